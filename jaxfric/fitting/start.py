"""Starting values from the data, without a guess of the user.

Starts for one state. The record is averaged over intervals that are short after a velocity step and
grow with the time since the step. Over the averaging intervals sliders are simulated for a whole
grid of (A, B, L) at once (and K if K is free). Implicit Euler steps are coarse but finite for any
parameters. The range of A in the grid comes from the jumps of friction. The range of B comes from
the steady levels, the range of L from the resolved and the total slip. Linear least squares gives
f0 (and a slip trend) for each simulated slider. The best few distinct points of the grid are the
starts.

`held` advances a state over an interval at constant velocity. A law other than a `RateState` has no
separate states, so its search begins like that of the slip law.

Starts for more states. A one-state fit gives the slider's velocity without the noise of the record.
The velocity of the one-state fit drives the evolution of the states theta = B h. The state h for B
= 1 follows one of two laws:

    slip     dh/dx = -(h + ln(V/V0))/L
    ageing   h = ln(V0 Theta/L),   dTheta/dt = 1 - V Theta/L

so f = f0 + A ln(V/V0) + sum_i B_i h_i (+ s x) is linear in all but the L_i, which are scanned. A
velocity from the record itself would bias the regression: noise in the regressors favours a fast
state of negative B.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..laws.registry import evolution_of
from ..records import VelocitySteps
from ..rig.friction import AbstractEvolution, AgeingEvolution, SlipEvolution
from ..rig.thresholds import NEWTON_STEPS
from ..traced import traced
from .loading import Loading, steepest_loading
from .means import INTERVALS, Averaged, average
from .noise.thresholds import SAME_VELOCITY
from .padding import bucket, filled
from .problem import Model
from .thresholds import FEWEST_PADDED, GRID_PAIRS, HOLD


class Fineness(NamedTuple):
    """Resolution of the search for starting values."""

    intervals: int = INTERVALS
    """Approximate number of means of the record."""
    A: tuple[float, ...] = tuple(np.geomspace(0.6, 8.0, 9))
    """Values of A, in units of the largest jump per unit of ln V."""
    B: tuple[float, ...] = (-1.0, -0.4, 0.0, 0.4, 1.0)
    """Offsets of B in the same unit, from the value that the steady levels suggest."""
    L: int = 16
    K: int = 8
    """Numbers of slip lengths and of stiffnesses; the latter if K is unknown."""


FINE = Fineness()
COARSE = Fineness(48, tuple(np.geomspace(0.7, 5.0, 5)), (-0.5, 0.0, 0.7), 8, 5)
"""For many records: a tenth of the time, and rarely another minimum."""


def seek(
    t: np.ndarray,
    f: np.ndarray,
    steps: VelocitySteps,
    *,
    V0: float,
    stiffness: float | None,
    fineness: Fineness = FINE,
) -> "Sought":
    """The input of the search for one-state starts of a record, as NumPy arrays."""
    t, f, steps = _before_reversal(t, f, steps)
    data = average(t, f, steps, intervals=fineness.intervals)
    rise = steepest_loading(t, f, steps) if stiffness is None else None
    grid = _grid(data, steps, stiffness, rise, fineness)
    # padded to a few sizes, so that other records need no compilation
    grid_columns: Any = grid.T
    size = bucket(len(data.time), FEWEST_PADDED if fineness == FINE else 64)
    length, load = np.diff(data.end, prepend=0.0), steps.displacement(data.end)
    velocity = np.diff(load, prepend=0.0) / length
    dt: Any = filled(length, size, 0.0)
    rest: list[Any] = [
        filled(load, size),
        filled(velocity, size),
        filled(data.friction, size, 0.0),
        filled(data.rows, size, 0.0),
    ]
    begun: list[Any] = [np.asarray(V0, float), np.asarray(steps.velocities[0])]
    return Sought(Members(*grid_columns), Intervals(dt, *rest), *begun)


def one_state_starts(
    t: np.ndarray,
    f: np.ndarray,
    steps: VelocitySteps,
    *,
    V0: float,
    stiffness: float | None,
    model: Model,
    number: int = 5,
) -> np.ndarray:
    """The best `number` one-state starts, rows in the order of `model.names()` for one state.

    If `stiffness` is None, the stiffness K is scanned from 0.8 to 20 times the steepest loading
    rate.
    """
    sought = seek(t, f, steps, V0=V0, stiffness=stiffness)
    members, intervals, reference, begin = jax.device_put(sought)
    evolution = first_evolution(model.law)
    linear, misfit = grid_misfit(members, intervals, reference, begin, evolution, model.slip_trend)
    return sought.best(np.asarray(linear), np.asarray(misfit), model, number)


def _before_reversal(
    t: np.ndarray, f: np.ndarray, steps: VelocitySteps
) -> tuple[np.ndarray, np.ndarray, VelocitySteps]:
    """The part of a record before the load point first turns back; all of it if it never does."""
    back = np.flatnonzero(steps.velocities < 0)
    if len(back) == 0:
        return t, f, steps
    first = back[0]
    keep = t < steps.times[first]
    return t[keep], f[keep], VelocitySteps(steps.times[:first], steps.velocities[:first])


def _grid(
    data: Averaged,
    steps: VelocitySteps,
    stiffness: float | None,
    rise: Loading | None,
    fineness: Fineness,
) -> np.ndarray:
    """Values of A, B, L and K to try, one row each."""
    times, velocities = steps.times, steps.velocities
    full = data.rows > 0
    time, friction = data.time[full], data.friction[full]
    segment = np.searchsorted(times, time, side="right") - 1
    levels, logs, jump, resolved, held = [], [], 0.0, np.inf, False
    same = -np.log(SAME_VELOCITY)
    for k in range(len(times)):
        here = np.flatnonzero(segment == k)
        if velocities[k] == 0:
            held = True
            continue
        if len(here) == 0:
            continue
        levels.append(np.mean(friction[here[-max(len(here) // 8, 1) :]]))
        logs.append(np.log(abs(velocities[k])))
        change = abs(logs[-1] - logs[-2]) if len(logs) > 1 else 0.0
        change = max(change, HOLD) if held and len(logs) > 1 else change
        if change > same:
            jump = max(jump, np.max(np.abs(friction[here] - levels[-2])) / change)
            resolved = min(resolved, abs(velocities[k]) * (data.end[full][here[0]] - times[k]))
        held = False
    apart = np.asarray(logs) - np.mean(logs)
    slope = apart @ levels / (apart @ apart) if np.ptp(logs) > same else 0.0
    jump = max(jump, 1e-4 * np.ptp(friction), 1e-12)
    travel = float(np.sum(np.abs(velocities) * np.diff(np.append(times, data.end[-1]))))
    Ls = np.geomspace(max(0.3 * min(resolved, travel), 1e-5 * travel), travel, fineness.L)
    if stiffness is None:
        steepest = max(2 * np.ptp(friction) / max(travel, 1e-300), rise.stiffness if rise else 0.0)
        Ks = np.geomspace(0.8 * steepest, 20.0 * steepest, fineness.K)
    else:
        Ks = np.array([stiffness])
    A, offset, L, K = (
        g.ravel()
        for g in np.meshgrid(
            jump * np.array(fineness.A), jump * np.array(fineness.B), Ls, Ks, indexing="ij"
        )
    )
    B = A - slope + offset
    return np.stack([A, np.where(B == 0, 1e-3 * A, B), L, K], axis=1)


class Members(NamedTuple):
    """Parameters of the trial sliders ("members") in SI, one entry for each slider."""

    A: Float[Array, " m"]
    B: Float[Array, " m"]
    L: Float[Array, " m"]
    K: Float[Array, " m"]


class Intervals(NamedTuple):
    """The record by intervals: duration [s], load point [m] at the end, mean velocity of the load
    point [m/s], mean friction, number of rows. Intervals of duration 0 are padding.
    """

    length: Float[Array, " n"]
    load: Float[Array, " n"]
    velocity: Float[Array, " n"]
    friction: Float[Array, " n"]
    rows: Float[Array, " n"]


class Sought(NamedTuple):
    """Trial sliders, a record by intervals, reference velocity and first velocity [m/s]. The arrays
    of a batch of records have a leading axis.
    """

    members: Members
    intervals: Intervals
    V0: Float[Array, ""]
    first_velocity: Float[Array, ""]

    def best(
        self, linear: np.ndarray, misfit: np.ndarray, model: Model, number: int
    ) -> Float[np.ndarray, "s p"]:
        """The `number` best distinct trial sliders, first the minimum of each valley along L. Rows
        are in the order of `model.names()`.

        `linear` (m, 2) and `misfit` (m,), are results of `grid_misfit`: f0, slip
        trend and misfit of each of m trial sliders. If friction drifts slowly, the
        misfit has a second valley at long L, next to the valley of the evolution after velocity
        steps. The coarse grid does not show which valley of the misfit is deeper.
        """
        grid = np.stack(self.members, axis=1)
        misfit = np.where(np.isfinite(misfit), misfit, np.inf)
        kept: list[int] = []
        shape = np.log(np.abs(grid[:, [0, 2, 3]]))
        for i in [*_valleys(grid[:, 2], misfit), *np.argsort(misfit)]:
            if all(np.max(np.abs(shape[i] - shape[j])) > 0.5 for j in kept):
                kept.append(int(i))
            if len(kept) == number:
                break
        A, B, L, K = grid[kept].T
        columns = [linear[kept, 0], A, B, L]
        columns += [K] * model.fit_stiffness + [linear[kept, 1]] * model.slip_trend
        return np.stack(columns, axis=1)


def _valleys(L: np.ndarray, misfit: np.ndarray) -> list[int]:
    """Members at the local minima, along L, of the least misfit at each L; best first."""
    order = np.lexsort((misfit, L))
    least = order[np.unique(L[order], return_index=True)[1]]
    walled = np.pad(misfit[least], 1, constant_values=np.inf)
    deep = least[(walled[1:-1] < walled[:-2]) & (walled[1:-1] < walled[2:])]
    return deep[np.argsort(misfit[deep])].tolist()


def first_evolution(law: str) -> AbstractEvolution:
    """State evolution for the search of starting values: the law's own, else the slip law's."""
    return evolution_of(law) or SlipEvolution()


def held(
    evolution: AbstractEvolution,
    u: Float[Array, " m"],
    theta: Float[Array, " m"],
    of: Members,
    V0: Float[Array, ""],
    time: Float[Array, ""],
) -> Float[Array, " m"]:
    """States, one per trial slider, after `time` [s] at the constant velocities exp(u) V0.

    The result is exact for the slip law, where theta relaxes to -B ln(V/V0) over L. The result is
    exact for the ageing law too, where Theta relaxes to L/V. Under other laws the states advance by
    an exponential step:

        theta + t (1 - exp(-z))/z dtheta/dt,   z = -t d(dtheta/dt)/dtheta,

    which is exact if the rate dtheta/dt is linear in theta, and accurate enough for starting
    values.
    """
    r = jnp.exp(u)
    if isinstance(evolution, SlipEvolution):
        kept = jnp.exp(-r * V0 * time / of.L)
        return theta * kept - of.B * u * (1 - kept)
    if isinstance(evolution, AgeingEvolution):
        age = jnp.exp(jnp.clip(theta / of.B, -40.0, 40.0))  # V0 Theta/L
        return of.B * jnp.log(1 / r + (age - 1 / r) * jnp.exp(-r * V0 * time / of.L))

    def rate(theta: Float[Array, " m"]) -> Float[Array, " m"]:
        return evolution.rate(r, theta, of.B, of.L, V0)

    now, slope = jax.jvp(rate, (theta,), (jnp.ones_like(theta),))
    z = -time * slope
    share = jnp.where(z == 0, 1.0, -jnp.expm1(-z) / jnp.where(z == 0, 1.0, z))
    return theta + time * share * now


_Moved = tuple[Array, Array, Array, Array]
"""Slip, ln(V/V0), state and friction of all members."""


@traced
def grid_misfit(
    members: Members,
    intervals: Intervals,
    V0: Float[Array, ""],
    first_velocity: Float[Array, ""],
    evolution: AbstractEvolution,
    trend: bool,
) -> tuple[Float[Array, "m 2"], Float[Array, " m"]]:
    """Misfit of every trial slider after linear least squares for f0 (and the slip trend).

    Implicit Euler in ln V advances the slider, `held` the state of the slider. Means of successive
    simulated values (trapezoidal rule) are compared with the interval means of the record.
    """
    A, B, _, K = members
    u0 = jnp.log(jnp.abs(first_velocity) / V0)

    def advance(carry: _Moved, interval: Intervals) -> tuple[_Moved, tuple[Array, Array]]:
        new = jax.lax.cond(interval.length > 0, moved, lambda old, _: old, carry, interval)
        return new, (0.5 * (new[3] + carry[3]), 0.5 * (new[0] + carry[0]))

    def moved(carry: _Moved, interval: Intervals) -> _Moved:
        x, u, theta, _ = carry
        h, x_m, v = interval.length, interval.load, interval.velocity

        def balance(u: Array) -> tuple[Array, Array]:
            """Friction minus spring force after the step to log velocity u; the state."""
            state = held(evolution, u, theta, members, V0, h)
            return A * u + state - K * (x_m - x - V0 * jnp.exp(u) * h), state

        speed = jnp.maximum(jnp.abs(v), 1e-6 * jnp.abs(first_velocity))
        near = jnp.clip(u, jnp.log(speed / V0) - 2.0, jnp.log(speed / V0) + 2.0)
        trial = jnp.where(v > 0, near, u)
        for _ in range(NEWTON_STEPS):
            gap, slope = jax.jvp(lambda u: balance(u)[0], (trial,), (jnp.ones_like(trial),))
            trial = trial - jnp.clip(gap / jnp.maximum(slope, 0.1 * A), -1.0, 1.0)
        trial = jnp.clip(trial, -40.0, 40.0)
        state = balance(trial)[1]
        return x + V0 * jnp.exp(trial) * h, trial, state, A * trial + state

    # at the start the spring carries the steady force: x is counted from there
    theta0 = -B * u0
    force0 = A * u0 + theta0
    start = (-force0 / K, u0 * jnp.ones_like(A), theta0, force0)
    _, (forces, slips) = jax.lax.scan(advance, start, intervals)
    return jax.vmap(_linear_part, in_axes=(1, 1, None, None, None))(
        forces, slips, intervals.friction, intervals.rows, trend
    )


def _linear_part(
    force: Float[Array, " n"],
    slip: Float[Array, " n"],
    friction: Float[Array, " n"],
    rows: Float[Array, " n"],
    trend: bool,
) -> tuple[Float[Array, " 2"], Float[Array, ""]]:
    """f0 and trend by weighted least squares, and the remaining misfit."""
    target = friction - force
    total = jnp.sum(rows)
    f0 = jnp.sum(rows * target) / total
    s = jnp.zeros_like(f0)
    if trend:
        centred = slip - jnp.sum(rows * slip) / total
        s = jnp.sum(rows * centred * target) / jnp.sum(rows * centred**2)
        f0 = f0 - s * jnp.sum(rows * slip) / total
    left = target - f0 - s * slip
    return jnp.stack([f0, s]), jnp.sum(rows * left**2)


class OneStateMotion(NamedTuple):
    """Slider motion from a one-state fit: times [s], friction, velocity and slip. `weight` holds
    the square roots of the numbers of averaged rows.
    """

    time: np.ndarray
    friction: np.ndarray
    velocity: np.ndarray
    slip: np.ndarray
    weight: np.ndarray


def more_state_starts(
    seen: OneStateMotion, *, V0: float, stiffness: float, model: Model, number: int = 5
) -> np.ndarray:
    """Starts for two or more states from the velocity and slip of a one-state fit.

    The result has no rows if the velocity is not positive throughout, or no regression has A > 0.
    """
    time, friction, velocity, slip, weight = seen
    if not (np.isfinite(slip).all() and np.isfinite(velocity).all() and (velocity > 0).all()):
        return np.empty((0, len(model.names())))
    u = np.log(velocity / V0)
    dt = np.diff(time)
    V = np.sqrt(velocity[1:] * velocity[:-1])
    travel = float(np.sum(V * dt))
    Ls = np.geomspace(1e-3 * travel, travel, GRID_PAIRS)
    driven = (jnp.asarray(x, float) for x in (V, dt, Ls, u[0], V0))
    h = np.asarray(_memory(first_evolution(model.law), *driven))
    finite = np.isfinite(h).all(axis=0)  # a bad one-state fit may make a state overflow
    Ls, h, found = Ls[finite], h[:, finite], []
    for chosen in _combinations(len(Ls), model.states):
        columns = [np.ones_like(u), u, *(h[:, i] for i in chosen)]
        columns += [slip] * model.slip_trend
        design = np.stack(columns, axis=1) * weight[:, None]
        solution, *_ = np.linalg.lstsq(design, friction * weight, rcond=1e-10)
        if solution[1] <= 0:
            continue
        misfit = float(np.sum((design @ solution - friction * weight) ** 2))
        values = [solution[0], solution[1]]
        for j, i in enumerate(chosen):
            values += [solution[2 + j], Ls[i]]
        values += [stiffness] * model.fit_stiffness + [solution[-1]] * model.slip_trend
        found.append((misfit, [float(v) for v in values]))
    found.sort(key=lambda item: item[0])
    return np.array([values for _, values in found[:number]]).reshape(-1, len(model.names()))


def split_state(one: np.ndarray, states: int) -> np.ndarray:
    """A start for more states from a one-state fit: equal shares of B, L times powers of 4."""
    f0, A, B, L, *rest = one
    pairs = [(B / states, L * 4.0**i) for i in range(states)]
    return np.array([[f0, A, *(value for pair in pairs for value in pair), *rest]])


@traced
def _memory(
    evolution: AbstractEvolution,
    V: Float[Array, " n"],
    dt: Float[Array, " n"],
    Ls: Float[Array, " l"],
    start_u: Float[Array, ""],
    V0: Float[Array, ""],
) -> Float[Array, "n+1 l"]:
    """h at every time for every L, with V constant over an interval; steady at the start."""
    one = jnp.ones_like(Ls)
    of = Members(one, one, Ls, one)

    def step(h: Array, interval: tuple[Array, Array]) -> tuple[Array, Array]:
        h = held(evolution, jnp.log(interval[0] / V0) * one, h, of, V0, interval[1])
        return h, h

    _, later = jax.lax.scan(step, -start_u * one, (V, dt))
    return jnp.concatenate([-start_u * one[None], later])


def _combinations(n: int, states: int) -> list[tuple[int, ...]]:
    """Ascending choices of slip lengths, at least two grid steps apart."""
    if states == 1:
        return [(i,) for i in range(n)]
    smaller = _combinations(n, states - 1)
    return [(*c, i) for c in smaller for i in range(c[-1] + 2, n)]
