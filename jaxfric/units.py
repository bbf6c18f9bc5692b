"""Conversion of text with a unit to a number in SI.

All other code uses SI. The package pint parses uncommon units, and is loaded on the first such
unit. Common spellings of laboratories are understood: um, µm, micron(s), microns/s, sec, MPa, s^-1,
1, -.
"""

import functools
import math
import re
from typing import TYPE_CHECKING, TypeVar

from .errors import InputError, did_you_mean

if TYPE_CHECKING:
    import numpy as np
    import pint

_Values = TypeVar("_Values", float, "np.ndarray")

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NO_UNIT = {"", "1", "-", "--", ".", "none", "dimensionless", "unitless", "n/a", "coefficient"}
_NEWTON_PER_AMPERE = "N/A"
"""Means "not available" if the expected quantity is dimensionless."""
_MACHINE = {"bit", "bits", "count", "counts", "cts", "ticks", "lsb", "adu", "raw"}
_MICRO = re.compile(r"\bum\b")
_ANGLE = re.compile(r"rad|deg|rev|turn|rpm")
_TORQUE = re.compile(r"(?<![A-Za-z])([mkuµμ]?N)\s?[-.* ]?\s?([cm]?m)(?![A-Za-z])")
_DAMPER = re.compile(r"(?<![A-Za-z])([mkuµμ]?N)-?m-?s(?![A-Za-z])")
_EXAMPLES = {"s": "10 s", "m": "20 um", "m/s": "2 um/s", "1/m": "1.6e-3/um", "N": "5 N"}
_EXAMPLES |= {"Pa": "25 MPa", "N/m": "1e6 N/m", "N*s/m": "10 N*s/m", "kg": "2 kg", "Hz": "100 Hz"}
_COMMON = {
    "": ("1", 1.0),
    **{unit: ("s", size) for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6))},
    **{unit: ("m", size) for unit, size in (("m", 1.0), ("mm", 1e-3), ("um", 1e-6))},
    **{unit: ("m/s", size) for unit, size in (("m/s", 1.0), ("mm/s", 1e-3), ("um/s", 1e-6))},
    **{unit: ("1/m", size) for unit, size in (("1/m", 1.0), ("1/mm", 1e3), ("1/um", 1e6))},
    **{unit: ("N", size) for unit, size in (("N", 1.0), ("mN", 1e-3), ("kN", 1e3))},
    **{unit: ("Pa", size) for unit, size in (("Pa", 1.0), ("kPa", 1e3), ("MPa", 1e6))},
    **{unit: ("N/m", size) for unit, size in (("N/m", 1.0), ("N/mm", 1e3), ("N/um", 1e6))},
    **{unit: ("kg", size) for unit, size in (("kg", 1.0), ("g", 1e-3))},
}
"""SI unit and size of common units, which need no pint (it takes half a second to load)."""
_COMMON_SI = {si for si, _ in _COMMON.values()}
_KNOWN = [*_COMMON, "min", "hour", "nm", "cm", "micron", "MN", "GPa", "Hz", "kHz", "bar", "psi"]
"""Units that are proposed in place of a misspelt one."""


class WrongDimension(InputError):
    """The unit of a quantity has another dimension than the expected unit."""


def parse_quantity(text: str, si_unit: str, what: str) -> float:
    """Read the value of `text`, such as "2.289 um/s" or "1.6e-3/um", in `si_unit`.

    **Arguments:** `what` names the quantity in errors. A number without a unit is accepted only if
    `si_unit` is "1".

    Raises `InputError` for a missing number, and for a missing, unknown or wrong unit.
    """
    text = text.strip()
    number, unit = _split(text, what)
    if number is None:
        raise InputError(f"{what}: '{text}' has no number; write it as in '{_example(si_unit)}'")
    if not unit and si_unit != "1":
        raise InputError(
            f"{what}: '{text}' has no unit; expected a unit of {si_unit},"
            f" as in '{_example(si_unit)}'"
        )
    value = float(scale(number, _unit_factor(unit, si_unit, what)))
    if not math.isfinite(value):
        raise InputError(f"{what}: '{text}' is too large to be a number")
    return value


_PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
_UNPREFIXED = re.compile(r"kg|%|1\b|$")
_NEVER_KILO = {"s", "m", "m/s", "rad", "rad/s"}


def prefix(value: float, unit: str) -> tuple[float, str]:
    """Size and name of the unit in which a value is a number from 1 to 1000: 1e3, "kN/m".

    Kilograms, percent and pure or reciprocal numbers have no prefix. Times, lengths, angles and
    their rates have none above 1.
    """
    unit = unit.replace("*", " ")
    if _UNPREFIXED.match(unit) or not 0 < abs(value) < math.inf:
        return 1.0, unit
    power = 3 * math.floor(math.log10(abs(value)) / 3 + 1e-9)
    power = min(max(power, -9), 0 if unit in _NEVER_KILO else 9)
    return 10.0**power, _PREFIXES[power] + unit


def prefixed(value: float, unit: str, digits: int = 4) -> str:
    """Format a value with the prefix of its unit: "1.757 kN/m"; the unit "1" is not shown."""
    size, shown = prefix(value, unit)
    return with_unit(f"{value / size:.{digits}g}", shown)


def with_unit(text: str, unit: str) -> str:
    """A number and its unit; the unit "1" of a pure number is not shown."""
    return text if unit in _NO_UNIT else f"{text} {unit}"


def parse_values(text: str, si_unit: str, what: str, *, count: int = 25) -> list[float]:
    """Read positive values from a text, in `si_unit`, ascending: one, a list, or a range.

    "5 um/s" is one value, "1, 2, 5 um/s" a list and "1e-6..1e-3 m/s" a range of `count` log-spaced
    values. Every number may have a unit; a number without a unit has the unit of the last number.

    Raises `InputError` for any other text, an empty or reversed range, and a value that is not
    positive.
    """
    apart = ".." if ".." in text else ","
    pieces = [piece.strip() for piece in text.split(apart)]
    if not all(pieces) or (apart == ".." and len(pieces) != 2):
        raise InputError(
            f"{what}: '{text}' is not a value, list or range; write it as in"
            f" '{_example(si_unit)}', '1, 2 {si_unit}' or '1..100 {si_unit}'"
        )
    unit = _split(pieces[-1], what)[1]
    whole = [p if _split(p, what)[1] or not unit else f"{p} {unit}" for p in pieces]
    values = [parse_quantity(piece, si_unit, what) for piece in whole]
    for value, piece in zip(values, pieces, strict=True):
        if not value > 0:
            raise InputError(f"{what}: '{piece}' is not positive")
    if apart == ",":
        return sorted(set(values))
    low, high = values
    if not low < high:
        raise InputError(f"{what}: the range '{text}' is empty; write the smaller value first")
    ratio = math.log(high / low)
    return [low, *(low * math.exp(ratio * i / (count - 1)) for i in range(1, count - 1)), high]


def factor(unit_text: str, si_unit: str, what: str) -> float:
    """Size of one `unit_text` in `si_unit`. The unit may contain a factor: "0.0764 um".

    Raises `InputError` for an unknown unit and for a unit of another dimension.
    """
    number, unit = _split(unit_text, what)
    value = (1.0 if number is None else number) * _unit_factor(unit, si_unit, what)
    if value == 0 or not math.isfinite(value):
        raise InputError(f"{what}: the unit '{unit_text}' has a factor of {value:g}")
    return value


def scale(values: _Values, size: float) -> _Values:
    """Return values * size, by division if 1/size is an integer: 10 um is exactly 1e-5 m."""
    whole = round(1 / size) if 0 < abs(size) < 1 else 0
    exact = whole != 0 and math.isclose(whole * size, 1, rel_tol=1e-15)
    return values / whole if exact else values * size  # ty: ignore[invalid-explicit-return]


def unit_in(text: str) -> str:
    """Return the unit in the text of a quantity, a list or a range; "" if there is none."""
    return _split(re.split(r",|\.\.", text)[-1])[1]


def is_angle(unit: str) -> bool:
    """Whether a unit contains an angle by name: "rad/s" does, "1/s" does not."""
    return _ANGLE.search(unit) is not None


def is_unit(text: str) -> bool:
    """Whether `text` is a known unit, a machine unit, or a sign for no unit."""
    number, unit = _split(text)
    if unit.lower() in _NO_UNIT | _MACHINE or unit in _COMMON:
        return True
    try:
        return number is not None or _parse(unit) is not None
    except InputError:
        return False


def has_dimension(unit_text: str, si_unit: str) -> bool:
    """Whether `factor(unit_text, si_unit, ...)` would succeed."""
    try:
        factor(unit_text, si_unit, "")
    except InputError:
        return False
    return True


def format_si(value: float, si_unit: str, shown_unit: str, digits: int = 4) -> str:
    """`value` [si_unit] as text in `shown_unit`: format_si(2e-6, "m/s", "um/s") is "2 um/s"."""
    shown = value / factor(shown_unit, si_unit, "shown unit")
    return with_unit(f"{shown:.{digits}g}", shown_unit)


def read_as(text: str) -> str:
    """Replace typed units in a text by printed ones: "2 um/s" becomes "2 µm/s"."""
    return _MICRO.sub("µm", text)


def _split(text: str, what: str = "unit") -> tuple[float | None, str]:
    """Split off a leading number, if any; return it and the unit in pint's spelling."""
    text = text.strip()
    match = _NUMBER.match(text)
    if match is None:
        return None, _spelling(text)
    rest = text[match.end() :].strip()
    if rest[:1] in (",", "."):
        raise InputError(f"{what}: '{text}': write numbers with a decimal point and no separators")
    return float(match.group()), _spelling("1" + rest if rest.startswith("/") else rest)


def _spelling(unit: str) -> str:
    """Convert spellings of practice to pint's: micro signs, `s-1`, a middle dot for times."""
    unit = unit.strip().replace("µ", "u").replace("μ", "u").replace("·", "*").replace("−", "-")
    if unit.lower() in _NO_UNIT and unit != _NEWTON_PER_AMPERE:
        return ""
    unit = re.sub(r"\b(microns|mic)\b", "micron", unit)
    unit = turning(unit)
    return re.sub(r"(?<=[A-Za-z])(-?\d)\b", r"^\1", unit)


def turning(unit: str) -> str:
    """Convert torques and rotations to pint's spelling: mNm, N-m, Nms/rad, rev."""
    unit = _DAMPER.sub(r"\1*m*s", unit)
    unit = _TORQUE.sub(r"\1*\2", unit)
    return re.sub(r"\b(rev|rot)\b", "turn", unit)


@functools.lru_cache(maxsize=256)
def _unit_factor(unit: str, si_unit: str, what: str) -> float:
    """Size of one `unit` in `si_unit`."""
    if unit.lower() in _MACHINE:
        raise InputError(
            f"{what}: '{unit}' is a machine unit; give the size of one,"
            f" as in '[0.01 {_EXAMPLES.get(si_unit, '1 N').split()[-1]}]'"
        )
    if unit == _NEWTON_PER_AMPERE and si_unit == "1":
        unit = ""
    turns = 2 * math.pi if si_unit == "Hz" and _ANGLE.search(unit) else 1.0  # rad/s, 1/min turns
    if unit in _COMMON and si_unit in _COMMON_SI:
        known, size = _COMMON[unit]
        if known != si_unit:
            raise _wrong_dimension(unit, si_unit, what)
        return size
    quantity = _parse(unit, what)
    try:
        wanted = _registry().Unit("" if si_unit == "1" else si_unit)
        return float(quantity.to(wanted).magnitude) / turns
    except Exception as error:
        if "dimension" not in type(error).__name__.lower():
            raise
        raise _wrong_dimension(unit, si_unit, what) from None


def _wrong_dimension(unit: str, si_unit: str, what: str) -> WrongDimension:
    found = f"'{unit}' is not" if unit else "a pure number is not"
    wanted = "dimensionless" if si_unit == "1" else f"a unit of {si_unit}"
    return WrongDimension(f"{what}: {found} {wanted}; write it as in '{_example(si_unit)}'")


def _parse(unit: str, what: str = "unit") -> "pint.Quantity":
    """One `unit` as a pint quantity; raises an `InputError` that names the nearest known unit."""
    registry = _registry()
    try:
        return 1.0 * registry.parse_expression(unit) if unit else registry.Quantity(1.0, "")  # ty: ignore[invalid-explicit-return]
    except Exception:  # pint raises a dozen kinds for text that is not a unit
        hint = did_you_mean(unit, _KNOWN, listed=False)
        raise InputError(f"{what}: '{unit}' is not a known unit{hint}") from None


@functools.lru_cache(maxsize=1)
def _registry() -> "pint.UnitRegistry":
    """The only registry; its definitions are cached on disk if possible."""
    import pint

    try:
        return pint.UnitRegistry(cache_folder=":auto:")
    except Exception:  # no home, a read-only or full disk, a damaged cache: use no cache
        return pint.UnitRegistry()


def _example(si_unit: str) -> str:
    return _EXAMPLES.get(si_unit, "0.6" if si_unit == "1" else f"1 {si_unit}")


def duration(seconds: float) -> str:
    """A time in s, min or h, with three digits."""
    if seconds < 600:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 36000 else f"{seconds / 3600:.3g} h"


def between(low: float, high: float, unit: str, *, digits: int = 3) -> str:
    """A range in words, "2 to 5 s"; one number if both ends round to the same."""
    ends = [f"{value:.{digits}g}" for value in (low, high)]
    return f"{ends[0]} {unit}" if ends[0] == ends[1] else f"{ends[0]} to {ends[1]} {unit}"


_LARGE = 3
"""A value is written with an exponent if its error is 10 to this power or more."""


def decimals(std: float) -> int:
    """Decimal places that show two digits of a standard deviation."""
    if not math.isfinite(std) or std <= 0:
        return 6
    return min(max(1 - math.floor(math.log10(std)), 0), 12)


def measured(value: float, error: float, *, short: bool = False) -> str:
    """A value with its standard error in brackets, in units of the last digit: 0.00592(29).

    The standard error has two digits. With `short` the error has one digit, or two digits if the
    first digit is a 1. Large numbers have an exponent, as 3.34(36)e8. Without an error the value
    has four digits.
    """
    if not (math.isfinite(error) and error > 0):
        return f"{value:.4g}"
    digits = 1 if short and not f"{error:.1e}".startswith("1") else 2
    power = int(f"{error:.{digits - 1}e}".partition("e")[2])  # power of ten of the rounded error
    last = power - digits + 1
    if power < _LARGE:
        places = min(max(-last, 0), 12)
        if short and last > 0:
            value, error = (round(x, -last) for x in (value, error))
        return f"{value:.{places}f}({round(error * 10**places)})"
    whole = math.floor(math.log10(max(abs(value), error)))
    return f"{value / 10**whole:.{whole - last}f}({round(error / 10**last)})e{whole}"


def p_text(p: float) -> str:
    """A p-value as text: "p = 0.03". A tiny p-value is given as an upper bound."""
    if not math.isfinite(p):
        return "p unknown"
    return "p < 1e-12" if p < 1e-12 else f"p = {p:.2g}"
