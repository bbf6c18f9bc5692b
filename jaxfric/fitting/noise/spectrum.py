"""Test from the spectrum whether a residual is white, in a millisecond.

The noise search whitens a record under hundreds of noises. If the noise is white, the spectral test
avoids most of the whitening. In a piece of a record all clocks advance evenly, so every noise part
is stationary from row to row. The Fourier coefficients of such a piece are nearly independent. Let
s_j be the variance of Fourier coefficient j, for a noise of total variance 1. The restricted
likelihood L follows from the spectrum, up to a constant:

    -2 log L = N log(sum_j I_j/s_j / N) + sum_j (1 - h_j) log s_j,   N = sum_j (1 - h_j)

I is the periodogram of the residual. h_j is the share of coefficient j that the fit absorbs, from
an orthonormal basis of the Jacobian. Neighbouring Fourier coefficients are summed over bands in
which the spectrum of no noise part changes noticeably. An exponential part, sampled at even
distances d, has the spectrum S(w):

    S(w) = (1 - r^2)/(1 - 2 r cos w + r^2),   r = exp(-d)

and other parts are sums of such spectra, with complex r.

The test for whiteness needs only a rough bound, so it neglects edges of pieces and uneven rows
within a piece. The test gives no result if no piece of the record has even rows.

Source: Whittle 1953 (doi:10.1007/BF02590998) for the likelihood of a spectrum.
"""

import itertools
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..padding import Numbers
from . import thresholds as const
from .parts import KINDS, AbstractPart, Limits


class Spectrum(NamedTuple):
    """Spectrum of the residual in frequency bands of all pieces, (b,)."""

    angle: np.ndarray
    """Frequency [rad per row]."""
    step: Float[np.ndarray, "b k"]
    """Advance of every clock per row in the band's piece."""
    power: np.ndarray
    """Sum of the periodogram."""
    number: np.ndarray
    """Number of coefficients, minus those that the fit absorbs."""


def spectrum(
    clock: Float[Numbers, "n k"], weight: Float[Numbers, " n"], columns: Float[Numbers, "n m"]
) -> Spectrum | None:
    """The spectrum of the residual (column 0), corrected for the Jacobian (other columns).

    The result is None if the rows do not form pieces of at least `PIECE` rows with even clocks.
    """
    on = np.asarray(weight) > 0
    clock, columns = np.asarray(clock)[on], np.asarray(columns)[on]
    steps = np.abs(np.diff(clock, axis=0))
    pieces = _pieces(steps)
    rows = sum(stop - start for start, stop in pieces)
    if not rows or rows < (1 - const.LEFT_OUT) * len(clock):
        return None
    basis = _basis(columns[:, 1:])
    left = columns[:, 0] - basis @ (basis.T @ columns[:, 0])
    found = [_bands(left[a:b], basis[a:b], np.median(steps[a : b - 1], axis=0)) for a, b in pieces]
    return Spectrum(*(np.concatenate(some) for some in zip(*found, strict=True)))


def gains_of_parts(
    seen: Spectrum, limits: Limits, *, either_sign: bool = False
) -> dict[type[AbstractPart], float]:
    """Rise of 2 log L from white noise to the likeliest additional part, for every kind of part."""
    clocks = np.flatnonzero(limits.longest > limits.shortest)
    kinds = [kind for kind in KINDS if kind.joins((), either_sign=either_sign)]
    return {
        kind: max((_gain(seen, kind, int(k), limits) for k in clocks), default=0.0)
        for kind in kinds
    }


def _gain(seen: Spectrum, kind: type[AbstractPart], clock: int, limits: Limits) -> float:
    """The largest rise of 2 log L by a part on one clock."""
    ends = np.log(limits.shortest[clock]), np.log(limits.longest[clock])
    shapes = kind.starts(np.linspace(*ends, const.SPECTRAL_MEMORIES).tolist())
    theta = np.array([[size, *own] for size in const.SPECTRAL_SIZES for own in shapes])
    parts = kind.at(theta, limits, clock)
    sizes = np.reshape(parts.share, (-1, len(shapes), 1))
    shape = _spectrum_of(jax.tree.map(lambda x: x[: len(shapes)], parts), seen)
    s = np.maximum((1 + sizes * shape) / (1 + sizes), 1e-12).reshape(-1, len(seen.angle))
    total = seen.number.sum()
    gain = np.log(seen.power.sum() / total) - np.log((1 / s) @ seen.power / total)
    return float(np.max(total * gain - np.log(s) @ seen.number))


def _spectrum_of(part: AbstractPart, seen: Spectrum) -> Float[np.ndarray, "m b"]:
    """Spectra of m parts of variance 1: sums of spectra of (complex) exponentials."""
    away, found = np.asarray(part.rates) @ seen.step.T, 0.0
    for size, rate in part.exponentials():
        keep = np.exp(-np.reshape(rate, (-1, 1)) * away)
        with np.errstate(invalid="ignore", divide="ignore"):
            own = (1 - keep**2) / (1 - 2 * keep * np.cos(seen.angle) + keep**2)
        own = np.where(np.isfinite(own), own, 1.0)  # a clock that stands, at frequency 0
        found = found + np.reshape(size, (-1, 1)) * own
    return np.maximum(np.real(found), 0.0)


def _pieces(steps: Float[np.ndarray, "r k"]) -> list[tuple[int, int]]:
    """Rows [first, last + 1] of sufficiently long pieces in which all clocks advance evenly."""
    clocks = [s for s in steps.T if np.any(s > 0)]
    breaks = np.zeros(max(len(steps) - 1, 0), bool)
    for s in clocks:
        breaks |= np.abs(np.diff(s)) > const.SAME_STEP * np.maximum(s[1:], s[:-1])
    for a, b in itertools.pairwise(clocks[:2]):  # relative speed of clocks
        pace = b / np.maximum(a, 1e-300)
        breaks |= np.abs(np.diff(pace)) > const.SAME_SPEED * np.maximum(pace[1:], pace[:-1])
    edges = np.concatenate([[0], np.flatnonzero(breaks) + 1, [len(steps) + 1]])
    return [(int(a), int(b)) for a, b in itertools.pairwise(edges) if b - a >= const.PIECE]


def _basis(jacobian: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n q"]:
    """Orthonormal basis of the non-zero columns."""
    size = np.linalg.norm(jacobian, axis=0)
    used = jacobian[:, size > 0] / size[size > 0]
    return np.linalg.qr(used)[0]


def _bands(left: np.ndarray, basis: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, ...]:
    """Angle, step, power and number of coefficients of one piece, by band."""
    n = len(left)
    power = np.abs(np.fft.rfft(left)) ** 2 / n
    taken = np.sum(np.abs(np.fft.rfft(basis, axis=0)) ** 2, axis=1) / n
    times = np.full(len(power), 2.0)
    times[0] = 1.0
    if n % 2 == 0:
        times[-1] = 1.0
    edges = [0, 1]
    while edges[-1] < len(power):
        edges.append(min(edges[-1] + max(1, int(const.BAND * edges[-1])), len(power)))
    start = np.array(edges[:-1])
    count = np.add.reduceat(times, start)
    angle = 2 * np.pi / n * np.add.reduceat(times * np.arange(len(power)), start) / count
    number = np.maximum(np.add.reduceat(times * (1 - taken), start), 0.0)
    both = angle, np.broadcast_to(step, (len(angle), len(step)))
    return *both, np.add.reduceat(times * power, start), number
