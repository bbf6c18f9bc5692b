"""Steps of the normal stress while a run slides steadily: the alpha of Linker and Dieterich.

If the normal stress changes from s1 to s2 before the slider slips L, the state theta falls at once
by alpha ln(s2/s1). After this fall friction returns to its level over a slip L (Linker & Dieterich
1992, J. Geophys. Res. 97, 4923-4940). The fit estimates alpha, f0, A, B, L and K (`stress_fit`). A
single step hardly determines A, B and L separately; the prior of A, B and L comes from the nearest
velocity steps, with errors. The prior of K has an error of 10 %; the loading after a step
determines K within 0.1 %.

No alpha is reported if another event is superposed, if the slider slips several L during the
change, or if the residual is not noise.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..findings import reasoned, warned
from ..fitting.uncertainty import QUANTILE
from ..laws.registry import evolution_of
from ..plain import entries
from ..records import Record
from ..records.stress import StressChange, find_stress_changes, is_constant
from ..silent import silent
from ..units import measured
from .events import Event, end_of
from .fits import HowFitted, StepFit
from .reasons import RunReason
from .stress_fit import StressFit, fit_stress, prior_of, stiffness_of
from .stress_problem import StressRows
from .stress_ramp import find_ramp
from .table import Cell, short, with_std

_FEWEST = 10
"""Least number of rows before and after the change."""
_BEFORE = 10.0
"""Load-point motion of the rows before the change, in L; at most half the time since the last
event."""
_SLOW = 3.0
"""A change is too slow if the slider slips this number of L during the change."""
_STEADY, _SURE = 0.1, 4.0
"""Sliding is steady before the change if friction changes by less than `_STEADY` of the full
loading by the load point, or by less than `_SURE` standard errors."""
_SCALES = {"f0": 1.0, "A": 1.0, "B": 1.0, "L [um]": 1e6, "K [1/um]": 1e-6}
"""Columns of a fit, and how many of their units make one SI unit."""
_ROUGH = 3.0
"""Largest residual of a fit, over that of the velocity steps' fits."""


@dataclass(frozen=True, eq=False)
class FittedStress:
    """A step of the normal stress from `before` to `after` [Pa] at `time`, in `lasts` [s].

    `alpha` and its standard `error`; None if not reported, with the reason `why`. `velocity` is the
    velocity of the load point [m/s]. `fit` is the fit, `prior` the numbers of the velocity steps
    that give the prior of A, B and L, `rows` the fitted rows; None without a fit.
    """

    time: float
    lasts: float
    velocity: float
    before: float
    after: float
    alpha: float | None = None
    error: float | None = None
    why: str = ""
    prior: tuple[int, ...] = ()
    fit: StressFit | None = None
    rows: StressRows | None = None


class _NotClaimedError(Exception):
    """The reason why no alpha is reported, its argument."""


def fit_stress_steps(
    record: Record,
    events: Sequence[Event],
    steps: Sequence[StepFit],
    how: HowFitted,
    *,
    progress: Callable[[str], None] = silent,
) -> tuple[FittedStress, ...]:
    """Fit every step of the normal stress of a run (`fits.RunFit`); a failed step has a reason.
    Records without a normal stress, or of a force, have no stress steps."""
    if record.normal_stress is None or record.friction_unit != "1":
        return ()
    changes = find_stress_changes(record.relative_time, record.normal_stress)
    chosen = [event for event in events if event.kind == "stress"]
    out = []
    for number, event in enumerate(chosen, 1):
        change = min(changes, key=lambda c: _apart(c, event.time), default=None)
        if change is None:
            continue
        progress(f"stress step {number} of {len(chosen)}, at {event.time:.6g} s")
        lasts = change.stop - change.start
        blank = FittedStress(event.time, lasts, event.after, change.before, change.after)
        try:
            out.append(_fitted(record, event, change, events, steps, how, blank))
        except _NotClaimedError as error:
            out.append(replace(blank, why=error.args[0]))
    return tuple(out)


def _apart(change: StressChange, time: float) -> tuple[float, float]:
    """Return the distances of a time from a change and from its start; the second decides if one
    change begins where another ends."""
    return max(change.start - time, time - change.stop, 0.0), abs(change.start - time)


def _fitted(
    record: Record,
    event: Event,
    change: StressChange,
    events: Sequence[Event],
    steps: Sequence[StepFit],
    how: HowFitted,
    blank: FittedStress,
) -> FittedStress:
    _refuse_superposed(event)
    prior = prior_of(steps, event.time)
    if prior is None or evolution_of(how.law) is None:
        raise _NotClaimedError(warned(RunReason.NO_PRIOR))
    L = float(np.exp(prior.mean[2]))
    rows = _rows(record, event, change, events, (_BEFORE * L / event.before, how.rows))
    given = how.stiffness is not None
    found = stiffness_of(steps, change.before)
    K = found if how.stiffness is None else how.stiffness.at(change.before)
    assert K is not None  # the steps of the prior have one
    _refuse_unsteady(rows, K, event.before)
    _refuse_slow(change, L, K, event.before, float(np.median(rows.friction)))
    fit = fit_stress(
        rows,
        prior,
        velocity=event.before,
        law=how.law,
        stiffness=K,
        stiffness_given=given and not how.fit_stiffness,
        slip_trend=how.slip_trend,
    )
    done = replace(blank, prior=prior.steps, fit=fit, rows=rows)
    alpha, error = fit.values["alpha"], fit.errors["alpha"]
    usual = [s.fit.rms for s in steps if s.fit is not None and s.number in prior.steps]
    if why := _doubt(fit, float(np.median(usual))):
        return replace(done, why=why)
    return replace(done, alpha=alpha, error=error)


def _refuse_superposed(event: Event) -> None:
    if event.before != event.after or event.before <= 0:
        speeds = {"before": event.before, "after": event.after}
        raise _NotClaimedError(warned(RunReason.VELOCITIES, **speeds))


def _rows(
    record: Record,
    event: Event,
    change: StressChange,
    events: Sequence[Event],
    limits: tuple[float, int],
) -> StressRows:
    """Return the rows from half the time since the last event up to the next event.

    `limits`: the longest time before the change [s], and the largest number of block means.
    """
    t, stress = record.relative_time, record.normal_stress
    assert stress is not None
    others = [e for e in events if e is not event and e.kind != "glitch"]
    since = max((end_of(e) for e in others if e.time < change.start), default=0.0)
    until = min((e.time for e in others if e.time > change.start), default=float(t[-1]) + 1.0)
    if since > change.start or until < change.stop:
        raise _NotClaimedError(warned(RunReason.OTHER_EVENT))
    longest, most = limits
    first = int(np.searchsorted(t, max((since + change.start) / 2, change.start - longest)))
    edges = np.searchsorted(t, [change.start, change.stop, until])
    low, high, last = int(edges[0]), int(edges[1]) + 1, int(edges[2])
    beside = {"before": low - first, "after": max(last - high, 0)}
    if min(beside.values()) < _FEWEST:
        raise _NotClaimedError(warned(RunReason.FEW_ROWS, **beside, needed=_FEWEST))
    if not (is_constant(stress[first:low], 4) and is_constant(stress[high:last], 4)):
        raise _NotClaimedError(warned(RunReason.STRESS_VARIES))
    weight = np.ones(len(t))
    weight[low : high + 1] = 0.0
    for glitch in (e for e in events if e.kind == "glitch"):
        row = int(np.searchsorted(t, glitch.time))
        weight[max(row - 1, 0) : row + 4] = 0.0
    ramp = find_ramp(t[first:last], stress[first:last], low - first, high - first)
    before, after = np.arange(first, low), np.arange(high, last)
    size = -(-(last - first) // most)
    groups = [x[: len(x) // size * size].reshape(-1, size) for x in (before, after)]
    kept = np.concatenate(groups)
    if size > 1:  # keep the first row, from which times count
        kept = np.concatenate([np.full((1, size), first), kept])
    begin = float(t[first])
    return StressRows(
        t[kept].mean(axis=1) - begin,
        record.friction[kept].mean(axis=1),
        weight[kept].min(axis=1),
        ramp.corners - begin,
        ramp.ratios,
        ramp.unsure,
    )


def _refuse_unsteady(rows: StressRows, K: float, velocity: float) -> None:
    """Raise if friction still rises or falls before the stress changes."""
    before = (rows.time < rows.corners[0]) & (rows.weight > 0)
    x, f = velocity * rows.time[before], rows.friction[before]
    (slope, _), covariance = np.polyfit(x, f, 1, cov=True)
    if abs(slope) > _STEADY * K and abs(slope) > _SURE * np.sqrt(covariance[0, 0]):
        raise _NotClaimedError(warned(RunReason.LOADS, share=slope / K))


def _refuse_slow(
    change: StressChange, L: float, K: float, velocity: float, friction: float
) -> None:
    """Raise if the slider slips several L during the change. Slip is load-point motion minus the
    extension of the spring."""
    ratio = change.after / change.before
    way = velocity * (change.stop - change.start)
    slip = way - max(friction * (ratio - 1) / K, 0.0)
    if slip > _SLOW * L:
        raise _NotClaimedError(warned(RunReason.SLOW, slip=slip, lengths=slip / L))


def _doubt(found: StressFit, usual: float) -> str:
    """Return the reason why a fitted alpha is not reported, or ''."""
    alpha, error = found.values["alpha"], found.errors["alpha"]
    if not found.converged or not np.isfinite([alpha, error]).all():
        return warned(RunReason.FAILED)
    if found.rms > _ROUGH * usual:
        return warned(RunReason.ROUGH, times=found.rms / usual)
    return warned(RunReason.UNDETERMINED) if QUANTILE * error > found.values["f0"] else ""


def rows(found: Sequence[FittedStress]) -> list[dict[str, Cell]]:
    """Return a row for every step of the normal stress, units in the names; None: not known."""
    out: list[dict[str, Cell]] = []
    for number, one in enumerate(found, 1):
        row: dict[str, Cell] = {
            "stress step": number,
            "time [s]": round(one.time, 4),
            "lasts [s]": short(one.lasts, 5),
            "velocity [um/s]": short(one.velocity, scale=1e6),
            "normal_stress before [MPa]": short(one.before, 6, 1e-6),
            "normal_stress after [MPa]": short(one.after, 6, 1e-6),
            **with_std("alpha", one.alpha, one.error, digits=6),
        }
        if one.fit is not None and one.alpha is not None:
            for label, scale in _SCALES.items():
                name = label.split()[0]
                row |= with_std(label, one.fit.values[name], one.fit.errors[name], scale, 6)
            row["rms"] = short(one.fit.rms, 4)
        row["A, B, L known from steps"] = " ".join(map(str, one.prior))
        row["result"] = one.why or "converged"
        out.append(row)
    return out


def to_json(found: Sequence[FittedStress]) -> list[dict[str, object]]:
    """Return the stress steps as JSON values, SI."""
    out = []
    for one in found:
        fit = None if one.alpha is None else one.fit
        own: dict[str, object] = {
            "normal_stress": [one.before, one.after],
            "known_from_steps": list(one.prior),
            "prior_widened": None if one.fit is None else one.fit.widened,
            "values": None if fit is None else fit.values,
            "errors": None if fit is None else fit.errors,
            **reasoned(one.why),
        }
        out.append(entries(one, "time", "lasts", "velocity", "alpha", "error") | own)
    return out


def told(found: Sequence[FittedStress]) -> list[str]:
    """Return lines on the steps of the normal stress."""
    lines = []
    for one in found:
        line = f"normal stress {one.before / 1e6:.4g} -> {one.after / 1e6:.4g} MPa at"
        line += f" {one.time:.6g} s: "
        if one.alpha is None or one.error is None:
            lines.append(f"{line}no alpha: {one.why}")
            continue
        line += f"alpha {measured(one.alpha, one.error)}"
        if one.fit is not None and one.fit.widened > 1:
            line += (
                f"; its A, B, L differ from those of the velocity steps by {one.fit.widened:.2g}"
                " times the errors"
            )
        lines.append(line)
    return lines
