"""The verdict of a loop in words: its sentence, the reasons that limit it, and every finding."""

import math
import typing
from collections.abc import Mapping, Sequence

from ..errors import option
from ..findings import Finding, Severity
from ..fitting import Estimate
from ..loop.family import CurveFamily, listed
from ..loop.findings import LoopCode
from ..loop.refusal import Fault, Move, Refusal, takes
from ..loop.residual_tests import p_text
from ..loop.result import Unfixed
from ..loop.thresholds import ACCEPT, FAR, SIGNIFICANT
from ..loop.verdict import Conclusion, Told
from ..units import read_as, speed_text
from .location_text import question, where_it_sits
from .words import say

_MOST_NAMED = 6


def reasons(found: Conclusion) -> tuple[str, ...]:
    """The reasons that limit the verdict, one a line."""
    return tuple(words_of(one) for one in found.findings if one.code is not LoopCode.MOVED)


def sentence(found: Conclusion) -> str:
    """The verdict in words."""
    codes, told = {one.code: one for one in found.findings}, found.told
    if told is None:
        return _withheld(found.findings[0])
    if LoopCode.MOVED in codes:
        moves = words_of(codes[LoopCode.MOVED])
        return _of(told.effects, "verdict.moved", moves=moves, change=change(told))
    named = listed(told.effects)
    before = say("verdict.error", before=told.before)
    match found.verdict:
        case "no_missing_effect":
            return say("verdict.no_missing_effect", before=before)
        case "too_weak":
            return _too_weak(told, before)
        case "outside_catalogue":
            return _outside(told, named)
    pairs = "; ".join(say("verdict.rivals", a=a, b=b) for a, b in told.rivals)
    known = {"change": change(told), "gain": told.gain, "pairs": pairs}
    alike = "_or_alike" if told.rivals else ""
    if not found.families:
        return say(f"verdict.effects{alike}", named=named, **known)
    (curve,) = found.families
    sure = [id for id in told.effects if id not in curve.effects]
    text = say(f"verdict.curve{alike}", what=listed([*sure, _curve(curve)]), **known)
    if not curve.decided_by:
        return text
    return text + say("verdict.curve_decided", where=_upper(where_told(curve)))


def _of(effects: Sequence[str], code: str, **values: object) -> str:
    """A template of one or of several effects."""
    number = "one" if len(effects) == 1 else "some"
    return say(f"{code}_{number}", named=listed(effects), **values)


def _too_weak(told: Told, before: str) -> str:
    known = {"before": before, "accept": ACCEPT}
    if told.before > FAR * told.most:
        return say("verdict.base_misses", most=told.most, **known)
    if told.p_value < SIGNIFICANT:
        return say("verdict.too_weak_but_left", p=p_text(told.p_value), **known)
    return say("verdict.too_weak", **known)


def _outside(told: Told, named: str) -> str:
    helped, closer = named and told.helped, told.closer
    if told.after <= told.most:
        code = "small_but_open" if closer else "small_but_structured"
    elif closer:
        code = "not_all_named" if helped else "not_named"
    else:
        code = "outside_in_part" if helped else "outside_or_changes" if named else "outside"
    what = say(f"verdict.{code}", after=told.after)
    located = where_it_sits(told.location, told.velocities)
    parts = (what, _unfixed(closer, named), _in_vain(told), located)
    return " ".join(part for part in parts if part)


def change(told: Told) -> str:
    """The test error before and after, called a fall only if it falls."""
    code = "verdict.error_falls" if told.helped else "verdict.error_does_not_fall"
    return say(code, before=told.before, after=told.after)


def _withheld(why: Finding) -> str:
    """That there is no verdict, why, and what to do."""
    if why.code in (LoopCode.RUNS_AWAY, LoopCode.EDGE):
        return say(f"verdict.{why.code}", stiffness=option("stiffness"), **why.values)
    return say("verdict.withheld", why=reason_of(why))


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _in_vain(told: Told) -> str:
    """A sentence on effects that were added but explain too little."""
    if not told.effects:
        return ""
    code = "helps" if told.helped else "little" if told.after <= told.most else "in_vain"
    return _of(told.effects, f"verdict.{code}", change=change(told))


def _unfixed(found: Sequence[Unfixed], named: str) -> str:
    """What models that are not fixed would bring beside the model taken, `named` by its effects or
    not at all."""
    than = say("verdict.than", named=named) if named else ""
    told = [
        say(
            "verdict.takes",
            names=" + ".join(one.effects),
            lower=f"{one.lower:.0f}",
            than=than,
            why=words_of_refusal(one.rejection),
        )
        for one in found
        if takes(one.rejection)
    ]
    if open_ := [one for one in found if not takes(one.rejection)]:
        names = listed([" + ".join(one.effects) for one in open_], "or")
        lower = listed(list(dict.fromkeys(f"{one.lower:.0f}" for one in open_)), "or")
        told.append(say("verdict.not_fixed", names=names, lower=lower, than=than))
    return " ".join(told)


# ---- curves whose shape is not told --------------------------------------------------------------


def _curve(family: CurveFamily) -> str:
    """The missing effect in words."""
    fit = say("curve.fits" if len(family.effects) == 1 else "curve.fit")
    code = ("none", "one")[len(family.fitting)] if len(family.fitting) < 2 else "some"
    shapes = listed(family.fitting)
    return say(f"curve.{code}", effects=listed(family.effects), fit=fit, shapes=shapes)


def where_told(family: CurveFamily) -> str:
    """Velocities that would determine the shape of a curve; '' if there are none."""
    if not family.decided_by:
        return ""
    rotary = family.unit == "rad/s"
    told = [f"{d.velocity:.2g} rad/s" if rotary else read_as(speed_text(d.velocity, 2))
            for d in family.decided_by]  # fmt: skip
    return say("curve.where", speeds=listed(told, "or"))


def why_untold(family: CurveFamily) -> str:
    """The reason why the record does not determine the shape of a curve."""
    parts = []
    if family.interpolates:
        counts = {"velocities": family.velocities, "parameters": family.parameters}
        parts.append(say("curve.interpolates", **counts))
    for other in family.others:
        if other.worse < ACCEPT:
            code = "curve.better" if other.worse < 0 else "curve.as_good"
            parts.append(say(code, shape=other.shape, by=abs(other.worse)))
    return "; ".join(parts)


# ---- findings ------------------------------------------------------------------------------------


def words_of(finding: Finding) -> str:
    """A finding as a line of a report."""
    v: Mapping[str, typing.Any] = finding.values
    code = f"finding.{finding.code}"
    match finding.code:
        case LoopCode.STRUCTURE:
            return say(code, what="; ".join(f"{question(n)}, {p_text(p)}" for n, p in v.items()))
        case LoopCode.BLOCK:
            return say(code, **{**v, "block": say(f"finding.{v['block']}")})
        case LoopCode.MOVED:
            moves: Sequence[Move] = v["moves"]
            return " and ".join(say(code, **_ends(move)) for move in moves)
        case LoopCode.EDGE | LoopCode.RUNS_AWAY | LoopCode.FEEDBACK | LoopCode.SPRING:
            return say("finding.withheld", why=reason_of(finding))
        case LoopCode.OTHERS:
            columns, more = v["columns"][:_MOST_NAMED], len(v["columns"]) - _MOST_NAMED
            rest = say("finding.more_columns", more=more) if more > 0 else ""
            return say(code, columns=", ".join(columns) + rest)
        case LoopCode.EFFECT:
            return say(code if finding.severity is Severity.CLAIM else f"{code}_or_alike", **v)
        case LoopCode.STABILITY:
            return say(f"{code}_free" if v["kind"] == "free" else code)
        case LoopCode.UNFITTED | LoopCode.FRICTION:
            return say(code, **v)
        case _:
            return finding.code.value.replace("_", " ")


def reason_of(finding: Finding) -> str:
    """Why a verdict is withheld."""
    v: Mapping[str, typing.Any] = finding.values
    match finding.code:
        case LoopCode.FEEDBACK:
            late = say("finding.late", ms=1e3 * v["late"]) if v["late"] else ""
            return say(f"finding.{finding.code}", late=late)
        case LoopCode.SPRING:
            return say(f"finding.{finding.code}", share=100 * v["hysteresis"], **v)
        case _:
            return say(f"finding.{finding.code}", **v)


# ---- why a model is not taken --------------------------------------------------------------------


def words_of_refusal(why: Refusal) -> str:
    """Why a model is rejected."""
    if why.moves and why.code is not Fault.NOT_FIXED:
        return words_of_moves(why.moves)
    return say(f"refusal.{why.code}", parameters=", ".join(why.parameters))


def words_of_moves(moves: Sequence[Move]) -> str:
    """How base parameters move, such as "takes B: 0.00176 ± 2e-05 -> -0.0014 ± 0.0007"."""
    told = "; ".join(say("refusal.move", **_ends(move)) for move in moves)
    return say("refusal.takes_of_the_base", moves=told)


def _ends(move: Move) -> dict[str, str]:
    """A parameter before and after, with its errors."""
    return {
        "name": move.name,
        "before": _with_error(move.before),
        "after": _with_error(move.after),
    }


def _with_error(estimate: Estimate) -> str:
    if not (estimate.determined and math.isfinite(estimate.std)):
        return say("refusal.undetermined")
    return f"{estimate.value:.3g} ± {estimate.std:.2g}"
