"""The noise of a new record, and the largest error that this noise explains.

The noise is estimated from the residual of the model refitted to the record, as in a loop
(`loop.learn.noise_floor`): directions of the parameters and smooth columns along the record are
projected out, because structure along the record is not noise. Noise may be correlated over a tenth
of the record in time or rows, as in a fit, and over a tenth of a velocity step along the path.

State evolves along the path, so a missing effect looks like noise that is correlated farther along
the path. A part of the noise at this limit counts as misfit, if noise over time or rows is clearly
less likely.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..fitting.noise import (
    CLOCKS,
    estimate_noise,
    least_noise,
    longest_memory,
    noise_rows,
    recorded_steps,
    rms_error,
)
from ..fitting.noise.parts import AbstractPart
from ..fitting.problem import Problem
from ..loop.engine import longest_of_steps, smooth_columns
from ..loop.learn import largest_rms, level_of
from ..loop.thresholds import ACCEPT, HELD_OUT

_PATH = CLOCKS.index("path")
_FEWEST = 2
"""Rows per column below which the smooth columns are left out: they would leave no residual."""
_AT_LIMIT = 0.9
"""Share of the largest correlation length from which a part of the noise counts as misfit."""


class RecordNoise(NamedTuple):
    """The noise of a record."""

    sigma: float
    """Standard deviation of a row, white and correlated parts together [friction]."""
    largest: float
    """The ratio of rms to `sigma` that noise alone exceeds in about one record of a thousand."""
    share: float
    """Share of the variance that is correlated."""


def noise_of_record(
    problem: Problem,
    step: np.ndarray,
    residual: Float[np.ndarray, " n"],
    columns: Float[np.ndarray, "N q"],
) -> RecordNoise:
    """Return the noise of a residual (n,) of a fit with the Jacobian `columns`, in noise units.

    `step` (n,) is the number of the velocity step of every row.
    """
    rows, size, unit = len(step), problem.time.shape[0], float(problem.noise_scale)
    clock, mask = np.asarray(problem.clock), np.arange(size) < rows
    longest = longest_memory(clock[:rows])
    longest[_PATH] = longest_of_steps(clock[:rows], int(step.max()) + 1)[_PATH]
    smooth = smooth_columns(clock[:rows, _PATH], step, size)
    if rows > _FEWEST * (columns.shape[1] + smooth.shape[1]):
        columns = np.concatenate([columns, smooth], axis=1)
    columns = columns * mask[:, None]
    columns = columns[:, np.linalg.norm(columns, axis=0) > 0]
    residual = np.pad(residual, (0, size - rows))
    least = least_noise(recorded_steps(np.asarray(problem.friction)[:rows])) / unit
    lines = noise_rows(clock, mask.astype(float), residual, columns, longest)
    found = estimate_noise(lines, least=least)
    if any(_at_limit(part, longest) for part in found.noise.parts):
        elsewhere = np.where(np.arange(len(longest)) == _PATH, 0.0, longest)
        lines = noise_rows(clock, mask.astype(float), residual, columns, elsewhere)
        other = estimate_noise(lines, least=least)
        found = other if 2 * (found.value - other.value) < ACCEPT else found
    noise = found.noise
    level = level_of(clock, residual, columns, mask, noise)
    near = [part for part in noise.parts if not _at_limit(part, longest)]
    left = float(noise.white + sum(part.share for part in near))
    noise = noise._replace(parts=tuple(part.with_share(part.share / left) for part in near))
    # noise is no larger than what it leaves, but a slow part of unknown size may be estimated so
    level = min(level * float(np.sqrt(left)), float(np.sqrt(np.mean(residual[:rows] ** 2))))
    chance = rms_error(clock, mask, noise)
    largest = max(HELD_OUT, largest_rms(float(np.hypot(chance, chance))))
    return RecordNoise(unit * level, largest, float(1 - noise.white))


def _at_limit(part: AbstractPart, longest: np.ndarray) -> bool:
    """Whether a part is correlated along the path as far as the limit allows."""
    return 0 < part.rates[_PATH] * longest[_PATH] < 1 / _AT_LIMIT
