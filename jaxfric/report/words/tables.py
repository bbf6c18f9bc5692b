"""Words of the tables of a loop: headlines, roles, notes, and which effects are distinguished."""

from collections.abc import Mapping

HEADLINE: Mapping[str, str] = {
    "no_missing_effect": "No effect is missing",
    "effects": "Missing: {effects}",
    "curve": "a curve of velocity whose shape is not determined",
    "ambiguous": "An effect is missing, but this record cannot say which",
    "one_of": "Missing: {effects}; this record cannot say which",
    "not_confirmed": "Missing: {effects}, not confirmed",
    "outside_catalogue": "Something is missing that the catalogue does not explain",
    "beyond": "Beyond {effects} something is missing that the catalogue does not explain",
    "unfixed": "Something is missing that this record does not determine",
    "beyond_unfixed": "Beyond {effects} something is missing that this record does not determine",
    "too_weak": "The evidence is too weak to name an effect",
    "base_misses": "The test rows are missed, and no effect is supported",
}
"""The verdict in a few words."""

ANSWER: Mapping[str, str] = {
    "doubted": "these rows do not determine it, though the residual of {fitted} looks like noise",
    "base": "{base}; nothing else is missing",
    "base_model": "{base} (of the base model alone)",
    "effects": "{base}; also found: {effects}",
    "friction": "friction: {found}",
    "not_sure": "not sure: {doubt}",
    "test_error": "test error: {errors} sigma (test block only; noise alone gives 1)",
    "F_c": "Coulomb",
    "F_v": "viscous",
    "M": "mass",
    "inertia": "inertia",
    "effect": "{id} ({meaning})",
}
"""The first lines on an axis."""

TABLE: Mapping[str, str] = {
    "train": "train: fitted",
    "select": "select: validation, used to choose the model",
    "report": "report: test, evaluated once",
    "errors": "Error before and after",
    "errors_note": "{sigma}; {lowest}{target}. Noise is {noise}{bound}",
    "not_below": "a perfect model scores about 1 σ",
    "below": "a fitted model brings the error of the fitted rows to {least:.2g} σ, so a part of"
    " what is taken for noise is not noise",
    "target": "; the report block is consistent with noise up to {most:.2f} σ",
    "sigma": "σ = {here} is the noise of a {row}",
    "sigmas": "σ is the noise of a {row}: {here} where the model is fitted, {later} in rows held"
    " out",
    "bound": "; correlation longer than {bound} does not count as noise",
    "no_row": "no row counts",
    "largest_errors": "the {most} of {all} with the largest errors after; all are in loop.html",
    "shift": "shift: after minus before, in standard deviations of the fit after",
    "rivals_covered": "± and intervals include the spread between the model and its rivals",
    "known_less": "± uses friction and {columns}; a fit of friction alone is less certain",
    "traded": "{name} is {value}{own}, though it was determined before",
    "own_error": " (± {own} in this model alone)",
    "nothing_takes": "{traded}: no parameter of an effect alone takes its place",
    "trades_with": "{traded}: it trades with {other} (correlation {correlation:.2f}); determined"
    " is {sum}",
    "given": "given",
    "undetermined": "undetermined",
    "weakening": "below 0: weakening",
    "weakening_all": "all states together; below 0: weakening",
    "moment": "moment of inertia",
    "reference": "reference velocity",
    "tests": "Tests for structure",
    "left": "does structure remain in the residual?",
    "tests_note": "p below {significant:g}: structure remains, not only noise (likelihood-ratio"
    " tests on the train block, the noise fitted with and without the structure, corrected for"
    " the number of tests; those of the figure location are single tests)",
    "candidates": "Models that were fitted",
    "candidates_note": "ΔBIC below 0: better than the base. An effect must lower it by more than"
    " 10; of equally good models the first is kept. It counts the fit of the train rows and the"
    " prediction of the select rows",
    "more_candidates": "; {more} more in loop.json",
    "model": "final model",
    "base": "base",
    "passed": "intermediate",
    "tried": "not accepted",
    "impossible": "impossible parameters",
    "failed": "did not converge",
    "refused": "not accepted: {why}",
    "as_good": "not accepted: as good, BIC within {tie:g} of the model",
    "worse": "not accepted: BIC {worse:.0f} worse than the model",
    "stretches": "The run's stretches",
    "level": "level{unit}: friction relative to the first stretch, fitted with the rest",
    "rests_on": "What each statement rests on",
    "rests_on_note": "Without these rows the statement could not be made. Of an effect they are"
    " the fewest whose loss brings the models with and without it within a BIC of {accept:g}."
    " Directions and speeds are those commanded, or those of the axis",
}
"""Titles, cells and notes."""

APART: Mapping[str, str] = {
    "left": "structure remains in the residual",
    "others": "other joints move",
    "worse": "{other} (BIC {worse:.0f} worse)",
    "refit": "; a refit distinguishes it from {others}",
    "not_told": "{id}: this record cannot distinguish it from {others}{would}{refit}",
    "would": "; a run that would: {changes}",
    "curve": "{id}: this record does not distinguish it from a steady curve of another shape"
    " ({why}){would}{refit}",
    "told": "{id}: this record distinguishes it from every other effect{near}{refit}",
    "in_part": "{id}: {why}, so it may partly stand for another effect{near}{refit}",
    "near": " (most alike: {near}, cosine {cosine:.2f})",
    "none": "no effect was added",
    "pair": "{a} or {b} ({cosine:.3f})",
    "pairs": "pairs that this record cannot distinguish: {pairs}",
    "no_pairs": "pairs that this record cannot distinguish: none",
    "by_parts": "split by {part}: {how}",
    "whole": "no {piece} is both fitted and held out",
    "cut": "the last {piece} is the test block, whole and never fitted; the {piece} before it is"
    " cut: its start is fitted, its end validates",
    "by_displacement": "the record has too few velocity steps to hold out whole ones, so it was"
    " split by displacement into before, transient and tail. Fewer effects can be distinguished:"
    " the aliasing matrix shows {pairs} that it cannot separate",
    "one_pair": "1 pair",
    "some_pairs": "{count} pairs",
    "zero_pairs": "no pairs",
}
"""What each effect is told from, and how the record was split."""
