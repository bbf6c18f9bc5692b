"""`jaxfric fit`: rate-and-state friction from a record."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from . import options
from .common import doing, prepare_jax, read_record, told, warn
from .fits import fit_files, for_each, refuse_for_several
from .folder import Folder, choose_folder, json_text
from .posterior import asked, draw, write_posterior
from .shown import Showing, show

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..fitting import Fit
    from ..posterior import Posterior
    from ..records import Record
    from ..report.report import Report


def fit(
    file: options.File,
    /,
    *more: Annotated[Path, Parameter(help="Further records: then there is one table of all.")],
    stiffness: Annotated[
        list[str] | None,
        Parameter(
            negative=(),
            allow_leading_hyphen=True,
            help="Stiffness with unit: 1.6e-3/um, or 2e6 N/m for a force. Of several files once for"
            " all, or once for each in their order.",
        ),
    ] = None,
    mass: Annotated[
        list[str] | None,
        Parameter(
            negative=(),
            allow_leading_hyphen=True,
            help="Mass with unit, where inertia counts: 2 kg, or 3e-6 s^2/m (over the normal force)"
            " for a coefficient. Of several files as --stiffness.",
        ),
    ] = None,
    law: Annotated[
        tuple[str, ...],
        Parameter(
            negative=(), help="Evolution law, slip or ageing; of several files as --stiffness."
        ),
    ] = ("slip",),
    states: Annotated[Literal["1", "2", "3"], Parameter(help="Number of state variables.")] = "1",
    fit_stiffness: Annotated[
        bool, Parameter(negative=(), help="Fit the stiffness too (then it need not be given).")
    ] = False,
    slip_trend: Annotated[
        bool, Parameter(negative=(), help="Fit a linear change of friction with slip as well.")
    ] = False,
    steps: options.Steps = None,
    reduce: options.Reduce = None,
    column: options.Columns = None,
    drop_bad: options.DropBad = False,
    since: options.Since = None,
    until: options.Until = None,
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
    rows: Annotated[
        int | None,
        Parameter(
            help="Fit means over neighbouring rows, about so many: quicker by as much. White noise"
            " falls with the root of the rows in a mean, and errors are those of what is left."
        ),
    ] = None,
    prior: Annotated[
        Path | None,
        Parameter(
            help="TOML file of priors, [priors] A = {normal = [0.006, 0.001]}: also the posterior"
            ' (posterior.nc, figure). Needs pip install "jaxfric\\[posterior]".'
        ),
    ] = None,
    draws: Annotated[
        int | None, Parameter(help="Draws of each chain by NUTS, as in --draws 1000; else none.")
    ] = None,
    chains: Annotated[int | None, Parameter(help="Chains of draws, 4 where not given.")] = None,
    seed: Annotated[int | None, Parameter(help="Seed of the draws, 0 where not given.")] = None,
    out: options.Out = None,
    details: options.Details = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Fit A, B and L (rate-and-state friction) to a record of velocity steps.

    Writes fit.json, its row for a paper (table.csv, table.tex), fit.png and fit.svg to the output
    folder, by default ./NAME-fit/ with the options that differ from their default:
    ./NAME-fit-ageing/. With --prior also posterior.nc. Of several files (jaxfric fit *.csv) one
    table is printed and written with a row for each; one that cannot be fitted says why in its row,
    and the exit code is 1.
    """
    wanted, every = asked(prior, draws, chains, seed), (file, *more)
    stiffnesses = for_each(every, stiffness or [None], "--stiffness")
    masses = for_each(every, mass or [None], "--mass")
    laws = for_each(every, law, "--law")

    def reading(path: Path) -> "Record":
        return read_record(path, column, drop_bad, since, until, reduce=reduce)

    def fitting(number: int, measured: "Record", say: "Callable[[str], None]") -> "Fit":
        from ..fitting import fit as run

        return run(
            measured,
            stiffness=stiffnesses[number],
            mass=masses[number],
            law=laws[number],
            states=int(states),
            fit_stiffness=fit_stiffness,
            slip_trend=slip_trend,
            steps=steps,
            reference_velocity=reference_velocity,
            start=None if start is None else parse_start(start, measured.friction_unit),
            weighting=weighting,
            profile=profile,
            rows=rows,
            progress=say,
        )

    def together(
        numbers: list[int], records: "list[Record]", say: "Callable[[str], None]"
    ) -> "list[Fit | str]":
        from ..fitting.many import fit_what_can_be

        return fit_what_can_be(
            records,
            [stiffnesses[k] for k in numbers],
            [masses[k] for k in numbers],
            [laws[k] for k in numbers],
            states=int(states),
            fit_stiffness=fit_stiffness,
            slip_trend=slip_trend,
            steps=steps,
            reference_velocity=reference_velocity,
            progress=say,
        )

    if more:
        refuse_for_several({"--prior": prior is not None})
        prepare_jax()
        alone = start is not None or weighting != "ordinary" or profile or rows is not None
        return fit_files(
            every, out, reading, fitting, None if alone else together, Showing(json, details)
        )
    doing(f"reading {file.name}")
    measured = reading(file)
    prepare_jax()
    if wanted is not None:
        from ..fitting.problem import Model

        wanted.check(Model(laws[0], int(states), fit_stiffness, slip_trend), measured.friction_unit)
    folder = choose_folder(out, file.stem, file, *([] if prior is None else [prior]))
    with told() as progress:
        result = fitting(0, measured, progress)
        content = json_text(result.to_json())
        keeps = not result.converged and _has_converged(folder.path / "fit.json")
        posterior = None if wanted is None else wanted.of(result, progress)
        if not keeps:
            progress("drawing the figure")
            _save(result, content, posterior, folder)
    if keeps:
        if json:
            print(content)
        return _complain_and_keep(result, folder)
    show(_report(result, posterior), folder.written, content, Showing(json, details))
    code = folder.close()
    if result.converged:
        return 1 if posterior is not None and posterior.warnings else code
    print(f"jaxfric: error: {_not_converged(result, folder)}", file=sys.stderr)
    return 1


def _save(result: "Fit", content: str, posterior: "Posterior | None", folder: Folder) -> None:
    from ..plot.fit import draw_fit
    from ..report.fits_table import TabledFit, files_of

    tables = files_of([TabledFit(Path(result.record.provenance.path).name, result)])
    with folder.results() as to:
        (to / "fit.json").write_text(content + "\n")
        for name, text in tables.items():
            (to / name).write_text(text, encoding="utf-8", errors="backslashreplace")
        write_posterior(posterior, to)
    folder.draw("the figure", lambda to: draw_fit(result, to / "fit.png", to / "fit.svg"))
    draw(posterior, folder)


def _report(result: "Fit", posterior: "Posterior | None") -> "Report":
    """The report of the fit; where there is a posterior its table comes first."""
    from ..views import report

    fit = report(result)
    if posterior is None:
        return fit
    also = report(posterior)
    return fit._replace(
        tables=[*fit.tables, *also.tables],
        notes=[*fit.notes, *also.notes],
        warnings=[*fit.warnings, *also.warnings],
        short=also.tables[0] if posterior.found else None,
    )


def _has_converged(file: Path) -> bool:
    """Whether a fit that converged was saved here before."""
    import json as text

    try:
        return text.loads(file.read_text()).get("converged") is True
    except (OSError, ValueError, AttributeError):
        return False


def _complain_and_keep(result: "Fit", folder: Folder) -> int:
    """Refuse to replace a fit that converged by one that did not."""
    warn(result.warnings)
    print(
        f"jaxfric: error: {_not_converged(result, folder)}. {folder.path} keeps the fit that"
        " converged there before, and nothing was written; give another folder with --out",
        file=sys.stderr,
    )
    return 1


def _not_converged(result: "Fit", folder: Folder) -> str:
    """What to do; of files only those that this run wrote are named."""
    no_use = ", and no other verb takes its fit.json" if "fit.json" in folder.files else ""
    figure = f"Look at {folder.path / 'fit.png'}: are" if "fit.png" in folder.files else "Are"
    return (
        f"the fit did not converge ({result.result}): its numbers mean nothing{no_use}. {figure}"
        " the steps right ('jaxfric record'), is the stiffness? Else cut the record to fewer steps"
        " (--from, --to), or state a start, as in --start 'A=0.01, B=0.012, L=20 um'"
    )


def parse_start(text: str, friction_unit: str) -> dict[str, float]:
    """Starting values (SI) by name, of "A=0.01, B=0.012, L=20 um". Raises `InputError` for text
    that is not of this form."""
    from ..errors import InputError
    from ..fitting.problem import quantity_of
    from ..fitting.result import unit_of
    from ..pairs import read_pairs
    from ..units import parse_quantity

    found: dict[str, float] = {}
    for name, value in read_pairs(text, "start", "'A=0.01, L=20 um'").items():
        try:
            quantity_of(name)
        except KeyError:
            raise InputError(f"start: '{name}' is no parameter; they are f0, A, B, L, K") from None
        found[name] = parse_quantity(value, unit_of(name, friction_unit), f"start of {name}")
    if not found:
        raise InputError("start: nothing given; write it as in 'A=0.01, L=20 um'")
    return found
