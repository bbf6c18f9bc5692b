"""Preparation of an axis record: filtered motion, fewer rows to compare.

The position passes a zero-phase low-pass (Butterworth, 4th order, forwards and backwards) and
central differences. A row replaces several samples. If rows are long, 20 to 39 samples of the
filtered motion are kept per row. Twenty samples per row represent the whole passband of the
low-pass; more samples would only cost time. One of three methods reduces both recorded and
predicted forces to rows:

- `Means`: means of consecutive samples. White noise stays white in means of consecutive samples, so
  the loop uses `Means`.
- the low-pass of longer rows: zero phase, magnitude 1/sqrt(1 + (f/f_N)^8), f_N half the row rate.
  The passed and the aliased power of this low-pass add up to 1 within 5 %, so white noise stays
  white. The low-pass of longer rows removes most of the force above the row rate 2 f_N, where the
  low-pass of the position removes motion.
- `Decimator`: zero-phase low-pass (Chebyshev, 8th order, forwards and backwards), then sampling, as
  usual in robotics. Published errors of robots refer to rows from `Decimator`.
"""

import abc
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Num

from ..errors import InputError
from ..motion import MeasuredMotion
from ..records.differences import noise_from_differences
from . import thresholds as const
from .padding import bucket


class Preparation(NamedTuple):
    """How an axis record is filtered.

    `cutoff` [Hz] is the cutoff of the position's Butterworth filter, `decimation` the number of
    samples per row.
    """

    cutoff: float
    decimation: int


def usual(interval: float, cutoff: float | None = None) -> Preparation:
    """Default preparation: cutoff at a tenth of the sampling rate, ten samples per row.

    Records sampled more slowly than 200 Hz keep all rows, with a cutoff at a fifth of the sampling
    rate. A given `cutoff` [Hz] above half of the default does not change the length of rows. Short
    rows give a fit more information than a low-pass with such a cutoff removes. With a `cutoff`
    below half of the default cutoff, a row of a fast record lasts 1/cutoff. All forces are then
    low-passed at half the cutoff, because the filtered motion lacks higher frequencies.
    """
    rate = 1 / interval
    share, rows = const.CUTOFF_SHARE, round(1 / const.CUTOFF_SHARE)
    if rate < const.SLOW:
        share, rows = const.SLOW_CUTOFF_SHARE, 1
    first = share * rate
    if cutoff is None:
        return Preparation(first, rows)
    if cutoff > 0 and cutoff < const.SAME_ROWS * first:
        rows = round(rows * first / cutoff)
    thin = max(rows // const.SAMPLES_OF_ROW, 1)
    return Preparation(cutoff, thin * round(rows / thin))


class AbstractSampler(eqx.Module):
    """Reduces a signal along the motion to fewer rows."""

    every: eqx.AbstractVar[int]

    @abc.abstractmethod
    def __call__(self, signal: Float[Array, " N"]) -> Float[Array, " n"]:
        """One row per `every` samples."""


class Means(AbstractSampler):
    """Means of `every` samples."""

    every: int = eqx.field(static=True)

    @eqx.filter_jit
    def __call__(self, signal: Float[Array, " N"]) -> Float[Array, " n"]:
        """The row of samples k..k+every-1 belongs to the time of their middle."""
        return jnp.mean(signal.reshape(-1, self.every), axis=1)


class Decimator(AbstractSampler):
    """Low-pass, then every n-th sample."""

    gain: Num[Array, " f"]
    """Gain of the filter at the frequencies of the extended signal; its phase shifts the rows if
    they lie between samples."""
    margin: int = eqx.field(static=True)
    after: int = eqx.field(static=True)
    every: int = eqx.field(static=True)

    @eqx.filter_jit
    def __call__(self, signal: Float[Array, " N"]) -> Float[Array, " n"]:
        """The row of sample k is at that sample, shifted by the phase of `gain`."""
        m, more = self.margin, self.after
        before = 2 * signal[0] - signal[m:0:-1]
        after = 2 * signal[-1] - signal[-2 : -more - 2 : -1]
        extended = jnp.concatenate([before, signal, after])
        smooth = jnp.fft.irfft(jnp.fft.rfft(extended) * self.gain, extended.shape[0])
        return smooth[m : m + signal.shape[0] : self.every]


def shifted(
    signal: Float[Array, " N"],
    interval: ArrayLike,
    *,
    lag: Float[Array, ""],
    lead: Float[Array, ""],
    late: Float[Array, ""],
) -> Float[Array, " N"]:
    """signal + lag signal', advanced by `lead`, delayed by `late` (first-order lag); to second
    order in the times. Differences of samples cancel in the sum over a row, so a jump of the signal
    does no harm.
    """
    slope = jnp.asarray(jnp.gradient(signal)) / interval
    bend = jnp.asarray(jnp.gradient(slope)) / interval
    second = lag * (lead - late) + 0.5 * lead**2 + late**2 - lead * late
    return signal + (lag + lead - late) * slope + second * bend


class Prepared(NamedTuple):
    """A prepared axis record; the first `rows` rows are data, all further rows are padding."""

    motion: MeasuredMotion
    means: Means
    forces: AbstractSampler
    """Filters forces and reduces them to the rows of the loop, at the times of `means`."""
    usual: Decimator
    interval: float
    """Time between samples of the record [s]."""
    step: float
    """Time between samples of the motion [s]."""
    time: np.ndarray
    """Times of the rows (n), from 0 [s]."""
    force: np.ndarray
    """Recorded force at the rows, filtered by `forces` (n)."""
    usual_force: np.ndarray
    """Recorded force at the rows, filtered by `usual` (n)."""
    rows: int
    inside: np.ndarray
    """Rows outside the excluded edges."""
    white: float
    """Standard deviation of the white error of the recorded position, or velocity if there is no
    position; from the part that the default filter removes."""
    of_position: bool
    scatter: np.ndarray
    """rms of the white error of the recorded motion at each row (n). Where an axis is at rest, the
    steps of its encoder are no error."""
    taken: np.ndarray
    """rms of the part of the motion that the low-pass removed, at each row (n)."""
    floor: float
    """Error of one sample of the recorded motion, from its fourth differences; at least the
    rounding error. A low-pass that removes no more than this removes no motion."""
    preparation: Preparation

    @property
    def velocity_noise(self) -> float:
        """Standard deviation of the velocity error within the passband."""
        cutoff = self.preparation.cutoff
        share = 2 * cutoff * self.interval  # of the Nyquist band
        if not self.of_position:
            return self.white * np.sqrt(share)
        return self.white * 2 * np.pi * cutoff * np.sqrt(share / 3)


def acceleration_noise(prepared: Prepared) -> float:
    """Standard deviation of a row's acceleration error, from the white error of the recorded
    motion."""
    f = np.linspace(0, 0.5 / prepared.interval, const.FREQUENCIES + 1)[1:]
    return prepared.white * float(np.sqrt(np.mean(_acceleration_gain(prepared, f) ** 2)))


def acceleration_errors(prepared: Prepared, white: float) -> np.ndarray:
    """A random draw of the acceleration errors (n), if the recorded motion has an error of standard
    deviation `white` in each sample."""
    size = prepared.rows * prepared.preparation.decimation
    drawn = np.fft.rfft(np.random.default_rng(const.SEED).standard_normal(size))
    gain = _acceleration_gain(prepared, np.fft.rfftfreq(size, prepared.interval))
    return white * np.fft.irfft(drawn * gain, size)[:: prepared.preparation.decimation]


def _acceleration_gain(prepared: Prepared, f: np.ndarray) -> np.ndarray:
    """Gain from the recorded motion to a row's acceleration at frequencies f [Hz]: low-pass (both
    ways), central differences, and the row filter."""
    h, every = prepared.interval, prepared.preparation.decimation
    low = 1 / (1 + (f / prepared.preparation.cutoff) ** (2 * const.ORDER))
    slope = np.sin(2 * np.pi * f * h) / h
    row = np.sinc(f * every * h) / np.sinc(f * h)
    if not isinstance(prepared.forces, Means):
        row = _of_rows(f, h, every)
    return slope ** (2 if prepared.of_position else 1) * low * row


def prepare(
    time: np.ndarray,
    position: np.ndarray | None,
    velocity: np.ndarray | None,
    force: np.ndarray,
    *,
    preparation: Preparation | None = None,
    held: bool = False,
) -> Prepared:
    """Filter and pad a record in SI units. Position or velocity may be missing.

    An unevenly sampled record is interpolated to its median sampling interval. With a zero-order
    hold (`held`) the recorded force acts half a sample late, so `force` is the mean of two
    neighbouring samples.

    Raises
    ------
    InputError : a cutoff outside 0 to half the sampling rate, or so low that too few rows remain;
        a record shorter than its edges.
    """
    count = len(time)
    time, position, velocity, recorded = _even(time, position, velocity, force)
    interval = float(np.median(np.diff(time)))
    chosen = preparation or usual(interval)
    _refuse_unusable(chosen, time, interval, count)
    raw = position if position is not None else velocity
    assert raw is not None
    smooth = _low_pass(raw, chosen.cutoff, interval)
    every = chosen.decimation
    more = (0, -(-bucket(len(time), 1024) // every) * every - len(time))
    size = len(time) + more[1]
    # thinning of the motion: a divisor of the samples per row
    thin = next(k for k in range(max(every // const.SAMPLES_OF_ROW, 1), 0, -1) if every % k == 0)
    kept = slice(thin // 2, None, thin)
    motion = _motion(smooth, interval, more, kept, of_position=position is not None)
    along, recording = _samplers(size, interval, every, thin)
    padded = np.pad(recorded, more, "edge")
    acting = 0.5 * (padded + np.concatenate([padded[:1], padded[:-1]])) if held else padded
    at = (np.arange(size // every) * every + kept.start + 0.5 * (every - thin)) * interval
    rows = len(time) // every
    white, edge = _white(raw, smooth, chosen, interval), round(const.EDGE / interval)
    at_rows = np.asarray(recording[0](jnp.asarray(acting)))
    ratio = float(np.ptp(acting)) / noise_from_differences(at_rows[:rows])
    ends = _ends(chosen, interval, time[-1], ratio)
    return Prepared(
        motion,
        Means(every // thin),
        *along,
        interval,
        thin * interval,
        at,
        at_rows,
        np.asarray(recording[1](jnp.asarray(padded))),
        rows,
        (at >= ends) & (at <= time[-1] - ends),
        float(np.std(white[edge : len(raw) - edge])),
        position is not None,
        np.sqrt(np.mean(np.pad(white**2, more).reshape(-1, every), axis=1)),
        np.sqrt(np.mean(np.pad((raw - smooth) ** 2, more).reshape(-1, every), axis=1)),
        _floor(raw),
        chosen,
    )


def memory(chosen: Preparation, interval: float, ratio: float) -> float:
    """Time [s] after which the filters have forgotten a jump that is `ratio` times the noise.

    The step response of a Butterworth low-pass of order n and cutoff f ends as exp(-t/tau),

        tau = 1/(2 pi f sin(pi/(2 n))),    t = tau ln(ratio),

    by its slowest pair of poles (Butterworth 1930); forwards and backwards, tau stays. f is the
    lower one of the position's cutoff and, for long rows, half the row rate. The poles' amplitudes
    are below 1/4, so that less than a quarter of the noise remains.
    """
    rows = 0.5 / (chosen.decimation * interval)
    long = chosen.decimation > usual(interval).decimation
    cutoff = min(chosen.cutoff, rows) if long else chosen.cutoff
    return float(np.log(ratio) / (2 * np.pi * cutoff * np.sin(np.pi / (2 * const.ORDER))))


def _ends(chosen: Preparation, interval: float, duration: float, ratio: float) -> float:
    """Time [s] left out at both ends: there a filter sees samples on one side only.

    A record may begin or end with a jump. `ratio`: the range of the force over the noise of a row.
    """
    most = max(const.EDGE, const.MOST_EDGE * duration)
    return min(max(const.EDGE, memory(chosen, interval, max(ratio, 1.0))), most)


def _refuse_unusable(chosen: Preparation, time: np.ndarray, interval: float, count: int) -> None:
    """Raise `InputError` for an unusable cutoff or record. `time` is on the even grid; `count` is
    the number of rows before interpolation."""
    if not 0 < chosen.cutoff * 2 * interval < 1:
        raise InputError(
            f"cutoff {chosen.cutoff:g} Hz: choose one above 0 and below half the sampling rate,"
            f" {0.5 / interval:g} Hz"
        )
    if time[-1] < 4 * const.EDGE or len(time) < 100:
        raise InputError(
            f"the record lasts {time[-1]:.3g} s in {count} rows"
            + (f" ({len(time)} at their usual interval)" if len(time) != count else "")
            + f"; {4 * const.EDGE:g} s and 100 rows are needed at any cutoff: both ends, of"
            f" {const.EDGE:g} s, are left out"
        )
    if len(time) < const.FEWEST_ROWS * chosen.decimation:
        raise InputError(
            f"cutoff {chosen.cutoff:g} Hz: of {time[-1]:.3g} s that leaves"
            f" {len(time) // chosen.decimation} rows, and {const.FEWEST_ROWS} are needed; choose"
            f" one above {const.FEWEST_ROWS / time[-1]:.2g} Hz"
        )


def _low_pass(raw: np.ndarray, cutoff: float, interval: float) -> np.ndarray:
    """Butterworth low-pass, forwards and backwards for zero phase."""
    from scipy import signal

    return signal.sosfiltfilt(signal.butter(const.ORDER, cutoff * 2 * interval, output="sos"), raw)


def _white(raw: np.ndarray, smooth: np.ndarray, chosen: Preparation, interval: float) -> np.ndarray:
    """White error of the motion at each sample, from the part that the default low-pass removes. A
    lower cutoff would remove motion too."""
    above = usual(interval).cutoff
    least = smooth if above == chosen.cutoff else _low_pass(raw, above, interval)
    return (raw - least) / np.sqrt(max(1 - 2 * above * interval, 1e-3))


def _motion(
    smooth: np.ndarray,
    interval: float,
    more: tuple[int, int],
    kept: slice,
    *,
    of_position: bool,
) -> MeasuredMotion:
    """Motion from a smooth position or velocity, padded by `more` samples at rest at the ends,
    then thinned to the samples `kept`."""
    if of_position:
        q, v = smooth, np.gradient(smooth, interval)
    else:
        v = smooth
        q = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * interval)])
    a = np.gradient(v, interval)
    return MeasuredMotion(
        jnp.asarray((np.arange(len(q) + sum(more)) * interval)[kept]),
        jnp.asarray(np.pad(q, more, mode="edge")[kept]),
        jnp.asarray(np.pad(v, more)[kept]),
        jnp.asarray(np.pad(a, more)[kept]),
        jnp.asarray(np.pad(np.cumsum(np.abs(v)) * interval, more, mode="edge")[kept]),
    )


def _floor(raw: np.ndarray) -> float:
    # 70 is the sum of squares of the fourth difference's coefficients, 1 4 6 4 1
    levels = np.diff(np.unique(raw))
    rounded = float(np.median(levels)) if 2 * len(levels) < len(raw) else 0.0
    return max(float(np.std(np.diff(raw, 4))) / np.sqrt(70), rounded / np.sqrt(12))


def _even(
    time: np.ndarray, position: np.ndarray | None, velocity: np.ndarray | None, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None, np.ndarray]:
    """The record on an even grid with its median interval, from time 0."""
    time = time - time[0]
    steps = np.diff(time)
    interval = float(np.median(steps))
    if np.all(np.abs(steps - interval) < const.UNEVEN * interval):
        return time, position, velocity, force
    grid = np.arange(0.0, time[-1] + 0.5 * interval, interval)
    on = lambda x: None if x is None else np.interp(grid, time, x)  # noqa: E731
    return grid, on(position), on(velocity), np.interp(grid, time, force)


def _of_rows(f: np.ndarray, interval: float, every: int) -> np.ndarray:
    """Gain of the low-pass of long rows at frequencies f [Hz]."""
    return 1 / np.sqrt(1 + (2 * f * every * interval) ** (2 * const.ORDER))


_Samplers: TypeAlias = tuple[AbstractSampler, Decimator]
"""The sampler for the rows of the loop, and that for the rows of published errors."""


def _samplers(size: int, interval: float, every: int, thin: int) -> tuple[_Samplers, _Samplers]:
    """Samplers of a force computed along the (thinned) motion, and of a recorded force."""
    begin, middle = thin // 2 * interval, 0.5 * (every - thin) * interval
    along = _decimators(size // thin, thin * interval, every // thin, middle)
    if every <= usual(interval).decimation:
        along = Means(every), along[1]
    return along, along if thin == 1 else _decimators(size, interval, every, middle, begin)


def _decimators(
    size: int, interval: float, every: int, middle: float, begin: float = 0.0
) -> tuple[Decimator, Decimator]:
    """Decimators for the rows of the loop and of published errors. Published rows lie `begin` [s]
    after every `every`-th sample, rows of the loop `middle` [s] later."""
    from scipy import signal
    from scipy.fft import next_fast_len

    margin = max(8, min(round(const.MARGIN / interval), size - 2))
    n = int(next_fast_len(size + 2 * margin, real=True) or size + 2 * margin)
    f = np.fft.rfftfreq(n, interval)
    long = _of_rows(f, interval, every) * np.exp(2j * np.pi * f * (begin + middle))
    published = np.ones_like(f)
    if every > 1:
        low = signal.cheby1(8, const.RIPPLE, const.PASS / every, output="sos")
        _, response = signal.sosfreqz(low, worN=2 * np.pi * f * interval)
        level = np.abs(np.asarray(response))
        published = (level / level[0]) ** 2
    if begin:
        published = published * np.exp(2j * np.pi * f * begin)
    after = n - size - margin
    return (
        Decimator(gain=jnp.asarray(long), margin=margin, after=after, every=every),
        Decimator(gain=jnp.asarray(published), margin=margin, after=after, every=every),
    )
