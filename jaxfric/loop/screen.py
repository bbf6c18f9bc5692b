"""Screens all effects at all shapes, to first order, for effects that would explain a residual.

One Jacobian at the null of all effects holds the sensitivities of effects without shape parameters.
For effects with shapes, `Case.shapes` gives the sensitivities of every shape. The likelihood of
each effect and shape is profiled over the base's parameters, the amplitudes and the noise.
"""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import jax
import numpy as np

from ..effects import RecordScales
from ..errors import InputError, option
from ..fitting.thresholds import FAILED_MISFIT
from .case import Column
from .engine import Engine
from .evaluate import Rows
from .evidence import evidence
from .refit import Candidate
from .thresholds import ACCEPT, OTHER_SHAPE, SEEN, SHAPES


class Screened(NamedTuple):
    """The best shape of one effect, from a fit to first order."""

    id: str
    delta_bic: float
    """BIC with the effect minus that of the base: below 0 is better."""
    z: np.ndarray
    """Parameters to start a joint fit from."""
    other: np.ndarray | None = None
    """The start of the best shape that differs by a factor of two or more, if first order does not
    rule it out: the likelihood of a ripple has many maxima over the wavelength."""


class Screening(NamedTuple):
    """Residual, and sensitivities of the fitted parameters and of all effects and shapes."""

    rows: Rows
    matrix: np.ndarray
    extra: np.ndarray
    """The columns of `matrix` in the extra rows."""
    base: tuple[int, ...]
    columns: tuple[Column, ...]


def sensitivities(
    engine: Engine, current: Candidate, scales: RecordScales, *, addable: bool = False
) -> Screening:
    """Sensitivities of all effects at a fit, in all rows. With `addable` only effects that can be
    added to the fit have sensitivities.
    """
    free = engine.free(current.effects)
    present = (*engine.always, *current.effects)
    missing = [e for e in engine.offered if e.id not in present]
    missing = engine.addable(current.effects) if addable else missing
    shaped = engine.case.shapes(engine, current.z, missing, scales)
    with_shapes = {own.columns[0].id for own in shaped}
    plain = [e for e in missing if e.id not in with_shapes]
    index = np.concatenate([free, *(engine.model.amplitudes(e.id) for e in plain)]).astype(int)
    rows = engine.evaluate(current.z, index)
    columns: list[Column] = []
    place = len(free)
    for effect in plain:
        amplitudes = tuple(engine.model.amplitudes(effect.id))
        at = tuple(range(place, place + len(amplitudes)))
        columns.append(Column(effect.id, {}, amplitudes, at))
        place += len(amplitudes)
    for own in shaped:
        columns += [c._replace(places=tuple(place + k for k in c.places)) for c in own.columns]
        place += own.matrix.shape[1]
    matrix = np.concatenate([rows.jacobian, *(own.matrix for own in shaped)], axis=1)
    extra = np.concatenate([rows.extra_jacobian, *(own.extra for own in shaped)], axis=1)
    return Screening(rows, matrix, extra, tuple(range(len(free))), tuple(columns))


def screen(engine: Engine, current: Candidate, scales: RecordScales) -> list[Screened]:
    """All effects that can be added to `current`, the most promising first."""
    every = sensitivities(engine, current, scales, addable=True)
    seen = _likeliest(engine, current, every)
    problem = engine.problem
    known = evidence(
        problem.clock,
        jax.device_put(engine.known),
        seen.rows.residual * engine.known,
        seen.matrix,
        (seen.rows.extra, seen.extra),
        engine.trial_noises(),
        engine.noise.scale,
    )
    width = len(seen.base) + max(len(c.places) for c in seen.columns)
    rows = [(), *(c.places for c in seen.columns)]
    # column 0 of the evidence is the residual
    asked = np.asarray([_row((*seen.base, *more), width) for more in rows])
    deviance, noise, weights = known.deviance(asked)
    free = engine.free(current.effects)
    fewest = len(free)
    effective = np.asarray([known.independent_rows(k) for k in noise])
    best: list[Screened] = []
    gains: dict[str, list[tuple[float, Column, int]]] = {}
    for i, column in enumerate(seen.columns, start=1):
        gain = float(deviance[0] - deviance[i])
        gains.setdefault(column.id, []).append((gain, column, i))
    for id, found in gains.items():
        starts = [_start(current.z, free, column, weights[i]) for _, column, i in found]
        possible = [k for k, z in enumerate(starts) if engine.physical((id,), z)]
        near = [k for k in possible if engine.moderate(current.z, starts[k])]
        chosen = max(near or possible or range(len(found)), key=lambda k: found[k][0])
        (gain, column, i), z = found[chosen], starts[chosen]
        apart = [
            k
            for k in near or possible
            if found[k][0] > gain - ACCEPT
            and any(abs(v - column.shape[p]) > OTHER_SHAPE for p, v in found[k][1].shape.items())
        ]
        other = starts[max(apart, key=lambda k: found[k][0])] if apart else None
        if not possible:  # the record shows the opposite of the effect
            gain = 0.0
        count = fewest + len(engine.model.columns((id,)))
        delta = count * np.log(effective[i]) - fewest * np.log(effective[0]) - gain
        best.append(Screened(id, float(delta), z, other))
    return sorted(best, key=lambda s: s.delta_bic)


def _likeliest(engine: Engine, current: Candidate, seen: Screening) -> Screening:
    """The most promising shapes of every effect, under white noise and that of the fit."""
    weight = engine.known[:, None]
    both = np.concatenate([seen.rows.residual[:, None], seen.matrix], axis=1) * weight
    _refuse_infinite(seen.columns, both[:, 1:])
    kept: set[int] = set()
    for white in (both, engine.whiten(both, current.noise, engine.known)):
        basis = orthonormal(white[:, [k + 1 for k in seen.base]])
        rest = white - basis @ (basis.T @ white)
        by_id: dict[str, list[tuple[float, int]]] = {}
        for k, column in enumerate(seen.columns):
            own = orthonormal(rest[:, [p + 1 for p in column.places]])
            by_id.setdefault(column.id, []).append((float(np.sum((own.T @ rest[:, 0]) ** 2)), k))
        for found in by_id.values():
            kept |= {k for _, k in sorted(found, reverse=True)[:SHAPES]}
    columns = [seen.columns[k] for k in sorted(kept)]
    places = [*seen.base, *(p for c in columns for p in c.places)]
    moved = {p: i for i, p in enumerate(places)}
    columns = [c._replace(places=tuple(moved[p] for p in c.places)) for c in columns]
    return seen._replace(
        matrix=seen.matrix[:, places], extra=seen.extra[:, places], columns=tuple(columns)
    )


def _start(z: np.ndarray, free: np.ndarray, column: Column, weights: np.ndarray) -> np.ndarray:
    """Parameters after the Gauss-Newton step with coefficients `weights`, at the column's shape."""
    z = np.array(z)
    for place, value in column.shape.items():
        z[place] = value
    targets = np.concatenate([free, column.amplitudes]).astype(int)
    z[targets] -= weights[: len(targets)]
    return z


def aliases(engine: Engine, current: Candidate, scales: RecordScales) -> tuple[tuple, np.ndarray]:
    """Pairs of effect ids, and the |cosine| between the two sensitivities of each pair.

    Sensitivities are first made orthogonal to the sensitivities of the fitted parameters, under the
    noise of the fit. For effects with several amplitudes the largest cosine of any combination
    counts. For effects with shapes the cosine of the closest shape counts. Effects that are already
    in the fit have the fitted shape.
    """

    def seen(gone: str) -> tuple[Screening, np.ndarray] | None:
        if not gone:
            return _whitened(engine, current, scales)
        return _without(engine, current, scales, gone)

    found = engine.each(seen, ("", *current.effects))
    absent = {id: own or found[0] for id, own in zip(current.effects, found[1:], strict=True)}
    here, white = found[0]
    return alias_cosines(engine, current, here, white, absent)


def _whitened(
    engine: Engine, current: Candidate, scales: RecordScales
) -> tuple[Screening, np.ndarray]:
    """Sensitivities, raw and whitened by the noise of the fit."""
    seen = _thinned(sensitivities(engine, current, scales))
    white = engine.whiten(seen.matrix * engine.weight[:, None], current.noise)
    return seen, np.concatenate([white, seen.extra])


def _without(
    engine: Engine, current: Candidate, scales: RecordScales, id: str
) -> tuple[Screening, np.ndarray] | None:
    """Sensitivities with effect `id` at its null, raw and whitened; None if the simulation fails.

    Whether another effect can replace `id` is tested without `id`. With `id` present, the other
    effect would also change the response to `id`, as a sensor gain does, and be similar for that
    reason alone.
    """
    z = np.array(current.z)
    z[engine.model.amplitudes(id)] = 0.0
    seen, white = _whitened(engine, current._replace(z=z), scales)
    failed = np.any(np.abs(seen.rows.residual) >= FAILED_MISFIT)
    return None if failed or not np.all(np.isfinite(white)) else (seen, white)


def _thinned(seen: Screening) -> Screening:
    """The sensitivities of at most a few evenly spread shapes per effect."""
    by_id: dict[str, list[Column]] = {}
    for column in seen.columns:
        by_id.setdefault(column.id, []).append(column)
    columns: list[Column] = []
    for found in by_id.values():
        at = np.unique(np.linspace(0, len(found) - 1, 2 * SHAPES).round().astype(int))
        columns += [found[i] for i in at]
    return seen._replace(columns=tuple(columns))


def alias_cosines(
    engine: Engine,
    current: Candidate,
    seen: Screening,
    white: np.ndarray,
    absent: Mapping[str, tuple[Screening, np.ndarray]],
) -> tuple[tuple[str, ...], np.ndarray]:
    """Effect ids, and the |cosine| between the whitened sensitivities of every two effects (e, e).

    Sensitivities are projected orthogonal to the base. The cosine of two effects is the cosine of
    the least principal angle, and the largest over all shapes. For each effect of the fit, `absent`
    has the sensitivities at a fit without this effect.
    """
    _refuse_infinite(seen.columns, white)
    free = list(engine.free(current.effects))
    parts: dict[str, list[np.ndarray]] = {}
    alone: dict[str, dict[str, list[np.ndarray]]] = {}
    for id in current.effects:
        own = [free.index(i) for i in engine.model.columns((id,))]
        others = [i for i in seen.base if i not in own]
        amplitudes = [free.index(i) for i in engine.model.amplitudes(id)]
        parts[id] = [_beyond(white[:, amplitudes], orthonormal(white[:, others]))]
        # alternatives to an effect in the fit are projected without that effect
        there, columns = absent[id]
        rest = orthonormal(columns[:, others])
        alone[id] = {id: [_beyond(columns[:, amplitudes], rest)]}
        for one in there.columns:
            alone[id].setdefault(one.id, []).append(_beyond(columns[:, list(one.places)], rest))
    everything = orthonormal(white[:, list(seen.base)])
    for column in seen.columns:
        parts.setdefault(column.id, []).append(_beyond(white[:, list(column.places)], everything))
    ids = tuple(parts)
    matrix = np.eye(len(ids))
    for i, a in enumerate(ids):
        for j, b in enumerate(ids[:i]):
            # effects of the fit come first: if only one of the two is in the fit, it is b
            where = alone[b] if b in alone and a not in alone else parts
            pairs = itertools.product(where[a], where[b])
            matrix[i, j] = matrix[j, i] = max((_cosine(p, q) for p, q in pairs), default=0.0)
    return ids, matrix


def _refuse_infinite(columns: tuple[Column, ...], matrix: np.ndarray) -> None:
    """Raise `InputError` for the first effect with a sensitivity that is not finite."""
    for column in columns:
        if not np.all(np.isfinite(matrix[:, list(column.places)])):
            raise InputError(
                f"effects: the derivative of the prediction by an amplitude of {column.id} is not"
                f" finite; leave this effect out ({option('exclude')} {column.id})"
            )


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    if not (a.shape[1] and b.shape[1]):
        return 0.0
    return float(min(np.linalg.svd(a.T @ b, compute_uv=False)[0], 1.0))


def _beyond(columns: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the columns beyond those of `basis`."""
    rest = columns - basis @ (basis.T @ columns)
    seen = np.linalg.norm(rest, axis=0) > SEEN * np.linalg.norm(columns, axis=0)
    return orthonormal(rest[:, seen])


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the space of the columns."""
    if not columns.shape[1]:
        return columns
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    return u[:, s > 1e-10 * max(s[0], 1e-300)]


def _row(columns: tuple[int, ...], width: int) -> list[int]:
    """Places in the evidence, whose column 0 is the residual; padded with -1."""
    return [c + 1 for c in columns] + [-1] * (width - len(columns))
