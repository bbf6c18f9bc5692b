"""Fits of candidates: one superset problem, any choice of free effects, noise profiled anew.

A candidate is the base and some effects, all their parameters free together. Its noise (white plus
exponentially correlated) is estimated with it, never taken from another one: noise estimated from
a fit that lacks an effect swallows the effect.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..fitting.noise import Noise, estimate_noise, whiten
from ..fitting.problem import FAILED_MISFIT, Problem, residual_and_jacobian
from ..fitting.solve import descend
from .split import NAMES, Blocks
from .superset import Superset

_PASSES = 2
_TOLERANCE = 1e-3
_WHITE = 1e-9


class Candidate(NamedTuple):
    """A joint fit of the base and some effects."""

    effects: tuple[str, ...]
    z: np.ndarray
    residual: np.ndarray
    """Predicted minus recorded over the problem's noise scale, all rows of the record."""
    noise: Noise
    bic: float
    rms: dict[str, float]
    """By block, in units of the record."""
    physical: bool
    failed: bool


class Engine:
    """Fits candidates of one record; `problem` has a `Superset` model. Only train rows count."""

    def __init__(self, problem: Problem, blocks: Blocks):
        self.blocks = blocks
        self.rows = len(blocks.train)
        weight = np.zeros(problem.time.shape[0])
        weight[: self.rows] = blocks.train
        self.problem = eqx.tree_at(lambda p: p.weight, problem, jnp.asarray(weight))
        self.everywhere = eqx.tree_at(
            lambda p: p.weight, problem, jnp.asarray(np.asarray(problem.weight) > 0, float)
        )
        assert isinstance(problem.model, Superset)
        self.model = problem.model
        self.names = self.model.names()
        self.base = list(range(len(self.model.base.names())))
        self.shifts = list(range(len(self.names), len(self.names) + problem.shift_scale.shape[0]))

    def free(self, effects: tuple[str, ...]) -> np.ndarray:
        """Indices of the free parameters of a candidate, base and step times first."""
        return np.asarray([*self.base, *self.shifts, *self.model.columns(effects)])

    def evaluate(self, z, *, train: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Residual (noise units) and its Jacobian with respect to all parameters, row by row."""
        problem = self.problem if train else self.everywhere
        residual, jacobian = residual_and_jacobian(problem.whitened(_white()), jnp.asarray(z))
        n = self.problem.time.shape[0]
        return np.asarray(residual)[:n], np.asarray(jacobian)[:n]

    def noise(self, residual: np.ndarray, columns: np.ndarray) -> Noise:
        """Noise of the train block, the directions of `columns` taken out."""
        problem = self.problem
        weight = problem.weight
        return estimate_noise(
            problem.time, weight, jnp.asarray(residual), jnp.asarray(_padded(columns))
        )

    def bic(self, residual: np.ndarray, parameters: int) -> tuple[float, Noise]:
        """-2 ln L + p ln n_eff at the most likely noise; n_eff counts the independent rows."""
        found = self.noise(residual, np.zeros((len(residual), 1)))
        ones = np.ones((len(residual), 1))
        white = whiten(self.problem.time, self.problem.weight, jnp.asarray(ones), found)
        effective = float(jnp.sum(white**2) * found.sigma**2)
        count = float(jnp.sum(self.problem.weight))
        effective = min(max(effective, 2.0), count)
        return -2 * float(found.log_likelihood) + parameters * np.log(effective), found

    def refit(self, effects: tuple[str, ...], z: np.ndarray) -> Candidate:
        """The joint fit of base and effects from the start `z`, all their parameters free."""
        index = self.free(effects)
        free = np.zeros(len(z))
        free[index] = 1.0
        residual, jacobian = self.evaluate(z)
        for _ in range(_PASSES):
            if not np.all(np.abs(residual) < FAILED_MISFIT):
                break
            found = self.noise(residual, jacobian[:, index])
            moved, _, _ = descend(
                self.problem.whitened(found), jnp.asarray(z), jnp.asarray(free), _TOLERANCE
            )
            z = np.asarray(moved)
            residual, jacobian = self.evaluate(z)
        return self.candidate(effects, z, residual)

    def candidate(self, effects: tuple[str, ...], z: np.ndarray, residual: np.ndarray) -> Candidate:
        """The scores of a fit."""
        failed = bool(np.any(np.abs(residual) >= FAILED_MISFIT))
        bic, found = (np.inf, _white()) if failed else self.bic(residual, len(self.free(effects)))
        whole, _ = self.evaluate(z, train=False)
        whole = whole[: self.rows]
        scale = float(self.problem.noise_scale)
        rms = {
            name: scale * float(np.sqrt(np.mean(whole[self.blocks.of(name)] ** 2)))
            for name in NAMES
        }
        return Candidate(effects, z, whole, found, bic, rms, self._physical(effects, z), failed)

    def _physical(self, effects: tuple[str, ...], z: np.ndarray) -> bool:
        values = np.asarray(self.problem.from_free(jnp.asarray(z)))
        for effect in self.model.effects:
            if effect.id in effects:
                chosen = [values[i] for i in self.model.columns((effect.id,))]
                fields = [self.names[i].split(".")[1] for i in self.model.columns((effect.id,))]
                made = effect(**dict(zip(fields, chosen, strict=True)))
                if not bool(made.physical()):
                    return False
        return True


def _white() -> Noise:
    one = jnp.ones(())
    return Noise(one, _WHITE * one, one, jnp.zeros(()))


def _padded(columns: np.ndarray, *, size: int = 4) -> Float[Array, "n m"]:
    """Zero columns fill up to a multiple of `size`, so that few shapes are compiled."""
    more = -columns.shape[1] % size
    return jnp.asarray(np.pad(columns, ((0, 0), (0, more))))
