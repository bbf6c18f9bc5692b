"""Every rule by which a search refuses a model, in order; each a pure function of a `Trial`.

A gate gives a `Refusal`: its code, the value that it looked at and the threshold, or the parameters
that it is about. `refusal.SOURCES` says where each rule comes from. `loop.json` has all of it for
every model that was tried.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..effects import AbstractPlaceEffect, RecordScales
from ..fitting import Estimate
from ..fitting.abstract_problem import powers
from ..fitting.uncertainty import normal_inverse
from .engine import Engine
from .estimates import estimates
from .refit import Candidate
from .refusal import Fault, Move, Refusal
from .thresholds import (
    ACCEPT,
    BEYOND,
    FAR_VELOCITY,
    KNOWN,
    LEAST_SHARE,
    LOST,
    WORSE,
)


class Trial(NamedTuple):
    """A fitted model that asks to be taken."""

    engine: Engine
    scales: RecordScales
    current: Candidate
    """The model so far."""
    candidate: Candidate
    without: Candidate
    """The candidate's model without its new effect."""

    @property
    def gain(self) -> float:
        """Fall of BIC."""
        return self.current.bic - self.candidate.bic


def converged(trial: Trial) -> Refusal | None:
    """The fit ended, at a motion that could be simulated."""
    return Refusal(Fault.FAILED) if trial.candidate.failed else None


def possible(trial: Trial) -> Refusal | None:
    """Its parameters are physically possible."""
    return None if trial.candidate.physical else Refusal(Fault.IMPOSSIBLE)


def evidence(trial: Trial) -> Refusal | None:
    """BIC falls by more than `ACCEPT`."""
    enough = trial.gain > ACCEPT
    return None if enough else Refusal(Fault.WEAK, value=trial.gain, threshold=ACCEPT)


def predicts(trial: Trial) -> Refusal | None:
    """The error of the select block grows by no more than chance allows.

    Chance is two standard errors of that rms: few rows, or correlated ones, may differ much from
    those of the train block. `WORSE` is allowed in any case.
    """
    before, after = trial.current.rms["select"], trial.candidate.rms
    chance = trial.engine.rms_error(trial.engine.blocks.select, trial.candidate.noise)
    most = max(WORSE, (1 + 2 * chance) * after["train"] / before)
    ratio = after["select"] / before
    return None if ratio <= most else Refusal(Fault.PREDICTS_WORSE, value=ratio, threshold=most)


def fixed(trial: Trial) -> Refusal | None:
    """The record fixes the parameters of its effects, see `not_fixed`."""
    names = not_fixed(trial.engine, trial.candidate, trial.scales)
    return Refusal(Fault.NOT_FIXED, names) if names else None


def takes_nothing(trial: Trial) -> Refusal | None:
    """The base keeps what was known of it without the effect, see `taken`."""
    moves = what_it_takes(trial.engine, trial.without, trial.candidate)
    return Refusal(Fault.TAKES, tuple(m.name for m in moves), moves) if moves else None


Gate = Callable[[Trial], Refusal | None]
FITTED: tuple[Gate, ...] = (converged, possible, evidence, predicts)
"""Of the fit itself."""
GATES: tuple[Gate, ...] = (*FITTED, fixed, takes_nothing)
"""All of them, in order."""
IN_PLACE: tuple[Gate, ...] = (fixed, takes_nothing)
"""Of a model that stands in the place of one that was taken."""


def refusal_of(trial: Trial, gates: Sequence[Gate] | None = None) -> Refusal | None:
    """The first refusal of some gates, by default all; None where a model may be taken."""
    asked = GATES if gates is None else gates
    return next((why for gate in asked if (why := gate(trial)) is not None), None)


# What the record does not fix.


class Part(NamedTuple):
    """A parameter of an effect, its value (SI), and its error where it is counted."""

    name: str
    unit: str
    value: float
    error: float
    """Error relative to the value; for a positive shape the error of its logarithm."""
    amplitude: bool


def not_fixed(engine: Engine, candidate: Candidate, scales: RecordScales) -> tuple[str, ...]:
    """Names of the parameters of a candidate's effects that the record does not fix.

    An amplitude is not fixed where it is no larger than its own error, or where it alone would
    change friction by more than the largest friction recorded. A shape is not fixed where its error
    is as large as its value, or where it lies beyond what the record covers: a length beyond twice
    its path, a time beyond twice its duration, a velocity far from all of its own, and whatever the
    effect itself says is beyond such a record. What is a matter of shape only, as an exponent
    between bounds, need not be fixed: errors are those of the other parameters where it is given.
    """
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
    force = float(np.max(np.abs(engine.noise.friction[: engine.rows])))
    values = engine.values(candidate.z)
    found = [*engine.beyond(candidate.effects, candidate.z, scales)]
    for id in candidate.effects:
        parts, amplitudes = [], engine.model.amplitudes(id)
        for i in engine.model.columns((id,)):
            if i in shapes:
                continue
            size = max(abs(candidate.z[i]), 1e-300) if i in amplitudes else 1.0
            name, unit = engine.names[i], engine.model.quantity(engine.names[i]).unit
            parts.append(Part(name, unit, values[name], error[i] / size, i in amplitudes))
        found += loose(parts, force, scales)
    return tuple(dict.fromkeys(found))


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
        return size <= BEYOND * scales.total_slip
    if part.unit == "s":
        return size <= BEYOND * scales.duration
    if part.unit == "m/s" and not part.amplitude:
        return scales.slowest / FAR_VELOCITY <= size <= FAR_VELOCITY * scales.fastest
    return True


def _is_shape_only(engine: Engine, i: int) -> bool:
    """Whether a parameter only gives a shape: a bounded exponent, or where a logarithm begins."""
    about = engine.model.quantity(engine.names[i])
    return math.isfinite(about.upper) or about.shape_only


# What an effect takes of the base.

_ONE_SIGN = ("A", "B", "L", "M", "F_c", "F_v")
_EITHER = ("B",)
"""Parameters of which clays have negative ones; of others a negative value is no loss."""
_SHARED = ("F_v",)
"""Friction that another curve of velocity may well take over: it may be lost, not turn its sign."""
_WHOLE = ("M", "F_c")


def what_it_takes(engine: Engine, without: Candidate, candidate: Candidate) -> tuple[Move, ...]:
    """The parameters of the base that an effect of a candidate takes; `without` is the fit without
    that effect."""
    new = [e for e in engine.model.effects if e.id in {*candidate.effects} - {*without.effects}]
    of_place = any(issubclass(effect, AbstractPlaceEffect) for effect in new)
    before, after = (estimates(engine, c, "F")[0] for c in (without, candidate))
    return taken(before, after, of_place=of_place)


def taken(
    before: Mapping[str, Estimate], after: Mapping[str, Estimate], *, of_place: bool = False
) -> tuple[Move, ...]:
    """The parameters of the base that are known `before` an effect is added and not what they were
    `after`; `of_place`: the effect depends on the place.

    A rate-and-state term with a long memory looks like inertia, a presliding spring like Coulomb
    friction, heating like an evolution that weakens. A fit with the wrong effect may be as likely
    as one with the right one, and what betrays it is the base: a parameter whose sign friction
    fixes, and that was known without the effect, turns its sign, is lost in its error, or, where it
    is the mass or the Coulomb friction of an axis, falls below a third. What depends on the place
    may take mass: where a weight is missing, accelerations stand for it.
    """
    both = [Move(n, before[n], after[n]) for n in _ONE_SIGN if n in before and n in after]
    return tuple(m for m in both if _is_taken(*m) and not (of_place and m.name in _WHOLE))


def _is_taken(name: str, before: Estimate, after: Estimate) -> bool:
    sign_known = before.value > 0 or name in _EITHER
    if not (before.determined and sign_known and abs(before.value) > KNOWN * before.std):
        return False
    margin = LOST * after.std
    if not (after.determined and np.isfinite(margin)):
        return name not in _SHARED
    if np.sign(before.value) * after.value < -margin * (name in _SHARED):
        return True
    if abs(after.value) < margin and name not in _SHARED:
        return True
    return name in _WHOLE and abs(after.value) + margin < LEAST_SHARE * abs(before.value)
