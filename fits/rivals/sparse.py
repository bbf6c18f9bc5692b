"""PySINDy: sparse regression of what the base leaves on a library of terms.

Two of its optimisers: STLSQ, its default, over a grid of thresholds and ridge penalties, and FROLS,
which adds one term after the other. Columns are scaled to one norm, the target by its rms. Trained
on the train block.
"""

import warnings
from collections.abc import Callable, Iterator

import numpy as np

from .answers import Claim, Formula, weight
from .base import Base
from .terms import Term, library

SHARES = (0.03, 0.05, 0.08, 0.12, 0.18, 0.25, 0.35, 0.5)
"""Thresholds: the rms of a term's part over that of the target."""
RIDGES = (1e-6, 1e-3, 1e-1)
MOST = 12


def stlsq(base: Base) -> list[Formula]:
    """Formulas of STLSQ, one for each threshold and penalty."""
    from pysindy.optimizers import STLSQ

    def fits(x: np.ndarray, y: np.ndarray) -> Iterator[np.ndarray]:
        for share in SHARES:
            for ridge in RIDGES:
                optimizer = STLSQ(threshold=share * np.sqrt(len(y)), alpha=ridge)
                yield np.ravel(optimizer.fit(x, y).coef_)

    return _formulas(base, fits)


def frols(base: Base) -> list[Formula]:
    """Formulas of FROLS with one to `MOST` terms."""
    from pysindy.optimizers import FROLS

    def fits(x: np.ndarray, y: np.ndarray) -> Iterator[np.ndarray]:
        path = FROLS(max_iter=MOST, alpha=1e-6).fit(x, y).history_
        for coefficients in path:
            yield np.ravel(coefficients)

    return _formulas(base, fits)


def _formulas(
    base: Base, fits: Callable[[np.ndarray, np.ndarray], Iterator[np.ndarray]]
) -> list[Formula]:
    """Formulas of all fits to the scaled columns of the train block."""
    terms, train = library(base), base.rows("train")
    columns = np.stack([term.values for term in terms], axis=1)
    scale = base.rms(base.residual, "train")
    norms = np.linalg.norm(columns[train], axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    from threadpoolctl import threadpool_limits

    # small matrices are slower on many threads; a threshold that leaves no term warns
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = list(fits(columns[train] / norms, base.residual[train] / scale))
    return [_formula(base, terms, columns, c * scale / norms) for c in found if np.any(c)]


def _formula(base: Base, terms: list[Term], columns: np.ndarray, c: np.ndarray) -> Formula:
    used = np.flatnonzero(c)
    claims = [
        Claim(terms[i].name, (terms[i].kind,), weight(base, c[i] * columns[:, i])) for i in used
    ]
    return Formula(tuple(claims), base.residual - columns @ c, len(used))
