"""The interface of every friction law, and the conditions that friction may depend on.

In the time domain a law is `force(V, state, at)` and `rate(V, state, at)`. In the frequency domain
a law is an instantaneous term and a memory kernel at a steady velocity. Automatic differentiation
gives the instantaneous term and the memory kernel, so laws do not define the frequency domain form.
"""

import abc
from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

Scalar = Float[Array, ""]
States = Float[Array, " n"]
"""State variables of a law, or one number for each of them."""


class Conditions(NamedTuple):
    """Slip [m] and time [s] since the start.

    `stress` is the normal stress relative to the start, n; None: constant. `load_velocity` [m/s] is
    the velocity of the load point; None: equal to the slider's (steady sliding).
    """

    slip: Float[Array, ""]
    time: Float[Array, ""]
    stress: Float[Array, ""] | None = None
    load_velocity: Float[Array, ""] | None = None


class AbstractLaw(eqx.Module):
    """A friction law with a vector of state variables.

    Forces are in newtons, or dimensionless (friction coefficient): the equations are the same for
    both. The whole rig must use either newtons or friction coefficients. Velocity V is in m/s, time
    in s.
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
        """A positive force, the typical size of the law's changes; scales the solver's errors."""


class AbstractInvertibleLaw(AbstractLaw):
    """A law whose force rises with velocity at fixed state, so that it can be inverted.

    The rise with velocity (direct effect) makes a massless slider's velocity a function of the
    force on the slider. The direct effect also keeps the equations of a slider with mass
    well-conditioned.
    """

    @abc.abstractmethod
    def velocity(
        self, force: Scalar, state: States, at: Conditions, *, damping: Scalar | None = None
    ) -> Scalar:
        """The velocity at which friction plus `damping` times velocity equals `force`."""
