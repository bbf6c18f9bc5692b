"""What only the loop of an axis reports: the fits of its models, the gains, and the friction."""

from collections.abc import Sequence

import numpy as np

from ..fitting import Estimate
from ..fitting.axis_fit import AxisFit
from ..gains.axis_result import AxisGains, Shown
from ..loop.axis.driven import ONE_SPEED, UNKNOWN, Driven, at_one_speed
from ..loop.axis.result import AxisDetails
from ..loop.family import listed
from .tables import TextTable

_APART, _FACTOR = 4.0, 1.5
_MEASURED = ("M", "F_c", "F_v")
_PAGE = "of the documentation's page 'theory'"


def short(details: AxisDetails) -> str:
    """Say whether the axis stick-slips, and which gain prevents stick-slip."""
    return f"stick-slip: {details.gains.short(*_units(details))}"


def found(details: AxisDetails) -> str:
    """What is known of friction if the record leaves its parameters open; '' otherwise.

    The parameters stay open if each direction has only one speed, or if the force is feedback.
    """
    if details.withheld or not at_one_speed(details.driven):
        return details.withheld
    told = words_of_driven(details.driven, details.record.force_unit, f"{_length(details)}/s")
    return f"{told}; {listed(UNKNOWN)} are not known, as {ONE_SPEED}"


def words_of_driven(directions: Sequence[Driven], force: str, speed: str) -> str:
    """Friction of each direction at its own speed; `force` and `speed` are units."""
    each = (
        f"{one.force:.4g}{'' if np.isnan(one.error) else f' ± {one.error:.2g}'} {force}"
        f" {one.direction} at {one.speed:.3g} {speed} ({one.slowest:.3g} to {one.fastest:.3g})"
        for one in directions
    )
    return " and ".join(each)


def doubt(details: AxisDetails) -> str:
    """Name mass and friction that differ between the loop and a least-squares fit of all rows.

    Only differences larger than the errors and than a factor of 1.5 are named; '' if there are
    none.
    """
    fit = details.fits[-1][1] if details.fits else None
    told = [
        f"{name} is {_shown(own.value, own.std)} by the loop and"
        f" {_shown(fit.values[name], fit.std[name])} by least squares over all rows"
        for name, own in details.loop.items()
        if fit is not None and name in _MEASURED and _far_apart(fit, name, own)
    ]
    return f"{'; '.join(told)}: neither value is reliable" if told else ""


def stability(details: AxisDetails) -> str:
    """Sentences on stability, in the units of the record."""
    return details.gains.sentence(*_units(details))


def tables(details: AxisDetails) -> list[TextTable]:
    """Tables of the parameters of both fits with their errors, and of the gains."""
    fits, unit = [fit for _, fit in details.fits], _length(details)
    names = list(dict.fromkeys(name for fit in fits for name in fit.values))
    rows: list[tuple[str, ...]] = []
    rows += [(name, *(_of(fit, name) for fit in fits), _looped(details, name)) for name in names]
    units = {"inverse dynamics": details.record.force_unit}
    errors = (f"{100 * fit.relative_error:.4g} %" for fit in fits)
    rows.append(("relative error", *errors, ""))
    sizes = (f"{fit.rms:.3g} {units.get(fit.method, unit)}" for fit in fits)
    rows.append(("rms", *sizes, ""))
    heads = [*(f"{when}: {fit.method}" for when, fit in details.fits), "the loop"]
    noted = "".join(f" {note[0].upper()}{note[1:]}." for note in details.notes)
    note = (
        "SI. Inverse dynamics: relative to the prepared motor force; output error: relative to"
        f" the position. Cutoff {details.preparation.cutoff:.3g} Hz, one row in"
        f" {details.preparation.decimation}; the sign of the velocity is smoothed over"
        f" {details.width:.2g} {unit}/s.{noted} Rows are all but those at rest, and the"
        " force acts at once, as in published fits; the loop's values are of its train block,"
        f" with its noise.{_differing(details)}"
    )
    both = "The two fits" if len({fit.method for fit in fits}) > 1 else "The fit"
    fitted = TextTable(f"{both}, over all rows", ("parameter", *heads), rows, note)
    return [fitted, gains_table(details)]


def gains_table(details: AxisDetails) -> TextTable:
    """Gains in force, and the least damping that friction requires, in both units."""
    force, drive, gains = details.record.force_unit, details.record.drive, details.gains
    unit = _length(details)
    rows = [("least k_v", "nothing is said", "")]
    if gains.claim.kind != "open":
        rows = _least(details, force, unit)
    if drive is not None and drive.K_d is not None:
        damped = _drive(drive.velocity_gain, drive.signal, unit)
        rows.append(("k_v in force", f"{drive.K_d:.4g} {force} s/{unit}", damped))
    if drive is not None and drive.K_p is not None:
        damped = _drive(drive.velocity_gain, drive.signal, unit)
        own = f"{drive.position_gain:.4g} 1/s times {damped}"
        rows.append(("k_p in force", f"{drive.K_p:.4g} {force}/{unit}", own))
    if (delay := details.longest_delay) is not None:
        held = f"{1e3 * delay:.3g} ms" if delay > 0 else "none: they do not hold it"
        rows.append(("delay they bear", held, ""))
    note = stability(details)
    if gains.claim.kind != "open" and gains.stiff is None:
        note += f" By equation (13) {_PAGE}"
    elif gains.claim.kind != "open":
        note += (
            f" By equation (13), (18)-(20) and (25) {_PAGE}: linear, and of an ideal drive;"
            " lags and sampling ask for more. The critical k_p at the drive is in 1/s at its"
            " k_v"
        )
    head = ("", "in force", "at the drive")
    if not any(row[-1] for row in rows):  # nothing is known of the drive
        head, rows = head[:-1], [row[:-1] for row in rows]
    return TextTable("Gains", head, rows, note)


def _least(details: AxisDetails, force: str, unit: str) -> list[tuple[str, str, str]]:
    """The least slope, the k_v that covers it and two of its errors, the other optimum."""
    gains, drive, damping = details.gains, details.record.drive, f"{force} s/{unit}"
    k_v = gains.claim.damping
    gain = k_v / drive.gain if drive is not None and drive.gain else None
    own = _drive(gain, "V" if drive is None else drive.signal, unit)
    return [
        ("worst velocity", f"{gains.worst_velocity:.4g} {unit}/s", ""),
        ("slope of friction there", f"{gains.slope:.4g} {damping}", ""),
        ("least k_v", f"{k_v:.4g} {damping}", own),
        *_stiff_rows(gains, force, unit),
    ]


def _stiff_rows(gains: AxisGains, force: str, unit: str) -> Sequence[tuple[str, str, str]]:
    """The optimum of stiffness, where there is one."""
    stiff = gains.stiff
    if stiff is None:
        return []
    if not np.isfinite(stiff.critical_stiffness):
        return [("critical k_p without k_v", f"none at {stiff.worst_velocity:.4g} {unit}/s", "")]
    own = "" if stiff.position_gain is None else f"{stiff.position_gain:.4g} 1/s"
    return [
        ("critical k_p without k_v", f"{stiff.critical_stiffness:.4g} {force}/{unit}", own),
        ("its worst velocity", f"{stiff.worst_velocity:.4g} {unit}/s", ""),
        ("its frequency", f"{stiff.frequency:.4g} rad/s", ""),
    ]


def _length(details: AxisDetails) -> str:
    return "m" if details.record.coordinate == "linear" else "rad"


def _units(details: AxisDetails) -> tuple[Shown, Shown]:
    """The units of damping and of velocity in sentences."""
    unit = _length(details)
    return Shown(f"{details.record.force_unit} s/{unit}"), Shown(f"{unit}/s")


def _drive(gain: float | None, signal: str, unit: str) -> str:
    return "" if gain is None else f"{gain:.4g} {signal} s/{unit}"


# ---- two fits of one model -----------------------------------------------------------------------


def _differing(details: AxisDetails) -> str:
    """A sentence on values in which the fits differ beyond their errors, or nothing."""
    last = details.fits[-1][0]
    names = [
        name
        for name, own in details.loop.items()
        if any(_apart(fit, name, own) for when, fit in details.fits if when == last)
    ]
    if not names:
        return ""
    return (
        f" They differ by more than their errors in {', '.join(names)}: the errors of one fit"
        " do not hold for the other, and the model is not the whole truth"
    )


def _apart(fit: AxisFit, name: str, own: Estimate) -> bool:
    if name not in fit.values or name in fit.loose or not own.determined:
        return False
    error = float(np.hypot(fit.std[name], own.std))
    return abs(fit.values[name] - own.value) > _APART * error


def _far_apart(fit: AxisFit, name: str, own: Estimate) -> bool:
    """Whether two fits have a parameter otherwise by more than their errors and a factor."""
    values = sorted((abs(own.value), abs(fit.values.get(name, own.value))))
    return _apart(fit, name, own) and values[1] > _FACTOR * values[0]


def _looped(details: AxisDetails, name: str) -> str:
    """The value that the loop ended with, as text."""
    one = details.loop.get(name)
    if one is None:
        return ""
    return _shown(one.value, one.std) if one.determined else "undetermined"


def _of(fit: AxisFit, name: str) -> str:
    if name in fit.loose:
        return "undetermined"
    return _shown(fit.values.get(name), fit.std.get(name))


def _shown(value: float | None, std: float | None) -> str:
    if value is None or std is None:
        return ""
    if not (np.isfinite(std) and std > 0):
        return f"{value:.4g}"
    digits = max(0, int(np.floor(np.log10(abs(value) / std)) + 2)) if value else 2
    return f"{value:.{max(digits, 2)}g} ± {std:.2g}"
