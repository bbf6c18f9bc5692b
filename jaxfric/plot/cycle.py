"""Figures of a simulated motion: in time, and in the plane of friction and velocity."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from ..coordinate import Coordinate, unit_of
from ..motion import PiecewiseVelocity
from ..rig import Inertial, Rig
from ..simulation import Trajectory
from ..stability.analysis import Law, steady_points
from .palette import BLACK, BLUE, GREY, ORANGE
from .stability import law_name, legend_below, mass_text, new_figure, prefixed, save, tidy
from .ticks import plain_log

# Velocities this much below the command count as stuck, and are drawn no lower.
_STUCK = 1e-4
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


def _save_series(motion: Motion, folder: Path) -> list[str]:
    t_size, t_unit = prefixed(min(float(motion.time[-1]), 1.0), "s")
    f_size, f_unit = prefixed(float(np.max(np.abs(motion.friction))), motion.unit("N"))
    v_size, v_unit = prefixed(float(np.max(np.abs(motion.command))), motion.unit("m/s"))
    far = max(np.max(np.abs(motion.slip)), np.max(np.abs(motion.load_point)))
    x_size, x_unit = prefixed(float(far), motion.unit("m"))
    figure = new_figure(9.0, 7.2)
    axes = figure.subplots(3, 1, sharex=True, height_ratios=[1.3, 1.3, 1])
    time = t_size * motion.time
    axes[0].plot(time, f_size * motion.friction, color=BLUE, lw=1.3)
    axes[0].set_ylabel(f"friction [{f_unit}]")
    axes[1].plot(time, v_size * _drawn(motion), color=BLUE, lw=1.3, label="slider")
    axes[1].plot(time, v_size * motion.command, color=ORANGE, lw=1.4, ls="--", label="command")
    _velocity_scale(axes[1], "y", v_size * _drawn(motion), v_size * _slowest(motion))
    axes[1].set_ylabel(f"velocity [{v_unit}]")
    axes[1].legend(loc="lower right", bbox_to_anchor=(1, 1), ncol=2, frameon=False, fontsize=8.5)
    axes[2].plot(time, x_size * motion.slip, color=BLUE, lw=1.5, label="slip")
    axes[2].plot(
        time, x_size * motion.load_point, color=ORANGE, lw=1.3, ls="--", label="load point"
    )
    axes[2].set_ylabel(f"displacement [{x_unit}]")
    axes[2].legend(loc="lower right", bbox_to_anchor=(1, 1), ncol=2, frameon=False, fontsize=8.5)
    axes[2].set_xlabel(f"time [{t_unit}]")
    note = _stuck_note(motion)
    tidy(axes[0], "Friction force on the slider")
    tidy(axes[1], f"Velocity{note}")
    tidy(axes[2], "Slip of the slider and path of the load point")
    for axis in axes:
        axis.margins(x=0.01)
    figure.align_ylabels(list(axes))
    figure.suptitle(_heading(motion), x=0.01, ha="left", fontsize=11)
    return save(figure, folder, "motion")


def _save_plane(motion: Motion, folder: Path) -> list[str]:
    """Friction against velocity, with the steady curve behind."""
    drawn, slow = _drawn(motion), _slowest(motion)
    f_size, f_unit = prefixed(float(np.max(np.abs(motion.friction))), motion.unit("N"))
    v_size, v_unit = prefixed(float(np.max(np.abs(motion.command))), motion.unit("m/s"))
    figure = new_figure(7.6, 5.6)
    axis = figure.subplots()
    low, high = _velocity_limits(motion, drawn, slow)
    V = np.geomspace(low if low > 0 else 0.03 * slow, high, _CURVE)
    force = np.asarray(steady_points(motion.law, V).force)
    seen = force > 0
    axis.plot(v_size * V[seen], f_size * force[seen], color=GREY, lw=4, alpha=0.6,
              label="steady friction")  # fmt: skip
    half = motion.time > 0.5 * motion.time[-1]
    axis.plot(v_size * drawn, f_size * motion.friction, color=BLUE, lw=0.8, alpha=0.45,
              label="motion: first half")  # fmt: skip
    axis.plot(v_size * drawn[half], f_size * motion.friction[half], color=BLUE, lw=1.8,
              label="second half")  # fmt: skip
    for V0 in np.unique(motion.command[motion.command > 0]):
        f0 = float(np.asarray(steady_points(motion.law, np.asarray([V0])).force)[0])
        label = "steady sliding at the command" if motion.command[-1] == V0 else None
        axis.plot(v_size * V0, f_size * f0, "o", color=ORANGE, ms=8, zorder=5, label=label)
    _arrow(axis, v_size * drawn, f_size * motion.friction)
    _velocity_scale(axis, "x", v_size * drawn, v_size * slow)
    spread = [f_size * motion.friction.min(), f_size * motion.friction.max()]
    room = max(0.12 * (spread[1] - spread[0]), 1e-9 * abs(spread[1]))
    axis.set_ylim(spread[0] - room, spread[1] + 2 * room)
    axis.set_xlim(v_size * low, v_size * high)
    axis.set_xlabel(f"velocity of the slider [{v_unit}]{_stuck_note(motion)}")
    axis.set_ylabel(f"friction [{f_unit}]")
    tidy(axis, "Phase plane: friction against velocity")
    legend_below(axis, columns=4)
    figure.suptitle(_heading(motion), x=0.01, ha="left", fontsize=10)
    return save(figure, folder, "phase_plane")


def _velocity_limits(motion: Motion, drawn: np.ndarray, slow: float) -> tuple[float, float]:
    """Limits of the velocity drawn, with some room: relative where the axis is logarithmic."""
    least, most = float(drawn.min()), float(drawn.max())
    if least > 0 and most > 5 * least:
        return least / 1.6, most * 1.6
    room = 0.3 * (most - least) + 1e-6 * slow
    return (2 * least if least < 0 else least - room), most + room


def _arrow(axis: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """An arrow that tells the sense of the motion, where friction changes fast late in it."""
    late = np.arange(len(x) // 2, len(x) - 1)
    span = np.ptp(y[late]) if len(late) else 0.0
    if span <= 0.01 * np.ptp(y):
        return
    middle = 0.5 * (np.max(y[late]) + np.min(y[late]))
    crossing = late[(y[late] < middle) != (y[late + 1] < middle)]
    for at in crossing[-2:]:
        axis.annotate(
            "",
            xy=(x[at + 1], y[at + 1]),
            xytext=(x[at], y[at]),
            arrowprops=dict(arrowstyle="-|>", color=BLACK, mutation_scale=16),
        )


def _slowest(motion: Motion) -> float:
    """The slowest commanded speed that is not zero."""
    speeds = np.abs(motion.command[motion.command != 0])
    return float(speeds.min())


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
    return f"   (stuck: drawn at {_STUCK:g} of the command)"


def _velocity_scale(axis: Axes, which: str, values: np.ndarray, slow: float) -> None:
    """Set a scale: linear for small changes, logarithmic for large ones, symmetric about 0."""
    if np.min(values) <= 0:
        if np.ptp(values) > 30 * slow:
            scale = axis.set_yscale if which == "y" else axis.set_xscale
            scale("symlog", linthresh=slow)
    elif np.max(values) > 5 * np.min(values):
        plain_log(axis, which)


def _heading(motion: Motion) -> str:
    k_size, k_unit = prefixed(motion.k_p, motion.unit("N/m"))
    text = f"{law_name(motion.law)}, k_p = {k_size * motion.k_p:.4g} {k_unit}, "
    text += f"k_v = {motion.k_v:g} {motion.unit('N s/m')}, "
    return text + mass_text(motion.mass, motion.coordinate)


DRAWERS: dict[str, Callable[[Motion, Path], list[str]]] = {
    "motion": _save_series,
    "phase_plane": _save_plane,
}
"""Functions that each write a figure of a simulation to a folder and return names written."""
