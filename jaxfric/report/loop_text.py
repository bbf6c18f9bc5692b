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
from ..loop.result import CandidateScore, Loop, RunDetails, Score
from ..loop.split import NAMES
from ..loop.thresholds import ACCEPT, ALIAS, FAR, SIGNIFICANT, TIE
from ..units import decimals, factor, format_si, read_as
from .estimates import shown_unit, with_error
from .fit_text import CORRELATED, DIFFERENCE, noise_text, shown_name
from .location_text import question
from .rig_words import AXIS
from .tables import TextTable
from .verdict_text import where_told, why_untold, words_of, words_of_refusal
from .words import change_words, say

_TOLD = 10.0
_NOT_NOISE = (LoopCode.STRUCTURE, LoopCode.BLOCK)
_LENGTHS = (("nm", 1e-9), ("um", 1e-6), ("mm", 1e-3), ("cm", 1e-2), ("m", 1.0))
_BELOW = 0.8
"""Errors of a model, in sigma, below which chance does not bring them."""


def headline(loop: Loop) -> str:
    """The verdict in a few words."""
    if loop.families:
        others = [id for id in loop.effects if not any(id in f.effects for f in loop.families)]
        return say("headline.effects", effects=listed([*others, say("headline.curve")]))
    code = loop.verdict
    if code == "too_weak" and _far_off(loop):
        code = "base_misses"
    if code == "outside_catalogue":
        helps = loop.effects and loop.test_error(loop.after) < loop.test_error(loop.before)
        if loop.unfixed():
            code = "beyond_unfixed" if helps else "unfixed"
        elif helps:
            code = "beyond"
    alike = dict(confused(loop)) if code == "ambiguous" else {}
    if code == "ambiguous" and loop.effects:
        code = "one_of" if alike else "not_confirmed"
    names = [listed([id, *alike.get(id, ())], "or") for id in loop.effects]
    return say(f"headline.{code}", effects=listed(names) or "an effect")


def _far_off(loop: Loop) -> bool:
    """Whether the base misses rows that it was not fitted to by far more than noise."""
    return loop.test_error(loop.before) > FAR * loop.held_out_threshold


def lines(loop: Loop) -> list[str]:
    """Lines on the verdict, and on the reasons that limit the verdict."""
    return [f"{loop.verdict}: {loop.sentence}", *_reasons(loop)]


def answer(loop: Loop) -> list[str]:
    """Lines on an axis: its friction, whether friction makes it stick-slip, and the test error.

    Empty for a slider, whose sentence gives these numbers.
    """
    details, base = loop.details, AXIS.base
    if not isinstance(details, AxisDetails):
        return []
    if known := details.found():
        found = known
    elif details.doubted() and loop.verdict in ("no_missing_effect", "effects"):
        found = say("answer.doubted", fitted=listed([base, *loop.effects]))
    elif loop.verdict == "no_missing_effect":
        found = say("answer.base", base=_base_of(loop, loop.after))
    elif loop.verdict == "effects" and not loop.families:
        effects = listed([named(loop, id) for id in loop.effects])
        found = say("answer.effects", base=_base_of(loop, loop.after), effects=effects)
    else:
        model = loop.before if loop.verdict == "outside_catalogue" else loop.after
        known = _base_of(loop, model)
        if known and model.effects != loop.after.effects:
            known = say("answer.base_model", base=known)
        found = "; ".join(filter(None, (known, _lower(headline(loop)))))
    doubt = details.doubt()
    return [
        say("answer.friction", found=found),
        *([say("answer.not_sure", doubt=doubt)] if doubt else []),
        details.short(),
        say("answer.test_error", errors=test_errors(loop, ".3g")),
    ]


def _lower(text: str) -> str:
    return f"{text[:1].lower()}{text[1:]}"


def _base_of(loop: Loop, model: Score) -> str:
    """Coulomb and viscous friction and the mass of an axis by a model, with errors."""
    moving = "inertia" if length_of(loop) == "rad" else "M"
    names, known = {"F_c": "F_c", "F_v": "F_v", "M": moving}, model.parameters
    return ", ".join(
        f"{say(f'answer.{code}')} {with_error(known[name], length_of(loop))}"
        for name, code in names.items()
        if name in known
    )


def test_errors(loop: Loop, form: str) -> str:
    """Test error before and after [sigma]; one number if no effect was found."""
    models = (loop.before, loop.after) if loop.effects else (loop.before,)
    return " -> ".join(format(loop.test_error(model), form) for model in models)


def named(loop: Loop, id: str) -> str:
    """An effect with its meaning, as part of a sentence."""
    told = meaning(loop, id)
    return say("answer.effect", id=id, meaning=told) if told else id


def meaning(loop: Loop, id: str) -> str:
    """The meaning of an effect, as part of a sentence; '' for an effect without meaning."""
    told = loop.words.catalogue[id].meaning if id in loop.words.catalogue else ""
    return _lower(told).rstrip(".")


def _reasons(loop: Loop) -> list[str]:
    return [f"  - {reason}" for reason in loop.reasons]


# ---- tables --------------------------------------------------------------------------------


def errors(loop: Loop) -> TextTable:
    """Table: rms of the residual of each block, in the unit of friction and in sigma."""
    size, unit = readable(loop)
    within = f" [{unit}]" if unit else ""
    rows = []
    for name in NAMES:
        both = [loop.before.rms[name], loop.after.rms[name]]
        count = str(int(loop.blocks.of(name).sum()))
        sigma = loop.sigma_of(loop.blocks.of(name))
        rows.append((say(f"table.{name}"), count, *_errors(both, size, sigma)))
    return TextTable(
        say("table.errors"),
        ("block", "rows", f"rms before{within}", f"rms after{within}", "before [σ]", "after [σ]"),
        rows,
        say(
            "table.errors_note",
            sigma=_what_sigma_is(loop),
            lowest=_lowest(loop),
            target=_target(loop),
            noise=noise_text(loop.after.noise),
            bound=_bound(loop),
        ),
        (2,),
    )


def _lowest(loop: Loop) -> str:
    """Words on how small an error can be; of a model that is below it, that the noise is too."""
    sizes = [c.train_rms / loop.sigma for c in loop.candidates if c.converged]
    least = min(sizes, default=1.0)
    if least > _BELOW:
        return say("table.not_below")
    return say("table.below", least=least)


def _target(loop: Loop) -> str:
    """The test error that counts as noise; empty where it is not known."""
    most = loop.held_out_threshold
    return say("table.target", most=most) if math.isfinite(most) else ""


def _what_sigma_is(loop: Loop) -> str:
    here, *later = sigma_texts(loop)
    row = loop.words.row
    if not later:
        return say("table.sigma", here=here, row=row)
    return say("table.sigmas", here=here, row=row, later=later[0])


def _bound(loop: Loop) -> str:
    """Words on the time beyond which structure is not taken for noise; empty if unknown."""
    bound = loop.after.noise.bound()
    return say("table.bound", bound=bound) if bound else ""


def _errors(both: list[float], size: float, sigma: float) -> tuple[str, ...]:
    return (*(f"{size * v:.4g}" for v in both), *(f"{v / sigma:.3f}" for v in both))


def by_velocity(loop: Loop, *, most: int | None = None) -> TextTable:
    """Table: rms [sigma] at each velocity, or at the `most` with the largest error after."""
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
        rows.append((f"{time:.4g} s", shown, blocks or say("table.no_row"), *errors))
        worst.append(both[1] if np.isfinite(both[1]) else np.inf if blocks else 0.0)
    head = ("from", loop.words.velocity.lower(), "block", "before [σ]", "after [σ]")
    if most is None or len(rows) <= most:
        return TextTable(loop.words.errors, head, rows)
    few = np.sort(np.argsort(worst, kind="stable")[-most:])
    note = say("table.largest_errors", most=most, all=len(rows))
    return TextTable(loop.words.errors, head, [rows[k] for k in few], note)


def moved(loop: Loop) -> TextTable:
    """Table: parameters before and after, with intervals, and their shifts."""
    rates = loop.before.A_minus_B, loop.after.A_minus_B
    rows = [] if rates[1] is None else [_moved(loop, DIFFERENCE, rates[0], rates[1])]
    for name, after in loop.after.parameters.items():
        rows.append(_moved(loop, name, loop.before.parameters.get(name), after))
    marked = tuple(k for k, row in enumerate(rows) if "." in row[0])
    head = ("name", "meaning", "before", "after ± std", "95 % interval", "shift [std]", "unit")
    notes = [say("table.shift")]
    if loop.verdict == "ambiguous" and loop.effects:
        notes.append(say("table.rivals_covered"))
    note = "\n".join([*notes, *_also_fitted(loop), *traded(loop)])
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
    """Lines on base parameters that are determined before an effect is added, but not after.

    Each line names the parameter q that p trades with, and a combination of p and q that stays
    determined. By the covariance S of this model alone, p - q S_pq/S_qq has the smallest error of
    all sums of p and a multiple of q.
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
    value = f"{one.value / size:.2g} ± {error} {unit}".rstrip()
    alone = say("table.own_error", own=own) if own != error else ""
    told = say("table.traded", name=shown_name(name), value=value, own=alone)
    others = [k for k, id in enumerate(after.free) if "." in id and after.parameters[id].determined]
    likes = {k: spread[i, k] / np.sqrt(spread[i, i] * spread[k, k]) for k in others}
    best = max(likes, key=lambda k: abs(likes[k]), default=None)
    if best is None or not abs(likes[best]) >= CORRELATED:
        return say("table.nothing_takes", traded=told)
    other, slope = after.free[best], spread[i, best] / spread[best, best]
    times = -slope * shown_unit(after.parameters[other], length)[1] / size
    value = (one.value - slope * after.parameters[other].value) / size
    std = math.sqrt(spread[i, i] * (1 - likes[best] ** 2)) / size
    sign = "+" if times > 0 else "-"
    known = f"{value:.{decimals(std)}f} ± {std:.{decimals(std)}f} {unit}"
    sum_ = f"{name} {sign} {abs(times):.3g} {other} = {known}"
    text = say("table.trades_with", traded=told, other=other, correlation=likes[best], sum=sum_)
    return text.rstrip().replace("-", "−")


def _also_fitted(loop: Loop) -> list[str]:
    """A note on columns beside friction that the errors rest on; `jaxfric fit` leaves them out."""
    columns = ("slip", "load_point_encoder")
    used = [name for name in columns if getattr(loop.record, name, None) is not None]
    return [say("table.known_less", columns=" and ".join(used))] if used else []


def _estimate(estimate: Estimate, size: float) -> tuple[str, str, str]:
    """Value, standard deviation and 95 % interval as text."""
    value, std = estimate.value / size, estimate.std / size
    if not estimate.free:
        return f"{value:.6g}", "", say("table.given")
    if not estimate.determined or not np.isfinite(value):
        return say("table.undetermined"), "", ""
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
        return say("table.weakening_all" if second else "table.weakening")
    if "." not in name:
        try:
            text = loop.words.quantity(name).text
            return say("table.moment") if (name, loop.length_unit) == ("M", "rad") else text
        except KeyError:
            return say("table.reference") if name == "V0" else ""
    effect, field = name.split(".", 1)
    known = parameters(loop.words.catalogue[effect]) if effect in loop.words.catalogue else {}
    return known[field].text if field in known else ""


def significance(loop: Loop) -> TextTable:
    """Table: p-values of the residual tests before and after."""
    rows = []
    for name, before in loop.before.tests.items():
        both = (before, loop.after.tests.get(name, math.nan))
        rows.append((question(name), *(p_value(p) for p in both)))
    head = (say("table.left"), "p before", "p after")
    note = say("table.tests_note", significant=SIGNIFICANT)
    return TextTable(say("table.tests"), head, rows, note)


def candidates(loop: Loop, *, most: int) -> TextTable:
    """Table: the fitted models, best first."""
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
    note = say("table.candidates_note")
    if more > 0:
        note += say("table.more_candidates", more=more)
    head = ("effects", "ΔBIC", "train [σ]", "select [σ]", "")
    marked = tuple(k for k, c in enumerate(found[:most]) if loop.role(c) == "model")
    return TextTable(say("table.candidates"), head, rows, note, marked)


def _role(loop: Loop, candidate: CandidateScore) -> str:
    """Role of a model in the search and, where it was not taken, why.

    One that nothing spoke against was compared with the model by BIC, and takes its place where
    that is lower by more than `TIE`.
    """
    role = loop.role(candidate)
    if role != "tried":
        return say(f"table.{role}")
    if candidate.rejection is not None:
        return say("table.refused", why=words_of_refusal(candidate.rejection))
    gain = loop.gain()
    worse = math.nan if gain is None else gain + candidate.delta_bic
    if abs(worse) <= TIE:
        return say("table.as_good", tie=TIE)
    return say("table.worse", worse=worse) if worse > TIE else say("table.tried")


def stretches(details: RunDetails) -> list[TextTable]:
    """Table: the stretches of a run with time, steps, holds, normal stress and friction level."""
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
    return [TextTable(say("table.stretches"), head, rows, say("table.level", unit=of))]


def rests_on(loop: Loop) -> TextTable:
    """Table: each claim, and the rows that support it, by direction and speed."""
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
    note = say("table.rests_on_note", accept=ACCEPT)
    return TextTable(say("table.rests_on"), head, rows, note)


# ---- aliases -------------------------------------------------------------------------------


def apart(loop: Loop) -> list[str]:
    """Sentences on every added effect: likely confusions, and the run that would separate them.

    Effects may look alike to first order. A refit with one in place of the other distinguishes them
    if its BIC is worse by more than 10. If structure remains in the residual, no added effect is
    distinguished from all others: it may partly stand for another effect.
    """
    out, open_ = [], dict(confused(loop))
    codes = {one.code for one in loop.findings}
    why = say("apart.left") if codes.intersection(_NOT_NOISE) else ""
    why = say("apart.others") if LoopCode.OTHERS in codes else why
    for id, *others in loop.alias_groups:
        alike = open_.get(id, [])
        told = [o for o in others if o not in alike]
        worse = [say("apart.worse", other=o, worse=_worse(loop, id, o)) for o in told]
        refit = say("apart.refit", others=listed(worse)) if worse else ""
        if alike:
            wanted = change_words(loop.separations.get(id, ()))
            would = say("apart.would", changes=wanted) if wanted else ""
            names = listed(alike, "or")
            out.append(say("apart.not_told", id=id, others=names, would=would, refit=refit))
        family = next((f for f in loop.families if id in f.effects), None)
        if family is not None:
            out.append(_of_family(id, family, "" if alike else refit))
        if alike or family is not None:
            continue
        near, value = _nearest(loop, id)
        most = say("apart.near", near=near, cosine=value) if near and not refit else ""
        code = "apart.in_part" if why else "apart.told"
        out.append(say(code, id=id, why=why, near=most, refit=refit))
    if not out:
        out.append(say("apart.none"))
    pairs = [say("apart.pair", a=a, b=b, cosine=value) for a, b, value in alias_pairs(loop)]
    out.append(say("apart.pairs", pairs="; ".join(pairs)) if pairs else say("apart.no_pairs"))
    return out


def confused(loop: Loop) -> list[tuple[str, list[str]]]:
    """Added effects that neither the record nor a refit distinguishes from others."""
    found = []
    for id, *others in loop.alias_groups:
        alike = [other for other in others if not _tells(loop, id, other)]
        found += [(id, alike)] if alike else []
    return found


def likeliest(loop: Loop, id: str, others: Sequence[str]) -> list[str]:
    """The effects that may replace the effect `id`, the best refit first.

    Effects without a refit follow, the most similar first.
    """
    worse = {other: _worse(loop, id, other) for other in others}
    return sorted(others, key=lambda other: math.inf if math.isnan(worse[other]) else worse[other])


def _of_family(id: str, family: CurveFamily, refit: str) -> str:
    """Words on effects easily taken for one, where the shape of its curve is not told."""
    would = say("apart.would", changes=where_told(family)) if family.decided_by else ""
    return say("apart.curve", id=id, why=why_untold(family), would=would, refit=refit)


def alias_pairs(loop: Loop) -> list[tuple[str, str, float]]:
    """Pairs of effects with |cosine| >= 0.95 that no refit distinguishes, most alike first."""
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
    """A sentence on how the record was split, and its consequence."""
    if loop.blocks.by_step:
        return say("apart.by_parts", part=loop.words.part, how=_whole_parts(loop))
    count = len(alias_pairs(loop))
    code = {0: "zero_pairs", 1: "one_pair"}.get(count, "some_pairs")
    return say("apart.by_displacement", pairs=say(f"apart.{code}", count=count))


def _whole_parts(loop: Loop) -> str:
    """Words on parts held out whole, and on what is done with one that is not."""
    blocks, piece = loop.blocks, loop.words.piece
    held = blocks.select | blocks.report
    if not np.isin(blocks.step[held], blocks.step[blocks.train]).any():
        return say("apart.whole", piece=piece)
    return say("apart.cut", piece=piece)


# ---- numbers -------------------------------------------------------------------------------


def base_name(loop: Loop) -> str:
    """The base model in words."""
    return loop.words.base.format(law=loop.base_fit.law)


def readable(loop: Loop) -> tuple[float, str]:
    """Factor and unit that make the noise of friction a readable number."""
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
    """`sigma` as text, and the noise of the held-out rows if it differs."""
    held = loop.sigma_of(loop.blocks.select | loop.blocks.report)
    return tuple(dict.fromkeys(in_words(loop, size) for size in (loop.sigma, held)))


def in_words(loop: Loop, friction: float) -> str:
    """A size of friction as text: "0.301 × 10⁻³", "1.2 mN"."""
    size, unit = readable(loop)
    times = " × " if unit.startswith("10") else " "
    return f"{size * friction:.3g}{times}{unit}".rstrip()


def length_of(loop: Loop) -> str:
    """The symbol of the record's unit of length; um if the unit has none, as "0.05 um"."""
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
