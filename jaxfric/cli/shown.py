"""Print the result of a verb: a short answer, the whole report with --details, or JSON."""

from typing import TYPE_CHECKING

from .common import stdout_console, warn
from .told import pause

if TYPE_CHECKING:
    from ..report.report import Report
    from .folder import Folder
    from .options import OutputOptions


def show(report: "Report", written: str, content: str, output: "OutputOptions") -> None:
    """Print the report, the next commands and the line `written` of the files; then the warnings.

    With `output.json` only the text `content` is printed. Without `output.details` at most 20 lines
    are printed on a terminal that is wide enough.
    """
    pause()
    if output.json:
        print(content)
    else:
        from ..report.report import SCREEN, STEPS, print_brief, print_details, print_next_steps

        console = stdout_console()
        if output.details:
            print_details(report, console)
        else:
            steps = min(len(report.next_steps), STEPS)
            print_brief(report, console, room=SCREEN - steps - 2)
        print_next_steps(report, console, most=None if output.details else STEPS)
        if written:
            console.print(f"\n{written}", markup=False, soft_wrap=True)
    warn(report.warnings)


def finish(
    report: "Report",
    folder: "Folder",
    content: str,
    output: "OutputOptions",
    written: str | None = None,
) -> int:
    """Show the report and the written files; return the exit code of the verb."""
    show(report, folder.written if written is None else written, content, output)
    return folder.close()
