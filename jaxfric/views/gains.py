"""Gains in one line, a report, a figure and a table."""

from ..gains.result import Gains
from ..report.gains_text import report
from .view import Frame, View, number


def line(gains: Gains) -> str:
    """The recommended gains, whether damping or stiffness stabilises, number of scenarios."""
    kp = (
        gains.smallest_kp
        if gains.any_stiffness
        else f"k_p = {number(gains.kp)} {gains.unit('N/m')}"
    )
    how = {"stiff": "held by stiffness", "damped": "held by damping"}
    held = how.get(gains.optima[0].name, gains.optima[0].name) if gains.optima else "no optimum"
    required = ", ".join(
        f"{name} >= {value:g}"
        for name, value in zip(gains.requirement.names, gains.requirement.values, strict=True)
    )
    return (
        f"Gains({kp}, k_v = {number(gains.kv)} {gains.unit('N s/m')}: {held}; {required} in"
        f" {len(gains.scenarios)} scenarios)"
    )


def frame(gains: Gains) -> Frame:
    """One row for each optimum, the recommended optimum first."""
    rows: list[dict[str, object]] = [
        {
            "name": o.name,
            f"kp [{gains.unit('N/m')}]": o.kp,
            f"kv [{gains.unit('N s/m')}]": o.kv,
            "norm": o.norm,
            "minimum": o.minimum,
            "at_limit": o.at_limit,
        }
        for o in gains.optima
    ]
    return Frame(rows, "name", {"law": gains.law, "warnings": list(gains.warnings)})


def figure(gains: Gains):
    """The figure gains.png."""
    from ..plot.gains import gains_figure

    return gains_figure(gains)


VIEW = View(line, report, figure, frame)
