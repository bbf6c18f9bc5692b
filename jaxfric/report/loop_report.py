"""Report a closed loop: the missing effect, the friction of the final model, and its meaning."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..findings import Finding
from ..fitting import Estimate
from ..loop.axis.result import AxisDetails
from ..loop.family import listed
from ..loop.findings import LoopCode
from ..loop.result import Loop, Score
from ..loop.thresholds import FAR, LOST, SIGNIFICANT, UNEXPLAINED
from ..stability.claims import SURE
from ..units import p_text
from .aliases import apart, confused
from .axis_loop_text import FRICTION
from .estimates import friction_line, length_of, with_error
from .location_text import variable_words
from .loop_next import next_steps, run_to_make
from .loop_text import (
    candidates,
    errors,
    moved,
    rests_on,
    significance,
)
from .report import Report
from .rig_words import AXIS
from .verdict_text import slow_alone, small, words_of
from .words import lower, say

_WIDER = 1.5
"""Factor by which rival models widen an error, from which the report says so."""


def report(loop: Loop, *, file: str = "loop.json") -> Report:
    """Report the loop's answer, all tables, and the effects that the record can distinguish.

    `file` is the path of the loop's JSON file in the next commands.
    """
    parameters = moved(loop)
    if (times := _widened(loop)) > _WIDER:
        parameters = parameters._replace(note=say("note.widened", times=times))
    tables = [
        parameters,
        significance(loop),
        errors(loop),
        candidates(loop),
        *(loop.details.tables() if isinstance(loop.details, AxisDetails) else []),
        rests_on(loop),
    ]
    lines = [f"{loop.verdict}: {loop.sentence}", *(f"  - {reason}" for reason in loop.reasons)]
    lines += [] if loop.blocks.by_step else [say("note.too_few_steps")]
    return Report(
        first_lines(loop),
        tables,
        lines,
        apart(loop),
        loop.warnings,
        next_steps=next_steps(loop, file),
    )


def headline(loop: Loop) -> str:
    """The verdict in a few words."""
    code, effects = loop.verdict, list(loop.effects)
    if loop.families:
        others = [id for id in effects if not any(id in one.effects for one in loop.families)]
        curve = "a curve of velocity whose shape is not determined"
        return say("headline.effects", effects=listed([*others, curve]))
    if code == "too_weak" and loop.test_error(loop.before) > FAR * loop.held_out_threshold:
        code = "base_misses"
    outside = code == "outside_catalogue"
    if outside:
        helps = loop.effects and loop.test_error(loop.after) < loop.test_error(loop.before)
        code = ("imitated" if helps else code) + ("_unfixed" if loop.unfixed() else "")
    if code == "ambiguous" and effects:
        alike = {id: listed([id, *others], "or") for id, others in confused(loop)}
        effects = [id for id in effects if id not in alike]
        code = "not_confirmed" if not alike else "also_one_of" if effects else "one_of"
        return say(f"headline.{code}", effects=listed(effects), either=listed([*alike.values()]))
    found = say(f"headline.{code}", effects=listed(effects) or "an effect")
    if outside and slow_alone(loop.findings):
        return say("headline.slow", found=found)
    p = loop.after.tests
    least = min(p, key=p.__getitem__, default="")
    if outside and small(loop.findings) and least and p[least] < SIGNIFICANT:
        told = {"variable": variable_words(least), "p": p_text(p[least])}
        return say("headline.small", found=found, **told)
    return found


def first_lines(loop: Loop) -> list[str]:
    """State the verdict, the friction parameters of the final model, and their meaning.

    If the verdict is limited, the first reason replaces the meaning of the parameters. For an axis,
    the lines give its friction, whether friction causes stick-slip, the test error, and the
    evidence that something is missing if no effect explains it.
    """
    details, found = loop.details, headline(loop)
    if isinstance(details, AxisDetails):
        doubt = details.doubt()
        return [
            f"friction: {_found(loop, details)}",
            *([f"not sure: {doubt}"] if doubt else []),
            _stick_slip(loop, details),
            f"test error: {test_errors(loop)} sigma (test block only; noise alone gives 1)",
            *_evidence(loop),
        ]
    if loop.verdict == "effects" and not loop.families:
        found += ", confirmed"
    found = f"{found}. Test error {test_errors(loop)} sigma"
    most = loop.held_out_threshold
    found += f" (noise alone gives up to {most:.2f})" if math.isfinite(most) else ""
    rate, parameters = loop.supported.A_minus_B, loop.supported.parameters
    friction = [] if rate is None else [friction_line(rate, parameters, length_of(loop.record))]
    if friction and loop.supported is not loop.after:
        friction = [f"base model, as the effects added predict the test rows worse: {friction[0]}"]
    curves = [id for family in loop.families for id in family.effects]
    if friction and curves and loop.supported is loop.after:
        friction += [
            f"These errors assume the curve {listed(curves)}; with another curve, a and b differ."
        ]
    if loop.verdict == "effects":
        told = [f"{id}: {meaning(loop, id)}" for id in loop.effects if meaning(loop, id)]
    else:
        told = [f"caution: {reason}" for reason in loop.reasons[:1]]
        if loop.verdict == "ambiguous" and loop.effects and not told:
            run = run_to_make(loop)
            told = [f"next run, to decide: {run.words()}" if run else loop.sentence]
    return [f"{found}.", *friction, *told]


def _evidence(loop: Loop) -> list[str]:
    """Why something is missing on an axis, if no effect explains it: structure in the residual,
    and the block whose error exceeds that of noise most."""
    if loop.verdict != "outside_catalogue":
        return []
    structure = [one for one in loop.findings if one.code is LoopCode.STRUCTURE]
    blocks = [one for one in loop.findings if one.code is LoopCode.BLOCK]
    blocks.sort(key=_excess, reverse=True)
    told = [words_of(one) for one in (*structure, *blocks[:1])]
    return [f"caution: {'; '.join(told)}"] if told else []


def _excess(block: Finding) -> float:
    """Error of a block over the largest that noise explains."""
    values: dict[str, Any] = dict(block.values)
    return values["error"] / values["most"]


def _alone(loop: Loop) -> dict[str, float]:
    """Standard errors of the final model of an axis without rival models; {} if unknown."""
    details = loop.details
    if not isinstance(details, AxisDetails) or details.covariance is None:
        return {}
    std = np.sqrt(np.diag(details.covariance)).tolist()
    return dict(zip(loop.after.free, std, strict=True))


def _widened(loop: Loop) -> float:
    """Largest factor by which rival models widen an error of the final model; 1 if unknown."""
    known = loop.after.parameters
    return max(
        (known[n].std / std for n, std in _alone(loop).items() if std > 0 and known[n].determined),
        default=1.0,
    )


def _found(loop: Loop, details: AxisDetails) -> str:
    """What is known of the friction of an axis, with errors, by the model to use."""
    if known := details.found():
        return known
    also, lost = lower(headline(loop)), "these rows do not determine it"
    model = _model_of_friction(loop)
    if details.doubted() and loop.verdict in ("no_missing_effect", "effects"):
        fitted = listed([AXIS.base, *loop.effects])
        return f"{lost}, though the residual of {fitted} looks like noise"
    if details.doubted() if model is loop.after else _unexplained(loop, model):
        return f"{lost}; {also}"
    known = _base_of(loop, model)
    if known and loop.verdict == "outside_catalogue" and loop.effects:
        full = f"a model with {listed(loop.effects)}"
        by = full if model.effects else "the base model alone"
        if loop.supported.effects and not model.effects:
            by += f" (errors cover the difference to {full} where it knows them)"
        known = f"{known}, by {by}"
        also = also.replace(listed(loop.effects), "these", 1) if full in by else also
    elif loop.verdict == "no_missing_effect":
        also = "nothing else is missing"
    elif loop.verdict == "effects" and not loop.families:
        means = {id: meaning(loop, id) for id in loop.effects}
        named = [f"{id} ({told})" if told else id for id, told in means.items()]
        also = f"also found: {listed(named)}"
    return "; ".join(filter(None, (known, also)))


def _stick_slip(loop: Loop, details: AxisDetails) -> str:
    """Whether the axis stick-slips, by the final model: the line says so if the friction line has
    the base model's numbers."""
    open_ = details.gains.claim.kind == "open"
    same = open_ or _model_of_friction(loop).effects == loop.after.effects
    return details.short() if same else details.short(", by the model with these effects")


def _model_of_friction(loop: Loop) -> Score:
    """The model whose friction the headline of an axis gives: the supported model, or the base.

    Effects that stand for others may leave Coulomb and viscous friction almost undetermined. Then
    the headline has the numbers of a base that explains most of the force, if the supported model
    agrees with all of them within `SURE` of its errors. Of two models that disagree, the headline
    has the supported one: it predicts the test block better.
    """
    base, own = loop.before.parameters, loop.supported.parameters
    if loop.verdict != "outside_catalogue" or _unexplained(loop, loop.before):
        return loop.supported
    agree = (
        base[name].determined and abs(own[name].value - base[name].value) <= SURE * own[name].std
        for name in FRICTION
        if name in own and own[name].determined
    )
    return loop.before if all(agree) else loop.supported


def _unexplained(loop: Loop, model: Score) -> bool:
    """Whether a model leaves most of the force of its rows unexplained."""
    left, force = model.residual, loop.record.friction
    return bool(np.nanstd(left) > UNEXPLAINED * np.std(force[np.isfinite(left)]))


def _base_of(loop: Loop, model: Score) -> str:
    """Coulomb and viscous friction and the mass of an axis by a model, with errors that include
    the misfit of the model and its rivals: the larger of the two. The errors of a base include the
    difference to the supported model for every parameter that this model knows: its value is more
    than `LOST` of its errors."""
    mass = "inertia" if length_of(loop.record) == "rad" else "mass"
    names = dict(zip(FRICTION, ("Coulomb", "viscous", mass), strict=True))
    alone, misfit = _alone(loop) if model is loop.after else {}, loop.misfit(model)
    told, wider = [], False
    for symbol, name in names.items():
        if symbol not in model.parameters:
            continue
        known = model.parameters[symbol]
        own = misfit * alone.get(symbol, known.std)
        wider |= known.determined and own > known.std
        rival = loop.supported.parameters.get(symbol, known)
        seen = rival.determined and abs(rival.value) > LOST * rival.std
        apart = rival.value - known.value if seen else 0.0
        known = replace(known, std=math.hypot(max(known.std, own), apart))
        falls = _falls(known, own if symbol in alone else None) if symbol == "F_v" else ""
        told.append(f"{name} {with_error(known, length_of(loop.record))}{falls}")
    note = f" (errors times {misfit:.1f}, for its misfit)" if wider else ""
    return ", ".join(told) + note


def _falls(viscous: Estimate, alone: float | None) -> str:
    """A note in brackets on a viscous friction that is negative, or not different from 0.

    alone : its standard error in this model, without rival models; None if unknown.
    """
    if not viscous.determined or not viscous.value < SURE * viscous.std:
        return ""
    if viscous.value < -SURE * viscous.std:
        return " (negative: friction falls with speed in this range; do not extrapolate)"
    if alone is not None and abs(viscous.value) > SURE * alone:
        return f" (± {alone:.2g} by this model alone; rival models allow 0)"
    return " (not different from 0)"


def test_errors(loop: Loop) -> str:
    """Test error [sigma] before and after adding effects; one number if no effect was found."""
    models = (loop.before, loop.after) if loop.effects else (loop.before,)
    return " -> ".join(f"{loop.test_error(model):.2f}" for model in models)


def meaning(loop: Loop, id: str) -> str:
    """The meaning of an effect, as part of a sentence; '' for an effect without meaning."""
    told = loop.words.catalogue[id].meaning if id in loop.words.catalogue else ""
    return lower(told).rstrip(".")
