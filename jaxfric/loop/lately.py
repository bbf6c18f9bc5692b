"""What was computed lately, and is asked again."""

import threading

import numpy as np

_KEPT = 32 * 2**20


class Lately:
    """The latest linearisations, as many as `_KEPT` bytes hold: a fit begins where the one before
    ended, and its errors are asked where it ends."""

    def __init__(self):
        self._kept: dict[bytes, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._lock = threading.Lock()

    def of(self, z: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Residual and Jacobian at `z` by the parameters of `index`; None where they are not known.

        Not to be written to.
        """
        known = self._kept.get(np.asarray(z, float).tobytes())
        if known is None:
            return None
        columns, residual, jacobian = known
        if not np.all(np.isin(index, columns)):
            return None
        if np.array_equal(index, columns):
            return residual, jacobian
        place = {int(column): k for k, column in enumerate(columns)}
        return residual, jacobian[:, [place[int(k)] for k in index]]

    def keep(
        self, z: np.ndarray, index: np.ndarray, residual: np.ndarray, jacobian: np.ndarray
    ) -> None:
        """Take them in, and let go of the oldest."""
        for array in (residual, jacobian):
            array.flags.writeable = False
        key, most = np.asarray(z, float).tobytes(), _KEPT // max(jacobian.nbytes, 1)
        with self._lock:
            self._kept.pop(key, None)
            self._kept[key] = np.array(index), residual, jacobian
            for oldest in list(self._kept)[: max(len(self._kept) - max(most, 2), 0)]:
                del self._kept[oldest]
