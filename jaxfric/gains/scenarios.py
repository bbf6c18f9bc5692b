"""The set of situations in which gains must hold: velocities, masses, samples of the law."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, PyTree

from ..errors import InputError
from ..laws.registry import Law
from ..stability.kernel import AbstractRationalKernel
from ..stability.linear import LinearFriction, Setting, linear_friction, refuse_without_steady_state

_TILE = 2048
# Margins of kernels that are not rational hold thousands of frequencies for every pair.
_SMALL_TILE = 64


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
    delay: np.ndarray | None = None
    """Delay of the controller in every scenario [s]; None: it has none."""
    integral: np.ndarray | None = None
    """Integral gain in every scenario [force/(m s)]; None: it has none."""

    def __len__(self) -> int:
        return self.velocity.shape[0]

    @property
    def setting(self) -> Setting:
        """Mass, delay and integral gain of every scenario, as arrays of JAX."""
        known = (self.mass, self.delay, self.integral)
        return Setting(*(None if x is None else jnp.asarray(x, float) for x in known))

    @property
    def tile(self) -> int:
        """Number of scenarios to evaluate at once, one shape to compile (`tiles`)."""
        return _TILE if isinstance(self.friction.kernel, AbstractRationalKernel) else _SMALL_TILE

    @staticmethod
    def product(
        laws: Law,
        velocities: ArrayLike,
        masses: ArrayLike | None,
        delay: float | None = None,
        integral: float | None = None,
    ) -> "Scenarios":
        """All combinations. `masses` None means a slider without mass; `delay` [s] and `integral`
        [force/(m s)] are of all.

        Raises
        ------
        InputError : no velocity, one that is not positive, a negative mass, a law
            without a steady state at a velocity.
        """
        V = _positive(velocities, "velocity", "m/s")
        m = None if masses is None else _positive(masses, "mass", "kg")
        samples = np.arange(number_of_samples(laws))
        grid = np.meshgrid(samples, V, np.zeros(1) if m is None else m, indexing="ij")
        sample, velocity, mass = (axis.reshape(-1) for axis in grid)
        of_all = (None if x is None else np.full(len(velocity), x) for x in (delay, integral))
        return Scenarios.at(laws, velocity, None if m is None else mass, sample, *of_all)

    @staticmethod
    def at(
        laws: Law,
        velocity: ArrayLike,
        mass: np.ndarray | None,
        sample: ArrayLike,
        delay: np.ndarray | None = None,
        integral: np.ndarray | None = None,
    ) -> "Scenarios":
        """Scenarios listed one by one."""
        velocity, sample = np.asarray(velocity, float), np.asarray(sample)
        number = len(velocity)
        rows = padded(np.arange(number), size=_SMALL_TILE if number <= 512 else _TILE)
        found = linearised(laws, jnp.asarray(velocity[rows]), jnp.asarray(sample[rows]))
        friction = jax.tree.map(lambda leaf: np.asarray(leaf)[:number], found)
        refuse_without_steady_state(velocity, friction)
        return Scenarios(laws, velocity, mass, sample, friction, delay, integral)

    @property
    def _rows(self) -> dict[str, PyTree]:
        """What has a row for each scenario."""
        return {name: value for name, value in vars(self).items() if name != "laws"}

    def take(self, index: ArrayLike | Sequence[int]) -> "Scenarios":
        """The scenarios at some indices."""
        rows = np.asarray(index)
        return Scenarios(self.laws, **jax.tree.map(lambda leaf: leaf[rows], self._rows))

    def at_velocities(self, index: ArrayLike, velocity: np.ndarray) -> "Scenarios":
        """Scenarios that differ from those at `index` in velocity only."""
        of = self.take(np.broadcast_to(np.asarray(index), velocity.shape))
        return Scenarios.at(self.laws, velocity, of.mass, of.sample, of.delay, of.integral)

    def join(self, other: "Scenarios") -> "Scenarios":
        """These scenarios followed by the others."""
        rows = jax.tree.map(lambda *both: np.concatenate(both), self._rows, other._rows)
        return Scenarios(self.laws, **rows)

    def law(self, index: int) -> Law:
        """The law of one scenario."""
        chosen = int(self.sample[index])
        arrays, rest = eqx.partition(self.laws, eqx.is_array)
        return eqx.combine(jax.tree.map(lambda leaf: leaf[chosen], arrays), rest)

    def describe(self, index: int) -> dict[str, float | int | None]:
        """Velocity, mass and sample of one scenario."""
        return {
            "velocity": float(self.velocity[index]),
            "mass": None if self.mass is None else float(self.mass[index]),
            "sample": int(self.sample[index]),
        }


def padded(index: np.ndarray, *, size: int = 32) -> np.ndarray:
    """Repeats of the first fill the length up to a multiple of `size`: few shapes to compile."""
    more = -len(index) % size
    return np.concatenate([index, np.full(more, index[0], index.dtype)])


def tiles(number: int, size: int) -> Iterator[tuple[np.ndarray, int]]:
    """Indices 0..number-1 in rows of `size`; the last is filled up. With each, how many count."""
    for begin in range(0, number, size):
        row = np.arange(begin, min(begin + size, number))
        yield padded(row, size=size), row.size


def number_of_samples(laws: Law) -> int:
    """Length of the leading axis of a batch of laws."""
    return jax.tree.leaves(eqx.filter(laws, eqx.is_array))[0].shape[0]


@eqx.filter_jit
def linearised(laws: Law, velocity: Array, sample: Array) -> LinearFriction:
    """Friction of the samples of a law, by their index, linearised about velocities [m/s], (n,)."""
    arrays, rest = eqx.partition(laws, eqx.is_array)

    def one(V: Array, index: Array) -> LinearFriction:
        law = eqx.combine(jax.tree.map(lambda leaf: leaf[index], arrays), rest)
        return linear_friction(law, V)

    return jax.vmap(one)(velocity, sample)


def _positive(values: ArrayLike, what: str, unit: str) -> np.ndarray:
    values = np.unique(np.atleast_1d(np.asarray(values, float)))
    if values.size == 0:
        raise InputError(f"{what}: the range is empty; give one {what} or more")
    if not np.all(np.isfinite(values) & (values > 0)):
        bad = values[~(np.isfinite(values) & (values > 0))][0]
        raise InputError(f"{what}: {bad:g} {unit} is not a positive number")
    return values
