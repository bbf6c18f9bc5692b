"""Templates of all sentences on results, one template for each code.

Results hold codes and values. `say` makes sentences from them; no code parses a sentence.
"""

from collections.abc import Iterable, Mapping
from typing import Protocol

from ..effects import RunChange
from ..units import prefixed

TEMPLATES: Mapping[str, str] = {
    # the sentence of a verdict
    "verdict.no_missing_effect": "Nothing is missing: the base model fits this record to its noise"
    " (test error {before:.2f} sigma).",
    "verdict.effects": "The model lacks {what}{alike}: {change}, BIC {gain:.0f} lower.",
    "verdict.base_misses": "The base model misses rows that it was not fitted to (test error"
    " {before:.2f} sigma; noise alone gives up to {most:.2f}), and no effect that explains this"
    " lowers the BIC by more than {accept:g}. The fitted rows may not determine the base model.",
    "verdict.too_weak": "An effect may be missing, but the evidence is too weak to name it: none"
    " lowers the BIC by more than {accept:g} (test error {before:.2f} sigma).",
    "verdict.too_weak_but_left": "Structure remains in the residual ({p}), but no effect lowers the"
    " BIC by more than {accept:g} (test error {before:.2f} sigma).",
    "verdict.outside": "The missing effect is not in the catalogue, or it changes along the"
    " record.",
    "verdict.in_part": "Only a part of what is missing can be named.",
    "verdict.not_named": "The missing effect cannot be named.",
    "verdict.small": "The residual is as small as the noise (test error {after:.2f} sigma), but it"
    " has structure. No effect whose parameters this record determines explains it.",
    "verdict.moved": "With {named} the train block is fitted better, but {moves}, and the test"
    " block is predicted no better ({change}). This is not confirmed: the record leaves both"
    " possible.",
    "verdict.helps": "With {named} the prediction is better ({change}).",
    "verdict.in_vain": "With {named} the train block is fitted better, but the other blocks are"
    " predicted no better ({change}).",
    "verdict.would": "{names} would lower the BIC by another {lower:.0f}, but is refused: {why}.",
    "verdict.withheld": "No verdict: {why}.",
    "verdict.base_runs_away": "No verdict: the base model cannot be simulated at the parameters"
    " where its fit ended. Check the units and signs of the columns, and the stiffness of a"
    " slider.",
    "verdict.edge_of_stability": "No verdict: the base fit is at the edge of stability (K/K_cr is"
    " {ratio:.2f}), where a small misfit of the law looks like a large effect. Use a stiffer"
    " machine, or check {stiffness}.",
    # a finding by its code
    "finding.structure_left": "structure remains in the residual: {what}",
    "finding.error_left": "the {block} error is {error:.3f} sigma; noise alone gives up to"
    " {most:.2f}",
    "finding.rival_not_fitted": "{rival} could not be fitted in place of {effect}, so it is not"
    " ruled out",
    "finding.headline_moved": "{name} moves from {before} to {after}",
    "finding.other_joints_move": "other joints move in this record (columns {columns}). The model"
    " has neither their weight nor their inertia, and an effect may stand for them: hold them"
    " still",
    "finding.effect": "{effect}",
    "finding.effect_or_alike": "{effect}, or what looks like it",
    "finding.friction": "friction {direction}",
    "finding.stability_free": "friction grows with speed",
    "finding.stability": "friction falls with speed",
    "finding.edge_of_stability": "K/K_cr is {ratio:.2f}",
    "finding.base_runs_away": "the fit runs away",
    "finding.force_follows_position": "the force follows the position{late} alone, without inertia"
    " and friction: feedback, as of a controller that carries a weight",
    "finding.never_slid": "the axis never slid: its force follows its position, with a hysteresis"
    " of at most {hysteresis:.2%}, which comes back over the whole stroke as in presliding. The"
    " stiffness is {stiffness:.4g} ± {std:.2g} {unit}. Such a record does not show Coulomb and"
    " viscous friction, inertia or stability: move the axis farther",
    # why a model is not accepted, by the code of its fault
    "refusal.did_not_converge": "did not converge",
    "refusal.impossible_parameters": "impossible parameters",
    "refusal.too_little_evidence": "too little evidence",
    "refusal.not_fixed": "{parameters} not determined",
    "refusal.takes_of_the_base": "takes over {moves}",
    # which variable the residual follows
    "location.best_p": "The residual of the base model follows {variable} best ({p}).",
    "location.would": "{subjects} alone would explain {share} of the residual of the base model.",
    "location.alike": "{variables} grow together in this record, which cannot distinguish them."
    " Steps at other velocities or a hold would separate them.",
    "location.only_noise": "The residual of the base model follows no variable more than noise"
    " does.",
    "location.no_shares": "This residual is too small compared with the noise to be divided into"
    " shares.",
    "location.nothing": "The residual of the base model is consistent with noise: there is nothing"
    " to locate.",
    "location.unexplained": "No variable explains the residual of the base model.",
    "location.bars": "Each bar below the first shows what its variable explains beyond the"
    " variables above.",
    # a next step: another experiment, gains, feedforward, or a test
    "next.gains": "Find the smallest gains that keep the sliding steady with this model (replace"
    " the example values by those of your machine):",
    "next.feedforward": "Compensate the friction in the controller (formula, C function, table):",
    "next.predict": "Test the model on a record that it was not fitted to:",
    "next.run": "Make this run: {run}. It can distinguish {told}.{lacking}",
    "next.family": "This record does not determine the shape of {effects}. A run that determines it"
    " has {where}.",
    "next.decides": "This record cannot distinguish {effect} from {others}. Distinguish them by a"
    " new run: {changes}.",
    "next.ask": "Check a run in advance: does it distinguish {effect} from {other}, and if not,"
    " which change of the run would?",
    "next.size": "Plan the next run, with the velocities of this record or others: how large must"
    " {effect} be to be identified?",
    "next.look": "See which variable the residual follows (location.png, in loop.html 'Where the"
    " structure sits'), and record the run again: structure that repeats comes from friction or the"
    " machine.",
    "next.own_effect": "Write an effect of your own, a class with an equation: `own=[...]` of"
    " close_loop in Python tries it beside the others.",
    "next.longer": "Record longer, with more {part}s or less noise. The effect is then identified,"
    " or it vanishes.",
    # the verdict on a steady friction curve
    "steady.ambiguous": "{untested}.",
    "steady.too_few": "A line each way fits the runs: {known} (rms {before} {unit}). {untested}:"
    " {fewest} runs are needed, {of_each} of each direction.",
    "steady.effects": "The curve lacks {effects}: rms {before} -> {after} {unit}, BIC {gain:.0f}"
    " lower.{rest}",
    "steady.too_weak": "An effect may be missing, but none lowers the BIC by more than {accept:g}"
    " (best {lower:.1f}).",
    "steady.stick_slip": "The others fit Coulomb and viscous friction (rms {before} {unit}); they"
    " do not show where friction falls with speed.{rest}",
    "steady.no_missing_effect": "Nothing is missing in these points: rms {before} {unit}.{rest}",
    # the verdict in a few words
    "headline.no_missing_effect": "No effect is missing",
    "headline.effects": "Missing: {effects}",
    "headline.ambiguous": "An effect is missing, but this record cannot say which",
    "headline.one_of": "Missing: {either} (this record cannot say which)",
    "headline.also_one_of": "Missing: {effects}; also {either} (this record cannot say which)",
    "headline.not_confirmed": "Missing: {effects}, not confirmed",
    "headline.outside_catalogue": "Something is missing that the catalogue does not explain",
    "headline.beyond": "Beyond {effects} something is missing that the catalogue does not explain",
    "headline.outside_catalogue_unfixed": "Something is missing that this record does not"
    " determine",
    "headline.beyond_unfixed": "Beyond {effects} something is missing that this record does not"
    " determine",
    "headline.too_weak": "The evidence is too weak to name an effect",
    "headline.base_misses": "The test rows are missed, and no effect is supported",
    # which effects the record distinguishes from an added effect
    "apart.not_told": "{id}: this record cannot distinguish it from {others}",
    "apart.curve": "{id}: this record does not distinguish it from a steady curve of another shape"
    " ({why}){decides}",
    "apart.told": "{id}: this record distinguishes it from every other effect",
    "apart.in_part": "{id}: this model is not complete, so it may partly stand for another effect",
    "apart.pairs": "pairs that this record cannot distinguish: {pairs}",
}
"""Every template by its code, "TABLE.CODE"; values are fields of `str.format`."""

VARIABLE: Mapping[str, str] = {
    "log_velocity": "velocity",
    "slip_since_step": "the slip since a step",
    "since_reversal": "the distance since a stop",
    "time_since_step": "the time since a step",
    "state": "the state",
    "periodic_in_slip": "a ripple along the path",
    "block_means": "slow changes along the record",
    "step_locked": "the same shape after every change of velocity",
    "none": "not explained",
}
"""A variable of a profile or the structure of a test; another is called by its name."""

CHANGES: Mapping[RunChange, str] = {
    RunChange.DECADES: "three velocities over two decades",
    RunChange.REPEAT: "the first velocity repeated at the end",
    RunChange.UP_AND_DOWN: "up and down steps",
    RunChange.LONG_STEPS: "longer than 3 L2",
    RunChange.SLOW_DWELL: "a slow dwell",
    RunChange.DWELL: "a dwell",
    RunChange.SLIP_CHANNEL: "a slip channel",
    RunChange.LOAD_POINT_CHANNEL: "a load-point encoder channel",
}
"""Changes of a run that tell effects apart."""


def say(code: str, **values: object) -> str:
    """Fill the template of a code with values."""
    return TEMPLATES[code].format(**values)


class HasUnits(Protocol):
    """A result whose quantities have the units of a line or of a rotation."""

    def unit(self, si_unit: str) -> str:
        """The unit of a quantity whose linear unit is `si_unit`."""
        ...


def amount(of: HasUnits, value: float, si_unit: str, digits: int = 4) -> str:
    """A quantity of a result with the prefix of its unit."""
    return prefixed(value, of.unit(si_unit), digits)


def machine(of: HasUnits, k_p: float | None, k_v: float, mass: float | None) -> str:
    """The gains and the mass of a machine; k_p may be open."""
    stiffness = "" if k_p is None else f"k_p = {amount(of, k_p, 'N/m')}, "
    inertia = "no mass (quasi-static)" if mass is None else f"mass {amount(of, mass, 'kg')}"
    return f"{stiffness}k_v = {amount(of, k_v, 'N s/m')}, {inertia}"


def lower(text: str) -> str:
    """The text within a sentence."""
    return text[:1].lower() + text[1:]


def capital(text: str) -> str:
    """The text as the beginning of a sentence."""
    return text[:1].upper() + text[1:]


def change_words(wanted: Iterable[str]) -> str:
    """Put into words the changes of a run that would separate effects; a text stays unchanged."""
    return ", ".join(CHANGES[one] if isinstance(one, RunChange) else one for one in wanted)
