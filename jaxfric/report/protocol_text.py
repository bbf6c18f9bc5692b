"""A planned protocol as tables and lines of text, for the terminal."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..effects import CATALOGUE, RunChange, parameters, separators
from ..fitting import Estimate
from ..loop.family import listed
from ..loop.thresholds import ALIAS
from ..protocol.design import BASE, Change, Design, Pair, Protocol, Smallest
from ..protocol.remedy import Answer, Remedy
from ..units import format_si, speed_text
from .estimates import shown_unit
from .report import NextStep, Report
from .tables import TextTable
from .words import change_words

_NOTE = (
    "detected from: the effect's amplitude at which the likelihood ratio exceeds 10 + p ln n (p"
    " parameters, n rows) in 19 of 20 records, for the shape of the effect that is easiest to"
    " identify. This amplitude is computed to first order, with white noise, for the rows that"
    " jaxfric loop would fit. The loop holds out the last velocities"
)
_NOTHING = Answer()
_SAME = 0.9995
_FIRST = 4
_TRIED = {
    "slip_x2": (RunChange.LONG_STEPS,),
    "dwell": (RunChange.SLOW_DWELL, RunChange.DWELL),
    "repeat": (RunChange.REPEAT,),
    "slip_channel": (RunChange.SLIP_CHANNEL,),
    "load_point_channel": (RunChange.LOAD_POINT_CHANNEL,),
}
"""The hints of the catalogue that a change of the table answers."""


def _speeds(V: Sequence[float]) -> str:
    low, high = speed_text(min(V)), speed_text(max(V))
    return low if low == high else f"{low} to {high}"


def headline(plan: Protocol, *, typical: bool = False) -> list[str]:
    """The plan in a few lines."""
    V = plan.velocities
    total = plan.rows * len(V)
    K = plan.stiffness
    unit = "/um" if plan.friction_unit == "1" else f"{plan.friction_unit}/um"
    edge = "any stiffness is stable" if plan.ratio is None else f"K/K_cr = {plan.ratio:.2f}"
    base = ", ".join(_parameter(plan, name) for name in plan.parameters)
    return [
        f"plan: {len(V)} velocities, {_speeds(V)},"
        f" {_slip(plan.slip_per_step)} each: {_duration(plan.duration)},"
        f" {total} rows",
        f"machine: K = {K * 1e-6:.4g} {unit}, {edge}; {_noise(plan)}"
        + (f"; slip channel, noise {_length(plan.slip_noise)}" if plan.slip_noise else ""),
        f"base: {plan.law} law, {base}"
        + (f"; with {', '.join(plan.with_)}" if plan.with_ else "")
        + (" (typical values: give yours with --parameters or --from)" if typical else ""),
    ]


def _noise(plan: Protocol) -> str:
    """The noise that the plan counts with, and where it is from."""
    unit = "" if plan.friction_unit == "1" else f" {plan.friction_unit}"
    origin = f", from {plan.noise_from}" if plan.noise_from else ""
    return f"noise of a row {_number(plan.noise)}{unit}{origin}"


def answer(
    plan: Protocol, pair: Pair, better: Remedy | None = None, less: Change | None = None
) -> str:
    """Whether the plan distinguishes the requested pair of effects, and the pair's |cosine|.

    If not, the answer names a change of the plan that would, or one that would for small effects.
    If yes, `less` is a change that distinguishes the pair in less time.
    """
    told = _answered(plan, pair)
    if better is not None:
        return f"{told}; {_would(plan, pair, better)}"
    if less is not None and less.design is not None:
        own = less.design.pair(*pair.ids)
        return f"{told}; {less.text} tells them too, in {_duration(less.duration)} of" + (
            f" {_duration(plan.duration)}, from {_from_sizes(less.design, own)} on"
        )
    return told if pair.apart or not plan.changes else f"{told}; no change in the table below would"


def _would(plan: Protocol, pair: Pair, better: Remedy) -> str:
    change, after = better.change, better.pair
    how = [] if after.cosine is None else [f"|cosine| {_cosine(after.cosine)}"]
    how += [f"from {_from_sizes(change.design, after)} on"] if after.apart else []
    text = f"{change.text} ({'; '.join([*_planned(plan, change), *how])})"
    if not better.enough:
        return f"no single change in the table below does, the nearest is {text}"
    other = better.sooner
    sooner = "" if other is None else f", or with {other.text} ({_duration(other.duration)})"
    small = "it would tell effects as small as those of the file" if pair.apart else "it would"
    return f"{small} with {text}{sooner}"


def _planned(plan: Protocol, change: Change) -> list[str]:
    """Velocities, slip and time of a plan with a change."""
    if not change.velocities:
        return [_duration(change.duration)]
    one = "" if change.slip_noise in (None, plan.slip_noise) else _length(change.slip_noise)
    noise = [f"noise of slip {one}"] if one else []
    noise += ["which no option plans"] if change.encoder_noise is not None else []
    speeds = ", ".join(speed_text(V, 4) for V in change.velocities)
    steps = f"{speeds}, {_slip(change.slip_per_step)} each"
    return [steps, *noise, f"{_duration(change.duration)} in all"]


def _other_likes(plan: Protocol, pair: Pair) -> str:
    """That one of two effects is easily taken for a third, in this plan."""
    told: dict[str, list[str]] = {}
    for one, other, value in plan.design.likes(*pair.ids):
        own, third = (one, other) if one in pair.ids else (other, one)
        told.setdefault(own, []).append(f"{third} ({_cosine(value)})")
    words = [f"{own} from {listed(thirds, 'or')}" for own, thirds in told.items()]
    return f"not {' nor '.join(words)}" if words else ""


def _later(plan: Protocol, pair: Pair) -> str:
    """From which size on either effect is told from all others too, where that is a larger one."""
    if pair.cosine is None:  # one of the pair is the law alone
        return ""
    told = []
    for id, size in pair.sizes.items():
        third, most = plan.design.from_all(id)
        if most is not None and third not in pair.ids and most > 1.05 * size:
            own = next(s for s in plan.design.smallest if s.id == id)
            told.append(f"{id} from {third} ({_size(own, most)})")
    return f"; others only from larger ones on: {' and '.join(told)}" if told else ""


def _named_from(plan: Protocol, pair: Pair) -> str:
    """From which sizes on one of two effects is named as one of them, where these are others."""
    least = {s.id: s.amplitude for s in plan.design.smallest if s.amplitude is not None}
    least = {id: least[id] for id in pair.sizes}
    if pair.cosine is None or all(1.01 * least[id] > size for id, size in pair.sizes.items()):
        return ""
    known = {s.id: s for s in plan.design.smallest}
    sizes = " or ".join(_size(known[id], size) for id, size in least.items())
    return f" (one of the two is named from {sizes} on)"


def _from_sizes(design: Design | None, pair: Pair) -> str:
    smallest = {s.id: s for s in design.smallest} if design else {}
    sizes = (pair.sizes or pair.needed).items()
    return " or ".join(_size(smallest[id], size) + _at(smallest[id]) for id, size in sizes)


def _at(s: Smallest) -> str:
    """The shape at which an effect is seen best."""
    shape = ", ".join(_shape(s.id, name, value) for name, value in s.shape.items())
    return f" at {shape}" if shape else ""


def _names(plan: Protocol, pair: Pair) -> list[str]:
    """The two that were asked for, the base by its law and last."""
    names = [f"the {plan.law} law" if id == BASE else id for id in pair.ids]
    return names if pair.ids[0] != BASE else names[::-1]


def _answered(plan: Protocol, pair: Pair) -> str:
    a, b = _names(plan, pair)
    if pair.apart:
        how = "" if pair.cosine is None else f" (|cosine| {_cosine(pair.cosine)})"
        sizes = f"from {_from_sizes(plan.design, pair)} on"
        likes = _other_likes(plan, pair)
        others = f"; but {likes}" if likes else ""
        others = f"{_later(plan, pair)}{others}"
        return f"yes: this plan tells {a} from {b}{how}, {sizes}{_named_from(plan, pair)}{others}"
    if pair.cosine is None:
        unseen = [id for id in pair.ids if id in plan.design.unseen()]
        return f"no: this plan does not see {' and '.join(unseen)}, whatever the size"
    if pair.needed:
        return (
            f"no: this plan would tell {a} from {b} only from {_from_sizes(plan.design, pair)} on,"
            " and no effect is ten times as large as A and B of the base"
        )
    alike = f"|cosine| {_cosine(pair.cosine)}, above {ALIAS:g}"
    return f"no: this plan cannot tell {a} from {b}: {alike}"


def found_too_small(plan: Protocol, pair: Pair, known: Mapping[str, float]) -> list[str]:
    """Lines on effects of a distinguished pair whose size in `known` is below the detectable size.

    `known` holds sizes in SI by name.
    """
    return [
        f"the {s.id} of the file, {_size(s, size)}, is smaller than what this plan tells"
        f" ({_size(s, pair.sizes[s.id])}): of that size the answer is no"
        for s, size in plan.design.too_small(pair, known)
    ]


def apart(plan: Protocol, asked: Pair | None = None) -> list[str]:
    """Lines on the effects that the plan cannot distinguish, and on the requested pair.

    Effects linked by such pairs form one line. The line is a group if any two of its effects are
    alike, otherwise a chain, in which only neighbours are alike.
    """
    design, out = plan.design, []
    for group in design.groups():
        pairs = [(a, b, v) for a, b, v in design.pairs() if a in group]
        text = ", ".join(f"{a}/{b} {_cosine(v)}" for a, b, v in pairs)
        if 2 * len(pairs) == len(group) * (len(group) - 1):
            out.append(f"{' or '.join(group)}  (|cosine|: {text})")
        else:
            out.append(f"these pairs; any two of another pair are told apart  (|cosine|: {text})")
        if asked is not None and asked.apart and set(asked.ids) <= set(group):
            out.append(f"not among these pairs: {' and '.join(asked.ids)}, which are told apart")
    if not out:
        out.append("every pair of effects is told apart (|cosine| at most 0.95)")
    unseen = design.unseen()
    if unseen:
        out.append(f"not seen at all: {', '.join(unseen)}")
    return out


def advice(plan: Protocol, asked: Pair | None = None, better: Remedy | None = None) -> str:
    """The recommended change of the plan: for the requested pair, and for the most pairs."""
    if asked is None:
        return _of_all(plan, "Recommended")
    two = listed([id for id in asked.ids if id != BASE])
    own = f"no change is needed for {two}" if asked.apart else f"no change helps {two}"
    if better is not None:
        own = f"{better.change.text}, for {two}" + ("" if better.enough else " the nearest")
    rest = "Recommended beyond that"
    if better is not None and plan.recommended() is better.change:
        rest = "The same for most pairs"
    elif plan.recommended() is not None:
        rest = "For the most pairs"
    return f"{own[0].upper()}{own[1:]}: see the first line. {_of_all(plan, rest)}"


def _of_all(plan: Protocol, recommended: str) -> str:
    """The change that leaves the fewest pairs of all."""
    pairs = len(plan.design.pairs())
    if not pairs:
        return "The plan needs no change: it tells all effects apart that it sees."
    best = plan.recommended()
    left = plan.design if best is None else best.design
    assert left is not None
    stay = _stay(plan, left)
    if best is None:
        return f"None of these changes leaves fewer pairs. Pair by pair: {stay}."
    text = (
        f"{recommended}: {best.text}. It separates {_list(plan.separated(best)) or 'no pair'} and"
        f" leaves {len(left.pairs())} of {pairs} pairs"
    )
    return f"{text}: {stay}." if stay else f"{text}."


def effects(plan: Protocol) -> TextTable:
    """Table of the effects: the smallest identifiable amplitude, and the most similar effect."""
    rows = [(s.id, *_amplitude(s), *_nearest(plan.design, s.id)) for s in plan.design.smallest]
    head = ("effect", "detected from", "with shape", "most alike", "|cosine|")
    return TextTable("How large an effect must be to be named", head, rows, _NOTE)


def changes(plan: Protocol, better: Remedy | None = None) -> TextTable:
    """Table of the changes of the plan: the pairs that each separates, and the pairs that remain.

    The marked row is the change for the requested pair, otherwise the recommended change.
    """
    best = plan.recommended() if better is None else better.change
    rows = [_change(plan, change) for change in plan.changes]
    marked = tuple(k for k, c in enumerate(plan.changes) if c is best)
    head = ("change", "lasts", "pairs left", "separates", "no longer told apart")
    title = f"What would separate more (the plan leaves {len(plan.design.pairs())} pairs)"
    return TextTable(title, head, rows, "", marked)


def report(
    plan: Protocol, found: Answer = _NOTHING, *, typical: bool = False, command: str = ""
) -> Report:
    """The answer on the requested pair, or the number of distinguished pairs; the plan; the advice.

    `found` is that answer, `command` the command line of the recommended change.
    """
    pair, better, less = found
    asked = [] if pair is None else [answer(plan, pair, better, less), ""]
    lines = [*headline(plan, typical=typical), "", "What this plan cannot tell apart"]
    lines += [f"  {line}" for line in apart(plan, pair)]
    notes = [advice(plan, pair, better)] if plan.changes else []
    tables = (effects(plan), changes(plan, better))
    first = _counted(plan) if pair is None else asked[:1]
    if pair is not None and pair.apart and better is None:
        first = _in_short(plan, pair)
    told = [*first, f"{headline(plan)[0]}; {_noise(plan)}", *_recommended(plan, better, less)][:3]
    steps = [NextStep("", command)] if command else []
    return Report(told, tables, [*asked, *lines], notes, plan.warnings, next_steps=steps)


def _counted(plan: Protocol) -> list[str]:
    """How many pairs of effects the plan tells apart, and the first that it does not."""
    pairs, seen = plan.design.pairs(), len(plan.design.ids) - len(plan.design.unseen())
    whole = seen * (seen - 1) // 2
    text = f"This plan tells {whole - len(pairs)} of {whole} pairs of effects apart"
    names = [f"{a}/{b}" for a, b, _ in pairs]
    more = f" and {len(names) - _FIRST} more" if len(names) > _FIRST else ""
    return [text + (f"; not {', '.join(names[:_FIRST])}{more}" if names else "")]


def _in_short(plan: Protocol, pair: Pair) -> list[str]:
    """Yes, with the sizes from which on, and a caution."""
    likes = _other_likes(plan, pair)
    sizes = _from_sizes(plan.design, pair)
    a, b = _names(plan, pair)
    told = f"yes: this plan tells {a} from {b}, from {sizes} on"
    return [told, *([f"caution: {likes}"] if likes else [])]


def _recommended(plan: Protocol, better: Remedy | None, less: Change | None) -> list[str]:
    """The change that is recommended, in a few words."""
    if less is not None:
        return [f"the same in less time ({_duration(less.duration)}): {less.text}"]
    best = plan.recommended() if better is None else better.change
    if best is None:
        return []
    left = "" if best.design is None else f": leaves {len(best.design.pairs())} pairs"
    return [f"recommended: {best.text}{left if better is None else ''}"]


# ---- cells ---------------------------------------------------------------------------------


def _change(plan: Protocol, change: Change) -> tuple[str, ...]:
    if change.design is None:
        return change.text, _duration(change.duration), "–", "the slider slips away", ""
    before = {(a, b) for a, b, _ in plan.design.pairs()}
    new = [(a, b) for a, b, _ in change.design.pairs() if (a, b) not in before]
    left = str(len(change.design.pairs()))
    return change.text, _duration(change.duration), left, _list(plan.separated(change)), _list(new)


def _list(pairs: Iterable[tuple[str, str]]) -> str:
    return ", ".join(f"{a}/{b}" for a, b in pairs)


def _stay(plan: Protocol, design: Design) -> str:
    """Pairs that are not told apart, the changes in the table that separate them, and what the
    catalogue knows besides, which was not tried here.

    A hint of the catalogue that names a change of the table is left out: the table answers it.
    """
    tried = {one for change in plan.changes for one in _TRIED.get(change.key, ())}
    texts = []
    for a, b, value in design.pairs():
        separates = [c.text for c in plan.changes if (a, b) in plan.separated(c)]
        hints = [
            change_words([hint])
            for id, other in ((a, b), (b, a))
            if id in CATALOGUE and other in CATALOGUE[id].confused_with
            for hint in separators(CATALOGUE[id])
            if hint not in tried
        ]
        said = [f"separated by {separates[0]}"] if separates else []
        said += [f"not tried here: {' or '.join(dict.fromkeys(hints))}"] if hints else []
        said += ["they differ only where they are large"] if value > _SAME else []
        said = said or ["no change in the table separates them"]
        texts.append(f"{a} or {b} ({'; '.join(said)})")
    return "; ".join(texts)


def _amplitude(s: Smallest) -> tuple[str, str]:
    if s.amplitude is None:
        wanted = "" if s.needed is None else f" (needs {_size(s, s.needed)}, impossible)"
        return f"not seen{wanted}", ""
    shape = ", ".join(_shape(s.id, name, value) for name, value in s.shape.items())
    return _size(s, s.amplitude), shape


def _size(s: Smallest, value: float) -> str:
    """An amplitude by its symbol, in a readable unit."""
    if s.id == "evolution_cutoff":  # 1/c is the velocity in the equation of this effect
        return f"Vc = {speed_text(1 / value)}"
    shown, size = shown_unit(Estimate(value, 0.0, 0.0, 0.0, s.unit), "um")
    symbols = [parameters(CATALOGUE[s.id])[n].symbol if s.id in CATALOGUE else n for n in s.names]
    return f"{', '.join(symbols)} = {_number(value / size)} {shown}".replace("µ", "u").rstrip()


def _shape(id: str, name: str, value: float) -> str:
    about = parameters(CATALOGUE[id]).get(name) if id in CATALOGUE else None
    unit, symbol = (about.unit, about.symbol) if about else ("", name)
    text = {"m": _length, "m/s": speed_text}.get(unit, lambda v: f"{v:.3g} {unit}")(value)
    return f"{symbol} = {text.removesuffix(' 1')}"


def _nearest(design: Design, id: str) -> tuple[str, str]:
    i = design.ids.index(id)
    row = np.array(design.cosines[i])
    row[i] = np.nan
    if not np.isfinite(row).any():
        return "", ""
    k = int(np.nanargmax(row))
    return design.ids[k], _cosine(float(row[k]))


def _cosine(value: float) -> str:
    return f"{math.floor(1000 * value + 0.5) / 1000:.3f}"


def _parameter(plan: Protocol, name: str) -> str:
    value = plan.parameters[name]
    if name == "V0":
        return f"V0 = {speed_text(value)}"
    if name[0] == "L" and "." not in name:
        return f"{name} = {_length(value)}"
    return f"{name} = {value:.4g}"


def _length(value: float) -> str:
    return format_si(value, "m", "um" if value < 1e-3 else "mm", 3)


def _slip(value: float) -> str:
    return format_si(value, "m", "um", 4)


def _number(value: float) -> str:
    return f"{value:.2g}"


def _duration(seconds: float) -> str:
    if seconds < 600:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 36000 else f"{seconds / 3600:.3g} h"
