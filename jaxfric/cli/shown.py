"""What a verb prints of its result: the answer on a screen, all of it with --details, or JSON."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from .common import stdout_console, warn

if TYPE_CHECKING:
    from ..report.report import Report


class Showing(NamedTuple):
    """How a result is shown."""

    json: bool = False
    """As JSON."""
    details: bool = False
    """With all tables."""


def show(
    report: "Report",
    written: str,
    content: str,
    how: Showing,
    *,
    next_steps: Sequence[str] = (),
) -> None:
    """Print the report, what to do next, and the line of the files that are `written`, or with
    `how.json` the text `content` alone; then warn.

    Without `how.details` all of it has 20 lines, where the terminal is wide enough.
    """
    if how.json:
        print(content)
    else:
        from ..report.report import SCREEN, print_brief, print_details

        console = stdout_console()
        if how.details:
            print_details(report, console)
        else:
            print_brief(report, console, room=SCREEN - len(next_steps) - 2)
        for line in next_steps:
            console.print(line, markup=False, soft_wrap=True)
        if written:
            console.print(f"\n{written}", markup=False, soft_wrap=True)
    warn(report.warnings)
