"""The noise of runs at steady speeds: what is left of their rows after the mean of each.

Every run has a scale of its own, the standard deviation of its rows, and all runs have one noise,
of the family of `fitting.noise`. Its clocks are time, path (mean speed times time) and rows: runs
at other speeds and sampling rates tell over which of them it forgets. Runs follow each other so
far apart on every clock that nothing is remembered from one to the next, and each loses the
direction of its mean (restricted likelihood), without which a long memory comes out too short.
Runs that stick and slip are left out, if there are others.

What turns makes noise that swings once a turn. From white noise on, part by part, it is not found:
what neighbouring rows share is taken first. So of a rotary axis it is one of the starts. Not tried:
several swings a turn, which two parts cannot be.
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
from ..thresholds import FEWEST_ROWS

_APART = 20.0
"""Longest memories between two runs: exp(-20) of a noise is left."""
_MOST_RUNS, _MOST_ROWS = 64, 16384
"""Most runs and rows that noise is estimated from; of more runs some, evenly over speed."""
_ANGLE = 1
"""The clock of the path."""
_SIZE, _MEMORY, _SHORTER = 4.0, 0.9, (-3.0, -1.0)
"""Starts of a swing once a turn: logarithm of both parts over white, its memory as a share of the
longest one, and logarithms of the other part's memory over that."""


@dataclass(frozen=True, eq=False)
class SteadyNoise:
    """The noise of the rows of R runs about their means; arrays are read-only.

    - `estimate`: what it is; `sigma` [unit of force] is its standard deviation in a run of scale 1,
      `scale` of every run [R] over all runs has a mean square of 1 (0 where a force never changes).
    - `clock`: time [s], path [m or rad] and rows of the n rows that it was estimated from [n, 3],
      the runs far apart; `residual`: what is left of them, each in units of its run's scale [n];
      `run`: the run of each [n].
    - `effective`: independent samples that the rows of a run are worth under the noise [R].
    - `after_a_turn`: how alike rows are that are one turn apart: their autocorrelation over all
      runs that last for two turns; None where there is none, or the axis does not turn.
    """

    estimate: NoiseEstimate
    clock: np.ndarray
    residual: np.ndarray
    run: np.ndarray
    effective: np.ndarray
    after_a_turn: float | None = None


def steady_noise(curve: SteadyCurve) -> SteadyNoise | None:
    """The noise of the runs of a curve; None where no rows were kept or no force ever changes.

    Raises
    ------
    InputError : JAX has 32-bit numbers; the curve keeps the rows of some of its runs only.
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
    used = _some(moving)
    middle = {k: _middle(len(left[k]), _MOST_ROWS // len(used)) for k in used}
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


def _some(moving: np.ndarray) -> list[int]:
    """The runs that a noise is estimated from, spread evenly over their order of speed."""
    if len(moving) <= _MOST_RUNS:
        return moving.tolist()
    return moving[np.linspace(0, len(moving) - 1, _MOST_RUNS).round().astype(int)].tolist()


def _middle(n: int, most: int) -> slice:
    """At most so many rows from the middle of n."""
    begin = max(n - most, 0) // 2
    return slice(begin, begin + min(n, most))


def _in_a_row(clocks: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The runs one after another, far apart; and the longest memory over each clock (3,).

    That is a tenth of the mean duration, path and number of rows of a run: what lasts longer is
    seen too seldom in one.
    """
    longest = LONGEST * np.mean([np.ptp(clock, axis=0) for clock in clocks], axis=0)
    placed, begin = [], np.zeros(3)
    for clock in clocks:
        placed.append(clock - clock[0] + begin)
        begin = placed[-1][-1] + _APART * longest
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
    """The noise from white on, part by part; or with a swing once a turn, if that is worth more."""
    weight = np.ones(len(residual))
    means = (run[:, None] == np.unique(run)).astype(float)
    rows = noise_rows(clock, weight, residual, means, longest)
    found = estimate_noise(rows, least=least)
    if not rotary:
        return found
    memory, once = math.log(_MEMORY * longest[_ANGLE]), 0.0  # logarithm of 2 pi/turn [1/rad]
    family = Family((Exponential.over(_ANGLE), Resonator.over(_ANGLE)))
    starts = [np.array([_SIZE, memory + a, _SIZE, memory, once]) for a in _SHORTER]
    turning = profile_noise(rows, family, starts, least=least)
    return max((found, turning), key=lambda one: _worth_of(one, len(residual)))


def _worth_of(found: Found, rows: int) -> float:
    """-BIC/2 of a noise."""
    return found.value - 0.5 * found.family.parameters * math.log(rows)


def _worth(clocks: list[np.ndarray], noise: Noise) -> np.ndarray:
    """Independent samples that the rows of each run are worth: 1 over the variance of their mean,
    of a noise of variance 1, in 1..n."""
    unit = noise._replace(sigma=noise.sigma / noise.sigma)
    most, found = max(len(clock) for clock in clocks), []
    for clock in clocks:
        n = len(clock)  # all runs are of one length, so that one shape is compiled
        padded = np.pad(clock, ((0, most - n), (0, 0)), mode="edge")
        each = np.where(np.arange(most) < n, 1 / n, 0.0)[:, None]
        variance = float(sandwich(jnp.asarray(padded), jnp.asarray(each), unit)[0, 0])
        found.append(np.clip(1 / max(variance, 1e-300), 1.0, n))
    return np.array(found)


def after_a_turn(angles: list[np.ndarray], left: list[np.ndarray]) -> float | None:
    """Autocorrelation of rows a turn apart, over all runs of two turns and more.

    `angles` [rad] rise with the rows of a run, of which `left` is left after its mean, in units of
    its scale. A row has its like between the two rows around one turn later.
    """
    products, squares = [], []
    for angle, x in zip(angles, left, strict=True):
        if len(x) < FEWEST_ROWS or np.ptp(angle) < 2 * math.tau:
            continue
        first, last = angle + math.tau <= angle[-1], angle - math.tau >= angle[0]
        later = np.interp(angle[first] + math.tau, angle, x)
        products.append(x[first] * later)
        # of rows, not of values between two rows, which are quieter
        size = 0.5 * (np.mean(x[first] ** 2) + np.mean(x[last] ** 2))
        squares.append(np.full(len(later), size))
    if not products:
        return None
    return float(np.concatenate(products).sum() / np.concatenate(squares).sum())
