"""Output of `jaxfric loop` and `jaxfric axis`: files, figures and the printed answer."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .call import current_call
from .folder import Folder
from .options import OutputOptions
from .shown import show

if TYPE_CHECKING:
    from ..loop import Loop


def checked_most(most: int) -> None:
    """Raise `InputError` if --max-effects is below 1."""
    if most < 1:
        raise InputError(f"--max-effects is {most}; it must be 1 or more")


def save_loop(result: "Loop", folder: Folder, progress: Callable[[str], None]) -> str:
    """Write loop.json, the figures and the page; return the JSON text.

    The page loop.html shows the figures that could be drawn.
    """
    from ..plot.loop import FIGURES
    from ..report.loop_page import page

    content = folder.save_json("loop.json", result.to_json())
    progress("drawing figures")
    for name, figure in FIGURES.items():
        folder.draw_figure(name, lambda figure=figure: figure(result))
    command = current_call().command
    folder.draw_page("loop.html", ".svg", lambda drawn: page(result, drawn, command=command))
    return content


def tell_loop(result: "Loop", content: str, folder: Folder, output: OutputOptions) -> int:
    """Print the answer and return the exit code: 1 if the verdict is withheld."""
    from ..findings import Severity  # only here: the command begins without NumPy
    from ..report.loop_report import report

    told_of = report(result, file=str(folder.path / "loop.json"))
    show(told_of, _written(folder), content, output)
    withheld = any(one.severity is Severity.WITHHELD for one in result.findings)
    return folder.close() or int(withheld)


def _written(folder: Folder) -> str:
    """Return the line of written files: the page, then the figures without their two suffixes."""
    names = folder.files
    pictures = sorted({Path(name).stem for name in names if name.endswith((".png", ".svg"))})
    page = "loop.html (open it in a browser)" if "loop.html" in names else ""
    files = [page, "loop.json", *([f"{', '.join(pictures)} (.png, .svg)"] if pictures else [])]
    return f"written: {folder.path}/{', '.join(filter(None, files))}"
