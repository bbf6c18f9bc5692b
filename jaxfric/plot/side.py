"""Shared parts of the figures of a study: a parameter as an axis, and colours of codes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .palette import CODES, CYCLE, ESCAPE, OPEN, STABLE

if TYPE_CHECKING:
    from xarray import Dataset

_COLOURS: dict[str, str] = {
    "steady": STABLE,
    "stable": STABLE,
    "computed": STABLE,
    "limit_cycle": CYCLE,
    "unstable": CYCLE,
    "escape": ESCAPE,
    "failed": OPEN,
    "unresolved": OPEN,
    "error": ESCAPE,
}
_FAR = 8.0


class Side(NamedTuple):
    """A parameter as an axis of a figure: its values, its label and unit, SI."""

    values: np.ndarray
    label: tuple[str, str]
    log: bool


def side_of(found: "Dataset", name: str) -> Side:
    """A parameter of a study as an axis of a figure; the parameter may be a sampled column."""
    about = found[name]
    values = np.asarray(about.values, float)
    unit = about.attrs.get("units", "1")
    label = about.attrs.get("long_name", name)
    label = f"{label} {name}" if label != name else name
    log = about.attrs.get("spacing") == "log" or (about.dims == (name,) and by_factors(values))
    return Side(values, (label, unit), log)


def by_factors(values: np.ndarray) -> bool:
    """Whether listed values grow by factors (1, 3, 10) rather than by equal steps (1, 2, 3).

    Values that grow by factors are positive and span more than a factor of `_FAR`. The logarithms
    of such values are more evenly spaced than the values.
    """
    listed = np.unique(values)
    if len(listed) < 2 or listed[0] <= 0 or listed[-1] < _FAR * listed[0]:
        return False
    steps, factors = np.diff(listed), np.diff(np.log(listed))
    return bool(np.ptp(factors) / factors.mean() <= np.ptp(steps) / steps.mean())


def code_colours(names: Sequence[str]) -> dict[str, str]:
    """The colours of codes, by the name of each code, in the order of the codes."""
    colours = [_COLOURS.get(name) or CODES[k % len(CODES)] for k, name in enumerate(names)]
    return {name.replace("_", " "): colour for name, colour in zip(names, colours, strict=True)}
