"""Sentences on a closed loop: verdict, reasons that limit the verdict, findings, alike effects."""

from collections.abc import Mapping

HEADLINE: Mapping[str, str] = {
    "no_missing_effect": "No effect is missing",
    "effects": "Missing: {effects}",
    "curve": "a curve of velocity whose shape is not determined",
    "ambiguous": "An effect is missing, but this record cannot say which",
    "one_of": "Missing: {either} (this record cannot say which)",
    "also_one_of": "Missing: {effects}; also {either} (this record cannot say which)",
    "not_confirmed": "Missing: {effects}, not confirmed",
    "outside_catalogue": "Something is missing that the catalogue does not explain",
    "beyond": "Beyond {effects} something is missing that the catalogue does not explain",
    "outside_catalogue_unfixed": "Something is missing that this record does not determine",
    "beyond_unfixed": "Beyond {effects} something is missing that this record does not determine",
    "too_weak": "The evidence is too weak to name an effect",
    "base_misses": "The test rows are missed, and no effect is supported",
}
"""The verdict in a few words."""

VERDICT: Mapping[str, str] = {
    "no_missing_effect": "Nothing is missing: the base model fits this record to its noise (test"
    " error {before:.2f} sigma).",
    "effects": "The model lacks {what}{alike}: {change}, BIC {gain:.0f} lower.",
    "alike": ", or what looks like it ({pairs})",
    "rivals": "{a} or {b}",
    "decided": " To decide: {where}.",
    "change": "test error {before:.2f} -> {after:.2f} sigma",
    "base_misses": "The base model misses rows that it was not fitted to (test error {before:.2f}"
    " sigma; noise alone gives up to {most:.2f}), and no effect that explains this lowers the BIC"
    " by more than {accept:g}. The fitted rows may not determine the base model.",
    "too_weak": "An effect may be missing, but the evidence is too weak to name it: none lowers"
    " the BIC by more than {accept:g} (test error {before:.2f} sigma).",
    "too_weak_but_left": "Structure remains in the residual ({p}), but no effect lowers the BIC"
    " by more than {accept:g} (test error {before:.2f} sigma).",
    "outside": "The missing effect is not in the catalogue, or it changes along the record.",
    "in_part": "Only a part of what is missing can be named.",
    "not_named": "The missing effect cannot be named.",
    "small": "The residual is as small as the noise (test error {after:.2f} sigma), but it has"
    " structure. No effect whose parameters this record determines explains it.",
    "moved": "With {named} the train block is fitted better, but {moves}, and the test block is"
    " predicted no better ({change}). This is not confirmed: the record leaves both possible.",
    "helps": "With {named} the prediction is better ({change}).",
    "in_vain": "With {named} the train block is fitted better, but the other blocks are predicted"
    " no better ({change}).",
    "would": "{names} would lower the BIC by another {lower:.0f}, but is refused: {why}.",
    "withheld": "No verdict: {why}.",
    "base_runs_away": "No verdict: the base model cannot be simulated at the parameters where its"
    " fit ended. Check the units and signs of the columns, and the stiffness of a slider.",
    "edge_of_stability": "No verdict: the base fit is at the edge of stability (K/K_cr is"
    " {ratio:.2f}), where a small misfit of the law looks like a large effect. Use a stiffer"
    " machine, or check {stiffness}.",
}
"""The sentence of a verdict, and its parts."""

CURVE: Mapping[str, str] = {
    "open": "a steady curve of velocity ({shapes})",
    "where": "steady sliding at {speeds}",
    "interpolates": "{velocities} velocities, {parameters} parameters of the curve",
    "as_good": "{shape}: BIC {by:+.1f}",
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
    " most {hysteresis:.2%}, which comes back over the whole stroke as in presliding. The stiffness"
    " is {stiffness:.4g} ± {std:.2g} {unit}. Such a record does not show Coulomb and viscous"
    " friction, inertia or stability: move the axis farther",
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

APART: Mapping[str, str] = {
    "not_told": "{id}: this record cannot distinguish it from {others}",
    "curve": "{id}: this record does not distinguish it from a steady curve of another shape"
    " ({why}){decides}",
    "decides": "; {where} would",
    "told": "{id}: this record distinguishes it from every other effect",
    "in_part": "{id}: this model is not complete, so it may partly stand for another effect",
    "pairs": "pairs that this record cannot distinguish: {pairs}",
}
"""What each effect is told from."""
