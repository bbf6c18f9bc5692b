"""`jaxfric loop`: which effect does this model of this record lack?"""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ..errors import InputError
from .common import (
    EFFECTS,
    Columns,
    DropBad,
    File,
    Out,
    Steps,
    effect_ids,
    prepare_jax,
    read_record,
    told,
)


def loop(
    file: File,
    /,
    *,
    stiffness: Annotated[
        str | None,
        Parameter(
            allow_leading_hyphen=True,
            help="Stiffness of the machine with unit: 1.6e-3/um, or 2e6 N/m for a force.",
        ),
    ] = None,
    law: Annotated[Literal["slip", "ageing"], Parameter(help="Law of the base model.")] = "slip",
    with_: Annotated[
        list[str] | None,
        Parameter(
            name="--with",
            negative=(),
            help="Effects that the base model has from the start: ids, separated by commas.",
        ),
    ] = None,
    without: Annotated[
        list[str] | None,
        Parameter(negative=(), help=f"Effects that are not considered. All ids: {EFFECTS}."),
    ] = None,
    most: Annotated[int, Parameter(help="Largest number of effects that may be added.")] = 3,
    steps: Steps = None,
    column: Columns = None,
    drop_bad: DropBad = False,
    out: Out = None,
    json: Annotated[
        bool, Parameter(negative=(), help="Print loop.json on stdout instead of the tables.")
    ] = False,
) -> None:
    """Name the effect that a fitted model lacks, add it, and report the error before and after.

    Fits the base model to a record of velocity steps, tests what it leaves, and tries every
    effect of the catalogue. Writes loop.html, loop.json and the figures residual, location,
    aliasing and candidates to the output folder, by default ./NAME-loop/.
    """
    import json as text

    if stiffness is None:
        raise InputError(
            "--stiffness is missing; give the stiffness of the machine: --stiffness 1.6e-3/um"
        )
    if most < 1:
        raise InputError(f"--most is {most}; it must be 1 or more")
    declared, excluded = effect_ids(with_, "--with"), effect_ids(without, "--without")
    destination = out or Path(f"{file.stem}-loop")
    with told(quiet=json) as progress:
        progress(f"reading {file.name}")
        measured = read_record(file, column, drop_bad)
        prepare_jax()
        from ..loop import close_loop
        from ..report.output import output_folder

        with output_folder(destination):
            pass  # a folder that cannot be written is better known before the search
        result = close_loop(
            measured,
            stiffness=stiffness,
            law=law,
            steps=steps,
            with_=declared,
            without=excluded,
            most=most,
            progress=progress,
        )
        progress("drawing figures")
        content = text.dumps(result.to_json(), indent=1, allow_nan=False)
        command = _command(
            file, stiffness, law, declared, excluded, most, steps, column, drop_bad, out
        )
        with output_folder(destination) as folder:
            names = _write(result, folder, content, command)
    if json:
        print(content)
    else:
        _print(result, destination, names)
    for warning in result.warnings:
        print(f"jaxfric: warning: {warning}", file=sys.stderr)


def _write(result, folder: Path, content: str, command: str) -> list[str]:
    from importlib.metadata import PackageNotFoundError, version

    from ..plot.loop import draw_loop
    from ..report.loop_html import FIGURES, page

    try:
        number = version("jaxfric")
    except PackageNotFoundError:  # run from a source tree
        number = "(not installed)"
    figures = draw_loop(result, folder)
    drawings = {name: (folder / f"{name}.svg").read_bytes() for name in FIGURES}
    html = page(result, drawings, version=number, command=command)
    (folder / "loop.html").write_text(html, encoding="utf-8")
    (folder / "loop.json").write_text(content + "\n", encoding="utf-8")
    return ["loop.html", "loop.json", *figures]


def _command(file, stiffness, law, declared, excluded, most, steps, column, drop_bad, out) -> str:
    """The command that makes this report again."""
    parts = ["jaxfric", "loop", str(file), "--stiffness", stiffness]
    parts += ["--law", law] if law != "slip" else []
    parts += ["--with", ",".join(declared)] if declared else []
    parts += ["--without", ",".join(excluded)] if excluded else []
    parts += ["--most", str(most)] if most != 3 else []
    parts += ["--steps", steps] if steps else []
    for role in column or []:
        parts += ["--column", role]
    parts += ["--drop-bad"] if drop_bad else []
    parts += ["--out", str(out)] if out else []
    return shlex.join(parts)


def _print(result, destination: Path, names: list[str]) -> None:
    from rich.console import Console

    from ..report.loop_text import print_loop

    console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
    print_loop(result, console)
    pictures = sorted({Path(name).stem for name in names if name.endswith((".png", ".svg"))})
    console.print(
        f"\nwritten: {destination}/loop.html (open it in a browser), loop.json,"
        f" {', '.join(pictures)} (.png, .svg)",
        markup=False,
        soft_wrap=True,
    )
