"""The used rows of a prepared record, and the scales of its motion."""

import numpy as np

from ...effects import RecordScales
from ...errors import InputError
from ...fitting.axis_preparation import Prepared
from ..split import Blocks
from .result import AxisRows
from .split import segments

_WIDTH_IN_NOISE = 2.0  # standard deviations of the velocity noise
_WIDTH_SHARE = 1e-3  # of the largest speed
_STUCK = 0.05  # [s] shortest stop


def rows_of(
    prepared: Prepared, width: float | None, *, unit: str = "m", share: float = 1.0
) -> AxisRows:
    """The decimated rows of a record, the mask of used rows, and the motion segments.

    `unit` is the unit of the position, for messages. A default width of the smoothed sign is
    multiplied by the factor `share`.
    """
    n, motion = prepared.rows, prepared.motion
    velocity, position, path = (
        np.asarray(prepared.means(x))[:n] for x in (motion.velocity, motion.position, motion.path)
    )
    fastest = float(np.max(np.abs(velocity)))
    if width is None:
        width = max(share * _WIDTH_IN_NOISE * prepared.velocity_noise, _WIDTH_SHARE * fastest)
    elif not 0 < width < fastest:
        raise InputError(
            f"width {width:g} {unit}/s: the axis moves at up to {fastest:g} {unit}/s; choose less"
        )
    every = prepared.means.every
    samples = np.asarray(motion.velocity).reshape(-1, every)[:n]
    slow = np.min(np.abs(samples), axis=1) < 2 * width
    slow |= np.ptp(np.sign(samples), axis=1) > 0
    # a quick turn may fall between two rows
    slow[1:] |= np.sign(samples[1:, 0]) != np.sign(samples[:-1, -1])
    step = float(prepared.time[1] - prepared.time[0])
    return AxisRows(
        time=prepared.time[:n],
        position=position,
        velocity=velocity,
        path=path,
        used=prepared.inside[:n] & ~_widened(slow),
        stuck=_long(slow, max(2, round(_STUCK / step))),
        segment=segments(slow),
        width=width,
    )


def _widened(slow: np.ndarray) -> np.ndarray:
    """The slow rows and their neighbours, which the filter of the position affects."""
    wide = slow.copy()
    wide[1:] |= slow[:-1]
    wide[:-1] |= slow[1:]
    return wide


def _long(slow: np.ndarray, rows: int) -> np.ndarray:
    """Mask of the slow rows in runs of at least `rows`."""
    long = np.zeros(len(slow), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], slow.astype(int), [0]])))
    for begin, end in edges.reshape(-1, 2):
        long[begin:end] = end - begin >= rows
    return long


def scales_of(rows: AxisRows, prepared: Prepared, blocks: Blocks) -> RecordScales:
    """Lengths, velocities and times of the train rows, as starting values of effects' shapes."""
    speed = np.abs(rows.velocity[blocks.train])
    moving = speed[speed > 2 * rows.width]
    interval = float(prepared.time[1] - prepared.time[0])
    # twice the distance between two rows at the median speed, within the filter's pass band
    resolved = 2.5 * float(np.median(moving)) * interval
    return RecordScales(
        slip_length=float("nan"),
        step_slip=resolved,
        total_slip=float(np.ptp(rows.position)),
        slowest=float(np.quantile(moving, 0.02)),
        fastest=float(moving.max()),
        interval=interval,
        duration=float(rows.time[-1]),
    )
