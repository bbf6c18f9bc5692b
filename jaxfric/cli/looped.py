"""Output of `jaxfric loop` and `jaxfric axis`: a closed loop is written, drawn and told."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .call import current_call
from .common import stdout_console, warn
from .folder import Folder

if TYPE_CHECKING:
    from ..loop import Loop


def checked_most(most: int) -> None:
    """Refuse to add less than one effect."""
    if most < 1:
        raise InputError(f"--max-effects is {most}; it must be 1 or more")


def save_loop(result: "Loop", folder: Folder, progress: Callable[[str], None]) -> str:
    """Write loop.json, the figures, and the page of those that could be drawn; the JSON's text."""
    from ..plot.loop import DRAWERS
    from ..report.loop_html import page
    from ..report.page import installed_version

    content = folder.save_json("loop.json", result.to_json())
    progress("drawing figures")
    for name, draw in DRAWERS.items():
        folder.draw(name, lambda to, draw=draw: draw(result, to))
    drawn = [name for name in DRAWERS if f"{name}.svg" in folder.files]

    def write(to: Path) -> None:
        drawings = {name: (folder.path / f"{name}.svg").read_bytes() for name in drawn}
        html = page(result, drawings, version=installed_version(), command=current_call().command)
        (to / "loop.html").write_text(html, encoding="utf-8")

    folder.draw("loop.html", write)
    return content


def tell_loop(result: "Loop", content: str, folder: Folder, *, details: bool = False) -> int:
    """Print the JSON's text where there is one, else the answer, with `details` all tables; warn;
    the verb's exit code, 1 where the verdict is withheld."""
    from ..findings import Severity  # only here: the command begins without NumPy

    if content:
        print(content)
    else:
        _print(result, folder, details)
    warn(result.warnings)
    withheld = any(one.severity is Severity.WITHHELD for one in result.findings)
    return folder.close() or int(withheld)


def _print(result: "Loop", folder: Folder, details: bool) -> None:
    from ..report.brief import print_brief
    from ..report.loop_next import next_steps
    from ..report.loop_text import print_loop

    console = stdout_console()
    (print_loop if details else print_brief)(result, console)
    names = folder.files
    pictures = sorted({Path(name).stem for name in names if name.endswith((".png", ".svg"))})
    page = "loop.html (open it in a browser)" if "loop.html" in names else ""
    written = [f"{', '.join(pictures)} (.png, .svg)"] if pictures else []
    written = ", ".join(filter(None, [page, "loop.json", *written]))
    for step in next_steps(result, str(folder.path / "loop.json")):
        told = f"{step.lead()}: {step.text} {step.command}".rstrip()
        console.print(told, markup=False, soft_wrap=True)
    console.print(f"\nwritten: {folder.path}/{written}", markup=False, soft_wrap=True)
