"""A closed loop in one line, a report, a figure and tables."""

import numpy as np

from ..loop.result import Loop, Score
from ..loop.split import NAMES
from ..plot.label import printable
from ..report.fit_text import DIFFERENCE
from ..report.loop_report import report
from ..report.loop_text import headline
from .fit import estimated
from .view import Arrays, Frame, Variable, View


def line(loop: Loop) -> str:
    """The verdict, and the test error before and after."""
    errors = [f"{loop.test_error(score):.2f}" for score in (loop.before, loop.after)]
    name = printable(loop.record.provenance.path)
    found = headline(loop)
    told = f"test error {' -> '.join(dict.fromkeys(errors))} of the noise"
    return f"Loop({name}: {loop.verdict}. {found}; {told})"


def _attributes(loop: Loop) -> dict[str, object]:
    return {
        "record": loop.record.provenance.path,
        "verdict": loop.verdict,
        "sentence": loop.sentence,
        "effects": list(loop.effects),
        "warnings": list(loop.warnings),
    }


def _rows(model: str, score: Score) -> list[dict[str, object]]:
    rate = score.A_minus_B
    of = {**({} if rate is None else {DIFFERENCE: rate}), **score.parameters}
    return [{"model": model, **estimated(name, e)} for name, e in of.items()]


def frame(loop: Loop) -> Frame:
    """One row for each parameter of the model before, and of the model after."""
    rows = [*_rows("before", loop.before), *_rows("after", loop.after)]
    return Frame(rows, "", _attributes(loop))


def arrays(loop: Loop) -> Arrays:
    """Residuals of the model before and of the model after, and the block of every row."""
    unit, rows = loop.record.friction_unit, ("time",)
    block = np.full(len(loop.before.residual), "", dtype=object)
    for name in NAMES:
        block[loop.blocks.of(name)] = name
    text = "record minus model"
    return Arrays(
        {
            "residual_before": Variable(rows, -loop.before.residual, unit, f"{text} before"),
            "residual_after": Variable(rows, -loop.after.residual, unit, f"{text} after"),
            "noise": Variable(rows, loop.row_sigma(), unit, "standard deviation of the noise"),
            "block": Variable(rows, block.astype(str), "", "train, select or report; or none"),
        },
        {"time": Variable(rows, loop.record.relative_time, "s", "time since the first row")},
        _attributes(loop),
    )


def figure(loop: Loop):
    """The figure residual.png: record minus model, before and after."""
    from ..plot.loop import residual_figure

    return residual_figure(loop)


VIEW = View(line, report, figure, frame, arrays)
