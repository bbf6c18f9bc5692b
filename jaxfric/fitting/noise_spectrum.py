"""Whether a residual is white, told from its spectrum in a millisecond.

The search of `noise_search` whitens a record under hundreds of noises. Most of that is spared where
nothing is correlated. Over a piece of a record with one pace of all clocks a part of the noise is
stationary from row to row, whichever clock it forgets over, and the Fourier coefficients of the
piece are nearly independent: with s_j the variance of coefficient j, white part and correlated one
together 1, the restricted likelihood is, up to a constant,

    -2 log L = N log(sum_j I_j/s_j / N) + sum_j (1 - h_j) log s_j,   N = sum_j (1 - h_j)

I is the periodogram of the residual and h_j the share of coefficient j that the fit has taken,
from an orthonormal basis of the Jacobian. Neighbouring coefficients are summed over bands that a
part cannot resolve. Sampled at even distances d, the exponential has the spectrum of

    S(w) = (1 - r^2)/(1 - 2 r cos w + r^2),   r = exp(-d)

and a resonator the sum of two of them with complex r.

Only a bound is asked of it, with much to spare, so edges of pieces and uneven rows within them may
be neglected; where rows are too uneven for pieces it says nothing.

Source: Whittle 1953 (doi:10.1007/BF02590998) for the likelihood of a spectrum.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .noise import Numbers

_SAME_SPEED, _SAME_STEP = 0.02, 0.5  # relative changes from row to row within a piece
_SAME_CLOCK = 1e-3  # relative difference of two clocks that tell the same
_FEWEST = 64  # rows of a piece
_LEFT_OUT = 0.1  # most rows in shorter pieces
_BAND = 0.04
_MEMORIES, _SWINGING = 9, 7
_SIZES = np.exp(np.array([-3.0, -2.0, -1.0, 0.0, 1.5, 3.0]))
_NEGATIVE = np.array([0.2, 0.5, 0.8])
_BETAS = np.expm1(2 * np.array([-1.0, 0.0, 0.75, 1.75]))


class Spectrum(NamedTuple):
    """The residual by bands of frequencies of all pieces, (b,)."""

    angle: np.ndarray
    """Frequency [rad a row]."""
    step: Float[np.ndarray, "b k"]
    """How far every clock moves from row to row in the band's piece."""
    power: np.ndarray
    """Sum of the periodogram."""
    number: np.ndarray
    """Number of coefficients that the fit has left."""


def spectrum(
    clock: Float[Numbers, "n k"], weight: Float[Numbers, " n"], columns: Float[Numbers, "n m"]
) -> Spectrum | None:
    """The spectrum of the residual, column 0, with what the Jacobian, the others, has taken.

    None where the rows are not in pieces of `_FEWEST` rows with even clocks.
    """
    on = np.asarray(weight) > 0
    clock, columns = np.asarray(clock)[on], np.asarray(columns)[on]
    steps = np.abs(np.diff(clock, axis=0))
    pieces = _pieces(steps)
    rows = sum(stop - start for start, stop in pieces)
    if not rows or rows < (1 - _LEFT_OUT) * len(clock):
        return None
    basis = _basis(columns[:, 1:])
    left = columns[:, 0] - basis @ (basis.T @ columns[:, 0])
    found = [_bands(left[a:b], basis[a:b], np.median(steps[a : b - 1], axis=0)) for a, b in pieces]
    return Spectrum(*(np.concatenate(some) for some in zip(*found, strict=True)))


def gains_of_parts(
    seen: Spectrum, shortest: np.ndarray, longest: np.ndarray, *, either_sign: bool = False
) -> tuple[float, float]:
    """By how much a part raises 2 log L above that of white noise: the likeliest exponential, and
    the likeliest resonator. Memories go from `shortest` to `longest` (k,) of every clock."""
    once, twice, known = [], [], []
    for k in np.flatnonzero(longest > shortest):
        away = seen.step[:, k] / np.geomspace(shortest[k], longest[k], _MEMORIES)[:, None]
        if any(np.allclose(away, other, rtol=_SAME_CLOCK, atol=0.0) for other in known):
            continue  # as rows and time of even sampling
        known.append(away)
        keep = np.exp(-away)
        shape = _exponential(keep, seen.angle)
        once.append(_mixed(shape, _SIZES))
        if either_sign:
            keep = np.min(keep, axis=1, keepdims=True)
            most = (1 - keep) / (1 + keep)
            once += [(1 - less * most * shape) / (1 - less * most) for less in _NEGATIVE]
        away = seen.step[:, k] / np.geomspace(shortest[k], longest[k], _SWINGING)[:, None]
        twice += [_mixed(_resonator(away, beta, seen.angle), _SIZES) for beta in _BETAS]
    return _most(seen, once), _most(seen, twice)


def _mixed(shape: Float[np.ndarray, "m b"], sizes: np.ndarray) -> Float[np.ndarray, "g b"]:
    """Spectra of variance 1 of white noise and parts of some sizes relative to it."""
    each = sizes[:, None, None]
    return ((1 + each * shape) / (1 + each)).reshape(-1, shape.shape[1])


def _most(seen: Spectrum, shapes: list[np.ndarray]) -> float:
    """The largest gain of some spectra."""
    if not shapes:
        return 0.0
    s, total = np.maximum(np.concatenate(shapes), 1e-12), seen.number.sum()
    white = np.log(seen.power.sum() / total)
    gain = total * (white - np.log((1 / s) @ seen.power / total))
    return float(np.max(gain - np.log(s) @ seen.number))


def _exponential(keep: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Spectrum (m, b) of what keeps a share, which may be complex, from row to row, of variance
    1."""
    square = keep * keep
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (1 - square) / (1 - 2 * keep * np.cos(angle) + square)
    return np.where(np.isfinite(found), found, 1.0)  # a clock that stands, at frequency 0


def _resonator(away: np.ndarray, beta: float, angle: np.ndarray) -> np.ndarray:
    """Spectrum of a resonator (see `noise`) of variance 1 whose rows are `away` in memories."""
    beta = beta if abs(beta) > 1e-6 else 1e-6
    if beta > 0:  # of two parts that are conjugate
        s = 1j * np.sqrt(beta)
        both = (2 * (1 + 1 / s) * _exponential(np.exp((s - 1) * away), angle)).real
    else:
        s = np.sqrt(-beta)
        slow, fast = (np.exp(-(1 + sign * s) / (1 - s) * away) for sign in (-1, 1))
        both = (1 + 1 / s) * _exponential(slow, angle) + (1 - 1 / s) * _exponential(fast, angle)
    return np.maximum(0.5 * both, 0.0)


def _pieces(steps: Float[np.ndarray, "r k"]) -> list[tuple[int, int]]:
    """First and last row (one past) of pieces with one pace of all clocks, long enough."""
    clocks = [s for s in steps.T if np.any(s > 0)]
    breaks = np.zeros(max(len(steps) - 1, 0), bool)
    for s in clocks:
        breaks |= np.abs(np.diff(s)) > _SAME_STEP * np.maximum(s[1:], s[:-1])
    for a, b in itertools.pairwise(clocks[:2]):  # how fast one goes with the other
        pace = b / np.maximum(a, 1e-300)
        breaks |= np.abs(np.diff(pace)) > _SAME_SPEED * np.maximum(pace[1:], pace[:-1])
    edges = np.concatenate([[0], np.flatnonzero(breaks) + 1, [len(steps) + 1]])
    return [(int(a), int(b)) for a, b in itertools.pairwise(edges) if b - a >= _FEWEST]


def _basis(jacobian: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n q"]:
    """Orthonormal basis of the columns that are not 0."""
    size = np.linalg.norm(jacobian, axis=0)
    used = jacobian[:, size > 0] / size[size > 0]
    return np.linalg.qr(used)[0]


def _bands(left: np.ndarray, basis: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, ...]:
    """Angles, steps, power and number of coefficients of one piece, by bands."""
    n = len(left)
    power = np.abs(np.fft.rfft(left)) ** 2 / n
    taken = np.sum(np.abs(np.fft.rfft(basis, axis=0)) ** 2, axis=1) / n
    times = np.full(len(power), 2.0)
    times[0] = 1.0
    if n % 2 == 0:
        times[-1] = 1.0
    edges = [0, 1]
    while edges[-1] < len(power):
        edges.append(min(edges[-1] + max(1, int(_BAND * edges[-1])), len(power)))
    start = np.array(edges[:-1])
    count = np.add.reduceat(times, start)
    angle = 2 * np.pi / n * np.add.reduceat(times * np.arange(len(power)), start) / count
    number = np.maximum(np.add.reduceat(times * (1 - taken), start), 0.0)
    both = angle, np.broadcast_to(step, (len(angle), len(step)))
    return *both, np.add.reduceat(times * power, start), number
