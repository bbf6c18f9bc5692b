"""Numbers along logarithmic axes."""

import math

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, ScalarFormatter

_MANY_DECADES = 1.6


def whole_numbers(axes: Axes, which: str, *, most: int = 5, least: float = 0.0) -> None:
    """Write the numbers of a linear axis, "x" or "y", in full, without an offset "+3.036e2".

    The axis has at most `most` + 1 numbers. If the range of the axis is less than the fraction
    `least` of the middle value, the range is widened. So constant values look constant.
    """
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 2.5, 5, 10]))
    axis.set_major_formatter(ScalarFormatter(useOffset=False))
    low, high = sorted(axis.get_view_interval())
    middle = 0.5 * (low + high)
    wanted = least * abs(middle)
    if high - low < wanted:
        axes.set(**{f"{which}lim": (middle - 0.5 * wanted, middle + 0.5 * wanted)})


def plain_log(axes: Axes, which: str, size: float = 1.0) -> None:
    """Make an axis, "x" or "y", logarithmic, with numbers such as 0.1 or 1000, not as powers of 10.

    Each number on the axis is the drawn value times `size`, a power of 10. A short axis has at
    least two numbers, also if the limits of the axis change later.
    """
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_minor_locator(LogLocator(subs=range(2, 10)))

    def shown(x: float, place: int | None) -> str:
        del place
        low, high = sorted(axis.get_view_interval())
        digits = shown_digits(low, high)
        return _text(size * x) if not digits or f"{x:e}"[0] in digits else ""

    axis.set_major_formatter(FuncFormatter(shown))
    axis.set_minor_formatter(FuncFormatter(shown))


def shown_digits(low: float, high: float) -> str:
    """Leading digits of the ticks from `low` to `high` that have a number; "" for all ticks.

    A long axis with at least two powers of ten has numbers at powers of ten only. On a shorter
    axis, ticks at 2 and 5 times a power of ten have numbers too. If fewer than two numbers would
    result, every tick has a number.
    """
    if math.log10(high / low) > _MANY_DECADES and _count("1", low, high) > 1:
        return "1"
    return "125" if _count("125", low, high) > 1 else ""


def _count(digits: str, low: float, high: float) -> int:
    """Number of ticks from `low` to `high` with one of these leading digits and noughts."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [int(digit) * 10.0**power for power in powers for digit in digits]
    return sum(low * (1 - 1e-9) <= tick <= high * (1 + 1e-9) for tick in ticks)


def _text(x: float) -> str:
    if 1e-5 < x < 1e6:
        return f"{x:g}"
    digits, power = f"{x:e}".split("e")
    many = "" if float(digits) == 1 else rf"{float(digits):g}\times"
    return rf"${many}10^{{{int(power)}}}$"
