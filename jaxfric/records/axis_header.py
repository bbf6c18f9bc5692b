"""Names of the columns of a servo axis: the role that a name gives, and units of drives."""

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ..errors import InputError
from ..units import factor, has_dimension, parse_quantity
from .header import NO_COLUMN, fitting, key, numbered, split_name_unit
from .sampled import HOW

FORCE_UNITS = {"linear": "N", "rotary": "N m"}
"""Unit of the motor force by coordinate; "%" where the rated torque is not known."""

ROLES = (
    "time",
    "position",
    "reference_position",
    "velocity",
    "motor_force",
    "control_signal",
    "motor_current",
    "disturbance",
)

_SYNONYMS = {
    "time": "time t elapsedtime timestamp runtime seconds datetime dateandtime timeofday clock"
    " clocktime zeit",
    "position": "position positionactualvalue actualposition positionactual measuredposition"
    " positionmeasured encoderposition loadposition axisposition motorposition motorangle"
    " encoder angle pos q qm theta x y displacement",
    "reference_position": "referenceposition positionreference positiondemandvalue demandposition"
    " positiondemand commandedposition positioncommand commandposition positionsetpoint"
    " setpointposition targetposition positiontarget desiredposition reference setpoint"
    " refposition posref refpos xref qref qg qd ref",
    "velocity": "velocity velocityactualvalueaveraged velocityactualvalue actualvelocity"
    " velocityactual measuredvelocity motorvelocity axisvelocity angularvelocity speed actualspeed"
    " measuredspeed motorspeed omega vel v",
    "motor_force": "motorforce motortorque torqueactualvalueaveraged torqueactualvalue"
    " actualtorque torqueactual measuredtorque drivetorque actuatorforce driveforce drivingforce"
    " torque force tau f",
    "control_signal": "controlsignal controlvoltage commandvoltage motorvoltage drivesignal control"
    " voltage vir u",
    "motor_current": "motorcurrent currentactualvalueaveraged currentactualvalue actualcurrent"
    " currentactual torquecurrent current iq i",
    "disturbance": "disturbance disturbanceforce disturbancetorque forcedisturbance"
    " torquedisturbance inputdisturbance loaddisturbance motordisturbance addedforce addedtorque"
    " forcepulses torquepulses pulsesn pulses pulse perturbation excitationforce excitationtorque",
}
_RANKS = {
    name: (role, rank)
    for role, names in _SYNONYMS.items()
    for rank, name in enumerate(names.split())
}

_SI = {
    "time": ("s", "s"),
    "position": ("m", "rad"),
    "reference_position": ("m", "rad"),
    "velocity": ("m/s", "rad/s"),
    "motor_force": ("N", "N*m"),
    "control_signal": ("V", "V"),
    "motor_current": ("A", "A"),
    "disturbance": ("N", "N*m"),
}
SIGNAL_UNITS = ("V", "A")
"""A disturbance may also be recorded as a control signal or a current, which the gain turns."""
_SHOWN = {"s": "s", "m": "mm", "m/s": "mm/s", "N": "N", "V": "V", "A": "A"}
_SHOWN_OF_ROTATION = {"m": "rad", "m/s": "rad/s", "N": "N m"}
_COUNTS = {"m": ("0.1 um", "0.09 deg"), "m/s": ("0.1 mm/s", "0.1 rpm"), "N": ("0.01 N", "0.01 N m")}
"""What one machine unit may be, on a line and of a rotation."""
_ANGLE = re.compile(r"(?i)rad|deg|rev|turn|rpm|arc|cycle")
_MACHINE = re.compile(r"(?i)(inc|increments?|qc|pulses?|counts?|cts|ticks?|lsb|bits?|steps|raw)")
_PER_CENT = {"%": 1.0, "percent": 1.0, "per cent": 1.0, "‰": 0.1, "permille": 0.1}
_SUFFIXES = {text: text for text in ("s", "ms", "us", "m", "mm", "um", "nm", "cm", "rpm")}
_SUFFIXES |= {text: text for text in ("rad", "mrad", "deg", "rev", "V", "mV", "A", "mA", "N", "kN")}
_SUFFIXES |= {"Nm": "Nm", "mNm": "mNm", "Ncm": "Ncm", "pct": "%", "percent": "%"}
_SUFFIXES |= {
    f"{length}{per}s": f"{length}/s"
    for length in ("m", "mm", "um", "rad", "mrad", "deg", "rev")
    for per in ("_", "_per_", "p")
}


@dataclass(frozen=True)
class Use:
    """Column `index`; one of its units is `size` in `si_unit`."""

    index: int
    unit: str
    si_unit: str
    size: float


def si_units(coordinate: str) -> dict[str, str]:
    """SI unit of every role on a "linear" or "rotary" axis."""
    return {role: units[coordinate == "rotary"] for role, units in _SI.items()}


def shown_units(coordinate: str, force_unit: str) -> dict[str, str]:
    """Unit in which each column of a record is shown."""
    linear = coordinate == "linear"
    length = "mm" if linear else "rad"
    found = {"time": "s", "position": length, "reference_position": length}
    found |= {"velocity": f"{length}/s", "motor_force": force_unit}
    return found | {"disturbance_force": force_unit}


def role_of(name: str) -> tuple[str, int] | None:
    """Role of a column's name and its rank (0: the role's own name); None: no role."""
    return _RANKS.get(key(name))


def split(cell: str, unit: str | None) -> tuple[str, str | None]:
    """Name and unit of a header cell whose `unit` may be known: `velocity_rpm` has one too."""
    if unit is not None:
        return cell, unit
    name, unit = split_name_unit(cell)
    if unit is not None:
        return name, unit
    pieces = re.split(r"[_\s]+", cell)
    for parts in (3, 2, 1):
        suffix = "_".join(pieces[-parts:])
        name = cell[: len(cell) - len(suffix)].rstrip("_ ")
        if len(pieces) > parts and suffix in _SUFFIXES and role_of(name):
            return name, _SUFFIXES[suffix]
    return cell, None


def spelling(unit: str) -> str:
    """Units as drives write them in the spelling of `jaxfric.units`.

    `mNm`, `N-m` and `N·m` are torques; `1/min`, `min-1` and `U/min` revolutions per minute.
    """
    unit = unit.strip().replace("°", "deg").replace("·", "*").replace("−", "-")
    unit = re.sub(r"(?<![A-Za-z])([mkuµμ]?N)\s?[-.* ]?\s?([cm]?m)(?![A-Za-z])", r"\1*\2", unit)
    if re.fullmatch(r"(1|r|U|rev|rot)?/min|min\s?\^?-1|r\.?p\.?m\.?", unit, re.IGNORECASE):
        return "rpm"
    return re.sub(r"\b(rev|rot)\b", "turn", unit)


def assign(
    path: str,
    names: tuple[str, ...],
    units: tuple[str | None, ...],
    columns: Mapping[str, str],
) -> tuple[dict[str, Use], list[str]]:
    """The column of every role that there is, and notes on what was assumed.

    **Arguments:** `columns` maps roles to names of columns, `NAME` or `NAME [unit]`, or to `none`
    where no column has that role; all other roles are found by their names.

    Raises `InputError` for a role or column that does not exist, time, motion or force without
    a column, and a unit that is missing, unknown or of another dimension.
    """
    cells = [split(name, unit) for name, unit in zip(names, units, strict=True)]
    named, without = _told(path, names, cells, columns)
    found = dict(named)
    taken = {index for index, _ in found.values()}
    for role in ROLES:
        if (
            role not in {*found, *without}
            and (index := _by_name(path, cells, role, taken)) is not None
        ):
            found[role] = (index, cells[index][1])
            taken.add(index)
    _require(path, cells, found)
    for role in _not_needed(found, set(named)):
        taken.remove(found.pop(role)[0])
    rotary = _is_rotary(unit for _, unit in found.values())
    uses = {
        role: _with_unit(path, cells[found[role][0]][0], role, *found[role], rotary)
        for role in ROLES
        if role in found
    }
    notes = [
        f"column '{cells[use.index][0]}' is {role}"
        for role, use in uses.items()
        if key(cells[use.index][0]) != key(role)
    ]
    ignored = [name for i, name in enumerate(names) if i not in taken]
    return uses, notes + ([f"ignored columns: {', '.join(ignored)}"] if ignored else [])


def coordinate_of(path: str, uses: Mapping[str, Use]) -> str:
    """ "linear" or "rotary", by the units of motion and force, which must agree."""
    kinds: dict[str, str] = {}
    for role, use in uses.items():
        linear, rotary = _SI[role]
        if linear != rotary and use.si_unit in (linear, rotary):
            kinds[role] = "linear" if use.si_unit == linear else "rotary"
    if len(set(kinds.values())) > 1:
        shown = ", ".join(f"{role} [{uses[role].unit}] is {kind}" for role, kind in kinds.items())
        kept = kinds.get("motor_force", next(iter(kinds.values())))
        role = next(role for role, kind in kinds.items() if kind != kept)
        unit = ("0.8 rad" if kept == "rotary" else "0.8 mm") + "/s" * (role == "velocity")
        raise InputError(
            f"{path}: units of a line and of a rotation: {shown}; give motion and force on one"
            f" side of the screw or gear, as in --column '{role}=NAME [{unit}]'"
        )
    return next(iter(kinds.values()), "rotary")


def quantity_of(text: str, si_unit: str, what: str) -> float:
    """The value of a text such as "9.84 mNm" or "35.15 N/V"; positive."""
    number, _, unit = text.strip().partition(" ")
    spelt = unit if si_unit == "1/s" else spelling(unit)  # 1/min is a rate there, no rotation
    value = parse_quantity(f"{number} {spelt}" if unit else spelling(text), si_unit, what)
    if not value > 0:
        raise InputError(f"{what}: '{text}' is not positive")
    return value


def _told(
    path: str,
    names: tuple[str, ...],
    cells: list[tuple[str, str | None]],
    columns: Mapping[str, str],
) -> tuple[dict[str, tuple[int, str | None]], set[str]]:
    """Columns and units that the user names by role, and the roles that no column has."""
    for role in columns:
        if role not in ROLES:
            raise InputError(f"'{role}' is no role of a column{_nearest(role, list(ROLES))}")
    without = {
        role
        for role, text in columns.items()
        if text.strip() == NO_COLUMN and NO_COLUMN not in names
    }
    kept = {role: text for role, text in columns.items() if role not in without}
    return {role: _named(path, names, cells, role, text) for role, text in kept.items()}, without


def _named(
    path: str,
    names: tuple[str, ...],
    cells: list[tuple[str, str | None]],
    role: str,
    text: str,
) -> tuple[int, str | None]:
    """Column and unit that the user names for a role."""
    name, unit = split(text, None)
    if (index := numbered(name, len(names))) is not None:
        return index, unit if unit is not None else cells[index][1]
    for wanted, override in ((text, None), (name, unit)):
        for have in (list(names), [cell for cell, _ in cells]):
            for same in (str.strip, key):
                hits = [i for i, one in enumerate(have) if same(one) == same(wanted)]
                if len(hits) == 1:
                    return hits[0], override if override is not None else cells[hits[0]][1]
    raise InputError(f"{path} has no column '{name}' for {role}{_nearest(name, list(names))}")


def _by_name(
    path: str, cells: list[tuple[str, str | None]], role: str, taken: set[int]
) -> int | None:
    """The column whose name fits the role best; an equal fit of two is an error."""
    fits: list[tuple[int, int]] = []
    for index, (name, _) in enumerate(cells):
        known = role_of(name)
        if index not in taken and known is not None and known[0] == role:
            fits.append((known[1], index))
    fits.sort()
    best = [index for rank, index in fits if rank == fits[0][0]]
    spelt = [None if unit is None else spelling(unit) for _, unit in cells]
    best = fitting(best, spelt, (*_SI[role], *SIGNAL_UNITS * (role == "disturbance")))
    if len(best) > 1:
        both = " and ".join(f"'{cells[i][0]}' (column {i + 1})" for i in best[:2])
        raise InputError(
            f"{path}: {both} could both be {role}; say which, as in --column"
            f" '{role}=#{best[0] + 1}'"
        )
    return best[0] if best else None


def _not_needed(found: Mapping[str, tuple[int, str | None]], named: set[str]) -> list[str]:
    """Roles that a file can do without, found by a name alone: no unit tells what they are.

    A disturbance is not among them, for a fit without it would be wrong: it needs a unit, or the
    word that there is none.
    """
    spare = {"reference_position"}
    spare |= {"velocity"} if "position" in found else set()
    spare |= {"control_signal", "motor_current"} if "motor_force" in found else set()
    unknown = [role for role in found if role in spare - named and found[role][1] is None]
    added = found.get("disturbance", (0, None))[1]
    if "disturbance" not in named and added is not None and not _is_drive_unit(added):
        unknown.append("disturbance")  # pulses that an encoder counts, a speed of a load
    return unknown


def _require(
    path: str, cells: list[tuple[str, str | None]], found: Mapping[str, tuple[int, str | None]]
) -> None:
    """Time, a motion and something that becomes a force must be there."""
    missing = [] if "time" in found else ["time"]
    if not {"position", "velocity"} & set(found):
        missing.append("position")
    if not {"motor_force", "control_signal", "motor_current"} & set(found):
        missing.append("motor_force")
    if not missing:
        return
    have = ", ".join(name if unit is None else f"{name} [{unit}]" for name, unit in cells)
    unit = {"time": "s", "position": "mm", "motor_force": "N"}[missing[0]]
    hint = _nearest(missing[0], [name for name, _ in cells], listed=False) or ";"
    rate = f", {HOW}" if "time" in missing else ""
    raise InputError(
        f"{path} has no column for {' and '.join(missing)}; it has: {have}{hint} map one, as in"
        f" --column '{missing[0]}=NAME [{unit}]'{rate}"
    )


def _is_rotary(units: Iterable[str | None]) -> bool:
    """Whether the units that are known are rather of a rotation: examples follow them."""
    pairs = [pair for pair in set(_SI.values()) if pair[0] != pair[1]]
    told = [spelling(unit) for unit in units if unit]
    spelt = [one for one in told if not _MACHINE.fullmatch(one) and one.lower() not in _PER_CENT]
    linear, rotary = (sum(has_dimension(one, p[k]) for one in spelt for p in pairs) for k in (0, 1))
    return rotary > linear


def _with_unit(
    path: str, name: str, role: str, index: int, unit: str | None, of_rotation: bool
) -> Use:
    """The size of the unit of a column in SI, linear or rotary."""
    what = f"{path}, column '{name}' ({role})"
    linear, rotary = _SI[role]
    if not unit:
        shown = _SHOWN | _SHOWN_OF_ROTATION if of_rotation else _SHOWN
        example = shown[linear]
        leave = f", or leave it out: --column {role}={NO_COLUMN}" if role == "disturbance" else ""
        raise InputError(
            f"{what} has no unit; give it, as in --column '{role}={name} [{example}]'{leave}"
        )
    spelt = spelling(unit)
    if role in ("motor_force", "disturbance") and spelt.lower() in _PER_CENT:
        return Use(index, unit, "%", _PER_CENT[spelt.lower()])
    signal = next((one for one in SIGNAL_UNITS if has_dimension(spelt, one)), None)
    if role == "disturbance" and signal is not None:
        return Use(index, unit, signal, factor(spelt, signal, what))
    if _MACHINE.fullmatch(spelt):
        example = _COUNTS[linear][of_rotation] if linear in _COUNTS else f"0.01 {linear}"
        raise InputError(
            f"{what}: '{unit}' is a machine unit; give what one of it is, as in"
            f" --column '{role}={name} [{example}]'"
        )
    if linear != rotary and role not in ("motor_force", "disturbance"):
        si_unit = rotary if _ANGLE.search(spelt) else linear
    else:
        si_unit = rotary if has_dimension(spelt, rotary) else linear
    return Use(index, unit, si_unit, factor(spelt, si_unit, what))


def _is_drive_unit(unit: str) -> bool:
    """Whether a unit is of a force, torque, control signal or per cent of a rated torque."""
    spelt = spelling(unit)
    return spelt.lower() in _PER_CENT or any(
        has_dimension(spelt, one) for one in (*_SI["disturbance"], *SIGNAL_UNITS)
    )


def _nearest(name: str, known: list[str], listed: bool = True) -> str:
    """Did you mean ...? And what there is."""
    by_key = {key(one): one for one in known}
    close = difflib.get_close_matches(key(name), by_key, n=1, cutoff=0.55)
    hint = f"; did you mean '{by_key[close[0]]}'?" if close else ""
    return hint + (f"; there are: {', '.join(known)}" if listed else "")
