"""The residual of a problem and its Jacobian, computed for a few directions at a time.

`SharedShifts` takes derivatives by several step times at once. Delaying a velocity step changes
friction from that step until the slider has slipped a few L. So a group of velocity steps far from
each other can be delayed together. A change of friction between two successive steps of a group is
due to the first step of the two. A delay dt of a step by dV also makes the load point trail by dV
dt from then on. The permanent displacement of the load point matters if friction depends on slip.
The permanent change of friction has the same form for all steps, and is computed from the first
step, which is delayed alone. The rows just before the next step of a group show whether the
response to a step has decayed.

Source: Curtis, Powell and Reid, On the estimation of sparse Jacobian matrices, J. Inst. Maths
Applics 13 (1974).
"""

import threading
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ..effects import AbstractHeavyEffect
from ..fitting.abstract_problem import AbstractProblem
from ..fitting.encompassing import EncompassingModel
from ..fitting.thresholds import FAILED_MISFIT
from ..threads import go_on
from ..traced import traced
from .thresholds import FORGOTTEN, GROUPS, HEAVY, KEPT, MORE_DIRECTIONS, PASS


class SharedShifts:
    """The shifts of step times that are parameters: the first shift alone, and the other shifts in
    groups. Each group of shifts has every `GROUPS`-th velocity step.

    `shifts` are the ascending indices of the shifts in the parameters, `begins` the ascending times
    of the delayed steps. `trails` is the displacement by which a shift of 1 delays the load point.
    `time` is the time of the rows of one channel. The residual has the rows of all `channels`, one
    channel after another, then one row for each shift.
    """

    def __init__(
        self,
        shifts: Sequence[int] | np.ndarray,
        begins: Float[np.ndarray, " k"],
        trails: Float[np.ndarray, " k"],
        time: Float[np.ndarray, " n"],
        channels: int,
    ):
        self.shifts = np.asarray(shifts, int)
        self.trails, self.rows, self.channels = trails, len(time), channels
        self.first = np.append(np.searchsorted(time, begins), [len(time)] * GROUPS)
        order = np.arange(len(self.shifts))
        self._group = np.where(order == 0, 0, 1 + (order - 1) % GROUPS)

    def directions(self, index: Int[np.ndarray, " m"], size: int) -> Float[np.ndarray, "d q"]:
        """Directions of differentiation for the parameters `index`, out of `size` parameters: first
        the parameters that are not shifts, one by one, then the first shift, then the groups of
        shifts.
        """
        alone = index[~np.isin(index, self.shifts)]
        found = np.zeros((len(alone) + 1 + GROUPS, size))
        found[np.arange(len(alone)), alone] = 1.0
        found[len(alone) + self._group, self.shifts] = 1.0
        return found

    def jacobian(
        self, along: Float[np.ndarray, "r d"], index: Int[np.ndarray, " m"], size: int
    ) -> Float[np.ndarray, "r m"] | None:
        """The Jacobian by the parameters `index` from the derivatives along the `directions`. The
        result is None if the response to a step has not decayed before the next step of its group.
        """
        is_shift = np.isin(index, self.shifts)
        alone = len(index) - int(is_shift.sum())
        found = np.zeros((len(along), len(index)))
        found[:, ~is_shift], shared = along[:, :alone], along[:, alone:]
        columns = np.zeros((len(along), len(self.shifts)))
        for channel in range(self.channels):
            rows = slice(channel * self.rows, (channel + 1) * self.rows)
            own = self._own(shared[rows])
            if own is None:
                return None
            columns[rows] = own
        held = len(along) - size + self.shifts
        columns[held, np.arange(len(held))] = shared[held, self._group]
        found[:, is_shift] = columns[:, np.searchsorted(self.shifts, index[is_shift])]
        return found

    def _own(self, shared: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n k"] | None:
        """Derivative of the rows of a channel by each shift; None if the remainder of one is not
        small compared with itself and with the next of its group."""
        found, ends = np.zeros((self.rows, len(self.trails))), self.first[GROUPS:]
        found[:, 0] = shared[:, 0]
        trailing = shared[:, 0] / self.trails[0]
        before, left = np.zeros(1 + GROUPS), np.zeros(len(self.trails))
        for k, (begin, end) in enumerate(zip(self.first, ends, strict=False)):
            group, trail = self._group[k], self.trails[k]
            if k > 0:
                found[begin:end, k] = shared[begin:end, group] - before[group] * trailing[begin:end]
                found[end:, k] = trail * trailing[end:]
                before[group] += trail
            if end < self.rows:
                late = slice(min(self.first[k + GROUPS - 1], end - 1), end)
                more = found[late, k] - trail * trailing[late]
                left[k] = np.sqrt(np.mean(more**2) * (self.rows - end))
        size = np.linalg.norm(found, axis=0)
        least = np.minimum(size, np.append(size, [np.inf] * GROUPS)[GROUPS:])
        return found if np.all(left <= FORGOTTEN * least) else None


P = TypeVar("P", bound=AbstractProblem)


class Rows(NamedTuple):
    """Residual and Jacobian of all rows at some parameters.

    `residual` and `jacobian` have all rows of the record, in every block, and padding. The extra
    rows, of unit variance, hold other channels in the train block and shifts of step times.
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
        base = np.concatenate([np.arange(len(self.model.base.names())), shifts])
        shared = self._shared.directions(base, first + len(problem.hold))
        usual = min(len(base), len(shared)) + MORE_DIRECTIONS
        self._size = PASS * -(-usual // PASS)
        heavy = [e.id for e in self.model.effects if issubclass(e, AbstractHeavyEffect)]
        self._heavy = {id: self.model.columns((id,)) for id in heavy}
        self._apart: set[bytes] = set()
        self._known: dict[bytes, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._lock = threading.Lock()

    def simulated(self, z: np.ndarray, problem: P) -> P:
        """The problem to simulate at `z`; costly effects at their null get a first-order form.

        The problem with first-order forms needs another compilation. The additional compilation
        pays, because most candidates lack costly effects.
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
        fewer = self._passes(few) < self._passes(index)
        if fewer and index.tobytes() not in self._apart:
            residual, along = self._in_passes(problem, z, few)
            jacobian = self._shared.jacobian(along, index, len(z))
            if jacobian is not None:
                return residual, jacobian
            self._apart.add(index.tobytes())
        return self._in_passes(problem, z, np.eye(len(z))[index])

    def _passes(self, directions: np.ndarray) -> int:
        """Number of passes for a Jacobian along these directions."""
        return max(-(-len(directions) // self._size), 1)

    def _in_passes(
        self, problem: P, z: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """`_evaluate` along a few directions per pass: it is compiled for one number of them."""
        size = self._size

        def one(begin: int) -> tuple[np.ndarray, np.ndarray]:
            own = directions[begin : begin + size]
            padded = np.pad(own, ((0, size - len(own)), (0, 0)))
            residual, jacobian = _evaluate(problem, *jax.device_put((z, padded)))
            return np.asarray(residual), np.asarray(jacobian)[:, : len(own)]

        found = self.each(one, range(0, self._passes(directions) * size, size))
        return found[-1][0], np.concatenate([jacobian for _, jacobian in found], axis=1)


@traced
def _evaluate(problem: AbstractProblem, z: Float[Array, " q"], directions: Float[Array, "m q"]):
    """Residual and its derivatives along some directions."""

    def push(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(problem.residual, (z,), (tangent,))

    return jax.vmap(push, out_axes=(None, -1))(directions)
