"""Likelihoods of many linear candidates at once, each candidate with its likeliest noise.

Columns are whitened under every noise model of a grid, and only the products of columns are stored.
The likelihood of any choice of columns is then a small linear problem. So the noise is profiled for
each of hundreds of candidates at the cost of one candidate.

`chances` makes likelihood-ratio tests for structure in a residual, with the noise estimated both
with and without the structure.

    LR = 2 (max ln L with the columns of a question - max ln L without them)

A question asks whether certain columns explain structure in a residual. Both likelihoods of the
ratio LR are maximised over the parameters of the fit and over sizes and correlation lengths of the
noise. Noise fitted to a residual with structure absorbs the structure. If the noise fit leaves out
the tested directions, it hardly determines the noise in the tested directions. The likelihood ratio
LR decides between structure and noise.

If the record is short compared with the correlation length, LR exceeds its chi-square distribution.
A bootstrap Bartlett correction therefore divides LR by a factor. The Bartlett factor is the mean of
LR in simulated records of the estimated noise alone, divided by the degrees of freedom, but at
least 1.

Sources: Bartlett 1937 (doi:10.1098/rspa.1937.0109) for the correction; Rocke 1989, J. Am. Stat.
Assoc. 84, 598, for its bootstrap.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from ..fitting.noise import Found, Noises, coloured, gram_of, noises_around
from ..fitting.padding import counted_rows
from ..fitting.thresholds import WIDE
from ..threads import side_by_side
from .engine import Engine
from .evaluate import Rows
from .residual_tests import chi_square_tail
from .thresholds import DRAWS, MEMORIES, NOISE_PASSES, NOISES_AT_ONCE, SEED, SEEN, SIZES


class Evidence(NamedTuple):
    """Products of whitened columns: column 0 is the residual, the last column is constant."""

    products: np.ndarray
    """Products for every noise of the grid, shape (g, m, m), in units of sigma = 1."""
    log_determinant: np.ndarray
    """Log-determinant of the covariance at sigma = 1, shape (g,)."""
    noises: Noises
    rows: float
    extra: np.ndarray
    """Products (m, m) of the extra rows, which have unit variance."""

    def deviance(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """-2 ln L of several choices of columns, profiled over sigma, coefficients and noise.

        `columns` (c, p) holds indices of columns; -1 stands for no column. Returns the deviances
        (c,), the indices of the best noises (c,), and the coefficients (c, p) of the columns in the
        residual.
        """
        used = columns >= 0
        at = np.where(used, columns, 0)
        pairs = (used[:, :, None] & used[:, None, :])[None]
        gram = np.where(pairs, self.products[:, at[:, :, None], at[:, None, :]], 0.0)
        more = np.where(pairs, self.extra[at[:, :, None], at[:, None, :]][None], 0.0)
        side = np.where(used[None], self.products[:, 0, :][:, at], 0.0)
        more_side = np.where(used, self.extra[0, at], 0.0)[None]
        first, first_more = self.products[:, 0, 0][:, None], self.extra[0, 0]
        variance = first / self.rows
        # the noise variance weights friction against the extra rows; a few passes converge
        solved = np.zeros_like(side)
        for _ in range(NOISE_PASSES if self.extra.any() else 1):
            v = variance[..., None]
            solved = _solve(gram / v[..., None] + more, side / v + more_side, used)
            left = first - 2 * np.einsum("gcp,gcp->gc", side, solved)
            left = left + np.einsum("gcp,gcpq,gcq->gc", solved, gram, solved)
            left = np.maximum(left, 1e-300)
            variance = left / self.rows
        kept = first_more - 2 * np.einsum("gcp,gcp->gc", more_side + 0 * side, solved)
        kept = kept + np.einsum("gcp,gcpq,gcq->gc", solved, more + 0 * gram, solved)
        deviance = self.rows * (np.log(variance) + 1) + self.log_determinant[:, None] + kept
        best = np.argmin(deviance, axis=0)
        chosen = np.arange(len(columns))
        return deviance[best, chosen], best, solved[best, chosen]

    def independent_rows(self, noise: int) -> float:
        """Effective number of independent rows under a noise of the grid."""
        return float(np.clip(self.products[noise, -1, -1], 2.0, self.rows))


def _solve(gram: np.ndarray, side: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Coefficients of the used columns; 0 for the others."""
    size = np.sqrt(np.maximum(np.einsum("gcii->gci", gram), 1e-300))
    size = np.where(used[None] & (size > 1e-140), size, 1.0)
    scaled = gram / size[..., :, None] / size[..., None, :]
    ridge = np.where(used, 1e-9, 1.0)[:, :, None] * np.eye(used.shape[1])
    return np.linalg.solve(scaled + ridge[None], (side / size)[..., None])[..., 0] / size


def evidence(
    clock: Array | np.ndarray,
    weight: Array | np.ndarray,
    residual: np.ndarray,
    columns: np.ndarray,
    extra: tuple[np.ndarray, np.ndarray],
    noises: Noises,
    scale: np.ndarray | None = None,
) -> Evidence:
    """Products of the residual and some columns (rows of zero weight are skipped).

    The `extra` rows (residual, columns) are data of unit variance, uncorrelated with other rows.
    All `noises` have the same `scale` of rows.
    """
    n, m = columns.shape
    pad = -(m + 2) % WIDE
    parts = [residual[:, None], columns, np.zeros((n, pad)), np.ones((n, 1))]
    every = np.ones(n) if scale is None else scale
    rows = counted_rows(clock, weight, np.concatenate(parts, axis=1), every)
    g = len(noises.white)

    def some(begin: int) -> tuple[np.ndarray, np.ndarray]:
        at = np.minimum(np.arange(begin, begin + NOISES_AT_ONCE), g - 1)
        return gram_of(*rows, jax.tree.map(lambda x: x[at], noises))

    grams, log_det = zip(*side_by_side(some, range(0, g, NOISES_AT_ONCE)), strict=True)
    more = np.concatenate([extra[0][:, None], extra[1]], axis=1)
    extra_products = np.zeros(grams[0].shape[1:])
    extra_products[: m + 1, : m + 1] = more.T @ more
    number = float(np.sum(np.asarray(weight) > 0))
    both = np.concatenate(grams)[:g], np.concatenate(log_det)[:g]
    return Evidence(*both, noises, number, extra_products)


class Question(NamedTuple):
    """Possible structure in a residual: any linear combination of some columns."""

    name: str
    columns: np.ndarray
    """Columns in units of the problem's noise scale, (n, k)."""
    times: int = 1
    """Number of such tests of which this is the most significant: the Bonferroni factor."""


def chances(
    engine: Engine, rows: Rows, found: Found, questions: Sequence[Question]
) -> dict[str, float]:
    """p-value of every question about the residual of the train block, under noise alone.

    `rows` are the residual and Jacobian of a model. All parameters of the model are free in each
    maximised likelihood. `found` is the noise after projecting out smooth columns.
    """
    weight = engine.weight[:, None]
    jacobian = rows.jacobian * weight
    residual = rows.residual * engine.weight
    null = engine.noise_of_family(residual, jacobian, found.family, (found.theta,))
    rng = np.random.default_rng(SEED)
    white = rng.standard_normal((len(engine.weight), DRAWS))
    drawn = coloured(engine.problem.clock, engine.weight, white, found.noise)
    asked = np.concatenate([q.columns for q in questions], axis=1) * weight
    more = rng.standard_normal((len(rows.extra), DRAWS))
    noises = noises_around(
        found.family,
        (null.theta, found.theta),
        engine.limits(),
        sizes=SIZES,
        memories=MEMORIES,
        alike=True,
        white=False,
    )
    extra = more, rows.extra_jacobian, np.zeros((len(more), asked.shape[1]))
    known = evidence(
        engine.problem.clock,
        engine.weight,
        residual,
        np.concatenate([np.asarray(drawn), jacobian, asked], axis=1),
        (rows.extra, np.concatenate(extra, axis=1)),
        noises,
        engine.noise.scale,
    )
    size, p = 1 + DRAWS, jacobian.shape[1]
    every = known.products + float(found.noise.sigma) ** 2 * known.extra
    rest = _without(every, np.arange(size, size + p))
    places = np.cumsum([size, *(q.columns.shape[1] for q in questions)])
    kept = np.concatenate([np.arange(size), np.arange(size + p, places[-1] + p)])
    rest = rest[:, kept[:, None], kept]
    answers = {}
    for question, begin, end in zip(questions, places, places[1:], strict=False):
        ratio, degrees = _ratios(rest, np.arange(begin, end), size, known)
        usual = max(float(np.mean(ratio[1:])) / max(degrees, 1), 1.0)
        tail = chi_square_tail(float(ratio[0]) / usual, degrees)
        answers[question.name] = min(1.0, question.times * tail)
    return answers


def _without(products: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Products (g, m, m) after projecting all columns orthogonal to some of them."""
    size = np.sqrt(np.maximum(np.einsum("gii->gi", products)[:, columns], 1e-300))
    gram = products[:, columns[:, None], columns] / size[:, :, None] / size[:, None, :]
    cross = products[:, columns] / size[:, :, None]
    ridge = 1e-12 * np.eye(len(columns))
    return products - np.swapaxes(cross, 1, 2) @ np.linalg.solve(gram + ridge, cross)


def _ratios(
    products: np.ndarray, columns: np.ndarray, size: int, known: Evidence
) -> tuple[np.ndarray, int]:
    """LR of some columns for each of the first `size` ones (size,), and its degrees of freedom."""
    squares = np.einsum("gii->gi", products)[:, :size]
    gram = products[:, columns[:, None], columns]
    side = products[:, columns, :size]
    scale, vectors = np.linalg.eigh(gram)
    used = scale > SEEN * np.maximum(scale[:, -1:], 1e-300)
    degrees = int(np.min(np.sum(used, axis=1)))
    if not degrees:
        return np.zeros(size), 0
    seen = np.swapaxes(vectors[:, :, -degrees:], 1, 2) @ side
    gain = np.sum(seen**2 / scale[:, -degrees:, None], axis=1)
    left = np.maximum(squares - gain, 1e-12 * squares)
    deviance = [
        np.min(known.rows * np.log(np.maximum(x, 1e-300)) + known.log_determinant[:, None], axis=0)
        for x in (squares, left)
    ]
    return deviance[0] - deviance[1], degrees
