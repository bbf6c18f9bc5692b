"""Bias of the mass by errors of the recorded motion.

The fit takes the recorded acceleration as exact. It holds the true one and an error n, which is
independent of it. A regression then lowers the mass (errors in variables, Fuller 1987, 1.1),

    E[M] = M (1 - s),    s = |W n|^2 / |P W a|^2.

W whitens the rows, P projects out the sensitivities of all other parameters. Encoder noise lies at
high frequencies, the motion at low ones. If the force has a long memory, W weights high frequencies
most, so that a small noise of the acceleration lowers the mass much.
"""

from typing import NamedTuple

import numpy as np

from ...fitting.axis_preparation import Prepared, acceleration_errors
from ..engine import Engine
from ..refit import Candidate
from .rows import Rough


class Attenuation(NamedTuple):
    """By how much the errors of the motion lower the mass."""

    share: float
    """s, the share of the mass."""
    in_errors: float
    """The bias over the standard error of the mass from noise alone, without misfit and rivals."""


def errors_of_rows(prepared: Prepared, used: np.ndarray) -> np.ndarray:
    """A draw of the acceleration errors at all rows (n), as large as in the rows `used`."""
    white = float(np.sqrt(np.mean(prepared.scatter[: prepared.rows][used] ** 2)))
    return acceleration_errors(prepared, white)


def attenuation_of_rough(prepared: Prepared, used: np.ndarray, rough: Rough) -> Attenuation:
    """The attenuation in a least-squares fit whose residual has the lag-one correlation r. The
    difference x_k - r x_(k-1) of neighbouring rows whitens it."""
    beside, residual = used[1:] & used[:-1], rough.residual
    before, after = residual[:-1][beside], residual[1:][beside]
    power = float(before @ before + after @ after)
    correlation = max(2 * float(before @ after) / power, 0.0) if power else 0.0

    def white(columns: np.ndarray) -> np.ndarray:
        return (columns[1:] - correlation * columns[:-1])[beside]

    unit = float(np.std(white(residual)))
    mass, matrix = abs(float(rough.values[0])) / unit, white(rough.matrix)
    errors = white(errors_of_rows(prepared, used))
    return _attenuation(mass * matrix[:, 0], matrix[:, 1:], mass * errors)


def attenuation_of_fit(
    engine: Engine, found: Candidate, prepared: Prepared, used: np.ndarray
) -> Attenuation:
    """The attenuation in a fit of the loop, under its noise."""
    index = engine.free(found.effects)
    rows = engine.evaluate(found.z, index)
    mass = engine.values(found.z)["M"] / engine.unit
    errors = mass * errors_of_rows(prepared, used)
    columns = np.column_stack(
        [rows.jacobian, np.pad(errors, (0, len(engine.weight) - len(errors)))]
    )
    white = engine.whiten(columns * engine.weight[:, None], found.noise)
    own = list(index).index(engine.names.index("M"))
    return _attenuation(white[:, own], np.delete(white[:, :-1], own, axis=1), white[:, -1])


def _attenuation(mass: np.ndarray, others: np.ndarray, errors: np.ndarray) -> Attenuation:
    """From the sensitivities to ln M and to all others, and the errors of M a; all whitened."""
    scale = np.linalg.norm(others, axis=0)
    others = others / np.where(scale > 0, scale, 1.0)
    alone = mass - others @ np.linalg.lstsq(others, mass, rcond=None)[0]
    power = float(alone @ alone)
    share = min(float(errors @ errors) / power, 1.0) if power else 1.0
    return Attenuation(share, share / (1 - share) * power**0.5 if share < 1 else np.inf)
