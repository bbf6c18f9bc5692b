"""`jaxfric loop`: which effect does this model of this record lack?"""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ..errors import InputError
from .common import (
    AXIS_EFFECTS,
    EFFECTS,
    Columns,
    DriveGain,
    DropBad,
    File,
    Flip,
    Out,
    PositionGain,
    RatedTorque,
    Rig,
    Since,
    Steps,
    Until,
    VelocityGain,
    axis_roles,
    doing,
    effect_ids,
    flipped,
    prepare_jax,
    read_record,
    refuse_options,
    tell_reading,
    told,
    windowed,
)
from .folder import Folder, choose_folder


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
    rig: Rig = "slider",
    law: Annotated[
        str, Parameter(help="Law of the base model of a slider, slip or ageing.")
    ] = "slip",
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
        Parameter(
            negative=(),
            help=f"Effects that are not considered. Ids of a slider: {EFFECTS}; of an axis:"
            f" {AXIS_EFFECTS}.",
        ),
    ] = None,
    most: Annotated[int, Parameter(help="Largest number of effects that may be added.")] = 8,
    steps: Steps = None,
    rows: Annotated[
        int | None,
        Parameter(
            help="Of a slider: fit means over neighbouring rows, about so many: quicker by as much."
        ),
    ] = None,
    drive_gain: DriveGain = None,
    position_gain: PositionGain = None,
    velocity_gain: VelocityGain = None,
    rated_torque: RatedTorque = None,
    flip: Flip = None,
    held: Annotated[
        bool,
        Parameter(
            negative=(),
            help="Of an axis: the force is a command that the controller holds until the next row."
            " Known without it where the gains of its loops are.",
        ),
    ] = False,
    cutoff: Annotated[
        str | None,
        Parameter(
            help='Of an axis: low-pass of the position, "50 Hz"; by default a tenth of the sampling'
            " rate, or less where the encoder's error, differentiated twice, would drown the force."
        ),
    ] = None,
    column: Columns = None,
    drop_bad: DropBad = False,
    since: Since = None,
    until: Until = None,
    out: Out = None,
    json: Annotated[
        bool, Parameter(negative=(), help="Print loop.json on stdout instead of the tables.")
    ] = False,
) -> int:
    """Name the effect that a fitted model lacks, add it, and report the error before and after.

    Fits the base model to a record of velocity steps, tests what it leaves, and tries every
    effect of the catalogue. Writes loop.html, loop.json and the figures residual, location,
    aliasing and candidates to the output folder, by default ./NAME-loop/ with the
    options that differ from their default.
    """
    import json as text

    if most < 1:
        raise InputError(f"--most is {most}; it must be 1 or more")
    own = {
        "--drive-gain": drive_gain,
        "--position-gain": position_gain,
        "--velocity-gain": velocity_gain,
        "--rated-torque": rated_torque,
        "--cutoff": cutoff,
    }
    turned = flipped(flip)
    of_a_slider = {"--law": law != "slip", "--steps": steps, "--rows": rows}
    _refuse_unused(rig, stiffness, of_a_slider, {**own, "--flip": turned, "--held": held})
    declared = effect_ids(with_, "--with")
    excluded = effect_ids(without, "--without")
    reading: dict[str, Any] = {
        "columns": axis_roles(column),
        "drive_gain": drive_gain,
        "rated_torque": rated_torque,
        "flip": turned,
        "drop_bad": drop_bad,
    }
    if rig == "steady":
        refuse_options(rig, {"--from": since, "--to": until})
        doing(f"reading {file.name}")
        from ..records import read_steady

        return _steady(file, read_steady(file, **reading), declared, excluded, out, json)
    with told(quiet=json) as progress:
        progress(f"reading {file.name}")
        record: Any
        if rig == "axis":
            from ..records import read_axis

            record = read_axis(
                file, position_gain=position_gain, velocity_gain=velocity_gain, **reading
            )
            record = windowed(record, since, until)
            if not json:
                tell_reading(record)
        else:
            record = read_record(file, column, drop_bad, since, until)
        prepare_jax()
        folder = choose_folder(out, file.stem, file)
        search: dict[str, Any] = {
            "with_": declared,
            "without": excluded,
            "most": most,
            "progress": progress,
        }
        if rig == "axis":
            from ..axis import close_axis_loop

            filtered = _filtered(record, cutoff)
            result = close_axis_loop(record, held=held or None, preparation=filtered, **search)
        else:
            from ..loop import close_loop

            assert stiffness is not None
            slider: dict[str, Any] = {"stiffness": stiffness, "law": law, "rows": rows}
            result = close_loop(record, steps=steps, **slider, **search)
        content = text.dumps(result.to_json(), indent=1, allow_nan=False)
        with folder.results() as to:
            (to / "loop.json").write_text(content + "\n", encoding="utf-8")
        progress("drawing figures")
        given = {
            "--stiffness": stiffness,
            "--rig": None if rig == "slider" else rig,
            "--law": None if law == "slip" else law,
            "--with": ",".join(declared),
            "--without": ",".join(excluded),
            "--most": None if most == 8 else str(most),
            "--steps": steps,
            "--rows": None if rows is None else str(rows),
            "--from": since,
            "--to": until,
            **own,
            "--flip": turned or None,
            "--out": out and str(out),
        }
        command = _command(file, given, column or [], {"--held": held, "--drop-bad": drop_bad})
        _draw(result, folder, command)
    if json:
        print(content)
    else:
        _print(result, folder)
    for warning in result.warnings:
        print(f"jaxfric: warning: {warning}", file=sys.stderr)
    return folder.close()


def _filtered(record, cutoff: str | None):
    """The usual preparation of an axis record, with a cutoff of the user's own."""
    if cutoff is None:
        return None
    import numpy as np

    from ..fitting.axis_preparation import usual
    from ..units import parse_quantity

    interval = float(np.median(np.diff(record.time)))
    return usual(interval, parse_quantity(cutoff, "Hz", "--cutoff"))


def _draw(result, folder: Folder, command: str) -> None:
    """The figures, and the page of those that could be drawn."""
    from importlib.metadata import PackageNotFoundError, version

    from ..plot.loop import DRAWERS
    from ..report.loop_html import page

    try:
        number = version("jaxfric")
    except PackageNotFoundError:  # run from a source tree
        number = "(not installed)"
    for name, draw in DRAWERS.items():
        folder.draw(name, lambda to, draw=draw: draw(result, to))
    written = [name for name in DRAWERS if f"{name}.svg" in folder.files]

    def write(to: Path) -> None:
        drawings = {name: (folder.path / f"{name}.svg").read_bytes() for name in written}
        html = page(result, drawings, version=number, command=command)
        (to / "loop.html").write_text(html, encoding="utf-8")

    folder.draw("loop.html", write)


def _steady(file: Path, curve, declared, excluded, out: Path | None, as_json: bool) -> int:
    """The loop on a folder of steady speeds."""
    import json as text

    from ..loop.steady.loop import close_steady_loop
    from ..loop.steady.noise import steady_noise
    from ..plot.steady import draw_noise, draw_steady
    from ..report.steady_text import to_json

    folder = choose_folder(out, file.stem, file)
    with told(quiet=as_json) as progress:
        progress("fitting the curve of friction over velocity")
        result = close_steady_loop(curve, with_=declared, without=excluded)
        prepare_jax()
        progress("estimating the noise of the runs")
        noise = steady_noise(curve)
        content = text.dumps(to_json(result, noise), indent=1, allow_nan=False)
        with folder.results() as to:
            (to / "steady.json").write_text(content + "\n", encoding="utf-8")
        progress("drawing the figures")
        folder.draw("curve", lambda to: draw_steady(result, to))
        if noise is not None:
            folder.draw("noise", lambda to: draw_noise(curve, noise, to))
    if as_json:
        print(content)
    else:
        _print_steady(result, curve, noise, folder)
    return folder.close()


def _print_steady(result, curve, noise, folder: Folder) -> None:
    from rich.console import Console

    from ..report.loop_text import print_tables
    from ..report.steady_text import noise_text, sentence, tables

    console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
    console.print(f"{result.verdict}: {result.sentence}", markup=False)
    for note in curve.provenance.notes:
        console.print(f"  - {note}", markup=False)
    print_tables(console, tables(result))
    console.print(f"\nGains: {sentence(result)}", markup=False)
    if noise is not None:
        first, *more = noise_text(noise, curve)
        console.print(f"\n{first[:1].upper()}{first[1:]}", markup=False)
        for line in more:
            console.print(f"  - {line}", markup=False)
    written = f"{folder.path}/{', '.join(folder.files)}"
    console.print(f"written: {written}", markup=False, soft_wrap=True)


def _command(file: Path, given: dict[str, str | None], columns, flags: dict[str, bool]) -> str:
    """The command that makes this report again."""
    parts = ["jaxfric", "loop", str(file)]
    for option, value in given.items():
        parts += [option, value] if value else []
    for role in columns:
        parts += ["--column", role]
    parts += [flag for flag, on in flags.items() if on]
    return shlex.join(parts)


def _refuse_unused(rig, stiffness, of_a_slider: dict, of_an_axis: dict) -> None:
    """A slider needs a stiffness, and neither takes options of the other."""
    if rig == "slider":
        if stiffness is None:
            raise InputError(
                "--stiffness is missing; give the stiffness of the machine: --stiffness 1.6e-3/um"
            )
        refuse_options(rig, of_an_axis)
    else:
        loops = ("--position-gain", "--velocity-gain", "--cutoff", "--held")
        of_a_stroke = {o: of_an_axis[o] for o in loops if rig == "steady"}
        refuse_options(rig, {"--stiffness": stiffness} | of_a_slider | of_a_stroke)


def _print(result, folder: Folder) -> None:
    from rich.console import Console

    from ..report.loop_text import print_loop

    console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
    print_loop(result, console)
    names = folder.files
    pictures = sorted({Path(name).stem for name in names if name.endswith((".png", ".svg"))})
    page = "loop.html (open it in a browser)" if "loop.html" in names else ""
    written = [f"{', '.join(pictures)} (.png, .svg)"] if pictures else []
    written = ", ".join(filter(None, [page, "loop.json", *written]))
    console.print(f"\nwritten: {folder.path}/{written}", markup=False, soft_wrap=True)
