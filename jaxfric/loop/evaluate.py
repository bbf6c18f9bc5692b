"""The residual of a problem and its Jacobian, a fixed number of directions at a time."""

import threading
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Array, Float

from ..effects import AbstractHeavyEffect
from ..fitting.abstract_problem import FAILED_MISFIT, AbstractProblem
from ..fitting.encompassing import EncompassingModel
from ..threads import go_on
from ..traced import traced
from .shared import SharedShifts
from .thresholds import AT_ONCE, HEAVY, KEPT, LONG, OF_LONG

P = TypeVar("P", bound=AbstractProblem)


class Rows(NamedTuple):
    """Residual and Jacobian of all rows at some parameters.

    `residual` and `jacobian` have all rows of the record and its padding, in any block. The extra
    rows, of unit variance, are other channels in the train block and shifts of step times.
    """

    residual: np.ndarray
    jacobian: np.ndarray
    extra: np.ndarray
    extra_jacobian: np.ndarray

    @property
    def failed(self) -> bool:
        """Whether the simulation, or a derivative of the simulation, failed at the parameters."""
        reached = bool(np.all(np.abs(self.residual) < FAILED_MISFIT))
        return not (reached and bool(np.all(np.isfinite(self.jacobian))))


class Evaluator(Generic[P]):
    """Residual and Jacobian of a problem over all rows, with a cache of the latest results.

    `shifts` are the indices of the shifts of step times in z; `each` maps a function in parallel.
    """

    def __init__(self, problem: P, shifts: np.ndarray, each: Callable[..., list]):
        assert isinstance(problem.model, EncompassingModel)
        self.problem, self.each, self.model = problem.plain(), each, problem.model
        first = len(self.model.names())
        begins, trails = (np.asarray(of)[shifts - first] for of in problem.late_steps())
        channels = 1 + len(problem.channels)
        self._shared = SharedShifts(shifts, begins, trails, np.asarray(problem.time), channels)
        heavy = [e.id for e in self.model.effects if issubclass(e, AbstractHeavyEffect)]
        self._heavy = {id: self.model.columns((id,)) for id in heavy}
        self._apart: set[bytes] = set()
        self._known: dict[bytes, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._lock = threading.Lock()

    def simulated(self, z: np.ndarray, problem: P) -> P:
        """The problem to simulate at `z`: first-order effects replace costly effects at their null.

        The replaced problem needs another compilation, which pays because most candidates lack
        costly effects.
        """
        lighter = tuple(id for id, own in self._heavy.items() if not np.any(np.asarray(z)[own]))
        if len(lighter) < len(self._heavy):
            problem = problem.heavier(HEAVY)
        return problem.with_model(self.model._replace(lighter=lighter)) if lighter else problem

    def __call__(self, z: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual (r,) and its Jacobian (r, m) by the parameters of `index`; read-only, as they
        are cached."""
        key = np.asarray(z, float).tobytes()
        columns, residual, jacobian = self._known.get(key, (np.zeros(0), None, None))
        if residual is None or jacobian is None or not np.all(np.isin(index, columns)):
            go_on()
            residual, jacobian = self._found(z, index)
            self._keep(key, index, residual, jacobian)
            return residual, jacobian
        if np.array_equal(index, columns):
            return residual, jacobian
        place = {int(column): k for k, column in enumerate(columns)}
        return residual, jacobian[:, [place[int(k)] for k in index]]

    def _keep(
        self, key: bytes, index: np.ndarray, residual: np.ndarray, jacobian: np.ndarray
    ) -> None:
        for array in (residual, jacobian):
            array.flags.writeable = False
        most = max(KEPT // max(jacobian.nbytes, 1), 2)
        with self._lock:
            self._known.pop(key, None)
            self._known[key] = np.array(index), residual, jacobian
            for oldest in list(self._known)[: max(len(self._known) - most, 0)]:
                del self._known[oldest]

    def _found(self, z: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual and Jacobian; shifts of step times share directions if that saves a pass."""
        problem = self.simulated(z, self.problem)
        few = self._shared.directions(index, len(z))
        if _parts(problem, few) < _parts(problem, index) and index.tobytes() not in self._apart:
            residual, along = _in_parts(problem, z, few, self.each)
            jacobian = self._shared.jacobian(along, index, len(z))
            if jacobian is not None:
                return residual, jacobian
            self._apart.add(index.tobytes())
        return _in_parts(problem, z, np.eye(len(z))[index], self.each)


def _at_once(problem: AbstractProblem) -> int:
    return AT_ONCE if len(problem.time) <= LONG else OF_LONG


def _parts(problem: AbstractProblem, directions: np.ndarray) -> int:
    """Number of passes for a Jacobian along these directions."""
    return max(-(-len(directions) // _at_once(problem)), 1)


def _in_parts(
    problem: AbstractProblem,
    z: np.ndarray,
    directions: np.ndarray,
    each: Callable[..., list],
) -> tuple[np.ndarray, np.ndarray]:
    """`_evaluate` along a few directions per pass: it is compiled for one number of them."""
    number = _at_once(problem)
    begins = range(0, _parts(problem, directions) * number, number)

    def part(begin: int) -> tuple[np.ndarray, np.ndarray]:
        own = directions[begin : begin + number]
        padded = np.pad(own, ((0, number - len(own)), (0, 0)))
        residual, jacobian = _evaluate(problem, *jax.device_put((z, padded)))
        return np.asarray(residual), np.asarray(jacobian)[:, : len(own)]

    parts = each(part, begins)
    return parts[-1][0], np.concatenate([jacobian for _, jacobian in parts], axis=1)


@traced
def _evaluate(problem: AbstractProblem, z: Float[Array, " q"], directions: Float[Array, "m q"]):
    """Residual and its derivatives along some directions."""

    def push(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(problem.residual, (z,), (tangent,))

    return jax.vmap(push, out_axes=(None, -1))(directions)
