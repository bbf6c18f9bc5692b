"""An effect: a modification of one room of a rig, with values that change nothing.

An effect holds its parameters; made without arguments it is at its null. `embed(rig)` gives the rig
with the effect in it, and at the null that rig predicts what `rig` predicts, to rounding. So
a fit with the effect free contains the fit without it.

A parameter is either an amplitude, whose null is 0 and which is unbounded, or a shape (a length, a
time, a velocity), which means nothing while the amplitudes are 0 and is started from a grid.
"""

import abc
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from ..quantity import Quantity, quantities
from ..rig import Rig
from ..rig.friction.extended import AbstractTerm, BlendedEvolution, ExtendedLaw
from ..rig.friction.rate_state import (
    AbstractRateState,
    AgeingEvolution,
    RateState,
    SlipEvolution,
)

if TYPE_CHECKING:  # which takes equinox's for a field of an instance
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar

R = TypeVar("R", bound=eqx.Module)
E = TypeVar("E", bound="AbstractEffect")
_RENAMED = {"aging": "ageing", "aging.q": "ageing.q"}

ROOMS = ("friction", "machine", "drive", "sensor")


class RecordScales(NamedTuple):
    """Sizes of a record, for starting values of shapes. SI."""

    slip_length: float
    """Slip length L of the base fit [m]."""
    step_slip: float
    """Median slip of a velocity step [m]."""
    total_slip: float
    slowest: float
    fastest: float
    """Velocities."""
    interval: float
    """Median sampling interval [s]."""
    duration: float


Limit = Callable[[Any, RecordScales], Any]
"""Whether the parameters of an effect are beyond what a record of such sizes can show."""


class AbstractEffect(eqx.Module, Generic[R]):
    """One effect of the catalogue.

    `id` is its name in tables and files; `room` the one it modifies; `equation` a line of
    text, `meaning` what it says in words; `confused_with` the ids it is easily taken for;
    `separated_by` what would tell them apart. `rigs` are the kinds of rig that it fits, a slider's
    unless it says otherwise. The fields declared by `quantity(...)` are its parameters, amplitudes
    first.
    """

    rigs: ClassVar[tuple[type[eqx.Module], ...]] = (Rig,)
    meaning: ClassVar[str] = ""
    """The effect in one or two plain sentences; reports leave it out where it is empty."""
    law: ClassVar[Mapping[str, float]] = MappingProxyType({})
    """Amplitudes with which the effect makes another well-known law of its base; a fit that is lost
    from elsewhere begins at the fit of that law. Empty where there is none."""
    limits: ClassVar[Mapping[str, Limit]] = MappingProxyType({})
    """By field name, whether a value is beyond what a record can show (`beyond`)."""

    channel: ClassVar[str | None] = None
    """The optional channel of a record that it needs, if any."""

    id: AbstractClassVar[str]
    room: AbstractClassVar[str]
    equation: AbstractClassVar[str]
    confused_with: AbstractClassVar[tuple[str, ...]]
    separated_by: AbstractClassVar[str]

    @abc.abstractmethod
    def embed(self, rig: R) -> R:
        """The rig with this effect in it."""

    @abc.abstractmethod
    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        """Starting values of every shape by field name; empty where there is none."""

    @abc.abstractmethod
    def physical(self) -> Bool[Array, ""]:
        """True where the parameters are physically possible (a lag is positive)."""


class AbstractLinearEffect(AbstractEffect[R]):
    """An effect without shapes: all its parameters are amplitudes."""

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        """An empty grid: a linear effect has no shapes to start from."""
        del scales
        return {}


class AbstractPlaceEffect(AbstractEffect[R]):
    """An effect that depends on where the slider is: about any place it is a spring beside k_p."""

    @abc.abstractmethod
    def softest_spring(self) -> Float[Array, ""]:
        """The least stiffness of that spring [F/m]; below 0 it softens."""


class AbstractEvolutionEffect(AbstractLinearEffect[Rig]):
    """An effect on how the states of a `RateState` relax; no other law has such an evolution."""


class AbstractHeavyEffect(AbstractLinearEffect[R]):
    """An effect that is costly to simulate, and has something cheaper to stand for it at its null.

    Most candidates of a loop lack it, and need no more than its derivatives.
    """

    @abc.abstractmethod
    def embed_first_order(self, rig: R) -> R:
        """The rig that has, at the null, the value and the first derivatives of `embed`'s."""


def parameters(effect: AbstractEffect | type[AbstractEffect]) -> dict[str, Quantity]:
    """The quantities of an effect by field name."""
    return quantities(effect)


def beyond(effect: AbstractEffect, scales: RecordScales) -> tuple[str, ...]:
    """Field names of parameters that are beyond what a record of such sizes can show."""
    return tuple(name for name, limit in effect.limits.items() if bool(limit(effect, scales)))


def made(effect: type[E], values: Mapping[str, ArrayLike]) -> E:
    """The effect with some of its parameters by field name, the others at their null."""
    return effect(**values)


def null(effect: type[E]) -> E:
    """The effect with the values that change nothing."""
    return made(effect, {})


def ids_of(value: str | Sequence[str]) -> tuple[str, ...]:
    """Ids of effects, each once: of a sequence, or of one text, "thermal" or "thermal, gain"."""
    pieces = value.split(",") if isinstance(value, str) else value
    return tuple(dict.fromkeys(id_of(piece.strip()) for piece in pieces if piece.strip()))


def id_of(name: str) -> str:
    """The present name of an effect, or of a parameter of one; older files have older names."""
    return _RENAMED.get(name, name)


def with_term(rig: Rig, term: AbstractTerm) -> Rig:
    """The rig with one more friction term."""
    law = extended(rig)
    return eqx.tree_at(lambda r: r.friction, rig, ExtendedLaw(law.base, (*law.terms, term)))


def with_evolution(rig: Rig, **changes: Array) -> Rig:
    """The rig with the given amounts added to fields of its `BlendedEvolution`."""
    law = extended(rig)
    evolution = evolution_of(law)
    if evolution is None or not isinstance(law.base, RateState):
        raise TypeError(f"the states of {type(law.base).__name__} have no evolution to change")
    for name, value in changes.items():
        changed = getattr(evolution, name) + value
        evolution = eqx.tree_at(lambda e, n=name: getattr(e, n), evolution, changed)
    base = eqx.tree_at(lambda b: b.evolution, law.base, evolution)
    return eqx.tree_at(lambda r: r.friction, rig, ExtendedLaw(base, law.terms))


def blended(law: RateState) -> RateState:
    """A copy of the law with an evolution that can blend: an ageing law at q = 1, another at 0."""
    evolution = law.evolution
    if isinstance(evolution, BlendedEvolution):
        return law
    ageing = isinstance(evolution, AgeingEvolution)
    first = SlipEvolution() if ageing else evolution
    blend = BlendedEvolution(q=jnp.asarray(float(ageing)), first=first)
    return eqx.tree_at(lambda b: b.evolution, law, blend)


def evolution_of(law: ExtendedLaw) -> BlendedEvolution | None:
    """Evolution of the base of an extended law; None where its base is no `RateState`."""
    evolution = law.base.evolution if isinstance(law.base, RateState) else None
    return evolution if isinstance(evolution, BlendedEvolution) else None


def extended(rig: Rig) -> ExtendedLaw:
    """The rig's friction as an `ExtendedLaw` whose base can blend evolutions.

    An ageing law becomes q = 1, any other q = 0: the same equations. A rate-and-state law that is a
    class of its own stays as it is.
    """
    law = rig.friction
    if isinstance(law, ExtendedLaw):
        return law
    if not isinstance(law, AbstractRateState):
        raise TypeError(f"effects need rate-and-state friction, not {type(law).__name__}")
    return ExtendedLaw(blended(law) if isinstance(law, RateState) else law, ())
