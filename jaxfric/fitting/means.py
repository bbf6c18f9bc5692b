"""Means of a record over intervals that grow with the time since the last velocity step."""

from typing import NamedTuple

import numpy as np

from ..records import VelocitySteps
from .thresholds import INTERVALS


class Averaged(NamedTuple):
    """Means over intervals: end [s], mean time [s], friction, number of rows."""

    end: np.ndarray
    time: np.ndarray
    friction: np.ndarray
    rows: np.ndarray


def average(
    t: np.ndarray, f: np.ndarray, steps: VelocitySteps, *, intervals: int = INTERVALS
) -> Averaged:
    """Average a record over intervals that begin at every velocity step and grow geometrically."""
    edges = [np.zeros(1)]
    times = steps.times[steps.times < t[-1]]
    per_segment = max(16, intervals // len(times))
    for start, end in zip(times, np.append(times[1:], t[-1]), strict=True):
        rows = np.count_nonzero((t >= start) & (t < end))
        first = (end - start) * min(2.0 / max(rows, 1), 0.25)
        growth = 1.0 + 4.0 / per_segment
        n = int(np.ceil(np.log1p((growth - 1) * (end - start) / first) / np.log(growth)))
        widths = first * growth ** np.arange(max(n, 1))
        edges.append(start + (end - start) * np.cumsum(widths) / widths.sum())
    edge = np.unique(np.concatenate(edges))
    edge[-1] = np.nextafter(max(edge[-1], t[-1]), np.inf)
    which = np.clip(np.searchsorted(edge, t, side="right") - 1, 0, len(edge) - 2)
    count = np.bincount(which, minlength=len(edge) - 1)
    safe = np.maximum(count, 1)
    mean_t = np.bincount(which, t, minlength=len(edge) - 1) / safe
    mean_f = np.bincount(which, f, minlength=len(edge) - 1) / safe
    return Averaged(edge[1:], np.where(count > 0, mean_t, edge[1:]), mean_f, count.astype(float))
