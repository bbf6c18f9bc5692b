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
from typing import NamedTuple

import numpy as np

from ...errors import InputError, did_you_mean
from ...tables import read_text
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


class _Call(NamedTuple):
    """A command's arguments, and the columns that it works on."""

    bench: Bench
    words: list[str]

    def integers(self, number: int) -> list[int]:
        """Return the first arguments as integers."""
        return [int(_number(word, "a whole number", int)) for word in self.words[:number]]


def _number(word: str, what: str, kind: Callable[[str], float]) -> float:
    try:
        return kind(word)
    except ValueError:
        raise InputError(f"'{word}' is not {what}") from None


def run_xlook(table: Table, script: Path) -> tuple[Table, tuple[Done, ...]]:
    """Reduce a table by xlook's commands in the file `script`; return the table and each command's
    log.

    Raises `InputError`, with the line, for an unknown command, missing arguments, a column or row
    that does not exist, division by a column of zeros, and a script that removes all rows or cannot
    be read.
    """
    bench = Bench.of(table)
    for number, line in enumerate(read_text(script, "replace").splitlines(), 1):
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
    if (computes := _COMMANDS.get(_ALIASES.get(command, command))) is not None:
        count, work = computes
        if len(words) < count:
            raise InputError(f"it has {len(words)} arguments and needs {count}")
        return work(_Call(bench, words))
    if command in _ELSEWHERE:
        raise InputError(f"it {_ELSEWHERE[command]}")
    if _SHOWS.fullmatch(command):
        return "shows, and changes nothing: not done"
    if _FITS.fullmatch(command):
        return "a fit of xlook's own: not done"
    known = ["math", "math_int", *_COMMANDS, *_ALIASES]
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


def _computing(
    arguments: str, work: Callable[..., np.ndarray]
) -> tuple[int, Callable[[_Call], str]]:
    """Return number of arguments and function of a command that computes a column.

    `arguments` describes the words of the command: `column`, `out`, `rows` (two words), `whole`,
    `real`, `new` (name and unit of the result). `work` gets values of the columns in these rows,
    and the numbers, in this order.
    """
    kinds = arguments.split()

    def run(call: _Call) -> str:
        bench, words, values, out = call.bench, iter(call.words), [], 0
        rows, name, unit = slice(0, len(bench)), "", ""
        for kind in kinds:
            word = next(words)
            if kind == "new":
                name, unit = word, _unit(next(words))
            elif kind == "real":
                values.append(_number(word, "a number", float))
            else:
                whole = int(_number(word, "a whole number", int))
                if kind == "column":
                    values.append(bench.column(whole).values)
                elif kind == "out":
                    out = whole
                elif kind == "rows":
                    last = int(_number(next(words), "a whole number", int))
                    rows = bench.rows(whole, last)
                else:
                    values.append(whole)
        own = (x[rows] if isinstance(x, np.ndarray) else x for x in values)
        with np.errstate(all="ignore"):
            return bench.write(out, work(*own), rows, name=name, unit=unit)

    return len(kinds) + kinds.count("rows") + kinds.count("new"), run


def _summation(call: _Call) -> str:
    """COL OUT NAME UNIT: s_i = s_i-1 + x_i from x_1 on; s_0 is what OUT has there, 0 if new."""
    column, out = call.integers(2)
    values = call.bench.column(column).values
    before = call.bench.columns.get(out)
    start = before.values[0] if before is not None else 0.0
    total = np.cumsum(np.concatenate([[start], values[1:]]))
    return call.bench.write(out, total, name=call.words[2], unit=_unit(call.words[3]))


def _zero(call: _Call) -> str:
    """COL ROW: the value of a row becomes 0."""
    number, row = call.integers(2)
    column, row = call.bench.column(number), call.bench.row(row)
    values = column.values - column.values[row]
    changed = call.bench.change(number, values)
    return f"{column.values[row]:.6g} taken away; {changed}"


def _without_jump(call: _Call) -> str:
    """COL FIRST LAST y|n: rows from LAST on have no jump from row FIRST."""
    number, first, last = call.integers(3)
    column, rows = call.bench.column(number), call.bench.rows(first, last)
    last = rows.stop - 1
    jump = column.values[last] - column.values[first]
    values = op.without_jump(column.values, first, last, flat=call.words[3].startswith("y"))
    changed = call.bench.change(number, values)
    return f"a jump of {jump:.6g} taken out; {changed}"


def _offset(call: _Call) -> str:
    """COL ROW OTHER ROW: shift COL so that its ROW equals OTHER in the second ROW."""
    number, row, other, other_row = call.integers(4)
    column = call.bench.column(number)
    wanted = call.bench.column(other).values[call.bench.row(other_row)]
    moved = wanted - column.values[call.bench.row(row)]
    return f"moved by {moved:.6g}; " + call.bench.change(number, column.values + moved)


def _remove_column(call: _Call) -> str:
    (number,) = call.integers(1)
    column = call.bench.column(number)
    del call.bench.columns[number]
    return f"column {number}, {column.name}, removed"


def _remove_rows(call: _Call) -> str:
    first, last = call.integers(2)
    last = min(last, len(call.bench) - 1)  # as xlook does
    mask = np.ones(len(call.bench), bool)
    mask[call.bench.rows(first, last)] = False
    return call.bench.keep(mask)


def _order(call: _Call) -> str:
    """COL FIRST LAST: remove rows that do not rise above all before; -COL: do not fall below."""
    number, first, last = call.integers(3)
    rows = call.bench.rows(first, last)
    values = call.bench.column(abs(number)).values[rows]
    mask = np.ones(len(call.bench), bool)
    mask[rows] = op.rising(values, falling=number < 0)
    return call.bench.keep(mask)


def _despike(call: _Call) -> str:
    """COL ROW: the row gets the value of the row before."""
    number, row = call.integers(2)
    if row == 0:
        raise InputError("there is no row before row 0")
    column, row = call.bench.column(number), call.bench.row(row)
    values = column.values.copy()
    values[row] = values[row - 1]
    call.bench.change(number, values)
    return f"{column.values[row]:.6g} became {values[row]:.6g}"


def _name(call: _Call) -> str:
    (number,) = call.integers(1)
    column = call.bench.column(number)
    return call.bench.write(number, column.values, name=call.words[1], unit=_unit(call.words[2]))


_COMMANDS: dict[str, tuple[int, Callable[[_Call], str]]] = {
    **{name: _computing("column out new", work) for name, work in _FUNCTIONS.items()},
    "power": _computing("column out real new", np.power),
    "summation": (4, _summation),
    "ec": _computing("column column out rows real new", op.elastically_corrected),
    "vc": _computing("column column out rows real new", op.edge_strain),
    "strain": _computing("column column out rows new", op.shear_strain),
    "cgt": _computing("real real column out new", op.thinned),
    "rgt": _computing("real column column out new", op.with_thinning),
    "slope": _computing("column column out rows whole new", op.running_slope),
    "smooth": _computing("column out rows whole new", op.running_mean),
    "median_smooth": _computing("column out rows whole new", op.running_median),
    "deriv": _computing("column column out rows new", op.derivative),
    "zero": (2, _zero),
    "offset_int": (4, _without_jump),
    "offset": (4, _offset),
    "r_col": (1, _remove_column),
    "r_row": (2, _remove_rows),
    "order": (3, _order),
    "r_spike": (2, _despike),
    "name": (3, _name),
}
"""Number of arguments and function of each command."""

_ALIASES = {"vol_cor": "vc", "cs": "strain", "calc_geometric_thinning": "cgt", "ras": "slope"}
_ALIASES |= {"geometric_thinning": "rgt", "ms": "median_smooth", "rr": "r_row", "sort": "order"}
