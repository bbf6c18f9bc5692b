"""Describe a feedforward as text: its terms, its fade speed, and the conditions for use."""

import math
from collections.abc import Sequence

from ..compensation.pieces import SIGN, uses_position
from ..compensation.result import Feedforward
from ..compensation.spot import FrictionAt
from .report import Report
from .tables import TextTable
from .version import installed_version
from .words import say


def tables(found: Feedforward) -> list[TextTable]:
    """The terms of the feedforward with their errors, and the reasons for the fade speed."""
    terms = [
        (p.name, f"{p.value:.5g}", _error(p.std), p.unit, _times(p.part, p.text))
        for p in found.pieces
    ]
    speed = f"{found.about.length}/s"
    fades = f"s = tanh(v/v_f), v_f = {found.fade.speed:.4g} {speed}"
    note = f"SI; errors of this model alone, without rival models; {fades}"
    reasons = [
        (one.name, "?" if math.isnan(one.speed) else f"{one.speed:.4g}", one.text)
        for one in found.fade.reasons
    ]
    marked = tuple(k for k, one in enumerate(found.fade.reasons) if one.speed == found.fade.speed)
    return [
        TextTable("Terms", ("term", "value", "±", "unit", "times"), terms, note),
        TextTable("Fade speed", ("by", f"v_f [{speed}]", "why"), reasons, "", marked),
    ]


def _error(std: float) -> str:
    return "undetermined" if math.isnan(std) else f"{std:.2g}" if std else "given"


def _times(part: str, factor: str) -> str:
    return " ".join(filter(None, ["s" if part == SIGN else "", factor])) or "1"


def spoken(found: Feedforward, here: FrictionAt) -> str:
    """Friction at a speed in words, and how reliable the value is."""
    about, speed = found.about, f"{found.about.length}/s"
    unit = about.force_unit
    ways = {name: getattr(here, name).text(unit) for name in ("forwards", "backwards", "mean")}
    place = say("friction.middle") if uses_position(found.pieces) else ""
    text = say("friction.at", at=here.speed, speed=speed, place=place, **ways) + found.within(here)
    if here.faded:
        text += say("friction.faded", given=here.given(unit), sign=here.sign)
    if not here.supported:
        text += say("friction.guess", slowest=about.slowest, fastest=about.fastest, speed=speed)
        text += say("friction.held") if here.speed > found.curve.held else ""
    return text


def report(found: Feedforward, asked: Sequence[FrictionAt] = ()) -> Report:
    """Report friction at the requested speeds, the feedforward's formula, and its conditions."""
    told = [*(f"{spoken(found, here)}." for here in asked), found.sentence, found.formula]
    notes = [f"  - left out: {line}" for line in found.left_out]
    notes += [f"  - {line}" for line in found.cautions]
    return Report(told, tables(found), notes=notes, warnings=found.warnings)


def tex(found: Feedforward) -> str:
    """The formula as a LaTeX equation, with units and errors in comments."""
    length = found.about.length
    rows = [f"% {p.name} = {p.value:.6g} +- {_error(p.std)} {p.unit}" for p in found.pieces]
    head = f"% u in {found.about.force_unit}; v in {length}/s, a in {length}/s^2, q in {length}"
    left = [f"% left out: {line}" for line in found.left_out]
    left += [f"% warning: {line}" for line in found.warnings]
    body = ["\\begin{equation}", f"  {found.latex}", "\\end{equation}"]
    return "\n".join([head, *rows, *left, *body]) + "\n"


def made_by(command: str) -> list[str]:
    """Comment lines for the C source: the version and command that made the feedforward."""
    return [f"made by jaxfric {installed_version()}: {command}"] if command else []
