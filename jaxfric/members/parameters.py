"""The parameters that a study can set and vary: names, units, bounds; and the law they make."""

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import jax.numpy as jnp

from ..errors import InputError
from ..quantity import Quantity
from ..rig.friction import (
    AbstractDirectEffect,
    AgeingEvolution,
    RateState,
    RegularisedEffect,
    SlipEvolution,
)
from ..units import parse_quantity

EVOLUTIONS = {"slip": SlipEvolution, "ageing": AgeingEvolution}

_KNOWN = {
    "A": Quantity("A", "N", "direct effect", lower=0.0),
    "B": Quantity("B", "N", "evolution effect"),
    "L": Quantity("L", "m", "characteristic slip length", lower=0.0),
    "f0": Quantity("f0", "N", "steady friction at V_ref"),
    "V_ref": Quantity("V_ref", "m/s", "reference velocity of the law", lower=0.0),
    "m": Quantity("m", "kg", "mass", lower=0.0),
    "k_p": Quantity("k_p", "N/m", "position gain or stiffness", lower=0.0),
    "k_v": Quantity("k_v", "N*s/m", "velocity gain or damping", lower=-1e-300),
    "V0": Quantity("V0", "m/s", "commanded velocity", lower=0.0),
    "ratio": Quantity("ratio", "1", "velocity over the one before the step", lower=0.0),
}
_OF_A_STATE = re.compile(r"([BL])([2-9])")
LAW = ("A", "B", "L", "f0", "V_ref")


def parameter(name: str, where: str, *, known: Iterable[str] | None = None) -> Quantity:
    """The parameter called `name`.

    Raises
    ------
    InputError : there is none; the nearest is named.
    """
    match = _OF_A_STATE.fullmatch(name)
    if match and (known is None or match.group(1) in known):
        about = _KNOWN[match.group(1)]
        return Quantity(
            name, about.unit, f"{about.text}, state {match.group(2)}", about.lower, about.upper
        )
    names = list(_KNOWN if known is None else known)
    if name not in names:
        raise InputError(f"{where}: no parameter '{name}'{nearest(name, names)}")
    return _KNOWN[name]


def nearest(name: str, names: Iterable[str]) -> str:
    """ "; did you mean 'x'?", or the list of names where none is like it."""
    names = list(names)
    folded = {known.lower(): known for known in names}
    close = difflib.get_close_matches(name.lower(), folded, n=1, cutoff=0.5)
    if close:
        return f"; did you mean '{folded[close[0]]}'?"
    return f"; there are: {', '.join(names)}"


def read_value(content: Any, name: str, where: str) -> float:
    """The value of one parameter, "3 um" or, without unit, a plain number."""
    return value_of(content, parameter(name, where), where)


def value_of(content: Any, about: Quantity, where: str) -> float:
    """The same of a parameter that is known."""
    value = number(content, about.unit, where)
    if about.symbol == "k_v" and value == 0:
        return 0.0
    return about.check(value, where)


def number(content: Any, unit: str, where: str) -> float:
    """A number in SI from a text with a unit, or from a plain number where `unit` is "1".

    Raises
    ------
    InputError : it is neither, or of another unit.
    """
    if isinstance(content, bool) or not isinstance(content, str | int | float):
        raise InputError(f"{where}: {content!r} is no quantity; write it as in '3 um'")
    if not isinstance(content, str):
        if unit != "1":
            raise InputError(f"{where}: {content} has no unit; write it as '{content} {unit}'")
        if not math.isfinite(content):
            raise InputError(f"{where}: {content} is not a finite number")
        return float(content)
    return parse_quantity(content, unit, where)


def states_of(names: Iterable[str]) -> int:
    """Number of states that a set of parameters speaks of."""
    found = [int(match.group(2)) for match in map(_OF_A_STATE.fullmatch, names) if match]
    return max(found, default=1)


def needed(states: int) -> list[str]:
    """Parameters of a rate-and-state law that have no default: A, B, L, B2, L2, ..."""
    more = [f"{letter}{i}" for i in range(2, states + 1) for letter in "BL"]
    return ["A", "B", "L", *more]


def rate_state(
    kind: str,
    p: Mapping[str, Any],
    states: int,
    direct: AbstractDirectEffect = RegularisedEffect(),  # noqa: B008
) -> RateState:
    """The law of one member or, where parameters are arrays, of all: states along the last axis.

    The direct effect is the regularised one, as in the law of a file or of the command.
    The reference velocity matters to f0 only, and f0 only where friction is less than some 20 A, or
    at rest: by default they are the commanded velocity and 50 A.
    """
    B = [p["B" if i == 1 else f"B{i}"] for i in range(1, states + 1)]
    L = [p["L" if i == 1 else f"L{i}"] for i in range(1, states + 1)]
    A = jnp.asarray(p["A"])
    return RateState(
        jnp.asarray(p.get("f0", 50.0 * A)),
        A,
        jnp.stack([jnp.asarray(x) for x in B], axis=-1),
        jnp.stack([jnp.asarray(x) for x in L], axis=-1),
        jnp.asarray(p.get("V_ref", p["V0"])),
        EVOLUTIONS[kind](),
        direct,
        jnp.zeros_like(A),
    )
