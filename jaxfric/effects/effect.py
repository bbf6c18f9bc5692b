"""An effect: a modification of one part of a rig, with a null that changes nothing.

An effect holds its parameters; an effect made without arguments is at its null. `embed(rig)`
returns the rig with the effect. At the null, the rig with the effect predicts the same as `rig`, to
rounding. So a fit without the effect is a special case of the fit with the effect.

A parameter is an amplitude or a shape. An amplitude is unbounded and has the null 0. A shape (a
length, a time, a velocity) has no influence while the amplitudes are 0. Fits start each shape from
a grid of values.
"""

import abc
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
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

if TYPE_CHECKING:  # type checkers mistake equinox's for an instance field
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar

R = TypeVar("R", bound=eqx.Module)
E = TypeVar("E", bound="AbstractEffect")
_RENAMED = {"aging": "ageing", "aging.q": "ageing.q"}

_TRUE = np.asarray(True)


class RecordScales(NamedTuple):
    """Scales of a record, for starting values of shapes. SI."""

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
"""Whether a parameter of an effect is beyond what a record of such scales can determine."""


class AbstractEffect(eqx.Module, Generic[R]):
    """One effect of the catalogue.

    `id` is the name of the effect in tables and files. `equation` is one line, and `meaning`
    explains the equation in words. `confused_with` lists the ids of similar effects.
    `separated_by` lists experiments that distinguish the effect from similar effects, each a
    `RunChange` or a text. `rigs` are the kinds of rig to which the effect applies, by default a
    slider's rig. The fields declared by `quantity(...)` are the parameters of the effect,
    amplitudes first.
    """

    rigs: ClassVar[tuple[type[eqx.Module], ...]] = (Rig,)
    room: ClassVar[str] = "friction"
    """The part of the rig that it modifies: "friction", "machine", "drive" or "sensor"."""
    meaning: ClassVar[str] = ""
    """The effect in one or two plain sentences; reports omit an empty one."""
    law: ClassVar[Mapping[str, float]] = MappingProxyType({})
    """Amplitudes at which base and effect form another well-known law, if any. A fit that fails
    from other starts begins at the fit of that law."""
    limits: ClassVar[Mapping[str, Limit]] = MappingProxyType({})
    """By field name, whether a value is beyond what a record can determine (`beyond`)."""

    channel: ClassVar[str | None] = None
    """The optional channel of a record that it needs, if any."""

    id: AbstractClassVar[str]
    equation: AbstractClassVar[str]
    confused_with: AbstractClassVar[tuple[str, ...]]
    separated_by: AbstractClassVar[tuple[str, ...]]

    @abc.abstractmethod
    def embed(self, rig: R) -> R:
        """Return the rig with this effect."""

    @abc.abstractmethod
    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        """Starting values of every shape by field name; empty without shapes."""

    @abc.abstractmethod
    def physical(self) -> Bool[Array, ""]:
        """Whether the parameters are physically possible (a lag is positive)."""


class AbstractLinearEffect(AbstractEffect[R]):
    """An effect without shapes: all its parameters are amplitudes."""

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        """An empty grid: a linear effect has no shapes to start from."""
        del scales
        return {}


class AbstractPlaceEffect(AbstractEffect[R]):
    """An effect that depends on position: locally it acts as a spring in parallel with k_p."""

    @abc.abstractmethod
    def softest_spring(self) -> Float[Array, ""]:
        """The lowest stiffness of the effect as a spring [F/m]; a negative stiffness softens."""

    def physical(self) -> Bool[Array, ""]:
        """True: friction may rise or fall with position."""
        return always()


class AbstractEvolutionEffect(AbstractLinearEffect[Rig]):
    """An effect on how the states relax; it applies only to a `RateState`."""


class AbstractHeavyEffect(AbstractLinearEffect[R]):
    """An effect that is costly to simulate, with a cheap first-order form at its null.

    Most candidate models of a loop do not contain a costly effect, and need only the derivatives of
    this effect at its null.
    """

    @abc.abstractmethod
    def embed_first_order(self, rig: R) -> R:
        """Return a rig that equals that of `embed` at the null, in value and first derivatives."""


def always() -> Bool[Array, ""]:
    """True, for `physical` of an effect whose parameters may have any value."""
    return jax.device_put(_TRUE)


def parameters(effect: AbstractEffect | type[AbstractEffect]) -> dict[str, Quantity]:
    """The quantities of an effect by field name."""
    return quantities(effect)


def separators(effect: AbstractEffect | type[AbstractEffect]) -> tuple[str, ...]:
    """Experiments that distinguish an effect from similar ones; a class may state one as a text."""
    one = effect.separated_by
    return (one,) if isinstance(one, str) else tuple(one)


def beyond(effect: AbstractEffect, scales: RecordScales) -> tuple[str, ...]:
    """Field names of the parameters that a record with given `RecordScales` cannot determine."""
    return tuple(name for name, limit in effect.limits.items() if bool(limit(effect, scales)))


def made(effect: type[E], values: Mapping[str, ArrayLike]) -> E:
    """Build an effect from parameters by field name; other parameters are at their null."""
    return effect(**values)


def null(effect: type[E]) -> E:
    """Build an effect at its null, where it changes nothing."""
    return made(effect, {})


def ids_of(value: str | Sequence[str]) -> tuple[str, ...]:
    """Unique effect ids from a sequence or from one text, "thermal" or "thermal, gain"."""
    pieces = value.split(",") if isinstance(value, str) else value
    return tuple(dict.fromkeys(id_of(piece.strip()) for piece in pieces if piece.strip()))


def id_of(name: str) -> str:
    """The current name of an effect or of an effect's parameter, given an older name."""
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
    """A copy of the law with a `BlendedEvolution`: q = 1 for the ageing law, else 0."""
    evolution = law.evolution
    if isinstance(evolution, BlendedEvolution):
        return law
    ageing = isinstance(evolution, AgeingEvolution)
    first = SlipEvolution() if ageing else evolution
    blend = BlendedEvolution(q=jnp.asarray(float(ageing)), first=first)
    return eqx.tree_at(lambda b: b.evolution, law, blend)


def evolution_of(law: ExtendedLaw) -> BlendedEvolution | None:
    """Evolution of the base of an extended law; None if its base is not a `RateState`."""
    evolution = law.base.evolution if isinstance(law.base, RateState) else None
    return evolution if isinstance(evolution, BlendedEvolution) else None


def extended(rig: Rig) -> ExtendedLaw:
    """The rig's friction as an `ExtendedLaw` whose base can blend evolutions.

    An ageing law becomes a blend with q = 1, any other law a blend with q = 0. The extended law has
    the same equations as the law of the rig. A rate-and-state law with its own class is unchanged.
    """
    law = rig.friction
    if isinstance(law, ExtendedLaw):
        return law
    if not isinstance(law, AbstractRateState):
        raise TypeError(f"effects need rate-and-state friction, not {type(law).__name__}")
    return ExtendedLaw(blended(law) if isinstance(law, RateState) else law, ())
