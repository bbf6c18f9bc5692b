"""The verdict of a loop in words."""

from collections.abc import Sequence
from typing import NamedTuple

from ..findings import Finding
from .family import CurveFamily, listed
from .findings import WITHHELD, LoopCode, words_of
from .residual_tests import p_text
from .search import Search
from .thresholds import ACCEPT, FAR, SIGNIFICANT
from .unfixed import Unfixed, unfixed, words_of_unfixed


class Told(NamedTuple):
    """The numbers in the sentence of a verdict."""

    before: float
    after: float
    """Errors of the base and of the model on the report block, in sigma."""
    most: float
    """The error of the report block that noise alone explains, in sigma."""
    p_value: float
    """The smallest p-value of the residual tests."""

    @property
    def helped(self) -> bool:
        """Whether the test error falls, by the two digits that are shown."""
        return round(self.after, 2) < round(self.before, 2)

    def change(self) -> str:
        """The test error before and after, said as a fall only where it is one."""
        before, after = f"{self.before:.2f}", f"{self.after:.2f}"
        if self.helped:
            return f"test error {before} -> {after} sigma"
        return f"test error {after} sigma with, {before} without"


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
        helped, closer = named and told.helped, _closer(search)
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


def withheld_sentence(why: Finding) -> str:
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
            return f"No verdict: {words_of(why).removesuffix(WITHHELD)}."


def moved_sentence(why: Finding, search: Search, told: Told) -> str:
    """That effects fit, but move a headline parameter and predict no better."""
    named = listed(search.final.effects)
    return (
        f"{named} {_verb(search, 'fits', 'fit')} the train block, but {words_of(why)}, and"
        f" the test block is predicted no better ({told.change()}): {named}"
        f" {_verb(search, 'is', 'are')} not confirmed, and this record leaves both open."
    )


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


def _in_vain(search: Search, named: str, told: Told) -> str:
    """A sentence on effects that were added but explain too little."""
    if not named:
        return ""
    one = len(search.final.effects) == 1
    if told.helped:
        verb, but = ("helps", "does") if one else ("help", "do")
        return f"{named} {verb} ({told.change()}) but {but} not explain all of it."
    if told.after <= told.most:
        verb = "changes" if one else "change"
        return f"{named} {verb} little: {told.change()}."
    verb, then = ("fits", "predicts") if one else ("fit", "predict")
    return f"{named} {verb} the train block but {then} the others no better ({told.change()})."
