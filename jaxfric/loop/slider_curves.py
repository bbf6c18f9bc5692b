"""Steady curves of a slider's friction, and the linearised response of the slider to a curve."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..effects import STEADY_CURVES
from ..effects.effect import evolution_of
from ..fitting.padding import bucket, filled
from ..fitting.problem import Problem, rig_at
from ..rig.friction.extended import Contact, ExtendedLaw
from ..traced import traced
from .curves import Curve, CurveRig
from .engine import Engine
from .nonlinear import extra_rows, respond
from .refit import Candidate
from .response import Response, linear_response

_LATE = "evolution_cutoff"
"""The curve that friction reaches over the slip length, not at once."""


def slider_curves(engine: Engine[Problem], final: Candidate, velocities: np.ndarray) -> CurveRig:
    """The steady curves of a fit, at the `velocities` [m/s] of the steps.

    A curve of another shape acts like the curves of the fit: at once, like A ln V, or over the slip
    length, like -B ln V.
    """
    effects = tuple(id for id in final.effects if id in STEADY_CURVES)
    known = engine.blocks.train | engine.blocks.select
    speeds = velocities[np.unique(engine.blocks.step[known])]
    return CurveRig(
        effects=effects,
        declared=tuple(id for id in engine.always if id in STEADY_CURVES),
        speeds=speeds[speeds > 0],
        counted=True,
        replaced=("f0", "A", "B"),
        base=lambda V: np.stack([np.ones_like(V), np.log(V), np.log(V)], axis=1),
        lowest=2,
        parameters=2,
        level=lambda z, V: _level(engine.problem, z, V),
        send=lambda curve: _sent(engine, final, curve, late=set(effects) == {_LATE}),
        unit="m/s",
    )


def _level(problem: Problem, z: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Friction of steady sliding, without terms that have states or depend on slip or time."""
    law = rig_at(problem, z).friction
    assert isinstance(law, ExtendedLaw)
    padded = filled(V, bucket(len(V)))
    return np.asarray(_levels(law, padded))[: len(V)]


@traced
def _levels(law: ExtendedLaw, V: Float[Array | np.ndarray, " n"]) -> Float[Array, " n"]:
    base, speed, still = law.base, jnp.asarray(V), jnp.zeros_like(V)
    total = base.f0 + base.A * jnp.log(speed / base.V0)
    total += jnp.sum(jax.vmap(base.steady_state)(speed), axis=1)
    for term in law.terms:
        if not term.states and term.shift(Contact(speed, still, still, still, base)) is None:
            total += term.force(Contact(speed, still, still, still, base))
    return total


def _sent(
    engine: Engine[Problem], final: Candidate, curve: Curve, *, late: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Responses to 1, ln V at once, ln V over the slip length, and to a curve."""
    response = linear_response(
        engine.evaluator.simulated(final.z, engine.problem), jax.device_put(final.z)
    )
    V = np.asarray(response.velocity)
    log, more = np.log(V)[:, None], curve(V)
    slow = followed(response, np.concatenate([log, more] if late else [log], axis=1))
    forces = [np.ones_like(log), log, slow[:, :1], slow[:, 1:] if late else more]
    friction, slip = respond(response, np.concatenate(forces, axis=1))
    size = float(engine.problem.noise_scale)
    return friction / size, extra_rows(engine, slip)


def followed(response: Response, curves: np.ndarray) -> np.ndarray:
    """The state h that relaxes to curves (k+1, c) over the slip length L: h' = (V/L) (curve - h).
    The slider starts in steady sliding.
    """
    law = response.rig.friction
    assert isinstance(law, ExtendedLaw)
    evolution = evolution_of(law)
    power = 0.0 if evolution is None else float(evolution.n)
    ratio = np.asarray(response.velocity) / float(law.base.V0)
    lengths = float(np.asarray(law.base.L)[0]) * ratio**power
    share = np.exp(-np.diff(np.asarray(response.slip)) / (0.5 * (lengths[1:] + lengths[:-1])))
    middle, out = 0.5 * (curves[1:] + curves[:-1]), [curves[0]]
    for keep, value in zip(share, middle, strict=True):
        out.append(keep * out[-1] + (1 - keep) * value)
    return np.stack(out)
