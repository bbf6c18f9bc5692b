"""Sentences of a closed loop: the verdict, why it is not more, its findings and what to do next."""

from collections.abc import Mapping

VERDICT: Mapping[str, str] = {
    "no_missing_effect": "This record shows nothing that is missing: the base model fits to the"
    " noise ({before}).",
    "effects": "The model lacks {named}: {change}, BIC {gain:.0f} lower.",
    "effects_or_alike": "The model lacks {named}, or what looks like it ({pairs}): {change}.",
    "curve": "The model lacks {what}: {change}, BIC {gain:.0f} lower.",
    "curve_or_alike": "The model lacks {what}, or what looks like it ({pairs}): {change}, BIC"
    " {gain:.0f} lower.",
    "curve_decided": " {where} would tell.",
    "rivals": "{a} or {b}",
    "base_misses": "The base model misses rows that it was not fitted to ({before}; noise alone"
    " gives up to {most:.2f}), and no effect that explains it is supported by more than"
    " {accept:g} of BIC: what is fitted of this record may not fix the base model.",
    "too_weak": "Something may be missing, but too weakly to be named: no effect is supported by"
    " more than {accept:g} of BIC ({before}).",
    "too_weak_but_left": "Something is left ({p}), but too little to be named: no effect is"
    " supported by more than {accept:g} of BIC ({before}).",
    "outside": "What is missing is not in the catalogue.",
    "outside_in_part": "Not all that is missing is in the catalogue.",
    "outside_or_changes": "What is missing is not in the catalogue, or not the same along all of"
    " the record.",
    "not_named": "What is missing is not named.",
    "not_all_named": "Not all that is missing is named.",
    "small_but_structured": "What is left is as small as the noise (test error {after:.2f} sigma),"
    " but has structure that no effect of the catalogue explains.",
    "small_but_open": "What is left is as small as the noise (test error {after:.2f} sigma), but"
    " has structure that no effect of the catalogue that this record fixes explains.",
    "error": "test error {before:.2f} sigma",
    "error_falls": "test error {before:.2f} -> {after:.2f} sigma",
    "error_does_not_fall": "test error {after:.2f} sigma with, {before:.2f} without",
    "moved_one": "{named} fits the train block, but {moves}, and the test block is predicted no"
    " better ({change}): {named} is not confirmed, and this record leaves both open.",
    "moved_some": "{named} fit the train block, but {moves}, and the test block is predicted no"
    " better ({change}): {named} are not confirmed, and this record leaves both open.",
    "helps_one": "{named} helps ({change}) but does not explain all of it.",
    "helps_some": "{named} help ({change}) but do not explain all of it.",
    "little_one": "{named} changes little: {change}.",
    "little_some": "{named} change little: {change}.",
    "in_vain_one": "{named} fits the train block but predicts the others no better ({change}).",
    "in_vain_some": "{named} fit the train block but predict the others no better ({change}).",
    "takes": "{names} would explain most (BIC {lower} lower{than}), but {why}: it is not"
    " confirmed.",
    "not_fixed": "{names} would explain most (BIC {lower} lower{than}), but the rows that are"
    " fitted do not fix the parameters of such a model.",
    "than": " than that of {named}",
    "withheld": "No verdict: {why}.",
    "base_runs_away": "No verdict: where its fit ended, the base model cannot be simulated, so"
    " nothing can be said of what it lacks. Check the units and signs of the columns, and of a"
    " slider its stiffness.",
    "edge_of_stability": "No verdict: the base fit sits at the edge of stability (K/K_cr is"
    " {ratio:.2f}), where a small misfit of the law looks like a large effect; use a stiffer"
    " machine, or check {stiffness}.",
}
"""The sentence of a verdict, and its parts."""

CURVE: Mapping[str, str] = {
    "none": "a steady curve of velocity ({effects} {fit})",
    "one": "a steady curve of velocity ({effects} {fit}, {shapes} another)",
    "some": "a steady curve of velocity ({effects} {fit}, {shapes} are others)",
    "fits": "is one that fits",
    "fit": "together are one that fits",
    "where": "steady sliding at {speeds}",
    "interpolates": "{velocities} velocities, {parameters} parameters of the curve",
    "as_good": "{shape}: BIC {by:.1f} higher",
    "better": "{shape}: BIC {by:.1f} lower",
}
"""A curve of velocity whose shape is open."""

FINDING: Mapping[str, str] = {
    "structure_left": "structure is left in the residual: {what}",
    "error_left": "the {block} error is {error:.3f} sigma; noise alone gives up to {most:.2f}",
    "rival_not_fitted": "{rival} could not be fitted in place of {effect}: it is not ruled out",
    "headline_moved": "{name} moves from {before} to {after}",
    "other_joints_move": "other joints move in this record (columns {columns}): their weight and"
    " inertia act here, the model has neither, and an effect may stand for them; hold them still",
    "effect": "{effect}",
    "effect_or_alike": "{effect}, or what looks like it",
    "friction": "friction {direction}",
    "stability_free": "friction grows with speed",
    "stability": "friction falls with speed",
    "withheld": "{why}: the verdict is withheld",
    "edge_of_stability": "K/K_cr is {ratio:.2f}",
    "base_runs_away": "the fit runs away",
    "force_follows_position": "the force is that of the position{late} alone, without inertia and"
    " friction: feedback, as of a controller that carries a weight",
    "late": " {ms:.2g} ms before",
    "never_slid": "the axis never slid: its force goes with the position and with no more than"
    " {share:.2g} % of hysteresis, which comes back over the whole stroke as in presliding. Its"
    " stiffness is {stiffness:.4g} ± {std:.2g} {unit}; Coulomb and viscous friction, inertia,"
    " stability and a feedforward are not in such a record: move it farther",
    "more_columns": " and {more} more",
    "report": "test",
    "select": "validation",
    "train": "train",
}
"""A finding by its code, and its parts."""

REFUSAL: Mapping[str, str] = {
    "did_not_converge": "did not converge",
    "impossible_parameters": "impossible parameters",
    "too_little_evidence": "too little evidence",
    "not_fixed": "{parameters} not fixed",
    "takes_of_the_base": "takes {moves}",
    "move": "{name}: {before} -> {after}",
    "undetermined": "undetermined",
}
"""Why a model is not taken, by the code of its fault."""
