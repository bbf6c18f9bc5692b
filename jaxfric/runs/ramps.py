"""The stiffness of machine and specimen, from ramps during which the slider sticks.

When the load point moves back, or moves on after a hold or after unloading, friction is so far
below sliding friction that the slider does not slip. For most rocks 10 % of sliding friction is 5 A
or more. At 10 % below sliding friction the slider then slips at less than 1 % of the load point's
velocity. While the slider sticks, shear stress changes by the stiffness k per metre of the load
point: k = cov(time, stress)/cov(time, position). The noise of both channels does not bias k (Wald
1940, Ann. Math. Stat. 11, 284-300, on lines with errors in both). Without a normal stress the
result is the stiffness K of friction.

A ramp is used if its parts (sixths, with enough rows) have similar slopes; two halves would also
agree for an S-shaped ramp. If the slopes differ, the first half of the ramp is tested, then the
first quarter, and so on. Slopes differ because unloading is softer at low load, and because the
slider begins to slip at the end of a reload. If the second half is stiffer than the first, the
press was not yet in contact, and the ramp is not used. The first loading of a press is not used
either, because this loading seats and crushes the specimen. A phase of motion directly after
another forward phase is not used, either. Ramps need no fit, so that `--stiffness ramps` and the
report of a run give the same stiffness. The error of a ramp's slope includes the scatter of the
ramp's blocks, and half the deviation of the worst part. A press may be stiffer for the small
changes after a velocity step than along a ramp.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, option
from ..findings import WarningCode, warned
from ..fitting.stiffness import MachineStiffness, departure
from ..records import Record
from ..records.stress import is_constant
from ..units import measured
from .events import Event
from .reasons import RunReason
from .table import Cell, short
from .weighted import weighted_mean

RAMPS = "ramps"
"""Value of --stiffness that uses the stiffness of the ramps."""
_BELOW, _LOW = 0.1, 0.1
"""The slider sticks if friction is below sliding by the share `_BELOW`. Below the share `_LOW` of
sliding friction the press may not be in contact."""
_FEWEST, _LEVEL, _BLOCKS, _PARTS = 16, 20, 8, 6
"""Least number of rows of a ramp, and of each of more than two parts; number of rows before an
event that give the sliding level; blocks of a ramp; largest number of compared parts."""
_ALIKE, _SURE, _HALVINGS = 0.1, 3.0, 4
"""Slopes of parts agree with the ramp's within the share `_ALIKE`, or within `_SURE` errors; a ramp
is halved at most `_HALVINGS` times."""
_KNOWN = 0.2
"""Largest relative error of a used slope."""
_LEAST = 1e-3
"""Least relative error of a slope in the weighted mean."""


@dataclass(frozen=True)
class Ramp:
    """A ramp from `start` to `stop` [s] that begins with an `unload` or a `reload` (`kind`).

    `slope` and its standard `error`: k [Pa/m] of shear stress if `of_stress`, else K of friction
    [friction/m]. Both are None if the ramp cannot be used, and `why` gives the reason.
    """

    kind: str
    start: float
    stop: float
    normal_stress: float | None
    of_stress: bool
    slope: float | None = None
    error: float | None = None
    why: str = ""


@dataclass(frozen=True)
class RampStiffness:
    """The stiffness of `count` ramps: weighted mean `value` and standard `error`, of stress [Pa/m]
    or of friction [friction/m]."""

    value: float
    error: float
    count: int
    of_stress: bool

    def machine(self) -> MachineStiffness:
        """Return the value as a machine stiffness for the fits of steps."""
        return MachineStiffness(self.value, self.of_stress)

    def told(self) -> str:
        """Return a line of text on the stiffness of the ramps."""
        scale, unit = (1e-12, "MPa/um") if self.of_stress else (1e-6, "1/um")
        number = measured(scale * self.value, scale * self.error)
        return f"stiffness from {self.count} ramp{'s' * (self.count > 1)}: {number} {unit}"


def find_ramps(record: Record, events: Sequence[Event]) -> tuple[Ramp, ...]:
    """Find the ramps of a run, whose record must have no encoder resets.

    The result does not depend on whether `events` were found with a stiffness. A phase of motion
    directly after another phase, called a step or a reload, gives no ramp. The friction of such a
    phase starts at the level of the rows before the phase.
    """
    t = record.relative_time
    joints = [e for e in events if e.before != e.after or e.kind == "stress"]
    if not joints:
        return ()
    phases = list(zip(joints, [*(j.time for j in joints[1:]), float(t[-1])], strict=True))
    ahead = -1.0 if sum(e.after * (end - e.time) for e, end in phases) < 0 else 1.0
    out, level = [], None
    for event, end in phases:
        rows = slice(*np.searchsorted(t, [event.time, end]))
        if event.before * ahead > 0 and rows.start >= _LEVEL:
            level = float(np.median(record.friction[rows.start - _LEVEL : rows.start]))
        if event.kind in ("unload", "reload") and event.after and rows.stop - rows.start > _FEWEST:
            out.append(_ramp(record, event, rows, level))
    return tuple(ramp for ramp in out if ramp is not None)


def _ramp(record: Record, event: Event, rows: slice, level: float | None) -> Ramp | None:
    """Return the ramp that begins with an event; None if the slider does not stick."""
    t, f = record.relative_time[rows], record.friction[rows]
    x, stress = record.load_point_displacement, record.normal_stress
    assert x is not None
    if level is None:  # the first loading of a press seats and crushes the specimen
        return None
    low, high = _LOW * abs(level), (1 - _BELOW) * abs(level)
    size = np.abs(f)
    if event.kind == "unload":
        part = slice(_first(size < high), _first(size < low))
    else:
        part = slice(_first(size > low), _first(size > high))
    if part.stop - part.start < _FEWEST:
        return None
    of_stress = stress is not None and record.friction_unit == "1"
    here = None if stress is None else stress[rows][part]
    about = None if here is None else float(np.median(here))
    ramp = Ramp(event.kind, float(t[part.start]), float(t[part.stop - 1]), about, of_stress)
    if not is_constant(here, 4):
        return replace(ramp, why=warned(RunReason.STRESS_VARIES))
    force = f[part] * here if of_stress and here is not None else f[part]
    return _straight(ramp, np.stack([t[part], x[rows][part], force]))


def _first(there: np.ndarray) -> int:
    """Return the index of the first True, or the length if there is none."""
    return int(np.argmax(there)) if there.any() else len(there)


def _straight(ramp: Ramp, rows: np.ndarray) -> Ramp:
    """Return the slope of a ramp, or of its first part that is straight; `rows` (3, n): time,
    position and force."""
    for _ in range(_HALVINGS + 1):
        number = rows.shape[1]
        half, (slope, error) = number // 2, _slope(rows)
        parts = np.array_split(rows, min(max(number // _FEWEST, 2), _PARTS), axis=1)
        slopes, errors = np.array([_slope(part) for part in parts]).T
        off = float(np.abs(slopes - slope).max())
        unsure = float(np.sqrt(np.mean(errors**2)))  # pooled: each part has few blocks
        if off < max(_ALIKE * abs(slope), _SURE * unsure):
            error = float(np.hypot(error, max(off - unsure, 0.0) / 2))
            if not slope > 0 or error > _KNOWN * slope:
                return replace(ramp, why=warned(RunReason.NOISY))
            start, stop = float(rows[0, 0]), float(rows[0, -1])
            return replace(ramp, start=start, stop=stop, slope=slope, error=error)
        if half < 2 * _FEWEST or _slope(rows[:, half:])[0] > _slope(rows[:, :half])[0]:
            break
        rows = rows[:, :half]
    return replace(ramp, why=warned(RunReason.BENT))


def _slope(rows: np.ndarray) -> tuple[float, float]:
    """Return cov(time, force)/cov(time, position), and its error from the scatter of blocks."""
    t, x, f = rows - rows.mean(axis=1, keepdims=True)
    moves = float(t @ x)
    slope = float(t @ f) / moves
    left = f - slope * x
    blocks = min(_BLOCKS, len(t) // 4)
    sums = [float(part.sum()) for part in np.array_split(t * left, blocks)]
    return slope, float(np.sqrt(np.sum(np.square(sums)) * blocks / (blocks - 2)) / abs(moves))


def ramp_stiffness(ramps: Sequence[Ramp]) -> RampStiffness | None:
    """Return the weighted mean of all ramps; the error of the mean includes the scatter of the
    ramps (Birge 1932, Phys. Rev. 40, 207-227). The result is None if no ramp has a slope.
    """
    known = [(r.slope, r.error) for r in ramps if r.slope is not None and r.error is not None]
    if not known:
        return None
    k, errors = np.array(known).T
    # a ramp whose blocks scatter little by chance must not outweigh all others
    errors = np.maximum(errors, _LEAST * k.mean())
    found = weighted_mean(k[:, None], errors[:, None, None] ** 2)
    birge = max(1.0, found.chi_square / max(len(k) - 1, 1))
    error = float(np.sqrt(birge * found.covariance.item()))
    return RampStiffness(found.mean.item(), error, len(k), ramps[0].of_stress)


def stiffness_from_ramps(record: Record, events: Sequence[Event]) -> RampStiffness:
    """Return the stiffness for `--stiffness ramps`. Raises `InputError` without a usable ramp."""
    ramps = find_ramps(record, events)
    found = ramp_stiffness(ramps)
    if found is None:
        raise InputError(
            f"{record.provenance.path}: {option('stiffness', 'ramps')}: {_none(ramps)}; give the"
            f" stiffness, as in {option('stiffness', '1.6e-3/um')}"
        )
    return found


def _none(ramps: Sequence[Ramp]) -> str:
    if not ramps:
        return "the load point never moves back, and no reload begins far below sliding friction"
    why = list(dict.fromkeys(ramp.why for ramp in ramps if ramp.why))
    return f"none of {len(ramps)} ramps gives a stiffness ({'; '.join(why)})"


def disagreement(
    found: RampStiffness | None, given: MachineStiffness | None, stress: float | None
) -> str | None:
    """Return a sentence if the given stiffness differs from that of the ramps, else None.

    If one stiffness is of stress and the other of friction, both are compared at the normal
    `stress` [Pa] of the steps.
    """
    if found is None or given is None:
        return None
    value = given.value
    if found.of_stress != given.of_stress:
        if not (stress and stress > 0):
            return None
        value = value * stress if found.of_stress else value / stress
    share = departure(value, found.value, found.error)
    return None if share is None else warned(WarningCode.RAMPS, share=share, found=found.told())


def rows(ramps: Sequence[Ramp]) -> list[dict[str, Cell]]:
    """Return a row for every ramp, with units in the names; None: not known."""
    out: list[dict[str, Cell]] = []
    for number, ramp in enumerate(ramps, 1):
        scale, unit = (1e-12, "MPa/um") if ramp.of_stress else (1e-6, "1/um")
        row: dict[str, Cell] = {
            "ramp": number,
            "kind": ramp.kind,
            "from [s]": round(ramp.start, 4),
            "to [s]": round(ramp.stop, 4),
            "normal_stress [MPa]": short(ramp.normal_stress, 6, 1e-6),
            f"stiffness [{unit}]": short(ramp.slope, 6, scale),
            f"std stiffness [{unit}]": short(ramp.error, 6, scale),
            "result": ramp.why or "straight",
        }
        out.append(row)
    return out


def told(ramps: Sequence[Ramp]) -> list[str]:
    """Return a line on the stiffness of the ramps; none without ramps."""
    if not ramps:
        return []
    found = ramp_stiffness(ramps)
    return [f"no stiffness from ramps: {_none(ramps)}" if found is None else found.told()]
