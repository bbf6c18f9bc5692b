"""The search: base, screen, joint refits, forward, backward, swaps.

1. Base fit and its noise, from several starts. 2. Screen all effects to first order. 3. Refit the
most promising jointly. 4. Accept the best if BIC falls by more than 10, neither the train nor the
select block is fitted worse, and its parameters are possible and fixed by the record. 5. Again, as
long as there is evidence; then drop what is no longer needed, and try in place of each what is
easily taken for it.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..effects import AbstractPlaceEffect, RecordScales
from .engine import Candidate, Engine
from .estimates import estimates
from .fixed import not_fixed
from .pace import Pace, now_and_then
from .refusal import Fault, Move, Refusal, not_fixed_refusal, takes_refusal
from .screen import Screened, aliases, screen
from .taken import taken
from .thresholds import ACCEPT, ALIAS, SIGNIFICANT, TIE

MOST = 8
"""Largest number of effects that a search adds: evidence ends it before, as a rule."""
_LOST = 2.0  # of -2 ln L
_PARTS = (0.1, 0.01, 1e-3)
_REFITS = 4
_WORSE = 1.02
_TRAIN_WORSE = 1.005
_AGREE, _ROUGHLY = 1.0, 0.1
"""Differences of BIC: between two fits that agree, and between a rough fit and the best."""


class Search(NamedTuple):
    """The outcome of a search: base, final model, and every candidate that was tried."""

    base: Candidate
    final: Candidate
    tried: tuple[Candidate, ...]
    accepted: tuple[tuple[str, ...], ...]
    screened: tuple[tuple[Screened, ...], ...]
    """The screened effects of every round."""
    ids: tuple[str, ...]
    cosines: np.ndarray
    starts_agree: bool


def search(
    engine: Engine,
    starts: Sequence[np.ndarray],
    scales: RecordScales,
    *,
    most: int,
    progress: Callable[[str], None],
) -> Search:
    """Find what the base model lacks. `starts` are parameters of the encompassing model
    to start the base from, the likeliest first."""
    words = "base fit of the train block"
    progress(words)
    engine.stopwatch.listen = now_and_then(progress, words)
    base, agree = _base(engine, starts)
    base = engine.learn_noise(base)
    engine.stopwatch.listen = lambda number, seconds: None
    current, tried = base, [base]
    rounds: list[tuple[Screened, ...]] = []
    accepted: list[tuple[str, ...]] = [()]
    pace = Pace(progress, engine.stopwatch, most, _REFITS, at_once=engine.at_once)
    while len(current.effects) < most and not base.failed:
        missing = len(engine.addable(current.effects))
        if not missing:
            break
        pace.screening(f"screening {missing} effects", len(rounds))
        found = screen(engine, current, scales)
        rounds.append(tuple(found))
        better = _refits(engine, current, found, scales, tried, pace)
        if better is None:
            break
        current = _exact(engine, better, tried)
        accepted.append(current.effects)
    pace.end()
    progress("what can be told apart")
    ids, cosines = aliases(engine, current, scales)
    before = current
    while True:
        current = _without_needless(engine, current, tried)
        other = _swapped(engine, current, (ids, cosines), rounds, scales, tried, progress)
        if other is current:
            break
        # beside the right effect one that stood in for it is needless
        current = other
        ids, cosines = aliases(engine, current, scales)
    if current is not before:
        current = _exact(engine, current, tried)
        accepted.append(current.effects)
        ids, cosines = aliases(engine, current, scales)
    for k, c in enumerate(tried):  # a rival that takes what the base had is none
        if c.effects and not c.failed and c.physical and 0 < c.bic - current.bic < ACCEPT:
            why = takes_refusal(what_it_takes(engine, _without_one(tried, c), c))
            tried[k] = c if why is None else c._replace(refused=why)
    return Search(base, current, tuple(tried), tuple(accepted), tuple(rounds), ids, cosines, agree)


def _base(engine: Engine, starts: Sequence[np.ndarray]) -> tuple[Candidate, bool]:
    """The best base fit of several starts, and whether they agree.

    The first is likely the best; the others are fitted to the end only where they are better.
    """
    engine.seek_parts(starts[0])
    found = engine.each(
        lambda k, start: engine.refit((), start, exact=not k), range(len(starts)), starts
    )
    good = [c for c in found if not c.failed]
    if not good:
        return found[0], False
    best = min(good, key=lambda c: c.bic)
    agree = sum(c.bic - best.bic < _AGREE for c in good) > 1
    if found[0].failed or found[0].bic - best.bic > _ROUGHLY:
        best = min(best, engine.refit((), best.z, exact=True), key=lambda c: c.bic)
    else:
        best = found[0]
    return best, agree or len(starts) == 1


def _refits(
    engine: Engine,
    current: Candidate,
    found: Sequence[Screened],
    scales: RecordScales,
    tried: list[Candidate],
    pace: Pace,
) -> Candidate | None:
    """The best acceptable joint refit of the most promising effects, and of those that make another
    law of the base, whose first order says little of them; or None.

    Of those whose BIC is within `TIE`, which is no evidence, the first of the catalogue. Where
    what was added before is no longer fixed beside a new effect, it may have stood in for that:
    then the new one is asked without it.
    """
    accepted: list[Candidate] = []
    missing = any(s.p_value <= SIGNIFICANT for s in found)
    laws = [s.id for s in found if missing and engine.law(s.id, current.z) is not None]
    asked = [
        s
        for k, s in enumerate(found)
        if (k < _REFITS and s.delta_bic >= 0 and s.p_value <= SIGNIFICANT)
        or s.id in laws
        or len(tried) + k <= 2  # two of the base are fitted in any case, for comparison
    ]

    def fitted(place: int, one: Screened) -> Candidate:
        effects = (*current.effects, one.id)
        words = "refitting with " + ", ".join(effects)
        pace.refitting(words, len(current.effects), place, len(asked))
        return refit_safely(engine, effects, one, current)

    for one, candidate in zip(asked, engine.each(fitted, range(len(asked)), asked), strict=True):
        chance = engine.rms_error(engine.blocks.select, candidate.noise)
        why = fault(current, candidate, chance)
        if why is None and one.p_value > SIGNIFICANT and one.id not in laws:
            why = Refusal(Fault.CHANCE)
        loose = () if why else not_fixed(engine, candidate, scales)
        takes = () if why or loose else what_it_takes(engine, current, candidate)
        refused = why or not_fixed_refusal(loose) or takes_refusal(takes)
        tried.append(candidate._replace(refused=refused))
        if loose:
            candidate = _without(engine, candidate, loose, one.id, tried)
            if candidate is None or fault(current, candidate, chance):
                continue
            loose = not_fixed(engine, candidate, scales)
        if not why and not loose and not takes:
            accepted.append(candidate)
    if not accepted:
        return None
    least = min(c.bic for c in accepted)
    tied = [c for c in accepted if c.bic - least < TIE]
    order = [e.id for e in engine.model.effects]
    return min(tied, key=lambda c: order.index(c.effects[-1]))


def _without(
    engine: Engine, candidate: Candidate, loose: Sequence[str], kept: str, tried: list[Candidate]
) -> Candidate | None:
    """Refitted without the effects whose parameters are `loose`; None where `kept` is one of them,
    or that model cannot be."""
    gone = {name.split(".")[0] for name in loose}
    if kept in gone:
        return None
    rest = tuple(e for e in candidate.effects if e not in gone)
    known = [c for c in tried if set(c.effects) == set(rest)]
    if not known:
        start = np.array(candidate.z)
        for id in gone:
            start[engine.model.amplitudes(id)] = 0.0
        known.append(engine.refit(rest, start))
        tried.append(known[0])
    found = min(known, key=lambda c: c.bic)
    return found if found.physical and not found.failed else None


def _exact(engine: Engine, candidate: Candidate, tried: list[Candidate]) -> Candidate:
    """A candidate fitted to the end, unless that is no better; it takes its place among `tried`."""
    found = engine.refit(candidate.effects, candidate.z, exact=True)
    if found.failed or not found.physical or found.bic > candidate.bic:
        return candidate
    rough = (
        k for k, c in enumerate(tried) if (c.effects, c.bic) == (candidate.effects, candidate.bic)
    )
    tried[next(rough)] = found
    return found


def refit_safely(
    engine: Engine, effects: tuple[str, ...], one: Screened, current: Candidate
) -> Candidate:
    """Refit from the first-order start or, while that runs away, from a part of the effect; at last
    from the fit of the law that the effect alone would be (`AbstractEffect.law`).

    `current` is a fit without the effect. Where two sensitivities are nearly one (a second state
    whose length is that of the first), their amplitudes to first order are opposite and a hundred
    times what they can be. A fit whose train rows are less likely than without the effect, which it
    has at its null, is lost too. One that fits them well and does not predict the select rows is
    not: nearer it ends in the same place.
    """
    own = engine.model.columns((one.id,))

    def found(candidate: Candidate) -> bool:
        less = float(current.noise.log_likelihood) - float(candidate.noise.log_likelihood)
        return not candidate.failed and 2 * less < _LOST

    best = engine.refit(effects, one.z)
    for part in _PARTS:
        if found(best):
            break
        start = np.array(current.z)
        start[own] = one.z[own]
        start[engine.model.amplitudes(one.id)] *= part
        best = min(best, engine.refit(effects, start), key=lambda c: (c.failed, c.bic))
    law = engine.law(one.id, current.z)
    if law is not None and not (found(best) and best.physical):
        start = engine.refit(current.effects, law).z
        again = engine.refit(effects, start)
        best = min(best, again, key=lambda c: (c.failed, not c.physical, c.bic))
    return best


def fault(current: Candidate, candidate: Candidate, chance: float) -> Refusal | None:
    """The first reason why a candidate is not taken; None where it is better by more than 10 of
    BIC, possible, and not worse on the select block than chance.

    `chance` is the relative standard error of the rms of noise there: few rows, or correlated
    ones, may differ much. Where the train block is fitted worse, only the noise has become
    likelier: that is no evidence of an effect.
    """
    limit = max(_WORSE * current.rms["select"], (1 + 2 * chance) * candidate.rms["train"])
    gain = current.bic - candidate.bic
    fitted = 2 * float(candidate.noise.log_likelihood - current.noise.log_likelihood)
    faults = {
        Fault.FAILED: candidate.failed,
        Fault.IMPOSSIBLE: not candidate.physical,
        Fault.OVERFITTED: gain < 0 and fitted > 2 * ACCEPT,
        Fault.WEAK: not gain > ACCEPT,
        Fault.TRAIN: not candidate.rms["train"] <= _TRAIN_WORSE * current.rms["train"],
        Fault.SELECT: not candidate.rms["select"] <= limit,
    }
    return next((Refusal(code) for code, is_so in faults.items() if is_so), None)


def what_it_takes(engine: Engine, without: Candidate, candidate: Candidate) -> tuple[Move, ...]:
    """The parameters of the base that an effect of a candidate takes; `without` is the fit without
    that effect."""
    new = [e for e in engine.model.effects if e.id in {*candidate.effects} - {*without.effects}]
    of_place = any(issubclass(effect, AbstractPlaceEffect) for effect in new)
    before, after = (estimates(engine, c, "F")[0] for c in (without, candidate))
    return taken(before, after, of_place=of_place)


def _without_one(tried: Sequence[Candidate], candidate: Candidate) -> Candidate:
    """The best fit that was tried with one effect less; the base where there is none."""
    own = set(candidate.effects)
    less = [
        c for c in tried if not c.failed and set(c.effects) < own and len(c.effects) == len(own) - 1
    ]
    return min(less, key=lambda c: c.bic, default=tried[0])


def _without_needless(engine: Engine, current: Candidate, tried: list[Candidate]) -> Candidate:
    """Drop effects whose absence BIC prefers."""
    dropped = True
    while dropped and len(current.effects) > 1:
        dropped = False
        for id in current.effects:
            rest = tuple(e for e in current.effects if e != id)
            known = [c for c in tried if set(c.effects) == set(rest)]
            if known:
                without = min(known, key=lambda c: c.bic)
            else:
                start = np.array(current.z)
                start[engine.model.amplitudes(id)] = 0.0
                without = engine.refit(rest, start)
                tried.append(without)
            if not without.failed and without.physical and without.bic < current.bic:
                current, dropped = without, True
                break
    return current


def _swapped(
    engine: Engine,
    current: Candidate,
    alike: tuple[tuple[str, ...], np.ndarray],
    rounds: Sequence[Sequence[Screened]],
    scales: RecordScales,
    tried: list[Candidate],
    progress: Callable[[str], None],
) -> Candidate:
    """The best of this fit and of those with an effect replaced by one easily taken for it.

    Where a better effect leaves others of the fit no longer fixed, those may have stood in for it:
    it is then tried without them. One whose fits have all failed is tried from what is left.
    """
    best, (ids, cosines), asked = current, alike, []
    for id in current.effects:
        others = [b for b in ids if b != id and cosines[ids.index(id), ids.index(b)] > ALIAS]
        for other in others:
            effects = tuple(other if e == id else e for e in current.effects)
            known = any(set(c.effects) == set(effects) and not c.failed for c in tried)
            if not known and len(set(effects)) == len(effects) and engine.apart(effects):
                asked.append((id, other, effects))

    def fitted(id: str, other: str, effects: tuple[str, ...]) -> Candidate:
        start = np.array(current.z)
        start[engine.model.amplitudes(id)] = 0.0
        rest = {e for e in current.effects if e != id}
        known = [c for c in tried if set(c.effects) == rest and not c.failed]
        seen = next(s for found in rounds for s in found if s.id == other)
        columns = engine.model.columns((other,))
        start[columns] = seen.z[columns]
        progress("refitting with " + ", ".join(effects))
        without = min(known, key=lambda c: c.bic, default=None)
        if without is None:
            return engine.refit(effects, start)
        return refit_safely(engine, effects, seen._replace(z=start), without)

    candidates = engine.each(lambda one: fitted(*one), asked)
    for (_, other, _), candidate in zip(asked, candidates, strict=True):
        possible = candidate.physical and not candidate.failed
        better = possible and best.bic - candidate.bic > TIE
        loose = not_fixed(engine, candidate, scales) if better else ()
        close = possible and best.bic - candidate.bic > -ACCEPT
        takes = what_it_takes(engine, _without_one(tried, candidate), candidate) if close else ()
        refused = not_fixed_refusal(loose) or takes_refusal(takes)
        tried.append(candidate._replace(refused=refused))
        if loose:
            candidate = _without(engine, candidate, loose, other, tried)
            if candidate is None or not best.bic - candidate.bic > TIE:
                continue
            better = not not_fixed(engine, candidate, scales)
        if better and not takes:
            best = candidate
    return best
