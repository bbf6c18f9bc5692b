"""Finds the joints of a broken line, its slopes, and the standard errors of both."""

from dataclasses import dataclass

import numpy as np

from .lines import Lines, Sums
from .segments import find_lines, settle

_LOCAL_HEIGHT = 20.0
"""The time of a joint rests on the rows near it: as many as lift it by this many scatters."""


@dataclass(frozen=True, eq=False)
class BrokenLine:
    """A continuous broken line: times of its joints [s], slopes [m/s], standard errors.

    `scatter` is the standard deviation about every line [m], `lengths` how long each is [s].
    """

    joints: np.ndarray
    slopes: np.ndarray
    joint_errors: np.ndarray
    slope_errors: np.ndarray
    scatter: np.ndarray
    lengths: np.ndarray


def fit_broken_line(t: np.ndarray, y: np.ndarray, least_change: float) -> BrokenLine:
    """The broken line through y(t) with as many joints as the data support.

    **Arguments:** as `find_lines`. Standard errors are widened for the correlation of the
    residual; they hold for a load point that is at constant velocity between the joints.
    """
    return broken_line(*find_lines(t, y, least_change))


def broken_line(sums: Sums, rows: np.ndarray) -> BrokenLine:
    """The broken line whose lines begin at given `rows`, the number of rows last."""
    lines = sums.lines(rows[:-1], rows[1:])
    parts = sums.residual(rows)
    widening = np.array([_correlation_factor(part) for part in parts])
    white = np.array([_white_variance(part) for part in parts])
    joints, joint_errors = np.zeros(len(rows) - 2), np.zeros(len(rows) - 2)
    for j in range(len(joints)):
        local = _near(sums, rows[j : j + 3])
        joints[j], joint_errors[j] = _joint(sums, local, widening[j : j + 2], white[j : j + 2])
    variance = lines.sum_squares / np.maximum(lines.count - 2, 1)
    edges = np.concatenate([sums.t[:1], joints, sums.t[-1:]])
    return BrokenLine(
        joints=joints,
        slopes=lines.slope + sums.trend,
        joint_errors=joint_errors,
        slope_errors=np.sqrt(variance * widening / lines.spread),
        scatter=np.sqrt(variance),
        lengths=np.diff(edges),
    )


def _near(sums: Sums, rows: np.ndarray) -> np.ndarray:
    """Rows (first, joint, end) around a joint that its time is to rest on.

    Far rows would make it more precise, were the load point exact; but a jump of the
    recorder or a drift far away would then move the joint. The reach shrinks in stages, each
    around the joint and with the scatter of the stage before.
    """
    t, here = sums.t, int(rows[1])
    reach, local = float(t[rows[2] - 1] - t[rows[0]]), rows
    for _ in range(20):
        low = max(min(int(np.searchsorted(t, t[here] - reach)), here - 20), int(rows[0]))
        high = min(max(int(np.searchsorted(t, t[here] + reach)), here + 20), int(rows[2]))
        local = settle(sums, np.array([low, here, high]), 10)
        two = sums.lines(local[:-1], local[1:])
        scatter = float(np.sqrt((two.sum_squares / np.maximum(two.count - 2, 1)).max()))
        change = max(abs(float(two.slope[1] - two.slope[0])), 1e-300)
        enough = 2 * _LOCAL_HEIGHT * scatter / change
        if reach <= enough or high - low <= 40:
            break
        here, reach = int(local[1]), max(reach / 3, enough)
    return local


def _joint(
    sums: Sums, rows: np.ndarray, widening: np.ndarray, white: np.ndarray
) -> tuple[float, float]:
    """Time at which two lines meet, with its standard error; else the row between them.

    The scatter of the few rows near the joint is itself known to a sixth; it counts as no smaller
    than `white`, the variance of white noise of the whole lines.
    """
    two: Lines = sums.lines(rows[:-1], rows[1:])
    between = float(sums.t[rows[1]])
    joint = float(two.meet()[0])
    near = sums.t[min(rows[1] + 3, rows[2] - 1)] - sums.t[max(rows[1] - 3, rows[0])]
    if not abs(joint - between) <= near:
        joint = between
    variance = widening * np.maximum(two.sum_squares / np.maximum(two.count - 2, 1), white)
    at_joint = variance / two.count + variance / two.spread * (joint - two.mean_time) ** 2
    change = max(abs(float(two.slope[1] - two.slope[0])), 1e-300)
    return joint, float(np.sqrt(at_joint.sum())) / change


def _white_variance(rest: np.ndarray) -> float:
    """Variance of the white part of a residual, from differences of neighbours: blind to drift and,
    by their median, to single jumps."""
    if len(rest) < 20:
        return 0.0
    return float(0.5 * (1.4826 * np.median(np.abs(np.diff(rest)))) ** 2)


def _correlation_factor(rest: np.ndarray) -> float:
    """Rows that count as one independent row, from the variance of batch means."""
    if len(rest) < 40:
        return 2.0
    batch = len(rest) // 20
    means = rest[: 20 * batch].reshape(20, batch).mean(axis=1)
    variance = float(rest.var())
    return max(1.0, float(means.var()) * batch / variance) if variance > 0 else 1.0
