"""How far derivatives are from differences, and from each other."""

from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .entries import Entry

# Central differences of fourth order: steps in units of the entry's, and weights.
_STEPS = np.asarray([-2.0, -1.0, 1.0, 2.0])
_WEIGHTS = np.asarray([1.0, -8.0, 8.0, -1.0]) / 12.0
# Share of the largest derivative of a row that each of its derivatives may be off by.
_FLOOR = 1e-3
FIRST = 1e-6
"""Largest error of a first derivative that is right."""
SECOND = 1e-3
"""Largest error of a second derivative that is right."""


@dataclass
class Derivatives:
    """Values, first and second derivatives of an entry at its points, and their differences."""

    entry: Entry

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the scalars."""
        return tuple(jax.eval_shape(self.entry.function, self.entry.logarithms()[0]))

    def vector(self, q: Float[Array, " n"]) -> Float[Array, " scalars"]:
        """All scalars."""
        found = self.entry.function(q)
        return jnp.stack([found[name] for name in self.names])

    @cached_property
    def both(self):
        """Values, Jacobian (reverse) and Hessian (forward over reverse) of points, compiled.

        One function for all, as compiling takes longer than computing.
        """

        def first(q: Float[Array, " n"]):
            def twice(q: Float[Array, " n"]):
                value = self.vector(q)
                return value, value

            jacobian, value = jax.jacrev(twice, has_aux=True)(q)
            return jacobian, (value, jacobian)

        def both(q: Float[Array, " n"]):
            hessian, (value, jacobian) = jax.jacfwd(first, has_aux=True)(q)
            return value, jacobian, hessian

        return jax.jit(jax.vmap(both))

    @cached_property
    def at_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values, first and second derivatives at the points."""
        value, jacobian, hessian = self.both(self.entry.logarithms())
        return np.asarray(value), np.asarray(jacobian), np.asarray(hessian)

    @cached_property
    def differences(self) -> tuple[np.ndarray, np.ndarray]:
        """Differences of values, and of first derivatives: derivatives by q_j are at [..., j]."""
        q, h = self.entry.logarithms(), self.entry.step
        points, n = q.shape
        moved = q[:, None, None] + h * _STEPS[:, None, None] * np.eye(n)
        # in batches of the number of points, for which `both` is compiled
        rows = [self.both(x)[:2] for x in moved.reshape(-1, points, n)]
        value, jacobian = (
            np.concatenate([np.asarray(x) for x in one]) for one in zip(*rows, strict=True)
        )
        shape = (points, len(_STEPS), n)

        def difference(x: np.ndarray) -> np.ndarray:
            found = np.einsum("s,psj...->pj...", _WEIGHTS / h, x.reshape(*shape, *x.shape[1:]))
            return np.moveaxis(found, 1, -1)

        return difference(value), difference(jacobian)

    def first_error(self) -> Float[np.ndarray, "points scalars"]:
        """max_i |J - D|_i/(|D_i| + 1e-3 max|D|); nan where a value is not finite."""
        return self._known(relative(self.at_points[1], self.differences[0], 1))

    def second_error(self) -> Float[np.ndarray, "points scalars"]:
        """max_ij |H - F|_ij/(sqrt|F_ii F_jj| + 1e-3 max|F|); nan where a value is not finite."""
        return self._known(matrix_error(self.at_points[2], self.differences[1]))

    def _known(self, error: np.ndarray) -> np.ndarray:
        # a derivative that is nan where the value is not is an infinite error
        error = np.where(np.isnan(error), np.inf, error)
        return np.where(np.isfinite(self.at_points[0]), error, np.nan)


def relative(found: np.ndarray, true: np.ndarray, axes: int) -> np.ndarray:
    """Largest difference over the last axes, each by its own size and a floor."""
    axis = tuple(range(-axes, 0))
    most = np.max(np.abs(true), axis=axis, keepdims=True)
    return np.max(np.abs(found - true) / (np.abs(true) + _FLOOR * most + 1e-300), axis=axis)


def matrix_error(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """max |H - F|_ij/(sqrt|F_ii F_jj| + 1e-3 max|F|) of matrices in the last two axes."""
    own = np.sqrt(np.abs(np.diagonal(true, axis1=-2, axis2=-1)))
    most = np.max(np.abs(true), axis=(-2, -1), keepdims=True)
    scale = own[..., :, None] * own[..., None, :] + _FLOOR * most + 1e-300
    return np.max(np.abs(found - true) / scale, axis=(-2, -1))
