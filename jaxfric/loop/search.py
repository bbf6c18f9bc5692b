"""The search for missing effects: forward selection, backward elimination, swaps.

The search fits the base and its noise, then screens all effects to first order. The most promising
effects are refitted jointly with the base. The search accepts the best model that no gate refuses.
Screening, refitting and acceptance repeat until every further model is refused. At the end the
search drops needless effects, and tries to replace each effect by similar effects (aliases). Each
step of the search returns a new `Search`.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np

from ..effects import RecordScales
from .engine import Engine
from .gates import IN_PLACE, Trial, refusal_of, takes_nothing
from .learn import learn_noise, seek_parts
from .refit import Candidate, refit
from .refusal import Fault, takes
from .screen import Screened, aliases, screen
from .thresholds import (
    ACCEPT,
    ALIAS,
    LOST_LIKELIHOOD,
    PARTS,
    REFITS,
    TIE,
)


class Search(NamedTuple):
    """The state of a search: base, model, and every tried candidate."""

    engine: Engine
    """Engine with the noise model from the base."""
    base: Candidate
    final: Candidate
    """The model so far."""
    tried: tuple[Candidate, ...]
    accepted: tuple[tuple[str, ...], ...]
    screened: tuple[tuple[Screened, ...], ...] = ()
    """The screened effects of every round."""
    ids: tuple[str, ...] = ()
    cosines: np.ndarray = np.eye(0)
    """|cosines| between the sensitivities of effects `ids` at the model, see `screen.aliases`."""

    def trying(self, candidate: Candidate) -> Self:
        """The search with one more tried candidate."""
        return self._replace(tried=(*self.tried, candidate))

    def taking(self, candidate: Candidate) -> Self:
        """The search with another accepted model."""
        accepted = (*self.accepted, candidate.effects)
        return self._replace(final=candidate, accepted=accepted)

    def best_of(self, effects: Sequence[str]) -> Candidate | None:
        """The best tried candidate with exactly these effects."""
        known = [c for c in self.tried if set(c.effects) == set(effects)]
        return min(known, key=lambda c: c.bic, default=None)

    def without(self, gone: set[str], candidate: Candidate) -> tuple[Self, Candidate]:
        """A candidate without some of its effects: the best tried fit, else a new fit."""
        rest = tuple(e for e in candidate.effects if e not in gone)
        known = self.best_of(rest)
        if known is not None:
            return self, known
        found = refit(self.engine, rest, _at_null(self.engine, candidate.z, gone))
        return self.trying(found), found

    def on_the_way(self) -> tuple[Candidate, ...]:
        """The fits of all accepted models, the last one first."""
        found = (self.best_of(effects) for effects in reversed(self.accepted))
        return tuple(c for c in found if c is not None)

    def one_less(self, candidate: Candidate) -> Candidate:
        """The best tried fit with one effect less; the base if there is none."""
        own = set(candidate.effects)
        less = [
            c
            for c in self.tried
            if not c.failed and set(c.effects) < own and len(c.effects) == len(own) - 1
        ]
        return min(less, key=lambda c: c.bic, default=self.base)


def search(
    engine: Engine,
    start: np.ndarray,
    scales: RecordScales,
    *,
    most: int,
    progress: Callable[[str], None],
) -> Search:
    """Find the effects that the base model lacks. `start` has the starting parameters of the base,
    as a parameter vector of the model with all effects.
    """
    progress("base fit of the train block")
    engine = seek_parts(engine, start)
    engine, base = learn_noise(engine, refit(engine, (), start, exact=True))
    now = Search(engine, base, base, (base,), ((),))
    while len(now.final.effects) < most and not base.failed:
        begun = now.final
        now = _forward(now, scales, progress)
        if now.final is begun:
            break
        now = _exact(now)
    progress("what can be told apart")
    forward = now.final
    now = _compared(now, scales)
    while True:
        now = _without_needless(now)
        begun = now.final
        now = _swapped(now, scales, progress)
        if now.final is begun:
            break
        now = _compared(now, scales)  # a right effect makes its substitutes needless
    if now.final is not forward:
        now = _exact(now)
        now = _compared(now.taking(now.final), scales)
    return _with_rivals_asked(now, scales)


def _forward(now: Search, scales: RecordScales, progress: Callable[[str], None]) -> Search:
    """The search with one more effect, if there is one that no gate refuses.

    The most promising effects are refitted, and those that turn the base into another law, for
    which first order is unreliable. Among candidates within `TIE` of the best BIC, the first of the
    catalogue is accepted. If a new effect makes an earlier one undetermined, the earlier one may
    have been its substitute: the new effect is then tried without it.
    """
    engine, current = now.engine, now.final
    missing = engine.addable(current.effects)
    if not missing:
        return now
    progress(f"screening {len(missing)} effects")
    found = screen(engine, current, scales)
    seen = any(one.delta_bic <= 0 for one in found)
    laws = {one.id for one in found if seen and engine.law(one.id, current.z) is not None}
    asked = [
        one
        for k, one in enumerate(found)
        if (k < REFITS and one.delta_bic <= 0)
        or one.id in laws
        or len(now.tried) + k <= 2  # two effects on the base are always fitted
    ]

    def fitted(place: int, one: Screened) -> Candidate:
        effects = (*current.effects, one.id)
        progress(f"refitting with {', '.join(effects)} ({place + 1} of {len(asked)})")
        return refit_safely(engine, effects, one, current)

    now, better = now._replace(screened=(*now.screened, tuple(found))), []
    for one, candidate in zip(asked, engine.each(fitted, range(len(asked)), asked), strict=True):
        trial = Trial(engine, scales, current, candidate, now.on_the_way())
        why = refusal_of(trial)
        now = now.trying(candidate._replace(rejection=why))
        if why is not None and why.code is Fault.NOT_FIXED:
            now, other = _without_loose(now, candidate, why.parameters, one.id)
            why = why if other is None else refusal_of(trial._replace(candidate=other))
            candidate = candidate if other is None else other
        if why is None:
            better.append(candidate)
    if not better:
        return now
    least = min(c.bic for c in better)
    tied = [c for c in better if c.bic - least < TIE]
    order = [e.id for e in engine.model.effects]
    return now.taking(min(tied, key=lambda c: order.index(c.effects[-1])))


def _without_loose(
    now: Search, candidate: Candidate, loose: Sequence[str], kept: str
) -> tuple[Search, Candidate | None]:
    """The candidate refitted without the effects whose parameters are `loose`; None if `kept` is
    one of them, or if that fit is impossible or failed."""
    gone = {name.split(".")[0] for name in loose}
    if kept in gone:
        return now, None
    now, found = now.without(gone, candidate)
    return now, found if found.physical and not found.failed else None


def _exact(now: Search) -> Search:
    """The search with its model fitted to convergence, also in `tried`.

    BIC contains the validation rows, so a converged fit may lose up to `TIE` by chance. A fit that
    loses more has left its minimum: the search is unchanged.
    """
    rough = now.final
    found = refit(now.engine, rough.effects, rough.z, exact=True)
    if found.failed or not found.physical or found.bic > rough.bic + TIE:
        return now
    same = [(c.effects, c.bic) == (rough.effects, rough.bic) for c in now.tried]
    place = same.index(True)
    tried = (*now.tried[:place], found, *now.tried[place + 1 :])
    return now._replace(final=found, tried=tried)


def _compared(now: Search, scales: RecordScales) -> Search:
    """The search with the alias cosines at its model."""
    ids, cosines = aliases(now.engine, now.final, scales)
    return now._replace(ids=ids, cosines=cosines)


def _at_null(engine: Engine, z: np.ndarray, ids: set[str]) -> np.ndarray:
    """`z` with some effects at their null."""
    z = np.array(z)
    for id in ids:
        z[engine.model.amplitudes(id)] = 0.0
    return z


def refit_safely(
    engine: Engine, effects: tuple[str, ...], one: Screened, current: Candidate
) -> Candidate:
    """Refit from the first-order start. If the first-order start fails, start from smaller and
    smaller amplitudes of the effect. The last start is the fit of the law that the effect turns the
    base into (`AbstractEffect.law`).

    `current` is a fit without the effect. If two sensitivities are nearly parallel, first-order
    amplitudes are opposite and a hundred times too large. An example is a second state with the
    slip length of the first state. A refit also counts as failed if it is less likely on the train
    rows than `current`. With the effect at its null, a refit would be as likely as the fit
    `current`. A good fit that predicts the validation rows badly has not failed: a start nearer to
    the null ends at the same parameters.
    """
    own = engine.model.columns((one.id,))

    def found(candidate: Candidate) -> bool:
        less = float(current.noise.log_likelihood) - float(candidate.noise.log_likelihood)
        return not candidate.failed and 2 * less < LOST_LIKELIHOOD

    best = refit(engine, effects, one.z)
    if one.other is not None:
        best = min(best, refit(engine, effects, one.other), key=lambda c: (c.failed, c.bic))
    for part in PARTS:
        if found(best):
            break
        start = np.array(current.z)
        start[own] = one.z[own]
        start[engine.model.amplitudes(one.id)] *= part
        best = min(best, refit(engine, effects, start), key=lambda c: (c.failed, c.bic))
    law = engine.law(one.id, current.z)
    if law is not None and not (found(best) and best.physical):
        start = refit(engine, current.effects, law).z
        again = refit(engine, effects, start)
        best = min(best, again, key=lambda c: (c.failed, not c.physical, c.bic))
    return best


def _without_needless(now: Search) -> Search:
    """Drop effects one after another while this lowers BIC."""
    for id in now.final.effects if len(now.final.effects) > 1 else ():
        now, fewer = now.without({id}, now.final)
        if not fewer.failed and fewer.physical and fewer.bic < now.final.bic:
            return _without_needless(now._replace(final=fewer))
    return now


def _swapped(now: Search, scales: RecordScales, progress: Callable[[str], None]) -> Search:
    """The best of this model and of those with one effect replaced by an alias.

    If a better effect makes others of the model undetermined, these may have been its substitutes:
    it is then tried without them. An alias whose fits all failed starts from the other effects.
    """
    engine, current, asked = now.engine, now.final, []
    for id in current.effects:
        for k in np.flatnonzero(now.cosines[now.ids.index(id)] > ALIAS):
            other = now.ids[k]
            effects = tuple(other if e == id else e for e in current.effects)
            known = any(set(c.effects) == set(effects) and not c.failed for c in now.tried)
            if not known and len(set(effects)) == len(effects) and engine.apart(effects):
                asked.append((id, other, effects))

    def fitted(one: tuple[str, str, tuple[str, ...]]) -> Candidate:
        id, other, effects = one
        progress("refitting with " + ", ".join(effects))
        start = _at_null(engine, current.z, {id})
        seen = next(s for found in now.screened for s in found if s.id == other)
        columns = engine.model.columns((other,))
        start[columns] = seen.z[columns]
        without = now.best_of([e for e in current.effects if e != id])
        if without is None or without.failed:
            return refit(engine, effects, start)
        return refit_safely(engine, effects, seen._replace(z=start, other=None), without)

    best = current
    for (_, other, _), candidate in zip(asked, engine.each(fitted, asked), strict=True):
        trial = Trial(engine, scales, best, candidate, (now.one_less(candidate),))
        able = candidate.physical and not candidate.failed
        near = able and trial.gain > -ACCEPT  # at least a rival
        why = refusal_of(trial, IN_PLACE if trial.gain > TIE else IN_PLACE[1:]) if near else None
        now = now.trying(candidate._replace(rejection=why))
        if why is not None and why.code is Fault.NOT_FIXED and trial.gain > TIE:
            now, fewer = _without_loose(now, candidate, why.parameters, other)
            if fewer is not None:
                candidate, trial = fewer, trial._replace(candidate=fewer)
                why = refusal_of(trial, IN_PLACE)
        if able and why is None and trial.gain > TIE:
            best = candidate
    return now if best is current else now._replace(final=best)


def _with_rivals_asked(now: Search, scales: RecordScales) -> Search:
    """The search with refusals of fits about as good as the model that take over parameters of the
    base: these are no rivals."""

    def asked(c: Candidate) -> Candidate:
        if not c.effects or c.failed or not c.physical:
            return c
        trial = Trial(now.engine, scales, now.final, c, (now.one_less(c),))
        near = -ACCEPT < trial.gain < 0
        why = takes_nothing(trial) if near else None
        return c if why is None else c._replace(rejection=why)

    return now._replace(tried=tuple(asked(c) for c in now.tried))


def rival_fits(search: Search, id: str) -> dict[str, Candidate]:
    """The best fit of each effect that fits about as well in place of effect `id`; best first."""
    kept = {e for e in search.final.effects if e != id}
    found: dict[str, Candidate] = {}
    for c in sorted(search.tried, key=lambda c: c.bic):
        new = set(c.effects) - kept
        sound = c.physical and not c.failed and not takes(c.rejection)
        close = sound and c.bic - search.final.bic < ACCEPT
        if close and kept < set(c.effects) and len(new) == 1 and id not in new:
            found.setdefault(new.pop(), c)
    return found


def near_fits(search: Search) -> list[Candidate]:
    """The best fit of every other tried set of effects. Sets that a gate refused are left out,
    unless the reason was weak evidence or undetermined parameters. The true model may be among the
    near fits, so standard errors include the differences between near fits.
    """
    found: dict[frozenset[str], Candidate] = {}
    for c in sorted(search.tried, key=lambda c: c.bic):
        why = None if c.rejection is None else c.rejection.code
        if c.physical and not c.failed and why in (None, Fault.WEAK, Fault.NOT_FIXED):
            found.setdefault(frozenset(c.effects), c)
    return [c for effects, c in found.items() if effects != frozenset(search.final.effects)]
