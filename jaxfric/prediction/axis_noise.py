"""The noise of an axis record, and the largest error that this noise explains.

The noise is white plus parts correlated in time, estimated from the residual of the model refitted
to the record. What a model lacks is no noise. Missing friction depends on the state of the axis, so
it looks like noise that is correlated over a part of a stroke. Some columns are therefore projected
out first: hat functions of velocity in each direction, of position, of the distance since a
reversal and of time; the likeliest ripple over position; and a delay of the force.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..fitting.axis_problem import AxisProblem
from ..fitting.noise import (
    Noise,
    estimate_noise,
    least_noise,
    noise_rows,
    recorded_steps,
    rms_error,
)
from ..fitting.padding import filled
from ..loop.axis.result import AxisRows
from ..loop.engine import longest_of_steps
from ..loop.learn import largest_rms, level_of
from ..loop.location import hats
from ..loop.screen import orthonormal
from ..loop.thresholds import COARSE, HELD_OUT

_FEWEST = 2
"""Rows per column: fewer rows leave no residual, so a short record has fewer hat functions."""
_VARIABLES = 6
"""Numbers of hat functions: velocity forwards and backwards, position (also with the sign of the
velocity), distance since a reversal, and time."""
_PERIODS = np.arange(4.0, 100.0, 0.5)
"""Periods of a ripple over the travel. Hat functions cover longer waves. Half a period between two
waves lets a ripple lose at most a tenth of its amplitude."""


class AxisNoise(NamedTuple):
    """The noise of an axis record."""

    noise: Noise
    """White and correlated parts, in units of `AxisProblem.noise_scale`."""
    largest: float
    """The ratio of rms to sigma that noise alone exceeds in about one record of a thousand."""


def noise_of_axis(
    problem: AxisProblem,
    rows: AxisRows,
    residual: Float[np.ndarray, " N"],
    columns: Float[np.ndarray, "N q"],
) -> AxisNoise:
    """Return the noise of the residual of a fit with the Jacobian `columns`, both in noise units.

    Noise is correlated over at most a tenth of a mean stroke or ten rows, whichever is longer.
    """
    clock, used = np.asarray(problem.clock), rows.used
    unit, n = float(problem.noise_scale), len(used)
    longest = longest_of_steps(clock[:n], int(rows.segment.max()) + 1)
    weight = filled(used.astype(float), len(clock), 0.0)
    force = np.asarray(problem.friction)[:n]
    structure = structure_columns(rows, residual[:n], columns[:n], force + unit * residual[:n])
    columns = np.concatenate([columns, filled(structure, len(clock), 0.0)], axis=1)
    columns, residual = columns * weight[:, None], residual * weight
    columns = columns[:, np.linalg.norm(columns, axis=0) > 0]
    least = least_noise(recorded_steps(force)) / unit
    lines = noise_rows(clock, weight, residual, columns, longest)
    noise = estimate_noise(lines, either_sign=True, least=least).noise
    level = level_of(clock, residual, columns, weight > 0, noise)
    # noise is no larger than what it leaves, but a slow part of unknown size may be estimated so
    level = min(level, float(np.sqrt(np.mean(residual[:n][used] ** 2))))
    chance = rms_error(clock, weight, noise)
    largest = max(HELD_OUT, largest_rms(float(np.hypot(chance, chance))))
    return AxisNoise(noise._replace(sigma=np.asarray(level)), largest)


def structure_columns(
    rows: AxisRows,
    residual: Float[np.ndarray, " n"],
    columns: Float[np.ndarray, "n q"],
    force: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n k"]:
    """Return columns of what a model of an axis may lack, for the residual of a fit with the
    Jacobian `columns` that predicts `force`; no columns for a record with few rows.

    A delay d of the force changes it by -d dF/dt.
    """
    used = rows.used
    most = int(used.sum()) // _FEWEST - columns.shape[1] - 3
    number = min(COARSE, most // _VARIABLES)
    if number < 2:
        return np.zeros((len(used), 0))
    delay = np.gradient(force, rows.time)[:, None]
    smooth = np.concatenate([_friction(rows, number), delay], axis=1)
    return np.concatenate([smooth, _ripple(rows, residual, np.hstack([columns, smooth]))], axis=1)


def _friction(rows: AxisRows, number: int) -> Float[np.ndarray, "n k"]:
    """Hat functions of friction, which has the sign of the velocity, and of a force of position."""
    sign, speed = np.sign(rows.velocity), np.abs(rows.velocity)
    used, since = rows.used, rows.path.copy()
    for k in np.unique(rows.segment):
        here = rows.segment == k
        since[here] -= since[here][0]
    found = []
    for way in (sign > 0, sign < 0):
        if np.any(used & way):
            centres = np.unique(np.quantile(speed[used & way], np.linspace(0, 1, number)))
            found.append(hats(speed, centres)[1] * way[:, None])
    for x, factor in (
        (rows.position, np.ones_like(sign)),
        (rows.position, sign),
        (np.sqrt(since), sign),
        (rows.time, sign),
    ):
        centres = np.linspace(x[used].min(), x[used].max(), number)
        found.append(hats(x, centres)[1] * factor[:, None])
    return np.concatenate(found, axis=1)


def _ripple(
    rows: AxisRows, residual: Float[np.ndarray, " n"], columns: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "n 2"]:
    """Cosine and sine over position, of the wavelength that explains most of the residual beside
    the other `columns`."""
    used, travel = rows.used, float(np.ptp(rows.position))
    others = orthonormal(columns[used])

    def beside(x: np.ndarray) -> np.ndarray:
        return x - others @ (others.T @ x)

    left, best, most = beside(residual[used]), np.zeros((len(used), 2)), -1.0
    for number in _PERIODS:
        phase = 2 * np.pi * number * rows.position / travel
        wave = np.stack([np.cos(phase), np.sin(phase)], axis=1)
        explained = float(np.sum((orthonormal(beside(wave[used])).T @ left) ** 2))
        if explained > most:
            best, most = wave, explained
    return best
