"""The scenarios in which gains must hold: velocities, masses, samples of the law."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, PyTree

from ..errors import InputError
from ..laws.registry import Law
from ..stability.kernel import StateSpaceKernel
from ..stability.linear import LinearFriction, Setting, linear_friction, refuse_without_steady_state
from .thresholds import RATIONAL_TILE, TILE

L = TypeVar("L", bound=Law)


@dataclass(frozen=True, eq=False)
class Scenarios:
    """Friction linearised at every (sample, velocity, mass); all arrays share the length n."""

    laws: Law
    """The samples of the law: every array has a leading axis."""
    velocity: np.ndarray
    """[m/s]"""
    mass: np.ndarray | None
    """[force s^2/m]; None without mass."""
    sample: np.ndarray
    """Index into `laws`."""
    friction: LinearFriction
    delay: float | None = None
    """Delay of the controller [s]; None: no delay."""
    integral: float | None = None
    """Integral gain [force/(m s)]; None: no integral action."""

    def __len__(self) -> int:
        return self.velocity.shape[0]

    @property
    def setting(self) -> Setting:
        """Mass, delay and integral gain of every scenario, as JAX arrays."""
        known = (self.mass, self.delay, self.integral)
        return Setting(*(None if x is None else jnp.full(len(self), x, float) for x in known))

    @property
    def tile(self) -> int:
        """Number of scenarios evaluated at once (`in_tiles`)."""
        return RATIONAL_TILE if isinstance(self.friction.kernel, StateSpaceKernel) else TILE

    @staticmethod
    def product(
        laws: Law,
        velocities: ArrayLike,
        masses: ArrayLike | None,
        delay: float | None = None,
        integral: float | None = None,
    ) -> "Scenarios":
        """Build all combinations of velocity, mass and sample. `masses` None: no mass. `delay` [s]
        and `integral` [force/(m s)] are the same in all scenarios.

        Raises
        ------
        InputError : no velocity, a velocity or mass that is not positive, a law without a steady
            state at a velocity.
        """
        V = _positive(velocities, "velocity", "m/s")
        m = None if masses is None else _positive(masses, "mass", "kg")
        samples = np.arange(number_of_samples(laws))
        grid = np.meshgrid(samples, V, np.zeros(1) if m is None else m, indexing="ij")
        sample, velocity, mass = (axis.reshape(-1) for axis in grid)
        mass = None if m is None else mass
        return Scenarios.at(laws, velocity, mass, sample, delay, integral)

    @staticmethod
    def at(
        laws: Law,
        velocity: ArrayLike,
        mass: np.ndarray | None,
        sample: ArrayLike,
        delay: float | None = None,
        integral: float | None = None,
    ) -> "Scenarios":
        """Build scenarios listed one by one."""
        velocity, sample = np.asarray(velocity, float), np.asarray(sample)

        def found(rows: np.ndarray) -> LinearFriction:
            return linearised(laws, jnp.asarray(velocity[rows]), jnp.asarray(sample[rows]))

        friction = in_tiles(found, len(velocity))
        refuse_without_steady_state(velocity, friction)
        return Scenarios(laws, velocity, mass, sample, friction, delay, integral)

    @property
    def _rows(self) -> dict[str, PyTree]:
        """The fields with one row for each scenario."""
        names = ("velocity", "mass", "sample", "friction")
        return {name: getattr(self, name) for name in names}

    def take(self, index: ArrayLike | Sequence[int]) -> "Scenarios":
        """Select scenarios by index."""
        rows = np.asarray(index, int)
        return replace(self, **jax.tree.map(lambda leaf: leaf[rows], self._rows))

    def at_velocities(self, index: ArrayLike, velocity: np.ndarray) -> "Scenarios":
        """Copy the scenarios at `index` with the given velocities."""
        of = self.take(np.broadcast_to(np.asarray(index), velocity.shape))
        return Scenarios.at(self.laws, velocity, of.mass, of.sample, self.delay, self.integral)

    def join(self, other: "Scenarios") -> "Scenarios":
        """Append other scenarios."""
        rows = jax.tree.map(lambda *both: np.concatenate(both), self._rows, other._rows)
        return replace(self, **rows)

    def law(self, index: int) -> Law:
        """The friction law of one scenario."""
        return law_of(self.laws, int(self.sample[index]))

    def describe(self, index: int) -> dict[str, float | int | None]:
        """Velocity, mass and sample of one scenario."""
        return {
            "velocity": float(self.velocity[index]),
            "mass": None if self.mass is None else float(self.mass[index]),
            "sample": int(self.sample[index]),
        }


def padded(index: np.ndarray, *, size: int = 32) -> np.ndarray:
    """Pad indices to a multiple of `size` with the first index, so that few shapes compile."""
    more = -len(index) % size
    return np.concatenate([index, np.full(more, index[0], index.dtype)])


def in_tiles(function: Callable[[np.ndarray], PyTree], number: int, size: int = TILE) -> PyTree:
    """Apply a function of `size` indices to 0..number-1, tile by tile; the last tile is padded."""
    parts = []
    for begin in range(0, number, size):
        found = function(padded(np.arange(begin, min(begin + size, number)), size=size))
        parts.append(jax.tree.map(lambda x, end=number - begin: np.asarray(x)[:end], found))
    return jax.tree.map(lambda *x: np.concatenate(x), *parts)


def number_of_samples(laws: Law) -> int:
    """Length of the leading axis of a batch of laws."""
    return jax.tree.leaves(eqx.filter(laws, eqx.is_array))[0].shape[0]


def law_of(laws: L, index: int | Array | np.ndarray) -> L:
    """Select one law of a batch, or several."""
    return jax.tree.map(lambda leaf: leaf[index] if eqx.is_array(leaf) else leaf, laws)


@eqx.filter_jit
def linearised(laws: Law, velocity: Array, sample: Array) -> LinearFriction:
    """Linearise samples of a law, given by index, about velocities [m/s] of shape (n,)."""
    return jax.vmap(lambda V, index: linear_friction(law_of(laws, index), V))(velocity, sample)


def _positive(values: ArrayLike, what: str, unit: str) -> np.ndarray:
    values = np.unique(np.atleast_1d(np.asarray(values, float)))
    if values.size == 0:
        raise InputError(f"{what}: the range is empty; give one {what} or more")
    if not np.all(np.isfinite(values) & (values > 0)):
        bad = values[~(np.isfinite(values) & (values > 0))][0]
        raise InputError(f"{what}: {bad:g} {unit} is not a positive number")
    return values
