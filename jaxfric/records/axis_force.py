"""The motor force of an axis: recorded as such, or as a signal, a current, or per cent."""

from collections.abc import Mapping

import numpy as np

from ..errors import InputError
from .axis_header import FORCE_UNITS, SIGNAL_UNITS, Use, quantity_of
from .axis_record import Drive
from .axis_source import Source

_SIGNALS = {"control_signal": ("control signal", "V"), "motor_current": ("motor current", "A")}
_LENGTHS = {"linear": "m", "rotary": "rad"}


def force_from_signal(
    source: Source,
    values: dict[str, np.ndarray],
    uses: Mapping[str, Use],
    coordinate: str,
    drive_gain: str | None,
) -> tuple[Drive | None, list[str]]:
    """Put the motor force in place of the control signal or current, gain times it."""
    signals = {role: values.pop(role) for role in _SIGNALS if role in values}
    gains = dict(source.gains)
    if "motor_force" in values:
        if drive_gain is not None and not _is_signal(uses, "disturbance"):
            raise InputError(
                f"{source.path} has a motor force of its own; leave out --drive-gain"
                f" '{drive_gain}', or map only the signal"
            )
        notes = [f"{role} is not used: there is a motor force" for role in signals]
        return (Drive(**gains) if gains else None), notes  # pyright: ignore[reportArgumentType]
    by_unit = [role for role in signals if f"/{_SIGNALS[role][1]}" in (drive_gain or "")]
    role = (by_unit or list(signals))[0]
    what, unit = _SIGNALS[role]
    force = FORCE_UNITS[coordinate]
    gains["gain"] = _gain(source, uses[role], what, unit, coordinate, drive_gain)
    values["motor_force"] = gains["gain"] * signals[role]
    note = f"motor force is {gains['gain']:.7g} {force}/{unit} times the {what}"
    return Drive(**gains, signal=unit), [note]


def add_disturbance(
    source: Source,
    values: dict[str, np.ndarray],
    uses: Mapping[str, Use],
    coordinate: str,
    force_unit: str,
    *,
    drive_gain: str | None,
    rated_torque: str | None,
) -> list[str]:
    """Put the disturbance's force, in the unit of the motor force, in place of its column."""
    if "disturbance" not in values:
        return []
    use, force = uses["disturbance"], FORCE_UNITS[coordinate]
    added = values.pop("disturbance")
    if use.si_unit in SIGNAL_UNITS:
        added = added * _gain(source, use, "disturbance", use.si_unit, coordinate, drive_gain)
    elif use.si_unit == "%" and force_unit != "%":
        if rated_torque is None:
            raise InputError(
                f"{source.path}: the disturbance is in per cent, the motor force in {force}; say"
                f" what 100 % are, as in --rated-torque '9.84 m{force}'"
            )
        added = added * (_rated(rated_torque, force) / 100)
    elif use.si_unit != "%" and force_unit == "%":
        raise InputError(
            f"{source.path}: the disturbance is in {force}, the motor force in per cent; say what"
            f" 100 % are, as in --rated-torque '9.84 m{force}'"
        )
    values["disturbance_force"] = added
    share = np.mean(np.abs(added) > 0) if len(added) else 0.0
    return [f"a disturbance is added to the motor force in {100 * share:.3g} % of the rows"]


def _gain(
    source: Source, use: Use, what: str, unit: str, coordinate: str, drive_gain: str | None
) -> float:
    """Force per `unit` of a signal: as told, else as the file has it."""
    force = FORCE_UNITS[coordinate]
    if drive_gain is not None:
        si_unit = f"{force.replace(' ', '*')}/{unit}"
        return quantity_of(drive_gain, si_unit, f"drive gain of the {what}")
    if "gain" in source.gains:
        return source.gains["gain"]
    example = "35.15 N/V" if (force, unit) == ("N", "V") else f"0.05 {force}/{unit}"
    raise InputError(
        f"{source.path}: '{source.names[use.index]}' is a {what} [{unit}], not a motor force: force"
        f" = drive gain x {what}, and the drive gain is not known; give it, as in"
        f" --drive-gain '{example}'"
    )


def _is_signal(uses: Mapping[str, Use], role: str) -> bool:
    return role in uses and uses[role].si_unit in SIGNAL_UNITS


def controlled(
    source: Source,
    uses: Mapping[str, Use],
    coordinate: str,
    drive: Drive | None,
    position_gain: str | None,
    velocity_gain: str | None,
) -> Drive | None:
    """The drive with the gains of its loops, where they are given."""
    if position_gain is None and velocity_gain is None:
        return drive
    if position_gain is None or velocity_gain is None:
        missing = "--position-gain" if position_gain is None else "--velocity-gain"
        raise InputError(f"{source.path}: {missing} is missing; both gains of the loops are needed")
    if "reference_position" not in uses:
        raise InputError(
            f"{source.path} has no reference position, without which the gains of the loops are of"
            " no use; add the column, or leave out --position-gain and --velocity-gain"
        )
    force, length = FORCE_UNITS[coordinate].replace(" ", "*"), _LENGTHS[coordinate]
    unit, gain = force, 1.0  # kv in force per velocity
    if "motor_force" not in uses and drive is not None:
        unit = next(signal for role, (_, signal) in _SIGNALS.items() if role in uses)
        gain = drive.gain
    elif uses["motor_force"].si_unit == "%":
        raise InputError(
            f"{source.path} has its force in per cent; gains of the loops need it in {force}: give"
            " the column's force, or leave out --position-gain and --velocity-gain"
        )
    return Drive(
        gain,
        quantity_of(position_gain, "1/s", "position gain"),
        quantity_of(velocity_gain, f"{unit}*s/{length}", "velocity gain"),
        unit.replace("*", " "),
    )


def force_unit_of(
    source: Source,
    values: dict[str, np.ndarray],
    uses: Mapping[str, Use],
    coordinate: str,
    rated_torque: str | None,
) -> str:
    """The unit of the force; per cent become torque where the rated torque is given."""
    per_cent = [role for role in ("motor_force", "disturbance") if _in_per_cent(uses, role)]
    force = FORCE_UNITS[coordinate]
    if rated_torque is None:
        return "%" if "motor_force" in per_cent else force
    if not per_cent:
        raise InputError(
            f"{source.path} has its force in {force}, not in per cent; leave out"
            f" --rated-torque '{rated_torque}'"
        )
    if "motor_force" in per_cent:
        values["motor_force"] = values["motor_force"] * (_rated(rated_torque, force) / 100)
    return force


def _in_per_cent(uses: Mapping[str, Use], role: str) -> bool:
    return role in uses and uses[role].si_unit == "%"


def _rated(rated_torque: str, force: str) -> float:
    """What 100 % are, in `force`."""
    return quantity_of(rated_torque, force.replace(" ", "*"), "rated torque")
