"""Which effects would explain a residual: every effect and shape, to first order, in one sweep.

At the null of every effect one Jacobian holds all sensitivities. For a candidate the base's
columns and the effect's are fitted together by generalised least squares under noise that is
estimated with both taken out, and the likelihood of what is left is compared with the base's.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..effects import RecordScales, null
from ..fitting.noise import Noise, whiten
from .engine import Candidate, Engine


class Screened(NamedTuple):
    """The best shape of one effect, to first order."""

    id: str
    delta_bic: float
    """BIC of the base less that with the effect: positive is better."""
    z: np.ndarray
    """Parameters to start a joint fit from."""


def screen(engine: Engine, base: Candidate, scales: RecordScales) -> list[Screened]:
    """All effects that are not in `base`, the most promising first."""
    grids = {e.id: null(e).grid(scales) for e in engine.model.effects if e.id not in base.effects}
    rounds = max([1, *(len(v) for grid in grids.values() for v in grid.values())])
    best: dict[str, Screened] = {}
    for k in range(rounds):
        z, members = _shaped(engine, base.z, grids, k)
        residual, jacobian = engine.evaluate(z)
        for id in members:
            found = _score(engine, base, id, z, residual, jacobian)
            if id not in best or found.delta_bic > best[id].delta_bic:
                best[id] = found
    return sorted(best.values(), key=lambda s: -s.delta_bic)


def aliases(engine: Engine, base: Candidate, scales: RecordScales) -> tuple[list[str], np.ndarray]:
    """Ids and |cosine| between their sensitivities, the base's projected out, noise whitened.

    Between effects with two amplitudes the largest cosine of any combination counts. Shapes stand
    at the middle of their grids where the effect is not in `base`.
    """
    grids = {e.id: null(e).grid(scales) for e in engine.model.effects if e.id not in base.effects}
    middle = {id: {n: (v[len(v) // 2],) for n, v in grid.items()} for id, grid in grids.items()}
    z, _ = _shaped(engine, base.z, middle, 0)
    _, jacobian = engine.evaluate(z)
    index = engine.free(base.effects)
    white = _whiten(engine, jacobian, base.noise)
    q = _orthonormal(white[:, index])
    parts = {}
    for effect in engine.model.effects:
        columns = white[:, engine.model.amplitudes(effect.id)]
        rest = columns - q @ (q.T @ columns)
        # what the base fit absorbs to a millionth is not seen at all
        seen = np.linalg.norm(rest, axis=0) > 1e-6 * np.linalg.norm(columns, axis=0)
        parts[effect.id] = _orthonormal(rest[:, seen]) if seen.any() else rest[:, :0]
    ids = list(parts)
    matrix = np.eye(len(ids))
    for i, a in enumerate(ids):
        for j, b in enumerate(ids):
            if i < j and parts[a].shape[1] and parts[b].shape[1]:
                cosine = np.linalg.svd(parts[a].T @ parts[b], compute_uv=False)[0]
                matrix[i, j] = matrix[j, i] = min(float(cosine), 1.0)
    return ids, matrix


def _shaped(engine: Engine, z, grids, k: int) -> tuple[np.ndarray, list[str]]:
    """Parameters with the k-th shape of every effect that has one; and which effects those are."""
    z = np.array(z)
    members = []
    for id, grid in grids.items():
        if not grid and k == 0:
            members.append(id)
        for field, values in grid.items():
            if k < len(values):
                place = engine.names.index(f"{id}.{field}")
                about = engine.model.quantity(engine.names[place])
                z[place] = float(about.to_free(jnp.asarray(values[k])))
                members.append(id)
    return z, members


def _score(engine: Engine, base: Candidate, id: str, z, residual, jacobian) -> Screened:
    index = np.concatenate([engine.free(base.effects), engine.model.amplitudes(id)]).astype(int)
    columns = jacobian[:, index]
    noise = engine.noise(residual, columns)
    white = _whiten(engine, np.concatenate([residual[:, None], columns], axis=1), noise)
    size = np.linalg.norm(white[:, 1:], axis=0)
    size = np.where(size > 0, size, 1.0)
    step, *_ = np.linalg.lstsq(white[:, 1:] / size, -white[:, 0], rcond=1e-10)
    step = step / size
    left = residual + columns @ step
    count = len(engine.free((*base.effects, id)))
    bic, _ = engine.bic(left, count)
    moved = np.array(z)
    moved[index] += step
    return Screened(id, base.bic - bic, moved)


def _whiten(engine: Engine, columns: np.ndarray, noise: Noise) -> np.ndarray:
    problem = engine.problem
    return np.asarray(whiten(problem.time, problem.weight, jnp.asarray(columns), noise))


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    return u[:, s > 1e-10 * max(s[0], 1e-300)] if s.size else u
