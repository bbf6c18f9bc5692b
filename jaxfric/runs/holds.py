"""Slide-hold-slide tests: frictional healing during holds, and the law that describes it.

During a hold of duration t_h after sliding at velocity V, friction creeps down from the steady
level of sliding. After the reload friction passes a peak above the steady level; healing is the
height of this peak. Under the ageing law in a stiff machine healing grows with B ln t_h (Dieterich
1972, J. Geophys. Res. 77, 3690-3697). Under the slip law the contact does not age at rest in a
stiff machine. To compare the laws, A, B and L are fitted to each sequence of slide, hold and slide,
once under each law, with the machine's stiffness. The criterion for the better law is the
likelihood of the residual, with noise estimated for each law (`fitting.noise`). Consecutive holds
share A, B and L; with separate parameters for each hold the wrong law could imitate every hold.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..findings import warned
from ..fitting import Fit
from ..fitting.misfit import excess
from ..fitting.noise import estimate_noise, longest_memory, noise_rows
from ..fitting.problem import clock_of
from ..records import Record, VelocitySteps
from ..records.differences import noise_from_differences
from ..records.stress import is_constant
from ..silent import silent
from ..units import measured
from .events import Event
from .fits import HowFitted
from .left_out import SAME, joints_of, why_left_out
from .peaks import FEWEST, peak_of
from .reasons import RunReason
from .table import Cell, rounded, short, with_std
from .weighted import WeightedLine, line_over_decades

LAWS = ("slip", "ageing")
_LEVEL = 0.1
"""Share of the window before a hold whose median is the level."""
_LATE = 0.2
"""Largest time from the last row of a hold to its end, over its duration."""
_STRONG = 3.0
"""Least difference of ln L that prefers a law, odds of 20 to 1."""
_NOISES, _SPREADS = 14.0, 8.0
"""Least excess of the rise of friction over the load of the spring, in scatters of neighbouring
rows and in scatters of sliding before the hold. The range of noise in thousands of rows is 9."""
_MANY = 10.0
"""Largest residual of a law that is compared, over the scatter of neighbouring rows. The true law
has up to 4 in measured noise."""


@dataclass(frozen=True, eq=False)
class Hold:
    """A hold of `lasts` [s] at `time` [s], from and to sliding at `velocity` [m/s].

    `creep` is the decrease of friction during the hold (None: not recorded), with standard error
    `creep_error` (of noise, and of the line's shape at the end of the hold), `healing` the height
    of the peak after the hold above the level before the hold, with standard `error` (of noise,
    white and slow, and of the peak's shape). `fits` are
    the converged fits by law, to all holds with the same number `group`. `preference` is the
    log-likelihood ln L of the slip law minus ln L of the ageing law; None without both fits.
    `missing` is unrecorded motion of the load point [m] (`missing_motion`). If motion is missing,
    the hold was shorter than recorded, and neither law is tested.
    """

    time: float
    lasts: float
    velocity: float
    normal_stress: float | None
    creep: float | None
    healing: float
    error: float
    fits: dict[str, Fit]
    preference: float | None
    group: int = 1
    missing: float = 0.0
    creep_error: float = 0.0


class HoldWindow(NamedTuple):
    """A hold between sliding at about one velocity: its event, start and end of its window [s], and
    the reload event."""

    event: Event
    start: float
    stop: float
    reload: Event

    @property
    def back(self) -> float:
        """Time of the reload [s]."""
        return self.reload.time


_Measured = tuple[HoldWindow, Hold]


def find_holds(events: Sequence[Event], end: float) -> list[HoldWindow]:
    """Return the holds between sliding at about one velocity."""
    out = []
    joints = joints_of(events)
    for k, (event, back) in enumerate(pairwise(joints)):
        if event.kind != "hold" or why_left_out(event, back):
            continue
        before = joints[k - 1].time if k else 0.0
        after = joints[k + 2].time if k + 2 < len(joints) else end
        out.append(HoldWindow(event, (before + event.time) / 2, after, back))
    return out


def follows(last: HoldWindow, window: HoldWindow) -> bool:
    """Whether a hold directly follows another hold at the same velocity."""
    ratio = window.event.before / last.event.before
    return window.event.time == last.stop and 1 / SAME < ratio < SAME


def fit_holds(
    record: Record,
    events: Sequence[Event],
    how: HowFitted,
    *,
    progress: Callable[[str], None] = silent,
) -> tuple[Hold, ...]:
    """Return the healing of every hold under constant normal stress, fitted with both laws.

    Consecutive holds that no law can fit together are fitted one by one; the laws are then not
    compared. Raises `InputError` if the stiffness is not known.
    """
    groups: list[list[_Measured]] = []
    for window in find_holds(events, float(record.relative_time[-1])):
        if (hold := _healed(record, window, how)) is None:
            continue
        last, before = groups[-1][-1] if groups else (window, hold)
        whole = not (before.missing or hold.missing)
        if groups and whole and follows(last, window):
            groups[-1].append((window, hold))
        else:
            groups.append([(window, hold)])
    if groups and how.stiffness is not None:
        how.stiffness.at(groups[0][0][1].normal_stress)
    out: list[Hold] = []
    for number, group in enumerate(groups, 1):
        progress(f"holds {number} of {len(groups)}, from {group[0][1].time:.6g} s")
        made = _fitted_together(record, group, how, out[-1].group + 1 if out else 1)
        if not (made[0].fits or len(group) == 1):  # fit each hold by itself
            made = [
                replace(hold, preference=None)
                for k, one in enumerate(group)
                for hold in _fitted_together(record, [one], how, made[0].group + k)
            ]
        out += made
    return tuple(out)


def _healed(record: Record, window: HoldWindow, how: HowFitted) -> Hold | None:
    """Return a hold with its healing and no fit, or None if it cannot be measured."""
    event = window.event
    try:
        part = record.window(window.start, window.stop)
    except InputError:
        return None
    begin = float(part.time[0] - record.time[0])
    seen = _heal(part, event.time - begin, window.back - begin)
    if seen is None:
        return None
    creep, creep_error, healing, error, spread = seen
    K = None if how.stiffness is None else how.stiffness.at(event.normal_stress)
    missing = missing_motion(part, event.time - begin, K, spread)
    return Hold(
        time=event.time,
        lasts=window.back - event.time,
        velocity=event.before,
        normal_stress=event.normal_stress,
        creep=None if missing else creep,
        healing=healing,
        error=error,
        fits={},
        preference=None,
        missing=missing,
        creep_error=creep_error,
    )


def missing_motion(
    part: Record, hold: float, stiffness: float | None, spread: float = 0.0
) -> float:
    """Return the unrecorded motion of the load point after the start of a `hold` [s], in m.

    A spring of stiffness K whose load point moves by u raises friction by at most K u. A larger
    rise of friction shows motion without rows, or motion that an encoder reset hides. The result is
    0 if the excess rise is within noise (with at least the `spread` of sliding before the hold).
    The result is also 0 if a stiffness up to twice as large would explain the excess rise, or if
    the record has no displacement.
    """
    u = part.load_point_displacement
    if u is None or not stiffness:
        return 0.0
    # the hold may have no rows
    on = max(int(np.searchsorted(part.relative_time, hold)) - FEWEST, 0)
    f, pulled = part.friction[on:], stiffness * u[on:]
    rest = f - pulled
    lowest = np.minimum.accumulate(rest)
    last = int(np.argmax(rest - lowest))
    first = int(np.argmin(rest[: last + 1]))
    beyond, rise = float(rest[last] - lowest[last]), float(f[last] - f[first])
    noise = max(_NOISES * noise_from_differences(rest), _SPREADS * spread)
    known = beyond > noise and rise / 2 < beyond < 2 * rise
    return beyond / stiffness if known else 0.0


def _fitted_together(
    record: Record, group: Sequence[_Measured], how: HowFitted, number: int
) -> list[Hold]:
    """Return consecutive holds with one fit of each law to all of them."""
    windows = [window for window, _ in group]
    first = windows[0].event
    part = record.window(windows[0].start, windows[-1].stop)
    begin = float(part.time[0] - record.time[0])
    events = [event for window in windows for event in (window.event, window.reload)]
    steps = VelocitySteps(
        np.array([0.0, *(event.time - begin for event in events)]),
        np.array([first.before, *(v for w in windows for v in (0.0, w.reload.after))]),
        time_errors=np.array([0.0, *(event.time_error for event in events)]),
    )
    asked = () if group[0][1].missing else LAWS
    found = {law: _fitted(part, steps, first, how, law) for law in asked}
    for law, other in permutations(asked, 2):
        if found[law] is None and found[other] is not None:
            found[law] = _fitted(part, steps, first, how, law, found[other])
    fits = {law: fit for law, fit in found.items() if fit is not None}
    both = len(fits) == len(LAWS)
    preference = log_likelihood(fits["slip"]) - log_likelihood(fits["ageing"]) if both else None
    return [replace(hold, fits=fits, preference=preference, group=number) for _, hold in group]


def _fitted(
    part: Record,
    steps: VelocitySteps,
    event: Event,
    how: HowFitted,
    law: str,
    other: Fit | None = None,
) -> Fit | None:
    """Return the fit of one law; None if it is not possible or does not converge. It starts from
    the parameters of the `other` law's fit, if that is given."""
    how = replace(how, law=law, states=1)
    start = None
    if other is not None:
        start = {name: other.parameters[name].value for name in ("f0", "A", "B", "L")}
    try:
        found = how.fit(part, steps, event.normal_stress, start=start)
    except InputError:
        return None
    return found if found.converged else None


def _heal(
    part: Record, hold: float, back: float
) -> tuple[float | None, float, float, float, float] | None:
    """Return creep and healing, each with its error, and the scatter of the rows before the hold;
    None without rows, or if the normal stress changes."""
    t, f = part.relative_time, part.friction
    before, held, after = t < hold, (t >= hold) & (t < back), t >= back
    if min(before.sum(), after.sum()) < 2 * FEWEST:
        return None
    if not is_constant(part.normal_stress, 8):
        return None
    steady = f[before][-max(int(_LEVEL * before.sum()), FEWEST) :]
    level, white = float(np.median(steady)), noise_from_differences(f)
    # noise of long memory is the same in all rows of a level, and another at the peak
    slow = max(float(np.var(f[before][before.sum() // 2 :])) - white**2, 0.0)
    peak = peak_of(t[after], f[after], level, white)
    common = np.pi / 2 * white**2 / len(steady) + 2 * slow
    error = float(np.sqrt(peak.error**2 + common))
    creep, creep_error = None, 0.0
    late = held & (t > back - _LATE * (back - hold))
    if late.any() and held.sum() >= FEWEST:
        last = np.flatnonzero(held)[-max(int(late.sum()), FEWEST) :]
        x = (t[last] - back) / (back - t[last][0])
        line, bent = (np.linalg.pinv(np.vander(x, n))[-1] for n in (2, 3))
        creep = level - float(line @ f[last])
        # what a parabola changes at the end, beyond noise
        shape = float((bent - line) @ f[last]) ** 2 - white**2 * ((bent - line) ** 2).sum()
        creep_error = float(np.sqrt(white**2 * (line @ line) + max(shape, 0.0) + common))
    return creep, creep_error, peak.value - level, error, float(np.std(steady))


def log_likelihood(found: Fit) -> float:
    """Return ln L of a fit's residual with the likeliest noise, up to a constant of the record."""
    time = found.record.relative_time
    clock = clock_of(time, found.steps)
    weight = np.ones(len(time))
    weight[list(found.noise.glitches.rows)] = 0.0
    scale = max(float(np.std(found.record.friction)), 1e-300)
    nothing = np.zeros((len(time), 1))
    rows = noise_rows(clock, weight, found.residual / scale, nothing, longest_memory(clock))
    return float(estimate_noise(rows).value)


def healing_rate(holds: Sequence[Hold]) -> WeightedLine | None:
    """Return the weighted line of healing over log10 of hold time [s]; None for fewer than three
    holds of known time, or hold times within a factor of two."""
    known = [(hold.lasts, hold.healing, hold.error) for hold in holds if not hold.missing]
    return line_over_decades(*np.array(known).T) if known else None


def why_no_law(hold: Hold) -> str:
    """Return the reason why a hold is not used to compare the laws, or ''."""
    if hold.missing:
        return warned(RunReason.MOTION_LACKS, missing=hold.missing)
    if hold.preference is None:
        if len(hold.fits) == 1:
            ((other, fit),) = hold.fits.items()
            law = LAWS[other == LAWS[0]]
            return warned(RunReason.ONE_FIT, law=law, other=other, times=excess(fit))
        return warned(RunReason.ALONE) if hold.fits else warned(RunReason.NO_FIT, laws=list(LAWS))
    law = LAWS[hold.preference < 0]
    times = excess(hold.fits[law]) if law in hold.fits else 0.0
    return warned(RunReason.NEITHER, law=law, times=times) if times > _MANY else ""


def preferred(holds: Sequence[Hold]) -> tuple[str | None, float]:
    """Return the law that all compared holds prefer together (None: no law), and ln L of the slip
    law minus ln L of the ageing law."""
    holds = [hold for hold in holds if not why_no_law(hold)]
    groups = {hold.group: hold.preference for hold in holds}
    total = float(sum(value for value in groups.values() if value is not None))
    if abs(total) < _STRONG:
        return None, total
    return ("slip" if total > 0 else "ageing"), total


def rows(
    holds: Sequence[Hold], unit: str = "1", others: Sequence[Event] = ()
) -> list[dict[str, Cell]]:
    """Return a row for every hold, with units in the names, then a row for each of the `others`,
    which were not fitted; unknown values are None. `unit` is the unit of friction, "1" or "N"."""
    out: list[dict[str, Cell]] = []
    force = " [N]" if unit == "N" else ""
    for number, hold in enumerate(holds, 1):
        row: dict[str, Cell] = {
            "hold": number,
            "time [s]": round(hold.time, 4),
            "hold time [s]": round(hold.lasts, 4),
            "velocity [um/s]": short(hold.velocity, scale=1e6),
            "normal_stress [MPa]": rounded(hold.normal_stress, 1e-6),
        }
        creep = None if hold.creep is None else hold.creep_error
        row |= with_std(f"creep{force}", hold.creep, creep, digits=6)
        row |= with_std(f"healing{force}", hold.healing, hold.error, digits=6)
        for law, found in hold.fits.items():
            for name, scale, label in (("A", 1.0, force), ("B", 1.0, force), ("L", 1e6, " [um]")):
                own = found.parameters[name]
                row[f"{name} {law}{label}"] = short(own.value, 6, scale) if own.determined else None
        together = (str(k) for k, other in enumerate(holds, 1) if other.group == hold.group)
        row["fitted with holds"] = " ".join(together)
        why = why_no_law(hold)
        row["ln L slip - ageing"] = None if why else rounded(hold.preference, digits=2)
        row["result"] = f"laws not compared: {why}" if why else "compared"
        out.append(row)
    for number, other in enumerate(others, len(holds) + 1):
        place: dict[str, Cell] = {"hold": number, "time [s]": round(other.time, 4)}
        out.append(place | {"result": f"not fitted: {other.why}"})
    return out


def told(holds: Sequence[Hold], unit: str = "1", others: Sequence[Event] = ()) -> list[str]:
    """Return lines on the holds of a run and on the `others`, which were not fitted; `unit` is the
    unit of friction, "1" or "N"."""
    force = " N" if unit == "N" else ""
    lines = [
        f"hold of {'at most ' if hold.missing else ''}{hold.lasts:.4g} s at {hold.time:.6g} s:"
        " friction"
        + (
            ""
            if hold.creep is None
            else f" creeps by {measured(hold.creep, hold.creep_error)}{force},"
        )
        + f" heals by {measured(hold.healing, hold.error)}{force}"
        for hold in holds
    ]
    lines += [f"hold at {one.time:.6g} s: not fitted, {one.why}" for one in others]
    if rate := healing_rate(holds):
        lines.append(f"healing: {measured(rate.slope, rate.error)}{force} per decade of hold time")
    for why in dict.fromkeys(filter(None, map(why_no_law, holds))):
        times = ", ".join(f"{hold.time:.6g}" for hold in holds if why_no_law(hold) == why)
        lines.append(f"hold at {times} s: laws not compared, {why}")
    compared = [hold for hold in holds if not why_no_law(hold)]
    if compared:
        law, total = preferred(holds)
        count = f"{len(compared)} hold{'s' if len(compared) > 1 else ''}"
        by = f"ln L {abs(total):.3g} higher over {count}"
        if law is None:
            lines.append(
                f"{count} cannot distinguish the slip law from the ageing law (ln L differs by"
                f" {abs(total):.2g})"
            )
        else:
            lines.append(f"to the holds the {law} law fits better ({by})")
    return lines


def warnings_of(holds: Sequence[Hold]) -> list[str]:
    """Return the warnings of the holds' fits, each with the times of its holds. The warnings are
    those under the preferred law, or under both laws if no law is preferred. Holds that are not
    used to compare the laws give no warnings."""
    law, _ = preferred(holds)
    told: dict[str, list[str]] = {}
    for hold in (hold for hold in holds if not why_no_law(hold)):
        for name, fit in hold.fits.items():
            if law in (None, name):
                for text in fit.warnings:
                    told.setdefault(f"({name} law): {text}", []).append(f"{hold.time:.6g}")
    return [f"hold at {', '.join(times)} s {text}" for text, times in told.items()]
