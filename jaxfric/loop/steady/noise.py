"""The noise of runs at steady speeds: the residual of the rows of each run about its mean.

Every run has its own noise scale, the standard deviation of the rows of the run. All runs share one
noise of the family of `fitting.noise`. The clocks of the noise are time, path (mean speed times
time) and row number. Runs at different speeds and sampling rates determine over which clock the
noise is correlated. On every clock the runs are placed so far apart that different runs are
uncorrelated. The restricted likelihood removes the mean of each run; otherwise a long correlation
would be underestimated. Runs that stick and slip are excluded if other runs exist.

A rotary axis often has noise that oscillates once per turn. A search that adds noise parts one by
one to white noise misses an oscillation once per turn, because the search fits the correlation of
neighbouring rows first. So for a rotary axis the search has an additional start with one
oscillation per turn. Not supported: several oscillations per turn, which two noise parts cannot
model.
"""

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from ...errors import InputError
from ...fitting.fit import require_float64
from ...fitting.noise import (
    CLOCKS,
    LONGEST,
    ROTARY_CLOCKS,
    Exponential,
    Family,
    Found,
    Noise,
    NoiseEstimate,
    Resonator,
    estimate_noise,
    least_noise,
    noise_estimate,
    noise_rows,
    profile_noise,
    recorded_steps,
    sandwich,
)
from ...records.steady import SteadyCurve
from ..thresholds import APART, FEWEST_ROWS, MEMORY, MOST_ROWS, SHORTER, SIZE

_ANGLE = 1
"""Index of the clock of the path."""


@dataclass(frozen=True, eq=False)
class SteadyNoise:
    """The noise of the rows of R runs about the mean of each run; arrays are read-only.

    - `estimate`: `sigma` [unit of force] is the standard deviation in a run of scale 1; `scale` of
      every run [R] has a mean square of 1 over all runs (0 if a force never changes).
    - `clock`: time [s], path [m or rad] and row number of the n rows of the estimate [n, 3], with
      the runs far apart; `residual`: the residuals of these rows in units of the run's scale [n];
      `run`: the run of each row [n].
    - `effective`: effective number of independent samples of each run under the noise [R].
    - `after_a_turn`: autocorrelation of rows one turn apart, over all runs of at least two turns;
      None if no run is so long, or for a linear axis.
    """

    estimate: NoiseEstimate
    clock: np.ndarray
    residual: np.ndarray
    run: np.ndarray
    effective: np.ndarray
    after_a_turn: float | None = None


def steady_noise(curve: SteadyCurve) -> SteadyNoise | None:
    """The noise of the runs of a curve; None if no rows were kept or no force ever changes.

    Raises
    ------
    InputError : JAX uses 32-bit numbers; the curve has the rows of only some of its runs.
    """
    if not curve.rows:
        return None
    if len(curve.rows) != len(curve):
        raise InputError(
            f"the curve has {len(curve)} runs and the rows of {len(curve.rows)}; keep those of all"
            " runs, or none"
        )
    require_float64()
    clocks = [_clock(curve, k) for k in range(len(curve))]
    left = [np.asarray(rows.force) - np.mean(rows.force) for rows in curve.rows]
    scale = np.array([np.sqrt(np.sum(x**2) / max(len(x) - 1, 1)) for x in left])
    slipping = curve.slipping()
    moving = np.flatnonzero((scale > 0) & ~slipping)
    if not len(moving):
        moving = np.flatnonzero(scale > 0)
    if not len(moving):
        return None
    left = [x / (s if s > 0 else 1.0) for x, s in zip(left, scale, strict=True)]
    used = moving.tolist()
    middle = {k: _middle(len(left[k]), MOST_ROWS // len(used)) for k in used}
    clock, longest = _in_a_row([clocks[k][middle[k]] for k in used])
    residual = np.concatenate([left[k][middle[k]] for k in used])
    run = np.concatenate([np.full(len(left[k][middle[k]]), k) for k in used])
    sizes = np.array([len(left[k]) for k in moving])
    rms = float(np.sqrt(np.average(scale[moving] ** 2, weights=sizes)))
    steps = recorded_steps(np.concatenate([curve.rows[k].force for k in moving]))
    least = least_noise(steps) / float(scale.max())
    rotary = curve.coordinate == "rotary"
    found = _likeliest(clock, residual, run, longest, least, rotary=rotary)
    told = noise_estimate(
        found.noise,
        rms,
        longest,
        by_step=((), (scale / rms).tolist()),
        steps=steps,
        clocks=ROTARY_CLOCKS if rotary else CLOCKS,
    )
    effective = _worth(clocks, found.noise)
    turn = after_a_turn([clocks[k][:, _ANGLE] for k in moving], [left[k] for k in moving])
    for values in (clock, residual, run, effective):
        values.setflags(write=False)
    return SteadyNoise(told, clock, residual, run, effective, turn if rotary else None)


def _clock(curve: SteadyCurve, k: int) -> np.ndarray:
    """Time, path and rows of a run since its first row, (n, 3)."""
    rows = curve.rows[k]
    time = np.asarray(rows.time) - rows.time[0]
    number = np.asarray(rows.number, float) - rows.number[0]
    return np.stack([time, abs(curve.speed[k]) * time, number], axis=1)


def _middle(n: int, most: int) -> slice:
    """The middle `most` of n rows, or all."""
    begin = max(n - most, 0) // 2
    return slice(begin, begin + min(n, most))


def _in_a_row(clocks: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The runs one after another, far apart; and the longest correlation length on each clock (3,).

    That is a tenth of the mean duration, path and number of rows of a run: one run samples slower
    noise too rarely.
    """
    longest = LONGEST * np.mean([np.ptp(clock, axis=0) for clock in clocks], axis=0)
    placed, begin = [], np.zeros(3)
    for clock in clocks:
        placed.append(clock - clock[0] + begin)
        begin = placed[-1][-1] + APART * longest
    return np.concatenate(placed), longest


def _likeliest(
    clock: np.ndarray,
    residual: np.ndarray,
    run: np.ndarray,
    longest: np.ndarray,
    least: float,
    *,
    rotary: bool,
) -> Found:
    """The noise found part by part, or one that oscillates once per turn if its BIC is lower."""
    weight = np.ones(len(residual))
    means = (run[:, None] == np.unique(run)).astype(float)
    rows = noise_rows(clock, weight, residual, means, longest)
    found = estimate_noise(rows, least=least)
    if not rotary:
        return found
    memory = math.log(MEMORY * longest[_ANGLE])
    family = Family((Exponential.over(_ANGLE), Resonator.over(_ANGLE)))
    once = memory  # the shape, frequency times memory, of an oscillation at 1/rad
    starts = [np.array([SIZE, memory + a, SIZE, memory, once]) for a in SHORTER]
    turning = profile_noise(rows, family, starts, least=least)
    return max((found, turning), key=rows.merit)


def _worth(clocks: list[np.ndarray], noise: Noise) -> np.ndarray:
    """Effective number of independent samples of each run: 1 over the variance of the mean, for
    noise of variance 1, limited to 1..n."""
    unit = noise._replace(sigma=noise.sigma / noise.sigma)
    most, found = max(len(clock) for clock in clocks), []
    for clock in clocks:
        n = len(clock)  # padded to one length, so that one shape is compiled
        padded = np.pad(clock, ((0, most - n), (0, 0)), mode="edge")
        each = np.where(np.arange(most) < n, 1 / n, 0.0)[:, None]
        variance = float(sandwich(jnp.asarray(padded), jnp.asarray(each), unit)[0, 0])
        found.append(np.clip(1 / max(variance, 1e-300), 1.0, n))
    return np.array(found)


def after_a_turn(angles: list[np.ndarray], left: list[np.ndarray]) -> float | None:
    """Autocorrelation of rows one turn apart, over all runs of at least two turns.

    `angles` [rad] increase with the rows of a run; `left` is the residual of the run in units of
    the run's scale. The value one turn later is interpolated between two rows.
    """
    products, squares = [], []
    for angle, x in zip(angles, left, strict=True):
        if len(x) < FEWEST_ROWS or np.ptp(angle) < 2 * math.tau:
            continue
        first, last = angle + math.tau <= angle[-1], angle - math.tau >= angle[0]
        later = np.interp(angle[first] + math.tau, angle, x)
        products.append(x[first] * later)
        # variance of rows, as interpolated values have less
        size = 0.5 * (np.mean(x[first] ** 2) + np.mean(x[last] ** 2))
        squares.append(np.full(len(later), size))
    if not products:
        return None
    return float(np.concatenate(products).sum() / np.concatenate(squares).sum())
