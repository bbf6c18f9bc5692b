"""Is something left that follows the drive, the slip, the velocity or the time since a step?

The residual is made white under its own noise, whose memory is bounded: what is then left of noise
is independent, of mean 0 and variance 1 (up to what the fit took away). Whether neighbouring rows
are alike is a question about the recorder and is not asked.

With the sizes of the train and of the held-out error, which a verdict also asks about, all answers
are corrected together: noise alone then fails one of them once in 1/p records. The size and memory
of the noise come from the same record, and tests allow for their errors (`fitting.noise_error`).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jax.scipy.special import betainc, gammaincc

QUESTIONS = {
    "block_means": "slow changes along the record",
    "step_locked": "the same shape after every velocity step",
    "spread_after_step": "larger or smaller just after the velocity steps",
    "slip": "follows the slip",
    "position": "follows the position",
    "time": "follows time",
    "log_velocity": "follows the velocity",
    "velocity": "follows the velocity",
    "state": "follows the state of the contact",
    "time_since_step": "follows the time since a step",
    "relaxation_length": "follows the slip since a step",
    "since_reversal": "follows the distance since a stop",
    "wavelength": "a ripple along the slip",
}
"""What the tests look for: three of the innovations, then bumps over one variable (`location`)."""
_BLOCKS = 24
_BINS = 12
_MANY = 1e6
"""Squares that make a variance as good as known."""


def asked(tests: dict[str, float]) -> int:
    """Questions that one verdict asks of a residual: the tests, and the sizes of two errors."""
    return len(tests) + 2


class Groups(NamedTuple):
    """Rows that are compared by the means of groups: the group of each, from 0."""

    block_means: np.ndarray
    """24 blocks of rows."""
    step_locked: np.ndarray
    """Rows of all velocity steps at equal slip since the step; 0: before the first."""


def groups_of(step: np.ndarray, slip: np.ndarray) -> Groups:
    """Of rows of the velocity steps `step` (n,), slipped so far (n,)."""
    return Groups(np.arange(len(step)) * _BLOCKS // len(step), _since_step(step, slip))


def indicators(group: np.ndarray) -> np.ndarray:
    """A column of length 1 for every group, (n, k): its products are the groups' sums."""
    columns = (group[:, None] == np.unique(group)).astype(float)
    return columns / np.linalg.norm(columns, axis=0)


def structure(
    innovations: np.ndarray,
    groups: Groups,
    followed: dict[str, float],
    degrees: Sequence[float] = (math.inf, math.inf),
) -> dict[str, float]:
    """p-values, corrected after Holm with those of `followed` (by variable): small ones mean
    structure.

    block_means, step_locked : means of the groups, compared with F whose denominator has so many
    `degrees` (`KnownNoise.denominator_degrees`). spread_after_step : sizes of rows in the groups of
    step_locked, by ranks (Kruskal-Wallis), for what changes its sign from step to step.
    """
    e = innovations - np.mean(innovations)
    e = e / max(float(np.std(e)), 1e-300)
    since = groups.step_locked
    raw = {
        name: _means(e, group, among)
        for name, group, among in zip(Groups._fields, groups, degrees, strict=True)
    }
    raw["spread_after_step"] = _means(_ranks(np.abs(e[since > 0])), since[since > 0])
    raw |= followed
    return holm(raw, asked(raw))


def p_text(p: float) -> str:
    """A p-value in words: "p = 0.03", a tiny one as a bound."""
    if not math.isfinite(p):
        return "p unknown"
    return "p < 1e-12" if p < 1e-12 else f"p = {p:.2g}"


def holm(raw: dict[str, float], asked: int) -> dict[str, float]:
    """Holm's correction of several p-values, the least of so many that were asked for."""
    corrected, least = {}, 0.0
    for i, name in enumerate(sorted(raw, key=lambda n: raw[n])):
        least = max(least, min(1.0, (asked - i) * raw[name]))
        corrected[name] = least
    return {name: corrected[name] for name in raw}


def _means(e: np.ndarray, group: np.ndarray, among: float = math.inf) -> float:
    sizes = np.bincount(group)
    sums = np.bincount(group, weights=e)
    used = sizes > 0
    return f_tail(float(np.sum(sums[used] ** 2 / sizes[used])), int(used.sum()) - 1, among)


def _ranks(x: np.ndarray) -> np.ndarray:
    """Ranks, to mean 0 and variance 1."""
    n = len(x)
    ranks = np.argsort(np.argsort(x))
    return (ranks - 0.5 * (n - 1)) / np.sqrt(max(n * (n + 1) / 12, 1e-300))


def _since_step(step: np.ndarray, slip: np.ndarray) -> np.ndarray:
    """Bin of each row by slip since its step, finer just after it; rows before the first apart."""
    group = np.zeros(len(step), int)
    for k in np.unique(step):
        rows = step == k
        x = slip[rows] - slip[rows][0]
        share = x / max(float(x[-1]), 1e-300)
        bins = np.minimum((np.sqrt(np.clip(share, 0, 1)) * _BINS).astype(int), _BINS - 1)
        group[rows] = 1 + bins if k else 0
    return group


def chi_square_tail(x: float, degrees: int) -> float:
    """Probability that chi-square with `degrees` exceeds `x`."""
    if degrees < 1:
        return 1.0
    p = float(gammaincc(0.5 * degrees, 0.5 * max(x, 0.0)))
    return p if math.isfinite(p) else 1.0


def f_tail(x: float, degrees: int, among: float) -> float:
    """Probability that a sum of `degrees` squares exceeds `x`, in units of a variance that is known
    as from `among` independent squares: that of F beyond x/degrees."""
    if degrees < 1 or not among < _MANY:
        return chi_square_tail(x, degrees)
    share = among / (among + max(x, 0.0))
    p = float(betainc(0.5 * among, 0.5 * degrees, share))
    return p if math.isfinite(p) else 1.0
