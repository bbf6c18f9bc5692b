"""Reports of results: a terminal, a notebook and a page show the same report.

`jaxfric.views` makes the report of a result; the command prints it in brief, or with all details.
"""

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from .tables import TextTable, print_tables

if TYPE_CHECKING:
    from rich.console import Console

SCREEN, STEPS = 20, 3
"""Lines, and next steps among them, that a terminal shows unless details are asked for."""
_FRAME = 4
"""Lines of a table besides its rows: an empty one, the title, the heads, how many rows follow."""
_ROWS, _WIDTH = 3, 120
"""Fewest rows of a cut table; the width of a report as text."""


class NextStep(NamedTuple):
    """A recommended next step: a sentence and, if possible, a command line."""

    text: str
    command: str = ""
    also: bool = False
    """Whether it is beside what is to be done next."""
    code: str = ""
    """What it asks for, in the table "next" of `words`; "" for one that has no code."""

    def lead(self) -> str:
        """The word before the sentence of a step."""
        return "also" if self.also else "next"


class Report(NamedTuple):
    """A result in words and tables, the most important first."""

    headline: Sequence[str] = ()
    """At most three lines: the result with its error, what it means, what speaks against it."""
    tables: Sequence[TextTable] = ()
    """The first stands below the headline, the others among the details."""
    lines: Sequence[str] = ()
    """Sentences of the details above the tables."""
    notes: Sequence[str] = ()
    """Sentences of the details below the tables."""
    warnings: Sequence[str] = ()
    short: TextTable | None = None
    """The table below the headline where it is not the first of all."""
    next_steps: Sequence[NextStep] = ()
    first_notes: int = 0
    """So many of the notes stand below the first table even if no details are asked for."""


def print_brief(report: Report, console: "Console", *, room: int = SCREEN) -> None:
    """Print the headline, and as many rows of the table as fit into `room` lines.

    A report without a table shows its notes in place of the table.
    """
    _print_lines(console, report.headline)
    room -= len(report.headline)
    table = report.short or next((table for table in report.tables if table.rows), None)
    if table is not None and table.rows:
        notes = report.notes[: min(report.first_notes, room - _FRAME - _ROWS - 1)]
        print_tables(console, [cut(table, room - _FRAME - len(notes) - bool(notes))])
        _print_lines(console, ["", *notes] if notes else [])
    elif not report.lines:
        _print_lines(console, report.notes[:room])


def print_details(report: Report, console: "Console") -> None:
    """Print the whole report, but not its warnings."""
    _print_lines(console, report.headline)
    if report.headline and report.lines:
        console.print()
    _print_lines(console, report.lines)
    print_tables(console, [table for table in report.tables if table.rows])
    if report.notes:
        console.print()
    _print_lines(console, report.notes)


def print_next_steps(report: Report, console: "Console", *, most: int | None = None) -> None:
    """Print the next steps, one in each line; only the first `most` steps if `most` is given."""
    told = [(f"{step.lead()}:", step.text, step.command) for step in report.next_steps[:most]]
    _print_lines(console, [" ".join(filter(None, words)) for words in told])


def cut(table: TextTable, most: int) -> TextTable:
    """Cut a table to the given number of rows, 3 or more: marked rows first, then the top rows.

    The cut table has no column of meanings, and no note longer than one line.
    """
    most = max(most, _ROWS)
    shown = range(len(table.rows))
    if len(table.rows) > most + 1:  # a line on one more row takes as much room as the row
        shown = sorted(sorted(shown, key=lambda k: (k not in table.marked, k))[:most])
    columns = [k for k, head in enumerate(table.head) if head != "meaning"]
    left = len(table.rows) - len(shown)
    note = table.note if len(table.note) < _WIDTH and len(shown) <= most else ""
    return TextTable(
        table.title,
        tuple(table.head[k] for k in columns),
        [tuple(table.rows[row][k] for k in columns) for row in shown],
        f"{left} more with --details" if left else note,
        tuple(k for k, row in enumerate(shown) if row in table.marked),
    )


def text_of(title: str, report: Report) -> str:
    """A report as text, with its warnings at the end."""
    from rich.console import Console

    out = io.StringIO()
    console = Console(file=out, width=_WIDTH, highlight=False, color_system=None)
    _print_lines(console, [title])
    print_details(report, console)
    print_next_steps(report, console)
    _print_lines(console, [f"warning: {warning}" for warning in report.warnings])
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def _print_lines(console: "Console", lines: Sequence[str]) -> None:
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)
