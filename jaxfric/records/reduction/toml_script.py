"""A reduction written as TOML, for laboratories without an xlook script.

    [columns.load_point_displacement]
    from = "Vert_Disp"             # a column of the file, or one made above; "#2" by number
    factor = "0.076472 um"         # size of one unit of the column
    jumps = [[18593, 19058]]       # encoder reset: the second row gets the value of the first
    zero = 1459                    # the row that becomes 0

    [columns.friction]
    ratio = ["shear_stress", "normal_stress"]

    [rows]
    remove = [[86283, 86283]]

A column has these keys, in the order of execution: `from`, `factor`, or `ratio`; `sum` (true: the
column holds intervals), `jumps`, `zero`, `elastic` (`{stress = "shear_stress", stiffness = "0.1
MPa/um"}`: subtract the elastic stretch of the frame) and `smooth` (number of rows of a running
mean). `rows` has the keys `from`, `to`, `remove` and `rising` (a column; rows where this column
does not rise are removed). Row numbers are those of the file, counted from 0. A column of the file
may be written with its unit, "Weg [mm]". The record has the columns that the script makes. If the
script makes no time, motion or friction, a column of the file with a matching header is used.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ...errors import InputError, did_you_mean, folded
from ...tables import read_toml, refuse_unknown, table_of
from ...units import factor, has_dimension, parse_quantity
from ..roles import SLIDER, Role
from ..table import Table
from . import operations as op
from .bench import Bench, BenchColumn, Done

_ROWS = ("from", "to", "remove", "rising")


class _Maker:
    """The columns that a script makes, and those of the file that it uses."""

    def __init__(self, table: Table):
        self.bench = Bench.of(table)
        self.given = len(table.names)

    def number(self, name: object) -> int:
        """Return the number of a column by its name, the last made first, or by "#2"."""
        columns = self.bench.columns
        if isinstance(name, str):
            if name.startswith("#") and name[1:].isdecimal() and int(name[1:]) <= self.given:
                return int(name[1:])
            for number in sorted(columns, reverse=True):
                if name in (columns[number].name, columns[number].shown):
                    return number
            wanted = tuple(map(folded, _parted(name)))
            for number in sorted(columns, reverse=True):
                column = columns[number]
                own = tuple(map(folded, _parted(column.name, column.unit)))
                if own[0] == wanted[0] and wanted[1] in ("", own[1]):
                    return number
        known = [column.shown for column in columns.values()]
        raise InputError(f"there is no column '{name}'{did_you_mean(str(name), known)}")

    def column(self, name: object) -> BenchColumn:
        return self.bench.columns[self.number(name)]


def _parted(name: str, unit: str = "") -> tuple[str, str]:
    """Split a name and its unit, "Weg [mm]"; '' for no unit."""
    if unit:
        return name, unit
    name, own = SLIDER.split(name)
    return name, own or ""


def run_toml(table: Table, script: Path) -> tuple[Table, tuple[Done, ...]]:
    """Reduce a table by the file `script`; return the reduced table and what each key did.

    Raises `InputError`, with the key, for a file that is not TOML, an unknown key, a value of the
    wrong type, a column or row that does not exist, and a unit of another dimension.
    """
    spec = read_toml(script)[1]
    refuse_unknown(spec, ("columns", "rows"), str(script))
    columns = table_of(spec, "columns", str(script))
    if not columns:
        raise InputError(f"{script} makes no column; write [columns.friction] and the others")
    maker = _Maker(table)
    for name in columns:
        _make(maker, script, name, table_of(columns, name, f"{script}, columns"))
    bench = maker.bench
    kept = _understood(maker)
    for number in range(1, maker.given + 1):
        if number not in kept:
            del bench.columns[number]
    _keep(maker, script, table_of(spec, "rows", str(script)))
    return bench.table(table), tuple(bench.done)


def _understood(maker: _Maker) -> set[int]:
    """Return the columns of the file that a record needs and the script does not make."""
    roles: dict[int, Role] = {}
    for number, column in maker.bench.columns.items():
        known = SLIDER.role_of(_parted(column.name, column.unit)[0])
        if known is not None:
            roles[number] = SLIDER.roles[known[0]]
    made = {role.need or role.name for n, role in roles.items() if n > maker.given}
    kept = {}
    for number, role in roles.items():
        # friction may be a quotient, which needs a normal stress
        need = "friction" if role.name == "normal_stress" else role.need
        if number <= maker.given and need and not {need, role.name} & made:
            kept[number] = role.name
    for number, role in kept.items():
        text = f"no [columns.{role}]"
        said = f"{maker.bench.columns[number].shown} of the file, which its header says to be that"
        maker.bench.done.append(Done(0, text, said))
    return set(kept)


def _make(maker: _Maker, script: Path, name: str, keys: Mapping[str, object]) -> None:
    """Make one column from its source, then apply the other keys in their order."""
    where = f"columns.{name}"
    refuse_unknown(keys, ("from", "factor", "ratio", *_STEPS), f"{script}, {where}")
    if ("from" in keys) == ("ratio" in keys):
        raise InputError(f"{script}, {where}: give either `from` or `ratio`")
    bench = maker.bench
    number = max(bench.columns) + 1
    source = "ratio" if "ratio" in keys else "from"
    for key in (source, *(key for key in _STEPS if key in keys)):
        text = f"{where}.{key} = {_written(keys[key])}"
        if key == "from" and "factor" in keys:
            text += f", factor = {_written(keys['factor'])}"
        try:
            if key == "ratio":
                values, unit = _ratio(maker, keys[key])
            elif key == "from":
                values, unit = _begun(maker, keys, SLIDER.roles.get(name))
            else:
                column = bench.columns[number]
                values, unit = _STEPS[key](maker, column, keys[key]), column.unit
            changed = bench.write(number, values, name=name, unit=unit)
        except InputError as error:
            raise InputError(f"{script}, {text}: {error}") from None
        bench.done.append(Done(0, text, changed))


def _written(value: object) -> str:
    """Write a value as in TOML, except dates."""
    return json.dumps(value, ensure_ascii=False, default=str)


def _begun(maker: _Maker, keys: Mapping[str, object], role: Role | None) -> tuple[np.ndarray, str]:
    """Return a column of the file in the unit of its `factor`, which most roles need."""
    column = maker.column(keys["from"])
    text = keys.get("factor")
    if text is None:
        return column.values, column.unit
    if not isinstance(text, str):
        raise InputError('write `factor` with its unit, as in factor = "0.05 um"')
    words = text.split(maxsplit=1)
    try:
        size, unit = float(words[0]), words[1] if len(words) > 1 else ""
    except (ValueError, IndexError):
        size, unit = 1.0, text.strip()
    if not unit and role is not None and role.unit != "1":
        example = f'factor = "{text.strip() or 1} {role.example}"'
        raise InputError(f"`factor` has no unit; write what one of it is, as in {example}")
    if unit:
        factor(unit, _si(unit), "factor")
    return column.values * size, unit


def _si(unit: str) -> str:
    """Return the SI unit of a unit of length, stress, time, force or velocity."""
    for si in ("m", "Pa", "s", "N", "m/s", "1"):
        if has_dimension(unit, si):
            return si
    raise InputError(f"'{unit}' is no unit of length, stress, time, force or velocity")


def _ratio(maker: _Maker, pair: object) -> tuple[np.ndarray, str]:
    """Return the ratio of two columns, without a unit."""
    if not (isinstance(pair, list) and len(pair) == 2):
        raise InputError('write two columns, as in ratio = ["shear_stress", "normal_stress"]')
    above, below = (maker.column(name) for name in pair)
    if not below.values.any():
        raise InputError(f"it divides by column {below.name}, which is 0 in all rows")
    size = 1.0
    if above.unit != below.unit:
        si = _si(above.unit)
        size = factor(above.unit, si, above.name) / factor(below.unit, si, below.name)
    with np.errstate(all="ignore"):
        return above.values / below.values * size, ""


def _summed(maker: _Maker, column: BenchColumn, value: object) -> np.ndarray:
    del maker
    if value is not True:
        raise InputError("it is true, or left out")
    return np.cumsum(column.values)


def _joined(maker: _Maker, column: BenchColumn, value: object) -> np.ndarray:
    values = column.values
    for first, last in _pairs(value):
        rows = maker.bench.rows(first, last)
        values = op.without_jump(values, rows.start, rows.stop - 1, flat=True)
    return values


def _zeroed(maker: _Maker, column: BenchColumn, value: object) -> np.ndarray:
    return column.values - column.values[maker.bench.row(_integer(value))]


def _corrected(maker: _Maker, column: BenchColumn, value: object) -> np.ndarray:
    """Subtract the elastic stretch of the frame; the stiffness is a text with a unit."""
    if not isinstance(value, dict) or set(value) != {"stress", "stiffness"}:
        raise InputError('write it as {stress = "shear_stress", stiffness = "0.1 MPa/um"}')
    stress = maker.column(value["stress"])
    stiffness = parse_quantity(str(value["stiffness"]), "Pa/m", "stiffness")
    sizes = factor(stress.unit, "Pa", stress.name), factor(column.unit, "m", column.name)
    return op.elastically_corrected(column.values, stress.values, stiffness * sizes[1] / sizes[0])


def _smoothed(maker: _Maker, column: BenchColumn, value: object) -> np.ndarray:
    del maker
    window = _integer(value)
    if window < 1:
        raise InputError(f"a mean over {window} rows is none: write 2 or more, or leave it out")
    return op.running_mean(column.values, window)


_STEPS: dict[str, Callable[[_Maker, BenchColumn, object], np.ndarray]] = {
    "sum": _summed,
    "jumps": _joined,
    "zero": _zeroed,
    "elastic": _corrected,
    "smooth": _smoothed,
}


def _integer(value: object) -> int:
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    raise InputError(f"{_written(value)} is not a whole number")


def _pairs(value: object) -> list[tuple[int, int]]:
    """Return pairs of rows, first and last."""
    whole = isinstance(value, list) and all(isinstance(x, list) and len(x) == 2 for x in value)
    if not whole or not isinstance(value, list):
        raise InputError("write pairs of rows, as in [[120, 180], [400, 420]]")
    return [(_integer(first), _integer(last)) for first, last in value]


def _keep(maker: _Maker, script: Path, keys: Mapping[str, object]) -> None:
    """Leave rows out; their numbers are those of the file."""
    refuse_unknown(keys, _ROWS, f"{script}, rows")
    bench = maker.bench
    mask = np.ones(len(bench), bool)
    for key in (key for key in _ROWS if key in keys):
        value = keys[key]
        try:
            if key == "from":
                mask[: bench.row(_integer(value))] = False
            elif key == "to":
                mask[bench.rows(0, _integer(value)).stop :] = False
            elif key == "remove":
                for first, last in _pairs(value):
                    mask[bench.rows(first, last)] = False
            else:
                values = maker.column(value).values
                mask[np.flatnonzero(mask)] = op.rising(values[mask])
            if not mask.any():
                raise InputError("no row is left")
        except InputError as error:
            raise InputError(f"{script}, rows.{key} = {_written(value)}: {error}") from None
    if keys:
        text = ", ".join(f"{key} = {_written(keys[key])}" for key in _ROWS if key in keys)
        bench.done.append(Done(0, f"rows.{text}", bench.keep(mask)))
