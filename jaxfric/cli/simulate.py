"""`jaxfric simulate`: the nonlinear motion of a slider in time, with pictures."""

import dataclasses
import re
from typing import TYPE_CHECKING, Annotated

from ..coordinate import Coordinate
from ..errors import InputError
from . import options
from .call import made_by
from .common import OfMotion, prepare_jax
from .folder import json_text
from .told import doing

if TYPE_CHECKING:
    from ..motion import PiecewiseVelocity


@options.FLAT
@dataclasses.dataclass(frozen=True)
class MotionOptions:
    """Options: start and duration of a motion."""

    duration: options.Text = None
    """Simulated time, '20 s'. By default until the end state is recognised."""
    at_rest: bool = False
    """Start at rest with an unloaded spring (stick)."""
    jump: options.Text = None
    """Jump of the load point at the start, '1 um', of either sign. At a constant velocity the
    default is a small jump: without this jump nothing would disturb steady sliding."""


def simulate(
    *,
    law: options.LawOptions = options.LawOptions(),
    velocity: Annotated[str | None, options.VELOCITY] = None,
    steps: options.Steps = None,
    kp: Annotated[str, options.GAIN],
    kv: options.Damping = None,
    mass: options.Mass = None,
    how: MotionOptions = MotionOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Simulate a slider: stick-slip or steady sliding, from rest or from a disturbance.

    The command writes trajectory.csv, which 'jaxfric inspect' and 'jaxfric fit' read, and figures
    to the output folder, by default ./NAME-simulate/. NAME is the name of the law, or of the folder
    of the fit. Options that differ from their default are part of the folder's name.
    """
    if (velocity is None) == (steps is None):
        raise InputError("give one of --velocity '2 um/s' and --steps '0 s: 1 um/s, 10 s: 10 um/s'")
    if how.jump is not None and how.at_rest:
        raise InputError("--jump and --at-rest exclude each other; give one")
    prepare_jax()
    from ..gains.course import course_of, rig_of
    from ..report.course_text import content, report, trajectory_text

    source = law.source()
    given = OfMotion(source.coordinate, how, velocity=velocity, kp=kp, kv=kv, mass=mass)
    command = _command(given, steps)
    k_p = given.one("--kp")
    assert k_p is not None
    k_v, own = given.damping("--kv"), given.one("--mass")
    duration, jump = given.one("--duration"), given.read("--jump")
    unseen = source.unseen(command.velocities.tolist())
    folder = law.folder(output)
    one_mass = source.mass if own is None else own
    rig, width = rig_of(source.law, one_mass, k_p, k_v, command.velocities.tolist())
    course = course_of(
        rig,
        command,
        duration=duration,
        at_rest=how.at_rest,
        jump=jump,
        coordinate=given.coordinate,
        progress=doing,
    )
    from ..plot.cycle import FIGURES

    shown = _length_shown(velocity or steps or "", given.coordinate)
    told_of = report(course, source.text, width, shown)._replace(warnings=unseen)
    warned = [f"warning: {line}" for line in (*source.warnings, *unseen)]
    notes = [*told_of.headline, *told_of.notes, *warned]
    folder.save({"trajectory.csv": trajectory_text(course.motion, made_by(), notes)})
    for name, figure in FIGURES.items():
        folder.draw_figure(name, lambda figure=figure: figure(course.motion))
    folder.content = json_text(content(course, source.text, width, folder.paths))
    return folder.finish(told_of)


def _command(given: OfMotion, steps: str | None) -> "PiecewiseVelocity":
    """The commanded velocities, from time 0 on."""
    import numpy as np

    from ..motion import PiecewiseVelocity
    from ..records import VelocitySteps

    if steps is None:
        return PiecewiseVelocity(np.zeros(1), np.asarray([given.one("--velocity")]))
    if given.coordinate == "rotary":
        raise InputError("--steps are in m/s; of a joint give one --velocity, as in '2 rad/s'")
    found = VelocitySteps.parse(steps)
    if not found.velocities[0] != 0:
        raise InputError("--steps: the first velocity is 0; steady sliding needs another")
    return PiecewiseVelocity(found.times, found.velocities)


def _length_shown(command: str, coordinate: Coordinate) -> str:
    """The unit of length of the commanded velocity, in which slip is told, else um; rad."""
    if coordinate == "rotary":
        return "rad"
    found = re.search(r"([nuµμmc]?m|microns?)\s*/\s*s", command)
    return found[1].replace("µ", "u").replace("μ", "u") if found else "um"
