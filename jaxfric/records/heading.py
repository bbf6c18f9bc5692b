"""Find names and units of columns in the lines of text above the numbers."""

import itertools
import re
from collections import Counter
from collections.abc import Iterable

from ..errors import folded
from ..units import is_unit
from . import clock
from .axis_units import spelling
from .cells import Writing
from .roles import SLIDER, has_role

_NAMES, _UNITS = ("channelname", "channel", "name", "signal"), ("unit", "units")
_TIMES = ("timestamp", "interval", "starttime", "dt")
"""Labels at the start of header lines, folded: of names, of units, of times."""
_COUNTS = re.compile(r"\s*(\d+ recs\s*)+")


def is_counts(line: str) -> bool:
    """Whether a line gives the number of rows of each column, as in xlook's text files."""
    return _COUNTS.fullmatch(line) is not None


def read_header(
    above: list[str], rows: list[str], writing: Writing
) -> tuple[list[str], list[str | None], str]:
    """Return names ("" for none), units and a doubt ("" for none) from the lines above the numbers.

    Without names, or with a wrong number of names, the columns are called #1, #2 and so on. The
    doubt gives the reason for names such as #1. R and xlook write a first column that counts the
    rows and has no name; this column is called `row`. xlook keeps these numbers in a listing of
    every n-th row.
    """
    listing = any(map(is_counts, above))
    written = [line for line in above if line.strip().strip("#").strip(" \t;,\"'")]
    written = [line for line in written if not is_counts(line)]
    cells = [writing.cells(row) for row in rows]
    least, most = _usual(len(_without_end(row)) for row in cells), _usual(map(len, cells))
    if not written:
        return [f"#{i + 1}" for i in range(least)], [None] * least, "it has no header"
    if (labelled := _labelled(written, writing, least)) is not None:
        return *labelled, ""
    names = _header_cells(written[-1], writing, least, most)
    below: list[str] | None = None
    if len(written) > 1:
        upper = _header_cells(written[-2], writing, least, most)
        if len(names) <= len(upper) <= most and _are_units(names, upper):
            below, names = [cell.strip("[]() ") for cell in names], upper
    if len(names) == least - 1 and _count_rows(cells, listing) and not _is_time(names[0]):
        names, below = ["row", *names], None if below is None else ["", *below]
    if not least <= len(names) <= most:
        halved = writing.delimiter == "," and least == 2 * len(names)
        hint = "; with decimal commas, part the columns by semicolons" if halved else ""
        doubt = (
            f"the header names {len(names)} columns, the first row has"
            f" {len(_without_end(cells[0]))} cells; header: {written[-1].strip()[:80]}" + hint
        )
        return [f"#{i + 1}" for i in range(least)], [None] * least, doubt
    if len(names) > 1 and len(set(names)) == 1 and is_unit(names[0]):
        doubt = f"the header calls all {len(names)} columns '{names[0]}', which is a unit"
        return [f"#{i + 1}" for i in range(len(names))], [*names], doubt
    if below is not None:
        below += [""] * (len(names) - len(below))
        plain = [SLIDER.split(name)[0] for name in names]
        return plain, [None if clock.is_clock_format(unit) else unit for unit in below], ""
    pairs = [SLIDER.split(name) for name in names]
    return [name for name, _ in pairs], [unit for _, unit in pairs], ""


def _labelled(
    written: list[str], writing: Writing, count: int
) -> tuple[list[str], list[str | None]] | None:
    """Return names and units from header lines that repeat a label before every column of values.

    None for other headers. National Instruments' text has a time and a value for each channel:
    `Channel name,Force,Channel name,Input 1`, `Unit,V,Unit,V`, and `Timestamp,DATE,Timestamp,DATE`.
    """
    found: dict[str, list[str]] = {}
    for line in written:
        cells = writing.cells(line)
        if count % 2 == 0 and len(cells) == count and len(set(cells[::2])) == 1:
            found[folded(cells[0])] = cells[1::2]
    names, units = (
        next((found[label] for label in labels if label in found), None)
        for labels in (_NAMES, _UNITS)
    )
    if names is None or units is None:
        return None
    times = any(label in found for label in _TIMES)
    of_time = [f"time of {name}" if k else "time" for k, name in enumerate(names)]
    firsts = of_time if times else [""] * len(names)
    return (
        [cell for pair in zip(firsts, names, strict=True) for cell in pair],
        [cell for unit in units for cell in (None, unit or None)],
    )


def _count_rows(rows: list[list[str]], thinned: bool) -> bool:
    """Whether the first cells of the rows are integers that increase: by one, unless `thinned`."""
    first = [row[0].strip("\"'") for row in rows]
    if len(first) < 2 or not all(cell.isdecimal() for cell in first):
        return False
    steps = [int(b) - int(a) for a, b in itertools.pairwise(first)]
    return min(steps) > 0 if thinned else set(steps) == {1}


def _is_time(name: str) -> bool:
    role = SLIDER.role_of(SLIDER.split(name)[0])
    return role is not None and role[0] == "time"


def _usual(counts: Iterable[int]) -> int:
    """Return the most frequent count; of equally frequent ones the largest."""
    found = Counter(counts)
    return max(found, key=lambda count: (found[count], count))


def _without_end(cells: list[str]) -> list[str]:
    """Remove empty cells at the end."""
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _header_cells(line: str, writing: Writing, least: int, most: int) -> list[str]:
    """Split a header line into cells, without a leading `#` and a remark after `;`.

    If `;` is the delimiter, it starts no remark. If the delimiter of the rows gives a wrong number
    of cells, other delimiters are tried.
    """
    line = line.strip(" ").removeprefix("#")
    found = _without_end(_header_cells_by(line, writing))
    if least <= len(found) <= most:
        return found
    for delimiter in ("\t", ";", ","):
        other = _without_end(Writing(delimiter).cells(line))
        if least <= len(other) <= most:
            return other
    wide = [cell.strip("\"' ") for cell in re.split(r"\s{2,}|\t", line.strip())]
    return wide if least <= len(wide) <= most else found


def _header_cells_by(line: str, writing: Writing) -> list[str]:
    if writing.delimiter is None:
        line = re.sub(r"\s+(?=[\[(])", "", line.strip())
        line = re.sub(r"[\[(][^\])]*[\])]", lambda unit: unit.group().replace(" ", "*"), line)
    elif writing.delimiter != ";":
        line = line.split(";")[0]
    return writing.cells(line)


def _are_units(cells: list[str], above: list[str]) -> bool:
    """Whether the cells of a line are units, and the line above looks more like names."""
    bare = [cell.strip("[]() ") for cell in cells]
    known = all(
        is_unit(cell) or is_unit(spelling(cell)) or clock.is_clock_format(cell) for cell in bare
    )
    return known and sum(map(has_role, above)) >= sum(map(has_role, bare))
