"""Words of the tables of a loop: headlines, roles, notes, and what each effect is told from."""

from collections.abc import Mapping

HEADLINE: Mapping[str, str] = {
    "no_missing_effect": "No effect is missing",
    "effects": "Missing: {effects}",
    "curve": "a curve of velocity whose shape is not told",
    "ambiguous": "An effect is missing, but this record cannot say which",
    "outside_catalogue": "Something is missing that the catalogue does not explain",
    "beyond": "Beyond {effects} something is missing that the catalogue does not explain",
    "unfixed": "Something is missing that this record does not fix",
    "beyond_unfixed": "Beyond {effects} something is missing that this record does not fix",
    "too_weak": "What is left is too little to be named",
    "base_misses": "Rows that were not fitted are missed, and no effect is supported",
}
"""The verdict in a few words."""

ANSWER: Mapping[str, str] = {
    "doubted": "these rows do not tell it, though what {fitted} leave looks like noise",
    "base": "{base}; nothing else is missing",
    "effects": "{base}; also found: {effects}",
    "not_described": "{base} do not describe it: {headline}",
    "friction": "friction: {found}",
    "not_sure": "not sure: {doubt}",
    "test_error": "test error: {errors} sigma (of the report block alone; noise alone gives 1)",
    "F_c": "Coulomb",
    "F_v": "viscous",
    "M": "mass",
    "inertia": "inertia",
    "effect": "{id} ({meaning})",
}
"""The first lines on an axis."""

TABLE: Mapping[str, str] = {
    "train": "train: fitted here",
    "select": "select: predicted, has a say in the choice",
    "report": "report: scored once",
    "errors": "Error before and after",
    "errors_note": "{sigma}; {lowest}{target}. Noise is {noise}{bound}",
    "not_below": "no model brings the error below 1 σ, but for chance",
    "below": "a model that was fitted brings the error of the fitted rows to {least:.2g} σ, so what"
    " is taken for noise here is not all noise",
    "target": "; the report block counts as noise up to {most:.2f} σ",
    "sigma": "σ = {here} is the noise of a {row}",
    "sigmas": "σ is the noise of a {row}: {here} where the model is fitted, {later} in rows held"
    " out",
    "bound": "; what lasts longer than {bound} is not taken for noise",
    "no_row": "no row counts",
    "largest_errors": "the {most} of {all} with the largest errors after; all are in loop.html",
    "shift": "shift: after minus before, in standard deviations of the fit after",
    "rivals_covered": "± and intervals cover what the fits with its rivals make of the same"
    " parameters",
    "known_less": "± rests on friction and {columns}; a fit of friction alone knows less",
    "traded": "{name} is {value}{own}, though it was known before",
    "own_error": " (± {own} in this model alone)",
    "nothing_takes": "{traded}: no parameter of an effect alone takes its place",
    "trades_with": "{traded}: it trades with {other} (correlation {correlation:.2f}); known is"
    " {sum}",
    "given": "given",
    "undetermined": "undetermined",
    "weakening": "below 0: weakening",
    "weakening_all": "all states together; below 0: weakening",
    "moment": "moment of inertia",
    "reference": "reference velocity",
    "tests": "Tests for structure",
    "left": "is it left in the residual?",
    "tests_note": "p below {significant:g}: structure is left, not only noise (train block; by"
    " likelihood, the noise found anew with and without it; corrected for all that is asked, those"
    " of the figure location each by itself)",
    "candidates": "Models that were fitted",
    "candidates_note": "ΔBIC below 0: better than the base. An effect must lower it by more than"
    " 10. Of models as good the first is kept. It counts the train rows, which are fitted, and how"
    " well the select rows are predicted",
    "more_candidates": "; {more} more in loop.json",
    "model": "the model",
    "base": "the start",
    "passed": "on the way",
    "tried": "not taken",
    "impossible": "impossible parameters",
    "failed": "did not converge",
    "refused": "not taken: {why}",
    "as_good": "not taken: as good, BIC within {tie:g} of the model",
    "worse": "not taken: BIC {worse:.0f} worse than the model",
    "stretches": "The run's stretches",
    "level": "level{unit}: friction less that of the first stretch, fitted with the rest",
    "rests_on": "What each statement rests on",
    "rests_on_note": "Without these rows it would not be said. Of an effect they are few beside"
    " which the models with it and without it differ by less than a BIC of {accept:g}; directions"
    " and speeds are those commanded, or those of the axis",
}
"""Titles, cells and notes."""

APART: Mapping[str, str] = {
    "left": "more than noise is left",
    "others": "other joints move",
    "worse": "{other} (BIC {worse:.0f} worse)",
    "refit": "; a refit tells it from {others}",
    "not_told": "{id}: this record cannot tell it from {others}{would}{refit}",
    "would": "; what would: {changes}",
    "curve": "{id}: this record does not tell it from a steady curve of another shape"
    " ({why}){would}{refit}",
    "told": "{id}: this record tells it from every other effect{near}{refit}",
    "in_part": "{id}: {why}, so that it may stand for another effect in part{near}{refit}",
    "near": " (most alike: {near}, cosine {cosine:.2f})",
    "none": "no effect was added",
    "pair": "{a} or {b} ({cosine:.3f})",
    "pairs": "pairs that this record cannot tell apart: {pairs}",
    "no_pairs": "pairs that this record cannot tell apart: none",
    "by_parts": "split by {part}: {how}",
    "whole": "no {piece} is both fitted and held out",
    "cut": "the last {piece} reports, whole and never fitted; the {piece} before it is cut: its"
    " start is fitted, its end selects",
    "by_displacement": "the record has too few velocity steps to hold whole ones out: it was split"
    " by displacement into before, transient and tail. Fewer effects can be told apart: the"
    " aliasing matrix shows {pairs} that it cannot separate",
    "one_pair": "1 pair",
    "some_pairs": "{count} pairs",
    "zero_pairs": "no pairs",
}
"""What each effect is told from, and how the record was split."""
