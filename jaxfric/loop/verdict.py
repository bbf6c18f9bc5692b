"""Turns a search into a verdict and its sentences."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..effects import effect_of
from ..findings import Finding, Severity
from ..fitting.noise import Noise, sandwich
from ..fitting.noise_search import Found
from ..fitting.padding import WIDE, padded_columns
from ..fitting.uncertainty import inverse_root
from .engine import Engine
from .evaluate import Rows
from .family import CurveFamily, listed
from .findings import BLOCK_NAMES, WITHHELD, LoopCode, left_over, words_of
from .location import Left
from .refit import Candidate
from .refusal import Move
from .residual_tests import p_text, structure
from .rivals import rival_fits
from .screen import orthonormal
from .search import Search
from .thresholds import ACCEPT, ALIAS, FAR, HELD_OUT, SIGNIFICANT
from .unfixed import Unfixed, unfixed, words_of_unfixed

_TRAIN = 1.04
_QUESTIONS = 12
"""About as many as are asked of a residual (`structure.asked`)."""
_MOST_PREDICTED = 0.1
"""Largest mean square of the prediction's own error, over sigma^2, that excuses a misfit."""
_HINT = 2.0
_EDGE = 1.1


class Floor(NamedTuple):
    """The noise with everything smooth taken out."""

    found: Found
    sigma: float
    """Standard deviation on the train block, in the unit of friction."""
    later: float
    """Standard deviation on the held-out rows: noise may differ from step to step."""
    most: Mapping[str, float]
    """Largest rms of every block, over sigma, that noise alone explains."""

    def level(self, block: str) -> float:
        """Standard deviation on a block, in the unit of friction."""
        return self.sigma if block == "train" else self.later


class Told(NamedTuple):
    """The numbers in the sentence of a verdict."""

    before: float
    after: float
    """Errors of the base and of the model on the report block, in sigma."""
    most: float
    """The error of the report block that noise alone explains, in sigma."""
    p_value: float
    """The smallest p-value of the residual tests."""

    def change(self) -> str:
        """The test error before and after, said as a fall only where it is one."""
        before, after = f"{self.before:.2f}", f"{self.after:.2f}"
        if float(after) < float(before):
            return f"test error {before} -> {after} sigma"
        return f"test error {after} sigma with, {before} without"


class Conclusion(NamedTuple):
    """The fields of `Loop` that the verdict fills."""

    verdict: str
    sentence: str
    findings: tuple[Finding, ...]
    """What speaks against more."""
    alias_groups: tuple[tuple[str, ...], ...]
    separations: dict[str, str]
    families: tuple[CurveFamily, ...] = ()
    sigma_held_out: float = float("nan")
    most_held_out: float = float("nan")

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why not more is said, a line each."""
        return tuple(words_of(one) for one in self.findings if one.code is not LoopCode.MOVED)


def noise_floor(engine: Engine, current: Candidate) -> Floor:
    """Noise with base, effects, and bumps along the record and along each step taken out.

    Its parts are found anew: structure that the base left may have looked like a part of it.
    """
    rows = engine.evaluate(current.z, engine.free(current.effects))
    columns = np.concatenate([rows.jacobian, engine.smooth], axis=1)
    train = columns * engine.weight[:, None]
    used = np.linalg.norm(train, axis=0) > 0
    found = engine.noise_afresh(rows.residual * engine.weight, train[:, used])
    noise = found.noise
    held = engine.blocks.select | engine.blocks.report
    size = float(engine.problem.noise_scale)
    # sigma comes from the train block and has its error
    chance = engine.rms_error(engine.blocks.train, noise)

    def most(block: np.ndarray) -> float:
        both = float(np.hypot(engine.rms_error(block, noise), chance))
        errors = _prediction_errors(engine, rows, block, noise)
        errors = errors * min(1.0, _MOST_PREDICTED / max(float(errors.sum()), 1e-300))
        return max(HELD_OUT, largest_rms(both, errors))

    return Floor(
        found,
        size * _level(engine, rows.residual, columns, engine.blocks.train, noise),
        size * _level(engine, rows.residual, columns, held, noise),
        {
            "train": max(_TRAIN, largest_rms(chance, np.zeros(0))),
            "select": most(engine.blocks.select),
            "report": most(engine.blocks.report),
        },
    )


def _level(
    engine: Engine, residual: np.ndarray, columns: np.ndarray, rows: np.ndarray, noise: Noise
) -> float:
    """rms of the noise on some rows (a mask): from the residual without the smooth columns, and
    corrected for the noise that these columns take away."""
    mask = np.zeros(len(residual))
    mask[: len(rows)] = rows
    columns = columns * mask[:, None]
    smooth = orthonormal(columns[:, np.linalg.norm(columns, axis=0) > 0])
    left = residual * mask
    left = left - smooth @ (smooth.T @ left)
    alone = noise._replace(sigma=np.ones(()))
    taken = np.asarray(sandwich(engine.problem.clock, padded_columns(smooth, size=WIDE), alone))
    whole = float(np.sum((mask * np.asarray(noise.scale)) ** 2))
    share = whole - float(np.trace(taken))
    return float(np.sqrt(left @ left / share * whole / mask.sum()))


def largest_rms(chance: float, errors: np.ndarray) -> float:
    """rms over sigma that is exceeded as rarely as one of `_QUESTIONS` may be answered wrongly.

    `chance` is the relative standard error of the rms of noise. `errors` are mean squares over
    sigma^2 that each of several independent errors of the prediction has on average; their sum is
    taken as a multiple of chi-square with the same mean and variance (Satterthwaite 1946,
    doi:10.2307/3002019). The two distances from the mean square are added in quadrature, which is
    exact where one of them is alone.
    """
    from scipy.special import chdtri, ndtri  # scipy.stats takes half a second to import

    rare = SIGNIFICANT / _QUESTIONS
    noise = (1 - float(ndtri(rare)) * chance) ** 2 - 1
    mean = float(errors.sum())
    if mean <= 0:
        return float(np.sqrt(1 + noise))
    unit = float(np.sum(errors**2)) / mean
    beyond = unit * float(chdtri(mean / unit, rare)) - mean
    return float(np.sqrt(1 + mean + np.hypot(noise, beyond)))


def _prediction_errors(engine: Engine, rows: Rows, held: np.ndarray, noise: Noise) -> np.ndarray:
    """Mean squares over sigma^2 that errors of the parameters cause on the held-out rows.

    One for each independent error: squares of the singular values of J R, J of these rows and R R^T
    the covariance of the fit to the train block; the times of steps that only the held-out rows see
    are known as well as the load point shows them.
    """
    white = engine.whiten(rows.jacobian * engine.weight[:, None], noise)
    errors = inverse_root(np.concatenate([white, rows.extra_jacobian]))
    seen = rows.jacobian[: engine.rows][held] @ errors / float(noise.sigma)
    return np.linalg.svd(seen, compute_uv=False) ** 2 / int(held.sum())


def questions(
    engine: Engine, candidate: Candidate, slip: np.ndarray, left: Left, noise: Noise
) -> dict[str, float]:
    """p-values of the residual tests on the train block, and of the structure `left`; `noise` is
    that with everything smooth taken out."""
    train = engine.blocks.train
    residual = np.zeros((len(engine.weight), 1))
    residual[: engine.rows, 0] = candidate.residual
    white = engine.whiten(residual * engine.weight[:, None], noise)[: engine.rows, 0]
    return structure(white[train], engine.blocks.step[train], slip[train], left.chances)


def conclude(
    engine: Engine,
    search: Search,
    floor: Floor,
    tests: dict[str, float],
    *,
    edge: float | None,
    located: str,
    curve: CurveFamily | None = None,
    moved: Sequence[Move] = (),
    withheld: Finding | None = None,
) -> Conclusion:
    """The conclusion. `edge` is K/K_cr of the base fit, `located` a sentence of the location map,
    `curve` the shapes that fit in place of the steady curve that the search found, `moved` the
    headline parameters that move by many of their errors, `withheld` why nothing may be said."""
    final, base, blocks = search.final, search.base, engine.blocks
    groups = _groups(search)
    separations = {id: effect_of_engine(engine, id).separated_by for g in groups for id in g}
    if withheld is not None:
        why = words_of(withheld).removesuffix(WITHHELD)
        return _withheld(f"No verdict: {why}.", withheld, floor)
    if base.failed and edge is None:
        text = (
            "No verdict: where its fit ended, the base model cannot be simulated, so nothing can be"
            " said of what it lacks. Check the units and signs of the columns, and of a slider its"
            " stiffness."
        )
        away = Finding(LoopCode.RUNS_AWAY, Severity.WITHHELD, {}, blocks.train)
        return _withheld(text, away, floor)
    if edge is not None and (base.failed or edge < _EDGE):
        text = (
            f"No verdict: the base fit sits at the edge of stability (K/K_cr is {edge:.2f}), where"
            " a small misfit of the law looks like a large effect; use a stiffer machine, or check"
            " --stiffness."
        )
        near = Finding(LoopCode.EDGE, Severity.WITHHELD, {"ratio": edge}, blocks.train)
        return _withheld(text, near, floor)
    errors = [(b, final.rms[b] / floor.level(b), floor.most[b]) for b in BLOCK_NAMES]
    against = left_over(tests, errors, blocks, SIGNIFICANT)
    unfitted = _unfitted(search)
    rivals = sorted({*_rivals(search), *unfitted})
    families = () if curve is None or not curve.untold else (curve,)
    told = Told(
        search.base.rms["report"] / floor.later,
        search.final.rms["report"] / floor.later,
        floor.most["report"],
        min(tests.values(), default=1.0),
    )
    doubts = [
        Finding(LoopCode.UNFITTED, Severity.CAUTION, {"effect": id, "rival": other}, blocks.train)
        for id, other in unfitted
    ]
    if moved and final.effects and not _helped(told):
        doubts.append(Finding(LoopCode.MOVED, Severity.CAUTION, {"moves": moved}, blocks.report))
    verdict = _verdict(search, against, [*rivals, *families, *doubts], floor)
    if verdict != "ambiguous":
        doubts, families = [], ()
    sentence = sentence_of(verdict, search, told, rivals, located, families)
    for one in doubts:
        if one.code is LoopCode.MOVED:
            named = listed(final.effects)
            sentence = (
                f"{named} {_verb(search, 'fits', 'fit')} the train block, but {words_of(one)}, and"
                f" the test block is predicted no better ({told.change()}): {named}"
                f" {_verb(search, 'is', 'are')} not confirmed, and this record leaves both open."
            )
    return Conclusion(
        verdict,
        sentence,
        (*against, *doubts),
        groups,
        separations,
        families,
        sigma_held_out=floor.later,
        most_held_out=floor.most["report"],
    )


def _withheld(sentence: str, why: Finding, floor: Floor) -> Conclusion:
    """A conclusion without a verdict, with the reason why."""
    return Conclusion("ambiguous", sentence, (why,), (), {}, sigma_held_out=floor.later)


def effect_of_engine(engine: Engine, id: str):
    """The class of an effect, of the catalogue or the user's own."""
    own = [e for e in engine.model.effects if e.id == id]
    return own[0] if own else effect_of(id)


def _verdict(
    search: Search,
    against: Sequence[Finding],
    doubts: Sequence[object],
    floor: Floor,
) -> str:
    final, base = search.final, search.base
    if final.effects:
        if against:
            return "outside_catalogue"
        return "ambiguous" if doubts else "effects"
    if not against:
        return "no_missing_effect"
    gains = [base.bic - c.bic for c in search.tried if c.effects and not c.failed]
    strong = base.rms["train"] / floor.sigma > HELD_OUT
    weak = gains and _HINT < max(gains) <= ACCEPT
    return "outside_catalogue" if strong and not weak else "too_weak"


def _groups(search: Search) -> tuple[tuple[str, ...], ...]:
    """For every effect found: its id, and those that it cannot be told from.

    Those are its aliases, most alike first, and the effects whose refit in its place is no more
    than `ACCEPT` of BIC worse.
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
    """Pairs (found, rival): refits with another effect in place of one that fit about as well."""
    return sorted({(id, other) for id in search.final.effects for other in rival_fits(search, id)})


def _unfitted(search: Search) -> list[tuple[str, str]]:
    """Pairs (found, alias): the alias was tried in place of the effect, and no fit of it converged.

    That is no evidence against it.
    """
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


def sentence_of(
    verdict: str,
    search: Search,
    told: Told,
    rivals: Sequence[tuple[str, str]],
    located: str,
    families: Sequence[CurveFamily] = (),
) -> str:
    """The verdict in words."""
    named = listed(search.final.effects)
    before = f"test error {told.before:.2f} sigma"
    if verdict == "no_missing_effect":
        what = "This record shows nothing that is missing"
        return f"{what}: the base model fits to the noise ({before})."
    if verdict == "too_weak" and told.before > FAR * told.most:
        return (
            f"The base model misses rows that it was not fitted to ({before}; noise alone gives up"
            f" to {told.most:.2f}), and no effect that explains it is supported by more than"
            f" {ACCEPT:g} of BIC: what is fitted of this record may not fix the base model."
        )
    if verdict == "too_weak":
        what = "Something may be missing, but too weakly to be named"
        if told.p_value < SIGNIFICANT:
            what = f"Something is left ({p_text(told.p_value)}), but too little to be named"
        return f"{what}: no effect is supported by more than {ACCEPT:g} of BIC ({before})."
    if verdict == "outside_catalogue":
        helped, closer = named and _helped(told), _closer(search)
        what = "Not all that is missing is" if helped else "What is missing is not"
        changes = ", or not the same along all of the record" if named and not helped else ""
        what += " named." if closer else f" in the catalogue{changes}."
        if told.after <= told.most:
            which = " that this record fixes" if closer else ""
            what = (
                "What is left is as small as the noise"
                f" (test error {told.after:.2f} sigma), but has structure that no effect of the"
                f" catalogue{which} explains."
            )
        parts = (what, words_of_unfixed(closer, named), _in_vain(search, named, told), located)
        return " ".join(part for part in parts if part)
    gain = search.base.bic - search.final.bic
    pairs = "; ".join(f"{a} or {b}" for a, b in rivals)
    if families:
        (curve,) = families
        sure = [id for id in search.final.effects if id not in curve.effects]
        what = listed([*sure, curve.name()])
        alike = f", or what looks like it ({pairs})" if pairs else ""
        wanted = f" {_upper(curve.wanted())} would tell." if curve.decided_by else ""
        return f"The model lacks {what}{alike}: {told.change()}, BIC {gain:.0f} lower.{wanted}"
    if rivals:
        return f"The model lacks {named}, or what looks like it ({pairs}): {told.change()}."
    return f"The model lacks {named}: {told.change()}, BIC {gain:.0f} lower."


def _closer(search: Search) -> list[Unfixed]:
    """Models that would explain more than the one that was taken, but are not fixed."""
    start = search.base.bic
    possible = [c for c in search.tried if c.physical and not c.failed]
    models = ((c, start - c.bic) for c in possible)
    return unfixed(models, start - search.final.bic)


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _verb(search: Search, one: str, many: str) -> str:
    """The verb that agrees with the number of effects found."""
    return one if len(search.final.effects) == 1 else many


def _helped(told: Told) -> bool:
    """Whether the test error falls, as it is written."""
    return float(f"{told.after:.2f}") < float(f"{told.before:.2f}")


def _in_vain(search: Search, named: str, told: Told) -> str:
    """A sentence on effects that were added but explain too little."""
    if not named:
        return ""
    one = len(search.final.effects) == 1
    if _helped(told):
        verb, but = ("helps", "does") if one else ("help", "do")
        return f"{named} {verb} ({told.change()}) but {but} not explain all of it."
    if told.after <= told.most:
        verb = "changes" if one else "change"
        return f"{named} {verb} little: {told.change()}."
    verb, then = ("fits", "predicts") if one else ("fit", "predict")
    return f"{named} {verb} the train block but {then} the others no better ({told.change()})."
