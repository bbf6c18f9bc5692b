"""The linear response of the record to a small additional friction force g(t).

The slider is linearised along its own motion, y' = A(t) y + b(t) g(t). The response to any number
of forces then needs no further solution of the equation of motion. This linear response serves to
rank many shapes of an effect, and to locate missing friction in slip, velocity, state or time
without a catalogue. The linear equation is solved by the midpoint rule on half the sampling
intervals of the record.
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..effects.effect import with_term
from ..fitting.problem import Problem
from ..quantity import quantity
from ..rig import Inertial, Rig
from ..rig.friction.extended import AbstractStatelessTerm, AbstractTerm, Contact, ExtendedLaw
from ..simulation import simulate
from ..simulation.blocks import in_blocks
from ..simulation.ode import SliderEquation
from ..simulation.rodas import inverted
from ..simulation.trajectory import Trajectory
from ..traced import traced


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
    """The linearised slider along its motion; arrays over `middle`, the midpoints of intervals."""

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
        """Rate, force and slip at one time, in one function to trace it once."""
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
def term_forces(response: Response, terms: AbstractTerm) -> Float[Array, "k+1 q"]:
    """Forces of a batch of friction terms along the unchanged motion of the slider."""
    return jax.vmap(lambda term: _term_force(response, term), out_axes=1)(terms)


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
