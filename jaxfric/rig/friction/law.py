"""The interface of every friction law, and the conditions that friction may depend on.

Time face: `force(V, state, at)` and `rate(V, state, at)`. The frequency face
(an instantaneous term and a memory kernel at a steady velocity) follows from these
two by automatic differentiation, so no law writes it.
"""

import abc
from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

LOG_MAX = 40.0
"""Largest logarithm of a ratio of velocities: a solver's trial step must stay a finite number."""
NEAR_ZERO = 1e-12
"""Share below which a power is continued by its value there: at 0 it may have no derivative."""
NEWTON_STEPS = 4
"""Newton steps from a start that is near: each doubles the digits, from one to all of a double."""

Scalar = Float[Array, ""]
States = Float[Array, " n"]
"""State variables of a law, or one number for each of them."""


class Conditions(NamedTuple):
    """Place and time of the contact: slip since the start [m] and time since the start [s].

    `stress` is the normal stress over the one at the start, n; None: it does not move.
    `load_velocity` [m/s] is that of the load point; None: steady sliding, it is the slider's.
    """

    slip: Float[Array, ""]
    time: Float[Array, ""]
    stress: Float[Array, ""] | None = None
    load_velocity: Float[Array, ""] | None = None


class AbstractLaw(eqx.Module):
    """A friction law with a vector of state variables.

    Forces are in newtons or, as a coefficient, dimensionless: the equations are the
    same and the whole rig must use one of the two. Velocity V in m/s, time in s.
    """

    @abc.abstractmethod
    def force(self, V: Scalar, state: States, at: Conditions) -> Scalar:
        """Friction force at slip velocity `V` in `state`."""

    @abc.abstractmethod
    def rate(self, V: Scalar, state: States, at: Conditions) -> States:
        """Time derivative of the state [force/s]."""

    @abc.abstractmethod
    def steady_state(self, V: Scalar) -> States:
        """The state at which `rate` vanishes when sliding steadily at `V` != 0."""

    @abc.abstractmethod
    def force_scale(self) -> Scalar:
        """A positive force typical of the law's changes: the unit of its error control."""


class AbstractInvertibleLaw(AbstractLaw):
    """A law whose force rises with velocity at fixed state, so that it can be inverted.

    The instantaneous rise (the direct effect) is what makes a massless slider's
    velocity a function of the force on it, and what keeps a slider with mass well-conditioned.
    """

    @abc.abstractmethod
    def velocity(
        self, force: Scalar, state: States, at: Conditions, *, damping: Scalar | None = None
    ) -> Scalar:
        """The velocity at which friction plus `damping` times velocity equals `force`."""
