"""Convert files of earlier versions to the current form; all renamed keys are listed here.

Changes from version 1 to 2 (a fit, a loop or steady curves): some keys have other names.
`delta_bic` is negative if a model is better than the base; in version 1 it was positive. A
parameter with a given value has no std and no interval; in version 1 its std was 0. The support of
a finding has keys; in version 1 of a fit and of steady curves it was a list. Files before version 2
may have old ids of effects.
"""

from collections.abc import Mapping
from typing import Any

from ..effects.effect import id_of
from ..schemas import FIT, LOOP, STEADY

_NOW = {"jaxfric.fit/1": FIT, "jaxfric.loop/1": LOOP, "jaxfric.steady/1": STEADY}
_VARIABLES = {"wavelength": "periodic_in_slip", "relaxation_length": "slip_since_step"}
_KEYS = {
    **_VARIABLES,
    "fault": "code",
    "heldout_rms": "validation_rms",
    "most_held_out": "held_out_threshold",
    "refused": "rejection",
}
_KEYS_OF: Mapping[str, Mapping[str, str]] = {
    "axis": {"width": "sign_width", "reach": "least_slip_length", "bears": "longest_delay"},
    "noise": {
        "longest": "max_correlation",
        "pace": "rate",
        "scale": "gain",
        "recorded_steps": "quantisation_step",
        "glitches": "outliers",
    },
}
"""Keys of version 1 and their current names: in every table, and in single entries."""
_SUPPORT = ("direction", "rows", "slowest", "fastest")
"""Keys of the support of a finding, in the order of the former list."""


def upgraded(content: Any) -> Any:
    """Return the content of a file of an earlier version in the current form.

    Other content is returned unchanged.
    """
    known = content.get("schema") if isinstance(content, dict) else None
    if known not in _NOW:
        return content
    table = {**_now(content, _KEYS), "schema": _NOW[known]}
    if "supported" not in table and _worse(table):
        table["supported"] = "before"
        table.pop("friction_law", None)  # made anew from the model before
    return table


def _worse(table: Mapping[str, Any]) -> bool:
    """Whether added effects predict the test rows worse than the base (`Loop.supported`)."""
    try:
        before, after = (table[when]["in_sigma"]["report"] for when in ("before", "after"))
        return table["verdict"] == "outside_catalogue" and after > before
    except (KeyError, TypeError):
        return False


def _now(value: Any, keys: Mapping[str, str]) -> Any:
    """Convert a value of a file, recursively, to version 2; `keys` are renamed."""
    if isinstance(value, str):
        return id_of(value)
    if isinstance(value, list):
        return [_now(one, keys) for one in value]
    if not isinstance(value, dict):
        return value
    table = {
        id_of(keys.get(key, key)): _now(one, {**_KEYS, **_KEYS_OF.get(key, {})})
        for key, one in value.items()
    }
    if isinstance(change := table.get("delta_bic"), int | float):
        table["delta_bic"] = 0.0 - change
    if isinstance(variable := table.get("variable"), str):
        table["variable"] = _VARIABLES.get(variable, variable)
    if isinstance(support := table.get("support"), list):
        rows = [one for one in support if isinstance(one, list)]
        table["support"] = [dict(zip(_SUPPORT, one, strict=False)) for one in rows] or support
    nothing_known = {"std", "lower", "upper"} if table.get("free") is False else set()
    return table | dict.fromkeys(nothing_known & table.keys())
