"""Position-dependent force of runs at steady speeds: the weight of a joint, a spring, a slope.

    F = f(run) + w(q) + sgn v u(q) + r sgn v t

F is the force, q the position, v the velocity and t the time. Every run has its own level f, so
that only changes of the force within a run determine w and u. The load w is equal in both
directions: half the sum of the forces of both directions at q. The term u is friction that depends
on position: half the difference of the forces of both directions at q. The term with r is friction
that changes with time. For a joint w is a sin q + b cos q, for a linear axis k q; u has the same
form. The mean over the travel is subtracted from each column of the fit, so that the mean load
stays in the offset of the curve.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .steady_mean import effective_samples
from .steady_run import Run

_ACCEPT = 10.0
"""Least decrease of BIC for a dependence on the position, as for an effect of a loop: "very
strong" evidence (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572)."""
_ROUNDS = 3
"""Number of reweightings of the runs by their residuals."""
_SINGULAR = 1e-10
"""Least ratio of the eigenvalues of the scaled normal matrix; below it columns are collinear."""
_NAMES = {"rotary": ("a", "b"), "linear": ("k",)}
_FRICTION_NAMES = {"rotary": ("a_friction", "b_friction"), "linear": ("m",)}
_EFFECTS = {"rotary": "gravity", "linear": "position_dependence"}


@dataclass(frozen=True, eq=False)
class Load:
    """Position-dependent force of steady runs; arrays are read-only, in SI.

    - `effect`: "gravity", a sin q + b cos q of a joint, or "position_dependence", k q of a linear
      axis.
    - `names`, `values` and `covariance` of the parameters of the force. Further parameters, if
      found, are of friction that depends on position: m of a linear axis, a_friction sin q +
      b_friction cos q of a joint.
    - `centre`: mean over the travel of every column of the fit; the mean load stays in the offset
      of the friction-velocity curve.
    """

    effect: str
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    centre: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard errors of `values`."""
        return np.sqrt(np.diag(self.covariance))

    def root(self) -> np.ndarray:
        """Matrix root R (p, p) of the covariance: R R^T = `covariance`."""
        variance, vectors = np.linalg.eigh(self.covariance)
        return vectors * np.sqrt(np.maximum(variance, 0.0))

    @property
    def both_ways(self) -> int:
        """Number of parameters of the force equal in both directions; `names` begins with these."""
        return len(_NAMES["rotary" if self.effect == "gravity" else "linear"])

    def size(self) -> tuple[float, float]:
        """Return amplitude and standard error of the force that is equal in both directions."""
        p = self.both_ways
        found = float(np.linalg.norm(self.values[:p]))
        along = self.values[:p] / found
        return found, float(np.sqrt(along @ self.covariance[:p, :p] @ along))


def load_of(runs: Sequence[Run], coordinate: str) -> Load | None:
    """Return the position-dependent force; None if it is not significant, if a run lacks positions,
    or if all runs have one direction."""
    rows = [run.rows for run in runs if run.rows is not None]
    placed = [(own, own.position) for own in rows if own.position is not None]
    signs = np.sign([run.speed for run in runs])
    if len(placed) < len(runs) or len(np.unique(signs)) < 2:
        return None
    columns = [_columns(position, coordinate) for _, position in placed]
    forces, p = [own.force for own in rows], columns[0].shape[1]
    plain, turned = [], []
    for sign, own, column in zip(signs, rows, columns, strict=True):
        plain.append(np.concatenate([column, sign * own.time[:, None]], axis=1))
        turned.append(np.concatenate([plain[-1], sign * column], axis=1))
    found, kept = _regressed(turned, forces), [*range(p), *range(p + 1, 2 * p + 1)]
    if found is None or not _seen(*found, kept[p:]):
        found, kept = _regressed(plain, forces), kept[:p]
    if found is None or not _seen(*found, kept[:p]):
        return None
    names = _NAMES[coordinate] + (_FRICTION_NAMES[coordinate] if len(kept) > p else ())
    values, covariance = found[0][kept], found[1][np.ix_(kept, kept)]
    centre = np.mean([own.mean(axis=0) for own in columns], axis=0)
    for array in (values, covariance, centre):
        array.setflags(write=False)
    return Load(_EFFECTS[coordinate], names, values, covariance, centre)


def without_load(load: Load, run: Run, coordinate: str) -> tuple[Run, np.ndarray]:
    """Return a run without the load, with new means and errors. The second result is the derivative
    (p,), times -1, of the run's mean force by the load's parameters.
    """
    assert run.rows is not None and run.rows.position is not None
    columns = _columns(run.rows.position, coordinate) - load.centre
    if len(load.names) > columns.shape[1]:
        columns = np.concatenate([columns, np.sign(run.speed) * columns], axis=1)
    force = run.rows.force - columns @ load.values
    force.setflags(write=False)
    changed = dataclasses.replace(
        run,
        force=float(force.mean()),
        std=float(force.std(ddof=1)),
        effective=effective_samples(force),
        rows=run.rows._replace(force=force),
    )
    return changed, columns.mean(axis=0)


def _columns(position: np.ndarray, coordinate: str) -> np.ndarray:
    """Return sin q and cos q of a joint, q of a linear axis (n, p)."""
    if coordinate == "rotary":
        return np.stack([np.sin(position), np.cos(position)], axis=1)
    return position[:, None]


_Regressed = tuple[np.ndarray, np.ndarray, float]
"""Values, their covariance, and the number of independent samples."""


def _regressed(columns: list[np.ndarray], forces: list[np.ndarray]) -> _Regressed | None:
    """Regress the forces on columns by least squares, with a level and a noise for each run.

    The noise of a run is that of its residual, and its rows count as `effective_samples`
    independent ones. None for collinear columns.
    """
    matrix = np.concatenate([x - x.mean(axis=0) for x in columns])
    force = np.concatenate([f - f.mean() for f in forces])
    sizes = [len(f) for f in forces]
    ends = np.cumsum(sizes)[:-1]
    least = (1e-12 * float(np.ptp(force))) ** 2 + 1e-300  # not 0 for a force without noise
    size = np.sqrt(np.sum(matrix**2, axis=0))
    size = np.where(size > 0, size, 1.0)
    values, normal, samples = np.zeros(len(size)), np.eye(len(size)), 0.0
    for _ in range(_ROUNDS):
        left = np.split(force - matrix @ values, ends)
        worth = np.array([effective_samples(x) for x in left])
        each = worth / (np.array(sizes) * [max(float(np.var(x)), least) for x in left])
        rows = matrix / size * np.repeat(each, sizes)[:, None]
        normal, samples = rows.T @ (matrix / size), float(worth.sum())
        eigenvalues = np.linalg.eigvalsh(normal)
        if eigenvalues[0] < _SINGULAR * eigenvalues[-1]:
            return None
        values = np.linalg.solve(normal, rows.T @ force) / size
    return values, np.linalg.inv(normal) / np.outer(size, size), samples


def _seen(values: np.ndarray, covariance: np.ndarray, samples: float, part: list[int]) -> bool:
    """Whether a part of the values lowers BIC by more than `_ACCEPT`."""
    own = values[part]
    gain = float(own @ np.linalg.solve(covariance[np.ix_(part, part)], own))
    return gain > len(own) * np.log(samples) + _ACCEPT
