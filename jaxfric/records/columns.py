"""Which column of a table plays which role, and in which unit."""

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass

from ..errors import InputError
from ..units import factor, has_dimension
from . import axis_header
from .header import COLUMN_ROLES, NO_COLUMN, fitting, key, numbered, role_of, split_name_unit
from .sampled import HOW
from .table import Table


@dataclass(frozen=True)
class Assigned:
    """Column `index` of the table; one of its units is `size` in `si_unit`."""

    index: int
    unit: str
    si_unit: str
    size: float


def assign(table: Table, columns: Mapping[str, str]) -> tuple[dict[str, Assigned], list[str]]:
    """The column of every role that the table has, and notes on what was assumed.

    **Arguments:** `columns` maps roles to names of columns, `NAME` or `NAME [unit]`, or to
    `none` where no column has that role; all other roles are found by their names. Without
    friction, or with one that is a stress, there are `shear_stress` and `normal_stress`.

    Raises `InputError` for a role or column that does not exist, a required role without
    a column, and a unit that is missing, unknown or of another dimension.
    """
    _refuse_unknown(columns)
    without = {role for role, value in columns.items() if _is_none(table, value)}
    named = {r: _named(table, r, value) for r, value in columns.items() if r not in without}
    found = dict(named)
    taken = {index for index, _ in found.values()}
    for role in COLUMN_ROLES:
        if role in {*found, *without}:
            continue
        if (index := _by_name(table, role, taken)) is not None:
            found[role] = (index, table.units[index])
    notes = _stresses(table, found, set(named))
    _require(table, found)
    roles = [role for role in COLUMN_ROLES if role in found]
    assigned = {role: _with_unit(table, role, *found[role]) for role in roles}
    notes += [
        f"column '{table.names[use.index]}' is {role}"
        for role, use in assigned.items()
        if key(table.names[use.index]) != key(role)
    ]
    used = {use.index for use in assigned.values()}
    ignored = [name for i, name in enumerate(table.names) if i not in used]
    if ignored:
        notes.append(f"ignored columns: {', '.join(ignored)}")
    return assigned, notes


def _refuse_unknown(columns: Mapping[str, str]) -> None:
    known = list(COLUMN_ROLES)
    for role in columns:
        if role not in known:
            raise InputError(f"'{role}' is no role of a column{_nearest(role, known)}")


def _is_none(table: Table, value: str) -> bool:
    return value.strip() == NO_COLUMN and NO_COLUMN not in table.names


def _stresses(table: Table, found: dict[str, tuple[int, str | None]], named: set[str]) -> list[str]:
    """Leave either friction or two stresses in `found`; a note where friction is computed."""
    unit = found["friction"][1] if "friction" in found else None
    is_stress = unit is not None and has_dimension(unit, "Pa")
    if is_stress and "normal_stress" in found and "shear_stress" not in found:
        found["shear_stress"] = found.pop("friction")
    if "shear_stress" in found and "friction" in found:
        found.pop("friction" if "shear_stress" in named - {"friction"} else "shear_stress")
    if "shear_stress" not in found:
        return []
    shear = table.names[found["shear_stress"][0]]
    if "normal_stress" not in found:
        raise InputError(
            f"{table.path} has a shear stress, '{shear}', and neither friction nor a normal stress;"
            f" it has: {table.describe()}; map one, as in --column 'normal_stress=NAME [MPa]'"
        )
    return [f"friction is '{shear}' over '{table.names[found['normal_stress'][0]]}'"]


def _named(table: Table, role: str, value: str) -> tuple[int, str | None]:
    """Column and unit that the user names for a role."""
    name, unit = split_name_unit(value)
    if (index := numbered(name, len(table.names))) is not None:
        return index, unit if unit is not None else table.units[index]
    for wanted, override in ((value, None), (name, unit)):
        for same in (str.strip, key):
            hits = [i for i, have in enumerate(table.names) if same(have) == same(wanted)]
            hits = fitting(hits, table.units, () if override is None else (override,))
            if len(hits) == 1:
                return hits[0], override if override is not None else table.units[hits[0]]
    raise InputError(
        f"{table.path} has no column '{name}' for {role}{_nearest(name, list(table.names))}"
    )


def _by_name(table: Table, role: str, taken: set[int]) -> int | None:
    """The column whose name fits the role best; an equal fit of two is an error."""
    fits: list[tuple[int, int]] = []
    for index, name in enumerate(table.names):
        known = role_of(name)
        if index not in taken and known is not None and known[0] == role:
            fits.append((known[1], index))
    fits.sort()
    best = [index for rank, index in fits if rank == fits[0][0]]
    best = fitting(best, table.units, _dimensions(role))
    if len(best) > 1:
        names = " and ".join(f"'{table.names[i]}' (column {i + 1})" for i in best[:2])
        raise InputError(
            f"{table.path}: {names} could both be {role}; say which, as in --column"
            f" '{role}=#{best[0] + 1}'"
        )
    return best[0] if best else None


def _dimensions(role: str) -> tuple[str, ...]:
    return ("1", "N", "Pa") if role == "friction" else (COLUMN_ROLES[role],)


def _require(table: Table, found: Mapping[str, object]) -> None:
    """Time, friction and a load point must be there."""
    moves = ("load_point_displacement", "load_point_velocity")
    missing = [role for role in ("time", "friction") if role not in found]
    if "shear_stress" in found and "friction" in missing:
        missing.remove("friction")
    if not any(role in found for role in moves):
        missing.insert(0, moves[0])
    if not missing:
        return
    if table.doubt:
        missing.sort(key=list(COLUMN_ROLES).index)
        unit = {"friction": "1", "time": "s"}.get(missing[0], "um")
        raise InputError(
            f"{table.path}: {table.doubt}; say by number which column is {', '.join(missing)}, as"
            f" in --column '{missing[0]}=#1 [{unit}]'{_or_rate(missing)}"
        )
    if _of_an_axis(table):
        raise InputError(
            f"{table.path} has no column for {' and '.join(missing)}; it has: {table.describe()}."
            " These are of a servo axis, which is read with --rig axis ('jaxfric record', 'jaxfric"
            " loop')"
        )
    machine = any((unit or "").lower() in ("bit", "bits") for unit in table.units)
    hint = (
        " (bits are machine units: give what one bit is)"
        if machine
        else _nearest(missing[0], list(table.names), listed=False)
    )
    hint = hint if hint.endswith("?") else hint + ";"
    unit = {"friction": "1", "time": "s"}.get(missing[0], "0.01 um" if machine else "um")
    raise InputError(
        f"{table.path} has no column for {' and '.join(missing)}; it has: {table.describe()}"
        f"{hint} map one, as in --column '{missing[0]}=NAME [{unit}]'{_or_rate(missing)}"
    )


def _or_rate(missing: list[str]) -> str:
    return f", {HOW}" if "time" in missing else ""


def _of_an_axis(table: Table) -> bool:
    """Whether the columns are those of a servo axis: its position and its motor."""
    known = [axis_header.role_of(name) for name in table.names]
    roles = {one[0] for one in known if one is not None}
    motor = {"motor_force", "control_signal", "motor_current"}
    return "position" in roles and bool(roles & motor)


def _with_unit(table: Table, role: str, index: int, unit: str | None) -> Assigned:
    """The size of the unit of a column in SI."""
    what = f"{table.path}, column '{table.names[index]}' ({role})"
    si_unit = COLUMN_ROLES[role]
    if unit is None and si_unit != "1":
        shown = {"s": "s", "m": "um", "m/s": "um/s", "Pa": "MPa"}[si_unit]
        raise InputError(
            f"{what} has no unit; write '{table.names[index]} [{shown}]' in the header"
        )
    if role == "friction" and re.search(r"(?i)deg|rad|°", unit or ""):
        raise InputError(f"{what} is an angle [{unit}]; friction is its tangent: write that")
    if role == "friction" and has_dimension(unit or "", "N"):
        si_unit = "N"
    elif role == "friction" and has_dimension(unit or "", "Pa"):
        raise InputError(
            f"{what} is a stress [{unit}]; friction is a coefficient or a force [N], or shear over"
            " normal stress: map the latter, as in --column 'normal_stress=NAME [MPa]'"
        )
    return Assigned(index, unit or "1", si_unit, factor(unit or "", si_unit, what))


def _nearest(name: str, known: list[str], listed: bool = True) -> str:
    """Did you mean ...? And what there is."""
    by_key = {key(one): one for one in known}
    close = difflib.get_close_matches(key(name), by_key, n=1, cutoff=0.55)
    hint = f"; did you mean '{by_key[close[0]]}'?" if close else ""
    return hint + (f"; there are: {', '.join(known)}" if listed else "")
