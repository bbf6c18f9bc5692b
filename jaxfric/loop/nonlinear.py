"""Sensitivities of every shape of an effect: responses of the linearised slider to its force."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..effects import STEADY_CURVES, AbstractEffect, RecordScales, null
from ..effects.effect import evolution_of, made
from ..fitting.padding import WIDE, bucket, filled, padded_columns
from ..fitting.problem import Problem, rig_at
from ..rig import Rig
from ..rig.friction.extended import AbstractTerm, Contact, ExtendedLaw
from ..traced import traced
from .case import Column, Sensitivities
from .curves import Curve, CurveRig
from .engine import Engine
from .refit import Candidate
from .response import Response, linear_response, term_forces


def friction_sensitivities(
    engine: Engine[Problem],
    z: np.ndarray,
    missing: Sequence[type[AbstractEffect]],
    scales: RecordScales,
) -> list[Sensitivities]:
    """Sensitivities of the missing effects that are friction terms with shape parameters."""
    problem = engine.evaluator.simulated(z, engine.problem)
    rig = rig_at(problem, z)
    response = linear_response(problem, jax.device_put(z))
    shaped = {e: starts for e in missing if (starts := shapes_of(e, scales)) and _is_term(e, rig)}
    return engine.each(
        lambda effect, starts: _shaped_columns(engine, rig, response, effect, starts),
        shaped.keys(),
        shaped.values(),
    )


def columns_of(engine: Engine, id: str, shapes: Sequence[Mapping[str, float]]) -> list[Column]:
    """The columns of all shapes of an effect, one after the other."""
    amplitudes = tuple(engine.model.amplitudes(id))
    found, own = [], [engine.names.index(f"{id}.{n}") for n in shapes[0]]
    for k, shape in enumerate(shapes):
        at = tuple(range(k * len(amplitudes), (k + 1) * len(amplitudes)))
        free = {
            i: float(engine.model.quantity(engine.names[i]).to_free(value))
            for i, value in zip(own, shape.values(), strict=True)
        }
        found.append(Column(id, free, amplitudes, at))
    return found


def shapes_of(effect: type[AbstractEffect], scales: RecordScales) -> list[dict[str, float]]:
    """Starting values of an effect's shapes, place by place."""
    grid = null(effect).grid(scales)
    return [dict(zip(grid, row, strict=True)) for row in zip(*grid.values(), strict=True)]


def _is_term(effect: type[AbstractEffect], before: Rig) -> bool:
    """Whether an effect only adds a friction term."""
    after = null(effect).embed(before)
    a, b = before.friction, after.friction
    if not (isinstance(a, ExtendedLaw) and isinstance(b, ExtendedLaw)):
        return False
    without = eqx.tree_at(lambda rig: rig.friction, after, ExtendedLaw(b.base, b.terms[:-1]))
    leaves = zip(jax.tree.leaves(before), jax.tree.leaves(without), strict=False)
    # identity, not equality: at its null a changed evolution is equal
    return len(b.terms) == len(a.terms) + 1 and all(x is y for x, y in leaves)


def _shaped_columns(
    engine: Engine[Problem],
    rig: Rig,
    response: Response,
    effect: type[AbstractEffect],
    shapes: Sequence[Mapping[str, float]],
) -> Sensitivities:
    """Sensitivities of all shapes of an effect."""
    problem, names, id = engine.problem, engine.names, effect.id
    amplitudes = tuple(engine.model.amplitudes(id))
    fields = [names[at].split(".")[1] for at in amplitudes]
    pairs = [
        {**shape, **{f: float(f == own) for f in fields}} for shape in shapes for own in fields
    ]
    batch = _terms(effect, rig, {name: np.array([one[name] for one in pairs]) for name in pairs[0]})
    forces = np.asarray(term_forces(response, batch))
    scale = np.asarray(problem.coordinates.scales)[list(amplitudes)]
    friction, slip = respond(response, forces * np.tile(scale, len(shapes)))
    friction = friction / float(problem.noise_scale)
    return Sensitivities(columns_of(engine, id, shapes), friction, extra_rows(engine, slip))


def _terms(
    effect: type[AbstractEffect], rig: Rig, values: Mapping[str, np.ndarray]
) -> AbstractTerm:
    """The friction terms of an effect for a batch of values."""

    def one(values: dict[str, Array]) -> AbstractTerm:
        law = made(effect, values).embed(rig).friction
        assert isinstance(law, ExtendedLaw)
        return law.terms[-1]

    return jax.vmap(one)(jax.device_put(dict(values)))


def respond(response: Response, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Response of friction and slip to many forces, computed in passes of one compiled width."""
    parts = []
    for begin in range(0, forces.shape[1], WIDE):
        part = forces[:, begin : begin + WIDE]
        seen = response(jax.device_put(padded_columns(part, size=WIDE)))
        parts.append([np.asarray(x)[:, : part.shape[1]] for x in seen])
    friction, slip = (np.concatenate(x, axis=1) for x in zip(*parts, strict=True))
    return friction, slip


def extra_rows(engine: Engine[Problem], slip: np.ndarray) -> np.ndarray:
    """Change of the extra rows with a change of slip; friction terms do not move the load point."""
    rows = []
    for channel in engine.problem.channels:
        anchor = np.asarray(channel.anchor)
        change = slip if channel.kind == "slip" else np.zeros_like(slip)
        change = change - anchor @ change / anchor.sum()
        rows.append(change * engine.weight[:, None] / float(channel.noise))
    return np.concatenate([*rows, np.zeros((len(engine.problem.hold), slip.shape[1]))])


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
