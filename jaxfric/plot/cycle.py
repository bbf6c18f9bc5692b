"""Figures of a simulated motion: in time, and in the plane of friction and velocity."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..coordinate import Coordinate, unit_of
from ..motion import PiecewiseVelocity
from ..rig import Inertial, Rig
from ..simulation import Trajectory
from ..stability.analysis import Law, steady_points
from . import style
from .palette import BLACK, BLUE, GREY, ORANGE
from .stability import law_name, mass_text
from .ticks import plain_log

_STUCK = 1e-4
"""Velocities this much below the command count as stuck, and are drawn no lower."""
_CURVE = 300


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """A simulated motion as arrays over time, SI; what is drawn and written."""

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
    """Whether the numbers are of a line, in m and N, or of a rotation, in rad and N m."""

    def unit(self, si_unit: str) -> str:
        """The unit here of a quantity that has `si_unit` on a line."""
        return unit_of(si_unit, self.coordinate)

    @staticmethod
    def of(found: Trajectory, rig: Rig, motion: PiecewiseVelocity, rows: np.ndarray) -> "Motion":
        """The motion at some rows of a trajectory under velocity steps that begin at time 0."""
        columns = (found.time, found.recorded, found.slip, found.velocity)
        time, friction, slip, velocity = (np.asarray(x)[rows] for x in columns)
        starts, steps = np.asarray(motion.times), np.asarray(motion.velocities)
        at = np.maximum(np.searchsorted(starts, time, side="right") - 1, 0)
        travelled = np.append(0.0, np.cumsum(np.diff(starts) * steps[:-1]))
        load = travelled[at] + (time - starts[at]) * steps[at]
        machine = rig.machine
        mass = float(machine.mass) if isinstance(machine, Inertial) else None
        damping = 0.0 if machine.damping is None else float(machine.damping)
        gains = mass, float(machine.stiffness), damping
        return Motion(rig.friction, *gains, steps[at], time, load, friction, slip, velocity)


def _series_figure(motion: Motion) -> Figure:
    figure, axes = style.panels([1.4, 1.4, 1.1])
    t_size, t_unit = style.prefixed(min(float(motion.time[-1]), 1.0), "s")
    velocity, slow = _drawn(motion), _slowest(motion)
    for axis, name, si, values, command in (
        (axes[0], "friction", "N", motion.friction, None),
        (axes[1], "velocity", "m/s", velocity, motion.command),
        (axes[2], "displacement", "m", motion.slip, motion.load_point),
    ):
        largest = style.most(values if command is None else command)
        size, unit = style.prefixed(largest, motion.unit(si))
        axis.plot(t_size * motion.time, size * values, color=BLUE, lw=1.1, label="slider")
        if command is not None:
            x, y = t_size * motion.time, size * command
            axis.plot(x, y, color=ORANGE, lw=1.1, ls="--", label="load point")
        if name == "velocity":
            _velocity_scale(axis, "y", size * values, size * slow)
        style.tidy(axis, _stuck_note(motion) if name == "velocity" else "", y=f"{name} [{unit}]")
    style.tidy(axes[2], x=f"time [{t_unit}]")
    return style.finish(figure, _heading(motion))


def _plane_figure(motion: Motion) -> Figure:
    """Friction against velocity, with the steady curve behind."""
    drawn, slow, friction = _drawn(motion), _slowest(motion), motion.friction
    f_size, f_unit = style.prefixed(style.most(friction), motion.unit("N"))
    v_size, v_unit = style.prefixed(style.most(motion.command), motion.unit("m/s"))
    figure, (axis,) = style.panels([3.45])
    low, high = _velocity_limits(drawn, slow)
    V = np.geomspace(low if low > 0 else 0.03 * slow, high, _CURVE)
    force = np.asarray(steady_points(motion.law, V).force)
    force = np.where(force > 0, force, np.nan)
    axis.plot(v_size * V, f_size * force, color=GREY, lw=3, alpha=0.6, label="steady friction")
    half = motion.time > 0.5 * motion.time[-1]
    for part, width, alpha, label in (
        (half | ~half, 0.8, 0.45, "motion: first half"),
        (half, 1.5, 1.0, "second half"),
    ):
        x, y = v_size * drawn[part], f_size * friction[part]
        axis.plot(x, y, color=BLUE, lw=width, alpha=alpha, label=label)
    commands = np.unique(motion.command[motion.command > 0])
    steady = np.asarray(steady_points(motion.law, commands).force)
    words = "steady sliding at the command"
    style.mark(axis, v_size * commands, f_size * steady, "o", words, ORANGE)
    _arrow(axis, v_size * drawn, f_size * friction)
    _velocity_scale(axis, "x", v_size * drawn, v_size * slow)
    least, top = f_size * friction.min(), f_size * friction.max()
    room = max(0.12 * (top - least), 1e-9 * abs(top))
    axis.set_ylim(least - room, top + 2 * room)
    axis.set_xlim(v_size * low, v_size * high)
    x, y = f"velocity of the slider [{v_unit}]", f"friction [{f_unit}]"
    style.tidy(axis, _stuck_note(motion), x=x, y=y)
    return style.finish(figure, _heading(motion))


def _velocity_limits(drawn: np.ndarray, slow: float) -> tuple[float, float]:
    """Limits of the velocity drawn, with some room: relative where the axis is logarithmic."""
    least, most = float(drawn.min()), float(drawn.max())
    if least > 0 and most > 5 * least:
        return least / 1.6, most * 1.6
    room = 0.3 * (most - least) + 1e-6 * slow
    return (2 * least if least < 0 else least - room), most + room


def _arrow(axis: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """An arrow in the sense of the motion, where friction changes fast late in it."""
    late = np.arange(len(x) // 2, len(x) - 1)
    span = np.ptp(y[late]) if len(late) else 0.0
    if span <= 0.01 * np.ptp(y):
        return
    middle = 0.5 * (np.max(y[late]) + np.min(y[late]))
    crossing = late[(y[late] < middle) != (y[late + 1] < middle)]
    head = dict(arrowstyle="-|>", color=BLACK, mutation_scale=12)
    for at in crossing[-2:]:
        axis.annotate("", (x[at + 1], y[at + 1]), (x[at], y[at]), arrowprops=head)


def _slowest(motion: Motion) -> float:
    """The slowest commanded speed that is not zero."""
    return float(np.abs(motion.command[motion.command != 0]).min())


def _backward(motion: Motion) -> bool:
    """Whether the slider really moves backwards."""
    return bool(np.min(motion.velocity) < -0.01 * _slowest(motion))


def _drawn(motion: Motion) -> np.ndarray:
    """Velocities no lower than what counts as stuck, unless the slider moves backwards."""
    if _backward(motion):
        return motion.velocity
    return np.maximum(motion.velocity, _STUCK * _slowest(motion))


def _stuck_note(motion: Motion) -> str:
    if _backward(motion) or np.min(motion.velocity) >= _STUCK * _slowest(motion):
        return ""
    return f"Stuck: drawn at {_STUCK:g} of the command"


def _velocity_scale(axis: Axes, which: str, values: np.ndarray, slow: float) -> None:
    """Set a scale: linear for small changes, logarithmic for large ones, symmetric about 0."""
    if np.min(values) <= 0:
        if np.ptp(values) > 30 * slow:
            scale = axis.set_yscale if which == "y" else axis.set_xscale
            scale("symlog", linthresh=slow)
    elif np.max(values) > 5 * np.min(values):
        plain_log(axis, which)


def _heading(motion: Motion) -> str:
    gains = f"k_p = {style.told(motion.k_p, motion.unit('N/m'))}, k_v = {motion.k_v:g}"
    mass = mass_text(motion.mass, motion.coordinate)
    return f"{law_name(motion.law)}, {gains} {motion.unit('N s/m')}, {mass}"


DRAWERS: dict[str, Callable[[Motion, Path], list[str]]] = style.drawers(
    {"motion": _series_figure, "phase_plane": _plane_figure}
)
"""Functions that each write a figure of a simulation to a folder and return names written."""
