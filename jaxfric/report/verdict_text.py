"""Put a loop's verdict into words: its sentence, the reasons that limit it, and every finding."""

import typing
from collections.abc import Sequence

from ..errors import option
from ..findings import Finding, Severity
from ..loop.family import CurveFamily, listed
from ..loop.findings import LoopCode
from ..loop.refusal import Fault, Move, Refusal
from ..loop.thresholds import ACCEPT, FAR, SIGNIFICANT
from ..loop.verdict import Conclusion, Told
from ..units import p_text, prefixed
from .estimates import bracketed
from .location_text import variable_words, where_it_sits
from .words import TEMPLATES, say

_SLOW = {"block_means", "slip", "time", "periodic_in_slip"}
"""Tests that find slow changes along the record."""
_BLOCKS = {"report": "test", "select": "validation", "train": "train"}


def reasons(found: Conclusion) -> tuple[str, ...]:
    """List the reasons that limit the verdict, one reason in each line."""
    return tuple(words_of(one) for one in found.findings if one.code is not LoopCode.MOVED)


def sentence(found: Conclusion) -> str:
    """The verdict in words."""
    codes, told = {one.code: one for one in found.findings}, found.told
    if told is None:
        return _withheld(found.findings[0])
    named, changed = listed(told.effects), change(told)
    if LoopCode.MOVED in codes:
        moves = words_of(codes[LoopCode.MOVED])
        return say("verdict.moved", named=named, moves=moves, change=changed)
    match found.verdict:
        case "no_missing_effect":
            return say("verdict.no_missing_effect", before=told.before)
        case "too_weak":
            return _too_weak(told)
        case "outside_catalogue":
            return _outside(found, told, named)
    curves = [id for family in found.families for id in family.effects]
    what = [id for id in told.effects if id not in curves]
    decided = ""
    for family in found.families:
        shapes = listed([listed(family.effects), *family.fitting], "or")
        what.append(f"a steady curve of velocity ({shapes})")
        if family.decided_by:
            decided = f" To decide: {where_told(family)}."
    pairs = "; ".join(f"{a} or {b}" for a, b in told.rivals)
    alike = f", or what looks like it ({pairs})" if pairs else ""
    text = say("verdict.effects", what=listed(what), alike=alike, change=changed, gain=told.gain)
    return text + decided


def _too_weak(told: Told) -> str:
    code = "too_weak"
    if told.before > FAR * told.most:
        code = "base_misses"
    elif told.p_value < SIGNIFICANT:
        code = "too_weak_but_left"
    values = {"before": told.before, "most": told.most, "accept": ACCEPT}
    return say(f"verdict.{code}", p=p_text(told.p_value), **values)


def small(findings: Sequence[Finding]) -> bool:
    """Whether the errors of all blocks are as small as noise: none exceeds that of noise."""
    return all(one.code is not LoopCode.BLOCK for one in findings)


def slow_alone(findings: Sequence[Finding]) -> bool:
    """Whether slow noise may explain what is left: errors as small as noise, and structure that
    changes slowly along the record, not with its velocity steps."""
    left = [one.values for one in findings if one.code is LoopCode.STRUCTURE]
    slow = any("block_means" in one and _SLOW.issuperset(one) for one in left)
    return slow and small(findings)


def _outside(found: Conclusion, told: Told, named: str) -> str:
    """What is known of what is missing: what explains a part, what would explain more, and where
    the residual sits."""
    helped = told.effects and told.helped
    code = "small" if small(found.findings) else "not_named" if told.closer else "outside"
    parts = [say(f"verdict.{code}", after=told.after)]
    parts += [say("verdict.slow")] if slow_alone(found.findings) else []
    if told.effects:
        code = "helps" if helped else "in_vain"
        parts.append(say(f"verdict.{code}", named=named, change=change(told)))
    for one in told.closer:
        values = {"names": " + ".join(one.effects), "lower": one.lower}
        parts.append(say("verdict.would", why=words_of_refusal(one.rejection), **values))
    parts.append(where_it_sits(told.location, told.velocities))
    return " ".join(filter(None, parts))


def change(told: Told) -> str:
    """State the test error before and after adding effects."""
    return f"test error {told.before:.2f} -> {told.after:.2f} sigma"


def _withheld(why: Finding) -> str:
    """That there is no verdict, why, and what to do."""
    if why.code in (LoopCode.RUNS_AWAY, LoopCode.EDGE):
        return say(f"verdict.{why.code}", stiffness=option("stiffness"), **why.values)
    return say("verdict.withheld", why=reason_of(why))


# ---- curves whose shape is not told --------------------------------------------------------------


def where_told(family: CurveFamily) -> str:
    """Name velocities that would determine the shape of a curve; '' for no such velocities."""
    told = [prefixed(one.velocity, family.unit, 3) for one in family.decided_by]
    return f"steady sliding at {listed(told, 'or')}" if told else ""


def why_untold(family: CurveFamily) -> str:
    """Say why the record does not determine the shape of the friction-velocity curve."""
    parts = []
    if family.interpolates:
        parts.append(f"{family.velocities} velocities, {family.parameters} parameters of the curve")
    fitting = [other for other in family.others if other.worse < ACCEPT]
    parts += [f"{other.shape}: BIC {other.worse:+.1f}" for other in fitting]
    return "; ".join(parts)


# ---- findings ------------------------------------------------------------------------------------


def words_of(finding: Finding) -> str:
    """A finding as a line of a report."""
    values: dict[str, typing.Any] = dict(finding.values)
    code = f"finding.{finding.code}"
    match finding.code:
        case LoopCode.STRUCTURE:
            tests = (f"{variable_words(name)}, {p_text(p)}" for name, p in values.items())
            return say(code, what="; ".join(tests))
        case LoopCode.BLOCK:
            return say(code, **{**values, "block": _BLOCKS[values["block"]]})
        case LoopCode.MOVED:
            return " and ".join(say(code, **_ends(move)) for move in values["moves"])
        case LoopCode.EDGE | LoopCode.RUNS_AWAY | LoopCode.FEEDBACK | LoopCode.SPRING:
            return f"{reason_of(finding)}: the verdict is withheld"
        case LoopCode.OTHERS:
            return say(code, columns=", ".join(values["columns"]))
        case LoopCode.EFFECT if finding.severity is not Severity.CLAIM:
            return say(f"{code}_or_alike", **values)
        case LoopCode.STABILITY if values["kind"] == "free":
            return say(f"{code}_free")
    known = code in TEMPLATES
    return say(code, **values) if known else finding.code.value.replace("_", " ")


def reason_of(finding: Finding) -> str:
    """Why a verdict is withheld."""
    values: dict[str, typing.Any] = dict(finding.values)
    late = values.get("late")
    values["late"] = f" {1e3 * late:.2g} ms before" if late else ""
    return say(f"finding.{finding.code}", **values)


# ---- why a model is not taken --------------------------------------------------------------------


def words_of_refusal(why: Refusal) -> str:
    """Why a model is rejected."""
    if why.moves and why.code is not Fault.NOT_FIXED:
        return words_of_moves(why.moves)
    return say(f"refusal.{why.code}", parameters=", ".join(why.parameters))


def words_of_moves(moves: Sequence[Move]) -> str:
    """Say how base parameters change, such as "takes over B: 0.00176(2) -> -0.0014(7)"."""
    told = "; ".join("{name}: {before} -> {after}".format(**_ends(move)) for move in moves)
    return say("refusal.takes_of_the_base", moves=told)


def _ends(move: Move) -> dict[str, str]:
    """A parameter before and after, with its errors."""
    before, after = (bracketed(one, short=True) for one in (move.before, move.after))
    return {"name": move.name, "before": before, "after": after}
