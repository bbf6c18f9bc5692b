"""Likelihood-ratio tests for structure in a residual, with the noise estimated under both models.

    LR = 2 (max ln L with the columns of a question - max ln L without them)

A question asks whether certain columns explain structure in a residual. Both likelihoods are
maximised over the parameters of the fit and over sizes and correlation lengths of the noise. Noise
fitted to a residual with structure absorbs this structure. If the tested directions are left out of
the noise fit, the fit hardly determines the noise in these directions. The likelihood ratio LR
decides between the two descriptions.

If the record is short compared with the correlation length, LR exceeds its chi-square distribution.
A bootstrap Bartlett correction therefore divides LR by a factor. The factor is the mean of LR in
simulated records of the estimated noise alone, over the degrees of freedom, but at least 1.

Sources: Bartlett 1937 (doi:10.1098/rspa.1937.0109) for the correction; Rocke 1989, J. Am. Stat.
Assoc. 84, 598, for its bootstrap.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..fitting.noise import Found, coloured, noises_around
from .engine import Engine
from .evaluate import Rows
from .evidence import Evidence, evidence
from .residual_tests import chi_square_tail
from .thresholds import DRAWS, MEMORIES, SEED, SEEN, SIZES


class Question(NamedTuple):
    """Possible structure in a residual, as any combination of some columns."""

    name: str
    columns: np.ndarray
    """Columns in units of the problem's noise scale, (n, k)."""
    times: int = 1
    """Number of such tests of which this is the most significant: the Bonferroni factor."""


def chances(
    engine: Engine, rows: Rows, found: Found, questions: Sequence[Question]
) -> dict[str, float]:
    """p-value of every question about the residual of the train block, under noise alone.

    `rows` are the residual and Jacobian of a model, whose parameters are free in every maximum.
    `found` is the noise after projecting out smooth columns.
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
