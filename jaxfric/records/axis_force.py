"""Compute the motor force of an axis from a force, control signal, current or percentage."""

from dataclasses import replace

import numpy as np

from ..errors import InputError, option
from .axis_record import Drive
from .axis_units import FORCE_UNITS, coordinate_of, quantity_of
from .columns import Understood
from .roles import SIGNAL_UNITS

_SIGNALS = {"control_signal": ("control signal", "V"), "motor_current": ("motor current", "A")}
_LENGTHS = {"linear": "m", "rotary": "rad"}


class Forces:
    """Convert signals, currents and percentages to motor forces, in place in `found.values`.

    The gains and the rated torque are the user's texts, or None, as in `read_axis`.
    """

    def __init__(
        self,
        found: Understood,
        drive_gain: str | None,
        gains: tuple[str | None, str | None],
        rated_torque: str | None,
    ):
        self.found, self.drive_gain, self.rated_torque = found, drive_gain, rated_torque
        self.position_gain, self.velocity_gain = gains
        self.path, self.values, self.uses = found.table.path, found.values, found.uses
        si = {role: use.si_unit for role, use in found.uses.items()}
        written = {role: use.unit for role, use in found.uses.items()}
        self.coordinate = coordinate_of(self.path, si, written)
        self.force = FORCE_UNITS[self.coordinate]

    def from_signal(self) -> tuple[Drive | None, list[str]]:
        """Replace the control signal or current by the motor force, drive gain times signal."""
        values, drive_gain = self.values, self.drive_gain
        signals = {role: values.pop(role) for role in _SIGNALS if role in values}
        known = Drive(**self.found.table.gains)  # ty: ignore[invalid-argument-type]
        if "motor_force" in values:
            if drive_gain is not None and self._unit("disturbance") not in SIGNAL_UNITS:
                raise InputError(
                    f"{self.path} has a motor force of its own; leave out {option('drive-gain')}"
                    f" '{drive_gain}', or map only the signal"
                )
            notes = [f"{role} is not used: there is a motor force" for role in signals]
            return (known if self.found.table.gains else None), notes
        by_unit = [role for role in signals if f"/{_SIGNALS[role][1]}" in (drive_gain or "")]
        role = (by_unit or list(signals))[0]
        what, unit = _SIGNALS[role]
        gain = self._gain(role, what, unit)
        values["motor_force"] = gain * signals[role]
        note = f"motor force is {gain:.7g} {self.force}/{unit} times the {what}"
        return replace(known, gain=gain, signal=unit), [note]

    def controlled(self, drive: Drive | None) -> Drive | None:
        """Return the drive with the loop gains that the user gave, if any."""
        position_gain, velocity_gain = self.position_gain, self.velocity_gain
        if position_gain is None and velocity_gain is None:
            return drive
        if position_gain is None or velocity_gain is None:
            missing = option("position-gain") if position_gain is None else option("velocity-gain")
            raise InputError(
                f"{self.path}: {missing} is missing; both gains of the loops are needed"
            )
        if "reference_position" not in self.uses:
            raise InputError(
                f"{self.path} has no reference position, which the gains of the loops need; add"
                f" the column, or leave out {option('position-gain')} and {option('velocity-gain')}"
            )
        unit, gain = self.force.replace(" ", "*"), 1.0  # kv in force per velocity
        if "motor_force" not in self.uses and drive is not None:
            unit = next(signal for role, (_, signal) in _SIGNALS.items() if role in self.uses)
            gain = drive.gain
        elif self._unit("motor_force") == "%":
            raise InputError(
                f"{self.path} has its force in per cent; gains of the loops need it in"
                f" {self.force}: give the column's force, or leave out {option('position-gain')}"
                f" and {option('velocity-gain')}"
            )
        return Drive(
            gain,
            quantity_of(position_gain, "1/s", "position gain"),
            quantity_of(velocity_gain, f"{unit}*s/{_LENGTHS[self.coordinate]}", "velocity gain"),
            unit.replace("*", " "),
        )

    def in_unit(self) -> str:
        """Return the unit of the motor force; a rated torque converts percentages to torques."""
        rated_torque = self.rated_torque
        force_in_per_cent = self._unit("motor_force") == "%"
        if rated_torque is None:
            return "%" if force_in_per_cent else self.force
        if not force_in_per_cent and self._unit("disturbance") != "%":
            raise InputError(
                f"{self.path} has its force in {self.force}, not in per cent; leave out"
                f" {option('rated-torque', rated_torque)}"
            )
        if force_in_per_cent:
            self.values["motor_force"] = self.values["motor_force"] * self._per_cent(rated_torque)
        return self.force

    def add_disturbance(self, force_unit: str) -> list[str]:
        """Convert the disturbance to a force in the unit of the motor force; return notes."""
        if "disturbance" not in self.values:
            return []
        unit, rated_torque = self.uses["disturbance"].si_unit, self.rated_torque
        added = self.values.pop("disturbance")
        if unit in SIGNAL_UNITS:
            added = added * self._gain("disturbance", "disturbance", unit)
        elif unit == "%" and force_unit != "%":
            if rated_torque is None:
                raise InputError(
                    f"{self.path}: the disturbance is in per cent, the motor force in {self.force};"
                    " give the value of 100 %, as in"
                    f" {option('rated-torque', f'9.84 m{self.force}')}"
                )
            added = added * self._per_cent(rated_torque)
        elif unit != "%" and force_unit == "%":
            raise InputError(
                f"{self.path}: the disturbance is in {self.force}, the motor force in per cent;"
                f" give the value of 100 %, as in {option('rated-torque', f'9.84 m{self.force}')}"
            )
        self.values["disturbance_force"] = added
        share = np.mean(np.abs(added) > 0) if len(added) else 0.0
        return [f"a disturbance is added to the motor force in {100 * share:.3g} % of the rows"]

    def _gain(self, role: str, what: str, unit: str) -> float:
        """Return force per `unit` of a signal: the user's drive gain, else that of the file."""
        drive_gain, gains, force = self.drive_gain, self.found.table.gains, self.force
        if drive_gain is not None:
            si_unit = f"{force.replace(' ', '*')}/{unit}"
            return quantity_of(drive_gain, si_unit, f"drive gain of the {what}")
        if "gain" in gains:
            return gains["gain"]
        example = "35.15 N/V" if (force, unit) == ("N", "V") else f"0.05 {force}/{unit}"
        name = self.found.table.names[self.uses[role].column]
        raise InputError(
            f"{self.path}: '{name}' is a {what} [{unit}], not a motor force: force = drive gain x"
            f" {what}, and the drive gain is not known; give it, as in"
            f" {option('drive-gain', example)}"
        )

    def _unit(self, role: str) -> str | None:
        return self.uses[role].si_unit if role in self.uses else None

    def _per_cent(self, rated_torque: str) -> float:
        """Return one per cent of the rated torque, in the unit of the force."""
        return quantity_of(rated_torque, self.force.replace(" ", "*"), "rated torque") / 100
