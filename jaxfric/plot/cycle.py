"""Figures of a simulated motion: over time, and in the plane of friction and velocity."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..gains.course import Motion
from ..stability.analysis import steady_points
from . import style
from .palette import BLACK, BLUE, GREY, ORANGE
from .stability import gains_text, law_name
from .ticks import whole_numbers

_STUCK = 1e-4
"""Velocities this much below the command count as stuck, and are not drawn."""
_CURVE, _HEAD = 300, 8


def _series_figure(motion: Motion) -> Figure:
    figure, axes = style.panels([1.4, 1.4, 1.1])
    for axis, name, si, values, command in (
        (axes[0], "friction", "N", motion.friction, None),
        (axes[1], "velocity", "m/s", motion.velocity, motion.command),
        (axes[2], "displacement", "m", motion.slip, motion.load_point),
    ):
        axis.plot(motion.time, values, color=BLUE, lw=1.1, label="slider")
        if command is not None:
            axis.plot(motion.time, command, color=ORANGE, lw=1.1, ls="--", label="load point")
        if name == "velocity":
            _set_scale(axis, "y", motion)
        style.tidy(axis, y=(name, motion.unit(si)))
    style.tidy(axes[2], x="time [s]")
    return style.finish(figure, _heading(motion))


def _plane_figure(motion: Motion) -> Figure:
    """Friction against velocity, with the steady curve behind."""
    figure, (axis,) = style.panels([3.45])
    x, y = motion.velocity, motion.friction
    half = motion.time > 0.5 * motion.time[-1]
    axis.plot(x, y, color=BLUE, lw=0.8, alpha=0.45, label="motion: first half")
    axis.plot(x[half], y[half], color=BLUE, lw=1.5, label="second half")
    _arrow(axis, x, y)
    axis.margins(x=0.06)
    slow = _set_scale(axis, "x", motion)
    seen = y[x >= axis.get_xlim()[0]]
    room = 0.12 * np.ptp(seen) + 1e-9 * style.most(seen)
    axis.set_ylim(seen.min() - room, seen.max() + room)
    limits = axis.axis()  # the steady curve may leave the panel
    V = np.geomspace(max(limits[0], 0.03 * slow), limits[1], _CURVE)
    force = np.asarray(steady_points(motion.law, V).force)
    force = np.where(force > 0, force, np.nan)
    axis.plot(V, force, color=GREY, lw=3, alpha=0.6, label="steady friction", zorder=1.5)
    commands = np.unique(motion.command[motion.command > 0])
    steady = np.asarray(steady_points(motion.law, commands).force)
    words = "steady sliding at the command"
    style.mark(axis, commands, steady, "o", words, ORANGE)
    axis.axis(limits)
    x, y = ("velocity of the slider", motion.unit("m/s")), ("friction", motion.unit("N"))
    style.tidy(axis, x=x, y=y)
    return style.finish(figure, _heading(motion))


def _set_scale(axis: Axes, which: str, motion: Motion) -> float:
    """Make the axis of a velocity that changes much logarithmic; it ends where the slider is stuck.

    Returns the slowest commanded speed that is not zero.
    """
    low, high = float(motion.velocity.min()), float(motion.velocity.max())
    slow = float(np.abs(motion.command[motion.command != 0]).min())
    set_scale = axis.set_yscale if which == "y" else axis.set_xscale
    if low >= -0.01 * slow and high > 5 * low:
        set_scale("log")
        axis.set(**{f"{which}lim": (max(0.7 * low, _STUCK * slow), 2 * max(high, slow))})
    elif high - low > 30 * slow:
        set_scale("symlog", linthresh=slow)
    else:
        whole_numbers(axis, which, least=1e-3)
    return slow


def _arrow(axis: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """An arrow in the sense of the motion, where friction changes fastest."""
    at = max(int(np.argmax(np.abs(np.diff(y)))), _HEAD)  # a head has the direction of _HEAD rows
    head = dict(arrowstyle="-|>", color=BLACK, mutation_scale=18, lw=0)
    axis.annotate("", (x[at + 1], y[at + 1]), (x[at - _HEAD], y[at - _HEAD]), arrowprops=head)


def _heading(motion: Motion) -> str:
    stiffness = style.told(motion.k_p, motion.unit("N/m"))
    return f"{law_name(motion.law)}, k_p = {stiffness}, {gains_text(motion)}"


FIGURES = {"motion": _series_figure, "phase_plane": _plane_figure}
"""Functions that make the figures of a simulated motion, by the name of the file."""
