"""Print tables of text on a terminal of any width, without breaking a number."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rich.console import Console

_WIDE = 105
_GAP = 2
_LONGEST_WORD, _LONGEST_NUMBER = 24, 48
"""Characters: of a word that is not broken, and of a cell that may be numbers."""


class TextTable(NamedTuple):
    """A table of text: title, column heads, rows, remark, and the most important rows."""

    title: str
    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    note: str = ""
    marked: tuple[int, ...] = ()


def print_tables(console: "Console", shown_tables: Sequence[TextTable]) -> None:
    """Print tables one below the other; a narrow console leaves out column meanings.

    A table that is wider than the console continues below, with its first column repeated.
    """
    for table in shown_tables:
        narrow = console.width < _WIDE
        left_out = ("meaning",) if narrow else ()
        columns = [
            k
            for k, head in enumerate(table.head)
            if head not in left_out and (head or any(row[k] for row in table.rows))
        ]
        parts = parts_of(table, columns, console.width)
        for number, part in enumerate(parts):
            console.print()
            console.print(_drawn(table, part, console.width, "" if number else table.title))
        if table.note:
            console.print(table.note, markup=False)


def parts_of(table: TextTable, columns: Sequence[int], width: int) -> list[list[int]]:
    """Groups of columns that fit side by side into `width` characters.

    Each group of columns begins with the first column of the table.
    """
    least = {k: _least_width(table, k) for k in columns}
    parts = [[columns[0]]]
    for k in columns[1:]:
        if len(parts[-1]) > 1 and sum(least[j] + _GAP for j in (*parts[-1], k)) - _GAP > width:
            parts.append([columns[0]])
        parts[-1].append(k)
    return parts


def _least_width(table: TextTable, column: int) -> int:
    """The characters that a column needs: of numbers every cell in whole, of text its words."""
    cells = [row[column] for row in table.rows]
    words = [word for text in (table.head[column], *cells) for word in text.split()]
    longest = min(max(map(len, words), default=0), _LONGEST_WORD)
    return max(longest, *map(len, cells)) if cells and _whole(table, column) else longest


def _whole(table: TextTable, column: int) -> bool:
    """Whether the cells of a column are numbers, which are not to be broken."""
    cells = [row[column] for row in table.rows]
    return numeric(table, column) and max(map(len, cells)) <= _LONGEST_NUMBER


def widths(table: TextTable, columns: Sequence[int], width: int) -> dict[int, int]:
    """Divide a number of characters among the columns; heads and texts are broken if needed."""
    least = {k: _least_width(table, k) for k in columns}
    own = {k: max(len(row[k]) for row in (table.head, *table.rows)) for k in columns}
    while sum(own.values()) + _GAP * (len(own) - 1) > width:
        widest = max(columns, key=lambda k: own[k] - least[k])
        if own[widest] <= least[widest]:
            break
        own[widest] -= 1
    return own


def _drawn(table: TextTable, columns: Sequence[int], width: int, title: str):
    """Some columns of a table, as rich draws them."""
    from rich.table import Table as RichTable

    shown = RichTable(title=title or None, title_justify="left", box=None, pad_edge=False)
    for k, own in widths(table, columns, width).items():
        shown.add_column(
            _plain(table.head[k]),
            justify="right" if numeric(table, k) else "left",
            width=own,
            overflow="fold",
        )
    for k, row in enumerate(table.rows):
        bold = "bold" if k in table.marked else None
        shown.add_row(*(_plain(row[column]) for column in columns), style=bold)
    return shown


def _plain(text: str):
    from rich.text import Text

    return Text(text)


def numeric(table: TextTable, column: int) -> bool:
    """Whether a column holds only numbers; such a column is aligned right."""
    cells = [row[column] for row in table.rows if row[column]]
    return bool(cells) and sum(cell[0] in "+−-<0123456789." for cell in cells) > 0.5 * len(cells)
