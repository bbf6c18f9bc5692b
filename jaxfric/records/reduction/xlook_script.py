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
from typing import Any

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


def _argument(word: str, kind: type) -> int | float | str:
    try:
        return kind(word)
    except ValueError:
        what = "a whole number" if kind is int else "a number"
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
        kinds, work = computes
        if len(words) < len(kinds):
            raise InputError(f"it has {len(words)} arguments and needs {len(kinds)}")
        return work(bench, *map(_argument, words, kinds))
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


def _computing(arguments: str, work: Callable[..., np.ndarray]) -> "_Command":
    """Return the command that computes a column.

    `arguments` describes the words of the command: `column`, `out`, `rows` (two words), `whole`,
    `real`, and last name and unit of the result. `work` gets values of the columns in these rows,
    and the numbers, in this order.
    """
    kinds = arguments.replace("rows", "first last").split()

    def run(bench: Bench, *words: Any) -> str:
        given, values = dict(zip(kinds, words, strict=False)), []
        rows = bench.rows(given.get("first", 0), given.get("last", -1))
        for kind, word in zip(kinds, words, strict=False):
            if kind == "column":
                values.append(bench.column(word).values[rows])
            elif kind in ("whole", "real"):
                values.append(word)
        name, unit = words[len(kinds) : len(kinds) + 2]
        with np.errstate(all="ignore"):
            return bench.write(given["out"], work(*values), rows, name=name, unit=_unit(unit))

    return (*(float if kind == "real" else int for kind in kinds), str, str), run


def _summation(bench: Bench, column: int, out: int, name: str, unit: str) -> str:
    """COL OUT NAME UNIT: s_i = s_i-1 + x_i from x_1 on; s_0 is what OUT has there, 0 if new."""
    values = bench.column(column).values
    before = bench.columns.get(out)
    start = before.values[0] if before is not None else 0.0
    total = np.cumsum(np.concatenate([[start], values[1:]]))
    return bench.write(out, total, name=name, unit=_unit(unit))


def _zero(bench: Bench, number: int, row: int) -> str:
    """COL ROW: the value of a row becomes 0."""
    values = bench.column(number).values
    taken = values[bench.row(row)]
    return f"{taken:.6g} taken away; {bench.change(number, values - taken)}"


def _without_jump(bench: Bench, number: int, first: int, last: int, flat: str) -> str:
    """COL FIRST LAST y|n: rows from LAST on have no jump from row FIRST."""
    column, rows = bench.column(number), bench.rows(first, last)
    last = rows.stop - 1
    jump = column.values[last] - column.values[first]
    values = op.without_jump(column.values, first, last, flat=flat.startswith("y"))
    return f"a jump of {jump:.6g} taken out; {bench.change(number, values)}"


def _offset(bench: Bench, number: int, row: int, other: int, other_row: int) -> str:
    """COL ROW OTHER ROW: shift COL so that its ROW equals OTHER in the second ROW."""
    values = bench.column(number).values
    moved = bench.column(other).values[bench.row(other_row)] - values[bench.row(row)]
    return f"moved by {moved:.6g}; {bench.change(number, values + moved)}"


def _remove_column(bench: Bench, number: int) -> str:
    column = bench.column(number)
    del bench.columns[number]
    return f"column {number}, {column.name}, removed"


def _remove_rows(bench: Bench, first: int, last: int) -> str:
    mask = np.ones(len(bench), bool)
    mask[bench.rows(first, min(last, len(bench) - 1))] = False  # as xlook does
    return bench.keep(mask)


def _order(bench: Bench, number: int, first: int, last: int) -> str:
    """COL FIRST LAST: remove rows that do not rise above all before; -COL: do not fall below."""
    rows = bench.rows(first, last)
    values = bench.column(abs(number)).values[rows]
    mask = np.ones(len(bench), bool)
    mask[rows] = op.rising(values, falling=number < 0)
    return bench.keep(mask)


def _despike(bench: Bench, number: int, row: int) -> str:
    """COL ROW: the row gets the value of the row before."""
    if row == 0:
        raise InputError("there is no row before row 0")
    column, row = bench.column(number), bench.row(row)
    values = column.values.copy()
    values[row] = values[row - 1]
    bench.change(number, values)
    return f"{column.values[row]:.6g} became {values[row]:.6g}"


def _name(bench: Bench, number: int, name: str, unit: str) -> str:
    return bench.write(number, bench.column(number).values, name=name, unit=_unit(unit))


_Command = tuple[tuple[type, ...], Callable[..., str]]
_COMMANDS: dict[str, _Command] = {
    **{name: _computing("column out", work) for name, work in _FUNCTIONS.items()},
    "power": _computing("column out real", np.power),
    "summation": ((int, int, str, str), _summation),
    "ec": _computing("column column out rows real", op.elastically_corrected),
    "vc": _computing("column column out rows real", op.edge_strain),
    "strain": _computing("column column out rows", op.shear_strain),
    "cgt": _computing("real real column out", op.thinned),
    "rgt": _computing("real column column out", op.with_thinning),
    "slope": _computing("column column out rows whole", op.running_slope),
    "smooth": _computing("column out rows whole", op.running_mean),
    "median_smooth": _computing("column out rows whole", op.running_median),
    "deriv": _computing("column column out rows", op.derivative),
    "zero": ((int, int), _zero),
    "offset_int": ((int, int, int, str), _without_jump),
    "offset": ((int,) * 4, _offset),
    "r_col": ((int,), _remove_column),
    "r_row": ((int, int), _remove_rows),
    "order": ((int,) * 3, _order),
    "r_spike": ((int, int), _despike),
    "name": ((int, str, str), _name),
}
"""Types of the arguments, and function of each command."""

_ALIASES = {"vol_cor": "vc", "cs": "strain", "calc_geometric_thinning": "cgt", "ras": "slope"}
_ALIASES |= {"geometric_thinning": "rgt", "ms": "median_smooth", "rr": "r_row", "sort": "order"}
