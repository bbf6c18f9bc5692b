"""Find the roles and units of the columns of a table, for sliders and axes alike."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import InputError, did_you_mean, either, folded, option
from ..units import factor, has_dimension, scale
from .axis_units import spelling
from .record import EMPTY_ROWS, Provenance
from .roles import AXIS, NO_COLUMN, SLIDER, Role, Schema
from .rows import FileRows
from .table import Table, filled_rows, with_stated

_ANGLE = re.compile(r"(?i)rad|deg|rev|turn|rpm|arc|cycle")
_MACHINE = re.compile(
    r"(?i)(inc|increments?|qc|pulses?|counts?|cts|ticks?|lsb|bits?|steps|raw|adu)"
)
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*")
_PER_CENT = {"%": 1.0, "percent": 1.0, "per cent": 1.0, "‰": 0.1, "permille": 0.1}


class Use(NamedTuple):
    """A used column of a table; `size` converts its `unit` in the file to `si_unit`."""

    column: int
    unit: str
    si_unit: str
    size: float


Found = dict[str, tuple[int, str | None]]
"""Column index and unit as written, by role."""

Settle = Callable[[Table, Found, set[str]], list[str]]
"""A function that adjusts the found columns before a missing column is refused. The function may
drop columns, and returns notes. Its set holds the roles that the user named."""


class Understood(NamedTuple):
    """The columns of a file by role, in SI, without empty rows at the start and end."""

    table: Table
    uses: dict[str, Use]
    values: dict[str, np.ndarray]
    rows: FileRows
    origin: Provenance


def understand(
    table: Table, columns: Mapping[str, str] | None, schema: Schema, settle: Settle
) -> Understood:
    """Find the columns of all roles of `schema`, and convert these columns to SI.

    **Arguments:** `columns` maps roles to names of columns, `NAME` or `NAME [unit]`. The name
    `none` means that no column has the role. `time` may map to a sampling rate or interval, and
    `load_point_velocity` to a constant speed.

    Raises `InputError` as `assign` does, and for columns of different length.
    """
    known = {role: name for role, name in table.roles.items() if role in schema.roles}
    table, columns = with_stated(table, {**known, **(columns or {})})
    table = _with_suffixes(table, schema)
    uses, notes = assign(table, columns, schema, settle)
    rows = _rows(table, uses)
    filled = filled_rows(table.blank, (use.column for use in uses.values()), len(rows.lines))
    empty = len(rows.lines) - (filled.stop - filled.start)
    with np.errstate(all="ignore"):  # a later check refuses overflows and names the row
        values = {
            role: scale(table.columns[use.column][filled], use.size) for role, use in uses.items()
        }
    origin = Provenance(
        table.path,
        table.sha256,
        rows_read=empty,
        dropped={EMPTY_ROWS: empty} if empty else {},
        notes=(*table.notes, *notes),
        reduction=table.reduction,
        stated=table.stated,
    )
    return Understood(table, uses, values, rows.part(filled), origin)


def assign(
    table: Table, columns: Mapping[str, str], schema: Schema, settle: Settle
) -> tuple[dict[str, Use], list[str]]:
    """Return the column of every role in the table, and notes on assumptions.

    **Arguments:** as for `understand`. Roles missing in `columns` are found by the columns' names.

    Raises `InputError` for a role or column that does not exist, a required role without
    a column, and a unit that is missing, unknown or of another dimension.
    """
    roles = schema.roles
    if schema is SLIDER:
        columns = {FORCES.get(role, role): text for role, text in columns.items()}
    for role in columns:
        if role not in roles:
            raise InputError(f"'{role}' is no role of a column{did_you_mean(role, roles)}")
    no_column = NO_COLUMN not in table.names
    without = {role for role, text in columns.items() if no_column and text.strip() == NO_COLUMN}
    found: Found = {
        role: _named(table, schema, role, text)
        for role, text in columns.items()
        if role not in without
    }
    named = set(found)
    taken = {index for index, _ in found.values()}
    for name, role in roles.items():
        if name in found or name in without:
            continue
        if (index := _by_name(table, schema, role, taken)) is not None:
            found[name] = (index, table.units[index])
            taken.add(index)
    notes = settle(table, found, named)
    _require(table, schema, found)
    linear, turning = _kinds((unit for _, unit in found.values()), roles.values())
    rotary = turning > linear
    for name, (index, unit) in found.items():
        _refuse_other_role(table, roles, roles[name], index, unit)
    _refuse_without_units(table, roles, found, rotary if linear or turning else None)
    uses = {
        name: _with_unit(table, role, *found[name], rotary)
        for name, role in roles.items()
        if name in found
    }
    notes += [
        f"column '{table.names[use.column]}' is"
        f" {role.replace('_stress', '_force') if use.si_unit == 'N' else role}"
        for role, use in uses.items()
        if folded(table.names[use.column]) != folded(role)
    ]
    used = {use.column for use in uses.values()}
    ignored = [name for i, name in enumerate(table.names) if i not in used]
    return uses, notes + ([f"ignored columns: {', '.join(ignored)}"] if ignored else [])


FORCES = {"shear_force": "shear_stress", "normal_force": "normal_stress"}
"""Roles for users who recorded forces instead of stresses."""


def spelt(unit: str | None) -> str:
    """Return a header's unit in the spelling of `jaxfric.units`; '' for None."""
    return "" if unit is None else spelling(unit)


def fits(unit: str, si_unit: str) -> bool:
    """Whether a unit, as `spelt`, has the dimension of `si_unit`, which may be "%"."""
    return _per_cent(unit) is not None if si_unit == "%" else has_dimension(unit, si_unit)


def _per_cent(unit: str) -> float | None:
    """Return the size in per cent of a unit such as "0.113 %"; None for other units."""
    number, size = _NUMBER.match(unit), _PER_CENT.get(_NUMBER.sub("", unit, count=1).lower())
    return None if size is None else size * (float(number[1]) if number else 1.0) or None


def _with_suffixes(table: Table, schema: Schema) -> Table:
    """Return the table with unit suffixes split off its names: `velocity_rpm`."""
    cells = [
        (name, unit) if unit is not None else schema.split(name)
        for name, unit in zip(table.names, table.units, strict=True)
    ]
    return replace(table, names=tuple(n for n, _ in cells), units=tuple(u for _, u in cells))


def _rows(table: Table, uses: Mapping[str, Use]) -> FileRows:
    """Return the rows of the used columns; refuse vectors of different length (MATLAB files)."""
    sizes = {role: len(table.columns[use.column]) for role, use in uses.items()}
    if len(set(sizes.values())) > 1:
        shown = ", ".join(
            f"{role} ('{table.names[uses[role].column]}') {size}" for role, size in sizes.items()
        )
        raise InputError(
            f"{table.path}: columns of different length: {shown}; cut them to the same rows"
        )
    size = next(iter(sizes.values()))
    return FileRows(table.lines[:size], table.malformed[:size], table.text)


def _named(table: Table, schema: Schema, role: str, text: str) -> tuple[int, str | None]:
    """Return the column and the unit that the user gave for a role."""
    name, unit = schema.split(text)
    number = re.fullmatch(r"#(\d+)", name.strip())
    if number and 0 < int(number[1]) <= len(table.names):
        index = int(number[1]) - 1
        return index, unit if unit is not None else table.units[index]
    dimension = () if unit is None else (unit.lstrip("+-.0123456789eE "),)
    spelled = [(text, None)] if folded(text) != folded(name) or unit is None else []  # not of a "%"
    for wanted, override in (*spelled, (name, unit), (schema.split(name)[0], unit)):
        for same in (str.strip, folded):
            hits = [i for i, have in enumerate(table.names) if same(have) == same(wanted)]
            hits = _fitting(hits, table.units, () if override is None else dimension)
            if len(hits) == 1:
                return hits[0], override if override is not None else table.units[hits[0]]
    raise InputError(
        f"{table.path} has no column '{name}' for {role}{did_you_mean(name, table.names)}"
    )


def _by_name(table: Table, schema: Schema, role: Role, taken: set[int]) -> int | None:
    """Return the column whose name fits the role best; raise if two fit equally well."""
    fits: list[tuple[int, int]] = []
    for index, name in enumerate(table.names):
        known = schema.role_of(name)
        if index not in taken and known is not None and known[0] == role.name:
            fits.append((known[1], index))
    best = [index for rank, index in fits if rank == min(fits)[0]]
    best = _fitting(best, table.units, role.units)
    if len(best) > 1:
        both = " and ".join(f"'{table.names[i]}' (column {i + 1})" for i in best[:2])
        raise InputError(
            f"{table.path}: {both} could both be {role.name}; say which, as in"
            f" {option('column', f'{role.name}=#{best[0] + 1}')}"
        )
    return best[0] if best else None


def _fitting(indices: list[int], units: Sequence[str | None], wanted: Iterable[str]) -> list[int]:
    """Return the columns with a unit of a wanted dimension; all of them if there are none."""
    if len(indices) < 2:
        return indices
    good = [i for i in indices if units[i] and any(fits(spelt(units[i]), one) for one in wanted)]
    return good or indices


def _require(table: Table, schema: Schema, found: Found) -> None:
    """Raise `InputError` if a record needs a column that was not found."""
    needs: dict[str, list[str]] = {}
    for role in schema.roles.values():
        if role.need:
            needs.setdefault(role.need, []).append(role.name)
    missing = [names[0] for names in needs.values() if not found.keys() & names]
    if not missing:
        return
    turns = _kinds(table.units, AXIS.roles.values())[1] > 0
    unit = schema.roles[missing[0]].shown(rotary=turns)
    often = f", or state how often rows were taken: {option('column', 'time=1 kHz')}"
    rate = often if "time" in missing else ""
    if table.doubt:
        raise InputError(
            f"{table.path}: {table.doubt}; columns are numbered #1, #2, ...: say by number which is"
            f" {', '.join(missing)}, as in {option('column', f'{missing[0]}=#1 [{unit}]')}{rate}"
        )
    axis = either(
        "--rig axis ('jaxfric inspect') or 'jaxfric axis'",
        "jaxfric.read_axis or jaxfric.close_axis_loop",
    )
    lacks = f"{table.path} has no column for {' and '.join(missing)}; it has: {table.describe()}"
    if schema is SLIDER and _of_an_axis(table):
        raise InputError(f"{lacks}. These are of a servo axis, which is read with {axis}")
    machine = next((one for one in table.units if one and _MACHINE.fullmatch(spelt(one))), None)
    hint = did_you_mean(missing[0], table.names, listed=False) or ";"
    if machine is not None:
        unit = unit if unit in ("s", "1") else f"0.01 {unit}"
        hint = f" ({machine} are machine units: give the size of one);"
    text = f"{lacks}{hint} map one, as in {option('column', f'{missing[0]}=NAME [{unit}]')}{rate}"
    if schema is SLIDER and turns:
        text += f"; for an axis or a joint: {axis}"
    if "load_point_displacement" in missing:
        text += f"; if its speed is constant: {option('column', 'load_point_velocity=10 um/s')}"
    if "position" in missing:
        text += f"; a velocity will do: {option('column', 'velocity=NAME [rpm]')}"
    if "motor_force" in missing:
        gain = schema.roles["motor_force"].shown(rotary=turns)
        text += (
            "; for a control signal, or the motor's current:"
            f" {option('column', 'control_signal=NAME [V]')} or"
            f" {option('column', 'motor_current=NAME [A]')}, with"
            f" {option('drive-gain', f'0.05 {gain}/V')} (or /A)"
        )
    if "friction" in missing:
        text += (
            "; for shear and normal force, or stress:"
            f" {option('column', 'shear_force=NAME [kN]', 'normal_force=NAME [kN]')}"
        )
    raise InputError(text)


def _of_an_axis(table: Table) -> bool:
    """Whether the table has columns of a servo axis: its position and its motor."""
    known = [AXIS.role_of(name) for name in table.names]
    needs = {AXIS.roles[one[0]].need for one in known if one is not None}
    return "force" in needs and any(one is not None and one[0] == "position" for one in known)


def _kinds(units: Iterable[str | None], roles: Iterable[Role]) -> tuple[int, int]:
    """Count the known units of linear motion, and those of rotation."""
    pairs = {(role.unit, role.turning) for role in roles if role.turning}
    told = [spelt(unit) for unit in units if unit]
    known = [one for one in told if not _MACHINE.fullmatch(one) and not fits(one, "%")]
    linear, rotary = (sum(has_dimension(one, p[k]) for one in known for p in pairs) for k in (0, 1))
    return linear, rotary


def _refuse_other_role(
    table: Table, roles: Mapping[str, Role], role: Role, index: int, unit: str | None
) -> None:
    """Raise if the unit belongs to another role of the same need, as for a current named force."""
    read = spelt(unit or "")
    if not read or not role.need or any(fits(read, one) for one in role.units):
        return
    others = (r for r in roles.values() if r.need == role.need)
    other = next((r for r in others if fits(read, r.unit)), None)
    if other is not None:
        name = table.names[index]
        raise InputError(
            f"{table.path}, column '{name}' ({role.name}): '{unit}' is a unit of {other.name};"
            f" assign that role: {option('column', f'{other.name}={name} [{unit}]')}"
        )


def _refuse_without_units(
    table: Table, roles: Mapping[str, Role], found: Found, rotary: bool | None
) -> None:
    """Raise one error for all columns that lack a unit they need; `rotary` None: not known."""
    bare = [
        roles[name] for name, (_, unit) in found.items() if not unit and roles[name].unit != "1"
    ]
    if not bare:
        return
    names = {role.name: table.names[found[role.name][0]] for role in bare}
    these = " and ".join(f"'{names[role.name]}' ({role.name})" for role in bare)
    each = [(role, role.shown(rotary=bool(rotary))) for role in bare]
    give = option("column", *(f"{role.name}={names[role.name]} [{unit}]" for role, unit in each))
    turning = next((role for role in bare if role.turning and rotary is None), None)
    either = f", or [{turning.shown(rotary=True)}] where it turns" if turning else ""
    share = ", of a duty cycle what 1 is: [24 V]" if "control_signal" in names else ""
    unwanted = [f"{role.name}={NO_COLUMN}" for role in bare if not role.need]
    spare = option("column", *unwanted) if unwanted else ""
    leave = f", or leave {'it' if len(bare) == 1 else 'what is not needed'} out: {spare}"
    lacks, it = ("has", "it") if len(bare) == 1 else ("have", "them")
    raise InputError(
        f"{table.path}, column{'s' * (len(bare) > 1)} {these} {lacks} no unit; give {it}, as in"
        f" {give}{either}{share}{leave if spare else ''}"
    )


def _with_unit(table: Table, role: Role, index: int, unit: str | None, rotary: bool) -> Use:
    """Return the use of a column, with the size of its unit in SI."""
    name, example = table.names[index], role.shown(rotary=rotary)
    what = f"{table.path}, column '{name}' ({role.name})"
    read = spelt(unit)
    if _MACHINE.fullmatch(read):
        raise InputError(
            f"{what}: '{unit}' is a machine unit; give the size of one, as in"
            f" {option('column', f'{role.name}={name} [0.01 {example}]')}"
        )
    si_unit = _si_unit(role, read)
    per_cent = _per_cent(read) if si_unit == "%" else None
    size = factor(read, si_unit, what) if per_cent is None else per_cent
    return Use(index, unit or "1", si_unit, size)


def _si_unit(role: Role, unit: str) -> str:
    """Return the SI unit of a role that fits a column's unit; by default the role's first."""
    for one in role.units[1:]:
        # pint takes angles as dimensionless, so that 1/s would pass for rad/s
        if _ANGLE.search(unit) if one.startswith("rad") else fits(unit, one):
            return one
    return role.unit
