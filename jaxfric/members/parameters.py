"""Names, units and bounds of parameters that a study sets or varies, and the law of a member."""

import re
from collections.abc import Iterable, Mapping

import jax.numpy as jnp
from jaxtyping import ArrayLike

from ..errors import InputError, did_you_mean
from ..laws import registry
from ..quantity import Quantity, numbered_names
from ..rig.friction import AbstractDirectEffect, AbstractRateState, RegularisedEffect
from ..tables import number

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
    """Return the parameter `name`.

    Raises
    ------
    InputError : `name` does not exist; the message gives the nearest name.
    """
    match = _OF_A_STATE.fullmatch(name)
    if match and (known is None or match.group(1) in known):
        about = _KNOWN[match.group(1)]
        return Quantity(
            name, about.unit, f"{about.text}, state {match.group(2)}", about.lower, about.upper
        )
    names = list(_KNOWN if known is None else known)
    if name not in names:
        raise InputError(f"{where}: no parameter '{name}'{did_you_mean(name, names)}")
    return _KNOWN[name]


def value_of(content: object, about: Quantity, where: str) -> float:
    """Read a number of a study.toml in SI; a known parameter must be within its bounds."""
    value = number(content, about.unit, where)
    if about.symbol == "k_v" and value == 0:
        return 0.0
    return about.check(value, where)


def needed(states: int) -> list[str]:
    """Return names of the parameters that have no default in a rate-and-state law: A, B, L, ..."""
    return ["A", *numbered_names(states)]


def rate_state(
    kind: str,
    p: Mapping[str, ArrayLike],
    states: int,
    direct: AbstractDirectEffect = RegularisedEffect(),  # noqa: B008
) -> AbstractRateState:
    """Return the law of one member or, for arrays, of all members, with states on the last axis.

    The direct effect is regularised by default, as in laws from files and from the command. The
    reference velocity is the velocity at which friction is f0. f0 only matters if friction is below
    about 20 A, or at rest. By default the reference velocity is the commanded velocity, and f0 is
    50 A.
    """
    known = {name: p[name] for name in needed(states)}
    known |= {"f0": p.get("f0", 50.0 * jnp.asarray(p["A"])), "V0": p.get("V_ref", p["V0"])}
    return registry.rate_state(kind, known, states, direct=direct)
