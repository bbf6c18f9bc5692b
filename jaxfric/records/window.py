"""Windows of a record between two times or two displacements of the load point."""

import numpy as np

from ..errors import InputError, option
from ..units import has_dimension, parse_quantity

Bound = float | str | None
"""Seconds since the first row, or text with a unit: "120 s", "2 min", "9500 um"; None: no bound."""


def bounds(
    time: np.ndarray, moved: np.ndarray | None, start: Bound, stop: Bound, path: str
) -> tuple[float, float]:
    """Return start and end of a window as times since the first row [s].

    A displacement, in either direction, is converted to the time at which `moved` [m] first reaches
    this displacement. For an axis, which moves back and forth, `moved` is None and only times are
    accepted.

    Raises `InputError` for text that is neither a time nor a length, a length for an axis, a length
    that the load point does not reach, and an end that is not after the start.
    """
    relative = time - time[0]

    def seconds(bound: float | str, name: str) -> float:
        if not isinstance(bound, str):
            if not np.isfinite(bound):
                raise InputError(f"{path}: {name} is {bound}; give seconds since the first row")
            return float(bound)
        if not has_dimension(bound, "m"):
            value = parse_quantity(bound, "s", f"{name} (a time such as '120 s', or '9500 um')")
            if not 0 <= value <= relative[-1]:
                raise InputError(
                    f"{path}: {name} '{bound}' lies outside the record, which lasts"
                    f" {relative[-1]:.6g} s (times count from the first row)"
                )
            return value
        if moved is None:
            raise InputError(f"{path}: {name} '{bound}': an axis goes back and forth; give a time")
        value = parse_quantity(bound, "m", name)
        reached = np.maximum.accumulate(np.abs(moved - moved[0]))
        if not 0 <= value <= reached[-1]:
            raise InputError(
                f"{path}: {name} '{bound}' lies outside the record, whose load point moves by"
                f" {1e6 * reached[-1]:.6g} um (from the first row)"
            )
        return float(relative[np.searchsorted(reached, value)])

    low = 0.0 if start is None else seconds(start, option("from"))
    high = float(relative[-1]) if stop is None else seconds(stop, option("to"))
    if not low < high:
        raise InputError(
            f"{path}: the window from {low:.6g} to {high:.6g} s is empty; the record lasts"
            f" {relative[-1]:.6g} s"
        )
    return low, high
