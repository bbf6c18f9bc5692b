"""A closed loop as tables and lines of text, for the terminal and for the page."""

import math
from collections.abc import Sequence

import numpy as np

from ..effects import parameters
from ..findings import Severity, support
from ..fitting import Estimate
from ..fitting.result import tidy_unit
from ..loop.axis.result import AxisDetails
from ..loop.family import CurveFamily, listed
from ..loop.findings import LoopCode
from ..loop.residual_tests import p_text
from ..loop.result import CandidateScore, Loop, RunDetails
from ..loop.split import NAMES
from ..loop.thresholds import ACCEPT, ALIAS, FAR, SIGNIFICANT, TIE
from ..units import decimals, factor, format_si, read_as
from .estimates import shown_unit, with_error
from .fit_text import CORRELATED, DIFFERENCE, noise_text, shown_name
from .location_text import QUESTIONS
from .rig_words import AXIS
from .tables import TextTable
from .verdict_text import where_told, why_untold, words_of, words_of_refusal

HEADLINES = {
    "no_missing_effect": "No effect is missing",
    "effects": "Missing: {effects}",
    "ambiguous": "An effect is missing, but this record cannot say which",
    "outside_catalogue": "Something is missing that the catalogue does not explain",
    "too_weak": "What is left is too little to be named",
}
BLOCKS = {
    "train": "fitted here",
    "select": "predicted, has a say in the choice",
    "report": "scored once",
}
_ROLES = {
    "model": "the model",
    "base": "the start",
    "passed": "on the way",
    "tried": "not taken",
    "impossible": "impossible parameters",
    "failed": "did not converge",
}
"""The role of a fitted model in the search, in words."""
_TOLD = 10.0
_NOT_NOISE = (LoopCode.STRUCTURE, LoopCode.BLOCK)
_LENGTHS = (("nm", 1e-9), ("um", 1e-6), ("mm", 1e-3), ("cm", 1e-2), ("m", 1.0))
_BELOW = 0.8
"""Errors of a model, in sigma, below which chance does not bring them."""


def headline(loop: Loop) -> str:
    """The verdict in a few words."""
    if loop.families:
        others = [id for id in loop.effects if not any(id in f.effects for f in loop.families)]
        return "Missing: " + listed([*others, "a curve of velocity whose shape is not told"])
    text = HEADLINES.get(loop.verdict, loop.verdict)
    if loop.verdict == "too_weak" and _far_off(loop):
        text = "Rows that were not fitted are missed, and no effect is supported"
    if loop.verdict == "outside_catalogue" and loop.unfixed():
        text = "Something is missing that this record does not fix"
    if (
        loop.verdict == "outside_catalogue"
        and loop.effects
        and loop.test_error(loop.after) < loop.test_error(loop.before)
    ):
        text = f"Beyond {{effects}} {text[0].lower()}{text[1:]}"
    return text.format(effects=listed(loop.effects) or "an effect")


def _far_off(loop: Loop) -> bool:
    """Whether the base misses rows that it was not fitted to by far more than noise."""
    return loop.test_error(loop.before) > FAR * loop.held_out_threshold


def lines(loop: Loop) -> list[str]:
    """Lines on the verdict, and on why it is not more."""
    return [f"{loop.verdict}: {loop.sentence}", *_reasons(loop)]


def answer(loop: Loop) -> list[str]:
    """Of an axis: what friction it has, whether that makes it stick-slip, and the error before and
    after, each in a line. Nothing of others, whose sentence says it."""
    details, base = loop.details, AXIS.base
    if not isinstance(details, AxisDetails):
        return []
    if known := details.found():
        found = known
    elif details.doubted() and loop.verdict in ("no_missing_effect", "effects"):
        fitted = listed([base, *loop.effects])
        found = f"these rows do not tell it, though what {fitted} leave looks like noise"
    elif loop.verdict == "no_missing_effect":
        found = f"{_base_of(loop)}; nothing else is missing"
    elif loop.verdict == "effects" and not loop.families:
        found = f"{_base_of(loop)}; also found: {listed([named(loop, id) for id in loop.effects])}"
    else:
        found = f"{base} do not describe it: {headline(loop)[0].lower()}{headline(loop)[1:]}"
    doubt = details.doubt()
    return [
        f"friction: {found}",
        *([f"not sure: {doubt}"] if doubt else []),
        details.short(),
        f"test error: {test_errors(loop, '.3g')} sigma (of the report block alone; noise alone"
        " gives 1)",
    ]


def _base_of(loop: Loop) -> str:
    """Coulomb and viscous friction and the mass of an axis, with errors."""
    moving = "inertia" if length_of(loop) == "rad" else "mass"
    names = {"F_c": "Coulomb", "F_v": "viscous", "M": moving}
    known = {names[n]: loop.after.parameters[n] for n in names if n in loop.after.parameters}
    return ", ".join(f"{name} {with_error(one, length_of(loop))}" for name, one in known.items())


def test_errors(loop: Loop, form: str) -> str:
    """The test error before and after, in sigma; one number where no effect was found."""
    models = (loop.before, loop.after) if loop.effects else (loop.before,)
    return " -> ".join(format(loop.test_error(model), form) for model in models)


def named(loop: Loop, id: str) -> str:
    """An effect with its meaning, as part of a sentence."""
    told = meaning(loop, id)
    return f"{id} ({told})" if told else id


def meaning(loop: Loop, id: str) -> str:
    """What an effect means, as part of a sentence; empty where it does not say."""
    told = loop.words.catalogue[id].meaning if id in loop.words.catalogue else ""
    return f"{told[0].lower()}{told[1:].rstrip('.')}" if told else ""


def _reasons(loop: Loop) -> list[str]:
    return [f"  - {reason}" for reason in loop.reasons]


# ---- tables --------------------------------------------------------------------------------


def errors(loop: Loop) -> TextTable:
    """rms of the residual by block, in the unit of friction and in sigma."""
    size, unit = readable(loop)
    within = f" [{unit}]" if unit else ""
    rows = []
    for name in NAMES:
        both = [loop.before.rms[name], loop.after.rms[name]]
        count = str(int(loop.blocks.of(name).sum()))
        sigma = loop.sigma_of(loop.blocks.of(name))
        rows.append((f"{name}: {BLOCKS[name]}", count, *_errors(both, size, sigma)))
    return TextTable(
        "Error before and after",
        ("block", "rows", f"rms before{within}", f"rms after{within}", "before [σ]", "after [σ]"),
        rows,
        f"{_what_sigma_is(loop)}; {_lowest(loop)}{_target(loop)}. Noise is"
        f" {noise_text(loop.after.noise)}{_bound(loop)}",
        (2,),
    )


def _lowest(loop: Loop) -> str:
    """Words on how small an error can be; of a model that is below it, that the noise is too."""
    sizes = [c.train_rms / loop.sigma for c in loop.candidates if c.converged]
    least = min(sizes, default=1.0)
    if least > _BELOW:
        return "no model brings the error below 1 σ, but for chance"
    return (
        f"a model that was fitted brings the error of the fitted rows to {least:.2g} σ, so what is"
        " taken for noise here is not all noise"
    )


def _target(loop: Loop) -> str:
    """The test error that counts as noise; empty where it is not known."""
    most = loop.held_out_threshold
    return f"; the report block counts as noise up to {most:.2f} σ" if math.isfinite(most) else ""


def _what_sigma_is(loop: Loop) -> str:
    here, *later = sigma_texts(loop)
    row = loop.words.row
    if not later:
        return f"σ = {here} is the noise of a {row}"
    return (
        f"σ is the noise of a {row}: {here} where the model is fitted, {later[0]} in rows held out"
    )


def _bound(loop: Loop) -> str:
    """Words on the time beyond which structure is not taken for noise; empty if unknown."""
    bound = loop.after.noise.bound()
    return f"; what lasts longer than {bound} is not taken for noise" if bound else ""


def _errors(both: list[float], size: float, sigma: float) -> tuple[str, ...]:
    return (*(f"{size * v:.4g}" for v in both), *(f"{v / sigma:.3f}" for v in both))


def by_velocity(loop: Loop, *, most: int | None = None) -> TextTable:
    """rms [sigma] of every velocity of the record, or of the `most` with the largest after."""
    steps, rows, worst = loop.base_fit.steps, [], []
    length = length_of(loop)
    for k, (time, velocity) in enumerate(zip(steps.times, steps.velocities, strict=True)):
        here = loop.blocks.step == k
        if k >= len(loop.before.per_step) or not here.any():
            continue
        blocks = ", ".join(name for name in NAMES if (loop.blocks.of(name) & here).any())
        shown = format_si(float(velocity), f"{loop.length_unit}/s", f"{length}/s", 4)
        shown = read_as(shown)
        both = [s.per_step[k] / loop.sigma_of(here) for s in (loop.before, loop.after)]
        errors = (_finite(v, "{:.3f}") if blocks else "–" for v in both)
        rows.append((f"{time:.4g} s", shown, blocks or "no row counts", *errors))
        worst.append(both[1] if np.isfinite(both[1]) else np.inf if blocks else 0.0)
    head = ("from", loop.words.velocity.lower(), "block", "before [σ]", "after [σ]")
    if most is None or len(rows) <= most:
        return TextTable(loop.words.errors, head, rows)
    few = np.sort(np.argsort(worst, kind="stable")[-most:])
    note = f"the {most} of {len(rows)} with the largest errors after; all are in loop.html"
    return TextTable(loop.words.errors, head, [rows[k] for k in few], note)


def moved(loop: Loop) -> TextTable:
    """Parameters before and after, with intervals, and how far they moved."""
    rates = loop.before.A_minus_B, loop.after.A_minus_B
    rows = [] if rates[1] is None else [_moved(loop, DIFFERENCE, rates[0], rates[1])]
    for name, after in loop.after.parameters.items():
        rows.append(_moved(loop, name, loop.before.parameters.get(name), after))
    marked = tuple(k for k, row in enumerate(rows) if "." in row[0])
    head = ("name", "meaning", "before", "after ± std", "95 % interval", "shift [std]", "unit")
    note = "shift: after minus before, in standard deviations of the fit after"
    if loop.verdict == "ambiguous" and loop.effects:
        note += "\n± and intervals cover what the fits with its rivals make of the same parameters"
    note = "\n".join([note + _also_fitted(loop), *traded(loop)])
    return TextTable("Parameters", head, rows, note, marked)


def _moved(loop: Loop, name: str, before: Estimate | None, after: Estimate) -> tuple[str, ...]:
    unit, size = shown_unit(after, length_of(loop))
    value, std, interval = _estimate(after, size)
    old = "–" if before is None else _estimate(before, size)[0]
    shift = ""
    if before is not None and after.std > 0:
        shift = f"{(after.value - before.value) / after.std:+.1f}".replace("-", "−")
    if after.free and after.determined:
        value = f"{value} ± {std}"
    return shown_name(name), _meaning(loop, name), old, value, interval, shift, unit


def traded(loop: Loop) -> list[str]:
    """A line for each parameter of the base that was known before an effect was added and is not
    after: what it trades with, and their sum that is known.

    By the covariance S of this model alone: p - q S_pq/S_qq has the least error of all sums of p
    and a multiple of q.
    """
    after, found = loop.after, []
    own = getattr(loop.details, "covariance", None)
    spread = np.asarray(after.covariance if own is None else own)
    for name, before in loop.before.parameters.items():
        one = after.parameters[name]
        known = before.free and before.determined and before.lower * before.upper > 0
        if known and one.free and one.determined and one.std > abs(one.value):
            found.append(_traded(loop, name, spread))
    return found


def _traded(loop: Loop, name: str, spread: np.ndarray) -> str:
    after, length = loop.after, length_of(loop)
    one, i = after.parameters[name], after.free.index(name)
    unit, size = shown_unit(one, length)
    own = f"{np.sqrt(spread[i, i]) / size:.2g}"
    error = f"{one.std / size:.2g}"
    told = f"{shown_name(name)} is {one.value / size:.2g} ± {error} {unit}".rstrip()
    told += f" (± {own} in this model alone)" if own != error else ""
    told = f"{told}, though it was known before"
    others = [k for k, id in enumerate(after.free) if "." in id and after.parameters[id].determined]
    likes = {k: spread[i, k] / np.sqrt(spread[i, i] * spread[k, k]) for k in others}
    best = max(likes, key=lambda k: abs(likes[k]), default=None)
    if best is None or not abs(likes[best]) >= CORRELATED:
        return f"{told}: no parameter of an effect alone takes its place"
    other, slope = after.free[best], spread[i, best] / spread[best, best]
    times = -slope * shown_unit(after.parameters[other], length)[1] / size
    value = (one.value - slope * after.parameters[other].value) / size
    std = math.sqrt(spread[i, i] * (1 - likes[best] ** 2)) / size
    sign = "+" if times > 0 else "-"
    text = (
        f"{told}: it trades with {other} (correlation {likes[best]:.2f}); known is {name} {sign}"
        f" {abs(times):.3g} {other} = {value:.{decimals(std)}f} ± {std:.{decimals(std)}f} {unit}"
    )
    return text.rstrip().replace("-", "−")


def _also_fitted(loop: Loop) -> str:
    """A note on columns beside friction that the errors rest on; `jaxfric fit` leaves them out."""
    columns = ("slip", "load_point_encoder")
    used = [name for name in columns if getattr(loop.record, name, None) is not None]
    if not used:
        return ""
    return f"\n± rests on friction and {' and '.join(used)}; a fit of friction alone knows less"


def _estimate(estimate: Estimate, size: float) -> tuple[str, str, str]:
    """Value, standard deviation and 95 % interval as text."""
    value, std = estimate.value / size, estimate.std / size
    if not estimate.free:
        return f"{value:.6g}", "", "given"
    if not estimate.determined or not np.isfinite(value):
        return "undetermined", "", ""
    ends = estimate.lower / size, estimate.upper / size
    places = decimals(std)
    if places > 6:
        exponent = math.floor(math.log10(max(abs(value), std)))
        texts = [
            f"{x / 10.0**exponent:.{max(places + exponent, 0)}f}e{exponent}"
            for x in (value, std, *ends)
        ]
    else:
        texts = [f"{x:.{places}f}" for x in (value, std, *ends)]
    value_text, std_text, low, high = (text.replace("-", "−") for text in texts)
    return value_text, std_text, f"{low} to {high}"


def _meaning(loop: Loop, name: str) -> str:
    """Meaning of a parameter; empty for an effect that is not of the catalogue."""
    if name == DIFFERENCE:
        second = any(n in loop.after.parameters for n in ("second_state.B2", "B2"))
        return "all states together; below 0: weakening" if second else "below 0: weakening"
    if "." not in name:
        try:
            text = loop.words.quantity(name).text
            return "moment of inertia" if (name, loop.length_unit) == ("M", "rad") else text
        except KeyError:
            return "reference velocity" if name == "V0" else ""
    effect, field = name.split(".", 1)
    known = parameters(loop.words.catalogue[effect]) if effect in loop.words.catalogue else {}
    return known[field].text if field in known else ""


def significance(loop: Loop) -> TextTable:
    """p-values of the residual tests before and after."""
    rows = []
    for name, before in loop.before.tests.items():
        both = (before, loop.after.tests.get(name, math.nan))
        rows.append((QUESTIONS.get(name, name), *(p_value(p) for p in both)))
    head = ("is it left in the residual?", "p before", "p after")
    note = (
        f"p below {SIGNIFICANT:g}: structure is left, not only noise (train block; by likelihood,"
        " the noise found anew with and without it; corrected for all that is asked, those of the"
        " figure location each by itself)"
    )
    return TextTable("Tests for structure", head, rows, note)


def candidates(loop: Loop, *, most: int) -> TextTable:
    """Models that were fitted, best first."""
    found = loop.ranked()
    rows = [
        (
            " + ".join(c.effects) or "base",
            _finite(c.delta_bic, "{:+.1f}").replace("-", "−"),
            _finite(c.train_rms / loop.sigma, "{:.3f}"),
            _finite(c.validation_rms / loop.sigma_of(loop.blocks.select), "{:.3f}"),
            _role(loop, c),
        )
        for c in found[:most]
    ]
    more = len(found) - len(rows)
    note = (
        "ΔBIC below 0: better than the base. An effect must lower it by more than 10. Of models as"
        " good the first is kept. It counts the train rows, which are fitted, and how well the"
        " select rows are predicted"
    )
    if more > 0:
        note += f"; {more} more in loop.json"
    head = ("effects", "ΔBIC", "train [σ]", "select [σ]", "")
    marked = tuple(k for k, c in enumerate(found[:most]) if loop.role(c) == "model")
    return TextTable("Models that were fitted", head, rows, note, marked)


def _role(loop: Loop, candidate: CandidateScore) -> str:
    """Role of a model in the search and, where it was not taken, why.

    One that nothing spoke against was compared with the model by BIC, and takes its place where
    that is lower by more than `TIE`.
    """
    role = loop.role(candidate)
    text = _ROLES[role]
    if role != "tried":
        return text
    if candidate.rejection is not None:
        return f"{text}: {words_of_refusal(candidate.rejection)}"
    gain = loop.gain()
    worse = math.nan if gain is None else gain + candidate.delta_bic
    if abs(worse) <= TIE:
        return f"{text}: as good, BIC within {TIE:g} of the model"
    return f"{text}: BIC {worse:.0f} worse than the model" if worse > TIE else text


def stretches(details: RunDetails) -> list[TextTable]:
    """The stretches of a run: when, the steps and holds, the normal stress, the level."""
    joined, rows = details.joined, []
    for k, s in enumerate(joined.stretches):
        units = {p.unit for p in joined.phases if p.stretch == k and p.unit >= 0}
        stress = "" if s.normal_stress is None else format_si(s.normal_stress, "Pa", "MPa", 4)
        level = details.after.parameters.get(f"level{k + 1}")
        shown = "0" if level is None else f"{level.value:.4g} ± {level.std:.2g}"
        rows.append((f"{s.start:.6g} to {s.stop:.6g} s", str(len(units)), stress, shown))
    head = ("stretch", "steps and holds", "normal stress", "level")
    unit = tidy_unit(joined.record.friction_unit)
    of = "" if unit == "1" else f" [{unit}]"
    note = f"level{of}: friction less that of the first stretch, fitted with the rest"
    return [TextTable("The run's stretches", head, rows, note)]


def rests_on(loop: Loop) -> TextTable:
    """What is claimed, and the rows that it rests on, by direction and speed."""
    rows, unit = [], f"{loop.length_unit}/s"
    shown = f"{length_of(loop)}/s"
    for one in loop.findings:
        if one.severity not in (Severity.CLAIM, Severity.OPEN):
            continue
        for k, part in enumerate(support(one.rows, loop.velocity)):
            ends = (read_as(format_si(v, unit, shown, 4)) for v in (part.slowest, part.fastest))
            told = words_of(one) if not k else ""
            rows.append((told, f"{part.rows}", part.direction, " to ".join(dict.fromkeys(ends))))
    head = ("statement", "rows", "direction", "speeds")
    note = (
        "Without these rows it would not be said. Of an effect they are few beside which the"
        f" models with it and without it differ by less than a BIC of {ACCEPT:g}; directions and"
        " speeds are those commanded, or those of the axis"
    )
    return TextTable("What each statement rests on", head, rows, note)


# ---- aliases -------------------------------------------------------------------------------


def apart(loop: Loop) -> list[str]:
    """Sentences on every effect added: its likely confusions, and what would separate them.

    Effects that look alike to first order are told apart where a refit with the other in place of
    the one was tried and is worse by more than 10 of BIC. Where more than noise is left, no effect
    is told from all others: what is left may be of another one, which it stands for in part.
    """
    out, open_ = [], dict(confused(loop))
    codes = {one.code for one in loop.findings}
    why = "more than noise is left" if codes.intersection(_NOT_NOISE) else ""
    why = "other joints move" if LoopCode.OTHERS in codes else why
    for id, *others in loop.alias_groups:
        alike = open_.get(id, [])
        refits = [f"{o} (BIC {_worse(loop, id, o):.0f} worse)" for o in others if o not in alike]
        told = f"; a refit tells it from {listed(refits)}" if refits else ""
        if alike:
            text = f"{id}: this record cannot tell it from {listed(alike, 'or')}"
            wanted = loop.separations.get(id)
            out.append(f"{text}; what would: {wanted}{told}" if wanted else text + told)
        family = next((f for f in loop.families if id in f.effects), None)
        if family is not None:
            out.append(_of_family(id, family) + ("" if alike else told))
        if alike or family is not None:
            continue
        text = f"{id}: this record tells it from every other effect"
        if why:
            text = f"{id}: {why}, so that it may stand for another effect in part"
        near, value = _nearest(loop, id)
        text += f" (most alike: {near}, cosine {value:.2f})" if near and not told else ""
        out.append(text + told)
    pairs = alias_pairs(loop)
    if not out:
        out.append("no effect was added")
    text = "; ".join(f"{a} or {b} ({value:.3f})" for a, b, value in pairs)
    out.append(f"pairs that this record cannot tell apart: {text or 'none'}")
    return out


def confused(loop: Loop) -> list[tuple[str, list[str]]]:
    """Effects added that the record cannot tell from others, which no refit tells apart either."""
    found = []
    for id, *others in loop.alias_groups:
        alike = [other for other in others if not _tells(loop, id, other)]
        found += [(id, alike)] if alike else []
    return found


def likeliest(loop: Loop, id: str, others: Sequence[str]) -> list[str]:
    """What may stand for the effect `id`, the best refit in its place first; then those that were
    not fitted so, the most alike first."""
    worse = {other: _worse(loop, id, other) for other in others}
    return sorted(others, key=lambda other: math.inf if math.isnan(worse[other]) else worse[other])


def _of_family(id: str, family: CurveFamily) -> str:
    """Words on effects easily taken for one, where the shape of its curve is not told."""
    text = f"{id}: this record does not tell it from a steady curve of another shape"
    text += f" ({why_untold(family)})"
    return f"{text}; what would: {where_told(family)}" if family.decided_by else text


def alias_pairs(loop: Loop) -> list[tuple[str, str, float]]:
    """Pairs of effects with |cosine| of .95 and more that no refit tells apart, most alike
    first."""
    ids, cosines = loop.alias_ids, np.asarray(loop.alias_cosines)
    found = [
        (ids[j], ids[i], float(cosines[i, j]))
        for i in range(len(ids))
        for j in range(i)
        if cosines[i, j] >= ALIAS
        and not (_tells(loop, ids[j], ids[i]) or _tells(loop, ids[i], ids[j]))
    ]
    return sorted(found, key=lambda pair: -pair[2])


def _tells(loop: Loop, id: str, other: str) -> bool:
    """Whether a refit tells the effect `id` of the model from another."""
    return _worse(loop, id, other) > _TOLD


def _worse(loop: Loop, id: str, other: str) -> float:
    """Rise of BIC with `other` in place of `id` in the model; nan where that was not fitted, or did
    not converge."""
    model = frozenset(loop.after.effects)
    if id not in model or other in model:
        return math.nan
    swapped = model - {id} | {other}
    known = {frozenset(c.effects): c for c in reversed(loop.ranked())}
    if model not in known or swapped not in known or not known[swapped].converged:
        return math.nan
    return known[swapped].delta_bic - known[model].delta_bic


def _nearest(loop: Loop, id: str) -> tuple[str, float]:
    if id not in loop.alias_ids:
        return "", 0.0
    row = np.array(loop.alias_cosines[loop.alias_ids.index(id)], float)
    row[loop.alias_ids.index(id)] = np.nan
    if not np.isfinite(row).any():
        return "", 0.0
    return loop.alias_ids[int(np.nanargmax(row))], float(np.nanmax(row))


def splitting(loop: Loop) -> str:
    """A sentence on how the record was split, and what that means."""
    if loop.blocks.by_step:
        return f"split by {loop.words.part}: {_whole_parts(loop)}"
    count = len(alias_pairs(loop))
    return (
        "the record has too few velocity steps to hold whole ones out: it was split by displacement"
        " into before, transient and tail. Fewer effects can be told apart: the aliasing matrix"
        f" shows {count or 'no'} pair{'' if count == 1 else 's'} that it cannot separate"
    )


def _whole_parts(loop: Loop) -> str:
    """Words on parts held out whole, and on what is done with one that is not."""
    blocks, piece = loop.blocks, loop.words.piece
    held = blocks.select | blocks.report
    if not np.isin(blocks.step[held], blocks.step[blocks.train]).any():
        return f"no {piece} is both fitted and held out"
    return (
        f"the last {piece} reports, whole and never fitted; the {piece} before it is cut: its start"
        " is fitted, its end selects"
    )


# ---- numbers -------------------------------------------------------------------------------


def base_name(loop: Loop) -> str:
    """The base model in words."""
    return loop.words.base.format(law=loop.base_fit.law)


def readable(loop: Loop) -> tuple[float, str]:
    """Factor and unit that bring the noise of friction to a readable number."""
    level, unit = 10 * loop.sigma, loop.record.friction_unit
    if unit == "%":
        return 1.0, unit
    if unit == "1" and level < 1e-4:
        return 1e6, "10⁻⁶"
    if level < 0.1:
        return 1e3, "10⁻³" if unit == "1" else f"m{unit}"
    if unit == "1":
        return 1.0, ""
    return (1.0, unit) if level < 1e3 else (1e-3, f"k{unit}")


def sigma_texts(loop: Loop) -> tuple[str, ...]:
    """`sigma` as text, and the noise of the rows held out where that is another number."""
    held = loop.sigma_of(loop.blocks.select | loop.blocks.report)
    return tuple(dict.fromkeys(in_words(loop, size) for size in (loop.sigma, held)))


def in_words(loop: Loop, friction: float) -> str:
    """A size of friction as text: "0.301 × 10⁻³", "1.2 mN"."""
    size, unit = readable(loop)
    times = " × " if unit.startswith("10") else " "
    return f"{size * friction:.3g}{times}{unit}".rstrip()


def length_of(loop: Loop) -> str:
    """The record's unit of length by its symbol; um where it has none, as "0.05 um"."""
    told = loop.record.units.get("load_point_displacement", "um")
    if told == "rad":
        return told
    size = factor(told, "m", "length")
    return next((name for name, one in _LENGTHS if math.isclose(size, one)), "um")


def p_value(p: float) -> str:
    """A p-value without its symbol, for a table."""
    return p_text(p).removeprefix("p ").removeprefix("= ")


def _finite(value: float, form: str) -> str:
    return form.format(value) if np.isfinite(value) else "failed"
