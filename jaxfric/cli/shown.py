"""What a verb prints of its result: the answer on a screen, all of it with --details, or JSON."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .common import stdout_console, warn

if TYPE_CHECKING:
    from ..report.report import Report
    from .options import OutputOptions


def show(
    report: "Report",
    written: str,
    content: str,
    output: "OutputOptions",
    *,
    next_steps: Sequence[str] = (),
) -> None:
    """Print the report, what to do next, and the line of the files that are `written`, or with
    `output.json` the text `content` alone; then warn.

    Without `output.details` all of it has 20 lines, where the terminal is wide enough.
    """
    if output.json:
        print(content)
    else:
        from ..report.report import SCREEN, print_brief, print_details

        console = stdout_console()
        if output.details:
            print_details(report, console)
        else:
            print_brief(report, console, room=SCREEN - len(next_steps) - 2)
        for line in next_steps:
            console.print(line, markup=False, soft_wrap=True)
        if written:
            console.print(f"\n{written}", markup=False, soft_wrap=True)
    warn(report.warnings)
