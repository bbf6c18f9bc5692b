"""Sensitivities of an effect at every shape: responses of the linearised slider to a force.

`Response` is the linear response of the record to a small additional friction force g(t). The
slider is linearised along its own motion, y' = A(t) y + b(t) g(t). The response to any number of
forces then needs no further solution of the equation of motion. The linear response serves to rank
many shapes of an effect, and to locate missing friction in slip, velocity, state or time without a
catalogue. The linear equation is solved by the midpoint rule on half the sampling intervals of the
record.

`slider_curves` gives the steady curves of a slider's friction, and the response to such a curve.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..effects import STEADY_CURVES, AbstractEffect, RecordScales, null
from ..effects.effect import evolution_of, made, with_term
from ..fitting.padding import bucket, filled, padded_columns
from ..fitting.problem import Problem, rig_at
from ..fitting.thresholds import WIDE
from ..quantity import quantity
from ..rig import Inertial, Rig
from ..rig.friction.extended import AbstractStatelessTerm, AbstractTerm, Contact, ExtendedLaw
from ..simulation import simulate
from ..simulation.blocks import in_blocks
from ..simulation.ode import SliderEquation
from ..simulation.rodas import inverted
from ..simulation.trajectory import Trajectory
from ..traced import traced
from .case import Column, Sensitivities
from .engine import Engine
from .family import Curve, CurveRig
from .refit import Candidate


class _Probe(AbstractStatelessTerm):
    """A given force."""

    moves: ClassVar[bool] = False
    states: ClassVar[int] = 0
    value: Float[Array, ""] = quantity("g", "F", "added force", default=0.0)

    def force(self, at: Contact):
        del at
        return self.value


def _unknowns(equation: SliderEquation, moved: Trajectory) -> dict[str, Array]:
    """The solver's unknowns along a trajectory that began in steady sliding."""
    scale, machine = equation.law.force_scale(), equation.rig.machine
    commanded = jax.vmap(equation.motion.displacement)(moved.time)
    y = {
        "q": machine.stiffness * (commanded - moved.slip) / scale,
        "psi": moved.state / scale,
    }
    if isinstance(machine, Inertial):
        y["phi"] = (moved.force - equation.reference) / scale
    if equation.is_late():  # approximately the slider's own velocity
        w = jnp.log(moved.velocity / equation.motion.first_velocity())
        y["w"] = jnp.stack([w, w], axis=1)
    return y


def _begun(equation: SliderEquation, force: Float[Array, ""]) -> SliderEquation:
    """The equation with `force` added from the start, where sliding is steady."""
    where = lambda rig: rig.friction.terms[-1].value  # noqa: E731
    return SliderEquation(eqx.tree_at(where, equation.rig, force), equation.motion)


def _probed(equation: SliderEquation, g: Float[Array, " 2"]) -> SliderEquation:
    """The equation with the force g[0] added now, and g[1] since the start."""
    return eqx.tree_at(lambda e: e.law.terms[-1].value, _begun(equation, g[1]), g[0])


class Response(eqx.Module):
    """The slider linearised along its motion; arrays hold values at `middle` of each interval."""

    rig: Rig
    time: Float[Array, " n"]
    rows: Float[Array, " n"]
    start: Float[Array, ""]
    middle: Float[Array, " k"]
    velocity: Float[Array, " k+1"]
    """Velocity at the start, then at every midpoint; slip, state and force likewise."""
    slip: Float[Array, " k+1"]
    state: Float[Array, "k+1 s"]
    force: Float[Array, " k+1"]
    propagate: Float[Array, "k d d"]
    driven: Float[Array, "k d"]
    by_start: Float[Array, "k d"]
    begin: Float[Array, " d"]
    """Derivative of the initial states by a force at the start."""
    read: Float[Array, "k d"]
    read_directly: Float[Array, "k 2"]
    read_slip: Float[Array, "k d"]

    @eqx.filter_jit
    def __call__(
        self, forces: Float[Array, "k+1 m"]
    ) -> tuple[Float[Array, "n m"], Float[Array, "n m"]]:
        """Change of recorded friction and slip by forces at the start and at every midpoint."""
        first, along = forces[0], forces[1:]

        def step(y: Array, now: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
            propagate, driven, by_start, read, direct, read_slip, g = now
            carried = jnp.sum(propagate[:, :, None] * y, axis=1)  # no matrix product, as in `rodas`
            y = carried + driven[:, None] * g + by_start[:, None] * first
            # computed here, because states of many forces at every row would fill the memory
            force = jnp.sum(read[:, None] * y, axis=0) + direct[0] * g + direct[1] * first
            return y, (force, jnp.sum(read_slip[:, None] * y, axis=0))

        y0 = self.begin[:, None] * first
        linear = self.propagate, self.driven, self.by_start
        inputs = (*linear, self.read, self.read_directly, self.read_slip, along)
        _, (out, slip) = jax.lax.scan(step, y0, inputs)
        begin = self.read[0] @ y0 + self.read_directly[0, 0] * first
        begin = begin + self.read_directly[0, 1] * first
        out = jnp.concatenate([begin[None], out])[self.rows]
        slip = jnp.concatenate([jnp.zeros_like(slip[:1]), slip])[self.rows]
        quiet = self.rig.sensor.read(self.time, jnp.zeros_like(self.time))
        seen = jax.vmap(lambda c: self.rig.sensor.read(self.time, c) - quiet, 1, 1)
        return seen(out), slip


@traced
def linear_response(problem: Problem, z: Float[Array, " q"]) -> Response:
    """The response of the slider with the parameters `z` along its motion in `problem`."""
    rig, motion = with_term(problem.rig(z), _Probe()), problem.motion
    time = problem.time
    halves = 0.5 * (time[1:] + time[:-1])
    jumps = jnp.clip(motion.breakpoints(), time[0], time[-1])
    knots = jnp.sort(jnp.concatenate([time, halves, jumps]))
    middle, h = 0.5 * (knots[1:] + knots[:-1]), jnp.diff(knots)
    moved = simulate(
        rig,
        motion,
        jnp.concatenate([time[:1], middle]),
        rtol=problem.rtol,
        max_steps=problem.max_steps,
    )
    equation = SliderEquation(rig, motion)
    ys = _unknowns(equation, moved)
    flat, back = ravel_pytree(jax.tree.map(lambda x: x[0], ys))
    rows = jax.vmap(lambda y: ravel_pytree(y)[0])(jax.tree.map(lambda x: x[1:], ys))

    def all_of(t: Array, y: Array, g: Array) -> tuple[Array, Array, Array]:
        """Rate, force and slip at one time, in one function so that JAX traces the model once."""
        probed = _probed(equation, g)
        rate = ravel_pytree(probed.derivative(t, back(y)))[0]
        now = probed.physical(t, back(y))
        return rate, now.force, now.slip

    def begun(force: Array) -> Array:
        return ravel_pytree(_begun(equation, force).initial())[0]

    g = jnp.zeros(2)
    slopes = in_blocks(lambda t, y: jax.jacfwd(all_of, (1, 2))(t, y, g), middle, rows)
    (A, b), (c, d), (slips, _) = slopes
    eye = jnp.eye(len(flat))
    half = 0.5 * h[:, None, None] * A
    inverse = jax.vmap(inverted)(eye - half)
    return Response(
        rig=rig,
        time=time,
        rows=jnp.searchsorted(knots, time, side="left"),
        start=time[0],
        middle=middle,
        velocity=moved.velocity,
        slip=moved.slip,
        state=moved.state,
        force=moved.force,
        propagate=inverse @ (eye + half),
        driven=(inverse @ (h[:, None] * b[:, :, 0])[..., None])[..., 0],
        by_start=(inverse @ (h[:, None] * b[:, :, 1])[..., None])[..., 0],
        begin=jax.jacfwd(begun)(g[1]),
        read=c,
        read_directly=d,
        read_slip=slips,
    )


@traced
def term_forces(response: Response, batches: Sequence[AbstractTerm]) -> list[Float[Array, "k+1 q"]]:
    """Forces of batches of friction terms along the unchanged motion of the slider."""
    force = jax.vmap(lambda term: _term_force(response, term), out_axes=1)
    return [force(terms) for terms in batches]


def _term_force(response: Response, term: AbstractTerm) -> Float[Array, " k+1"]:
    law = response.rig.friction
    assert isinstance(law, ExtendedLaw)
    times = jnp.concatenate([response.start[None], response.middle])
    stress = response.rig.normal_stress
    ratio = None if stress is None else jax.vmap(stress.ratio)(times)

    def contact(i: Array, part: Array) -> Contact:
        pressed = None if ratio is None else ratio[i]
        return Contact(response.velocity[i], response.slip[i], times[i], part, law.base, pressed)

    rows = jnp.arange(len(times))
    if not term.states:
        return jax.vmap(lambda i: term.force(contact(i, jnp.zeros(0))))(rows)

    def rate(i: Array, part: Array) -> Array:
        return term.rate(contact(i, part), response.force[i])

    first = term.steady_state(response.velocity[0], law.base, response.force[0])
    A = jax.vmap(lambda i: jax.jacfwd(rate, 1)(i, first))(rows)
    driven = jax.vmap(lambda i: rate(i, first))(rows) - A @ first
    # trapezoidal rule between midpoints
    h = jnp.diff(times)[:, None, None]
    half = 0.25 * h * (A[1:] + A[:-1])
    eye = jnp.eye(term.states)
    inverse = jax.vmap(inverted)(eye - half)
    source = 0.5 * jnp.diff(times)[:, None] * (driven[1:] + driven[:-1])

    def step(y: Array, now: tuple[Array, ...]) -> tuple[Array, Array]:
        P, S, s = now
        y = P @ (y + S @ y + s)
        return y, y

    _, later = jax.lax.scan(step, first, (inverse, half, source))
    parts = jnp.concatenate([first[None], later])
    return jax.vmap(lambda i: term.force(contact(i, parts[i])))(rows)


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
    shapes = {e: shapes_of(e, scales) for e in engine.offered}
    shapes = {e: starts for e, starts in shapes.items() if starts and _is_term(e, rig)}
    # the forces of all effects, of whichever are missing, so that one function is compiled
    batches = [_terms(e, rig, _unit_terms(engine, e, starts)) for e, starts in shapes.items()]
    forces = dict(zip(shapes, term_forces(response, batches), strict=True))
    asked = [e for e in missing if e in shapes]
    return engine.each(
        lambda effect: _shaped_columns(engine, response, effect, shapes[effect], forces[effect]),
        asked,
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
    """Starting values of the shape parameters of an effect, one dictionary per shape."""
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
    response: Response,
    effect: type[AbstractEffect],
    shapes: Sequence[Mapping[str, float]],
    forces: Float[Array, "k+1 q"],
) -> Sensitivities:
    """Sensitivities of all shapes of an effect with given forces."""
    problem, id = engine.problem, effect.id
    scale = np.asarray(problem.coordinates.scales)[list(engine.model.amplitudes(id))]
    friction, slip = respond(response, np.asarray(forces) * np.tile(scale, len(shapes)))
    friction = friction / float(problem.noise_scale)
    return Sensitivities(columns_of(engine, id, shapes), friction, extra_rows(engine, slip))


def _unit_terms(
    engine: Engine[Problem], effect: type[AbstractEffect], shapes: Sequence[Mapping[str, float]]
) -> dict[str, np.ndarray]:
    """The parameters of an effect of every shape, with each of its amplitudes 1 by turns."""
    fields = [engine.names[at].split(".")[1] for at in engine.model.amplitudes(effect.id)]
    pairs = [
        {**shape, **{f: float(f == own) for f in fields}} for shape in shapes for own in fields
    ]
    return {name: np.array([one[name] for one in pairs]) for name in pairs[0]}


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
    """Response of friction and slip to many forces, computed in batches of one compiled size."""
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
