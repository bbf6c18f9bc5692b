"""Lines of the table of `peers.py`."""

import time
from collections.abc import Callable

import numpy as np


def timed(function: Callable[[], object], repeats: int = 5) -> float:
    """Median of seconds of calls, after a first one."""
    function()
    spent = []
    for _ in range(repeats):
        begun = time.perf_counter()
        function()
        spent.append(time.perf_counter() - begun)
    return float(np.median(spent))


class Table:
    """Ours first; a peer's line says how many times as long it takes as ours of a given name."""

    def __init__(self, title: str, error: str):
        self.error, self._ours = error, {}
        print(f"\n{title}", flush=True)

    def ours(self, name: str, seconds: float, error: float) -> None:
        self._ours[name] = seconds
        self._line(f"jaxfric, {name}", seconds, error)

    def peer(self, name: str, seconds: float, error: float, against: str) -> None:
        times = seconds / self._ours[against]
        self._line(name, seconds, error, f"   {times:8.3g} x jaxfric, {against}")

    def _line(self, name: str, seconds: float, error: float, more: str = "") -> None:
        print(
            f"  {name:44s} {1e3 * seconds:10.4g} ms   {self.error} {error:7.1e}{more}", flush=True
        )
