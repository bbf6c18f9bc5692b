"""The noise of a new record, and the largest error that this noise explains.

The noise is estimated from the residual of the model refitted to the record. It is white noise and
correlated parts. As in a fit, noise may be correlated over a tenth of the record in time or rows.
Along the path it may be correlated over a tenth of a velocity step.

The residual of a model that lacks an effect looks like slow noise. Unlike noise it is locked to the
velocity steps (`structure_columns`). If these columns make the residual significantly likelier,
they are projected out, and the noise is that of the rest. An F-test of the likelihoods decides,
each with the noise that is likeliest beside its columns. The columns are few: many smooth columns
would take up slow noise, and the rest would look white and small.

State evolves along the path, so a missing effect also looks like noise that is correlated farther
along the path. A part of the noise at this limit counts as misfit, if noise over time or rows is
clearly less likely. Then smooth columns along the record (`smooth_columns`) are projected out.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..fitting.noise import (
    CLOCKS,
    Noise,
    NoisePart,
    Noises,
    estimate_noise,
    gram_of,
    least_noise,
    longest_memory,
    noise_estimate,
    noise_rows,
    recorded_steps,
    rms_error,
)
from ..fitting.noise.parts import AbstractPart
from ..fitting.padding import padded_columns
from ..fitting.problem import Problem
from ..loop.engine import longest_of_steps, smooth_columns
from ..loop.learn import largest_rms, level_of
from ..loop.thresholds import ACCEPT, ALONG, HELD_OUT

_PATH = CLOCKS.index("path")
_FEWEST = 2
"""Rows per column below which no structure is sought: its columns would leave no residual."""
_AT_LIMIT = 0.9
"""Share of the largest correlation length from which a part of the noise is at the limit."""
_SIGNIFICANT = 1e-4
"""Significance level of structure. Both noises are estimated, so that noise over a twentieth of a
short record passes it more often: about once in a hundred records."""
_MEMORIES = (1 / 8, 1 / 4, 1 / 2, 1.0, 2.0)
"""Memory lengths of structure, over the mean path of a velocity step."""
_SEEN = 1e-10
"""Share of the variance of a column below which its remainder beside others is rounding."""
_HOLD = 0.1
"""Speed of a hold, over that of the slowest step: its logarithm must be finite."""


class RecordNoise(NamedTuple):
    """The noise of a record."""

    sigma: float
    """Standard deviation of a row, white and correlated parts together [friction]."""
    largest: float
    """The ratio of rms to `sigma` that noise alone exceeds in about one record of a thousand."""
    share: float
    """Share of the variance that is correlated."""


class SliderNoise(NamedTuple):
    """The noise by which a prediction of a slider is judged, and by which its errors are found."""

    told: RecordNoise
    noise: Noise
    """White and correlated parts, in units of `Problem.noise_scale`, for the errors of parameters.
    It is the same noise, but includes misfit if there is any: misfit also moves parameters."""
    slow: NoisePart | None
    """A part that is correlated over time or rows as far as the limit allows: slower noise, or
    structure, looks the same."""


def noise_of_record(
    problem: Problem,
    step: np.ndarray,
    residual: Float[np.ndarray, " n"],
    columns: Float[np.ndarray, "N q"],
) -> SliderNoise:
    """Return the noise of a residual (n,) of a fit with the Jacobian `columns`, in noise units.

    `step` (n,) is the number of the velocity step of every row.
    """
    rows, size, unit = len(step), problem.time.shape[0], float(problem.noise_scale)
    clock, mask = np.asarray(problem.clock), np.arange(size) < rows
    longest = longest_memory(clock[:rows])
    longest[_PATH] = longest_of_steps(clock[:rows], int(step.max()) + 1)[_PATH]
    residual = np.pad(residual, (0, size - rows))
    columns = _moving(columns * mask[:, None])
    least = least_noise(recorded_steps(np.asarray(problem.friction)[:rows])) / unit
    whole = noise = _likeliest(clock, mask, residual, columns, longest, least)
    size_of_whole = level_of(clock, residual, columns, mask, whole)
    wanders = any(_is_misfit(part, longest) for part in whole.parts)
    path = clock[:rows, _PATH]
    some = smooth_columns(path, step, rows) if wanders else structure_columns(clock[:rows], step)
    structure = np.pad(some, ((0, size - rows), (0, 0)))
    more = _moving(np.concatenate([columns, structure], axis=1))
    if rows > _FEWEST * more.shape[1]:
        beside = _likeliest(clock, mask, residual, more, longest, least)
        alone = _deviance(clock, mask, residual, columns, whole)
        chance = _chance(alone, _deviance(clock, mask, residual, more, beside), rows)
        if wanders or chance < _SIGNIFICANT:
            noise, columns = beside, more
    # noise is no larger than what it leaves, but a slow part of unknown size may be estimated so
    left = float(np.sqrt(np.mean(residual[:rows] ** 2)))
    near = [part for part in noise.parts if not _is_misfit(part, longest)]
    kept = float(noise.white + sum(part.share for part in near))
    level = min(level_of(clock, residual, columns, mask, noise) * float(np.sqrt(kept)), left)
    told = noise._replace(parts=tuple(part.with_share(part.share / kept) for part in near))
    error = rms_error(clock, mask, told)
    largest = max(HELD_OUT, largest_rms(float(np.hypot(error, error))))
    slow = noise._replace(parts=tuple(part for part in near if _at_limit(part, longest)))
    return SliderNoise(
        RecordNoise(unit * level, largest, float(1 - noise.white)),
        whole._replace(sigma=np.asarray(min(size_of_whole, left))),
        next(iter(noise_estimate(slow, unit, longest).parts), None),
    )


def structure_columns(
    clock: Float[np.ndarray, "n k"], step: np.ndarray
) -> Float[np.ndarray, "n 13"]:
    """Return columns of what a model of a slider may lack; `step` (n,) is the step of every row.

    - A state of memory length D, which relaxes to the logarithm of the velocity V of the load
      point: du/dx = (ln V - u)/D over the path x, for five D.
    - The same shape after every velocity step, whatever its direction, as a wrong law leaves it:
      hat functions of the path since the step times |change of ln V|.
    - A trend with the path.
    """
    path, each = clock[:, _PATH], np.unique(step)
    spans = [np.ptp(clock[step == k], axis=0) for k in each]
    speeds = np.asarray([span[_PATH] / max(span[0], 1e-300) for span in spans])
    level = np.log(np.maximum(speeds, _HOLD * np.min(speeds[speeds > 0], initial=1.0)))
    lengths = np.asarray(_MEMORIES) * max(float(np.ptp(path)), 1e-300) / len(each)
    changes, memories = np.zeros(len(path)), np.zeros((len(path), len(lengths)))
    begin, state = path[0], np.zeros(len(lengths))
    for k, number in enumerate(each):
        here, aim = step == number, level[k] - level[0]
        memories[here] = aim + (state - aim) * np.exp((begin - path[here])[:, None] / lengths)
        begin, state = path[here][-1], memories[here][-1]
        changes[here] = abs(level[k] - level[max(k - 1, 0)])
    shapes = smooth_columns(path, step, len(path))[:, ALONG:] * changes[:, None]
    return np.concatenate([memories, shapes, (path - path[0])[:, None]], axis=1)


def _moving(columns: np.ndarray) -> np.ndarray:
    return columns[:, np.linalg.norm(columns, axis=0) > 0]


def _likeliest(
    clock: np.ndarray,
    mask: np.ndarray,
    residual: np.ndarray,
    columns: np.ndarray,
    longest: np.ndarray,
    least: float,
) -> Noise:
    """Return the likeliest noise; a part at the limit of the path only if it is clearly likelier
    than noise over time or rows."""
    lines = noise_rows(clock, mask.astype(float), residual, columns, longest)
    found = estimate_noise(lines, least=least)
    if any(_is_misfit(part, longest) for part in found.noise.parts):
        elsewhere = np.where(np.arange(len(longest)) == _PATH, 0.0, longest)
        lines = noise_rows(clock, mask.astype(float), residual, columns, elsewhere)
        other = estimate_noise(lines, least=least)
        found = other if 2 * (found.value - other.value) < ACCEPT else found
    return found.noise


def _at_limit(part: AbstractPart, longest: np.ndarray) -> bool:
    """Whether a part is correlated as far as the limit of its clock allows."""
    clock = int(np.argmax(part.rates))
    return bool(part.memory() >= _AT_LIMIT * part.rates[clock] * longest[clock])


def _is_misfit(part: AbstractPart, longest: np.ndarray) -> bool:
    return bool(part.rates[_PATH] > 0) and _at_limit(part, longest)


class _Deviance(NamedTuple):
    value: float
    """-2 ln L of the rows, at the likeliest sigma and coefficients, but for a constant."""
    directions: int


def _deviance(
    clock: np.ndarray, mask: np.ndarray, residual: np.ndarray, columns: np.ndarray, noise: Noise
) -> _Deviance:
    """Return the deviance of a residual whose `columns` have free coefficients."""
    both = padded_columns(np.column_stack([residual, columns]))
    noises = jax.tree.map(lambda x: np.asarray(x)[None], Noises(noise.white, noise.parts))
    grams, log_determinant = gram_of(clock, mask.astype(float), both, np.ones(()), noises)
    gram = grams[0]
    size = np.sqrt(np.where(np.diag(gram) > 0, np.diag(gram), 1.0))
    scaled = gram / np.outer(size, size)
    values, vectors = np.linalg.eigh(scaled[1:, 1:])
    used = values > _SEEN
    explained = float(np.sum((vectors[:, used].T @ scaled[1:, 0]) ** 2 / values[used]))
    rows = int(mask.sum())
    squares = gram[0, 0] * max(1.0 - explained, 1e-300)
    return _Deviance(rows * np.log(squares) + float(log_determinant[0]), int(used.sum()))


def _chance(alone: _Deviance, more: _Deviance, rows: int) -> float:
    """Return the chance that further columns lower the deviance as much in noise (F-test)."""
    from scipy.special import fdtrc  # scipy.stats takes half a second to import

    further, left = more.directions - alone.directions, rows - more.directions
    if further < 1:
        return 1.0
    gain = np.expm1(max(alone.value - more.value, 0.0) / rows)
    return float(fdtrc(further, left, gain * left / further))
