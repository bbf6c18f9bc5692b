"""Many massless sliders at once, as one loop over plain arrays.

`simulate` under `vmap` holds every slider's interpolant in one array that is copied at every
step, and evaluates the law in a form that serves all laws. For a slider without mass under
rate-and-state friction with A ln(V/V0), in V > 0, the balance of forces

    f0 + A u + sum theta_i + k_v V = K e + k_v V_m,   u = ln(V/V0),   de/dt = V_m - V

can be differentiated, and e is then known from u and theta without being integrated:

    du/dt = [K (V_m - V) - sum dtheta_i/dt]/(A + k_v V)
    slip law (4):  dtheta_i/dt = -(V/L_i) (theta_i + B_i u)
    ageing law:    dtheta_i/dt = (B_i V0/L_i) (exp(-theta_i/B_i) - V/V0)

Any other evolution is asked for its rate. One exponential a stage (two or more for ageing), no root
to find. Tsit5 (Tsitouras 2011,
doi:10.1016/j.camwa.2011.06.002) with its own error estimate and interpolant; the controller and the
tolerance are those of `simulate`. All lanes step together, each with its own step; a lane that has
ended is left as it is, and the loop ends with its last lane. So lanes that take about as
many steps should share a batch; 256 to 2048 of them fit into a cache.
"""

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from diffrax import Tsit5
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..errors import InputError
from ..quantity import is_known, refuse_outside
from ..rig import QuasiStatic
from ..rig.friction import AgeingEvolution, LogarithmicEffect, RateState, SlipEvolution

# Error of a step, as in `simulate`, with which the whole stays within 10 rtol.
_SAFETY = 0.03
_SHRINK, _GROW, _CAUTION = 0.2, 10.0, 0.9
_LARGEST_EXPONENT = 600.0

_TABLEAU = Tsit5.tableau
_A = [np.asarray(row, float) for row in _TABLEAU.a_lower]
_ERROR = np.asarray(_TABLEAU.b_error, float)


def _weights_of_the_middle() -> np.ndarray:
    """Weights of the stages in Tsit5's interpolant half-way through a step."""
    s = 0.5
    quartics = [
        -1.0530884977290216
        * s
        * (s - 1.3299890189751412)
        * (s**2 - 1.4364028541716351 * s + 0.7139816917074209),
        0.1017 * s**2 * (s**2 - 2.1966568338249754 * s + 1.2949852507374631),
        2.490627285651252793 * s**2 * (s**2 - 2.38535645472061657 * s + 1.57803468208092486),
        -16.54810288924490272 * (s - 1.21712927295533244) * (s - 0.61620406037800089) * s**2,
        47.37952196281928122 * (s - 1.203071208372362603) * (s - 0.658047292653547382) * s**2,
        -34.87065786149660974 * (s - 1.2) * (s - 0.666666666666666667) * s**2,
        2.5 * (s - 1) * (s - 0.6) * s**2,
    ]
    return np.asarray(quartics)


_MIDDLE = _weights_of_the_middle()

Vector = tuple[Array, ...]
"""u and the states over A, an array over the lanes for each."""
Seen = TypeVar("Seen")
"""The type of what an observer gathers."""


class Lanes(NamedTuple):
    """Massless sliders, an entry of every array for each, moved at constant `velocity`. SI."""

    law: RateState
    """The law, arrays with lanes along their first axis; log direct effect, no slip trend."""
    stiffness: Float[Array, " n"]
    damping: Float[Array, " n"]
    velocity: Float[Array, " n"]


class LanePoint(NamedTuple):
    """Positions of the lanes: time [s], u = ln(V/V0) and the states over A."""

    time: Float[Array, " n"]
    y: Vector


class Integration(NamedTuple, Generic[Seen]):
    """Result of an integration."""

    point: LanePoint
    """Time and unknowns at which each lane ended."""
    seen: Seen
    """Result of the observer."""
    steps: Int[Array, " n"]
    """Steps taken, rejected ones included."""
    reached: Bool[Array, " n"]
    """Whether the lane reached its last stop, or was ended by the observer."""


class Step(NamedTuple):
    """One accepted step, as an observer is shown it."""

    before: LanePoint
    after: LanePoint
    accepted: Bool[Array, " n"]
    row: Int[Array, ""]
    """Number of the step of the loop, the same for all lanes."""
    slopes: tuple[Vector, Vector]
    """dy/dt at both ends."""
    middle: Vector
    """y half-way."""


def lanes(law: RateState, stiffness: ArrayLike, damping: ArrayLike, velocity: ArrayLike) -> Lanes:
    """Lanes from arrays that share their first axis.

    Raises
    ------
    InputError : a law that is no `RateState`, or that hardens with slip; of what is
        known, parameters, stiffness or velocity that are not positive, damping below 0.
    """
    if not isinstance(law, RateState):
        raise InputError(
            f"an ensemble of sliders without mass needs a rate-and-state law, not a"
            f" {type(law).__name__}"
        )
    refuse_outside(law, "ensemble")
    refuse_outside(QuasiStatic(stiffness, damping), "ensemble")
    if is_known(velocity) and not np.all(np.asarray(velocity) > 0):
        raise InputError("ensemble: a velocity is not positive")
    return Lanes(law, *(jnp.asarray(x, law.A.dtype) for x in (stiffness, damping, velocity)))


def stepped(of: Lanes, ratio: Float[Array, " n"]) -> LanePoint:
    """Steady sliding at velocity/ratio, whose command has just stepped to `velocity`."""
    law = of.law
    u = jnp.log(of.velocity / (ratio * law.V0))
    # the spring and theta go on from where they were; the dashpot feels the command's step at once:
    # A u + k_v (V - V_m) keeps its value, which it has from before, when V was V_m
    wanted = law.A * u + of.damping * of.velocity
    V = LogarithmicEffect().velocity(wanted, jnp.zeros_like(u), law.A, law.V0, of.damping)
    new = jnp.log(V / law.V0)
    b = law.B / law.A[:, None]
    return LanePoint(jnp.zeros_like(u), (new, *(-b[:, i] * u for i in range(b.shape[1]))))


def derivative(of: Lanes) -> Callable[[Vector], Vector]:
    """The rates of u and of the states over A [1/s], of all lanes."""
    law = of.law
    n = law.B.shape[1]
    stiff, damp = of.stiffness * law.V0 / law.A, of.damping * law.V0 / law.A
    command = of.velocity / law.V0
    b = [law.B[:, i] / law.A for i in range(n)]
    pace = [law.V0 / law.L[:, i] for i in range(n)]
    evolution = law.evolution
    own = jax.vmap(lambda r, theta, B, L, V0: evolution.rate(r, theta, B, L, V0))

    def rates(y: Vector) -> Vector:
        u, *psi = y
        r = jnp.exp(jnp.minimum(u, _LARGEST_EXPONENT))
        if isinstance(evolution, AgeingEvolution):
            states = [
                jnp.where(
                    b[i] == 0,
                    0.0,
                    b[i]
                    * pace[i]
                    * (jnp.exp(jnp.minimum(-psi[i] / jnp.where(b[i] == 0, 1.0, b[i]), 600.0)) - r),
                )
                for i in range(n)
            ]
        elif isinstance(evolution, SlipEvolution):
            states = [-(pace[i] * r) * (psi[i] + b[i] * u) for i in range(n)]
        else:
            theta = jnp.stack(psi, axis=1) * law.A[:, None]
            states = list((own(r, theta, law.B, law.L, law.V0) / law.A[:, None]).T)
        du = (stiff * (command - r) - sum(states)) / (1 + damp * r)
        return (du, *states)

    return rates


def integrate(
    of: Lanes,
    start: LanePoint,
    stops: Float[Array, "s n"],
    *,
    observe: Callable[[Seen, Step], tuple[Seen, Bool[Array, " n"]]],
    seen: Seen,
    rtol: float = 1e-6,
    max_steps: int = 4096,
) -> Integration[Seen]:
    """Step all lanes to the last of their `stops`, landing on each of them.

    `observe(seen, step)` is shown every step of the loop and gives the new `seen` and the
    lanes to end. No lane raises: one that needs more than `max_steps`, or whose step vanishes, has
    `reached` False.
    """
    rates = derivative(of)
    tolerance = _SAFETY * rtol
    rows = jnp.arange(stops.shape[0])[:, None]
    slope = rates(start.y)
    fastest = jnp.maximum(_norm(slope), 1e-300)
    size = jnp.minimum(0.1 * tolerance**0.2 / fastest, stops[-1] - start.time)

    def unfinished(carry: tuple) -> Bool[Array, ""]:
        return jnp.any(carry[-2]) & (carry[-1] < max_steps)

    def body(carry: tuple) -> tuple:
        point, slope, size, at, seen, steps, active, row = carry
        stop = jnp.min(jnp.where(rows == at, stops, jnp.inf), axis=0)
        room = stop - point.time
        lands = size >= room * (1 - 1e-12)
        h = jnp.where(lands, room, size)
        y, k, error, middle = _tsit5(rates, point.y, slope, h, tolerance)
        good = jnp.isfinite(error) & (error <= 1)
        grown = jnp.clip(_CAUTION * jnp.where(good, error, 1.0) ** -0.2, _SHRINK, _GROW)
        shrunk = jnp.clip(_CAUTION * jnp.where(jnp.isfinite(error), error, 1e9) ** -0.2, _SHRINK, 1)
        after = LanePoint(jnp.where(lands, stop, point.time + h), y)
        accepted = active & good
        seen, ended = observe(seen, Step(point, after, accepted, row, (slope, k), middle))
        next_size = h * jnp.where(good, grown, shrunk)
        next_size = jnp.where(good & lands, jnp.maximum(next_size, size), next_size)
        at = at + jnp.where(accepted & lands, 1, 0)
        vanished = next_size <= 1e-14 * jnp.maximum(stops[-1], 1e-300)
        point, slope = jax.tree.map(
            lambda new, old: jnp.where(accepted, new, old), (after, k), (point, slope)
        )
        size = jnp.where(active, next_size, size)
        steps = steps + active
        finished = (at >= stops.shape[0]) | (accepted & ended)
        at = jnp.where(finished, stops.shape[0], at)
        active = active & ~finished & ~vanished
        return point, slope, size, at, seen, steps, active, row + 1

    at = jnp.zeros(size.shape, jnp.int32)
    active = jnp.isfinite(fastest) & jnp.isfinite(stops[-1]) & (stops[-1] > start.time)
    carry = (start, slope, size, at, seen, at, active, jnp.asarray(0, jnp.int32))
    point, _, _, at, seen, steps, _, _ = jax.lax.while_loop(unfinished, body, carry)
    return Integration(point, seen, steps, at >= stops.shape[0])


def _tsit5(
    rates: Callable[[Vector], Vector],
    y: Vector,
    first: Vector,
    h: Float[Array, " n"],
    tolerance: float,
) -> tuple[Vector, Vector, Float[Array, " n"], Vector]:
    """A step: y at its end, dy/dt there, error in units of the tolerance, y in the middle."""
    ks, at = [first], y
    for row in _A:
        at = tuple(
            y[j] + h * sum(float(a) * k[j] for a, k in zip(row, ks, strict=True))
            for j in range(len(y))
        )
        ks.append(rates(at))
    end = at
    error = jnp.zeros_like(h)
    for j in range(len(y)):
        wrong = h * sum(float(e) * k[j] for e, k in zip(_ERROR, ks, strict=True))
        scale = tolerance * (1 + jnp.maximum(jnp.abs(y[j]), jnp.abs(end[j])))
        error = error + jnp.square(wrong / scale)
    middle = tuple(
        y[j] + h * sum(float(w) * k[j] for w, k in zip(_MIDDLE, ks, strict=True))
        for j in range(len(y))
    )
    return end, ks[-1], jnp.sqrt(0.5 * error), middle


def _norm(y: Vector) -> Float[Array, " n"]:
    return jnp.sqrt(sum(jnp.square(part) for part in y))


class LaneResponse(NamedTuple):
    """Motion of all lanes at sample times; rows are times, columns are lanes."""

    force: Float[Array, "t n"]
    """Friction [force]."""
    velocity: Float[Array, "t n"]
    """[m/s]"""
    steps: Int[Array, " n"]
    reached: Bool[Array, " n"]
    """False where the lane ran away or took too many steps: its last values hold."""
    escaped: Bool[Array, " n"]


def response(
    of: Lanes,
    start: LanePoint,
    times: Float[Array, "t n"],
    *,
    rtol: float = 1e-6,
    max_steps: int = 4096,
    runaway: float = 1e4,
    window: int = 512,
) -> LaneResponse:
    """Friction and velocity at `times` [s] > 0, ascending, of each lane.

    Steps are kept, `window` of them at a time, and the solver's own interpolant, a quartic, is
    evaluated between them, so samples cost no steps. A lane whose velocity passes `runaway`
    times the command ends there. Lanes that go on after `max_steps`, rounded up to whole
    windows, or whose step vanishes, have `reached` False.
    """
    size = min(window, max_steps)
    limit = jnp.log(of.velocity / of.law.V0) + np.log(runaway)

    def unfinished(carry: tuple) -> Bool[Array, ""]:
        return jnp.any(carry[2]) & (carry[-1] < max_steps)

    def follow(carry: tuple) -> tuple:
        point, samples, active, reached, escaped, steps, row = carry
        part = _kept(of, point, jnp.where(active, times[-1], point.time), limit, rtol, size)
        fresh = _between(part.kept, part.rows, len(point.y), jnp.minimum(times, part.point.time))
        inside = active & (times > point.time)
        samples = tuple(jnp.where(inside, x, y) for x, y in zip(fresh, samples, strict=True))
        reached = reached | (active & part.reached & ~part.escaped)
        escaped = escaped | (active & part.escaped)
        # one that stopped before its window was full could go no further
        active = active & ~part.reached & ~part.escaped & (part.steps >= size)
        return part.point, samples, active, reached, escaped, steps + part.steps, row + size

    no = jnp.zeros(start.time.shape, bool)
    samples = tuple(jnp.broadcast_to(x, times.shape) for x in start.y)
    carry = (start, samples, ~no, no, no, jnp.zeros(no.shape, jnp.int32), jnp.asarray(0, jnp.int32))
    _, y, _, reached, escaped, steps, _ = jax.lax.while_loop(unfinished, follow, carry)
    force = of.law.f0 + of.law.A * sum(y)
    velocity = of.law.V0 * jnp.exp(jnp.minimum(y[0], _LARGEST_EXPONENT))
    return LaneResponse(force, velocity, steps, reached, escaped)


_Kept = tuple[tuple[Array, ...], tuple[Array, ...], Bool[Array, " n"]]
"""Kept steps, the last of them, and the lanes that have escaped."""


class _Window(NamedTuple):
    """Kept steps of all lanes: time, y, dy/dt and y in the middle, a row a step."""

    kept: tuple[Array, ...]
    rows: Int[Array, ""]
    point: LanePoint
    reached: Bool[Array, " n"]
    escaped: Bool[Array, " n"]
    steps: Int[Array, " n"]


def _kept(
    of: Lanes,
    start: LanePoint,
    until: Float[Array, " n"],
    limit: Float[Array, " n"],
    rtol: float,
    size: int,
) -> _Window:
    """Follow all lanes to `until` [s] or for `size` steps, and keep the steps."""
    number = start.time.shape[0]
    first = (start.time, *start.y, *derivative(of)(start.y), *start.y)
    kept = tuple(jnp.zeros((size + 1, number), x.dtype).at[0].set(x) for x in first)

    def observe(seen: _Kept, step: Step) -> tuple[_Kept, Bool[Array, " n"]]:
        kept, last, escaped = seen
        new = (step.after.time, *step.after.y, *step.slopes[1], *step.middle)
        last = tuple(jnp.where(step.accepted, x, y) for x, y in zip(new, last, strict=True))
        kept = tuple(
            jax.lax.dynamic_update_index_in_dim(rows, x, step.row + 1, 0)
            for rows, x in zip(kept, last, strict=True)
        )
        fast = step.accepted & (step.after.y[0] > limit)
        return (kept, last, escaped | fast), fast

    seen = (kept, first, jnp.zeros(number, bool))
    done = integrate(of, start, until[None], observe=observe, seen=seen, rtol=rtol, max_steps=size)
    kept, _, escaped = done.seen
    rows = jnp.minimum(jnp.max(done.steps), size)
    return _Window(kept, rows, done.point, done.reached, escaped, done.steps)


def _between(
    kept: tuple[Array, ...], rows: Int[Array, ""], n: int, times: Float[Array, "t n"]
) -> Vector:
    """y at `times` by the quartic through both ends, their slopes and the middle."""
    low = jnp.zeros(times.shape, jnp.int32)
    high = jnp.broadcast_to(rows.astype(jnp.int32), times.shape)
    lane = jnp.arange(times.shape[1], dtype=jnp.int32)

    def column(i: int, row: Int[Array, "t n"]) -> Float[Array, "t n"]:
        return kept[i].at[row, lane].get(mode="promise_in_bounds")

    def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        probe = (low + high) // 2
        later = column(0, probe) >= times
        return jnp.where(later, low, probe), jnp.where(later, probe, high)

    rounds = int(np.ceil(np.log2(kept[0].shape[0] + 1)))
    low, high = jax.lax.fori_loop(0, rounds, halve, (low, high))
    t0, t1 = column(0, low), column(0, high)
    h = t1 - t0
    s = jnp.clip((times - t0) / jnp.where(h > 0, h, 1.0), 0.0, 1.0)
    found = []
    for j in range(n):
        y0, y1 = column(1 + j, low), column(1 + j, high)
        d0, d1 = h * column(1 + n + j, low), h * column(1 + n + j, high)
        middle = column(1 + 2 * n + j, high)
        cubic = _hermite(s, y0, y1, d0, d1)
        bump = middle - (0.5 * (y0 + y1) + (d0 - d1) / 8)
        found.append(cubic + 16 * jnp.square(s * (1 - s)) * bump)
    return tuple(found)


def _hermite(s: Array, y0: Array, y1: Array, d0: Array, d1: Array) -> Array:
    """The cubic at s in 0..1 through both ends with their slopes, times the length of the step."""
    rest = 1 - s
    slope = y1 - y0
    return y0 + s * slope + s * rest * (rest * (d0 - slope) - s * (d1 - slope))
