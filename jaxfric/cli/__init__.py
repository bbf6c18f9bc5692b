"""The command: thin verbs over the public functions.

Only what a verb needs is imported when it runs, so that `jaxfric --help` is quick. Bad input
ends in one line on stderr and exit code 2.
"""

import contextlib
import gc
import io
import logging
import os
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import cyclopts
from cyclopts import Parameter

from .errors import InputError

app = cyclopts.App(
    name="jaxfric",
    help="Sliders that stick-slip: fit rate-and-state friction to velocity-step records.",
    version="0.1.0",
    suppress_keyboard_interrupt=False,
)

_File = Annotated[Path, Parameter(help="The record: a CSV or other table of columns.")]
_Columns = Annotated[
    list[str] | None,
    Parameter(
        name="--column",
        help="Say which column is what, as ROLE=NAME or 'ROLE=NAME [UNIT]'. Roles: time, friction, "
        "load_point_displacement, load_point_velocity, slip, normal_stress. May be repeated.",
        negative=(),
    ),
]
_DropBad = Annotated[
    bool, Parameter(negative=(), help="Leave out rows with cells that are no numbers.")
]
_Steps = Annotated[
    str | None,
    Parameter(help="Velocity steps, '0 s: 2 um/s, 60 s: 20 um/s', instead of those found."),
]
_Out = Annotated[Path | None, Parameter(help="Output folder.")]


@app.command
def record(
    file: _File,
    /,
    *,
    column: _Columns = None,
    drop_bad: _DropBad = False,
    steps: _Steps = None,
    out: _Out = None,
) -> None:
    """Show what is understood of a record: columns, units, sampling, velocity steps; and draw it.

    The figure goes to the output folder, by default ./NAME-record/.
    """
    from .plot.record import draw_record
    from .records import VelocitySteps, record_steps
    from .report.output import output_folder
    from .report.record_text import describe

    measured = _read(file, column, drop_bad)
    found = record_steps(measured) if steps is None else VelocitySteps.parse(steps)
    destination = out or Path(f"{file.stem}-record")
    with output_folder(destination) as folder:
        draw_record(measured, found, folder / "record.png")
    for line in describe(measured, found):
        print(line)
    print(f"figure: {destination / 'record.png'}")


@app.command
def fit(
    file: _File,
    /,
    *,
    stiffness: Annotated[
        str | None,
        Parameter(
            allow_leading_hyphen=True,
            help="Stiffness with unit: 1.6e-3/um, or 2e6 N/m for a force.",
        ),
    ] = None,
    law: Annotated[Literal["slip", "ageing"], Parameter(help="Evolution law.")] = "slip",
    states: Annotated[Literal["1", "2", "3"], Parameter(help="Number of state variables.")] = "1",
    fit_stiffness: Annotated[
        bool, Parameter(negative=(), help="Fit the stiffness too (then it need not be given).")
    ] = False,
    slip_trend: Annotated[
        bool, Parameter(negative=(), help="Fit a linear change of friction with slip as well.")
    ] = False,
    steps: _Steps = None,
    column: _Columns = None,
    drop_bad: _DropBad = False,
    reference_velocity: Annotated[
        str | None,
        Parameter(allow_leading_hyphen=True, help="Velocity, with unit, at which friction is f0."),
    ] = None,
    start: Annotated[
        str | None,
        Parameter(help="Starting values, 'A=0.01, B=0.012, L=20 um'; not needed as a rule."),
    ] = None,
    weighting: Annotated[
        Literal["ordinary", "whitened"],
        Parameter(help="Plain sum of squares, or weighted by the estimated noise."),
    ] = "ordinary",
    profile: Annotated[
        bool, Parameter(negative=(), help="Intervals from the profile likelihood (slower).")
    ] = False,
    out: _Out = None,
    json: Annotated[
        bool, Parameter(negative=(), help="Print fit.json on stdout instead of the table.")
    ] = False,
) -> None:
    """Fit A, B and L (rate-and-state friction) to a record of velocity steps.

    Writes fit.json, fit.png and fit.svg to the output folder, by default ./NAME-fit/.
    """
    import json as text

    measured = _read(file, column, drop_bad)
    _prepare_jax()
    from .fitting import fit as run
    from .fitting.start_text import parse_start
    from .plot.fit import draw_fit
    from .report.output import output_folder

    starts = None if start is None else parse_start(start, measured.friction_unit)
    destination = out or Path(f"{file.stem}-fit")
    with output_folder(destination):
        pass  # a folder that cannot be written is better known before the fit
    result = run(
        measured,
        stiffness=stiffness,
        law=law,
        states=int(states),
        fit_stiffness=fit_stiffness,
        slip_trend=slip_trend,
        steps=steps,
        reference_velocity=reference_velocity,
        start=starts,
        weighting=weighting,
        profile=profile,
    )
    content = text.dumps(result.to_json(), indent=1, allow_nan=False)
    with output_folder(destination) as folder:
        (folder / "fit.json").write_text(content + "\n")
        draw_fit(result, folder / "fit.png", folder / "fit.svg")
    if json:
        print(content)
    else:
        _print_fit(result, destination)
    for warning in result.warnings:
        print(f"jaxfric: warning: {warning}", file=sys.stderr)


def _read(file: Path, columns: list[str] | None, drop_bad: bool):
    from .records import read

    roles = {}
    for text in columns or []:
        role, equals, name = text.partition("=")
        if not equals or not name.strip():
            raise InputError(f"--column '{text}' is not ROLE=NAME, as in --column friction=mu")
        roles[role.strip()] = name.strip()
    return read(file, columns=roles or None, drop_bad=drop_bad)


def _prepare_jax() -> None:
    """64-bit numbers, and a compilation cache in the user's cache folder if there can be one."""
    import jax
    from platformdirs import user_cache_dir

    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        folder = Path(user_cache_dir("jaxfric")) / "compiled"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            return
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _print_fit(result, destination: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from .fitting.table import rows, summary

    table = Table(title=f"{result.model.law} law", title_justify="left", box=None, pad_edge=False)
    for heading in ("", "", "value", "std", "95 % interval", "unit"):
        table.add_column(heading, justify="left" if heading in ("", "unit") else "right")
    for row in rows(result):
        table.add_row(row.name, row.meaning, row.value, row.std, row.interval, row.unit)
    console = Console(width=None if sys.stdout.isatty() else 100, highlight=False)
    console.print(table)
    for line in summary(result):
        console.print(line)
    console.print(f"written: {destination}/fit.json, fit.png, fit.svg")


def main() -> None:
    """Run the command; every failure becomes one line and an exit code."""
    gc.disable()  # a short-lived process: collecting while JAX traces costs a tenth of its time
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the caller
            setattr(sys, name, io.StringIO())
        else:
            stream.reconfigure(errors="backslashreplace")
    try:
        code = _run(sys.argv[1:])
    except KeyboardInterrupt:
        code = 130
    except BrokenPipeError:
        sys.stdout = None
        code = 141
    sys.exit(code)


def _run(arguments: list[str]) -> int:
    try:
        with _quiet():
            app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except cyclopts.CycloptsError as error:
        verb = " ".join(("jaxfric", *(error.command_chain or ())))
        return _complain(f"{error} ({verb} --help lists what there is)", 2)
    except InputError as error:
        return _complain(str(error), 2)
    except (KeyboardInterrupt, BrokenPipeError):
        raise
    except MemoryError:
        return _complain("out of memory; use a shorter record", 1)
    except Exception as error:
        if _debugging():
            raise
        if isinstance(error, OSError) and error.strerror:
            return _complain(f"{error.filename or 'standard output'}: {error.strerror}", 1)
        kind = type(error).__name__
        return _complain(
            f"internal error ({kind}: {error}); please report it. JAXFRIC_DEBUG=1 shows where", 1
        )
    return 0


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without remarks of libraries on fonts, caches and rounding, unless debugging."""
    if _debugging():
        yield
        return
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(logging.NOTSET)


def _debugging() -> bool:
    return bool(os.environ.get("JAXFRIC_DEBUG"))


def _complain(message: str, code: int) -> int:
    print("jaxfric: error: " + " ".join(message.split()), file=sys.stderr)
    return code
