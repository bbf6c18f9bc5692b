"""A planned protocol in one line, a report, a figure and a table."""

from ..protocol.design import Protocol
from ..report.protocol_text import report
from .view import Frame, View


def line(plan: Protocol) -> str:
    """Number of velocities, and number of pairs of effects that the plan cannot distinguish."""
    pairs = len(plan.design.pairs())
    return (
        f"Protocol({len(plan.velocities)} velocities over {plan.duration:.6g} s, {plan.law} law:"
        f" {pairs} pairs of effects not told apart)"
    )


def frame(plan: Protocol) -> Frame:
    """One row for each effect: the smallest identifiable amplitude [unit], nan if there is none."""
    rows = [
        {
            "effect": s.id,
            "smallest": float("nan") if s.amplitude is None else s.amplitude,
            "worst": float("nan") if s.worst is None else s.worst,
            "unit": s.unit,
        }
        for s in plan.design.smallest
    ]
    alike = [list(pair) for pair in plan.design.pairs()]
    return Frame(rows, "effect", {"alike": alike, "warnings": list(plan.warnings)})


def figure(plan: Protocol):
    """The figure aliasing.png."""
    from ..plot.loop import aliasing_figure

    return aliasing_figure(plan.design.ids, plan.design.cosines, what="this plan")


VIEW = View(line, report, figure, frame)
