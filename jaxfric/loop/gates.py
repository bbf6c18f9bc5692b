"""The rules by which a search refuses a model, in order. Each rule is a function of a `Trial`.

A gate (a rule of refusal) returns a `Refusal`: a code with the value and the threshold, or a code
with the parameters concerned. `refusal.SOURCES` gives the source of each rule. `loop.json` lists
the refusal of every tried model.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..effects import AbstractPlaceEffect, RecordScales
from ..fitting import Estimate
from ..fitting.abstract_problem import powers
from ..fitting.thresholds import LARGEST_ERROR
from ..fitting.uncertainty import normal_inverse
from .engine import Engine
from .refit import Candidate, estimates
from .refusal import Fault, Move, Refusal
from .thresholds import (
    ACCEPT,
    BEYOND,
    FAR_VELOCITY,
    KNOWN,
    LEAST_SHARE,
    LOST,
)


class Trial(NamedTuple):
    """A fitted model that a search may accept."""

    engine: Engine
    scales: RecordScales
    current: Candidate
    """The model so far."""
    candidate: Candidate
    without: tuple[Candidate, ...]
    """The models to which the effects of the candidate were added, one after another."""

    @property
    def gain(self) -> float:
        """Reduction of BIC from the current model to the trial model."""
        return self.current.bic - self.candidate.bic


def converged(trial: Trial) -> Refusal | None:
    """The fit of the trial ended with a motion that can be simulated."""
    return Refusal(Fault.FAILED) if trial.candidate.failed else None


def possible(trial: Trial) -> Refusal | None:
    """The parameters of the trial are physically possible."""
    return None if trial.candidate.physical else Refusal(Fault.IMPOSSIBLE)


def evidence(trial: Trial) -> Refusal | None:
    """BIC falls by more than `ACCEPT` with this trial."""
    enough = trial.gain > ACCEPT
    return None if enough else Refusal(Fault.WEAK, value=trial.gain, threshold=ACCEPT)


def fixed(trial: Trial) -> Refusal | None:
    """The record determines the parameters of the trial's effects, see `not_fixed`."""
    names = not_fixed(trial.engine, trial.candidate, trial.scales)
    return Refusal(Fault.NOT_FIXED, names) if names else None


def takes_nothing(trial: Trial) -> Refusal | None:
    """The effects do not take over parameters of the base, see `taken`.

    Every model on the way to the candidate is asked, not only the last one. One effect may leave a
    parameter of the base badly known, and the next effect may lose this parameter.
    """
    moves = what_it_takes(trial.engine, trial.without, trial.candidate)
    return Refusal(Fault.TAKES, tuple(m.name for m in moves), moves) if moves else None


Gate = Callable[[Trial], Refusal | None]
FITTED: tuple[Gate, ...] = (converged, possible, evidence)
"""Gates that need the fit only."""
GATES: tuple[Gate, ...] = (*FITTED, fixed, takes_nothing)
"""All gates, in order."""
IN_PLACE: tuple[Gate, ...] = (fixed, takes_nothing)
"""Gates for a model that replaces an accepted one."""


def refusal_of(trial: Trial, gates: Sequence[Gate] | None = None) -> Refusal | None:
    """The first refusal by the given gates (default: all); None if the model may be accepted."""
    asked = GATES if gates is None else gates
    return next((why for gate in asked if (why := gate(trial)) is not None), None)


# Parameters that the record does not determine.


class Part(NamedTuple):
    """A parameter of an effect, with value (SI) and relative error."""

    name: str
    unit: str
    value: float
    error: float
    """Error relative to the value; for a positive shape the error of its logarithm."""
    amplitude: bool
    change: float = math.inf
    """Half the range of the force of an amplitude of place over the train rows [F], else inf."""


def not_fixed(engine: Engine, candidate: Candidate, scales: RecordScales) -> tuple[str, ...]:
    """Names of the parameters of a candidate's effects that the record does not determine.

    An amplitude is undetermined if it does not exceed its standard error, or if it alone would
    change friction by more than the largest recorded friction. For an effect of place the change
    over the train rows may be small instead: over a small angle, a weight is mostly offset. A shape
    parameter is undetermined if its 95 % interval spans a decade, or if it lies outside the range
    of the record. Outside the range are a length beyond twice the path, a time beyond twice the
    duration, and a velocity far from all recorded ones. The class of an effect may set further
    limits to parameters. Pure shape parameters, such as a bounded exponent, need not be determined:
    their values are held fixed when the errors of amplitudes are computed. The errors of lengths,
    times and velocities hold only bounded exponents: a shape without bounds, such as the damping of
    a bristle, may replace a length, which a result states by its value.
    """
    own = engine.model.columns(candidate.effects)
    shapes = [i for i in own if _is_shape_only(engine, i)]
    index = engine.free(candidate.effects)
    rows = engine.evaluate(candidate.z, index)
    if rows.failed:
        return candidate.effects
    white = engine.whiten(rows.jacobian * engine.weight[:, None], candidate.noise)
    columns = np.concatenate([white, rows.extra_jacobian])
    exponents = [i for i in shapes if _is_bounded(engine, i)]
    of_scales, of_amplitudes = (
        _errors(columns[:, free], index[free])
        for free in (~np.isin(index, exponents), ~np.isin(index, shapes))
    )
    force = float(np.max(np.abs(engine.noise.friction[: engine.rows])))
    values = engine.values(candidate.z)
    half = np.ptp(rows.jacobian[engine.weight > 0], axis=0) / 2 * engine.unit
    change = dict(zip(index.tolist(), half.tolist(), strict=True))
    places = {e.id for e in engine.model.effects if issubclass(e, AbstractPlaceEffect)}
    found = [*engine.beyond(candidate.effects, candidate.z, scales)]
    for id in candidate.effects:
        parts, amplitudes = [], engine.model.amplitudes(id)
        for i in engine.model.columns((id,)):
            if i in shapes:
                continue
            size = max(abs(candidate.z[i]), 1e-300) if i in amplitudes else 1.0
            name, unit = engine.names[i], engine.model.quantity(engine.names[i]).unit
            error = (of_amplitudes if i in amplitudes else of_scales)[i] / size
            part = Part(name, unit, values[name], error, i in amplitudes)
            of_place = part.amplitude and id in places
            parts.append(part._replace(change=size * change[i]) if of_place else part)
        found += loose(parts, force, scales)
    return tuple(dict.fromkeys(found))


def _errors(columns: np.ndarray, index: np.ndarray) -> dict[int, float]:
    """Standard error of every parameter `index` with these columns of the whitened Jacobian."""
    return dict(
        zip(index.tolist(), np.sqrt(np.diag(normal_inverse(columns))).tolist(), strict=True)
    )


def loose(parts: list[Part], force: float, scales: RecordScales) -> tuple[str, ...]:
    """Names of the undetermined parameters of one effect. `force` is the largest recorded force.

    If an effect has several amplitudes (a sine and a cosine), only the amplitude with the smallest
    relative error must be determined.
    """
    amplitudes = [p for p in parts if p.amplitude]
    found = [p.name for p in parts if not _possible(p, force, scales)]
    if amplitudes and not min(p.error for p in amplitudes) < 1:
        found += [p.name for p in amplitudes]
    found += [p.name for p in parts if not p.amplitude and not p.error < LARGEST_ERROR]
    return tuple(dict.fromkeys(found))


def _possible(part: Part, force: float, scales: RecordScales) -> bool:
    """Whether a record of this size can show a parameter of this value."""
    f, m, s = powers(part.unit)
    size = abs(part.value)
    if not math.isfinite(size):
        return False
    if f == 1:
        if part.change <= force:
            return True
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
    """Whether a parameter is purely a shape: a bounded exponent, or the start of a logarithm."""
    return _is_bounded(engine, i) or engine.model.quantity(engine.names[i]).shape_only


def _is_bounded(engine: Engine, i: int) -> bool:
    return math.isfinite(engine.model.quantity(engine.names[i]).upper)


# Parameters of the base that an effect takes over.

_ONE_SIGN = ("A", "B", "L", "M", "F_c", "F_v")
_EITHER = ("B",)
"""Parameters that may be negative from the start, as in clays. Others need a positive start."""
_SHARED = ("F_v",)
"""Friction that another curve of velocity may replace: it may be lost, but not change sign."""
_WHOLE = ("M", "F_c")


def what_it_takes(
    engine: Engine, on_the_way: Sequence[Candidate], candidate: Candidate
) -> tuple[Move, ...]:
    """The parameters of the base that effects of a candidate take over, from the first of the fits
    `on_the_way` from which they take any. Each of these fits leaves out some of the effects.
    """
    after = estimates(engine, candidate, "F")[0]
    for without in on_the_way:
        added = {*candidate.effects} - {*without.effects}
        new = [e for e in engine.model.effects if e.id in added]
        of_place = any(issubclass(effect, AbstractPlaceEffect) for effect in new)
        moves = taken(estimates(engine, without, "F")[0], after, of_place=of_place)
        if moves:
            return moves
    return ()


def taken(
    before: Mapping[str, Estimate], after: Mapping[str, Estimate], *, of_place: bool = False
) -> tuple[Move, ...]:
    """The parameters of the base model that the record determines `before` an effect is added, but
    no longer `after`.

    A rate-and-state term with a long L mimics inertia. A presliding spring mimics Coulomb friction,
    and heating mimics a weakening evolution. A wrong effect may fit as well as the right one, but a
    wrong effect changes parameters of the base. The effect takes over a parameter of known sign
    that is determined without the effect if, with the effect, the sign changes or the value falls
    below its error. An effect also takes over mass or Coulomb friction of an axis if the value
    falls below a third of the value without the effect. Exception (`of_place`): an effect of
    position may take over mass and Coulomb friction. Without an effect of position, accelerations
    replace the missing weight in the fit.
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
