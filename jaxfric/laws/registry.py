"""All friction laws by the name that users give, what parameters they have, and how they are built.

An entry of `REGISTRY` is a law's class or, of a `RateState`, the evolution of its states. To add a
law is to write it in a file of `rig.friction` and to enter it here; fits, loops, gains,
simulations, margins and studies take it by its name.

Rate-and-state laws (`AbstractRateState`) have the parameters f0, A, B and L, B2 and L2, ..., V0 and
slip_trend. A class of one is made with the fields of those names as keywords, with `direct`, and
says how many states it has by a class variable `number`. Fits, loops and studies take these
laws only. Any other law has the parameters that its class declares.
"""

import re
from collections.abc import Iterable, Mapping

import jax.numpy as jnp
from jaxtyping import ArrayLike

from ..effects.effect import AbstractEffect, AbstractEvolutionEffect, id_of
from ..errors import InputError
from ..quantity import Quantity, numbered_names, quantities
from ..rig.friction import (
    AbstractDelayLaw,
    AbstractDirectEffect,
    AbstractEvolution,
    AbstractLaw,
    AbstractRateState,
    AgeingEvolution,
    Dahl,
    GaussianStribeck,
    GeneralStribeck,
    HessSoom,
    RateState,
    RegularisedEffect,
    SlipEvolution,
)
from ..traced import depends_on

Law = AbstractLaw | AbstractDelayLaw

REGISTRY: dict[str, AbstractEvolution | type[AbstractLaw] | type[AbstractDelayLaw]] = {
    "slip": SlipEvolution(),
    "ageing": AgeingEvolution(),
    "stribeck": GeneralStribeck,
    "gaussian-stribeck": GaussianStribeck,
    "delay": HessSoom,
    "dahl": Dahl,
}
"""Every law by its name."""
depends_on(REGISTRY)

_RATE_STATE = quantities(RateState)
_OF_A_STATE = re.compile(r"[BL]([2-9])")


def names_of_laws() -> tuple[str, ...]:
    """Names of all laws."""
    return tuple(REGISTRY)


def rate_state_laws() -> tuple[str, ...]:
    """Names of the laws that fits, loops and studies take."""
    return tuple(name for name in REGISTRY if is_rate_state(name))


def is_rate_state(name: object) -> bool:
    """Whether there is a rate-and-state law of this name."""
    entry = REGISTRY.get(name) if isinstance(name, str) else None
    return isinstance(entry, AbstractEvolution) or (
        isinstance(entry, type) and issubclass(entry, AbstractRateState)
    )


def known_law(name: object) -> str:
    """The name of a law that fits, loops and studies take, in either spelling (aging, ageing);
    raises `InputError` for others."""
    here = id_of(name) if isinstance(name, str) else name
    if not isinstance(here, str) or not is_rate_state(here):
        known = ", ".join(rate_state_laws())
        raise InputError(f"law '{name}' is not known; choose one of {known}")
    return here


def evolution_of(name: str) -> AbstractEvolution | None:
    """The evolution of a `RateState`'s states; None of a law that is a class of its own."""
    entry = REGISTRY[name]
    return entry if isinstance(entry, AbstractEvolution) else None


def takes(name: str, effect: type[AbstractEffect]) -> bool:
    """Whether a model of this law can have an effect."""
    return evolution_of(name) is not None or not issubclass(effect, AbstractEvolutionEffect)


def refuse_untaken(name: str, effects: Iterable[type[AbstractEffect]]) -> None:
    """Raise `InputError` for an effect that a model of this law cannot have."""
    for effect in effects:
        if not takes(name, effect):
            raise InputError(
                f"effect {effect.id} changes the evolution of a RateState, and the {name} law is"
                " none; leave the effect out"
            )


def fixed_states(name: str) -> int | None:
    """The number of states that a rate-and-state law always has; None: any."""
    return getattr(REGISTRY[name], "number", None)


def name_of(law: Law) -> str | None:
    """The name of a law; None where it is none of the registry."""
    kind = law.evolution if isinstance(law, RateState) else law
    for name, entry in REGISTRY.items():
        if type(kind) is (type(entry) if isinstance(entry, AbstractEvolution) else entry):
            return name
    return None


def count_states(name: str | None, parameters: Iterable[str]) -> int:
    """Number of states of a law with these parameters: its own, or one for each B or L there is."""
    always = None if name is None else fixed_states(name)
    found = (_OF_A_STATE.fullmatch(parameter) for parameter in parameters)
    return always or max((int(match.group(1)) for match in found if match), default=1)


def law_quantity(name: str) -> Quantity:
    """Symbol, unit and bounds behind a parameter of a rate-and-state law, such as "A" or "L2".

    Raises
    ------
    KeyError : no such parameter.
    """
    return _RATE_STATE[name if name in _RATE_STATE else name.rstrip("0123456789")]


def rate_state(
    name: str,
    p: Mapping[str, ArrayLike],
    states: int,
    *,
    scale: float = 1.0,
    direct: AbstractDirectEffect = RegularisedEffect(),  # noqa: B008
) -> AbstractRateState:
    """The law of a name with the parameters `p`; a batch where they are arrays.

    Forces are `scale` times those given. Without a slip_trend there is none.
    """
    p = {key: jnp.asarray(value, float) for key, value in p.items()}
    fields = {
        "f0": p["f0"] * scale,
        "A": p["A"] * scale,
        "B": jnp.stack([p[key] * scale for key in numbered_names(states)[0::2]], axis=-1),
        "L": jnp.stack([p[key] for key in numbered_names(states)[1::2]], axis=-1),
        "V0": p["V0"],
        "direct": direct,
        "slip_trend": p.get("slip_trend", jnp.zeros_like(p["V0"])) * scale,
    }
    entry = REGISTRY[name]
    if isinstance(entry, AbstractEvolution):
        return RateState(**fields, evolution=entry)
    assert issubclass(entry, AbstractRateState)
    return entry(**fields)
