"""State the friction parameters of a result in one line: a - b, a, b, D_c and their errors."""

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from ..fitting import Estimate
from ..records import Record
from ..units import decimals, factor, measured, read_as, with_unit

UNDETERMINED = "undetermined"
_MOST_PLACES = 6
"""Decimal places beyond which a number has an exponent."""

ROCK_NAMES = {"A": "a", "B": "b", "L": "D_c"}
"""The parameters of a law by their names in rock mechanics."""
STATE = re.compile(r"(?:second_state\.)?([ABL])(\d*)")
"""Parameters of the law and of a second state by their letter, with the number of the state."""


def friction_line(rate: Estimate, parameters: Mapping[str, Estimate], length: str) -> str:
    """Line such as "a - b = −0.01101(1), a = ..., b = ..., D_c = ... µm: velocity weakening."

    `rate` is the rate dependence, A minus the sum of all B ("a - b - b2" with two states). Lengths
    are in the unit `length`.
    """
    own = {
        ROCK_NAMES[m[1]] + m[2]: known
        for name, known in parameters.items()
        if (m := STATE.fullmatch(name))
    }
    states = sorted(name for name in own if name[0] == "b")
    shown = {" - ".join(("a", *(states or ["b"]))): rate}
    shown |= {name: own[name] for name in sorted(own, key=lambda name: "abD".index(name[0]))}
    told = [
        f"{name} {'=' if _known(estimate) else 'is'} {with_error(estimate, length)}"
        for name, estimate in shown.items()
    ]
    return f"{', '.join(told)}: {_SIGNS[sign_of(rate)]}."


def with_error(estimate: Estimate, length: str) -> str:
    """An estimate with its standard error in brackets, and its unit; or "not known"."""
    if not _known(estimate):
        return "not known"
    unit, size = shown_unit(estimate, length)
    text = measured(estimate.value / size, estimate.std / size, short=True).replace("-", "−")
    return with_unit(text, unit)


def _known(estimate: Estimate) -> bool:
    return estimate.free and estimate.determined


def sign_of(rate: Estimate) -> int:
    """The sign of A - B where its 95 % interval has one sign, else 0. An interval with one open end
    does not determine A - B, but may give its sign."""
    known = rate.determined or math.isinf(rate.std)
    return int(known and rate.lower > 0) - int(known and rate.upper < 0)


_SIGNS = {
    -1: "velocity weakening",
    0: "whether velocity weakens friction is not known",
    1: "velocity strengthening",
}


def bracketed(estimate: Estimate, *, short: bool = False) -> str:
    """An estimate in SI with its standard error in brackets; or "undetermined"."""
    known = estimate.determined and math.isfinite(estimate.std)
    return measured(estimate.value, estimate.std, short=short) if known else UNDETERMINED


class Row(NamedTuple):
    """One parameter in display units; text only, ready for a table."""

    name: str
    meaning: str
    value: str
    std: str
    interval: str
    unit: str

    @property
    def shown(self) -> str:
        """Value and standard error with the unit, such as "14.3 ± 1.3 µm"."""
        error = f" ± {self.std}" if self.std else ""
        return (
            self.value
            if self.value == UNDETERMINED
            else f"{self.value}{error} {self.unit}".rstrip()
        )


def cells(estimate: Estimate, size: float) -> tuple[str, str, str]:
    """Value, standard error and 95 % interval of an estimate in a unit of `size`."""
    if not estimate.free:
        return f"{estimate.value / size:.6g}", "", "fixed"
    if not (estimate.determined and math.isfinite(estimate.value)):
        return UNDETERMINED, "", ""
    return interval_cells(estimate.value, estimate.std, estimate.lower, estimate.upper, size)


def interval_cells(
    value: float, std: float, low: float, high: float, size: float = 1.0
) -> tuple[str, str, str]:
    """Format value, standard error and interval in a unit of `size`; the error sets the digits.

    Numbers with more than six decimal places have an exponent.
    """
    numbers = [x / size for x in (value, std, low, high)]
    places, power, exponent = decimals(numbers[1]), 0, ""
    if places > _MOST_PLACES:
        power = math.floor(math.log10(max(map(abs, numbers[:2]))))
        places, exponent = max(places + power, 0), f"e{power}"
    mean, error, *ends = (
        f"{x / 10.0**power:.{places}f}{exponent}".replace("-", "−") for x in numbers
    )
    return mean, error, " to ".join(ends)


def signed(value: float) -> str:
    """A difference with its sign."""
    return f"{value:+.1f}".replace("-", "−")


def shown_unit(estimate: Estimate, length: str) -> tuple[str, float]:
    """The unit in which a parameter is shown, and the size of that unit in SI.

    Lengths and velocities are in the record's `length`, angles in rad, short times in milliseconds.
    """
    unit = estimate.unit.replace("*", " ").strip().removeprefix("1 ")
    size = 1.0 if length == "rad" else factor(length, "m", "length")
    if unit in ("m", "m/s"):
        shown = length if unit == "m" else f"{length}/s"
    elif unit.endswith("/m"):
        small = 0 < abs(estimate.value) * size < 1e-4
        length, size = ("mm", 1e-3) if small else (length, size)
        shown, size = f"{unit.removesuffix('/m')}/{length}", 1 / size
    elif unit == "s" and abs(estimate.value) < 0.1:
        shown, size = "ms", 1e-3
    else:
        shown, size = "" if unit == "1" else unit, 1.0
    return read_as(shown), size


def length_of(record: Record) -> str:
    """Return the symbol of the record's unit of length; "um" for a unit such as "0.05 um"."""
    told = record.units.get("load_point_displacement", "um")
    if told == "rad":
        return told
    size = factor(told, "m", "length")
    names = ("nm", "um", "mm", "cm", "m")
    return next((name for name in names if math.isclose(size, factor(name, "m", ""))), "um")
