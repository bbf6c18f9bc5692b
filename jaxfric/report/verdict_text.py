"""The verdict of a loop in words: its sentence, the reasons why not more is said, every finding."""

import math
import typing
from collections.abc import Mapping, Sequence

from ..findings import Finding, Severity
from ..fitting import Estimate
from ..loop.family import CurveFamily, listed
from ..loop.findings import LoopCode
from ..loop.refusal import Fault, Move, Refusal, takes
from ..loop.residual_tests import p_text
from ..loop.thresholds import ACCEPT, FAR, SIGNIFICANT
from ..loop.unfixed import Unfixed
from ..loop.verdict import Conclusion, Told
from ..units import read_as, speed_text
from .location_text import QUESTIONS, where_it_sits

_MOST_NAMED = 6
_WITHHELD = ": the verdict is withheld"
_FAULTS = {
    Fault.FAILED: "did not converge",
    Fault.IMPOSSIBLE: "impossible parameters",
    Fault.WEAK: "too little evidence",
}
_BLOCKS = {"report": "test", "select": "validation", "train": "train"}


def reasons(found: Conclusion) -> tuple[str, ...]:
    """Why not more is said, a line each."""
    return tuple(words_of(one) for one in found.findings if one.code is not LoopCode.MOVED)


def sentence(found: Conclusion) -> str:
    """The verdict in words."""
    codes, told = {one.code: one for one in found.findings}, found.told
    if told is None:
        return _withheld(found.findings[0])
    if LoopCode.MOVED in codes:
        return _moved(codes[LoopCode.MOVED], told)
    named = listed(told.effects)
    before = f"test error {told.before:.2f} sigma"
    match found.verdict:
        case "no_missing_effect":
            what = "This record shows nothing that is missing"
            return f"{what}: the base model fits to the noise ({before})."
        case "too_weak":
            return _too_weak(told, before)
        case "outside_catalogue":
            return _outside(told, named)
    pairs = "; ".join(f"{a} or {b}" for a, b in told.rivals)
    if found.families:
        (curve,) = found.families
        sure = [id for id in told.effects if id not in curve.effects]
        what = listed([*sure, _curve(curve)])
        alike = f", or what looks like it ({pairs})" if pairs else ""
        wanted = f" {_upper(where_told(curve))} would tell." if curve.decided_by else ""
        return f"The model lacks {what}{alike}: {change(told)}, BIC {told.gain:.0f} lower.{wanted}"
    if told.rivals:
        return f"The model lacks {named}, or what looks like it ({pairs}): {change(told)}."
    return f"The model lacks {named}: {change(told)}, BIC {told.gain:.0f} lower."


def _too_weak(told: Told, before: str) -> str:
    if told.before > FAR * told.most:
        return (
            f"The base model misses rows that it was not fitted to ({before}; noise alone gives up"
            f" to {told.most:.2f}), and no effect that explains it is supported by more than"
            f" {ACCEPT:g} of BIC: what is fitted of this record may not fix the base model."
        )
    what = "Something may be missing, but too weakly to be named"
    if told.p_value < SIGNIFICANT:
        what = f"Something is left ({p_text(told.p_value)}), but too little to be named"
    return f"{what}: no effect is supported by more than {ACCEPT:g} of BIC ({before})."


def _outside(told: Told, named: str) -> str:
    helped, closer = named and told.helped, told.closer
    what = "Not all that is missing is" if helped else "What is missing is not"
    changes = ", or not the same along all of the record" if named and not helped else ""
    what += " named." if closer else f" in the catalogue{changes}."
    if told.after <= told.most:
        which = " that this record fixes" if closer else ""
        what = (
            f"What is left is as small as the noise (test error {told.after:.2f} sigma), but has"
            f" structure that no effect of the catalogue{which} explains."
        )
    located = where_it_sits(told.location, told.velocities)
    parts = (what, _unfixed(closer, named), _in_vain(told, named), located)
    return " ".join(part for part in parts if part)


def change(told: Told) -> str:
    """The test error before and after, said as a fall only where it is one."""
    before, after = f"{told.before:.2f}", f"{told.after:.2f}"
    if told.helped:
        return f"test error {before} -> {after} sigma"
    return f"test error {after} sigma with, {before} without"


def _withheld(why: Finding) -> str:
    """That there is no verdict, why, and what to do."""
    match why.code:
        case LoopCode.RUNS_AWAY:
            return (
                "No verdict: where its fit ended, the base model cannot be simulated, so nothing"
                " can be said of what it lacks. Check the units and signs of the columns, and of a"
                " slider its stiffness."
            )
        case LoopCode.EDGE:
            return (
                "No verdict: the base fit sits at the edge of stability (K/K_cr is"
                f" {why.values['ratio']:.2f}), where a small misfit of the law looks like a large"
                " effect; use a stiffer machine, or check --stiffness."
            )
        case _:
            return f"No verdict: {reason_of(why)}."


def _moved(why: Finding, told: Told) -> str:
    """That effects fit, but move a headline parameter and predict no better."""
    named, one = listed(told.effects), len(told.effects) == 1
    return (
        f"{named} {'fits' if one else 'fit'} the train block, but {words_of(why)}, and"
        f" the test block is predicted no better ({change(told)}): {named}"
        f" {'is' if one else 'are'} not confirmed, and this record leaves both open."
    )


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _in_vain(told: Told, named: str) -> str:
    """A sentence on effects that were added but explain too little."""
    if not named:
        return ""
    one = len(told.effects) == 1
    if told.helped:
        verb, but = ("helps", "does") if one else ("help", "do")
        return f"{named} {verb} ({change(told)}) but {but} not explain all of it."
    if told.after <= told.most:
        verb = "changes" if one else "change"
        return f"{named} {verb} little: {change(told)}."
    verb, then = ("fits", "predicts") if one else ("fit", "predict")
    return f"{named} {verb} the train block but {then} the others no better ({change(told)})."


def _unfixed(found: Sequence[Unfixed], named: str) -> str:
    """What models that are not fixed would bring beside the model taken, `named` by its effects or
    not at all."""
    than = f" than that of {named}" if named else ""
    told = [
        f"{' + '.join(one.effects)} would explain most (BIC {one.lower:.0f} lower{than}), but"
        f" {words_of_refusal(one.rejection)}: it is not confirmed."
        for one in found
        if takes(one.rejection)
    ]
    if open_ := [one for one in found if not takes(one.rejection)]:
        names = listed([" + ".join(one.effects) for one in open_], "or")
        lower = listed(list(dict.fromkeys(f"{one.lower:.0f}" for one in open_)), "or")
        told.append(
            f"{names} would explain most (BIC {lower} lower{than}), but the rows that are fitted do"
            " not fix the parameters of such a model."
        )
    return " ".join(told)


# ---- curves whose shape is not told --------------------------------------------------------------


def _curve(family: CurveFamily) -> str:
    """The missing effect in words."""
    fit = "is one that fits" if len(family.effects) == 1 else "together are one that fits"
    shapes = listed(family.fitting)
    also = f", {shapes} another" if len(family.fitting) == 1 else ""
    also = f", {shapes} are others" if len(family.fitting) > 1 else also
    return f"a steady curve of velocity ({listed(family.effects)} {fit}{also})"


def where_told(family: CurveFamily) -> str:
    """Velocities that would decide; nothing where there are none."""
    if not family.decided_by:
        return ""
    rotary = family.unit == "rad/s"
    told = [f"{d.velocity:.2g} rad/s" if rotary else read_as(speed_text(d.velocity, 2))
            for d in family.decided_by]  # fmt: skip
    return f"steady sliding at {listed(told, 'or')}"


def why_untold(family: CurveFamily) -> str:
    """The reason why the shape of a curve is open."""
    parts = []
    if family.interpolates:
        count = family.parameters
        parts.append(f"{family.velocities} velocities, {count} parameters of the curve")
    for other in family.others:
        if other.worse < ACCEPT:
            side = "lower" if other.worse < 0 else "higher"
            parts.append(f"{other.shape}: BIC {abs(other.worse):.1f} {side}")
    return "; ".join(parts)


# ---- findings ------------------------------------------------------------------------------------


def words_of(finding: Finding) -> str:
    """A finding as a line of a report."""
    v: Mapping[str, typing.Any] = finding.values
    match finding.code:
        case LoopCode.STRUCTURE:
            left = (f"{QUESTIONS.get(n, n)}, {p_text(p)}" for n, p in v.items())
            return "structure is left in the residual: " + "; ".join(left)
        case LoopCode.BLOCK:
            return (
                f"the {_BLOCKS[v['block']]} error is {v['error']:.3f} sigma; noise alone"
                f" gives up to {v['most']:.2f}"
            )
        case LoopCode.UNFITTED:
            return (
                f"{v['rival']} could not be fitted in place of {v['effect']}: it is not ruled out"
            )
        case LoopCode.MOVED:
            moves: Sequence[Move] = v["moves"]
            return " and ".join(f"{m.name} moves from {_both(m, ' to ')}" for m in moves)
        case LoopCode.EDGE | LoopCode.RUNS_AWAY | LoopCode.FEEDBACK | LoopCode.SPRING:
            return reason_of(finding) + _WITHHELD
        case LoopCode.OTHERS:
            columns = v["columns"]
            shown = ", ".join(columns[:_MOST_NAMED]) + (
                f" and {len(columns) - _MOST_NAMED} more" if len(columns) > _MOST_NAMED else ""
            )
            return (
                f"other joints move in this record (columns {shown}): their weight and inertia act"
                " here, the model has neither, and an effect may stand for them; hold them still"
            )
        case LoopCode.EFFECT:
            sure = "" if finding.severity is Severity.CLAIM else ", or what looks like it"
            return f"{v['effect']}{sure}"
        case LoopCode.FRICTION:
            return f"friction {v['direction']}"
        case LoopCode.STABILITY:
            return f"friction {'grows' if v['kind'] == 'free' else 'falls'} with speed"
        case _:
            return finding.code.value.replace("_", " ")


def reason_of(finding: Finding) -> str:
    """Why a verdict is withheld."""
    v: Mapping[str, typing.Any] = finding.values
    match finding.code:
        case LoopCode.EDGE:
            return f"K/K_cr is {v['ratio']:.2f}"
        case LoopCode.FEEDBACK:
            after = f" {1e3 * v['late']:.2g} ms before" if v["late"] else ""
            return (
                f"the force is that of the position{after} alone, without inertia and friction:"
                " feedback, as of a controller that carries a weight"
            )
        case LoopCode.SPRING:
            return (
                "the axis never slid: its force goes with the position and with no more than"
                f" {100 * v['hysteresis']:.2g} % of hysteresis, which comes back over the whole"
                f" stroke as in presliding. Its stiffness is {v['stiffness']:.4g} ±"
                f" {v['std']:.2g} {v['unit']}; Coulomb and viscous friction, inertia, stability and"
                " a feedforward are not in such a record: move it farther"
            )
        case _:
            return "the fit runs away"


# ---- why a model is not taken --------------------------------------------------------------------


def words_of_refusal(why: Refusal) -> str:
    """The fault of a model."""
    if why.code is Fault.NOT_FIXED:
        return f"{', '.join(why.parameters)} not fixed"
    return words_of_moves(why.moves) if why.moves else _FAULTS[why.code]


def words_of_moves(moves: Sequence[Move]) -> str:
    """What becomes of parameters, "takes B: 0.00176 ± 2e-05 -> -0.0014 ± 0.0007"."""
    return "takes " + "; ".join(f"{move.name}: {_both(move, ' -> ')}" for move in moves)


def _both(move: Move, between: str) -> str:
    """Both values of a parameter with their errors."""
    return between.join(map(_with_error, (move.before, move.after)))


def _with_error(estimate: Estimate) -> str:
    if not (estimate.determined and math.isfinite(estimate.std)):
        return "undetermined"
    return f"{estimate.value:.3g} ± {estimate.std:.2g}"
