"""Hum: lines of constant frequency, such as the mains, in the residual of a record.

The frequency of a wave along the path is proportional to velocity; the frequency of hum is
constant. To distinguish hum from waves, the residual is cut into pieces of constant velocity. The
periodogram of each piece is divided by the spectrum of the surrounding noise. The spectrum of the
noise is a cosine series, fitted to the logarithm of the periodogram. The periodograms of all pieces
are added at equal frequency. A spectral line is hum if it is significant in the sum over pieces,

    P = sum_i |sum_j r_j exp(2 pi i f t_j)|^2/(n_i S_i(f)),   under noise alone Gamma(pieces, 1).

Hum must persist through both halves of a piece, unlike ringing after a velocity step. Hum must also
be significant at two velocities, and no wave along the path may explain as much of the residual. In
this test a piece needs fewer cycles of the line than in the search for a frequency. A spectral line
at a single velocity may be a wave or hum. Such a line counts as hum only at a frequency of the
mains. Every piece has its own amplitude and phase of the hum, by least squares. Frequencies that
the sampling does not resolve are not searched.

Source: Lomb 1976 (doi:10.1007/BF00648343) and Scargle 1982 (doi:10.1086/160554) for uneven rows.
This module bins rows into cells of a quarter of the row interval, which lowers the power P by at
most 5 %.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from . import thresholds as const
from .filter import taken_out


class Hum(NamedTuple):
    """A spectral line of constant frequency."""

    frequency: float
    """[Hz]"""
    error: float
    """Its standard error [Hz]."""
    sizes: tuple[float, ...]
    """Its rms in every velocity step [unit of friction]; 0 if the rows do not resolve it."""

    def scaled(self, unit: float) -> "Hum":
        """The hum with its amplitudes in another unit."""
        return self._replace(sizes=tuple(unit * size for size in self.sizes))

    def to_json(self) -> dict:
        """The fields as JSON values."""
        return {"frequency": self.frequency, "std": self.error, "rms_by_step": list(self.sizes)}

    def text(self) -> str:
        """The hum as text: "hum at 100.0 Hz", with the error of the frequency from 0.1 Hz on."""
        known = f"{self.frequency:.1f}" + (f" ± {self.error:.1f}" if self.error >= 0.1 else "")
        return f"hum at {known} Hz"


class _Piece(NamedTuple):
    """Neighbouring rows of constant velocity, and the periodogram of their residual."""

    rows: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    speed: float
    frequency: Float[np.ndarray, " m"]
    power: Float[np.ndarray, " m"]
    """Relative to the surrounding noise: 1 on average."""
    around: Float[np.ndarray, " m"]
    lowest: float
    """Lowest frequency of the search; a line found in other pieces may have fewer cycles here."""

    @property
    def width(self) -> float:
        """Resolution of this piece in frequency [Hz]."""
        return 1 / float(np.ptp(self.time))

    def resolves(self, f: Float[np.ndarray, " k"] | float) -> np.ndarray:
        """Whether a known line has enough cycles in this piece, and at least two rows a cycle."""
        return (self.frequency[0] <= np.asarray(f)) & (np.asarray(f) <= self.frequency[-1])

    def searches(self, f: Float[np.ndarray, " k"] | float) -> np.ndarray:
        """Whether this piece alone may show a line at some frequencies."""
        return (self.lowest <= np.asarray(f)) & self.resolves(f)

    def at(self, f: np.ndarray) -> np.ndarray:
        """The power of this piece at some frequencies, 0 where it has too few cycles or rows."""
        return np.interp(f, self.frequency, self.power, left=0.0, right=0.0)

    def near(self, f: float) -> float:
        """The largest power within half the resolution of some frequencies."""
        here = np.abs(self.frequency - f) <= 0.5 * self.width
        return float(np.max(self.power, where=here, initial=0.0))

    def exact(self, left: np.ndarray, f: np.ndarray, part: slice = slice(None)) -> np.ndarray:
        """The power of this piece at some frequencies, by least squares over a part of the rows."""
        time, values = self.time[part], left[self.rows[part]]
        angle = 2 * np.pi * np.outer(f, time - time[0])
        c, s = np.cos(angle), np.sin(angle)
        a, b, cc, cs, ss = (
            c @ values,
            s @ values,
            *(np.sum(x, axis=1) for x in (c * c, c * s, s * s)),
        )
        both = cc * ss - cs**2
        # with two rows per cycle only one of sine and cosine is visible
        alone = both < const.HALF_A_CYCLE * len(time) ** 2
        power = 0.5 * (ss * a**2 - 2 * cs * a * b + cc * b**2) / np.where(alone, 1.0, both)
        power = np.where(alone, (a**2 + b**2) / len(time), power)
        return power / np.interp(f, self.frequency, self.around)


def find_hum(
    time: Float[np.ndarray, " n"],
    path: Float[np.ndarray, " n"],
    step: Int[np.ndarray, " n"],
    on: Bool[np.ndarray, " n"],
    columns: Float[np.ndarray, "n m"],
) -> tuple[tuple[Hum, ...], Float[np.ndarray, " n"]]:
    """The hum in a residual, in the unit of the residual, and the contribution of hum to every row.

    Column 0 of `columns` is the residual; the other columns are directions that a model may still
    fit. `step` is the velocity step of each row; rows outside the mask `on` are skipped.
    """
    wave, used = np.zeros(len(time)), np.flatnonzero(on)
    left = np.zeros(len(time))
    left[used] = taken_out(columns[used])[0]
    cut = _cut(time, step, used)
    found: list[tuple[float, float]] = []
    barred: list[tuple[float, float]] = []
    rest = left
    for _ in range(const.LINES_TRIED):
        pieces = [p for p in (_piece(rest, time, path, rows) for rows in cut) if p is not None]
        f = _likeliest(pieces, rest, barred)
        if f is None:
            break
        resolving = [p for p in pieces if p.resolves(f)]
        power = np.array([p.exact(rest, np.array([f]))[0] for p in resolving])
        error = _error(resolving, power)
        if _is_hum(pieces, resolving, power, rest, f):
            found.append((f, error))
            wave = _wave(cut, time, left, [f for f, _ in found])
            rest = left - wave
        barred.append((f, 1.5 * max(p.width for p in resolving)))
    count, hum = np.maximum(np.bincount(step), 1), []
    for f, error in sorted(found):
        squares = np.bincount(step, _wave(cut, time, left, [f]) ** 2)
        hum.append(Hum(f, error, tuple(np.sqrt(squares / count).tolist())))
    return tuple(hum), wave


def _error(pieces: list[_Piece], power: np.ndarray) -> float:
    """Lower bound of the standard error of a frequency, from its power P in all pieces: a piece of
    duration T gives sqrt(6/P)/(2 pi T) (Rife & Boorstyn 1974, doi:10.1109/TIT.1974.1055282)."""
    known = sum(x / p.width**2 for x, p in zip(power, pieces, strict=True))
    return float(np.sqrt(6 / max(known, 1e-300))) / (2 * np.pi)


def _cut(time: np.ndarray, step: np.ndarray, used: np.ndarray) -> list[np.ndarray]:
    """The rows of every piece."""
    found = []
    for k in np.unique(step[used]):
        own = used[step[used] == k]
        lasting, rows = float(np.ptp(time[own])), len(own)
        number = max(1, min(int(lasting / const.LONGEST_PIECE), rows // const.ROWS_OF_PIECE))
        found += np.array_split(own, number)
    return found


def _piece(left: np.ndarray, time: np.ndarray, path: np.ndarray, rows: np.ndarray) -> _Piece | None:
    """A piece with its periodogram; None if it is too short for one."""
    if len(rows) < const.FEWEST_OF_PIECE:
        return None
    when = time[rows]
    lasting = float(when[-1] - when[0]) * len(rows) / (len(rows) - 1)
    # if rows come in bursts, cells are limited by their mean interval
    cell = max(float(np.median(np.diff(when))), lasting / (const.FINER * len(rows))) / const.FINER
    size = int(np.ceil(lasting / cell)) * const.FINER
    place = np.round((when - when[0]) / cell).astype(int)
    values = np.bincount(place, left[rows] - np.mean(left[rows]), size)
    last = size // (2 * const.FINER)  # half a cycle a row
    power = np.abs(np.fft.rfft(values)[: last + 1]) ** 2 / len(rows)
    angle = np.pi * np.arange(last + 1) / last
    frequency = angle / (2 * np.pi * const.FINER * cell)
    first = const.CYCLES_FITTED * const.FINER
    if first >= last:  # fewer than two frequencies
        return None
    lowest = max(frequency[1] * const.CYCLES * const.FINER, const.CYCLES / const.LONGEST_PIECE)
    around = _smooth(power, angle)
    around[last + 1 - const.FINER :] *= 2  # no sine: chi-squared of 1 d.o.f., halved
    frequency, power, around = (x[first:] for x in (frequency, power, around))
    speed = float(np.ptp(path[rows])) / lasting
    return _Piece(rows, when, speed, frequency, power / around, around, lowest)


def _smooth(power: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Mean power of the noise: a few cosines of the angle, fitted to the logarithms of independent
    coefficients. Few cosines mean correlation over few rows, and logarithms give a line little
    weight."""
    own = slice(const.SLOW * const.FINER, None, const.FINER)
    number = len(power[own])
    order = np.arange(1 + int(np.clip(number // const.EACH_COSINE, *const.COSINES)))
    basis = np.cos(np.outer(angle, order))
    logs = np.log(np.maximum(power[own], 1e-300))
    found = np.linalg.lstsq(basis[own], logs, rcond=None)[0]
    return np.exp(basis @ found + np.euler_gamma)


def _likeliest(
    pieces: list[_Piece], left: np.ndarray, barred: list[tuple[float, float]]
) -> float | None:
    """The frequency of the most significant line; None if none is significant."""
    from scipy.special import gammaincc

    if not pieces:
        return None
    apart = min(p.frequency[1] - p.frequency[0] for p in pieces)
    most = max(p.frequency[-1] for p in pieces)
    f = apart * np.arange(int(most / apart) + 2)
    total = np.sum([p.at(f) for p in pieces], axis=0)
    searched = np.any([p.searches(f) for p in pieces], axis=0)
    count = np.where(searched, np.sum([p.resolves(f) for p in pieces], axis=0), 0)
    for centre, reach in barred:
        count = np.where(np.abs(f - centre) <= reach, 0, count)
    seen = np.flatnonzero(count)
    if not len(seen):
        return None
    chance = gammaincc(count[seen], total[seen])
    # if p underflows to 0, the largest power decides
    best = seen[np.lexsort((-total[seen], chance))[0]]
    resolving = [p for p in pieces if p.resolves(f[best])]
    low, high = min(p.lowest for p in pieces), max(p.frequency[-1] for p in resolving)
    around = np.clip(f[best] + apart * np.linspace(-1, 1, const.TRIED_AROUND), low, high)
    exact = np.sum([p.exact(left, around) for p in resolving], axis=0)
    independent = len(seen) / const.FINER
    if gammaincc(count[best], float(np.max(exact))) * independent > const.CHANCE_OF_HUM:
        return None
    return float(around[np.argmax(exact)])


def _is_hum(
    pieces: list[_Piece], resolving: list[_Piece], power: np.ndarray, left: np.ndarray, f: float
) -> bool:
    """Whether a line with this power in the pieces that resolve it is hum: see the module."""
    speed = np.array([p.speed for p in resolving])
    stands = power > -np.log(const.CHANCE_OF_LINE / len(power))
    for k in np.flatnonzero(stands):
        half = len(resolving[k].rows) // 2
        parts = (slice(None, half), slice(half, None))
        both = sum(resolving[k].exact(left, np.array([f]), part)[0] for part in parts)
        stands[k] = power[k] > const.GOES_ON * both
    if not stands.any():
        return False
    if _along_path(pieces, resolving, power, stands, f):
        return False
    if not _alike(speed[stands].min(), speed[stands].max()):
        return True
    known = [p for p, on in zip(resolving, stands, strict=True) if on]
    off = const.MAINS_OFF + const.CLEAR * _error(known, power[stands])
    return any(abs(f - mains) <= off for mains in const.MAINS)


def _along_path(
    pieces: list[_Piece], resolving: list[_Piece], power: np.ndarray, stands: np.ndarray, f: float
) -> bool:
    """Whether a wave along the path, with the wavelength from one piece, is significant at other
    velocities and stronger there than a line of constant frequency."""
    from scipy.special import gammaincc

    speed = np.array([p.speed for p in resolving])
    for k in np.flatnonzero(stands):
        other = ~_alike(speed, speed[k])
        in_time = float(np.sum(power[other]))
        far = [(p, f * p.speed / speed[k]) for p in pieces if not _alike(p.speed, speed[k])]
        seen = [p.near(g) for p, g in far if p.searches(g)]
        if (
            seen
            and sum(seen) > in_time
            and gammaincc(len(seen), 0.5 * sum(seen)) < const.CHANCE_OF_LINE
        ):
            return True
    return False


def _alike(one: np.ndarray | float, other: float) -> np.ndarray:
    """Whether velocities are equal within the tolerance."""
    return np.minimum(one, other) > const.SAME_VELOCITY * np.maximum(one, other)


def _wave(
    cut: list[np.ndarray], time: np.ndarray, left: np.ndarray, frequencies: list[float]
) -> np.ndarray:
    """Contribution of some frequencies to every row, by least squares in every piece."""
    wave = np.zeros(len(time))
    for rows in cut:
        when = time[rows] - time[rows[0]]
        apart = float(np.median(np.diff(when))) if len(rows) > 1 else np.inf
        lowest, highest = (
            const.CYCLES_FITTED / max(when[-1] + apart, 1e-300),
            0.5 * (1 + const.HALF_A_CYCLE) / apart,
        )
        own = [f for f in frequencies if lowest <= f <= highest]
        if own:
            angle = 2 * np.pi * np.outer(when, own)
            columns = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
            wave[rows] = columns @ np.linalg.lstsq(columns, left[rows], rcond=const.HALF_A_CYCLE)[0]
    return wave
