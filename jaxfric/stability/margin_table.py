"""The stability margins, one entry each: whatever names, requires or shows one reads this table.

To add one, write its function and its entry. `margin`, `jaxfric stability`, requirements of
`jaxfric gains`, the outputs of a study, figures and help texts then have it. Importing this table
loads no JAX, so that the command's help stays quick: an entry names its function.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ..errors import InputError


@dataclass(frozen=True)
class Margin:
    """Name and meaning of a margin, its requirements, and the function that computes it."""

    unit: str
    limit: float
    """The value of a slider at the limit of stability; a stable one has more."""
    text: str
    """The margin in words, as beside the output of a study."""
    function: str
    """Its function as "package.module:name", which takes a `margins.Analysis` to a scalar."""
    highest: float = math.inf
    """Largest value of any slider: requirements lie between `limit` and here."""
    zero: bool = False
    """Whether 0 may be required, which asks for stability alone."""
    needs_poles: bool = False
    """Whether it needs the poles, which a slider lacks whose kernel is only known over time."""
    unless_late: str = ""
    """Reason why it has no meaning where the controller answers late; empty where it has one."""
    unless_integral: str = ""
    """Reason why it has no meaning where the controller has integral action, or empty."""
    unlimited: str = "no crossing"
    """Reason why it is inf, where it is."""

    @property
    def suffix(self) -> str:
        """The text after a number: a space and the unit, or nothing where it has none."""
        return "" if self.unit == "1" else f" {self.unit}"


_HERE = "jaxfric.stability.margins:"
_CROSSES_NOT = "none: the loop's magnitude never crosses 1"
MARGINS: dict[str, Margin] = {
    "stiffness": Margin(
        "1",
        1.0,
        "stiffness margin, k_p over the critical stiffness",
        _HERE + "stiffness",
        unless_late="it has no critical stiffness, as a spring answers at once",
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
        unless_late="a late loop has poles without end, the faster the less damped",
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
    """The margin called `name`.

    Raises
    ------
    InputError : there is none; all names are listed.
    """
    if name not in MARGINS:
        raise InputError(f"margin '{name}' does not exist; there are: {', '.join(MARGINS)}")
    return MARGINS[name]


def meaningless(name: str, *, late: bool, integral: bool) -> str:
    """Why a margin has no meaning with such a controller, in words; empty where it has one."""
    one = MARGINS[name]
    if late and one.unless_late:
        return f"a controller that answers late: {one.unless_late}"
    if integral and one.unless_integral:
        return f"integral action: {one.unless_integral}"
    return ""


def refuse_meaningless(names: Iterable[str], *, late: bool, integral: bool) -> None:
    """Raise `InputError` for the first margin that has no meaning with such a controller."""
    for name in names:
        if reason := meaningless(name, late=late, integral=integral):
            raise InputError(
                f"margin {name} has no meaning with {reason}."
                " Require modulus=0.5, gain, phase or delay"
            )


def named_with_units() -> str:
    """All names, those of margins that have a unit with it: "decay (1/s), damping"."""
    return ", ".join(n if m.unit == "1" else f"{n} ({m.unit})" for n, m in MARGINS.items())
