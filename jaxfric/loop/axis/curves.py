"""Steady friction curves of an axis, and their forces along its measured motion."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...effects.axis import AXIS_STEADY_CURVES
from ...fitting.axis_preparation import shifted
from ...fitting.axis_problem import AxisProblem
from ..curves import Curve, CurveRig
from ..engine import Engine
from ..refit import Candidate
from .result import AxisRows


def axis_curves(
    engine: Engine[AxisProblem], final: Candidate, rows: AxisRows, unit: str
) -> CurveRig:
    """The steady curves of a fit that change sign with velocity, over the speeds of train and
    validation rows. `unit` is the unit of the position. Below the slowest of these speeds the
    curves are constant, because slower rows are not used.
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
        parameters=2,
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
