"""Responses of an axis to missing friction: shapes of effects, hat functions of variables."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from ...effects import RecordScales
from ...effects.effect import AbstractEffect
from ...fitting.axis_problem import AxisProblem, shape_columns
from ...fitting.padding import filled
from ..case import Column, Sensitivities
from ..engine import Engine
from ..location import Bumps, hats
from ..nonlinear import columns_of, shapes_of
from .result import AxisRows

_COARSE, _WAVES = 16, 60


def axis_sensitivities(
    engine: Engine[AxisProblem],
    z: np.ndarray,
    missing: Sequence[type[AbstractEffect]],
    scales: RecordScales,
) -> Sensitivities:
    """Sensitivities of the missing effects with shape parameters: derivatives at every shape."""
    problem = engine.problem
    columns: list[Column] = []
    blocks, place = [np.zeros((len(engine.weight), 0))], 0
    for effect in missing:
        shapes = shapes_of(effect, scales)
        if not shapes:
            continue
        found = columns_of(engine, effect.id, shapes, place)
        zs = np.tile(z, (len(shapes), 1))
        for row, column in zip(zs, found, strict=True):
            for i, value in column.shape.items():
                row[i] = value
        block = np.asarray(shape_columns(problem, jnp.asarray(zs), found[0].amplitudes))
        columns += found
        blocks.append(block)
        place += block.shape[1]
    matrix = np.concatenate(blocks, axis=1)
    return Sensitivities(tuple(columns), matrix, np.zeros((0, matrix.shape[1])))


def friction_bumps(engine: Engine[AxisProblem], rows: AxisRows, *, unit: str = "m") -> list[Bumps]:
    """Waves, and hat functions of position, velocity, time and distance since reversal."""
    since = rows.path.copy()
    for k in np.unique(rows.segment):
        here = rows.segment == k
        since[here] -= since[here][0]
    train = engine.blocks.train
    found = []
    for variable, shown_unit, x in (
        ("position", unit, rows.position),
        ("velocity", f"{unit}/s", rows.velocity),
        ("time", "s", rows.time),
        ("since_reversal", unit, np.sqrt(since)),
    ):
        centres, columns = hats(x, np.linspace(x[train].min(), x[train].max(), _COARSE))
        shown = centres**2 if variable == "since_reversal" else centres
        found.append(Bumps(variable, shown_unit, shown, columns))
    travel = float(np.ptp(rows.position))
    waves = np.geomspace(travel / 100, travel, _WAVES)
    phase = 2 * np.pi * rows.position[:, None] / waves
    pairs = np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(len(phase), -1)
    found.append(Bumps("periodic_in_slip", unit, waves, pairs))
    size, scale = len(engine.weight), float(engine.problem.noise_scale)
    return [one._replace(columns=filled(one.columns, size, 0.0) / scale) for one in found]
