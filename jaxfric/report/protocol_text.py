"""A planned protocol as tables and lines of text, for the terminal."""

from collections.abc import Iterable, Mapping

import numpy as np

from ..effects import CATALOGUE, parameters
from ..fitting import Estimate
from ..loop.thresholds import ALIAS
from ..protocol.design import BASE, Change, Design, Pair, Protocol, Smallest
from ..protocol.remedy import Answer, Remedy
from ..units import duration, prefixed, with_unit
from .estimates import shown_unit
from .report import NextStep, Report
from .tables import TextTable
from .words import say

_NOTHING = Answer()
_FIRST = 4


def report(
    plan: Protocol, found: Answer = _NOTHING, *, typical: bool = False, command: str = ""
) -> Report:
    """Report the distinguished pairs of effects, or only the requested pair; then plan and tables.

    `found` is the answer on the requested pair. `command` is the command line of the recommended
    change of the plan.
    """
    pair, better, less = found
    best = plan.recommended() if better is None else better.change
    first = [_counted(plan)] if pair is None else answer(plan, pair, better)
    last = []
    if less is not None:
        last = [f"the same in less time ({duration(less.duration)}): {less.text}"]
    elif pair is None and best is not None and best.design is not None:
        last = [f"recommended: {best.text}: leaves {len(best.design.pairs())} pairs"]
    tables = (effects(plan), changes(plan, best))
    steps = [NextStep("", command)] if command else []
    head = [*first, _planned(plan), *last][:3]
    return Report(head, tables, _details(plan, typical), (), plan.warnings, next_steps=steps)


def answer(plan: Protocol, pair: Pair, better: Remedy | None = None) -> list[str]:
    """Say whether the plan distinguishes the requested two effects, and their smallest amplitudes.

    If the answer is no, the text names a change of the plan that would distinguish the two effects.
    If the answer is yes, a second line names further effects that are easily mistaken for either of
    the two.
    """
    told = _answered(plan, pair)
    if better is not None:
        told = f"{told}; {_would(pair, better)}"
    elif not pair.apart and plan.changes:
        told = f"{told}; no change in the table below would"
    likes = [
        f"{a} from {b} ({value:.3f})" if a in pair.ids else f"{b} from {a} ({value:.3f})"
        for a, b, value in plan.design.likes(*pair.ids)
    ]
    return [told, f"caution: not {' nor '.join(likes)}"] if pair.apart and likes else [told]


def _answered(plan: Protocol, pair: Pair) -> str:
    base_last = sorted(pair.ids, key=lambda id: id == BASE)
    a, b = (f"the {plan.law} law" if id == BASE else id for id in base_last)
    if pair.apart or pair.needed:
        code = "apart" if pair.apart else "only_if"
        return say(f"protocol.{code}", a=a, b=b, sizes=_from_sizes(plan.design, pair))
    if pair.cosine is None:
        unseen = [id for id in pair.ids if id in plan.design.unseen()]
        return f"no: this plan does not see {' and '.join(unseen)}, whatever the size"
    alike = f"|cosine| {pair.cosine:.3f}, above {ALIAS:g}"
    return f"no: this plan cannot distinguish {a} from {b}: {alike}"


def _would(pair: Pair, better: Remedy) -> str:
    change, after = better.change, better.pair
    sizes = ""
    if after.apart and change.design is not None:
        sizes = f", if {_from_sizes(change.design, after)}"
    text = f"{change.text} ({duration(change.duration)}){sizes}"
    if not better.enough:
        return f"no single change in the table below does, the nearest is {text}"
    return (
        f"{'effects as small as those of the file need' if pair.apart else 'it would with'} {text}"
    )


def _from_sizes(design: Design, pair: Pair) -> str:
    """The smallest sizes of a pair of effects, each at the shape at which it is seen best."""
    smallest = {s.id: s for s in design.smallest}
    texts = []
    for id, size in (pair.sizes or pair.needed).items():
        shape = _shape(smallest[id])
        at = f" at {shape}" if shape else ""
        texts.append(f"{id} is as large as {_size(smallest[id], size)}{at}")
    return " or ".join(texts)


def found_too_small(plan: Protocol, pair: Pair, known: Mapping[str, float]) -> list[str]:
    """Lines on effects of a distinguished pair whose size in `known` is below the detectable size.

    `known` holds known sizes of effects, in SI, by the name of the effect.
    """
    small = plan.design.too_small(pair, known)
    sizes = [(s.id, _size(s, size), _size(s, pair.sizes[s.id])) for s, size in small]
    return [say("protocol.small", id=id, size=size, needed=needed) for id, size, needed in sizes]


def _counted(plan: Protocol) -> str:
    """How many pairs of effects the plan tells apart, and the first that it does not."""
    pairs, seen = plan.design.pairs(), len(plan.design.ids) - len(plan.design.unseen())
    whole = seen * (seen - 1) // 2
    text = f"This plan tells {whole - len(pairs)} of {whole} pairs of effects apart"
    more = f" and {len(pairs) - _FIRST} more" if len(pairs) > _FIRST else ""
    return text + (f"; not {_list(pairs[:_FIRST])}{more}" if pairs else "")


def _planned(plan: Protocol) -> str:
    """The velocities, the duration and the noise of the plan."""
    ends = (prefixed(V, "m/s", 3) for V in (min(plan.velocities), max(plan.velocities)))
    noise = with_unit(f"{plan.noise:.2g}", plan.friction_unit)
    origin = f", from {plan.noise_from}" if plan.noise_from else ""
    return (
        f"plan: {len(plan.velocities)} velocities, {' to '.join(ends)},"
        f" {prefixed(plan.slip_per_step, 'm')} each: {duration(plan.duration)},"
        f" {plan.rows * len(plan.velocities)} rows; noise of a row {noise}{origin}"
    )


def _details(plan: Protocol, typical: bool) -> list[str]:
    """The machine, the base, and the effects that the plan does not tell apart or see."""
    unit = f"{plan.friction_unit.removeprefix('1')}/µm"
    edge = "any stiffness is stable" if plan.ratio is None else f"K/K_cr = {plan.ratio:.2f}"
    slip = f"; slip channel, noise {prefixed(plan.slip_noise, 'm', 3)}" if plan.slip_noise else ""
    base = ", ".join(_parameter(name, value) for name, value in plan.parameters.items())
    known = f"; with {', '.join(plan.with_)}" if plan.with_ else ""
    usual = " (typical values: give yours with --parameters or --from)" if typical else ""
    lines = [
        f"machine: K = {plan.stiffness * 1e-6:.4g} {unit}, {edge}{slip}",
        f"base: {plan.law} law, {base}{known}{usual}",
    ]
    alike = [f"{a}/{b} {value:.3f}" for a, b, value in plan.design.pairs()]
    if alike:
        lines.append(f"not told apart (|cosine| above {ALIAS:g}): {', '.join(alike)}")
    unseen = plan.design.unseen()
    return [*lines, f"not seen at all: {', '.join(unseen)}"] if unseen else lines


def effects(plan: Protocol) -> TextTable:
    """Table of effects with their smallest identifiable amplitude and most similar effect."""
    rows = []
    for k, s in enumerate(plan.design.smallest):
        wanted = "" if s.needed is None else f" (needs {_size(s, s.needed)}, impossible)"
        seen = f"not seen{wanted}" if s.amplitude is None else _size(s, s.amplitude)
        alike = np.delete(plan.design.cosines[k], k)
        most = ("", "")
        if np.isfinite(alike).any():
            other = int(np.nanargmax(alike))
            most = (np.delete(plan.design.ids, k)[other], f"{alike[other]:.3f}")
        rows.append((s.id, seen, _shape(s), *most))
    head = ("effect", "detected from", "with shape", "most alike", "|cosine|")
    return TextTable("How large an effect must be to be named", head, rows, say("note.detected"))


def changes(plan: Protocol, best: Change | None) -> TextTable:
    """Table of possible changes of the plan, with the pairs of effects that each change separates.

    In this table the row of the change `best` is marked.
    """
    before = {pair[:2] for pair in plan.design.pairs()}
    rows = []
    for change in plan.changes:
        left, separated, new = "–", "the slider slips away", ""
        if change.design is not None:
            pairs = change.design.pairs()
            left, separated = str(len(pairs)), _list(plan.separated(change))
            new = _list(pair for pair in pairs if pair[:2] not in before)
        rows.append((change.text, duration(change.duration), left, separated, new))
    marked = tuple(k for k, change in enumerate(plan.changes) if change is best)
    head = ("change", "lasts", "pairs left", "separates", "no longer told apart")
    title = f"What would separate more (the plan leaves {len(before)} pairs)"
    return TextTable(title, head, rows, "", marked)


# ---- cells ---------------------------------------------------------------------------------


def _list(pairs: Iterable[tuple[str, str] | tuple[str, str, float]]) -> str:
    return ", ".join(f"{pair[0]}/{pair[1]}" for pair in pairs)


def _size(s: Smallest, value: float) -> str:
    """An amplitude by its symbol, in a readable unit."""
    if s.id == "evolution_cutoff":  # 1/c is the velocity in the equation of this effect
        return f"Vc = {prefixed(1 / value, 'm/s', 3)}"
    shown, size = shown_unit(Estimate(value, 0.0, 0.0, 0.0, s.unit), "um")
    symbols = [parameters(CATALOGUE[s.id])[n].symbol if s.id in CATALOGUE else n for n in s.names]
    return f"{', '.join(symbols)} = {with_unit(f'{value / size:.2g}', shown)}"


def _shape(s: Smallest) -> str:
    """The shape at which an effect is seen best."""
    texts = []
    for name, value in s.shape.items():
        about = parameters(CATALOGUE[s.id]).get(name) if s.id in CATALOGUE else None
        unit, symbol = (about.unit, about.symbol) if about else ("", name)
        texts.append(f"{symbol} = {prefixed(value, unit, 3)}")
    return ", ".join(texts)


def _parameter(name: str, value: float) -> str:
    unit = "m/s" if name == "V0" else "m" if name[0] == "L" and "." not in name else "1"
    return f"{name} = {prefixed(value, unit)}"
