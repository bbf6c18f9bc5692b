"""`jaxfric fit`: rate-and-state friction from a record."""

import functools
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from cyclopts import Parameter

from . import options
from .common import doing, prepare_jax, refuse_unused, told, warn
from .compare import compare_record
from .fits import Said, fit_files, for_each
from .folder import Folder, choose_folder, json_text
from .posterior import PriorOptions, draw, write_posterior
from .shown import show

if TYPE_CHECKING:
    from ..fitting import Fit
    from ..posterior import Posterior
    from ..records import Record
    from ..report.report import Report

_WEIGHTINGS = {"ols": "ordinary", "gls": "whitened"}
"""Names of the choices of --weighting in Python and in files."""


@options.FLAT
@dataclass(frozen=True)
class FitOptions:
    """How a model is fitted."""

    reference_velocity: Annotated[options.Text, options.MORE] = None
    """Reference velocity with unit, at which steady-state friction is f0."""
    start: Annotated[str | None, options.MORE] = None
    """Starting values, 'A=0.01, B=0.012, L=20 um'. Rarely needed."""
    weighting: Annotated[Literal["ols", "gls"], options.MORE] = "ols"
    """Ordinary least squares (ols), or generalised (gls): whitened by the noise model."""
    profile: Annotated[bool, options.MORE] = False
    """Intervals from the profile likelihood (slower)."""
    downsample_to: options.DownsampleTo = None

    @property
    def of_one(self) -> bool:
        """Whether an option is given that the batched fit of many records does not have."""
        return self != FitOptions(reference_velocity=self.reference_velocity)


class Fitter(NamedTuple):
    """The fit of several records, with one stiffness, mass and law for each file."""

    stiffnesses: Sequence[str | None]
    masses: Sequence[str | None]
    laws: Sequence[str]
    model: options.ModelOptions
    how: FitOptions
    steps: str | None

    def one(self, number: int, record: "Record", say: Said) -> "Fit":
        """Fit the record of file `number`."""
        from ..fitting import fit as run
        from ..fitting.typed import typed_parameters

        how, model = self.how, self.model
        return run(
            record,
            stiffness=self.stiffnesses[number],
            mass=self.masses[number],
            law=self.laws[number],
            states=int(model.states),
            fit_stiffness=model.fit_stiffness,
            slip_trend=model.slip_trend,
            steps=self.steps,
            reference_velocity=how.reference_velocity,
            start=None if how.start is None else typed_parameters(how.start, record.friction_unit),
            weighting=_WEIGHTINGS[how.weighting],
            profile=how.profile,
            rows=how.downsample_to,
            progress=say,
        )

    def together(self, numbers: list[int], records: "list[Record]", say: Said) -> "list[Fit | str]":
        """Fit many records in one batch; a failed record returns its reason in place of a fit."""
        from ..fitting.many import fit_what_can_be

        return fit_what_can_be(
            records,
            [self.stiffnesses[k] for k in numbers],
            [self.masses[k] for k in numbers],
            [self.laws[k] for k in numbers],
            states=int(self.model.states),
            fit_stiffness=self.model.fit_stiffness,
            slip_trend=self.model.slip_trend,
            steps=self.steps,
            reference_velocity=self.how.reference_velocity,
            progress=say,
        )


def fit(
    file: options.File,
    /,
    *more: Annotated[Path, Parameter(help="Further records; one table lists all fits.")],
    stiffness: Annotated[list[str] | None, options.STIFFNESS] = None,
    mass: Annotated[list[str] | None, options.MASS] = None,
    law: Annotated[list[str] | None, options.LAW] = None,
    compare: Annotated[
        bool,
        Parameter(
            help="Compare friction laws: slip and ageing, with one and with two states. Choose"
            " others with --law 'slip,ageing'."
        ),
    ] = False,
    model: options.ModelOptions = options.ModelOptions(),
    steps: options.Steps = None,
    how: FitOptions = FitOptions(),
    reading: options.RecordOptions = options.RecordOptions(),
    reduce: options.Reduce = None,
    prior: PriorOptions = PriorOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Fit A, B and L (rate-and-state friction) to a record of velocity steps.

    Writes fit.json, a table row for a paper (table.csv, table.tex), fit.png and fit.svg to the
    output folder, by default ./NAME-fit/. Options that differ from their default are part of the
    folder's name, as in ./NAME-fit-ageing/. With --prior the command also writes posterior.nc. For
    several files (jaxfric fit *.csv) the command prints and writes one table with a row for each
    file. If a file cannot be fitted, its row gives the reason, and the exit code is 1.

    With --compare the command fits several laws to one record. If the record has three or more
    steps, each law also predicts steps that it was not fitted to. The command prints which law the
    record supports and by how much, or that the record does not decide. It writes compare.json,
    compare.csv, compare.tex, compare.png and compare.svg to ./NAME-compare/.
    """
    prior.refuse_unusable()
    every, read = (file, *more), functools.partial(reading.slider, reduce=reduce)
    fitter = Fitter(
        for_each(every, stiffness or [None], "--stiffness"),
        for_each(every, mass or [None], "--mass"),
        ["slip"] * len(every) if compare else for_each(every, law or ["slip"], "--law"),
        model,
        how,
        steps,
    )
    if compare:
        unused = {
            "a further file": more,
            "--mass": mass,
            "--states": model.states != "1",
            "--reference-velocity": how.reference_velocity,
            "--start": how.start,
            "--weighting": how.weighting != "ols",
            "--profile": how.profile,
            "--prior": prior.prior,
        }
        refuse_unused("--compare", unused)
        K = fitter.stiffnesses[0]
        return compare_record(file, read, K, law, model, steps, how.downsample_to, output)
    if more:
        refuse_unused("several records", {"--prior": prior.prior})
        prepare_jax()
        together = None if how.of_one else fitter.together
        return fit_files(every, output, read, fitter.one, together)
    return _fit_one(file, read, fitter, prior, output)


def _fit_one(
    file: Path,
    read: "Callable[[Path], Record]",
    fitter: Fitter,
    prior: PriorOptions,
    output: options.OutputOptions,
) -> int:
    doing(f"reading {file.name}")
    measured = read(file)
    prepare_jax()
    from ..fitting.problem import Model

    model = fitter.model
    shape = Model(fitter.laws[0], int(model.states), model.fit_stiffness, model.slip_trend)
    prior.check(shape, measured.friction_unit)
    inputs = [file] if prior.prior is None else [file, prior.prior]
    folder = choose_folder(output.folder, file.stem, *inputs)
    with told() as progress:
        result = fitter.one(0, measured, progress)
        content = json_text(result.to_json())
        keeps = not result.converged and _has_converged(folder.path / "fit.json")
        posterior = prior.of(result, progress)
        if not keeps:
            progress("drawing the figure")
            _save(result, content, posterior, folder)
    if keeps:
        if output.json:
            print(content)
        return _complain_and_keep(result, folder)
    show(_report(result, posterior), folder.written, content, output)
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
    """Return the report of the fit, with the table of the posterior first if there is one."""
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
    """Whether the file holds a fit that converged."""
    try:
        return json.loads(file.read_text()).get("converged") is True
    except (OSError, ValueError, AttributeError):
        return False


def _complain_and_keep(result: "Fit", folder: Folder) -> int:
    """Refuse to replace a converged fit by one that did not converge; the exit code."""
    warn(result.warnings)
    print(
        f"jaxfric: error: {_not_converged(result, folder)}. {folder.path} keeps the fit that"
        " converged there before, and nothing was written; give another folder with --out",
        file=sys.stderr,
    )
    return 1


def _not_converged(result: "Fit", folder: Folder) -> str:
    """Return what to do after a failed fit; it names only files that this run wrote."""
    no_use = ", and other verbs refuse its fit.json" if "fit.json" in folder.files else ""
    figure = f"Look at {folder.path / 'fit.png'}: are" if "fit.png" in folder.files else "Are"
    return (
        f"the fit did not converge ({result.result}): its numbers mean nothing{no_use}. {figure}"
        " the steps right ('jaxfric inspect'), is the stiffness? Else cut the record to fewer steps"
        " (--from, --to), or give starting values, as in --start 'A=0.01, B=0.012, L=20 um'"
    )
