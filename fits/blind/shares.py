"""Shares, percentiles and ratios of many records, with 95 % intervals and targets.

Intervals beside shares are Wilson's. Those beside a median or a percentile q are the percentiles
at Wilson's limits of q; those beside a ratio of medians are bootstrapped (seeded).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_Z = 1.959963984540054


def wilson(count: float, total: int) -> tuple[float, float]:
    """95 % interval of a share of `count` in `total`."""
    if total == 0:
        return 0.0, 1.0
    p, z2 = count / total, _Z**2
    middle = (p + z2 / (2 * total)) / (1 + z2 / total)
    half = _Z / (1 + z2 / total) * math.sqrt(p * (1 - p) / total + z2 / (4 * total**2))
    return max(0.0, middle - half), min(1.0, middle + half)


def percentile(values: Sequence[float], q: float) -> float:
    """The percentile by the nearest rank above: it may be infinite."""
    rank = min(len(values) - 1, max(0, math.ceil(q * len(values) - 1e-9) - 1))
    return sorted(values)[rank]


@dataclass(frozen=True)
class Number:
    """One number of the study. `sense` is ">=" or "<=" with a target; without one: to be told."""

    what: str
    value: float | None
    low: float | None
    high: float | None
    of: str
    """Where it comes from: "93/100", or a count of records."""
    sense: str = ""
    target: float | None = None
    share: bool = True
    most: float | None = None
    """With a `target` to be ">=": the value may not be above this either."""

    @property
    def reached(self) -> bool | None:
        if self.target is None or self.value is None:
            return None
        if self.most is not None and self.value > self.most:
            return False
        return self.value >= self.target if self.sense == ">=" else self.value <= self.target


def share(
    what: str,
    marks: Sequence[bool],
    sense: str = "",
    target: float | None = None,
    *,
    most: float | None = None,
) -> Number:
    """A share of records."""
    n, k = len(marks), sum(marks)
    if not n:
        return Number(what, None, None, None, "0/0", sense, target, most=most)
    return Number(what, k / n, *wilson(k, n), f"{k}/{n}", sense, target, most=most)


def quantile(what: str, values: Sequence[float], q: float, target: float | None = None) -> Number:
    """A percentile that should be small."""
    n, sense = len(values), "<=" if target is not None else ""
    if not n:
        return Number(what, None, None, None, "0", sense, target, share=False)
    low, high = wilson(q * n, n)
    at, least, most = (percentile(values, each) for each in (q, low, high))
    return Number(what, at, least, most, str(n), sense, target, share=False)


def bias_ratio(what: str, pairs: Sequence[tuple[float, float]], target: float) -> Number:
    """Median bias after over median bias before, of (before, after)."""
    if not pairs:
        return Number(what, None, None, None, "0", "<=", target, share=False)
    table = np.array(pairs)

    def ratio(rows: np.ndarray) -> float:
        before, after = np.median(rows, axis=0)
        return float(after / before) if before > 0 else math.inf

    rng, n = np.random.default_rng(0), len(table)
    drawn = [ratio(table[rng.integers(0, n, n)]) for _ in range(1000)]
    low, high = percentile(drawn, 0.025), percentile(drawn, 0.975)
    return Number(what, ratio(table), low, high, str(n), "<=", target, share=False)
