"""Sentences of the verdict on a steady friction curve, and reasons for giving no friction."""

from collections.abc import Mapping

STEADY: Mapping[str, str] = {
    "counted": "runs that stick and slip count in the fit, since too few others remain: the"
    " fitted line is not the friction of steady sliding",
    "not_fitted": "these runs have no steady friction and are not fitted",
    "wanders": "the force changes along the runs as slowly as a weight or a spring changes it (a"
    " run is worth {samples:.0f} independent samples). Friction cannot be separated from such a"
    " load, and the errors of the means are unknown. Record {more}",
    "longer_runs": "longer runs",
    "position": "the position as well",
    "drives": "the fitted friction is negative{where}, {force}: it would drive the axis, so that"
    " the model is wrong",
    "at": " at {speed:.3g} {unit}",
    "slips": "Stick-slip: {each}; {how}.",
    "slips_one": "at {speed:.3g} {unit} the axis rests {share:.0f} % of the time ({stops}"
    " stops) and moves at {moving_speed:.3g} {unit} between",
    "loaded": "The force changes {what}, equally in both directions, like that of a weight or a"
    " spring. This part is subtracted from the friction; F_0 contains its value in the middle of"
    " the travel.",
    "gravity": "with the sine of the angle, {size} at most",
    "position_dependence": "with the position, {size}",
    "untested": "Whether friction lacks an effect ({effects}) is not tested",
    "ambiguous": "{untested}.",
    "too_few": "A line each way fits the runs: {known} (rms {before} {unit}). {untested}:"
    " {fewest} runs are needed, {of_each} of each direction.",
    "not_supported": " Not supported: {effects}.",
    "effects": "The curve lacks {effects}: rms {before} -> {after} {unit}, BIC {gain:.0f}"
    " lower.{rest}",
    "too_weak": "An effect may be missing, but none lowers the BIC by more than {accept:g} (best"
    " {lower:.1f}).",
    "stick_slip": "The others fit Coulomb and viscous friction (rms {before} {unit}); they do not"
    " show where friction falls with speed.{rest}",
    "no_missing_effect": "Nothing is missing in these points: rms {before} {unit}.{rest}",
}
"""A sentence by its code, and its parts."""
