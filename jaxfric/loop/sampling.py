"""Adds times between the rows at which the sensor of a loop's problem samples friction.

The simulated sensor interpolates friction linearly between times, and a lag shorter than the row
interval needs the slope of friction at the row. After a velocity step friction bends within the
slip A/K, which the slider may cross within one row interval. Without intermediate times the loop
took a lag of the sensor for a lag of the drive. A lag of the drive is simulated exactly, as part of
the motion.
"""

import dataclasses

import jax
import numpy as np

from ..fitting.problem import Problem
from .thresholds import BETWEEN, COARSE_SHARE, MOST_COARSE


def seen_between(
    problem: Problem, bend: float, length: float, number: int | None = None
) -> Problem:
    """A copy of the problem whose sensor also samples friction before the coarsest rows.

    `bend` and `length` [m] are A/K and L. Of the rows soon after a velocity step, the coarsest are
    the `number` rows with the most slip since the previous row. The default of `number` depends on
    the problem's size only.
    """
    time = np.asarray(problem.time)
    back = np.diff(time, prepend=time[0])
    jumps, speeds = np.asarray(problem.motion.times), np.abs(problem.motion.velocities)
    step = np.clip(np.searchsorted(jumps, time, side="right") - 1, 0, None)
    since = speeds[step] * (time - jumps[step])
    coarse = speeds[step] * back * np.exp(-0.5 * np.maximum(since, 0.0) / (bend + length))
    chosen = np.argsort(-np.where(step > 0, coarse, 0.0), kind="stable")
    chosen = chosen[: min(int(COARSE_SHARE * len(time)), MOST_COARSE) if number is None else number]
    between = (time[chosen, None] - back[chosen, None] * np.asarray(BETWEEN)).ravel()
    times = np.concatenate([time, between])
    order = np.argsort(times, kind="stable")
    rows = np.argsort(order)[: len(time)]
    return dataclasses.replace(problem, seen=jax.device_put((times[order], rows)))
