"""Is something left that follows the drive, the slip, the velocity or the time since a step?

Noise is correlated over short distances, in a memory that is bounded. Whether neighbouring rows are
alike is a question about the recorder and is not asked. What is asked are likelihood ratios
(`ratio`): whether hats along the record or since the steps, or bumps of friction over one variable
(`location`), make the residual likelier than noise alone does.

With the sizes of the train and of the held-out error, which a verdict also asks about, all answers
are corrected together: noise alone then fails one of them once in 1/p records.
"""

import math

import numpy as np

QUESTIONS = {
    "block_means": "slow changes along the record",
    "step_locked": "the same shape after every change of velocity",
    "spread_after_step": "larger or smaller just after changes of velocity",
    "slip": "follows the slip",
    "position": "follows the position",
    "time": "follows time",
    "log_velocity": "follows the velocity",
    "velocity": "follows the velocity",
    "state": "follows the state of the contact",
    "time_since_step": "follows the time since a step",
    "relaxation_length": "follows the slip since a step",
    "since_reversal": "follows the distance since a stop",
    "wavelength": "a ripple along the path",
}
"""Words for the structure that each test looks for, by the name of the test or variable."""
_BINS = 12


def asked(tests: dict[str, float]) -> int:
    """Questions that one verdict asks of a residual: the tests, and the sizes of two errors."""
    return len(tests) + 2


def structure(
    innovations: np.ndarray, step: np.ndarray, slip: np.ndarray, chances: dict[str, float]
) -> dict[str, float]:
    """p-values of what is asked, corrected after Holm: small ones mean structure.

    `chances` are those of likelihood ratios. One more question is asked of the innovations of the
    rows, of velocity steps `step` (n,) and slipped so far (n,): spread_after_step, the sizes at
    equal slip since the step, by ranks (Kruskal-Wallis), for what changes its sign from step to
    step. Where sizes scatter more among steps than independent rows would, as those of a recorder
    that is quiet at one time and loud at another, the statistic is divided by how much more.
    """
    e = np.abs(innovations - np.mean(innovations))
    since = _since_step(step, slip)
    raw = dict(chances)
    after = since > 0
    raw["spread_after_step"] = _means(_ranks(e[after]), since[after], step[after])
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


def merged(p: float, q: float) -> float:
    """p-value of two that may depend on each other in any way: twice their geometric mean.

    The chance that p q <= e^2 is at most x + e^2/x for any x (Makarov 1981, doi:10.1137/1126086):
    2 e at best. For more than two see Vovk and Wang 2020 (doi:10.1093/biomet/asaa027).
    """
    return min(1.0, 2 * math.sqrt(p * q))


def _means(ranks: np.ndarray, group: np.ndarray, step: np.ndarray) -> float:
    """p-value of equal means of the groups; see `structure` on what scatters among steps."""
    sizes, sums = np.bincount(group), np.bincount(group, weights=ranks)
    used = sizes > 0
    degrees, squares = int(used.sum()) - 1, float(np.sum(sums[used] ** 2 / sizes[used]))
    each, of = np.unique(step, return_inverse=True)
    if len(each) > 1:
        off = ranks - (sums / np.maximum(sizes, 1))[group]
        cells = np.bincount(of * len(sizes) + group, weights=off, minlength=len(each) * len(sizes))
        scatter = np.sum(cells.reshape(len(each), -1) ** 2, axis=0)[used] / sizes[used]
        squares /= max(float(np.mean(scatter)) * len(each) / (len(each) - 1), 1.0)
    return chi_square_tail(squares, degrees)


def _ranks(x: np.ndarray) -> np.ndarray:
    """Ranks of values, scaled to mean 0 and variance 1."""
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
    from scipy.special import gammaincc

    p = float(gammaincc(0.5 * degrees, 0.5 * max(x, 0.0)))
    return p if math.isfinite(p) else 1.0
