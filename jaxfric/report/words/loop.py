"""Sentences of a closed loop: the verdict, the reasons that limit it, findings and next steps."""

from collections.abc import Mapping

VERDICT: Mapping[str, str] = {
    "no_missing_effect": "Nothing is missing: the base model fits this record to its noise"
    " ({before}).",
    "effects": "The model lacks {named}: {change}, BIC {gain:.0f} lower.",
    "effects_or_alike": "The model lacks {named}, or what looks like it ({pairs}): {change}.",
    "curve": "The model lacks {what}: {change}, BIC {gain:.0f} lower.",
    "curve_or_alike": "The model lacks {what}, or what looks like it ({pairs}): {change}, BIC"
    " {gain:.0f} lower.",
    "curve_decided": " {where} would tell.",
    "rivals": "{a} or {b}",
    "base_misses": "The base model misses rows that it was not fitted to ({before}; noise alone"
    " gives up to {most:.2f}), and no effect that explains this lowers the BIC by more than"
    " {accept:g}. The fitted rows may not determine the base model.",
    "too_weak": "An effect may be missing, but the evidence is too weak to name it: none lowers"
    " the BIC by more than {accept:g} ({before}).",
    "too_weak_but_left": "Structure remains in the residual ({p}), but no effect lowers the BIC"
    " by more than {accept:g} ({before}).",
    "outside": "The missing effect is not in the catalogue.",
    "outside_in_part": "The catalogue explains only a part of what is missing.",
    "outside_or_changes": "The missing effect is not in the catalogue, or it changes along the"
    " record.",
    "not_named": "The missing effect cannot be named.",
    "not_all_named": "Only a part of what is missing can be named.",
    "small_but_structured": "The residual is as small as the noise (test error {after:.2f}"
    " sigma), but it has structure that no effect of the catalogue explains.",
    "small_but_open": "The residual is as small as the noise (test error {after:.2f} sigma), but"
    " it has structure. No effect whose parameters this record determines explains it.",
    "error": "test error {before:.2f} sigma",
    "error_falls": "test error {before:.2f} -> {after:.2f} sigma",
    "error_does_not_fall": "test error {after:.2f} sigma with, {before:.2f} without",
    "moved_one": "{named} fits the train block, but {moves}, and the test block is predicted no"
    " better ({change}). {named} is not confirmed: this record leaves both possible.",
    "moved_some": "{named} fit the train block, but {moves}, and the test block is predicted no"
    " better ({change}). {named} are not confirmed: this record leaves both possible.",
    "helps_one": "{named} helps ({change}) but explains only a part.",
    "helps_some": "{named} help ({change}) but explain only a part.",
    "little_one": "{named} changes little: {change}.",
    "little_some": "{named} change little: {change}.",
    "in_vain_one": "{named} fits the train block but predicts the other blocks no better"
    " ({change}).",
    "in_vain_some": "{named} fit the train block but predict the other blocks no better"
    " ({change}).",
    "takes": "{names} would explain most (BIC {lower} lower{than}), but {why}: {names} is not"
    " confirmed.",
    "not_fixed": "{names} would explain most (BIC {lower} lower{than}), but the fitted rows do"
    " not determine the parameters of such a model.",
    "than": " than that of {named}",
    "withheld": "No verdict: {why}.",
    "base_runs_away": "No verdict: the base model cannot be simulated at the parameters where its"
    " fit ended. Check the units and signs of the columns, and the stiffness of a slider.",
    "edge_of_stability": "No verdict: the base fit is at the edge of stability (K/K_cr is"
    " {ratio:.2f}), where a small misfit of the law looks like a large effect. Use a stiffer"
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
    "structure_left": "structure remains in the residual: {what}",
    "error_left": "the {block} error is {error:.3f} sigma; noise alone gives up to {most:.2f}",
    "rival_not_fitted": "{rival} could not be fitted in place of {effect}, so it is not ruled out",
    "headline_moved": "{name} moves from {before} to {after}",
    "other_joints_move": "other joints move in this record (columns {columns}). The model has"
    " neither their weight nor their inertia, and an effect may stand for them: hold them still",
    "effect": "{effect}",
    "effect_or_alike": "{effect}, or what looks like it",
    "friction": "friction {direction}",
    "stability_free": "friction grows with speed",
    "stability": "friction falls with speed",
    "withheld": "{why}: the verdict is withheld",
    "edge_of_stability": "K/K_cr is {ratio:.2f}",
    "base_runs_away": "the fit runs away",
    "force_follows_position": "the force follows the position{late} alone, without inertia and"
    " friction: feedback, as of a controller that carries a weight",
    "late": " {ms:.2g} ms before",
    "never_slid": "the axis never slid: its force follows its position, with a hysteresis of at"
    " most {share:.2g} %, which comes back over the whole stroke as in presliding. The stiffness"
    " is {stiffness:.4g} ± {std:.2g} {unit}. Such a record does not show Coulomb and viscous"
    " friction, inertia or stability: move the axis farther",
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
    "not_fixed": "{parameters} not determined",
    "takes_of_the_base": "takes over {moves}",
    "move": "{name}: {before} -> {after}",
    "undetermined": "undetermined",
}
"""Why a model is not taken, by the code of its fault."""
