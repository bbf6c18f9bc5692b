"""Noise floor of a record: the noise after projecting out smooth columns along the record. Also the
largest error of every block that this noise alone explains.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..fitting.noise import Found, Noise, sandwich
from ..fitting.padding import WIDE, padded_columns
from .engine import Engine
from .refit import Candidate
from .screen import orthonormal
from .thresholds import ASKED, HELD_OUT, SEEN, SIGNIFICANT, TRAIN_FLOOR


class Floor(NamedTuple):
    """The noise of a record after projecting out smooth columns."""

    found: Found
    sigma: float
    """Standard deviation on the train block, in the unit of friction."""
    later: float
    """Standard deviation on the held-out rows: noise may differ between steps."""
    most: Mapping[str, float]
    """Largest rms of every block over sigma that noise alone explains."""

    def level(self, block: str) -> float:
        """Standard deviation of the noise on a block, in the unit of friction."""
        return self.sigma if block == "train" else self.later


def noise_floor(engine: Engine, current: Candidate) -> Floor:
    """Noise after projecting out base, effects, and smooth bumps along the record and each step.

    The parts of the noise are estimated anew, because structure in the residual of the base may
    have looked like a part of noise.
    """
    rows = engine.evaluate(current.z, engine.free(current.effects))
    columns = np.concatenate([rows.jacobian, engine.smooth], axis=1)
    train = columns * engine.weight[:, None]
    used = np.linalg.norm(train, axis=0) > 0
    found = engine.noise_afresh(rows.residual * engine.weight, train[:, used])
    noise = found.noise
    held = engine.blocks.select | engine.blocks.report
    size = float(engine.problem.noise_scale)
    # sigma is estimated from the train block and has a standard error
    chance = engine.rms_error(engine.blocks.train, noise)

    def most(block: np.ndarray) -> float:
        return max(HELD_OUT, largest_rms(float(np.hypot(engine.rms_error(block, noise), chance))))

    return Floor(
        found,
        size * _level(engine, rows.residual, columns, engine.blocks.train, noise),
        size * _level(engine, rows.residual, columns, held, noise),
        {
            "train": max(TRAIN_FLOOR, largest_rms(chance)),
            "select": most(engine.blocks.select),
            "report": most(engine.blocks.report),
        },
    )


def _level(
    engine: Engine, residual: np.ndarray, columns: np.ndarray, rows: np.ndarray, noise: Noise
) -> float:
    """rms of the noise on some rows (a mask): from the residual without the smooth columns,
    corrected for the noise that this projection removes."""
    mask = np.zeros(len(residual))
    mask[: len(rows)] = rows
    here = columns * mask[:, None]
    # outside the used rows the shift of a step is rounding, not a direction
    seen = np.linalg.norm(here, axis=0) > SEEN * np.linalg.norm(columns, axis=0)
    smooth = orthonormal(here[:, seen])
    left = residual * mask
    left = left - smooth @ (smooth.T @ left)
    alone = noise._replace(sigma=np.ones(()))
    taken = np.asarray(sandwich(engine.problem.clock, padded_columns(smooth, size=WIDE), alone))
    whole = float(np.sum((mask * np.asarray(noise.scale)) ** 2))
    share = whole - float(np.trace(taken))
    return float(np.sqrt(left @ left / share * whole / mask.sum()))


def largest_rms(chance: float) -> float:
    """The rms over sigma that noise exceeds with probability `SIGNIFICANT`/`ASKED` (Bonferroni).
    `chance` is the relative standard error of the rms of noise.
    """
    from scipy.special import ndtri  # scipy.stats takes half a second to import

    return 1 - float(ndtri(SIGNIFICANT / ASKED)) * chance
