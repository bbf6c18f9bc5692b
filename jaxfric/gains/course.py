"""Simulation of a slider from its start until its end state can be classified."""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..coordinate import Coordinate, unit_of
from ..errors import InputError, option
from ..motion import PiecewiseVelocity
from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction import AbstractDelayLaw, AbstractInvertibleLaw, AbstractStribeck
from ..silent import silent
from ..simulation import RESULTS, InitialState, Trajectory, jump_start, rest_start, simulate
from ..simulation.delay import simulate_delay
from ..simulation.trajectory import result_words
from ..stability.analysis import Law
from ..stability.linear import linearise
from ..stability.margins import poles
from .ends import ENDS, Track, classify
from .thresholds import DISTURBANCE, LONGER, MAX_STEPS, PERIODS, ROWS, RUNAWAY, TRIES, WIDTH

_simulate = eqx.filter_jit(functools.partial(simulate, max_steps=MAX_STEPS, runaway=RUNAWAY))
_classify = eqx.filter_jit(classify)


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """A simulated motion as arrays over time, SI, for figures and files."""

    law: Law
    mass: float | None
    k_p: float
    k_v: float
    command: np.ndarray
    """Commanded velocity [m/s]."""
    time: np.ndarray
    load_point: np.ndarray
    friction: np.ndarray
    slip: np.ndarray
    velocity: np.ndarray
    coordinate: Coordinate = "linear"
    """Whether the numbers are linear (m and N) or rotary (rad and N m)."""

    def unit(self, si_unit: str) -> str:
        """The linear or rotary unit of a quantity whose linear unit is `si_unit`."""
        return unit_of(si_unit, self.coordinate)

    @staticmethod
    def of(found: Trajectory, rig: Rig, motion: PiecewiseVelocity, rows: np.ndarray) -> "Motion":
        """Select rows of a trajectory under velocity steps that begin at time 0."""
        columns = (found.time, found.recorded, found.slip, found.velocity)
        time, friction, slip, velocity = (np.asarray(x)[rows] for x in columns)
        of = motion.velocity, motion.displacement
        command, load = (np.asarray(jax.vmap(one)(jnp.asarray(time))) for one in of)
        machine = rig.machine
        mass = float(machine.mass) if isinstance(machine, Inertial) else None
        damping = 0.0 if machine.damping is None else float(machine.damping)
        gains = mass, float(machine.stiffness), damping
        return Motion(rig.friction, *gains, command, time, load, friction, slip, velocity)


class Cycle(NamedTuple):
    """Numbers that describe an oscillation, computed from the last half of the motion."""

    period: float
    """Mean time between rises of friction [s]."""
    slip_amplitude: float
    """Half the range of slip about steady sliding [m]."""
    least_velocity: float
    largest_velocity: float


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """A simulated motion with its start and its end."""

    motion: Motion
    duration: float
    """Requested duration [s]."""
    solver_steps: int
    result: RESULTS
    """`RESULTS.successful`, or why the simulation ended early."""
    start: str
    """ "at_rest" on an unloaded spring, "steady" sliding, or a "jump" of the load point."""
    jump: float | None
    """Size of the jump [m]."""
    end: str = ""
    """The name of one of `ENDS`; "" for a command with steps, whose end is not classified."""
    cycle: Cycle | None = None
    """The oscillation, if the end is "limit_cycle"."""

    @property
    def seen(self) -> bool:
        """Whether the end state is final, so that a longer simulation would not change it."""
        return self.end != "unresolved" or bool(self.result != RESULTS.successful)

    def to_json(self) -> dict[str, object]:
        """Return the entry `course` of the command's JSON, in SI."""
        cycle = None if self.cycle is None else self.cycle._asdict()
        return {
            "start": self.start,
            "jump": self.jump,
            "simulated": float(self.motion.time[-1]),
            "asked": self.duration,
            "solver_steps": self.solver_steps,
            "result": result_words(self.result),
            "end": self.end or None,
            "cycle": cycle,
        }


def rig_of(
    law: Law, mass: float | None, k_p: float, k_v: float, velocities: Sequence[float]
) -> tuple[Rig, float | None]:
    """Build the rig; return the rig and the width [m/s] of the smoothed sign of friction. A
    Stribeck law without a width gets a width from the commanded `velocities`. In all other cases
    the returned width is None.

    Raises `InputError` for a law without direct effect and without mass.
    """
    damping, width = k_v if k_v > 0 else None, None
    if mass is None and not isinstance(law, AbstractInvertibleLaw):
        raise InputError(
            f"a {type(law).__name__} law has no direct effect: without mass its velocity cannot be"
            f" found from the force; give a mass, as in {option('mass', '2 kg')}"
        )
    if isinstance(law, AbstractStribeck) and law.width is None:
        width = WIDTH * min(abs(V) for V in velocities if V)
        law = eqx.tree_at(
            lambda law: law.width, law, jnp.asarray(width), is_leaf=lambda x: x is None
        )
    machine = QuasiStatic(k_p, damping) if mass is None else Inertial(mass, k_p, damping)
    return Rig(machine, law), width


def course_of(
    rig: Rig,
    command: PiecewiseVelocity,
    *,
    duration: float | None = None,
    at_rest: bool = False,
    jump: float | None = None,
    coordinate: Coordinate = "linear",
    progress: Callable[[str], None] = silent,
) -> Course:
    """Simulate for the given duration, or for longer and longer until the end state is classified.

    A motion begins in steady sliding, or `at_rest`. At a constant velocity a `jump` [m] of the load
    point disturbs the motion; the default jump is small.

    Raises `InputError` for a delay law from rest or under steps.
    """
    times, velocities = (np.asarray(x).tolist() for x in (command.times, command.velocities))
    V = velocities[0]
    constant, delayed = len(velocities) == 1, isinstance(rig.friction, AbstractDelayLaw)
    if delayed and (at_rest or not constant):
        raise InputError(f"a delay law is simulated at one {option('velocity')}, and not from rest")
    start, lead, kind = None, 0.0, "steady"
    if at_rest:
        start, kind = rest_start(rig, V), "at_rest"
        lead = abs(float(start.elongation) / V) if start.elongation is not None else 0.0
    elif constant or jump is not None:
        if jump is None:
            jump = DISTURBANCE * float(rig.friction.force_scale()) / float(rig.machine.stiffness)
        kind = "jump"
        start = (
            InitialState(elongation=jump) if delayed else eqx.filter_jit(jump_start)(rig, V, jump)
        )
    whole = duration or _default_duration(rig, times, velocities, lead)
    tries = 1 if duration or not constant else TRIES
    k = 1
    while True:
        of = f", try {k} of at most {tries}" if tries > 1 else ""
        progress(f"simulating {whole:.4g} s{of}")
        found, run = _simulated(rig, command, whole, start)
        run = dataclasses.replace(run, coordinate=coordinate)
        end, cycle = _ending(found, run, V, lead) if constant else ("", None)
        steps = int(found.num_steps)
        course = Course(run, whole, steps, found.result, kind, jump, end, cycle)
        if course.seen or k == tries:
            return course
        k, whole = k + 1, whole * LONGER


def _default_duration(rig: Rig, times: list[float], velocities: list[float], lead: float) -> float:
    """Duration from the slowest relevant linear mode and the time to load the spring."""
    slowest = min(abs(V) for V in velocities if V)
    s = np.asarray(eqx.filter_jit(lambda *at: poles(linearise(*at)))(rig, jnp.asarray(slowest)))
    size = np.abs(s[np.isfinite(s)])
    size = size[size > 0]
    slow = max(size.min(), 1e-4 * size.max()) if size.size else 1.0
    if len(times) > 1:
        return times[-1] + max(times[-1] / (len(times) - 1), 1.5 / slow) + lead
    return PERIODS * 2 * math.pi / slow / 3 + 2 * lead


def _simulated(
    rig: Rig, command: PiecewiseVelocity, duration: float, start: InitialState | None
) -> tuple[Trajectory, Motion]:
    """Simulate once, sampled at even times and at the solver's own steps."""
    even = np.linspace(0.0, duration, ROWS + 1)
    if isinstance(rig.friction, AbstractDelayLaw):
        V = command.velocities[0]
        found = simulate_delay(rig, V, jnp.asarray(even), start=start, pieces=8)
    else:
        moved = functools.partial(_simulate, rig, command, start=start)
        rough = moved(jnp.asarray([0.0, duration]), at_steps=True)
        own = np.asarray(rough.time)
        ts = np.unique(np.concatenate([even, own]))
        ts = np.concatenate([ts, np.full(ROWS + 1 + len(own) - len(ts), ts[-1])])
        found = moved(jnp.asarray(ts), at_steps=False)
    keep = np.unique(np.asarray(found.time), return_index=True)[1]
    keep = keep[np.asarray(found.time)[keep] <= float(found.end) * (1 + 1e-12)]
    return found, Motion.of(found, rig, command, keep)


def _ending(found: Trajectory, run: Motion, V: float, lead: float) -> tuple[str, Cycle | None]:
    """The name of the motion's end, and its limit cycle if any."""
    if bool(found.result == RESULTS.ran_away):
        return "escape", None
    last = float(run.time[-1])
    columns = (run.time, run.velocity, run.slip - V * run.time, V, min(lead, 0.5 * last), last)
    *seen, V0, begin, until = (jnp.asarray(column) for column in columns)
    end = _classify(Track(*seen), V0, begin=begin, end=until)
    if bool(end.code == ENDS.steady):
        return "steady", None
    if not bool(end.code == ENDS.limit_cycle):
        return "unresolved", None
    swing, least = float(end.velocity_amplitude), float(end.least_velocity)
    period = _period(run.time, run.friction) or float(end.period)
    return "limit_cycle", Cycle(period, float(end.slip_amplitude), least, least + 2 * swing)


def _period(time: np.ndarray, friction: np.ndarray) -> float | None:
    """Mean time [s] between rises of friction from its lower to its upper quarter, in the last
    half. Oscillations within a slip do not count."""
    late = time >= 0.5 * time[-1]
    time, friction = time[late], friction[late]
    low, high = friction.min(), friction.max()
    below, rises = False, []
    for t, f in zip(time, friction, strict=True):
        if f < low + 0.25 * (high - low):
            below = True
        elif below and f > high - 0.25 * (high - low):
            below = False
            rises.append(t)
    return (rises[-1] - rises[0]) / (len(rises) - 1) if len(rises) > 1 else None
