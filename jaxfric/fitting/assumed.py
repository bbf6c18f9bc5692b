"""Warnings about rows that contradict what a model assumes of a record.

The model starts in steady sliding at the first velocity. In steady sliding the slider moves as fast
as the load point. While friction f changes, the spring of stiffness K changes its length, and the
slider moves at V - df/dt / K. The model has one normal stress.
"""

import numpy as np

from ..findings import Warned, WarningCode, warned
from ..records import Record, VelocitySteps
from ..records.differences import noise_from_differences
from ..records.stress import find_stress_changes, is_constant
from . import thresholds as const


def unsteady_start(
    time: np.ndarray, friction: np.ndarray, steps: VelocitySteps, K: float
) -> tuple[Warned, ...]:
    """Warn if sliding is not steady at the first row; `time` [s] starts at 0.

    The `steps` begin forwards, `friction` belongs to them, `K` is the stiffness [friction/m].
    """
    V, end = steps.velocities[0], steps.times[1] if len(steps) > 1 else time[-1]
    n = int(np.searchsorted(time, end))
    noise, size = noise_from_differences(friction), float(np.ptp(friction))

    def settles(first: int, factor: float = 1.0) -> bool:
        t, f = time[first:n], friction[first:n]
        for half in (len(f) // scale // 2 for scale in const.STEADY_SCALES):
            if half < const.STEADY_ROWS:
                break
            means = f[: len(f) // half * half].reshape(-1, half).mean(axis=1)
            later = means[len(means) // 2 :]
            change, away = means[1] - means[0], np.median(later) - means[0]
            usual = float(np.sqrt(np.mean(np.diff(later) ** 2)))
            clear = max(const.CLEAR_RISE * noise * np.sqrt(2 / half), const.STEADY_USUAL * usual)
            loads = factor * const.STEADY_LOADS * K * V * (t[half] - t[0])
            if abs(change) > max(loads, clear) and abs(away) > factor * const.STEADY_AWAY * size:
                return True
        return False

    if not (V > 0 and settles(0)):
        return ()
    parts = [n * k // const.STEADY_PARTS for k in range(1, const.STEADY_PARTS)]
    later = next((row for row in parts if not settles(row, const.STEADY_SAFE)), parts[-1])
    return (warned(WarningCode.UNSTEADY, time=float(time[later])),)


def changed_stress(record: Record) -> tuple[Warned, ...]:
    """Warn if the recorded normal stress of a record is not constant."""
    stress, time = record.normal_stress, record.relative_time
    if stress is None or is_constant(stress, const.STEADY_PARTS):
        return ()
    changes = find_stress_changes(time, stress)
    return (
        warned(
            WarningCode.STRESS,
            least=float(np.min(stress)),
            most=float(np.max(stress)),
            when="".join(f", at {change.start:.4g} s" for change in changes[: const.STEADY_PARTS]),
        ),
    )
