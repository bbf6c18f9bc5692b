"""Parts of a report that only an axis has: fits of its models, gains, and friction."""

from collections.abc import Sequence

import numpy as np

from ..fitting import Estimate
from ..fitting.axis_fit import AxisFit
from ..gains.axis_result import AxisGains
from ..loop.axis.driven import UNKNOWN, Driven, at_one_speed
from ..loop.axis.result import AxisDetails
from ..loop.family import listed
from ..stability.reasons import ClaimReason
from ..units import measured
from .estimates import UNDETERMINED, bracketed
from .tables import TextTable
from .words import capital, coded, say

_APART, _FACTOR = 4.0, 1.5
FRICTION = ("F_c", "F_v", "M")
"""Parameters of the base model of an axis that an owner asks for."""


def short(details: AxisDetails, by: str = "") -> str:
    """Say whether the axis stick-slips, `by` which model, and which gain prevents stick-slip."""
    return f"stick-slip{by}: {details.gains.short(*_units(details))}"


def found(details: AxisDetails) -> str:
    """Say what is known of friction if its parameters are undetermined; '' otherwise.

    The friction parameters are undetermined if each direction has only one speed, or if the force
    is feedback.
    """
    if details.withheld or not at_one_speed(details.driven):
        return details.withheld
    told = words_of_driven(details.driven, *_units(details))
    return f"{told}; {listed(UNKNOWN)} are not known, as {coded(ClaimReason.ONE_SPEED, {})}"


def words_of_driven(directions: Sequence[Driven], force: str, speed: str) -> str:
    """Friction of each direction at the speed of that direction; `force` and `speed` are units.

    Friction cannot drive. If the force drives in one direction, it includes a load P: the forces
    against the motion are f + P and f - P, and half their sum is the friction f.
    """
    each = " and ".join(
        f"{_with_error(one.force, one.error)} {force} {one.direction} at {one.speed:.3g} {speed}"
        f" ({one.slowest:.3g} to {one.fastest:.3g})"
        for one in directions
    )
    if min(one.force for one in directions) >= 0:
        return each
    (there, back), (error, other) = zip(*((o.force, o.error) for o in directions), strict=True)
    friction = _with_error((there + back) / 2, float(np.hypot(error, other)) / 2)
    load = abs(there - back) / 2
    return say("axis.load", friction=friction, force=force, load=load, each=each)


def _with_error(force: float, error: float) -> str:
    """A force with its standard error, if that is known."""
    return f"{force:.4g}" if np.isnan(error) else f"{force:.4g} ± {error:.2g}"


def doubt(details: AxisDetails) -> str:
    """Name mass and friction that differ between the loop and least squares of the counted rows.

    A difference is named only if it exceeds both its error and a factor of 1.5. The result is '' if
    mass and friction do not differ.
    """
    fit = details.check
    told = [
        f"{name} is {measured(own.value, own.std)} by the loop and"
        f" {measured(fit.values[name], fit.std[name])} by least squares of the rows that count"
        for name, own in details.loop.items()
        if fit is not None and name in FRICTION and _far_apart(fit, name, own)
    ]
    return f"{'; '.join(told)}: neither value is reliable" if told else ""


def _far_apart(fit: AxisFit, name: str, own: Estimate) -> bool:
    """Whether two fits have a parameter otherwise by more than their errors and a factor."""
    if name not in fit.values or name in fit.loose or not own.determined:
        return False
    error = float(np.hypot(fit.std[name], own.std))
    least, most = sorted((abs(own.value), abs(fit.values[name])))
    return abs(fit.values[name] - own.value) > _APART * error and most > _FACTOR * least


def stability(details: AxisDetails) -> str:
    """Sentences on stability, in the units of the record."""
    return details.gains.sentence(*_units(details))


def tables(details: AxisDetails) -> list[TextTable]:
    """Tables: parameters of both fits with standard errors; gains of the axis."""
    fits, unit = [fit for _, fit in details.fits], details.record.length_unit
    columns = [values_of(fit) for fit in fits]
    names = dict.fromkeys(name for column in columns for name in column)
    loop = {name: bracketed(estimate) for name, estimate in details.loop.items()}
    rows = [(name, *(column.get(name, "") for column in (*columns, loop))) for name in names]
    rows.append(("relative error", *(f"{100 * fit.relative_error:.4g} %" for fit in fits), ""))
    units = {"inverse dynamics": details.record.force_unit}
    rows.append(("rms", *(f"{fit.rms:.3g} {units.get(fit.method, unit)}" for fit in fits), ""))
    head = ("parameter", *(f"{when}: {fit.method}" for when, fit in details.fits), "the loop")
    notes = "".join(f" {capital(one)}." for one in details.notes)
    prepared = {"cutoff": details.preparation.cutoff, "every": details.preparation.decimation}
    note = say("axis.fits", **prepared, width=details.width, unit=unit, notes=notes)
    return [TextTable("Fits over all rows", head, rows, note), gains_table(details)]


def values_of(fit: AxisFit) -> dict[str, str]:
    """The parameters of a fit with their errors, as text."""
    return {
        name: UNDETERMINED if name in fit.loose else measured(value, fit.std.get(name, 0.0))
        for name, value in fit.values.items()
    }


def gains_table(details: AxisDetails) -> TextTable:
    """Table of the controller's gains in force, and of the least damping that friction requires."""
    force, drive, unit = details.record.force_unit, details.record.drive, details.record.length_unit
    rows = _least(details.gains, force, unit)
    signal = "V" if drive is None else drive.signal
    if drive is not None and drive.gain and details.gains.claim.kind != "open":
        own = f"{details.gains.claim.damping / drive.gain:.4g} {signal} s/{unit}"
        rows[0] = (*rows[0][:2], own)
    if drive is not None and drive.K_d is not None:
        damped = f"{drive.velocity_gain:.4g} {signal} s/{unit}"
        rows.append(("k_v in force", f"{drive.K_d:.4g} {force} s/{unit}", damped))
        if drive.K_p is not None:
            own = f"{drive.position_gain:.4g} 1/s times {damped}"
            rows.append(("k_p in force", f"{drive.K_p:.4g} {force}/{unit}", own))
    if (delay := details.longest_delay) is not None:
        held = f"{1e3 * delay:.3g} ms" if delay > 0 else "none: they do not hold it"
        rows.append(("delay they bear", held, ""))
    head, note = ("", "in force", "at the drive"), stability(details)
    if details.gains.claim.kind != "open":
        note += " By the equations of the documentation's page 'theory', for an ideal drive"
    if not any(row[-1] for row in rows):  # nothing is known of the drive
        head, rows = head[:-1], [row[:-1] for row in rows]
    return TextTable("Gains", head, rows, note)


def _least(gains: AxisGains, force: str, unit: str) -> list[tuple[str, ...]]:
    """The k_v that covers the least slope and two of its errors, and the optimum of stiffness."""
    if gains.claim.kind == "open":
        return [("least k_v", "nothing is said", "")]
    rows = [("least k_v", f"{gains.claim.damping:.4g} {force} s/{unit}", "")]
    if (stiff := gains.stiff) is not None:
        most = stiff.critical_stiffness
        shown = f"{most:.4g} {force}/{unit}" if np.isfinite(most) else "none suffices"
        own = "" if stiff.position_gain is None else f"{stiff.position_gain:.4g} 1/s"
        rows.append(("critical k_p without k_v", shown, own if np.isfinite(most) else ""))
    return rows


def _units(details: AxisDetails) -> tuple[str, str]:
    """The units of force and of velocity."""
    return details.record.force_unit, f"{details.record.length_unit}/s"
