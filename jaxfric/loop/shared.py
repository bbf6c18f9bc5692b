"""Derivatives of a record by the times of many velocity steps, several step times at once.

Delaying a velocity step changes friction from that step until the slider has slipped a few L. So a
group of steps far from each other can be delayed together. The change of friction between one step
of a group and the next step of the group belongs to the first of the two. One change is permanent:
the load point trails by dV dt, which matters if friction depends on slip. The permanent change is
the same for all steps, so it is computed from the first step, delayed alone. The rows before the
next step of a group show whether any other change remains.

Source: Curtis, Powell and Reid, On the estimation of sparse Jacobian matrices, J. Inst. Maths
Applics 13 (1974).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from .thresholds import FORGOTTEN, GROUPS


class SharedShifts:
    """The shifts of step times that are parameters: the first shift alone, and the other shifts in
    groups. Each group of shifts has every `GROUPS`-th velocity step.

    `shifts` are the ascending indices of the shifts in the parameters, `begins` the ascending times
    of the delayed steps. `trails` is the displacement by which a shift of 1 delays the load point.
    `time` is the time of the rows of one channel. The residual has all `channels` in turn, then one
    row for each shift.
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
        those that are not shifts, one by one, then the first shift, then the groups.
        """
        alone = index[~np.isin(index, self.shifts)]
        found = np.zeros((len(alone) + 1 + GROUPS, size))
        found[np.arange(len(alone)), alone] = 1.0
        found[len(alone) + self._group, self.shifts] = 1.0
        return found

    def jacobian(
        self, along: Float[np.ndarray, "r d"], index: Int[np.ndarray, " m"], size: int
    ) -> Float[np.ndarray, "r m"] | None:
        """The Jacobian by the parameters `index` from the derivatives along the `directions`. None
        if the response to a step has not decayed before the next step of its group.
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
