"""The verdict of a search and the residual of its model, from one table, with the reasons."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..described import said
from ..effects import separators
from ..findings import Finding, Severity
from .family import CurveFamily
from .findings import LoopCode, left_over
from .learn import Floor
from .refusal import Move
from .result import LocationProfile, Unfixed, unfixed
from .search import Search, rival_fits
from .split import NAMES
from .thresholds import ACCEPT, ALIAS, EDGE, SIGNIFICANT, TIE


class Facts(NamedTuple):
    """The facts about a search that determine its verdict."""

    named: bool = False
    """The search accepted effects."""
    left: bool = False
    """The residual is more than noise: structure, or a large error of a block."""
    open: bool = False
    """Something else explains as much: a rival, another curve, an alias without a good fit."""
    seen: bool = False
    """The train error of the base exceeds that of noise (`Floor.most`)."""
    hinted: bool = False
    """An effect lowers BIC by less than `ACCEPT` but more than `TIE`."""
    withheld: bool = False
    """No claim may be made, see `withheld_by`."""


TABLE: tuple[tuple[Callable[[Facts], bool], str], ...] = (
    (lambda so: so.withheld, "ambiguous"),
    (lambda so: so.named and so.left, "outside_catalogue"),
    (lambda so: so.named and so.open, "ambiguous"),
    (lambda so: so.named, "effects"),
    (lambda so: not so.left, "no_missing_effect"),
    (lambda so: so.seen and not so.hinted, "outside_catalogue"),
    (lambda so: True, "too_weak"),
)
"""Conditions in order; the first one that holds gives the verdict."""


def verdict_of(facts: Facts) -> str:
    """The verdict according to `TABLE`."""
    return next(verdict for condition, verdict in TABLE if condition(facts))


class Told(NamedTuple):
    """Values for the sentence of a verdict; errors are those of the test block in sigma."""

    effects: tuple[str, ...]
    before: float
    after: float
    most: float
    """The error that noise alone explains."""
    p_value: float
    """The smallest p-value of the residual tests."""
    gain: float
    """Reduction of BIC from the base to the model."""
    rivals: Sequence[tuple[str, str]] = ()
    """Pairs of an effect found and its possible replacement."""
    closer: Sequence[Unfixed] = ()
    location: tuple[LocationProfile, ...] = ()
    velocities: Sequence[float] | np.ndarray = ()
    """Velocities of the record, in order."""

    @property
    def helped(self) -> bool:
        """Whether added effects lower the test error, with errors rounded to two decimals."""
        return round(self.after, 2) < round(self.before, 2)


class Conclusion(NamedTuple):
    """The fields of a `Loop` result that follow from the verdict."""

    verdict: str
    told: Told | None
    """None if the verdict is withheld."""
    findings: tuple[Finding, ...]
    """Evidence against a stronger verdict."""
    alias_groups: tuple[tuple[str, ...], ...]
    separations: dict[str, tuple[str, ...]]
    families: tuple[CurveFamily, ...] = ()
    sigma_held_out: float = float("nan")
    held_out_threshold: float = float("nan")

    @property
    def sentence(self) -> str:
        """The verdict as text."""
        return said("verdict_text.sentence", self)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons against a stronger verdict, a line each."""
        return said("verdict_text.reasons", self)


def withheld_by(search: Search, edge: float | None) -> Finding | None:
    """The reason why no claim about missing effects may be made. Either the base fit runs away, or
    `edge` is so near 1 that a small misfit of the law looks like a large effect. `edge` is K/K_cr
    of the base fit, the ratio of loading to critical stiffness.
    """
    train = search.engine.blocks.train
    if edge is not None and (search.base.failed or edge < EDGE):
        return Finding(LoopCode.EDGE, Severity.WITHHELD, {"ratio": edge}, train)
    if search.base.failed:
        return Finding(LoopCode.RUNS_AWAY, Severity.WITHHELD, {}, train)
    return None


def facts_of(
    search: Search, against: Sequence[Finding], doubts: Sequence[object], floor: Floor
) -> Facts:
    """The facts of a search. `against` holds findings of structure in the residual of the final
    model, `doubts` other models that explain the record as well.
    """
    base = search.base
    gains = [base.bic - c.bic for c in search.tried if c.effects and not c.failed]
    return Facts(
        named=bool(search.final.effects),
        left=bool(against),
        open=bool(doubts),
        seen=base.rms["train"] / floor.sigma > floor.most["train"],
        hinted=bool(gains) and TIE < max(gains) <= ACCEPT,
    )


def conclude(
    search: Search,
    floor: Floor,
    tests: dict[str, float],
    *,
    edge: float | None,
    location: tuple[LocationProfile, ...] = (),
    velocities: Sequence[float] | np.ndarray = (),
    curve: CurveFamily | None = None,
    moved: Sequence[Move] = (),
    withheld: Finding | None = None,
) -> Conclusion:
    """The conclusion of a search. `edge`: K/K_cr of the base fit. `location`: profiles of missing
    friction. `curve`: other shapes of the steady curve. `moved`: headline parameters that move by
    many standard errors. `withheld`: the reason for making no claim.
    """
    engine, final = search.engine, search.final
    why = withheld or withheld_by(search, edge)
    if why is not None:
        verdict = verdict_of(Facts(withheld=True))
        return Conclusion(verdict, None, (why,), (), {}, sigma_held_out=floor.later)
    errors = [(b, final.rms[b] / floor.level(b), floor.most[b]) for b in reversed(NAMES)]
    against = left_over(tests, errors, engine.blocks, SIGNIFICANT)
    unfitted, train = _unfitted(search), engine.blocks.train
    rivals = sorted({*_rivals(search), *unfitted})
    families = () if curve is None or not curve.untold else (curve,)
    start, gain = search.base.bic, search.base.bic - final.bic
    possible = ((c, start - c.bic) for c in search.tried if c.physical and not c.failed)
    told = Told(
        final.effects,
        search.base.rms["report"] / floor.later,
        final.rms["report"] / floor.later,
        floor.most["report"],
        min(tests.values(), default=1.0),
        gain,
        rivals,
        unfixed(possible, gain),
        location,
        velocities,
    )
    doubts = [
        Finding(LoopCode.UNFITTED, Severity.CAUTION, {"effect": id, "rival": other}, train)
        for id, other in unfitted
    ]
    if moved and final.effects and not told.helped:
        rows = engine.blocks.report
        doubts.append(Finding(LoopCode.MOVED, Severity.CAUTION, {"moves": moved}, rows))
    verdict = verdict_of(facts_of(search, against, [*rivals, *families, *doubts], floor))
    if verdict != "ambiguous":
        doubts, families = [], ()
    groups = _groups(search)
    known = {effect.id: separators(effect) for effect in engine.model.effects}
    return Conclusion(
        verdict,
        told,
        (*against, *doubts),
        groups,
        {id: known[id] for group in groups for id in group},
        families,
        sigma_held_out=floor.later,
        held_out_threshold=floor.most["report"],
    )


def _groups(search: Search) -> tuple[tuple[str, ...], ...]:
    """For every effect found: its id, and the ids of effects that the record does not distinguish.

    These are its aliases, by decreasing cosine, and the effects whose refit in its place has a BIC
    within `ACCEPT`.
    """
    ids, found = search.ids, []
    for id in search.final.effects:
        alike = search.cosines[ids.index(id)]
        order = sorted(range(len(ids)), key=lambda j: -alike[j])
        like = [ids[j] for j in order if ids[j] != id and alike[j] > ALIAS]
        as_good = [e for e in rival_fits(search, id) if e not in like]
        found.append((id, *like, *as_good))
    return tuple(found)


def _rivals(search: Search) -> list[tuple[str, str]]:
    """Pairs (found, rival): refits with the rival in place of the effect fit about as well."""
    return sorted({(id, other) for id in search.final.effects for other in rival_fits(search, id)})


def _unfitted(search: Search) -> list[tuple[str, str]]:
    """Pairs (found, alias): no fit with the alias in place of the effect converged. This is no
    evidence against the alias."""
    failed: dict[frozenset[str], bool] = {}
    for c in search.tried:
        failed[frozenset(c.effects)] = c.failed and failed.get(frozenset(c.effects), True)
    final, ids = frozenset(search.final.effects), list(search.ids)
    return [
        (id, other)
        for id in search.final.effects
        for other in ids
        if other not in final
        and search.cosines[ids.index(id), ids.index(other)] > ALIAS
        and failed.get(final - {id} | {other}, False)
    ]
