"""Preparation of an axis record as it is usual in robotics: filtered motion, decimated rows.

The position is low-passed without phase (Butterworth, 4th order, forwards and backwards),
differenced centrally, and every regressor is decimated like the force: low-passed without phase
(Chebyshev, 8th order, forwards and backwards) and sampled. The decimation is linear, so it is
applied to a predicted force as well as to a recorded one, in the frequency domain, where lags and
delays are factors.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..errors import InputError
from ..fitting.problem import bucket

_ORDER = 4
_CUTOFF_SHARE = 0.1
_ROWS_PER_CUTOFF = 1.0
_SLOW = 200.0
_SLOW_CUTOFF_SHARE = 0.2
_RIPPLE = 0.05
_PASS = 0.8
_EDGE = 0.2
_UNEVEN = 0.01
_MARGIN = 0.5


class Preparation(NamedTuple):
    """How an axis record is filtered.

    `cutoff` [Hz] of the Butterworth filter of the position; `decimation` keeps one row in so many;
    `edge` [s] is left out at both ends, where zero-phase filters have only one side.
    """

    cutoff: float
    decimation: int
    edge: float = _EDGE


def usual(interval: float) -> Preparation:
    """A tenth of the sampling rate for cutoff and rows (100 Hz and 10 of 1 kHz); records slower
    than 200 Hz keep all rows, with a cutoff of a fifth."""
    rate = 1 / interval
    if rate < _SLOW:
        return Preparation(_SLOW_CUTOFF_SHARE * rate, 1)
    return Preparation(_CUTOFF_SHARE * rate, round(_ROWS_PER_CUTOFF / _CUTOFF_SHARE))


class Motion(eqx.Module):
    """Measured motion at the full rate, padded at its end by rest."""

    time: Float[Array, " N"]
    position: Float[Array, " N"]
    velocity: Float[Array, " N"]
    acceleration: Float[Array, " N"]
    path: Float[Array, " N"]
    """Distance travelled."""


class Decimator(eqx.Module):
    """Zero-phase low-pass and sampling of a signal at the full rate, and time shifts of it."""

    gain: Float[Array, " f"]
    """Squared magnitude of the filter at the frequencies of the padded signal."""
    frequency: Float[Array, " f"]
    """Angular frequency [rad/s]."""
    margin: int = eqx.field(static=True)
    after: int = eqx.field(static=True)
    every: int = eqx.field(static=True)

    def __call__(
        self, signal: Float[Array, " N"], *, lag: ArrayLike = 0.0, lead: ArrayLike = 0.0
    ) -> Float[Array, " n"]:
        """Every n-th row of the signal low-passed, of signal + lag d(signal)/dt advanced by
        lead [s]."""
        m, more = self.margin, self.after
        before = 2 * signal[0] - signal[m:0:-1]
        after = 2 * signal[-1] - signal[-2 : -more - 2 : -1]
        extended = jnp.concatenate([before, signal, after])
        spectrum = jnp.fft.rfft(extended) * self.gain
        shift = (1 + 1j * self.frequency * lag) * jnp.exp(1j * self.frequency * lead)
        smooth = jnp.fft.irfft(spectrum * shift, extended.shape[0])
        return smooth[m : m + signal.shape[0] : self.every]


class Prepared(NamedTuple):
    """A prepared record; `rows` of it are real, the others padding."""

    motion: Motion
    decimator: Decimator
    interval: float
    """Between rows at the full rate [s]."""
    samples: int
    """Rows at the full rate."""
    time: np.ndarray
    """Of the decimated rows (n), from 0 [s]."""
    force: np.ndarray
    """Recorded, decimated."""
    rows: int
    inside: np.ndarray
    """Rows that are not at an end."""
    velocity_noise: float
    """Standard deviation of the error of the velocity, from what the filter takes away."""
    preparation: Preparation


def prepare(
    time: np.ndarray,
    position: np.ndarray | None,
    velocity: np.ndarray | None,
    force: np.ndarray,
    *,
    preparation: Preparation | None = None,
) -> Prepared:
    """Filter and pad a record; all SI, time from 0, one of position and velocity may be missing.

    Uneven sampling is interpolated to its median interval.

    Raises
    ------
    InputError : a cutoff beyond half the sampling rate, or a record shorter than its edges.
    """
    from scipy import signal

    time, position, velocity, recorded = _even(time, position, velocity, force)
    interval = float(np.median(np.diff(time)))
    chosen = preparation or usual(interval)
    if not 0 < chosen.cutoff * 2 * interval < 1:
        raise InputError(
            f"cutoff {chosen.cutoff:g} Hz: half the sampling rate is {0.5 / interval:g} Hz; choose"
            " less"
        )
    if time[-1] < 4 * chosen.edge or len(time) < 100:
        raise InputError(
            f"the record lasts {time[-1]:.3g} s in {len(time)} rows; {4 * chosen.edge:g} s and 100"
            " rows are needed"
        )
    low = signal.butter(_ORDER, chosen.cutoff * 2 * interval, output="sos")
    raw = position if position is not None else velocity
    assert raw is not None
    smooth = signal.sosfiltfilt(low, raw)
    if position is not None:
        q, v = smooth, np.gradient(smooth, interval)
    else:
        v = smooth
        q = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * interval)])
    a = np.gradient(v, interval)
    size = bucket(len(time), 1024)
    more = (0, size - len(time))
    motion = Motion(
        jnp.asarray(np.arange(size) * interval),
        jnp.asarray(np.pad(q, more, mode="edge")),
        jnp.asarray(np.pad(v, more)),
        jnp.asarray(np.pad(a, more)),
        jnp.asarray(np.pad(np.cumsum(np.abs(v)) * interval, more, mode="edge")),
    )
    decimator = _decimator(size, interval, chosen.decimation)
    decimated = np.asarray(decimator(jnp.asarray(np.pad(recorded, more, "edge"))))
    rows = -(-len(time) // chosen.decimation)
    at = np.arange(len(decimated)) * interval * chosen.decimation
    inside = (at >= chosen.edge) & (at <= time[-1] - chosen.edge)
    noise = _velocity_noise(raw, smooth, interval, chosen.cutoff, position is not None)
    return Prepared(
        motion, decimator, interval, len(time), at, decimated, rows, inside, noise, chosen
    )


def _even(
    time: np.ndarray, position: np.ndarray | None, velocity: np.ndarray | None, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None, np.ndarray]:
    """The record on an even grid of its median interval, from time 0."""
    time = time - time[0]
    steps = np.diff(time)
    interval = float(np.median(steps))
    if np.all(np.abs(steps - interval) < _UNEVEN * interval):
        return time, position, velocity, force
    grid = np.arange(0.0, time[-1] + 0.5 * interval, interval)
    on = lambda x: None if x is None else np.interp(grid, time, x)  # noqa: E731
    return grid, on(position), on(velocity), np.interp(grid, time, force)


def _decimator(size: int, interval: float, every: int) -> Decimator:
    from scipy import signal
    from scipy.fft import next_fast_len

    margin = max(8, min(round(_MARGIN / interval), size - 2))
    n = int(next_fast_len(size + 2 * margin, real=True) or size + 2 * margin)
    frequency = 2 * np.pi * np.fft.rfftfreq(n, interval)
    if every == 1:
        gain = np.ones_like(frequency)
    else:
        low = signal.cheby1(8, _RIPPLE, _PASS / every, output="sos")
        _, response = signal.sosfreqz(low, worN=frequency * interval)
        level = np.abs(np.asarray(response))
        gain = (level / level[0]) ** 2
    return Decimator(jnp.asarray(gain), jnp.asarray(frequency), margin, n - size - margin, every)


def _velocity_noise(raw, smooth, interval, cutoff, is_position: bool) -> float:
    """White noise beyond the cutoff, carried to the velocity within it."""
    share = 2 * cutoff * interval  # of the band that the filter keeps
    white = float(np.std(raw - smooth)) / np.sqrt(max(1 - share, 1e-3))
    if not is_position:
        return white * np.sqrt(share)
    return white * 2 * np.pi * cutoff * np.sqrt(share / 3)
