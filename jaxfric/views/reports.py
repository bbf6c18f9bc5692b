"""Reports of results for which the command prints no separate report."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from ..coordinate import unit_of
from ..quantity import is_known
from ..report.report import NextStep, Report
from ..report.tables import TextTable

if TYPE_CHECKING:
    from ..fitting.axis_fit import AxisFit
    from ..fitting.result import Fit
    from ..gains.set_points import Schedule
    from ..loop.compare import LawComparison
    from ..posterior.result import Posterior
    from ..prediction.result import Prediction
    from ..records import AxisRecord, Record
    from ..simulation.trajectory import Trajectory

MOTION = {
    "force": ("F", "friction force on the slider"),
    "recorded": ("F", "the force as the sensor records it"),
    "velocity": ("m/s", "velocity of the slider"),
    "slip": ("m", "displacement of the slider since the start"),
}
"""Unit and meaning of the values of a trajectory; F is the unit of friction."""


def _with_columns(record: "Record | AxisRecord", report: Report) -> Report:
    """The report of a record, below its file, sampling and columns in one line."""
    from ..plot.label import printable

    name, columns = printable(record.provenance.path), ", ".join(record.columns)
    return report._replace(headline=[f"{name}: {record.sampling()}; {columns}", *report.headline])


def record(record: "Record") -> Report:
    """Report columns, sampling and velocity steps of a record, as `jaxfric inspect` does."""
    from ..records import record_steps
    from ..report.record_text import report

    return _with_columns(record, report(record, record_steps(record)))


def axis_record(record: "AxisRecord") -> Report:
    """Report columns, sampling and strokes of an axis record, as `jaxfric inspect` does."""
    from ..records.strokes import find_strokes
    from ..report.axis_record_text import report_axis

    return _with_columns(record, report_axis(record, find_strokes(record)))


def fit(fit: "Fit") -> Report:
    """The table of parameters and the sentences that `jaxfric fit` prints."""
    from ..report.fit_text import headline, rows, summary

    head = ("", "", "value", "std", "95 % interval", "unit")
    states = "" if fit.model.states == 1 else f", {fit.model.states} states"
    table = TextTable(f"{fit.law} law{states}", head, [tuple(row) for row in rows(fit)])
    return Report(headline(fit), [table], notes=summary(fit), warnings=fit.warnings)


def posterior(posterior: "Posterior") -> Report:
    """Report a posterior: ordinary fit, maximum, Laplace approximation and draws."""
    from ..report.posterior_text import posterior_lines, posterior_rows

    rows = posterior_rows(posterior)
    by = "Laplace approximation" if posterior.draws is None else "NUTS"
    told = [f"{r.name.partition(' ')[0]} = {r.shown}" for r in rows if r.name[0] in "ABL"]
    end = "" if posterior.converged else "; did not converge: it claims nothing"
    head = ("", "prior", posterior.fit_name, "maximum", "mean", "std", "95 % interval", "unit")
    found = [(r.name, r.prior, r.fit, r.maximum, *r.laplace, r.unit) for r in rows]
    tables = [TextTable("posterior", head, found)]
    if posterior.draws is not None:
        head = ("", "mean", "std", "95 % interval", "R-hat", "ESS bulk", "tail", "unit")
        tables.append(TextTable("draws", head, [(r.name, *r.draws, r.unit) for r in rows]))
    headline = [f"{posterior.fit.law} law, {by}: {', '.join(told)}{end}"]
    notes = posterior_lines(posterior)
    return Report(headline, tables, notes=notes, warnings=posterior.warnings)


def prediction(found: "Prediction") -> Report:
    """The sentence, the notes and the tables that `jaxfric predict` prints."""
    from ..report.prediction_text import tables

    notes = [f"  - {note}" for note in found.notes]
    told = (found.sentence, *notes[:2])
    return Report(told, tables(found), notes[2:], warnings=found.warnings)


def comparison(found: "LawComparison") -> Report:
    """The sentence and the table that `jaxfric fit --compare` prints."""
    from ..report.comparison import table

    steps = [NextStep(found.next_step)] if found.next_step else []
    return Report((found.sentence,), [table(found)], warnings=found.warnings, next_steps=steps)


def axis_fit(fit: "AxisFit") -> Report:
    """Report the fitted parameters of an axis with their errors, in SI."""
    rows = [
        (name, "undetermined", "")
        if name in fit.loose
        else (name, f"{value:.4g}", f"{fit.std[name]:.2g}" if name in fit.std else "")
        for name, value in fit.values.items()
    ]
    failed = () if fit.converged else ("the fit did not converge: its numbers mean nothing",)
    values = ", ".join(f"{name} = {value:.4g}" for name, value in fit.values.items())
    told = f"{fit.method}: relative error {100 * fit.relative_error:.3g} %, {values}"
    note = f"SI; rms of the residual {fit.rms:.4g}"
    table = TextTable(fit.method, ("parameter", "value", "std if white"), rows, note)
    return Report((*failed, told), [table], warnings=failed)


def schedule(schedule: "Schedule") -> Report:
    """Report a table of set points: gains, and velocity jumps after which the slider settles."""
    units = [unit_of(unit, schedule.coordinate) for unit in ("m/s", "N/m", "N s/m")]
    pairs = zip(("velocity", "k_p", "k_v"), units, strict=True)
    head = (*(f"{name} [{unit}]" for name, unit in pairs), "jump up", "jump down")
    rows = [tuple(f"{x:.4g}" for x in dataclasses.astuple(point)) for point in schedule.points]
    note = "jump: factor by which velocity may change at once for the slider to settle here"
    slow, fast, chained = rows[0][0], rows[-1][0], "chained" if schedule.covered else "not chained"
    if schedule.gap is not None:
        chained = "broken between {:.3g} and {:.3g} {}".format(*schedule.gap, units[0])
    told = f"{len(rows)} set points, {slow} to {fast} {units[0]}; {chained}"
    table = TextTable("Set points", head, rows, note)
    return Report([told], [table], warnings=schedule.warnings)


def trajectory(found: "Trajectory") -> Report:
    """Report how the motion ended, its final values, and the reason of an early end.

    A trajectory traced by JAX has no values to report.
    """
    from ..simulation.trajectory import RESULTS, result_words

    batch, times = np.shape(found.end), np.shape(found.force)[-1]
    told = f"batch of {' x '.join(map(str, batch))}, {times} times" if batch else f"{times} times"
    if not is_known(found.end):
        return Report([f"{told}; being traced"])
    names, counts = np.unique(result_words(found.result), return_counts=True)
    ends = [f"{c} {n}" if batch else n for n, c in zip(names, counts, strict=True)]
    told += f" to {float(np.max(np.asarray(found.end))):.6g} s; {', '.join(ends)}"
    lines = [
        f"{text} [{unit}]: {np.min(values):.6g} to {np.max(values):.6g}"
        for name, (unit, text) in MOTION.items()
        for values in [np.asarray(getattr(found, name))]
    ]
    lines.append(f"steps of the solver: {np.max(found.num_steps)}{' at most' if batch else ''}")
    early = [] if batch or found.result == RESULTS.successful else [RESULTS[found.result]]
    return Report([told], lines=lines, warnings=[" ".join(text.split()) for text in early])
