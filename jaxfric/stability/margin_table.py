"""The table of stability margins, with one entry for each margin.

To add a margin, write its function and an entry in this table. The following parts of jaxfric then
include the margin: `stability_margin`, `jaxfric stability`, requirements of `jaxfric gains`,
outputs of a study, figures and help texts. Each entry of the table gives only the name of a
function. So importing the table does not load JAX, and `jaxfric --help` stays fast.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ..errors import InputError


@dataclass(frozen=True)
class Margin:
    """Name and meaning of a margin, conditions for using it, and the function that computes it."""

    unit: str
    limit: float
    """Value at the limit of stability; a stable slider has more."""
    text: str
    """The margin in words, as in the outputs of a study."""
    function: str
    """Its function as "package.module:name", from a `margins.Analysis` to a scalar."""
    highest: float = math.inf
    """Upper bound of its values: requirements lie between `limit` and this."""
    zero: bool = False
    """Whether 0 may be required, which demands only stability."""
    needs_poles: bool = False
    """Whether it needs the poles, which a kernel given as a function of time does not have."""
    unless_late: str = ""
    """Reason why it is undefined with a controller delay, or empty."""
    unless_integral: str = ""
    """Reason why it is undefined with integral action, or empty."""
    unlimited: str = "no crossing"
    """Reason for the value inf."""

    @property
    def suffix(self) -> str:
        """The text after a number: a space and the unit, or nothing for a pure number."""
        return "" if self.unit == "1" else f" {self.unit}"


_HERE = "jaxfric.stability.margins:"
_CROSSES_NOT = "none: the loop's magnitude never crosses 1"
MARGINS: dict[str, Margin] = {
    "stiffness": Margin(
        "1",
        1.0,
        "stiffness margin, k_p over the critical stiffness",
        _HERE + "stiffness",
        unless_late="the critical stiffness is that of a spring, which has no delay",
        unless_integral="the critical stiffness is that of a spring, which does not integrate",
        unlimited="no critical stiffness: damping suffices",
    ),
    "decay": Margin(
        "1/s",
        0.0,
        "decay rate of the slowest pole",
        _HERE + "decay",
        zero=True,
        needs_poles=True,
    ),
    "damping": Margin(
        "1",
        0.0,
        "smallest damping ratio of a pole",
        _HERE + "damping",
        1.0,
        needs_poles=True,
        unless_late="the loop then has infinitely many poles, the faster the less damped",
    ),
    "modulus": Margin("1", 0.0, "modulus margin", _HERE + "modulus", 1.0),
    "gain": Margin(
        "1",
        1.0,
        "gain margin",
        _HERE + "gain",
        unlimited="none: no gain factor reaches instability",
    ),
    "phase": Margin("rad", 0.0, "phase margin", _HERE + "phase", math.pi, unlimited=_CROSSES_NOT),
    "delay": Margin("s", 0.0, "delay margin", _HERE + "delay", unlimited=_CROSSES_NOT),
}


def known_margin(name: str) -> Margin:
    """Return the entry of the margin `name`.

    Raises
    ------
    InputError : no such margin; all names are listed.
    """
    if name not in MARGINS:
        raise InputError(f"margin '{name}' does not exist; there are: {', '.join(MARGINS)}")
    return MARGINS[name]


def meaningless(name: str, *, late: bool, integral: bool) -> str:
    """Reason in words why a margin is undefined with the given controller, or empty."""
    one = MARGINS[name]
    if late and one.unless_late:
        return f"a controller delay: {one.unless_late}"
    if integral and one.unless_integral:
        return f"integral action: {one.unless_integral}"
    return ""


def refuse_meaningless(names: Iterable[str], *, late: bool, integral: bool) -> None:
    """Raise `InputError` for the first margin that is undefined with the given controller."""
    for name in names:
        if reason := meaningless(name, late=late, integral=integral):
            raise InputError(
                f"margin {name} has no meaning with {reason}."
                " Require modulus=0.5, gain, phase or delay"
            )


def named_with_units() -> str:
    """List the names of all margins with their units, if any, such as "decay (1/s), damping"."""
    return ", ".join(n if m.unit == "1" else f"{n} ({m.unit})" for n, m in MARGINS.items())
