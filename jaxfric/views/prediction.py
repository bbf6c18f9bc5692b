"""A prediction in one line, a report, a figure and tables."""

import dataclasses

from ..plot.label import printable
from ..prediction.result import Prediction
from ..report.prediction_text import tables
from ..report.report import Report
from .view import Arrays, Frame, Variable, View

_VERDICTS = {
    "noise": "as good as the noise allows",
    "parameters": "other parameters fit this record better",
    "model": "the model lacks an effect here",
}


def line(found: Prediction) -> str:
    """The prediction error in units of the noise, and its causes."""
    ratio, name = found.rms / found.sigma, printable(found.origin.path)
    return (
        f"Prediction({name} by {found.source}: error {ratio:.2f} times the noise;"
        f" {_VERDICTS[found.verdict]})"
    )


def report(found: Prediction) -> Report:
    """The sentence, the notes and the tables that `jaxfric predict` prints."""
    notes = [f"  - {note}" for note in found.notes]
    told = (found.sentence, *notes[:2])
    return Report(told, tables(found), notes[2:], warnings=found.warnings)


def _attributes(found: Prediction) -> dict[str, object]:
    return {
        "model": found.source,
        "record": found.origin.path,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "warnings": list(found.warnings),
    }


def frame(found: Prediction) -> Frame:
    """One row for each comparison of a model with the record."""
    return Frame([dataclasses.asdict(c) for c in found.comparisons], "", _attributes(found))


def arrays(found: Prediction) -> Arrays:
    """Measured and predicted values at the compared rows."""
    unit, rows = found.force_unit, ("time",)
    return Arrays(
        {
            "recorded": Variable(rows, found.recorded, unit, "as recorded"),
            "predicted": Variable(rows, found.predicted, unit, "as predicted; nan: not compared"),
        },
        {"time": Variable(rows, found.time, "s", "time since the first row")},
        _attributes(found),
    )


def figure(found: Prediction):
    """The figure prediction.png."""
    from ..plot.prediction import prediction_figure

    return prediction_figure(found)


VIEW = View(line, report, figure, frame, arrays)
