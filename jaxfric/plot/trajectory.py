"""The figure of a trajectory: friction, velocity and slip over time."""

import numpy as np
from matplotlib.figure import Figure

from ..simulation.trajectory import RESULTS, Trajectory, result_words
from . import style
from .palette import BLUE

_MOST = 50
"""Members of a batch that are drawn."""


def trajectory_figure(found: Trajectory) -> Figure:
    """Figure of a trajectory; for a batch the first members are drawn over each other."""
    figure, axes = style.panels([1.4, 1.4, 1.4])
    members = int(np.prod(np.shape(found.end)))
    times = np.broadcast_to(np.asarray(found.time, float), np.shape(found.force))
    times = times.reshape(members, -1)[:_MOST]
    named = (("force", "friction", ""), ("velocity", "velocity", "m/s"), ("slip", "slip", "m"))
    for axis, (name, label, si) in zip(axes, named, strict=True):
        values = np.asarray(getattr(found, name), float).reshape(members, -1)[:_MOST]
        alpha = 1.0 if members == 1 else 0.5
        axis.plot(times.T, values.T, color=BLUE, lw=1.0, alpha=alpha)
        style.tidy(axis, y=(label, si) if si else "friction [F]")
    style.tidy(axes[-1], x=("time", "s"))
    drawn = f"the first {_MOST} of {members}" if members > _MOST else f"{members}"
    title = f"{drawn} simulated motions" if members > 1 else "Simulated motion"
    if members == 1 and found.result != RESULTS.successful:
        title += f"; {result_words(found.result)} at {float(found.end):.4g} s"
    return style.finish(figure, f"{title} (F: the unit of friction, N or 1)")
