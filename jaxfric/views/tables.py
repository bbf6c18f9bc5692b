"""Results as tables, SI: one row for each parameter, model, step or sample time."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from pandas import DataFrame

from ..errors import InputError
from ..plain import entries
from ..report.fit_text import DIFFERENCE
from ..report.results import MOTION

if TYPE_CHECKING:
    from ..compensation.result import Feedforward
    from ..fitting.axis_fit import AxisFit
    from ..fitting.result import Estimate, Fit
    from ..gains.result import Gains
    from ..gains.set_points import Schedule
    from ..loop.compare import LawComparison
    from ..loop.result import Loop
    from ..loop.steady.loop import SteadyLoop
    from ..posterior.result import Posterior
    from ..prediction.result import Prediction
    from ..protocol.design import Protocol
    from ..records import AxisRecord, Record
    from ..runs.fits import RunFit
    from ..simulation.trajectory import Trajectory


def _table(
    rows: Sequence[Mapping[str, object]] | Mapping[str, np.ndarray],
    index: str = "",
    /,
    **about: object,
) -> DataFrame:
    """A table of rows, or of columns, with attributes; the column `index` names the rows."""
    table = DataFrame(dict(rows) if isinstance(rows, Mapping) else list(rows))
    table = table.set_index(index) if index and len(table) else table
    table.attrs.update(about)
    return table


def _estimated(name: str, estimate: "Estimate") -> dict[str, object]:
    """An estimate as a row; an undetermined one has no error and no interval."""
    row: dict[str, object] = {"name": name, **dataclasses.asdict(estimate)}
    return row if estimate.determined else row | dict.fromkeys(("std", "lower", "upper"))


def axis_fit(fit: "AxisFit") -> DataFrame:
    """One row for each parameter; the standard error `std` is valid only for white residuals."""
    rows = [
        {"name": n, "value": v, "std": fit.std.get(n), "determined": n not in fit.loose}
        for n, v in fit.values.items()
    ]
    return _table(rows, "name", method=fit.method, converged=fit.converged, rms=fit.rms)


def record(record: "Record | AxisRecord") -> DataFrame:
    """The columns of the record; `attrs` contains the units."""
    return _table(record.columns, "time", units=units_of(record), record=record.provenance.path)


def units_of(record: "Record | AxisRecord") -> dict[str, str]:
    """The SI unit of each column of a record."""
    from ..records import Record
    from ..records.axis_units import si_units
    from ..records.record import ROLES

    if isinstance(record, Record):
        return {role: ROLES[role] for role in record.columns} | {"friction": record.friction_unit}
    known = si_units(record.coordinate)
    return {r: record.force_unit if r.endswith("_force") else known[r] for r in record.columns}


def comparison(found: "LawComparison") -> DataFrame:
    """One row for each law with each number of states, as in compare.csv."""
    from ..report.comparison import tabled
    from ..report.fits_table import csv_rows

    rows = csv_rows(tabled(found), "model")
    return _table(rows, "model", sentence=found.sentence, warnings=list(found.warnings))


def feedforward(found: "Feedforward") -> DataFrame:
    """One row for each velocity of the feedforward's table."""
    about = {"formula": found.formula, "fade_speed": found.fade.speed}
    return _table(found.columns(), **about, warnings=list(found.warnings))


def fit(fit: "Fit") -> DataFrame:
    """One row for A-B and for each parameter: meaning, value, std, 95 % interval, unit."""
    from ..report.fit_text import rows

    of = {DIFFERENCE: fit.A_minus_B, **fit.parameters}
    found = []
    for (name, estimate), row in zip(of.items(), rows(fit), strict=True):
        found.append({"name": name, "shown": row.shown} | _estimated(name, estimate))
    return _table(found, "name", **about_fit(fit))


def about_fit(fit: "Fit") -> dict[str, object]:
    """Return the record and law of a fit, and how the fit ended."""
    return {
        "record": fit.record.provenance.path,
        **entries(fit, "law", "converged", "result"),
        "warnings": list(fit.warnings),
    }


def gains(gains: "Gains") -> DataFrame:
    """One row for each optimum, the recommended optimum first."""
    kp, kv = f"kp [{gains.unit('N/m')}]", f"kv [{gains.unit('N s/m')}]"
    rows = [
        entries(o, "name", "norm", "minimum", "at_limit", **{kp: "kp", kv: "kv"})
        for o in gains.optima
    ]
    return _table(rows, "name", law=gains.law, warnings=list(gains.warnings))


def loop(loop: "Loop") -> DataFrame:
    """One row for each parameter of the models before and after adding effects."""
    rows = []
    for model, score in (("before", loop.before), ("after", loop.after)):
        rate = {} if score.A_minus_B is None else {DIFFERENCE: score.A_minus_B}
        of = {**rate, **score.parameters}
        rows += [{"model": model, **_estimated(name, e)} for name, e in of.items()]
    return _table(rows, **about_loop(loop))


def about_loop(loop: "Loop") -> dict[str, object]:
    """Return the record and the result of a loop."""
    return {
        "record": loop.record.provenance.path,
        **entries(loop, "verdict", "sentence"),
        "effects": list(loop.effects),
        "warnings": list(loop.warnings),
    }


def posterior(posterior: "Posterior") -> DataFrame:
    """One row for A-B and each parameter, from the draws or from the Laplace approximation.

    The first columns of this table are in words.
    """
    from ..report.posterior_text import spread_rows

    spreads, maximum, fitted = posterior.parameters, posterior.maximum(), posterior.fitted()
    of = {DIFFERENCE: posterior.fit.A_minus_B, **posterior.fit.parameters}
    rows = [
        {"name": name, "shown": row.shown, "maximum": maximum[name], **spreads[name]._asdict()}
        | {"unit": of[name].unit, "fit": fitted[name].value, "fit_std": fitted[name].std}
        | (posterior.chains[name]._asdict() if name in posterior.chains else {})
        for name, row in spread_rows(posterior, spreads).items()
    ]
    method = "Laplace" if posterior.draws is None else "NUTS"
    about = {"converged": posterior.converged, "warnings": list(posterior.warnings)}
    return _table(rows, "name", method=method, fit=posterior.fit_name, **about)


def prediction(found: "Prediction") -> DataFrame:
    """One row for each comparison of a model with the record."""
    return _table([dataclasses.asdict(c) for c in found.comparisons], **about_prediction(found))


def about_prediction(found: "Prediction") -> dict[str, object]:
    """Model and record of a prediction, and the prediction's result."""
    return {
        "model": found.source,
        "record": found.origin.path,
        **entries(found, "verdict", "sentence"),
        "warnings": list(found.warnings),
    }


def protocol(plan: "Protocol") -> DataFrame:
    """One row for each effect with its smallest identifiable amplitude, or nan."""
    rows = [
        entries(s, "worst", "unit", effect="id", smallest="amplitude") for s in plan.design.smallest
    ]
    alike = [list(pair) for pair in plan.design.pairs()]
    table = _table(rows, "effect", alike=alike, warnings=list(plan.warnings))
    return table.astype({"smallest": float, "worst": float})


def run(run: "RunFit") -> DataFrame:
    """The rows of table.csv; the names of the columns contain the units."""
    from ..runs.table import rows

    return _table(rows(run), "step", record=run.record.provenance.path)


def schedule(schedule: "Schedule") -> DataFrame:
    """One row for each set point."""
    points = [dataclasses.asdict(point) for point in schedule.points]
    return _table(points, "velocity", covered=schedule.covered, warnings=list(schedule.warnings))


def steady(loop: "SteadyLoop") -> DataFrame:
    """One row for each parameter of the final model, SI or % of the rated torque."""
    std = loop.final.std
    rows = [{"name": n, "value": v, "std": std.get(n)} for n, v in loop.final.values.items()]
    return _table(rows, "name", verdict=loop.verdict, effects=list(loop.final.effects))


def trajectory(found: "Trajectory") -> DataFrame:
    """One row for each sample time; raises `InputError` for a batch."""
    from ..simulation.trajectory import result_words

    if batch := np.shape(found.end):
        raise InputError(
            f"a batch of {batch} trajectories is no single table: to_xarray() has all of"
            " it, and jax.tree.map(lambda x: x[0], trajectory) is one of it"
        )
    state = np.asarray(found.state)
    columns = {
        "time [s]": np.asarray(found.time),
        **{f"{name} [{u}]": np.asarray(getattr(found, name)) for name, (u, _) in MOTION.items()},
        **{f"state {k + 1} [F]": state[:, k] for k in range(state.shape[1])},
    }
    result = str(result_words(found.result))
    return _table(columns, "time [s]", result=result, end=float(found.end))
