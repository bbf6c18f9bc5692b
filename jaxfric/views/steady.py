"""The loop of runs at steady speeds in one line, a report, a figure and a table."""

from ..loop.steady.loop import SteadyLoop
from ..plot.label import printable
from ..report.steady_text import report
from .view import Frame, View


def line(loop: SteadyLoop) -> str:
    """The verdict, and the number of runs."""
    name, found = printable(loop.curve.provenance.path), " + ".join(loop.final.effects)
    told = f"{loop.verdict}{f': {found}' if found else ''}"
    return f"SteadyLoop({name}: {len(loop.curve.names)} runs; {told})"


def frame(loop: SteadyLoop) -> Frame:
    """One row for each parameter of the final model, SI or % of the rated torque."""
    values, std = loop.final.values, loop.final.std
    rows: list[dict[str, object]] = [
        {"name": name, "value": value, "std": std.get(name)} for name, value in values.items()
    ]
    return Frame(rows, "name", {"verdict": loop.verdict, "effects": list(loop.final.effects)})


def figure(loop: SteadyLoop):
    """The figure curve.png."""
    from ..plot.steady import steady_figure

    return steady_figure(loop)


VIEW = View(line, report, figure, frame)
