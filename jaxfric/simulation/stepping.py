"""Integrate a motion from its start to its sample times, in segments of a few steps.

A segment takes up to `ROWS` steps and computes the derivatives of these steps (`tangents`). After
its steps, a segment evaluates the interpolant at its sample times, and discards the steps. So
memory scales with the number of samples, not with the number of steps. Derivatives of any order and
mode pass through a loop over segments:

    while a member of the batch goes on: segment(equation, point, samples) -> point, samples

The loop over segments, and each step in it, continues while any member of a batch continues. So the
counters of the loop are the same for all members of a batch, and arrays are written in place. If no
derivatives are needed, the loop is a `while_loop`. Reverse mode needs the number of iterations in
advance. So with derivatives the loop is a scan over all segments that `max_steps` allows. The scan
skips segments that no member of the batch needs.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int, PyTree

from .blocks import in_blocks
from .explicit import explicit_step
from .ode import SliderEquation, Unknowns
from .rodas import quartic, rodas_step
from .tangents import Knots, differentiable
from .thresholds import (
    CAUTION,
    FAN,
    FEWEST_PARTS,
    GROW,
    MOST_PARTS,
    ROUNDINGS,
    ROWS,
    SAMPLES_EACH,
    SHRINK,
    SMALL,
    STABLE,
)

_DECIDED = "decided"
"""Name of the values that reverse mode stores of a step: its end, and whether it was accepted.
Both depend on rounding, which differs when a segment is recomputed: the recomputed segment might
not end where the next one begins."""


class How(eqx.Module):
    """Method, accuracy and limits of the integration of a motion."""

    tolerance: Float[Array, ""]
    """Error of a step, relative and absolute, in the scaled unknowns."""
    stiff: bool = eqx.field(static=True)
    """True: Rodas5P, False: Tsit5."""
    max_steps: int = eqx.field(static=True)
    log_runaway: float = eqx.field(static=True)
    """ln of the speed, relative to the largest commanded one, at which a motion ends."""


class Underway(NamedTuple):
    """Current point of a motion."""

    time: Float[Array, ""]
    y: Unknowns
    slope: Unknowns
    """dy/dt, for the explicit pair: its last stage is the first of the next step."""
    size: Float[Array, ""]
    """Length of the next step [s]; 0: to be estimated."""
    log_speed: Float[Array, ""]
    """ln of the speed relative to the largest commanded one."""
    going: Bool[Array, ""]
    ran_away: Bool[Array, ""]
    steps: Int[Array, ""]
    """Steps taken, rejected ones included."""


Seen = TypeVar("Seen")
"""Data that an observer collects of a motion."""
Observer = Callable[[Seen, Underway, Underway], tuple[Seen, Bool[Array, ""]]]


class Sampled(NamedTuple):
    """Scaled unknowns at the sample times, and how the motion ended."""

    time: Float[Array, " n"]
    y: PyTree[Float[Array, "n ..."]]
    end: Float[Array, ""]
    reached: Bool[Array, ""]
    ran_away: Bool[Array, ""]
    steps: Int[Array, ""]


def recorded(
    equation: SliderEquation, initial: Unknowns, ts: Float[Array, " n"], how: How
) -> Sampled:
    """Solve `equation` from `initial` at `ts[0]` to `ts[-1]`; return the solution at the ends of
    the steps. The result has `max_steps` + 1 rows; the last row is repeated.

    Derivatives exist for every array of `equation` and `initial`, except the times of jumps.
    """
    point, step = _begun(equation, initial, ts, how)
    end, knots = jax.lax.scan(step, constant(point), None, length=how.max_steps)
    knots = differentiable(equation, initial, knots)
    rows = jnp.nonzero(knots.t1 > knots.t0, size=how.max_steps, fill_value=how.max_steps - 1)[0]
    time = jnp.append(point.time, knots.t1[rows])
    y = jax.tree.map(lambda y0, y1: jnp.concatenate([y0[None], y1[rows]]), initial, knots.y1)
    return _ended(ts, time, y, end)


def observed(
    equation: SliderEquation,
    initial: Unknowns,
    stops: Float[Array, " s"],
    how: How,
    observe: Observer[Seen],
    seen: Seen,
) -> tuple[Underway, Seen]:
    """Integrate from `initial` at time 0 with a step ending at each of `stops`; store no step.

    `observe(seen, before, after)` is called after every accepted step. `observe` returns the new
    `seen` and whether to stop. The motion ends at the last of the times `stops`. The result of
    `observed` has no derivatives.
    """
    equation, last = constant(equation), stops[-1]
    stops = jnp.minimum(jnp.append(equation.motion.breakpoints(), stops), last)

    def turn(carry: tuple[Underway, Seen]) -> tuple[Underway, Seen]:
        point, seen = carry
        point = _refreshed(equation, point)
        new, _ = _step(equation, point, stops, how)
        more, enough = observe(seen, point, new)
        taken = new.time > point.time
        return new._replace(going=new.going & ~(taken & enough)), _choose(taken, more, seen)

    def goes_on(carry: tuple[Underway, Seen]) -> Bool[Array, ""]:
        return eqxi.unvmap_any(carry[0].going)

    begin = _at(jnp.zeros_like(last), initial, going=last > 0)
    return jax.lax.while_loop(goes_on, turn, (begin, seen))


_Carry = tuple[Underway, PyTree[Float[Array, "n ..."]]]
"""Current point of a motion, and the unknowns at the samples, up to that point."""
_Step = Callable[[Underway, None], tuple[Underway, Knots]]


@eqx.filter_custom_jvp
def follow(
    equation: SliderEquation, initial: Unknowns, ts: Float[Array, " n"], how: How
) -> Sampled:
    """Solve `equation` from `initial` at `ts[0]`; return the solution at the ascending times `ts`.

    Derivatives exist for every array of `equation`, `initial` and `ts`, except the times of jumps.
    """
    rows = ROWS * max(_parts(ts), FEWEST_PARTS)
    carry, segment = _segments(equation, initial, ts, how, rows=rows)

    def goes_on(carry: _Carry) -> Bool[Array, ""]:
        return eqxi.unvmap_any(carry[0].going)

    point, ys = jax.lax.while_loop(goes_on, segment, carry)
    return _ended(ts, ts, ys, point)


@follow.def_jvp
def _(primals: tuple, tangents: tuple) -> tuple[Sampled, Sampled]:
    return eqx.filter_jvp(_by_scan, primals, tangents)


def _by_scan(
    equation: SliderEquation, initial: Unknowns, ts: Float[Array, " n"], how: How
) -> Sampled:
    carry, segment = _segments(equation, initial, ts, how, rows=ROWS, parts=_parts(ts))
    segments = -(-how.max_steps // (ROWS * _parts(ts)))
    decided = jax.checkpoint_policies.save_only_these_names(_DECIDED)
    loop, length = jax.checkpoint(segment, policy=decided), segments
    while length > 1:
        turns = min(length, FAN)
        loop = _repeated(loop, turns)
        length = -(-length // turns)
    point, ys = loop(carry)
    return _ended(ts, ts, ys, point)


def _repeated(loop: Callable[[_Carry], _Carry], turns: int) -> Callable[[_Carry], _Carry]:
    """Repeat `loop` `turns` times, as long as a member of the batch goes on."""

    def once(carry: _Carry, _: None) -> tuple[_Carry, None]:
        going = eqxi.unvmap_any(carry[0].going)
        return jax.lax.cond(going, loop, lambda carry: carry, carry), None

    return lambda carry: jax.lax.scan(once, carry, None, length=turns)[0]


def _parts(ts: Float[Array, " n"]) -> int:
    return int(np.clip(ts.shape[0] // SAMPLES_EACH, 1, MOST_PARTS))


def _at(time: Array, y: Unknowns, *, going: Bool[Array, ""]) -> Underway:
    """The beginning of a motion."""
    zero, slope = jnp.zeros_like(time), jax.tree.map(jnp.zeros_like, y)
    return Underway(time, y, slope, zero, zero, going, ~going & False, jnp.zeros((), jnp.int32))


def _begun(
    equation: SliderEquation, initial: Unknowns, ts: Float[Array, " n"], how: How
) -> tuple[Underway, _Step]:
    """Return the beginning of a motion, and a step of it that a member which has ended skips."""
    fixed = constant(equation)
    first, last = jax.lax.stop_gradient((ts[0], ts[-1]))
    stops = jnp.minimum(jnp.append(fixed.motion.breakpoints(), jnp.inf), last)

    def step(point: Underway, _: None) -> tuple[Underway, Knots]:
        def taken(point: Underway) -> tuple[Underway, Knots]:
            return _step(fixed, _refreshed(fixed, point), stops, how)

        return jax.lax.cond(eqxi.unvmap_any(point.going), taken, _still, point)

    return _at(first, initial, going=last > first), step


def _segments(
    equation: SliderEquation,
    initial: Unknowns,
    ts: Float[Array, " n"],
    how: How,
    *,
    rows: int,
    parts: int = 1,
) -> tuple[_Carry, Callable[[_Carry], _Carry]]:
    """Return the start of the loop over segments, and a segment of `parts` with `rows` steps."""
    point, step = _begun(equation, initial, ts, how)
    ys = jax.tree.map(lambda y: jnp.broadcast_to(y, (ts.shape[0], *y.shape)), initial)

    def part(point: Underway, _: None) -> tuple[Underway, Knots]:
        begin = point.y
        point, knots = jax.lax.scan(step, constant(point), None, length=rows)
        knots = differentiable(equation, begin, knots)
        y = jax.tree.map(lambda y: y[-1], knots.y1)
        return point._replace(y=y), knots

    def idle(point: Underway, _: None) -> tuple[Underway, Knots]:
        row = _still(constant(point))[1]
        y0, y1 = (
            jax.tree.map(lambda a: jnp.broadcast_to(a, (rows, *a.shape)), y) for y in 2 * [point.y]
        )
        still = jax.tree.map(lambda a: jnp.broadcast_to(a, (rows, *a.shape)), row)
        return point, still._replace(y0=y0, y1=y1)

    def segment(carry: _Carry) -> _Carry:
        point, ys = carry
        begin = point.time
        if parts == 1:
            point, knots = part(point, None)
        else:

            def some(point: Underway, _: None) -> tuple[Underway, Knots]:
                going = eqxi.unvmap_any(point.going)
                return jax.lax.cond(going, part, idle, point, None)

            point, knots = jax.lax.scan(some, point, None, length=parts)
            knots = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), knots)
        return point, _between(knots, until(ts, point.time), ts > begin, ys)

    return (point, ys), segment


def _ended(ts: Array, time: Array, ys: PyTree[Float[Array, "n ..."]], point: Underway) -> Sampled:
    reached = ~point.ran_away & (point.time >= jax.lax.stop_gradient(ts[-1]))
    return Sampled(time, ys, point.time, reached, point.ran_away, point.steps)


def _refreshed(equation: SliderEquation, point: Underway) -> Underway:
    """Recompute slope and speed of a point at the start and after a jump of the command."""
    fresh = point.going & (point.size == 0)

    def begin() -> tuple[Unknowns, Array]:
        return equation.derivative(point.time, point.y), equation.log_speed(point.time, point.y)

    known = (point.slope, point.log_speed)
    slope, log_speed = jax.lax.cond(eqxi.unvmap_any(fresh), begin, lambda: known)
    return point._replace(slope=slope, log_speed=log_speed)


def _step(
    equation: SliderEquation, point: Underway, stops: Float[Array, " s"], how: How
) -> tuple[Underway, Knots]:
    """Try one step, at most to the next of the `stops`; the last one ends the motion. A motion
    that has ended does not change."""
    tolerance = jax.lax.stop_gradient(how.tolerance)
    t, y, slope, last = point.time, point.y, point.slope, stops[-1]
    size = _first_size(equation, slope, y, tolerance)
    size = jnp.where(point.size == 0, size, point.size)
    size = size if how.stiff else jnp.minimum(size, _longest(equation, point.log_speed))
    stop = jnp.min(jnp.where(stops > t, stops, jnp.inf), initial=last)
    shortest = ROUNDINGS * jnp.spacing(jnp.abs(t))
    room = stop - t
    lands = size >= room * (1 - 1e-12)
    end = jnp.where(lands, stop, t + jnp.maximum(size, shortest))
    end = checkpoint_name(end, _DECIDED)
    # a jump of the command belongs to the next step
    before = jnp.where(lands, stop - ROUNDINGS * jnp.spacing(jnp.abs(stop)), end)
    before = checkpoint_name(jnp.where(before > t, before, end), _DECIDED)
    if how.stiff:
        y1, error, k = rodas_step(equation.derivative, t, before, y)
        later = slope
    else:
        y1, error, k, later = explicit_step(equation, t, before, y, slope)
    wrong = _norm(error, y, y1, tolerance)
    fine = jnp.isfinite(wrong)
    good = fine & (wrong <= 1)
    factor = CAUTION * jnp.where(fine & (wrong > 0), wrong, 1e-10) ** -0.2
    factor = jnp.where(fine, jnp.clip(factor, SHRINK, jnp.where(good, GROW, 1.0)), SHRINK)
    length = before - t
    vanished = point.going & ~good & (length <= 2 * shortest) & (not how.stiff)
    taken = checkpoint_name(point.going & good, _DECIDED)
    log_speed = equation.log_speed(before, y1)
    away = taken & (log_speed > how.log_runaway)
    new = Underway(
        jnp.where(taken, end, t),
        _choose(taken, y1, y),
        _choose(taken, later, slope),
        jnp.where(good & lands, 0.0, length * factor),
        jnp.where(taken, log_speed, point.log_speed),
        point.going
        & ~away
        & ~vanished
        & ~(taken & (end >= last))
        & (point.steps + 1 < how.max_steps),
        point.ran_away | away | vanished,
        point.steps + point.going,
    )
    none = jax.tree.map(jnp.zeros_like, k)
    return new, Knots(t, new.time, y, new.y, _choose(taken, k, none))


def _still(point: Underway) -> tuple[Underway, Knots]:
    """A step of length 0."""
    none = jax.tree.map(lambda y: jnp.zeros((3, *y.shape), y.dtype), point.y)
    return point, Knots(point.time, point.time, point.y, point.y, none)


def _longest(equation: SliderEquation, log_speed: Array) -> Float[Array, ""]:
    """Longest stable explicit step [s], from the spring's relaxation over F/K of slip plus k_v/K.

    In steady sliding a longer one amplifies rounding errors up to the tolerance.
    """
    time = _relaxation(equation) * jnp.exp(-jnp.clip(log_speed, -60.0, 60.0))
    machine = equation.rig.machine
    if machine.damping is not None:
        time = time + machine.damping / machine.stiffness
    return STABLE * time


def _relaxation(equation: SliderEquation) -> Float[Array, ""]:
    """Time in which the spring relaxes at the largest commanded speed, F/(K V) [s]."""
    slip = equation.law.force_scale() / equation.rig.machine.stiffness
    return slip / equation.motion.largest_speed()


def _padded_norm(y: PyTree) -> Float[Array, ""]:
    """sqrt(sum of squares/2): the rms of two components; components that are 0 add nothing.

    With the usual mean, an absent state would loosen the tolerance of the others. A model with an
    effect at its null would then take other steps than the model without the effect.
    """
    flat, _ = ravel_pytree(y)
    square = jnp.sum(jnp.square(flat))
    safe = jnp.where(square == 0, 1.0, square)
    return jnp.where(square == 0, 0.0, jnp.sqrt(0.5 * safe))


def _first_size(
    equation: SliderEquation, slope: Unknowns, y: Unknowns, tolerance: Float[Array, ""]
) -> Float[Array, ""]:
    """Length of the first step and of those after a jump, from the rates of the unknowns [s].

    It is at most a small part of the spring's relaxation time. Even if the motion is steady, its
    derivatives may change, for example by an effect at its null.
    """
    rate = _padded_norm(jax.tree.map(lambda d, y: d / (1 + jnp.abs(y)), slope, y))
    guess = tolerance**0.2 / jnp.where(rate > 0, rate, 1e-300)
    return jnp.minimum(guess, SMALL * _relaxation(equation))


def _norm(
    error: Unknowns, y0: Unknowns, y1: Unknowns, tolerance: Float[Array, ""]
) -> Float[Array, ""]:
    def scaled(e: Array, a: Array, b: Array) -> Array:
        return e / (tolerance * (1 + jnp.maximum(jnp.abs(a), jnp.abs(b))))

    return _padded_norm(jax.tree.map(scaled, error, y0, y1))


def _between(knots: Knots, ts: Float[Array, " n"], inside: Bool[Array, " n"], ys: PyTree) -> PyTree:
    """Replace `ys` by the interpolant at the ascending times that are `inside`, up to the last
    knot."""
    ends = jax.lax.stop_gradient(knots.t1)
    rows = jnp.searchsorted(ends, jax.lax.stop_gradient(ts))
    rows = jnp.minimum(rows, ends.shape[0] - 1)

    def at(t: Array, i: Array) -> Unknowns:
        t0, t1, y0, y1, k = jax.tree.map(
            lambda x: x[i], (knots.t0, knots.t1, knots.y0, knots.y1, knots.k)
        )
        share = (t - t0) / jnp.where(t1 > t0, t1 - t0, 1.0)
        return jax.tree.map(lambda y0, y1, k: quartic(share, y0, y1, k), y0, y1, k)

    return jax.vmap(_choose)(inside, in_blocks(at, ts, rows), ys)


def until(ts: Float[Array, " n"], end: Float[Array, ""]) -> Float[Array, " n"]:
    """The times, with `end` in place of later ones; `minimum` halves the derivative at `end`."""
    return jnp.where(ts > end, end, ts)


def _choose(which: Bool[Array, ""], one: PyTree, other: PyTree) -> PyTree:
    return jax.tree.map(lambda a, b: jnp.where(which, a, b), one, other)


def constant(tree: PyTree) -> PyTree:
    """Return the same numbers without their derivatives."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, tree)
