"""Templates of all sentences on results, one template for each code.

Results hold codes and values. `say` makes sentences from them; no code parses a sentence.
"""

import string
from collections.abc import Iterable, Mapping
from typing import Protocol

from ..effects import RunChange
from ..errors import option
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
    "verdict.not_named": "The missing effect cannot be named.",
    "verdict.small": "The residual is as small as the noise (test error {after:.2f} sigma), but it"
    " has structure. No effect whose parameters this record determines explains it.",
    "verdict.slow": "The structure changes slowly along the record. Slow noise (1/f) of the"
    " recorder also has such structure.",
    "verdict.moved": "With {named} the train block is fitted better, but {moves}, and the test"
    " block is predicted no better ({change}). This is not confirmed: the record leaves both"
    " possible.",
    "verdict.helps": "With {named} the prediction is better ({change}); {named} may imitate part of"
    " the missing effect.",
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
    "finding.imitation": "{effect}, which may imitate part of the missing effect",
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
    "headline.imitated": "Something is missing that the catalogue does not explain ({effects} may"
    " imitate part of it)",
    "headline.outside_catalogue_unfixed": "Something is missing that this record does not"
    " determine",
    "headline.imitated_unfixed": "Something is missing that this record does not determine"
    " ({effects} may imitate part of it)",
    "headline.small": "{found}: errors are as small as noise, but the residual has structure"
    " ({variable}: {p})",
    "headline.slow": "{found}, or the recorder has slow noise (1/f)",
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

WARNINGS: Mapping[str, str] = {
    # of a saved model
    "unsaid_convergence": "its file does not say whether it converged",
    "no_claim": "this {what} says nothing of stability ({reasons}): what follows is of its {of},"
    " not of the record",
    "no_claim_of_the_axis": "of the axis itself: {sentence}",
    "last_model_used": "the loop's verdict is {verdict}{sentence}: the law of its last model is"
    " used, which does not describe the record",
    "base_model_used": "the loop's verdict is {verdict}{sentence}: the law of its base model is"
    " used, since the effects added predict the test rows worse; it does not describe the record"
    " either",
    # of a posterior
    "chains_disagree": "the chains disagree: R-hat of {name} is {rhat:.3f}, above {most}; the"
    " posterior claims nothing; ask for more {option[draws]}, or give priors",
    "few_draws": "too few independent draws: the effective sample size of {name} is {size:.0f},"
    " below {least}; the posterior claims nothing; ask for more {option[draws]}",
    "diverged": "{number} transitions of the sampler diverged: a part of the posterior may be"
    " missing, so it claims nothing; give tighter priors",
    "no_maximum": "the maximum of the posterior was not found (do the priors contradict the"
    " record?): it claims nothing",
    "no_prior": "neither the record nor a prior determines {parameters}, so the posterior claims"
    " nothing; give {first} a prior",
    "prior_ends_inside": "the uniform prior of {parameters} ends inside the posterior: there the"
    " Laplace approximation is inexact; ask for {option[draws]}",
    # of a prediction
    "model_undetermined": "the model's own record does not determine {parameters}",
    "other_velocities": "velocities of this record ({velocities:u.3g} um/s) are outside the model's"
    " own record ({slowest:u.3g} to {fastest:u.3g} um/s): there it extrapolates",
    "faster": "{share:%.0f} % of the rows are faster than {fastest:.3g} {unit}, the maximum of the"
    " model's own record: there it extrapolates",
    "few_rows": "{compared} of {rows} rows are compared ({recorded} in the file before averaging):"
    " the others are at rest, reverse, or have no neighbours",
    "one_direction": "the record moves in one direction only, so that a fit determines only the sum"
    " of Coulomb friction and offset",
    # of a protocol
    "steps_too_short": "a step of {slip:u.4g} um is shorter than 3 L ({needed:u.4g} um): friction"
    " does not reach steady state between steps",
    # of gains
    "no_controller_is_as_fast": "the delay margin of these gains is {delay:u.2g} us, less than the"
    " delay of any controller ({least:u.0f} us at a sample rate of 30 kHz). Include the delay of"
    " yours: {option[sample-time]}, or {option[delay]} if it is known",
    "stiffness_at_its_lower_limit": "k_p is at its lower limit: any {which} stiffness meets the"
    " requirement; give a lower limit ({option[min-kp]}) if the position must be controlled",
    "gains_raised": "the gains were raised by a factor {factor:.4g} for a basin of {basin:g}",
    "margin_missed": "the raised gains miss a required margin by {by:.2g} of its value",
    "simulations_unresolved": "{unresolved} of {checked} simulated starts end unresolved: the"
    " simulation stopped before they settled. They are not counted: look at one with 'jaxfric"
    " simulate'",
    "steps_unresolved": "{unresolved} of {steps} steps between set points end unresolved: the"
    " simulation stopped before it was clear whether the slider settles there. Raise the margin, so"
    " that it settles sooner",
    "delay_law_not_simulated": "gains under a delay law are not simulated",
    "integral_not_simulated": "gains with integral action are not simulated in motion",
    "any_stiffness_not_simulated": "not simulated: k_p means any positive stiffness; give a lower"
    " limit of k_p",
    # of a record or a fit
    "trend_with_slip": "friction has a significant trend with slip that the model lacks: with it"
    " A-B is {told}, not {without} ({option[slip-trend]})",
    "not_steady_at_the_start": "sliding is not steady at its start, as the model assumes: begin"
    " at least {time:.4g} s later ({option[from]})",
    "normal_stress_changes": "the normal stress goes from {least:M.3g} to {most:M.3g} MPa{when};"
    " the model takes it as constant. Leave out its changes ({option[from]}, {option[to]}), or use"
    " 'jaxfric loop', which has the effect normal_stress",
    "means_flatten_the_peaks": "means over {rows} rows flatten the peaks after the steps by"
    " {times:.2g} times the noise of the means: A is too small; raise {option[downsample-to]}",
    "rows_at_uneven_times": "the rows are {least:m.3g} to {most:m.3g} ms apart ({middle:m.3g} as a"
    " rule; {share:%.2g} % differ from that by a fifth or more): they are interpolated, which"
    " blurs the acceleration. Record at even times",
    "errors_of_the_motion_lower_the_inertia": "the encoder's error, differentiated twice, lowers"
    " the inertia by about {share:%.2g} %, {in_errors:.2g} times its error from noise alone."
    " Low-pass the position at a lower frequency: {advice}",
    "motion_does_not_answer_to_the_force": "in {share:%.2g} % of the rows that count ({times}) the"
    " motion does not answer to the recorded force: by more than half of it. Either something"
    " else acts there, or the force is wrong: give what was added as a column"
    " ({option[column=disturbance=NAME]}), or cut those rows out",
    "steps_contradict_the_motion": "from {time:.4g} s on the steps say {stated:u.4g} µm/s, but the"
    " load point moves at {moved:u.4g} µm/s: are they those of this record?",
    "did_not_converge": "the fit did not converge ({result}): do not use its parameters",
    "slip_length_beyond_the_slip": "L ends at {L:m.3g} mm, beyond the {slip:m.3g} mm of slip in"
    " this record: such a law only lets friction drift with slip. Fit the drift itself: {advice}",
    "direct_effect_vanishes": "A ends at {A:.2g}: from the slowest to the fastest velocity it"
    " changes friction by {change:.2g}, and the noise is {noise:.2g}. A drift of friction with slip"
    " may hide the direct effect. Fit the drift too: {advice}",
    "parameters_undetermined": "this record does not determine {parameters}: other values fit it as"
    " well",
    "edge_of_stability": "near the stability edge (K/K_cr = {ratio:.2f}): finite velocity steps may"
    " leave the basin of steady sliding; a stiffer machine avoids it",
    "below_the_critical_stiffness": "stick-slip regime: the stiffness is below the critical one of"
    " this fit (K/K_cr = {ratio:.2f}); steady sliding is unstable and A, B, L are suspect",
    "step_time_moved": "velocity step {step} fits best {sigmas:+.1f} standard errors from the time"
    " that the load point shows: the stiffness may be wrong, the step not sharp, or there is a lag",
    "coarse_recorder_steps": "{file}: friction is recorded in steps of {step:.2g}, more than twice"
    " the rest of its noise ({noise:.2g}): neighbouring rows differ by steps, not by noise, and"
    " what is smaller than a step may be lost; record more digits, or in a finer range",
    # of a friction law
    "slopes_of_a_table": "slopes are those between neighbouring rows of the table, including their"
    " scatter",
    "no_direct_effect_assumed": "the table does not determine a direct effect: none is assumed",
    "law_without_memory": "a table of steady-state friction has no memory: only damping can"
    " stabilise the slider, and the effect of stiffness is unknown. Give the memory distance if it"
    " is known, {option[memory=1 mm]}",
    "effect_stiffens": "{effect} is left out of the law: it depends on position, and stiffens k_p"
    " like a spring, so leaving it out is safe",
    "effect_softens": "{effect} is left out of the law: it depends on position, like a spring of"
    " {stiffness:.3g} {unit} beside k_p: add {more:.3g} {unit} to k_p",
    "effect_of_the_record": "{effect} is left out of the law: it belongs to the {room} of the"
    " record; a lag that stays asks for larger gains",
    "effect_vanishes_in_steady_motion": "{effect} is left out of the law: it vanishes in steady"
    " motion",
    "law_of_one_direction": "{effect}: the law is that of motion {direction}, where viscous"
    " friction is less",
    "law_beyond_its_record": "the law is fitted to velocities of {slowest:.3g} to {fastest:.3g} m/s"
    " and asked at {least:.3g} to {most:.3g} m/s, up to {times:.3g} times beyond the record: an"
    " untested extrapolation",
    # of a feedforward
    "errors_of_an_older_version": "the file is of an older version, so the band of friction is too"
    " wide; run 'jaxfric axis' again",
    "middle_of_the_travel": "friction changes along the travel: its middle is compensated",
    "curve_is_a_guess": "the record does not determine {parameters}: below {slowest:.3g} {length}/s"
    " the shape of the curve and its compensation are a guess",
    "friction_falls_with_speed": "friction falls with speed up to {fastest:.3g} {length}/s, the"
    " highest supported speed. Extrapolated, it would drive the axis above {above:.3g} {length}/s;"
    " the friction map keeps the friction of {fastest:.3g} {length}/s instead",
    "v_c_at_its_least": "v_c is set to the smallest value that the fit resolves, {width:.3g}"
    " {length}/s",
    "terms_undetermined": "the record does not determine {parameters}; the band of the table holds"
    " for the sum of all terms",
    # of a run
    "gaps_of_the_clock": "gaps of the clock: {number}, the longest of {longest:.4g} s after"
    " {time:.6g} s. Events in a gap are inferred from the rows before and after it",
    "load_point_turns_back": "the load point turns back {turns} times: one direction is taken as"
    " forward, the other as unloading. For such an axis use 'jaxfric axis'",
    "friction_falls_and_returns": "friction falls to {lowest:.2g}{unit} and comes back within"
    " {rows} rows, at {times:.6g} s ({number} in all): the load point may have turned there, if"
    " |friction| was recorded. Cut the record there ({option[from]}, {option[to]}), or use 'jaxfric"
    " axis' for motion back and forth",
    "one_stiffness_at_several_stresses": "a stiffness of {stiffness:M.4g}/um was used at normal"
    " stresses from {low:M.4g} to {high:M.4g} MPa, but a press has one stiffness of shear stress."
    " If {stiffness:M.4g}/um holds at the last, give {option[stiffness]} as {needed:T.4g} MPa/um",
    "stiffness_is_not_that_of_the_ramps": "{option[stiffness]} differs by {share:%+.0f} % from that"
    " of the ramps ({found}): A, B and L depend on it. To use that: {option[stiffness=ramps]}",
    "stiffness_is_not_that_of_stick_slip": "{option[stiffness]} differs by {share:%+.0f} % from the"
    " slope of friction during stick, {found}",
    # of a study
    "mass_in_the_margins_only": "the mass m is in the margins, and the simulated slider has none:"
    " {advice}, or inertia = false if this is intended",
    "plan_without_mass": "the plan is without mass; the fit has {mass:.4g} {unit}, which is not"
    " used",
    "motions_near_rest_without_mass": "motions without mass use the direct effect A ln(V/V_ref),"
    " margins the regularised one. They differ here (f0 = {least:.3g} A): for one law give m and"
    " inertia = true",
    "file_system_without_locks": "the file system of {store} has no locks ({error}); make sure that"
    " no other run writes there",
    "begun_with_other_versions": "begun with other versions: {versions}",
}
"""Every template of a warning by its code, a `findings.WarningCode`."""

REASONS: Mapping[str, str] = {
    # of an event of a run
    "of_some_time": "of {lasts:.4g} s",
    "after_a_hold": "after a hold of {lasts:.4g} s",
    "load_point_turns": "the load point reverses",
    "saw_teeth_beside": "friction has saw teeth next to it",
    "stress_changes": "the stress goes from {before:M.4g} to {after:M.4g} MPa until {stop:.6g} s",
    "still_rises": "friction still rises before it, by {share:%.2g} % in a quarter of the time",
    "still_loaded": "before it friction changes by {share:%.2g} % of what the motion would load",
    "saw_teeth": "drops of {drop:.3g}{unit} every {period:.3g} s until {stop:.6g} s",
    "outlier_of_friction": "outlier of friction",
    "encoder_jumps": "encoder jumps by {size:u.5g} um at {time:.6g} s",
    "motion_not_counted": "the encoder is off by {size:u.3g} um after {paused:.3g} s without rows"
    " before {time:.6g} s: velocities before and after agree, and friction does not respond",
    "too_few_rows": "{before} rows before it and {after} after it: {needed} are needed",
    "normal_stress_not_constant": "the normal stress is not constant around it",
    # of a hold that is not fitted, or not used to compare the laws
    "no_sliding_before": "the load point does not slide before it",
    "run_ends_in_it": "the run ends in it",
    "no_reload_follows": "the next event is {kind}, not reload",
    "not_one_velocity": "one forward velocity is needed, not {before:u.3g} and {after:u.3g} um/s",
    "not_measured": "too few rows of sliding beside it, or the normal stress changes there",
    "motion_not_recorded": "friction rises more than the recorded motion can load the spring: at"
    " least {missing:u.2g} um are missing, or press and specimen are stiffer. No law is tested",
    "no_fit_under_a_law": "no fit converged (law: {laws})",
    "no_fit_under_one_law": "no fit of the {law} law converged; this alone is no evidence for the"
    " {other} law, whose fit leaves {times:.2g} times the scatter between rows",
    "not_fitted_with_the_others": "no law has a fit to this hold and its neighbours together",
    "neither_law": "the better law ({law}) leaves {times:.2g} times the scatter between rows",
    # of a change of the normal stress
    "fit_did_not_converge": "the fit did not converge",
    "no_step_of_one_state": "no velocity step of the run gives A, B and L of one state",
    "other_event_meanwhile": "another event occurs while the stress changes",
    "slow_change": "the change is slow: meanwhile the slider slips {slip:u.3g} um, {lengths:.2g} L",
    "rougher_than_the_steps": "its residual is {times:.2g} times that of the velocity steps' fits",
    "not_determined": "the record does not determine it",
    # of a ramp, and of stick-slip
    "slope_lost_in_noise": "its slope is lost in the noise",
    "not_straight": "it is not straight",
    "rises_missed": "its misfit is {misfit:%.2g} % of a drop: it does not describe the rises",
    "near_critical": "K would be {share:.2g} of the critical stiffness: the mass of the slider"
    " matters while it creeps, or rows are running means (record unfiltered rows)",
    "inertia_during_creep": "a drop would last {lasts:.2g} s ({moved:u.3g} um of the load point,"
    " and L {L:u.3g} um): inertia matters, or rows are running means: record unfiltered rows",
    "too_few_teeth": "{teeth} teeth after the first {first}; {needed} are needed",
    "too_few_rows_in_a_rise": "fewer than {needed} rows in a rise",
    "teeth_not_alike": "its teeth are not alike",
    "no_steady_rise": "friction does not rise steadily between its drops",
    # notes of a prediction
    "parameters_fitted": "of this record {parameters} was fitted",
    "nothing_fitted": "no parameter was fitted to this record",
    "step_times_fitted": "the times of the velocity steps were fitted within their error",
    "stiffness_of_the_model": "stiffness is the model's, {stiffness:.4g} {unit}: if another machine"
    " made this record, give the stiffness of that machine ({option[stiffness]})",
    "stiffness_scaled_by_normal_stress": "stiffness is {stiffness:.4g} {unit}, from the model's"
    " {of_model:.4g} {unit}: the same machine [MPa/µm], at the normal stress of this record"
    " ({here:M.4g} MPa) instead of the model's ({before:M.4g} MPa). If another machine made this"
    " record, give the stiffness of that machine ({option[stiffness]})",
    "disturbance_inside": "the recorded force contains the disturbance: so the error is smaller",
    "disturbance_beside": "the recorded force is without the disturbance: so the error is smaller",
    "noise_of_the_record": "noise of this record: sigma = {sigma:.3g}, {share:%.2g} % of its"
    " variance correlated; noise alone exceeds {largest:.3g} sigma in one record of a thousand",
}
"""Every template of a reason (`runs.reasons`) or note (`prediction.NoteCode`) by its code."""

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


_SIZES = {"u": 1e6, "m": 1e3, "M": 1e-6, "T": 1e-12, "%": 100.0}


class _Filler(string.Formatter):
    """Fills a template: "{option[draws]}" is an option of the command, or an argument of Python.
    Each value of a list is written in turn. "{:u.3g}" writes a value in micro-units (`_SIZES`)."""

    def get_field(self, field_name, args, kwargs):
        if field_name.startswith("option["):
            return option(*field_name[len("option[") : -1].split("=", 1)), field_name
        return super().get_field(field_name, args, kwargs)

    def format_field(self, value, format_spec):
        if isinstance(value, list | tuple):
            return ", ".join(self.format_field(one, format_spec) for one in value)
        if format_spec[:1] in _SIZES:
            value, format_spec = _SIZES[format_spec[0]] * value, format_spec[1:]
        return super().format_field(value, format_spec)


def say(code: str, **values: object) -> str:
    """Fill the template of a code with values."""
    return _Filler().vformat(TEMPLATES[code], (), values)


def coded(code: str, values: Mapping[str, object]) -> str:
    """A warning or a reason in words."""
    return _Filler().vformat(WARNINGS.get(code) or REASONS[code], (), values)


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
