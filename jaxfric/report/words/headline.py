"""Words of the headline of a loop, and of which effects it distinguishes."""

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
