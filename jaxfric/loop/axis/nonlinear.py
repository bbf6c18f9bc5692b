"""Responses of an axis to missing friction: to effects of every shape and to hat functions.

`axis_curves` gives the steady friction curves of an axis, and the force of each curve along the
motion.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...effects import RecordScales
from ...effects.axis import AXIS_STEADY_CURVES
from ...effects.effect import AbstractEffect
from ...fitting.axis_preparation import shifted
from ...fitting.axis_problem import AxisProblem, shape_columns
from ...fitting.padding import filled
from ..case import Sensitivities
from ..engine import Engine
from ..family import Curve, CurveRig
from ..location import Bumps, hats
from ..nonlinear import columns_of, shapes_of
from ..refit import Candidate
from ..thresholds import AXIS_WAVES, FINE
from .result import AxisRows


def axis_sensitivities(
    engine: Engine[AxisProblem],
    z: np.ndarray,
    missing: Sequence[type[AbstractEffect]],
    scales: RecordScales,
) -> list[Sensitivities]:
    """Derivatives of the force by the amplitudes of missing effects, at every shape of effects."""
    problem = engine.problem
    found = []
    for effect in missing:
        shapes = shapes_of(effect, scales)
        if not shapes:
            continue
        columns = columns_of(engine, effect.id, shapes)
        zs = np.tile(z, (len(shapes), 1))
        for row, column in zip(zs, columns, strict=True):
            for i, value in column.shape.items():
                row[i] = value
        matrix = np.asarray(shape_columns(problem, jnp.asarray(zs), columns[0].amplitudes))
        found.append(Sensitivities(columns, matrix, np.zeros((0, matrix.shape[1]))))
    return found


def friction_bumps(engine: Engine[AxisProblem], rows: AxisRows, *, unit: str = "m") -> list[Bumps]:
    """Bumps of friction over position, velocity, time and distance since reversal, and waves."""
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
        centres, columns = hats(x, np.linspace(x[train].min(), x[train].max(), FINE))
        shown = centres**2 if variable == "since_reversal" else centres
        found.append(Bumps(variable, shown_unit, shown, columns))
    travel = float(np.ptp(rows.position))
    waves = np.geomspace(travel / 100, travel, AXIS_WAVES)
    phase = 2 * np.pi * rows.position[:, None] / waves
    pairs = np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(len(phase), -1)
    found.append(Bumps("periodic_in_slip", unit, waves, pairs))
    size, scale = len(engine.weight), float(engine.problem.noise_scale)
    return [one._replace(columns=filled(one.columns, size, 0.0) / scale) for one in found]


def axis_curves(
    engine: Engine[AxisProblem], final: Candidate, rows: AxisRows, unit: str
) -> CurveRig:
    """The steady friction curves of a fit that change sign with velocity, over the speeds of train
    and validation rows. `unit` is the unit of the position. Below the slowest speed of train and
    validation rows the curves are constant, because slower rows are not used.
    """
    problem = engine.problem
    known = engine.blocks.train | engine.blocks.select
    speed = np.abs(rows.velocity[known])
    ends = np.asarray([max(float(np.min(speed)), rows.width), float(np.max(speed))])

    def send(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
        V = np.asarray(problem.motion.velocity)
        along = np.maximum(np.abs(V), ends[0])
        columns = np.concatenate([_base(np.abs(V)), curve(along)], axis=1)
        seen = np.asarray(_seen(problem, jnp.asarray(final.z), jnp.asarray(columns)))
        return seen, np.zeros((0, seen.shape[1]))

    return CurveRig(
        effects=tuple(id for id in final.effects if id in AXIS_STEADY_CURVES),
        declared=tuple(id for id in engine.always if id in AXIS_STEADY_CURVES),
        speeds=ends,
        counted=False,
        replaced=("F_c", "F_v"),
        base=_base,
        lowest=1,
        level=lambda z, V: _level(problem, z, V),
        send=send,
        unit=f"{unit}/s",
    )


def _base(V: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(V), V], axis=1)


def _level(problem: AxisProblem, z: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Mean friction (F(v) - F(-v))/2 of both directions, at the mean position."""
    place = jnp.mean(problem.motion.position)
    return np.asarray(problem.rig(jnp.asarray(z)).turning_friction(place, jnp.asarray(V)))


@eqx.filter_jit
def _seen(problem: AxisProblem, z: Array, curves: Array) -> Array:
    """Recorded force due to curves (N, k) of the speed, each with the sign of the velocity."""
    rig = problem.rig(z)
    sign = rig.sign(problem.motion.velocity)

    def one(curve: Array) -> Array:
        force = shifted(sign * curve, problem.interval, lag=rig.lag, lead=rig.delay, late=rig.late)
        return problem.sampler(force) / problem.noise_scale

    return jax.vmap(one, 1, 1)(curves)
