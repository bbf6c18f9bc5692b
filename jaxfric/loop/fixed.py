"""Effects that the record does not fix: they are not added, whatever their likelihood.

An amplitude is not fixed where it is no larger than its own error, or where it alone would change
friction by more than the largest friction recorded. A shape is not fixed where its error is as
large as its value, or where it lies beyond what the record covers: a length beyond twice its path,
a time beyond twice its duration, a velocity far from all of its own, and whatever the effect itself
says is beyond such a record. What is a matter of shape
only, as an exponent between bounds, need not be fixed: errors are those of the other parameters
where it is given. A curve whose shape is open has a family for a name (`family`). Two lags of one
model whose errors are those of their sum or difference alone are not fixed either: they may act
against each other, and only what they do together is known.
"""

import math
from typing import NamedTuple

import numpy as np

from ..effects import RecordScales
from ..fitting.abstract_problem import powers
from ..fitting.uncertainty import normal_inverse
from .engine import Candidate, Engine
from .thresholds import ALIAS

_BEYOND = 2.0
_FAR = 30.0


class Part(NamedTuple):
    """A parameter of an effect, its value (SI), and its error where it is counted."""

    name: str
    unit: str
    value: float
    error: float
    """Error relative to the value; for a positive shape the error of its logarithm."""
    amplitude: bool


def loose(parts: list[Part], force: float, scales: RecordScales) -> tuple[str, ...]:
    """Names of the parameters of one effect that are not fixed; `force`: largest one recorded.

    Of several amplitudes (a sine and a cosine) the largest in units of its error counts.
    """
    amplitudes = [p for p in parts if p.amplitude]
    found = [p.name for p in parts if not _possible(p, force, scales)]
    if amplitudes and not min(p.error for p in amplitudes) < 1:
        found += [p.name for p in amplitudes]
    found += [p.name for p in parts if not p.amplitude and not p.error < 1]
    return tuple(dict.fromkeys(found))


def _possible(part: Part, force: float, scales: RecordScales) -> bool:
    """Whether a record of this size can show an effect of such a value."""
    f, m, s = powers(part.unit)
    size = abs(part.value)
    if not math.isfinite(size):
        return False
    if f == 1:
        if m == -s:
            return size * scales.fastest**-m <= force
        return size * scales.total_slip**-m * scales.duration**-s <= force
    if part.unit == "m":
        return size <= _BEYOND * scales.total_slip
    if part.unit == "s":
        return size <= _BEYOND * scales.duration
    if part.unit == "m/s" and not part.amplitude:
        return scales.slowest / _FAR <= size <= _FAR * scales.fastest
    return True


def not_fixed(engine: Engine, candidate: Candidate, scales: RecordScales) -> tuple[str, ...]:
    """Names of the parameters of a candidate's effects that the record does not fix."""
    own = engine.model.columns(candidate.effects)
    shapes = [i for i in own if _is_shape_only(engine, i)]
    index = engine.free(candidate.effects)
    index = index[~np.isin(index, shapes)]
    rows = engine.evaluate(candidate.z, index)
    if rows.failed:
        return candidate.effects
    white = engine.whiten(rows.jacobian * engine.weight[:, None], candidate.noise)
    spread = normal_inverse(np.concatenate([white, rows.extra_jacobian]))
    error = dict(zip(index.tolist(), np.sqrt(np.diag(spread)).tolist(), strict=True))
    force = float(np.max(np.abs(np.asarray(engine.problem.friction)[: engine.rows])))
    values, found, lags = engine.values(candidate.z), [], []
    found += engine.beyond(candidate.effects, candidate.z, scales)
    for id in candidate.effects:
        parts, amplitudes = [], engine.model.amplitudes(id)
        for i in engine.model.columns((id,)):
            if i in shapes:
                continue
            size = max(abs(candidate.z[i]), 1e-300) if i in amplitudes else 1.0
            name, unit = engine.names[i], engine.model.quantity(engine.names[i]).unit
            parts.append(Part(name, unit, values[name], error[i] / size, i in amplitudes))
        found += loose(parts, force, scales)
        lags += [i for i in amplitudes if engine.model.quantity(engine.names[i]).unit == "s"]
    place = {int(i): k for k, i in enumerate(index)}
    at = [place[i] for i in lags]
    found += [engine.names[lags[k]] for k in inseparable(spread[np.ix_(at, at)])]
    return tuple(dict.fromkeys(found))


def _is_shape_only(engine: Engine, i: int) -> bool:
    """Whether a parameter only gives a shape: a bounded exponent, or where a logarithm begins."""
    about = engine.model.quantity(engine.names[i])
    return math.isfinite(about.upper) or about.shape_only


def inseparable(covariance: np.ndarray) -> list[int]:
    """Indices of the amplitudes that the record fixes only together: |correlation| of two errors,
    which is the cosine of their sensitivities beyond all others, exceeds `ALIAS`."""
    size = np.sqrt(np.diag(covariance))
    alike = np.abs(covariance) > ALIAS * size[:, None] * size
    return np.flatnonzero(np.sum(alike, axis=1) > 1).tolist()
