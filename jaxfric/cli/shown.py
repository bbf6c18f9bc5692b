"""What a verb prints: a short answer, the whole report with --details, or JSON."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter, Token

from ..errors import InputError
from .common import stdout_console, warn
from .told import pause

if TYPE_CHECKING:
    from ..report.report import Report


def named(type_: object, tokens: Sequence[Token]) -> str:
    """Return the path or URL of an option; refuse an empty text, which `Path` reads as "."."""
    text = tokens[0].value
    if not text.strip():
        raise InputError(
            f"{tokens[0].keyword or 'a path'} is empty; write . for the current folder"
        )
    return text


@Parameter(name="*")
@dataclass(frozen=True)
class OutputOptions:
    """Options for the output folder and the printed text of a verb."""

    out: Annotated[str | None, Parameter(converter=named)] = None
    """Output folder. A folder that holds results of another record is refused. For a study: the
    store, a folder or s3://BUCKET/NAME.zarr (also gs://, az://), by default NAME.zarr. With --plot:
    the folder of the figures."""
    details: bool = False
    """Print all tables and sentences instead of the answer alone."""
    json: bool = False
    """Print one JSON document on stdout instead of tables and lines."""
    quiet: bool = False
    """Print no progress on stderr. Warnings and errors are still printed."""


def show(report: "Report", written: str, content: str, output: OutputOptions) -> None:
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
