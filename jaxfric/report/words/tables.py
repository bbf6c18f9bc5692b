"""Words of the first lines and tables of a loop, and of which effects it distinguishes."""

from collections.abc import Mapping

HEADLINE: Mapping[str, str] = {
    "no_missing_effect": "No effect is missing",
    "effects": "Missing: {effects}",
    "curve": "a curve of velocity whose shape is not determined",
    "ambiguous": "An effect is missing, but this record cannot say which",
    "one_of": "Missing: {either} (this record cannot say which)",
    "also_one_of": "Missing: {effects}; also {either} (this record cannot say which)",
    "not_confirmed": "Missing: {effects}, not confirmed",
    "outside": "Something is missing that the catalogue does not explain",
    "beyond": "Beyond {effects} something is missing that the catalogue does not explain",
    "outside_unfixed": "Something is missing that this record does not determine",
    "beyond_unfixed": "Beyond {effects} something is missing that this record does not determine",
    "too_weak": "The evidence is too weak to name an effect",
    "base_misses": "The test rows are missed, and no effect is supported",
}
"""The verdict in a few words."""

ANSWER: Mapping[str, str] = {
    "doubted": "these rows do not determine it, though the residual of {fitted} looks like noise",
    "base": "{base}; nothing else is missing",
    "base_model": "{base} (of the base model alone)",
    "of_base": "base model, as the effects added predict the test rows worse: {friction}",
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
"""The first lines, most of them on an axis."""

TABLE: Mapping[str, str] = {
    "train": "train: fitted",
    "select": "select: validation, used to choose the model",
    "report": "report: test, evaluated once",
    "errors": "Error before and after",
    "errors_note": "σ, the noise of a row, is {sigma}; a perfect model scores about 1 σ{target}."
    " Noise is {noise}",
    "target": "; the report block is consistent with noise up to {most:.2f} σ",
    "by_velocity": "Error in every {part}",
    "no_row": "no row counts",
    "moved": "Parameters",
    "shift": "shift: after minus before, in standard deviations of the fit after",
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
    "model": "final model",
    "base": "base",
    "passed": "intermediate",
    "tried": "not accepted",
    "impossible": "impossible parameters",
    "failed": "did not converge",
    "refused": "not accepted: {why}",
    "stretches": "The run's stretches",
    "level": "level{unit}: friction relative to the first stretch, fitted with the rest",
    "rests_on": "What each statement rests on",
    "rests_on_note": "Without these rows the statement could not be made. Of an effect they are"
    " the fewest whose loss brings the models with and without it within a BIC of {accept:g}."
    " Directions and speeds are those commanded, or those of the axis",
}
"""Titles, cells and notes."""

APART: Mapping[str, str] = {
    "not_told": "{id}: this record cannot distinguish it from {others}",
    "curve": "{id}: this record does not distinguish it from a steady curve of another shape"
    " ({why}){decides}",
    "decides": "; {where} would",
    "told": "{id}: this record distinguishes it from every other effect",
    "in_part": "{id}: this model is not complete, so it may partly stand for another effect",
    "pair": "{a} or {b} ({cosine:.3f})",
    "pairs": "pairs that this record cannot distinguish: {pairs}",
    "by_displacement": "The record has too few velocity steps to hold out whole ones, so it was"
    " split by displacement into before, transient and tail. Fewer effects can be distinguished.",
}
"""What each effect is told from, and how the record was split."""
