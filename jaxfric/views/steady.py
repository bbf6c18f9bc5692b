"""The loop of runs at steady speeds in a line, a page, a figure and a table."""

from ..loop.steady.loop import SteadyLoop
from ..plot.label import printable
from ..report.steady_text import sentence, tables
from .view import Frame, Page, View


def line(loop: SteadyLoop) -> str:
    """The verdict over how many runs."""
    name, found = printable(loop.curve.provenance.path), " + ".join(loop.final.effects)
    told = f"{loop.verdict}{f': {found}' if found else ''}"
    return f"SteadyLoop({name}: {len(loop.curve.names)} runs; {told})"


def page(loop: SteadyLoop) -> Page:
    """The verdict, what follows for gains, and the tables, as `jaxfric axis` prints them."""
    return Page((f"{loop.verdict}: {loop.sentence}", sentence(loop)), tables(loop))


def frame(loop: SteadyLoop) -> Frame:
    """A row for every parameter of the final model, SI or % of the rated torque."""
    values, std = loop.final.values, loop.final.std
    rows: list[dict[str, object]] = [
        {"name": name, "value": value, "std": std.get(name)} for name, value in values.items()
    ]
    return Frame(rows, "name", {"verdict": loop.verdict, "effects": list(loop.final.effects)})


def figure(loop: SteadyLoop):
    """The figure curve.png."""
    from ..plot.steady import steady_figure

    return steady_figure(loop)


VIEW = View(line, page, figure, frame)
