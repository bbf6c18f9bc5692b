"""The figure of a trajectory: friction, velocity and slip over time."""

import numpy as np
from matplotlib.figure import Figure

from ..simulation.trajectory import RESULTS, Trajectory, result_words
from .palette import BLUE
from .stability import new_figure, prefixed, tidy

_MOST = 50
"""Members of a batch that are drawn."""


def trajectory_figure(found: Trajectory) -> Figure:
    """Figure of a trajectory; of a batch its first members, one over the other."""
    figure = new_figure(9.0, 7.2)
    axes = figure.subplots(3, 1, sharex=True)
    time = np.asarray(found.time)
    members = int(np.prod(np.shape(found.end)))
    times = np.broadcast_to(time, np.shape(found.force)).reshape(members, -1)[:_MOST]
    size, unit = prefixed(float(np.max(np.abs(times))), "s")
    panels = (("force", "friction", ""), ("velocity", "velocity", "m/s"), ("slip", "slip", "m"))
    for axis, (name, label, si) in zip(axes, panels, strict=True):
        values = np.asarray(getattr(found, name)).reshape(members, -1)[:_MOST]
        factor, shown = prefixed(float(np.max(np.abs(values))), si) if si else (1.0, "F")
        alpha = 1.0 if members == 1 else 0.5
        axis.plot(size * times.T, factor * values.T, color=BLUE, lw=1.2, alpha=alpha)
        axis.set_ylabel(f"{label} [{shown}]")
        axis.margins(x=0.01)
        tidy(axis, "")
    axes[-1].set_xlabel(f"time [{unit}]")
    figure.suptitle(_title(found, members), x=0.01, ha="left", fontsize=11)
    figure.align_ylabels(list(axes))
    return figure


def _title(found: Trajectory, members: int) -> str:
    unit = "F: the unit of friction, N or 1"
    if members > 1:
        drawn = f"the first {_MOST} of {members}" if members > _MOST else f"{members}"
        return f"{drawn} simulated motions ({unit})"
    ended = found.result == RESULTS.successful
    early = "" if ended else f"; {result_words(found.result)} at {float(found.end):.4g} s"
    return f"Simulated motion{early} ({unit})"
