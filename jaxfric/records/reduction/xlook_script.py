"""xlook's command files, with which Penn State's laboratories and others reduce a run.

A line is a command and its arguments, separated by blanks or commas. Columns are counted from 1,
rows from 0, and -1 is the last row. `#` begins a comment, `end` ends the script. Commands that
compute are executed. Commands that plot, list or fit are only named in the log. An unknown command
is an error, so that nothing is skipped silently.

Source: github.com/PennStateRockandSedimentMechanics/xlook, `cmds.c` and `event.c`.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, TypedDict

import numpy as np

from ...errors import InputError, did_you_mean
from ..table import Table
from . import operations as op
from .bench import Bench, Done

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_MATH = re.compile(
    rf"(\d+)\s*([-+*/])\s*({_NUMBER})\s*([=:])\s*(\d+)((?:\s+-?\d+\s+-?\d+)?)\s+(\S+)\s+(\S+)"
)
_SHOWS = re.compile(
    r"(plot|pdf|type|stat|examin)\w*|pa|q|quit|kp|kw|nw|aw|ap|kill_\w+|new_window|activate_\w+"
    r"|head|getaschead|all|set_path|comment|mem"
)
_FITS = re.compile(r"qi(_\w+)?(\.\w+)?|fric_tool|scm\w*|rsm|cm|simplex\w*")
_ELSEWHERE = {
    "append": "reads another file; give one that has all of the run",
    "doit": "runs another script; put its lines here",
    "write": "writes a file, which jaxfric does itself: leave the line out",
}
_WORKS = {"begin", "com_file"}
_FUNCTIONS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "exp": np.exp,
    "ln": np.log,
    "log": np.log10,
    "recip": np.reciprocal,
    "positive": lambda values: (values > 0).astype(float),
    "r_mean": lambda values: values - values.mean(),
    "z_min": lambda values: values - values.min(),
    "z_max": lambda values: values - values.max(),
}


class _Named(TypedDict):
    """Name and unit of a column."""

    name: str
    unit: str


class _Call(NamedTuple):
    """A command with its arguments."""

    bench: Bench
    command: str
    words: list[str]

    def integers(self, *places: int) -> list[int]:
        """Return the arguments at these places as integers."""
        return [int(self._number(place, "a whole number", int)) for place in places]

    def real(self, place: int) -> float:
        """Return an argument as a number."""
        return self._number(place, "a number", float)

    def _number(self, place: int, what: str, kind: Callable[[str], float]) -> float:
        try:
            return kind(self.words[place])
        except ValueError:
            raise InputError(f"'{self.words[place]}' is not {what}") from None


def run_xlook(table: Table, script: Path) -> tuple[Table, tuple[Done, ...]]:
    """Reduce a table by xlook's commands in the file `script`; return it and what each command did.

    Raises `InputError`, with the line, for an unknown command, missing arguments, a column or row
    that does not exist, division by a column of zeros, and a script that removes all rows or cannot
    be read.
    """
    bench = Bench.of(table)
    for number, line in enumerate(_lines(script), 1):
        text = line.split("#")[0].strip()
        if not text:
            continue
        command, *words = text.replace(",", " ").split()
        if command == "end":
            break
        try:
            changed = _carried_out(bench, command, words, text, table)
        except InputError as error:
            raise InputError(f"{script}, line {number}, '{text}': {error}") from None
        if changed:
            bench.done.append(Done(number, text, changed))
        if not len(bench):
            raise InputError(f"{script}, line {number}, '{text}': no row is left")
    return bench.table(table), tuple(bench.done)


def _lines(script: Path) -> list[str]:
    try:
        return script.read_bytes().decode("utf-8", errors="replace").splitlines()
    except FileNotFoundError:
        raise InputError(f"{script}: there is no such file") from None
    except OSError as error:
        raise InputError(f"{script} cannot be read: {error.strerror or error}") from None


def _carried_out(bench: Bench, command: str, words: list[str], text: str, table: Table) -> str:
    """Execute one command; return what it changed, '' for commands that only frame a script."""
    if command in _WORKS:
        return ""
    if command == "read":
        return _same_file(words, table)
    if command.endswith(":"):
        return "a remark, not a command"
    if command in ("math", "math_int", "mathint"):
        return _math(bench, text.replace(",", " ")[len(command) :].strip(), command != "math")
    if command in _COMMANDS:
        count, work = _COMMANDS[command]
        if len(words) < count:
            raise InputError(f"it has {len(words)} arguments and needs {count}")
        return work(_Call(bench, command, words))
    if command in _ELSEWHERE:
        raise InputError(f"it {_ELSEWHERE[command]}")
    if _SHOWS.fullmatch(command):
        return "shows, and changes nothing: not done"
    if _FITS.fullmatch(command):
        return "a fit of xlook's own: not done"
    known = ["math", "math_int", *_COMMANDS]
    raise InputError(
        f"'{command}' is no command of xlook's that is understood"
        f"{did_you_mean(command, known, listed=False)}; a comment begins with #"
    )


def _same_file(words: list[str], table: Table) -> str:
    if not words:
        raise InputError("it names no file")
    stated, given = Path(words[0]).name, Path(table.path).name
    if stated == given:
        return f"{given}, {len(table)} rows"
    return f"the script was written for {stated}; it is carried out on {given}, as asked"


def _math(bench: Bench, text: str, between: bool) -> str:
    """COL op NUMBER = COL NAME UNIT, or with `:` COL op COL; `between` with FIRST LAST rows."""
    match = _MATH.fullmatch(text)
    if match is None or bool(match[6].strip()) != between:
        rows = " FIRST LAST" if between else ""
        raise InputError(
            f"it is written as COLUMN * NUMBER = COLUMN{rows} NAME UNIT, or with : as"
            f" COLUMN / COLUMN : COLUMN{rows} NAME UNIT"
        )
    first, last = (int(word) for word in match[6].split()) if between else (0, -1)
    rows = bench.rows(first, last)
    one = bench.column(int(match[1])).values[rows]
    by_column = match[4] == ":"
    other = bench.column(int(float(match[3]))).values[rows] if by_column else float(match[3])
    if match[2] == "/" and not np.any(other):
        what = f"column {int(float(match[3]))}, which is 0 in all these rows" if by_column else "0"
        raise InputError(f"it divides by {what}")
    with np.errstate(all="ignore"):
        values = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}[match[2]](
            one, other
        )
    return bench.write(int(match[5]), values, rows, name=match[7], unit=_unit(match[8]))


def _unit(word: str) -> str:
    return "" if word in (".", "no_val") else word


def _mapped(call: _Call) -> str:
    """COL OUT NAME UNIT: a function of one column."""
    column, out = call.integers(0, 1)
    with np.errstate(all="ignore"):
        values = _FUNCTIONS[call.command](call.bench.column(column).values)
    return call.bench.write(out, values, **_named(call, 2))


def _named(call: _Call, place: int) -> _Named:
    """Return name and unit of a column from the arguments at `place`."""
    return {"name": call.words[place], "unit": _unit(call.words[place + 1])}


def _power(call: _Call) -> str:
    column, out = call.integers(0, 1)
    with np.errstate(all="ignore"):
        values = call.bench.column(column).values ** call.real(2)
    return call.bench.write(out, values, **_named(call, 3))


def _summation(call: _Call) -> str:
    """COL OUT NAME UNIT: s_i = s_i-1 + x_i from x_1 on; s_0 is what OUT has there, 0 if new."""
    column, out = call.integers(0, 1)
    values = call.bench.column(column).values
    before = call.bench.columns.get(out)
    start = before.values[0] if before is not None else 0.0
    total = np.cumsum(np.concatenate([[start], values[1:]]))
    return call.bench.write(out, total, **_named(call, 2))


def _elastic(call: _Call) -> str:
    """DISPLACEMENT STRESS OUT FIRST LAST STIFFNESS NAME UNIT."""
    column, stress, out, first, last = call.integers(*range(5))
    rows, stiffness = call.bench.rows(first, last), call.real(5)
    if stiffness == 0:
        raise InputError("the stiffness is 0")
    values = op.elastically_corrected(
        call.bench.column(column).values[rows], call.bench.column(stress).values[rows], stiffness
    )
    return call.bench.write(out, values, rows, **_named(call, 6))


def _edges(call: _Call) -> str:
    """STRAIN STRESS OUT FIRST LAST SIZE NAME UNIT."""
    column, stress, out, first, last = call.integers(*range(5))
    rows, size = call.bench.rows(first, last), call.real(5)
    values = op.edge_strain(
        call.bench.column(column).values[rows], call.bench.column(stress).values[rows], size
    )
    return call.bench.write(out, values, rows, **_named(call, 6))


def _strain(call: _Call) -> str:
    """DISPLACEMENT THICKNESS OUT FIRST LAST NAME UNIT."""
    column, thickness, out, first, last = call.integers(*range(5))
    rows = call.bench.rows(first, last)
    with np.errstate(all="ignore"):
        values = op.shear_strain(
            call.bench.column(column).values[rows], call.bench.column(thickness).values[rows]
        )
    return call.bench.write(out, values, rows, **_named(call, 5))


def _derivative(call: _Call) -> str:
    """X Y OUT FIRST LAST NAME UNIT."""
    x, y, out, first, last = call.integers(*range(5))
    rows = call.bench.rows(first, last)
    if rows.stop - rows.start < 3:
        raise InputError("it needs three rows or more")
    values = op.derivative(call.bench.column(x).values[rows], call.bench.column(y).values[rows])
    return call.bench.write(out, values, rows, **_named(call, 5))


def _slope(call: _Call) -> str:
    """X Y OUT FIRST LAST WINDOW NAME UNIT."""
    x, y, out, first, last, window = call.integers(*range(6))
    rows = _wide_enough(call, first, last, window)
    values = op.running_slope(
        call.bench.column(x).values[rows], call.bench.column(y).values[rows], window
    )
    return call.bench.write(out, values, rows, **_named(call, 6))


def _smoothed(call: _Call) -> str:
    """COL OUT FIRST LAST WINDOW NAME UNIT."""
    column, out, first, last, window = call.integers(*range(5))
    rows = _wide_enough(call, first, last, window)
    smooth = op.running_mean if call.command == "smooth" else op.running_median
    values = smooth(call.bench.column(column).values[rows], window)
    return call.bench.write(out, values, rows, **_named(call, 5))


def _wide_enough(call: _Call, first: int, last: int, window: int) -> slice:
    """Return the rows; refuse a window that is longer."""
    rows = call.bench.rows(first, last)
    if not 0 < window // 2 * 2 + 1 <= rows.stop - rows.start:
        raise InputError(f"a window of {window} rows does not fit into {rows.stop - rows.start}")
    return rows


def _thickness(call: _Call) -> str:
    """LENGTH THICKNESS DISPLACEMENT OUT NAME UNIT: thickness of a layer thinned by shear."""
    column, out = call.integers(2, 3)
    values = call.bench.column(column).values
    values = op.thinned(values, _length(call), call.real(1))
    return call.bench.write(out, values, **_named(call, 4))


def _without_thinning(call: _Call) -> str:
    """LENGTH DISPLACEMENT THICKNESS OUT NAME UNIT: thickness without thinning by shear."""
    column, thickness, out = call.integers(1, 2, 3)
    if out == column:
        raise InputError("it cannot write over the displacement that it needs")
    both = call.bench.column(column).values, call.bench.column(thickness).values
    values = op.with_thinning(*both, _length(call))
    return call.bench.write(out, values, **_named(call, 4))


def _length(call: _Call) -> float:
    length = call.real(0)
    if length == 0:
        raise InputError("the length of the block is 0")
    return length


def _zero(call: _Call) -> str:
    """COL ROW: the value of a row becomes 0."""
    number, row = call.integers(0, 1)
    column, row = call.bench.column(number), call.bench.row(row)
    values = column.values - column.values[row]
    changed = call.bench.change(number, values)
    return f"{column.values[row]:.6g} taken away; {changed}"


def _without_jump(call: _Call) -> str:
    """COL FIRST LAST y|n: rows from LAST on have no jump from row FIRST."""
    number, first, last = call.integers(0, 1, 2)
    column, rows = call.bench.column(number), call.bench.rows(first, last)
    last = rows.stop - 1
    jump = column.values[last] - column.values[first]
    values = op.without_jump(column.values, first, last, flat=call.words[3].startswith("y"))
    changed = call.bench.change(number, values)
    return f"a jump of {jump:.6g} taken out; {changed}"


def _offset(call: _Call) -> str:
    """COL ROW OTHER ROW: shift COL so that its ROW equals OTHER in the second ROW."""
    number, row, other, other_row = call.integers(*range(4))
    column = call.bench.column(number)
    wanted = call.bench.column(other).values[call.bench.row(other_row)]
    moved = wanted - column.values[call.bench.row(row)]
    return f"moved by {moved:.6g}; " + call.bench.change(number, column.values + moved)


def _remove_column(call: _Call) -> str:
    (number,) = call.integers(0)
    column = call.bench.column(number)
    del call.bench.columns[number]
    return f"column {number}, {column.name}, removed"


def _remove_rows(call: _Call) -> str:
    first, last = call.integers(0, 1)
    last = min(last, len(call.bench) - 1)  # as xlook does
    mask = np.ones(len(call.bench), bool)
    mask[call.bench.rows(first, last)] = False
    return call.bench.keep(mask)


def _order(call: _Call) -> str:
    """COL FIRST LAST: remove rows that do not rise above all before; -COL: do not fall below."""
    number, first, last = call.integers(0, 1, 2)
    rows = call.bench.rows(first, last)
    values = call.bench.column(abs(number)).values[rows]
    mask = np.ones(len(call.bench), bool)
    mask[rows] = op.rising(values, falling=number < 0)
    return call.bench.keep(mask)


def _despike(call: _Call) -> str:
    """COL ROW: the row gets the value of the row before."""
    number, row = call.integers(0, 1)
    if row == 0:
        raise InputError("there is no row before row 0")
    column, row = call.bench.column(number), call.bench.row(row)
    values = column.values.copy()
    values[row] = values[row - 1]
    call.bench.change(number, values)
    return f"{column.values[row]:.6g} became {values[row]:.6g}"


def _name(call: _Call) -> str:
    (number,) = call.integers(0)
    column = call.bench.column(number)
    return call.bench.write(number, column.values, **_named(call, 1))


_COMMANDS: dict[str, tuple[int, Callable[[_Call], str]]] = {
    **{name: (4, _mapped) for name in _FUNCTIONS},
    "power": (5, _power),
    "summation": (4, _summation),
    "ec": (8, _elastic),
    **{name: (8, _edges) for name in ("vc", "vol_cor")},
    **{name: (7, _strain) for name in ("strain", "cs")},
    **{name: (6, _thickness) for name in ("cgt", "calc_geometric_thinning")},
    **{name: (6, _without_thinning) for name in ("rgt", "geometric_thinning")},
    **{name: (8, _slope) for name in ("ras", "slope")},
    **{name: (7, _smoothed) for name in ("smooth", "median_smooth", "ms")},
    "deriv": (7, _derivative),
    "zero": (2, _zero),
    "offset_int": (4, _without_jump),
    "offset": (4, _offset),
    "r_col": (1, _remove_column),
    **{name: (2, _remove_rows) for name in ("r_row", "rr")},
    **{name: (3, _order) for name in ("order", "sort")},
    "r_spike": (2, _despike),
    "name": (3, _name),
}
"""Number of arguments and function of each command."""
