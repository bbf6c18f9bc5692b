"""The roles of columns of a record: one schema for sliders, one for servo axes.

A role has a name, the SI units of its column, an example of a unit for messages, and the names that
laboratories and drives use. `columns` finds the columns of a file by these names, in the same way
for sliders and axes. To support another column name, add the name to its role in this module.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

from ..errors import folded

NO_COLUMN = "none"
"""Given instead of a column if no column has the role."""


class Role(NamedTuple):
    """A role that a column of a record can have.

    `unit` is the SI unit of the role, `turning` its SI unit on a rotary axis ('' for none);
    `others` are further allowed units. `example` is a common spelling of a unit. `aliases` are
    other names of the role, folded, the most certain first. Roles with the same word in `need` are
    alternatives: a record needs a column for one of these roles.
    """

    name: str
    unit: str
    example: str
    aliases: str
    need: str = ""
    turning: str = ""
    others: tuple[str, ...] = ()

    @property
    def units(self) -> tuple[str, ...]:
        """SI units that a column of this role may have; `unit` comes first."""
        return (self.unit, *filter(None, [self.turning]), *self.others)

    def shown(self, *, rotary: bool = False) -> str:
        """Return an example of the role's unit for messages."""
        return self.turning.replace("*", " ") if rotary and self.turning else self.example


class Schema:
    """The roles of one kind of rig by name; `suffixes` are units that may end a column's name."""

    def __init__(self, roles: tuple[Role, ...], suffixes: Mapping[str, str]):
        self.roles = {role.name: role for role in roles}
        self._suffixes = suffixes
        self._ranks = {
            name: (role.name, rank)
            for role in roles
            for rank, name in enumerate([folded(role.name), *role.aliases.split()])
        }

    def role_of(self, name: str) -> tuple[str, int] | None:
        """Return the role of a column's name and the name's rank (0: the role's name), or None."""
        return self._ranks.get(folded(name))

    def split(self, cell: str) -> tuple[str, str | None]:
        """Return name and unit (or None) of a header cell: `time [s]`, `Time(s)`, `time_s`.

        A suffix is a unit only if the name before it has a role, so that `layer_m` stays a name.
        """
        cell = cell.strip().strip("\"'").strip()
        if cell.lower() in _MILLISECONDS:
            return cell, "ms"
        match = re.fullmatch(r"(.*?)\s*[\[({]\s*([^\])}]*?)\s*[\])}]", cell)
        if match and match[1].strip():
            return match[1].strip(), match[2]
        pieces = re.split(r"[_\s,]+", cell)
        for parts in (3, 2, 1):
            suffix = "_".join(pieces[-parts:]).replace("µ", "u").replace("μ", "u")
            name = cell[: len(cell) - len(suffix)].rstrip("_ ,")
            unit = self._suffixes.get(suffix)
            if unit is None and suffix not in _TORQUE:
                unit = self._suffixes.get(suffix.lower())
            if len(pieces) > parts and unit and self.role_of(name):
                return name, unit
        return cell, None


_MILLISECONDS = ("ms", "msec")
"""Names of a time column that are also its unit, in exports of drives."""
_TORQUE = ("Nm", "NM")
"""Suffixes that mean a torque, never nanometres."""


def _per_second(*lengths: str) -> dict[str, str]:
    """Return suffixes of velocities: um_s, um_per_s, umps."""
    return {f"{m}{per}s": f"{m}/s" for m in lengths for per in ("_", "_per_", "p")}


def _same(*units: str) -> dict[str, str]:
    return {unit: unit for unit in units}


SLIDER = Schema(
    (
        Role(
            "time",
            "s",
            "s",
            "t elapsedtime testtime timestamp exptime runtime seconds datetime dateandtime"
            " dateandtimeofday timeofday clock clocktime zeit ms msec",
            need="time",
        ),
        Role(
            "load_point_displacement",
            "m",
            "um",
            "loadpointdisp loadpointdispl lpdisplacement lpdisp lpd loadpointposition motorposition"
            " motordisplacement ramdisplacement ramdisp pistondisplacement sheardisplacement"
            " sheardisp displacement displ disp",
            need="motion",
        ),
        Role(
            "load_point_velocity",
            "m/s",
            "um/s",
            "loadpointvel lpvelocity lpvel vlp loadingvelocity loadingrate drivevelocity"
            " motorvelocity commandedvelocity velocity vel v",
            need="motion",
        ),
        Role(
            "load_point_encoder",
            "m",
            "um",
            "lpencoder encoder encoderdisplacement encoderposition motorencoder ramencoder"
            " measuredloadpoint measuredposition",
        ),
        Role(
            "friction",
            "1",
            "1",
            "frictioncoefficient coefficientoffriction frictioncoeff coefffriction cof mu μ"
            " frictionforce shearforce tangentialforce",
            need="friction",
            others=("N", "Pa"),
        ),
        Role(
            "slip",
            "m",
            "um",
            "slipdisplacement faultslip shearslip sliderdisplacement sliderposition",
        ),
        Role(
            "normal_stress",
            "Pa",
            "MPa",
            "effectivenormalstress effnormalstress effectivestress normstress norstress sigman sign"
            " σn",
            others=("N",),
        ),
        Role(
            "shear_stress",
            "Pa",
            "MPa",
            "shearstressonfault shearstr shrstress tau τ",
            need="friction",
            others=("N",),
        ),
    ),
    {
        **_same("s", "ms", "us", "min", "um", "micron", "microns", "mm", "nm", "m", "1"),
        **{"sec": "s", "n": "N", "kn": "kN", "pa": "Pa", "kpa": "kPa", "mpa": "MPa", "gpa": "GPa"},
        **_per_second("m", "mm", "um", "nm"),
    },
)
"""Friction is shear over normal stress, or shear over normal force. Friction may also be a force;
a friction column in Pa is read as shear stress."""

AXIS = Schema(
    (
        Role(
            "time",
            "s",
            "s",
            "t elapsedtime timestamp runtime seconds datetime dateandtime timeofday clock clocktime"
            " zeit ms msec",
            need="time",
        ),
        Role(
            "position",
            "m",
            "mm",
            "positionactualvalue actualposition positionactual measuredposition positionmeasured"
            " encoderposition loadposition axisposition motorposition feedbackposition"
            " positionfeedback motorangle encoder angle pos q qm theta x y displacement",
            need="motion",
            turning="rad",
        ),
        Role(
            "reference_position",
            "m",
            "mm",
            "positionreference positiondemandvalue demandposition positiondemand commandedposition"
            " positioncommand commandposition positionsetpoint setpointposition targetposition"
            " positiontarget goalposition desiredposition reference setpoint refposition posref"
            " refpos xref qref qg qd ref",
            turning="rad",
        ),
        Role(
            "velocity",
            "m/s",
            "mm/s",
            "velocityactualvalueaveraged velocityactualvalue actualvelocity velocityactual"
            " measuredvelocity motorvelocity axisvelocity angularvelocity speed actualspeed"
            " measuredspeed motorspeed servomotorspeed feedbackspeed speedfeedback velocityfeedback"
            " feedbackvelocity omega vel v",
            need="motion",
            turning="rad/s",
        ),
        Role(
            "motor_force",
            "N",
            "N",
            "motortorque torqueactualvalueaveraged torqueactualvalue actualtorque torqueactual"
            " measuredtorque drivetorque feedbacktorque torquefeedback actuatorforce driveforce"
            " drivingforce torque force effort jointeffort measuredeffort tau f",
            need="force",
            turning="N*m",
            others=("%",),
        ),
        Role(
            "control_signal",
            "V",
            "V",
            "controlvoltage commandvoltage motorvoltage drivesignal control voltage vir u",
            need="force",
        ),
        Role(
            "motor_current",
            "A",
            "A",
            "currentactualvalueaveraged currentactualvalue actualcurrent currentactual"
            " torquecurrent current iq i",
            need="force",
        ),
        Role(
            "disturbance",
            "N",
            "N",
            "disturbanceforce disturbancetorque forcedisturbance torquedisturbance inputdisturbance"
            " loaddisturbance motordisturbance addedforce addedtorque forcepulses torquepulses"
            " pulsesn pulses pulse perturbation excitationforce excitationtorque",
            turning="N*m",
            others=("%", "V", "A"),
        ),
    ),
    {
        **_same("s", "ms", "us", "m", "mm", "um", "nm", "cm", "rpm", "rad", "mrad", "deg", "rev"),
        **_same("V", "mV", "A", "mA", "N", "kN", "Nm", "mNm", "Ncm"),
        **{"NM": "Nm", "pct": "%", "percent": "%"},
        **_per_second("m", "mm", "um", "rad", "mrad", "deg", "rev"),
    },
)
"""A force may be a torque, or per cent of an unknown rated torque. A disturbance may also be a
control signal or a current, which the drive gain converts to a force."""

SIGNAL_UNITS = ("V", "A")
"""Units of control signals and motor currents."""


def has_role(cell: str) -> bool:
    """Whether the name in a header cell has a role of any rig."""
    name = SLIDER.split(cell)[0]
    return any(schema.role_of(name) is not None for schema in (SLIDER, AXIS))
