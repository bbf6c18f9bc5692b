"""Describe a simulated motion in words, and write it as the table trajectory.csv."""

import io
from collections.abc import Mapping, Sequence

import numpy as np

from ..gains.course import Course, Motion
from ..gains.thresholds import MAX_STEPS, RUNAWAY
from ..plain import entries
from ..schemas import SIMULATION
from ..simulation import RESULTS
from ..units import factor, format_si
from .report import Report
from .words import amount, machine, say


def report(course: Course, law: str, width: float | None, length: str) -> Report:
    """Say how a simulated motion ends, then describe its law, machine, start and course.

    Lengths are in the unit `length`. Around zero velocity, friction changes its sign over the
    assumed range of velocity `width` [m/s].
    """
    motion, early = course.motion, course.result != RESULTS.successful
    notes = [law, machine(motion, motion.k_p, motion.k_v, motion.mass)]
    if width is not None:
        speed = amount(motion, width, "m/s", 3)
        notes.append(f"the sign of friction turns over {speed} (parameter width)")
    jump = "" if course.jump is None else f" by {amount(motion, course.jump, 'm')}"
    notes.append(f"start: {course.start.replace('_', ' ')}{jump}")
    reached = f"{float(motion.time[-1]):.6g} s of {course.duration:.6g} s"
    speeds = _speeds(motion.velocity.min(), motion.velocity.max(), length)
    notes.append(f"simulated: {reached}, {course.solver_steps} steps; slider {speeds}")
    notes += [f"ended early: {_why(course.result)}"] if early else []
    if not course.end:
        return Report([notes.pop()], notes=notes)
    end = say(f"end.{course.end}", most=RUNAWAY)
    return Report([f"end: {end}{_cycle(course, length)}"], notes=notes)


def content(
    course: Course, law: str, width: float | None, files: Sequence[str]
) -> dict[str, object]:
    """The simulated motion as JSON, in SI."""
    run = course.motion
    return {
        "schema": SIMULATION,
        "law": law,
        "width": width,
        **entries(run, "mass", kp="k_p", kv="k_v"),
        "units": {"kp": run.unit("N/m"), "kv": run.unit("N s/m"), "slip": run.unit("m")},
        "course": course.to_json(),
        "rows": len(run.time),
        "duration": float(run.time[-1]),
        "slip": float(run.slip[-1]),
        "velocity": [float(run.velocity.min()), float(run.velocity.max())],
        "friction": [float(run.friction.min()), float(run.friction.max())],
        "files": files,
    }


def trajectory_text(motion: Motion, made: Mapping[str, str], notes: Sequence[str]) -> str:
    """trajectory.csv: comments, a line of names with units, numbers."""
    length, size = ("rad", 1.0) if motion.coordinate == "rotary" else ("um", 1e6)
    names = ["time [s]", f"load_point_displacement [{length}]", f"friction [{motion.unit('N')}]"]
    names += [f"slip [{length}]", f"slider_velocity [{length}/s]"]
    told = ("simulated by jaxfric", *(f"{name}: {text}" for name, text in made.items()), *notes)
    lines = [*(f"# {' '.join(note.split())}" for note in told), ",".join(names)]
    moved, slip, velocity = (size * x for x in (motion.load_point, motion.slip, motion.velocity))
    rows = np.stack([motion.time, moved, motion.friction, slip, velocity], axis=1)
    formats = ["%.12g", "%.10g", "%.10g", "%.10g", "%.6g"]
    out = io.StringIO()
    np.savetxt(out, rows, formats, ",", header="\n".join(lines), comments="")
    return out.getvalue()


def _why(result: RESULTS) -> str:
    if bool(result == RESULTS.max_steps_reached):
        return f"{MAX_STEPS} solver steps were not enough; give a shorter --duration"
    return " ".join(RESULTS[result].split())


def _cycle(course: Course, length: str) -> str:
    cycle = course.cycle
    if cycle is None:
        return ""
    amplitude = format_si(cycle.slip_amplitude, course.motion.unit("m"), length, 5)
    speeds = _speeds(cycle.least_velocity, cycle.largest_velocity, length)
    return say("end.cycle", period=cycle.period, amplitude=amplitude, speeds=speeds)


def _speeds(slowest: float, fastest: float, length: str) -> str:
    size = 1.0 if length == "rad" else factor(length, "m", "length")
    return f"velocity {slowest / size:.4g} to {fastest / size:.4g} {length}/s"
