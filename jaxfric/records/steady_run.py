"""One run at a steady speed: its steady rows, and their means."""

from dataclasses import dataclass

import numpy as np

from .axis_record import AxisRecord
from .record import MIN_ROWS
from .steady_mean import effective_samples

_BATCH = 5
"""Rows that are averaged before a start-up is looked for."""
_BLOCKS = 10
"""Parts of a run whose mean speeds are compared."""
_CHANGE = 0.1
"""The mean speed of a part differs from that of the run by less than this fraction."""
_BACKWARD = 0.25
"""A run that goes backward in more than this fraction of its rows has no direction."""
_UNEVEN = 0.25
"""A spread of the speed above this fraction of its mean is told."""


@dataclass(frozen=True)
class Run:
    """Means over the steady part of a run; or why there is none."""

    name: str
    speed: float = 0.0
    """Mean; of a run that is refused the root of the mean square."""
    speed_std: float = 0.0
    force: float = 0.0
    std: float = 0.0
    samples: int = 0
    effective: float = 1.0
    refused: str = ""
    note: str = ""
    uneven: bool = False
    """Whether it moved unevenly, or its speed is recorded too coarsely to tell."""


def steady_run(name: str, record: AxisRecord) -> Run:
    """Means of a run, or why it is none."""
    speed, from_position = record.velocity, False
    if record.position is not None and (speed is None or not np.any(speed)):
        speed, from_position = np.gradient(record.position, record.time), True
    if speed is None or not np.any(speed):
        return Run(name, refused="the axis stands still")
    size = float(np.sqrt(np.mean(speed**2)))
    start, stop = steady_rows(speed)
    if stop - start < MIN_ROWS:
        return Run(name, size, refused=_range(speed, record) + ", no steady part of 20 rows")
    part = speed[start:stop]
    mean, spread = float(part.mean()), float(part.std(ddof=1))
    if not _is_steady(part):
        return Run(name, size, refused=_range(speed, record))
    if abs(mean) <= 3 * spread / np.sqrt(effective_samples(part)):
        shown = shown_speed(mean, record)
        return Run(
            name, size, refused=f"the direction of its mean speed, {shown}, is not determined"
        )
    if np.mean(np.sign(part) == -np.sign(mean)) > _BACKWARD:
        return Run(name, size, refused=_range(speed, record) + ", it turns back again and again")
    force = record.motor_force[start:stop]
    if from_position and record.position is not None:
        time = record.relative_time[start:stop]
        mean = float(np.polyfit(time, record.position[start:stop], 1)[0])
    notes = []
    if stop - start < len(speed):
        notes.append(
            f"{start} rows of start-up and {len(speed) - stop} of stop are left out of {len(speed)}"
        )
    uneven = _unevenness(part, mean, record)
    notes += [uneven] if uneven else []
    return Run(
        name,
        speed=mean,
        speed_std=spread,
        force=float(force.mean()),
        std=float(force.std(ddof=1)),
        samples=len(force),
        effective=effective_samples(force),
        note="; ".join(notes),
        uneven=bool(uneven),
    )


def _unevenness(speed: np.ndarray, mean: float, record: AxisRecord) -> str:
    """How unevenly a run moves, or that steps of the recorder hide it; empty where it is even.

    A steady speed that is recorded in steps of q spreads by less than q about its mean.
    """
    spread, step = float(speed.std(ddof=1)), _step(speed)
    share = f"{100 * spread / abs(mean):.0f} % of its mean, {shown_speed(mean, record)}"
    if spread <= _UNEVEN * abs(mean):
        return ""
    if spread <= step:
        return (
            f"how evenly it moves is not seen: its speed is recorded in steps of"
            f" {shown_speed(step, record)} and spreads by {share}"
        )
    return f"moves unevenly: its speed spreads by {share}"


def _step(speed: np.ndarray) -> float:
    """The smallest step between speeds that occur; 0 where there is one speed only."""
    steps = np.diff(np.unique(speed))
    return float(steps[steps > 1e-9 * np.ptp(speed)].min()) if len(steps) else 0.0


def steady_rows(speed: np.ndarray) -> tuple[int, int]:
    """First row of the steady part of a run, and the row after its last.

    Means of 5 rows are compared with the median of those in the middle half: a start-up ends
    with the first three in a row that are within six times their scatter (at least 5 % of the
    median, at least one step of the recorder).
    """
    count = len(speed) // _BATCH
    means = speed[: count * _BATCH].reshape(count, _BATCH).mean(axis=1)
    middle = means[count // 4 : count - count // 4]
    level = float(np.median(middle))
    scatter = 1.4826 * float(np.median(np.abs(middle - level)))
    inside = np.abs(means - level) <= max(6 * scatter, 0.05 * abs(level), _step(speed))
    head, tail = _leading(inside), _leading(inside[::-1])
    stop = len(speed) if tail == 0 else (count - tail) * _BATCH
    return head * _BATCH, max(stop, 0)


def _leading(inside: np.ndarray) -> int:
    """Number of batches before the first three in a row that are inside."""
    if inside[0]:
        return 0
    settled = inside[2:] & inside[1:-1] & inside[:-2]
    return int(np.argmax(settled)) if settled.any() else len(inside)


def _is_steady(speed: np.ndarray) -> bool:
    """Whether the parts of a run have one mean speed.

    The noise of a part's mean is judged by differences of neighbours, which a slow change of
    speed leaves alone.
    """
    parts = np.array_split(speed, _BLOCKS)
    means = np.array([part.mean() for part in parts])
    mean = float(speed.mean())
    noise = float(np.std(np.diff(speed))) / np.sqrt(2 * len(parts[-1]))
    return bool(np.abs(means - mean).max() <= max(_CHANGE * abs(mean), 4 * noise))


def _range(speed: np.ndarray, record: AxisRecord) -> str:
    low, high = shown_speed(float(speed.min()), record), shown_speed(float(speed.max()), record)
    return f"its speed is not steady, from {low} to {high}"


def shown_speed(speed: float, record: AxisRecord) -> str:
    if record.coordinate == "rotary":
        return f"{speed * 30 / np.pi:.4g} rpm"
    return f"{speed * 1e3:.4g} mm/s"
