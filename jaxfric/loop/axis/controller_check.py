"""Check whether the recorded force comes from the stated controller.

The stated control law, u_k = g_tau k_v (k_p (r_k - q_k) - (q_k - q_(k-2))/(2 h)), is evaluated for
the measured signals. The force of the stated control law is compared with the recorded force. If
the two forces differ, the closed loop is incomplete: an unrecorded disturbance, other gains, or a
saturated drive.
"""

import numpy as np

from ...errors import option
from ...fitting.axis_problem import NEGLIGIBLE
from ...records.axis_record import AxisRecord
from ..thresholds import CONTROLLER_OFF, SAME_FORCE, STUCK


def stated_force(record: AxisRecord) -> np.ndarray | None:
    """Force by the stated control law for the measured signals; None without a stated law."""
    drive, reference, position = record.drive, record.reference_position, record.position
    if drive is None or reference is None or position is None:
        return None
    if drive.K_d is None or drive.position_gain is None:
        return None
    interval = float(np.median(np.diff(record.time)))
    velocity = np.zeros_like(position)
    velocity[2:] = (position[2:] - position[:-2]) / (2 * interval)
    return drive.K_d * (drive.position_gain * (reference - position) - velocity)


def disagreement(record: AxisRecord, *, held: bool) -> str | None:
    """A warning if recorded and stated force disagree; None if they agree or no force is stated.

    held : the recorded force includes the disturbance, which is then added to the stated force.
    """
    stated = stated_force(record)
    if stated is None:
        return None
    if held and record.disturbance_force is not None:
        stated = stated + record.disturbance_force
    force, time, unit = record.motor_force, record.relative_time, record.force_unit
    off = (force - stated)[2:]
    middle = float(np.median(np.abs(off)))
    size = float(np.sqrt(np.mean(force**2)))
    if middle > SAME_FORCE * size:
        return (
            f"the recorded force and the stated controller disagree: by {middle:.3g} {unit} in half"
            f" of the rows, {100 * middle / size:.2g} % of the force. Check the gains and their"
            f" units ({option('position-gain')}, {option('velocity-gain')},"
            f" {option('drive-gain')}); do not trust the closed-loop fit"
        )
    limit = max(CONTROLLER_OFF * 1.4826 * middle, NEGLIGIBLE * float(np.max(np.abs(force))))
    rows = np.flatnonzero(np.abs(off) > limit) + 2
    if not len(rows):
        return None
    return (
        f"the recorded force and the stated controller disagree in {len(rows)} rows, by up to"
        f" {float(np.max(np.abs(off))):.3g} {unit} ({stretches(rows, time)}): something else acts"
        " there, which the closed loop does not know. Give what was added as a column"
        f" ({option('column', 'disturbance=NAME')}), or do not trust the closed-loop fit"
    )


def stretches(rows: np.ndarray, time: np.ndarray) -> str:
    """Times of some rows as text: the longest stretch, and the number of other stretches."""
    gap = max(STUCK / float(np.median(np.diff(time))), 1.0)
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > gap) + 1)
    longest = max(parts, key=len)
    more = f" and {len(parts) - 1} more stretches" if len(parts) > 1 else ""
    last = f"{time[longest[-1]]:.4g} s{more}"
    return f"{time[longest[0]]:.4g} to {last}" if len(longest) > 1 else f"one row at {last}"
