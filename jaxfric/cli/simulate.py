"""`jaxfric simulate`: the nonlinear motion of a slider in time, with pictures."""

import dataclasses
import functools
import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

from ..errors import InputError
from ..schemas import SIMULATION
from . import options
from .common import OfMotion, prepare_jax, told, warn
from .folder import Folder, json_text
from .stamp import made_by

if TYPE_CHECKING:
    import numpy as np

    from ..coordinate import Coordinate
    from ..plot.cycle import Motion
    from ..rig import Rig
    from ..simulation import RESULTS, InitialState, Trajectory
    from ..stability.analysis import Law

_MAX_STEPS = 16384
_RTOL = 1e-6
_ROWS = 2000
_PERIODS = 30.0
# A default duration in which no end is seen is made longer, so many times as often.
_LONGER, _TRIES = 4.0, 4
# Spring force of the disturbance at a constant velocity, relative to the law's scale of force.
_SEED = 0.02
# Velocity over which the sign of a memoryless law turns, relative to the slowest command.
_WIDTH = 1e-3


@options.FLAT
@dataclasses.dataclass(frozen=True)
class MotionOptions:
    """Start and duration of a motion."""

    duration: options.Text = None
    """Simulated time, '20 s'. By default until the end state is recognised."""
    at_rest: bool = False
    """Start at rest with an unloaded spring (stick)."""
    jump: options.Text = None
    """Jump of the load point at the start, '1 um', of either sign. At a constant velocity the
    default is a small jump: without it nothing would disturb steady sliding."""


def simulate(
    *,
    law: options.LawOptions = options.LawOptions(),
    velocity: options.Velocity = None,
    steps: options.Steps = None,
    kp: Annotated[options.Gain, options.required(options.GAIN)] = None,
    kv: options.Damping = None,
    mass: options.Mass = None,
    how: MotionOptions = MotionOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Simulate a slider: stick-slip or steady sliding, from rest or from a disturbance.

    Writes trajectory.csv, which 'jaxfric inspect' and 'jaxfric fit' read, and figures to the
    output folder, by default ./NAME-simulate/ with the options that differ from their default;
    NAME is the law's, or the folder's of the fit.
    """
    if (velocity is None) == (steps is None):
        raise InputError("give one of --velocity '2 um/s' and --steps '0 s: 1 um/s, 10 s: 10 um/s'")
    if kp is None:
        raise InputError("--kp is missing; give stiffness or position gain, as in --kp '3 kN/m'")
    if how.jump is not None and how.at_rest:
        raise InputError("--jump and --at-rest exclude each other; give one")
    prepare_jax()
    source = law.source()
    given = OfMotion(
        {
            "--velocity": (velocity, "m/s"),
            "--kp": (kp, "N/m"),
            "--kv": (kv, "N*s/m"),
            "--mass": (mass, "kg"),
            "--duration": (how.duration, "s"),
            "--jump": (how.jump, "m"),
        },
        source.coordinate,
    )
    times, velocities = _command(given, velocity, steps)
    k_p = given.positive("--kp")
    assert k_p is not None
    k_v, one_mass = given.damping("--kv"), given.mass()
    length, jumped = given.positive("--duration"), given.read("--jump")
    one_mass = source.mass if one_mass is None else one_mass
    unseen = source.unseen(velocities)
    warn(unseen)
    folder = law.folder(output)
    rig, notes = _rig(source.law, one_mass, k_p, k_v, velocities, given.unit("--velocity"))
    with told() as progress:
        shown = _length_shown(velocity or steps or "", given.coordinate)
        run, lines = _run(rig, (times, velocities), length, how.at_rest, jumped, shown, progress)
        progress("drawing figures")
        from ..plot.cycle import DRAWERS

        run = dataclasses.replace(run, coordinate=given.coordinate)
        heading = [source.text, _machine(run), *notes]
        with folder.results() as to:
            warned = [f"warning: {line}" for line in (*source.warnings, *unseen)]
            (to / "trajectory.csv").write_text(_table(run, [*heading, *lines, *warned]))
        for name, draw in DRAWERS.items():
            folder.draw(name, lambda to, draw=draw: draw(run, to))
    if output.json:
        print(json_text(_content(run, source.text, notes, lines, folder)))
    else:
        for line in [*heading, *lines]:
            print(line)
        print(folder.written)
    return folder.close()


def _content(
    run: "Motion", law: str, notes: list[str], lines: list[str], folder: Folder
) -> dict[str, object]:
    """What was simulated as JSON, in SI; `course` are words on its start and end by their name."""
    return {
        "schema": SIMULATION,
        "law": law,
        "mass": run.mass,
        "kp": run.k_p,
        "kv": run.k_v,
        "units": {"kp": run.unit("N/m"), "kv": run.unit("N s/m"), "slip": run.unit("m")},
        "course": dict(line.split(": ", 1) for line in lines),
        "notes": notes,
        "rows": len(run.time),
        "duration": float(run.time[-1]),
        "slip": float(run.slip[-1]),
        "velocity": [float(run.velocity.min()), float(run.velocity.max())],
        "friction": [float(run.friction.min()), float(run.friction.max())],
        "files": [str(folder.path / name) for name in folder.files],
    }


def _command(
    given: OfMotion, velocity: str | None, steps: str | None
) -> tuple[list[float], list[float]]:
    """Times [s] and velocities [m/s] of the command."""
    if steps is not None:
        if given.coordinate == "rotary":
            raise InputError("--steps are in m/s; of a joint give one --velocity, as in '2 rad/s'")
        from ..records import VelocitySteps

        found = VelocitySteps.parse(steps)
        if not found.velocities[0] != 0:
            raise InputError("--steps: the first velocity is 0; steady sliding needs another")
        return found.times.tolist(), found.velocities.tolist()
    values = given.values("--velocity")
    if len(values) > 1:
        raise InputError(f"--velocity: '{velocity}' is more than one; give one, or --steps")
    return [0.0], values


def _length_shown(command: str, coordinate: "Coordinate") -> str:
    """The unit of length of the commanded velocity, in which slip is told, else um; rad."""
    if coordinate == "rotary":
        return "rad"
    found = re.search(r"([nuµμmc]?m|microns?)\s*/\s*s", command)
    return found[1].replace("µ", "u").replace("μ", "u") if found else "um"


def _rig(
    law: "Law", mass: float | None, k_p: float, k_v: float, velocities: list[float], speed: str
) -> "tuple[Rig, list[str]]":
    """The rig, and what was assumed; `speed` is the unit of the velocities."""
    import equinox as eqx
    import jax.numpy as jnp

    from ..rig import Inertial, QuasiStatic, Rig
    from ..rig.friction import AbstractInvertibleLaw, AbstractStribeck

    damping = k_v if k_v > 0 else None
    notes = []
    if mass is None and not isinstance(law, AbstractInvertibleLaw):
        raise InputError(
            f"a {type(law).__name__} law has no direct effect: without mass its velocity cannot be"
            " found from the force; give a mass, as in --mass '2 kg'"
        )
    if isinstance(law, AbstractStribeck) and law.width is None:
        width = _WIDTH * min(abs(V) for V in velocities if V)
        law = eqx.tree_at(
            lambda law: law.width, law, jnp.asarray(width), is_leaf=lambda x: x is None
        )
        notes.append(f"the sign of friction turns over {width:.3g} {speed} (parameter width)")
    machine = QuasiStatic(k_p, damping) if mass is None else Inertial(mass, k_p, damping)
    return Rig(machine, law), notes


def _run(
    rig: "Rig",
    command: tuple[list[float], list[float]],
    length: float | None,
    at_rest: bool,
    jump: float | None,
    shown: str,
    progress: Callable[[str], None],
) -> "tuple[Motion, list[str]]":
    """Simulate, longer and longer where nothing was asked for and no end is seen; what happened."""
    from ..rig.friction import AbstractDelayLaw
    from ..simulation import rest_start

    times, velocities = command
    V = velocities[0]
    constant, delayed = len(velocities) == 1, isinstance(rig.friction, AbstractDelayLaw)
    if delayed and (at_rest or not constant):
        raise InputError("a delay law is simulated at one --velocity, and not from rest")
    start, lead, lines = None, 0.0, []
    if at_rest:
        start = rest_start(rig, V)
        lead = abs(float(start.elongation) / V) if start.elongation is not None else 0.0
        lines.append("start: at rest, the spring unloaded")
    elif constant or jump is not None:
        if jump is None:
            jump = _SEED * float(rig.friction.force_scale()) / float(rig.machine.stiffness)
        start = _jumped(rig, V, jump, delayed)
        size = 1.0 if shown == "rad" else 1e-6
        unit = "rad" if shown == "rad" else "um"
        lines.append(
            f"start: steady sliding; then the load point jumps by {jump / size:.4g} {unit}"
        )
    whole = length or _default_duration(rig, times, velocities, lead)
    tries = 1 if length or not constant else _TRIES
    k = 1
    while True:
        of = f", try {k} of at most {tries}" if tries > 1 else ""
        progress(f"simulating {whole:.4g} s{of}")
        run, lines_end, seen = _once(rig, command, whole, start, lead, shown)
        if seen or k == tries:
            return run, [*lines, *lines_end]
        k, whole = k + 1, whole * _LONGER


def _jumped(rig: "Rig", V: float, jump: float, delayed: bool) -> "InitialState":
    import equinox as eqx

    from ..simulation import InitialState, jump_start

    return InitialState(elongation=jump) if delayed else eqx.filter_jit(jump_start)(rig, V, jump)


def _default_duration(
    rig: "Rig", times: list[float], velocities: list[float], lead: float
) -> float:
    """Periods of the slowest linear mode that matters, and the time to load the spring."""
    import numpy as np

    from ..rig import Inertial
    from ..stability.analysis import slider_poles

    machine = rig.machine
    slowest = min(abs(V) for V in velocities if V)
    mass = machine.mass if isinstance(machine, Inertial) else None
    damping = 0.0 if machine.damping is None else machine.damping
    s = np.asarray(slider_poles(rig.friction, slowest, mass, machine.stiffness, damping))
    size = np.abs(s[np.isfinite(s)])
    size = size[size > 0]
    slow = max(size.min(), 1e-4 * size.max()) if size.size else 1.0
    if len(times) > 1:
        return times[-1] + max(times[-1] / (len(times) - 1), 1.5 / slow) + lead
    return _PERIODS * 2 * math.pi / slow / 3 + 2 * lead


def _once(
    rig: "Rig",
    command: tuple[list[float], list[float]],
    duration: float,
    start: "InitialState | None",
    lead: float,
    shown: str,
) -> "tuple[Motion, list[str], bool]":
    """One simulation: what to draw and write, lines about its end, whether the end was seen."""
    import jax.numpy as jnp
    import numpy as np

    from ..motion import PiecewiseVelocity
    from ..plot.cycle import Motion
    from ..rig.friction import AbstractDelayLaw
    from ..simulation import RESULTS
    from ..simulation.delay import simulate_delay

    times, velocities = command
    motion = PiecewiseVelocity(jnp.asarray(times), jnp.asarray(velocities))
    delayed = isinstance(rig.friction, AbstractDelayLaw)
    even = np.linspace(0.0, duration, _ROWS + 1)
    if delayed:
        found = simulate_delay(rig, velocities[0], jnp.asarray(even), start=start, pieces=8)
    else:
        span = jnp.asarray([0.0, duration])
        rough = _integrator()(rig, motion, span, start=start, at_steps=True)
        own = np.asarray(rough.time)
        ts = np.unique(np.concatenate([even, own]))
        ts = np.concatenate([ts, np.full(_ROWS + 1 + len(own) - len(ts), ts[-1])])
        found = _integrator()(rig, motion, jnp.asarray(ts), start=start, at_steps=False)
    end = float(found.end)
    keep = np.unique(np.asarray(found.time), return_index=True)[1]
    keep = keep[np.asarray(found.time)[keep] <= end * (1 + 1e-12)]
    run = Motion.of(found, rig, motion, keep)
    lines = [f"simulated: {end:.6g} s of {duration:.6g} s, {int(found.num_steps)} steps"]
    early = bool(found.result != RESULTS.successful)
    if early:
        lines.append(f"ended early: {_why(found.result)}")
    if len(velocities) > 1:
        return run, lines, True
    text, seen = _ending(found, run, velocities[0], lead, early, shown)
    return run, [*lines, text], seen or early


@functools.cache
def _integrator():
    """`simulate`, compiled once for each shape."""
    import equinox as eqx

    from ..gains.ends import RUNAWAY
    from ..simulation import simulate as integrate

    limits = {"rtol": _RTOL, "max_steps": _MAX_STEPS, "runaway": RUNAWAY}
    return eqx.filter_jit(functools.partial(integrate, **limits))


@functools.cache
def _classifier():
    """`classify`, compiled: arrays in, the end state out."""
    import equinox as eqx

    from ..gains.ends import Track, classify

    @eqx.filter_jit
    def run(time, velocity, deviation, V, *, begin, end):
        return classify(Track(time, velocity, deviation), V, begin=begin, end=end)

    return run


def _why(result: "RESULTS") -> str:
    from ..simulation import RESULTS

    if bool(result == RESULTS.max_steps_reached):
        return f"{_MAX_STEPS} solver steps were not enough; give a shorter --duration"
    return " ".join(RESULTS[result].split())


def _ending(
    found: "Trajectory", run: "Motion", V: float, lead: float, early: bool, shown: str
) -> tuple[str, bool]:
    """How the motion ends, in words; lengths in the unit `shown`."""
    import jax.numpy as jnp

    from ..gains.ends import ENDS
    from ..simulation import RESULTS
    from ..units import factor, format_si

    if bool(found.result == RESULTS.ran_away):
        return "end: escape, the slider ran away", True
    last = float(run.time[-1])
    columns = (run.time, run.velocity, run.slip - V * run.time, V, min(lead, 0.5 * last), last)
    *seen, begin, until = (jnp.asarray(column) for column in columns)
    end = _classifier()(*seen, begin=begin, end=until)
    if bool(end.code == ENDS.steady):
        return "end: steady sliding, or ever closer to it", True
    if bool(end.code == ENDS.limit_cycle):
        swing, slip = float(end.velocity_amplitude), float(end.slip_amplitude)
        unit = "rad" if shown == "rad" else "m"
        size, least = factor(shown, unit, "length"), float(end.least_velocity)
        period = _period(run.time, run.friction) or float(end.period)
        return (
            f"end: oscillation (stick-slip limit cycle, or still growing), period"
            f" {period:.5g} s, slip amplitude {format_si(slip, unit, shown, 5)} (half the range of"
            f" slip about steady sliding), velocity {least / size:.4g} to"
            f" {(least + 2 * swing) / size:.4g} {shown}/s"
        ), True
    return "end: not decided in this time; give a longer --duration", False


def _period(time: "np.ndarray", friction: "np.ndarray") -> float | None:
    """Mean time [s] between rises of friction from its lower to its upper quarter, in the last
    half: what happens within a slip does not count."""
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


def _machine(run: "Motion") -> str:
    k_p, k_v, mass = (run.unit(unit) for unit in ("N/m", "N s/m", "kg"))
    text = "no mass (quasi-static)" if run.mass is None else f"mass {run.mass:g} {mass}"
    return f"k_p = {run.k_p:g} {k_p}, k_v = {run.k_v:g} {k_v}, {text}"


def _table(run: "Motion", notes: list[str]) -> str:
    """trajectory.csv: comments, a line of names with units, numbers."""
    made = [f"{name}: {text}" for name, text in made_by().items()]
    rotary = run.coordinate == "rotary"
    length, size = ("rad", 1.0) if rotary else ("um", 1e6)
    names = ["time [s]", f"load_point_displacement [{length}]", f"friction [{run.unit('N')}]"]
    names += [f"slip [{length}]", f"slider_velocity [{length}/s]"]
    lines = [f"# {' '.join(note.split())}" for note in ("simulated by jaxfric", *made, *notes)]
    lines.append(",".join(names))
    moved, slip, velocity = (size * x for x in (run.load_point, run.slip, run.velocity))
    columns = (run.time, moved, run.friction, slip, velocity)
    lines += [
        f"{t:.12g},{x:.10g},{f:.10g},{s:.10g},{v:.6g}"
        for t, x, f, s, v in zip(*columns, strict=True)
    ]
    return "\n".join(lines) + "\n"
