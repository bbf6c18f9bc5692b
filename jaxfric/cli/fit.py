"""`jaxfric fit`: rate-and-state friction from a record."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

import jaxfric

from ..errors import InputError
from . import options
from .call import current_call
from .common import effect_ids, prepare_jax, refuse_unused, warn
from .fits import FitOptions, Fitter, fit_files, for_each
from .folder import choose_folder
from .plan_line import loop_line
from .posterior import PriorOptions
from .told import doing

if TYPE_CHECKING:
    from ..posterior import Posterior
    from ..report.report import Report


def fit(
    file: options.File,
    /,
    *more: Annotated[Path, Parameter(help="Further records; one table lists all fits.")],
    stiffness: Annotated[list[str] | None, options.STIFFNESS] = None,
    mass: Annotated[list[str] | None, options.MASS] = None,
    law: Annotated[list[str] | None, options.LAW] = None,
    how: FitOptions = FitOptions(),
    reading: options.SliderOptions = options.SliderOptions(),
    prior: PriorOptions = PriorOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Fit A, B and L (rate-and-state friction) to a record of velocity steps.

    The command writes fit.json, a table row for a paper (table.csv, table.tex), fit.png and fit.svg
    to the output folder, by default ./NAME-fit/. Options that differ from their default are part of
    the folder's name, as in ./NAME-fit-ageing/. With --prior the command also writes posterior.nc.
    For several files (jaxfric fit *.csv) the command prints and writes one table with a row for
    each file. If a file cannot be fitted, its row gives the reason, and the exit code is 1.

    With --compare the command fits several laws to one record. If the record has three or more
    steps, each law also predicts steps that it was not fitted to. The command prints which law the
    record supports and by how much, or that the record does not decide. With --compare the command
    writes compare.json, compare.csv, compare.tex, compare.png and compare.svg to ./NAME-compare/.
    """
    prior.refuse_unusable()
    every = (file, *more)
    fitter = Fitter(
        every,
        reading.read,
        for_each(every, stiffness or [None], "--stiffness"),
        for_each(every, mass or [None], "--mass"),
        ["slip"] * len(every) if how.compare else for_each(every, law or ["slip"], "--law"),
        how,
    )
    if how.compare:
        one_law = ("reference_velocity", "start", "weighting", "profile", "prior")
        refuse_unused("--compare", "more", "mass", "states", *one_law)
        return _compare(fitter, law, output)
    if more:
        refuse_unused("several records", "prior")
        prepare_jax()
        return fit_files(fitter, output)
    return _fit_one(file, fitter, prior, output)


def _fit_one(file: Path, fitter: Fitter, prior: PriorOptions, output: options.OutputOptions) -> int:
    measured = fitter.read(file)
    prepare_jax()
    from ..report.fits_table import TabledFit, files_of

    prior.check(fitter.laws[0], fitter.how, measured.friction_unit)
    folder = choose_folder(output, file.stem, file, prior.prior)
    result = fitter.one(0, measured, doing)
    if not result.converged and _has_converged(folder.path / "fit.json"):
        why = f"the fit did not converge ({result.result}). {folder.path} keeps the fit that"
        warn([f"{why} converged there before; give another folder with --out"], "error")
        return 1
    posterior = prior.of(result)
    found = posterior if posterior is not None and posterior.found else None
    tables = files_of([TabledFit(Path(result.record.provenance.path).name, result)])
    folder.save_json("fit.json", result.to_json(), tables, found)
    folder.draw_figure("the figure", result.plot, "fit.png", "fit.svg")
    if found is not None:
        folder.draw_figure("posterior", found.plot)
    code = folder.finish(_report(result, posterior))
    if result.converged:
        return 1 if posterior is not None and posterior.warnings else code
    drift = "" if result.model.slip_trend else " fit a drift with slip (--slip-trend),"
    why = (
        f"the fit did not converge ({result.result}): its numbers mean nothing, and other verbs"
        f" refuse its fit.json. Look at the figure in {folder.path}: are the steps right ('jaxfric"
        f" inspect'), is the stiffness? Else{drift} cut the record to fewer steps (--from, --to),"
        " or give starting values, as in --start 'A=0.01, B=0.012, L=20 um'"
    )
    warn([why], "error")
    return 1


def _has_converged(file: Path) -> bool:
    try:
        return json.loads(file.read_text()).get("converged") is True
    except (OSError, ValueError, AttributeError):
        return False


def _report(result: "jaxfric.Fit", posterior: "Posterior | None") -> "Report":
    """Return the report of the fit and its posterior; the short table is that of a posterior that
    converged, from its draws if there are any."""
    from ..views import report

    fit = report(result)
    if posterior is None:
        return fit
    also = report(posterior)
    return fit._replace(
        tables=[*fit.tables, *also.tables],
        notes=[*fit.notes, *also.notes],
        warnings=[*fit.warnings, *also.warnings],
        short=also.tables[-1] if posterior.converged else None,
    )


def _compare(fitter: Fitter, laws: list[str] | None, output: options.OutputOptions) -> int:
    """Compare laws on the first record; write and print the comparison; return the exit code."""
    file, stiffness, how = fitter.files[0], fitter.stiffnesses[0], fitter.how
    if how.fit_stiffness == (stiffness is not None):
        raise InputError(
            "give one of --stiffness 1.6e-3/um, that of machine and specimen, and --fit-stiffness"
        )
    measured = fitter.read(file)
    prepare_jax()
    from ..report.comparison import files_of
    from ..views import report

    folder = choose_folder(output, file.stem, file)
    found = jaxfric.compare_laws(
        measured,
        stiffness=stiffness,
        laws=effect_ids(laws, "--law") or None,
        slip_trend=how.slip_trend,
        steps=how.steps,
        downsample_to=how.downsample_to,
        progress=doing,
    )
    folder.save_json("compare.json", found.to_json(), files_of(found))
    folder.draw_figure("compare", found.plot)
    told_of = report(found)
    if told_of.next_steps:
        line = loop_line(current_call(), found.of_laws[0].fit.law)
        told_of = told_of._replace(next_steps=[told_of.next_steps[0]._replace(command=line)])
    return folder.finish(told_of)
