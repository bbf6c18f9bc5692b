"""All friction laws by name: their parameters and how to build them.

An entry of `REGISTRY` is the class of a law or, for a `RateState`, the evolution law of the states.
To add a law, write its class in a file of `rig.friction` and add an entry to `REGISTRY`. Fits,
loops, gains, simulations, margins and studies then accept the name of the new law.

Rate-and-state laws (`AbstractRateState`) have the parameters f0, A, B and L, B2 and L2, ..., V0 and
slip_trend. A subclass of `AbstractRateState` takes f0, A, B, L, ... and `direct` as keyword
arguments. The class variable `number` of a law fixes its number of states. Fits, loops and studies
accept only rate-and-state laws. Any other law has the parameters that its class declares.
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
from ..traced import Registry

Law = AbstractLaw | AbstractDelayLaw

REGISTRY: Registry[AbstractEvolution | type[AbstractLaw] | type[AbstractDelayLaw]] = Registry(
    {
        "slip": SlipEvolution(),
        "ageing": AgeingEvolution(),
        "stribeck": GeneralStribeck,
        "gaussian-stribeck": GaussianStribeck,
        "delay": HessSoom,
        "dahl": Dahl,
    }
)
"""Every law by its name. A law that is replaced is compiled anew."""

_RATE_STATE = quantities(RateState)
_OF_A_STATE = re.compile(r"[BL]([2-9])")


def rate_state_laws() -> tuple[str, ...]:
    """Names of the laws that fits, loops and studies accept."""
    return tuple(name for name in REGISTRY if is_rate_state(name))


def is_rate_state(name: object) -> bool:
    """Whether there is a rate-and-state law of this name."""
    entry = REGISTRY.get(name) if isinstance(name, str) else None
    return isinstance(entry, AbstractEvolution) or (
        isinstance(entry, type) and issubclass(entry, AbstractRateState)
    )


def known_law(name: object) -> str:
    """Return the registry name of a rate-and-state law given in either spelling (aging, ageing);
    raise `InputError` for any other name."""
    here = id_of(name) if isinstance(name, str) else name
    if not isinstance(here, str) or not is_rate_state(here):
        known = ", ".join(rate_state_laws())
        raise InputError(f"law '{name}' is not known; choose one of {known}")
    return here


def evolution_of(name: str) -> AbstractEvolution | None:
    """The evolution law of the states of a `RateState`; None for a law with its own class."""
    entry = REGISTRY[name]
    return entry if isinstance(entry, AbstractEvolution) else None


def takes(name: str, effect: type[AbstractEffect]) -> bool:
    """Whether a model with the given law can have the given effect."""
    return evolution_of(name) is not None or not issubclass(effect, AbstractEvolutionEffect)


def refuse_untaken(name: str, effects: Iterable[type[AbstractEffect]]) -> None:
    """Raise `InputError` for an effect that a model with this law cannot have."""
    for effect in effects:
        if not takes(name, effect):
            raise InputError(
                f"effect {effect.id} changes the evolution of a RateState, which the {name} law"
                " does not have; leave the effect out"
            )


def fixed_states(name: str) -> int | None:
    """The fixed number of states of a rate-and-state law; None: any number."""
    return getattr(REGISTRY[name], "number", None)


def name_of(law: Law) -> str | None:
    """The registry name of a law; None if it has none."""
    kind = law.evolution if isinstance(law, RateState) else law
    for name, entry in REGISTRY.items():
        if type(kind) is (type(entry) if isinstance(entry, AbstractEvolution) else entry):
            return name
    return None


def count_states(name: str | None, parameters: Iterable[str]) -> int:
    """Number of states: fixed by the law, else the highest index of a B or L in `parameters`."""
    always = None if name is None else fixed_states(name)
    found = (_OF_A_STATE.fullmatch(parameter) for parameter in parameters)
    return always or max((int(match.group(1)) for match in found if match), default=1)


def law_quantity(name: str) -> Quantity:
    """Symbol, unit and bounds of a parameter of a rate-and-state law, such as "A" or "L2".

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
    """Build the law `name` with parameters `p`; arrays give a batch of laws.

    Forces are multiplied by `scale`. The default slip_trend is 0.
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
