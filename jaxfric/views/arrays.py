"""Results as xarray Datasets: arrays in SI over the rows of a record, or over time."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from xarray import Dataset

from ..report.results import MOTION
from .tables import about_fit, about_loop, about_prediction, units_of

if TYPE_CHECKING:
    from ..fitting.result import Fit
    from ..loop.result import Loop
    from ..prediction.result import Prediction
    from ..records import AxisRecord, Record
    from ..simulation.trajectory import Trajectory


def _over_time(
    time: np.ndarray,
    values: Mapping[str, tuple[np.ndarray, str, str]],
    about: Mapping[str, object],
) -> Dataset:
    """Arrays over time, each with its unit and its meaning, and common attributes."""
    variables = {
        name: ("time", array, {"units": unit, "long_name": text})
        for name, (array, unit, text) in values.items()
    }
    since = {"units": "s", "long_name": "time since the first row"}
    return Dataset(variables, {"time": ("time", time, since)}, about)


def record(record: "Record | AxisRecord") -> Dataset:
    """The columns of the record over time."""
    units = units_of(record)
    columns = {r: (v, units[r], r.replace("_", " ")) for r, v in record.columns.items()}
    time, *_ = columns.pop("time")
    return _over_time(time, columns, {"record": record.provenance.path})


def fit(fit: "Fit") -> Dataset:
    """Measured friction, fitted friction and residual, at the rows of the record."""
    unit = fit.record.friction_unit
    values = {
        "friction": (fit.record.friction, unit, "friction as recorded"),
        "predicted": (fit.predicted, unit, "fitted friction"),
        "residual": (fit.residual, unit, "record minus fit"),
    }
    return _over_time(fit.record.relative_time, values, about_fit(fit))


def loop(loop: "Loop") -> Dataset:
    """Residuals of the models before and after adding effects, and the data block of every row."""
    from ..loop.split import NAMES

    unit = loop.record.friction_unit
    block = np.full(len(loop.before.residual), "", dtype=object)
    for name in NAMES:
        block[loop.blocks.of(name)] = name
    values = {
        "residual_before": (-loop.before.residual, unit, "record minus model before"),
        "residual_after": (-loop.after.residual, unit, "record minus model after"),
        "noise": (loop.row_sigma(), unit, "standard deviation of the noise"),
        "block": (block.astype(str), "", "train, select or report; or none"),
    }
    return _over_time(loop.record.relative_time, values, about_loop(loop))


def prediction(found: "Prediction") -> Dataset:
    """Measured and predicted values at the compared rows."""
    values = {
        "recorded": (found.recorded, found.force_unit, "as recorded"),
        "predicted": (found.predicted, found.force_unit, "as predicted; nan: not compared"),
    }
    return _over_time(found.time, values, about_prediction(found))


def trajectory(found: "Trajectory") -> Dataset:
    """All values of the trajectory over time; each axis of a batch is a further dimension."""
    from ..simulation.trajectory import result_words

    batch = tuple("member" if k == 0 else f"member_{k}" for k in range(np.ndim(found.end)))
    words = np.asarray(result_words(found.result), dtype=str)
    state = {"units": "F", "long_name": "state variables of the friction law"}
    variables = {
        "state": ((*batch, "time", "number"), np.asarray(found.state), state),
        "result": (batch, words, {"long_name": "how the simulation ended"}),
        "end": (batch, np.asarray(found.end), {"units": "s", "long_name": "time that it reached"}),
    }
    for name, (unit, text) in MOTION.items():
        about = {"units": unit, "long_name": text}
        variables[name] = ((*batch, "time"), np.asarray(getattr(found, name)), about)
    time, about = np.asarray(found.time), {"units": "s", "long_name": "sample times"}
    first = time.reshape(-1, time.shape[-1])[0]
    if np.all(time == first):
        return Dataset(variables, {"time": ("time", first, about)})
    return Dataset(variables | {"sample_time": ((*batch, "time"), time, about)})
