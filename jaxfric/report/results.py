"""Reports of results for which the command prints no separate report."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..coordinate import unit_of
from ..quantity import is_known
from .html import printable
from .report import Report
from .tables import TextTable

if TYPE_CHECKING:
    from ..fitting.axis_fit import AxisFit
    from ..gains.set_points import Schedule
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
    name, columns = printable(Path(record.provenance.path).name), ", ".join(record.columns)
    return report._replace(headline=[f"{name}: {record.sampling()}; {columns}", *report.headline])


def record(record: "Record") -> Report:
    """Report columns, sampling and velocity steps of a record, as `jaxfric inspect` does."""
    from ..records import record_steps
    from .record import report

    return _with_columns(record, report(record, record_steps(record)))


def axis_record(record: "AxisRecord") -> Report:
    """Report columns, sampling and strokes of an axis record, as `jaxfric inspect` does."""
    from ..records.strokes import find_strokes
    from .record import report_axis

    return _with_columns(record, report_axis(record, find_strokes(record)))


def axis_fit(fit: "AxisFit") -> Report:
    """Report the fitted parameters of an axis with their errors, in SI."""
    from .axis_loop_text import values_of

    failed = () if fit.converged else ("the fit did not converge: its numbers mean nothing",)
    values = ", ".join(f"{name} = {value:.4g}" for name, value in fit.values.items())
    told = f"{fit.method}: relative error {100 * fit.relative_error:.3g} %, {values}"
    note = f"SI; errors of white noise in brackets; rms of the residual {fit.rms:.4g}"
    table = TextTable(fit.method, ("parameter", "value"), [*values_of(fit).items()], note)
    return Report((*failed, told), [table], warnings=failed)


def schedule(schedule: "Schedule") -> Report:
    """Report a table of set points: gains, and velocity jumps after which the slider settles."""
    units = [unit_of(unit, schedule.coordinate) for unit in ("m/s", "N/m", "N s/m")]
    pairs = zip(("velocity", "k_p", "k_v"), units, strict=True)
    head = (*(f"{name} [{unit}]" for name, unit in pairs), "jump up", "jump down")
    rows = []
    for point in schedule.points:
        *numbers, up_lost, down_lost = dataclasses.astuple(point)
        more = ("", "", "", *(" or more" * (lost == "steady") for lost in (up_lost, down_lost)))
        rows.append(tuple(f"{x:.4g}{after}" for x, after in zip(numbers, more, strict=True)))
    note = "jump: factor by which velocity may change at once for the slider to settle here"
    slow, fast = rows[0][0], rows[-1][0]
    words = {True: "chained", False: "not chained", None: "not known to be chained"}
    chained = words[schedule.covered]
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
