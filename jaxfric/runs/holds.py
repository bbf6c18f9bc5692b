"""Slide-hold-slide: how friction heals while the load point holds, and which law does it so.

A hold of t_h at a sliding velocity V: friction creeps down from its steady level, and the reload
passes a peak above it, by the healing. Healing grows with ln t_h, by B for the ageing law in a
stiff machine (Dieterich 1972, J. Geophys. Res. 77, 3690-3697); under the slip law the contact of a
stiff machine does not age at rest. Which one holds is asked of the whole of slide, hold and slide,
with the machine's stiffness: A, B and L are fitted under either law, and the laws are compared by
the likelihood of what each leaves, the noise found anew for each (`fitting.noise_search`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..fitting import Fit
from ..fitting.noise_search import estimate_noise, longest_memory, noise_rows
from ..fitting.problem import clock_of
from ..records import Record, VelocitySteps
from .events import Event
from .fits import HowFitted
from .stress import is_constant
from .table import Cell, measured
from .weighted import WeightedLine, weighted_line

LAWS = ("slip", "ageing")
_LEVEL, _PEAK = 0.1, 5
"""Share of the window before a hold whose median is the level; rows in the mean at the peak."""
_LATE = 0.2
"""The last row of a hold is no further from its end than this share of it."""
_STRONG = 5.0
"""A law is preferred by so much of ln L, as odds of 150 to 1."""


@dataclass(frozen=True, eq=False)
class Hold:
    """A hold of `lasts` [s] at `time` [s], from and to sliding at `velocity` [m/s].

    `creep` is the fall of friction during the hold (None: it was not recorded), `healing` the peak
    above the level before it, with its standard `error`; `fits` are those of the laws by name that
    could be fitted, and `preference` is ln L of the slip law less that of the ageing law; None
    where not both can.
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


def find_holds(events: Sequence[Event], end: float) -> list[tuple[Event, float, float, float]]:
    """Holds between sliding at one velocity: the event, when the window begins, when the load point
    moves on, and when the window ends [s]."""
    out = []
    joints = [e for e in events if e.before != e.after or e.kind in ("stress", "stick_slip")]
    for k, event in enumerate(joints):
        if event.kind != "hold" or k + 1 == len(joints) or not event.before:
            continue
        back = joints[k + 1]
        if back.kind != "reload" or not 0.5 < back.after / event.before < 2:
            continue
        before = joints[k - 1].time if k else 0.0
        after = joints[k + 2].time if k + 2 < len(joints) else end
        out.append((event, (before + event.time) / 2, back.time, after))
    return out


def fit_holds(
    record: Record,
    events: Sequence[Event],
    how: HowFitted,
    *,
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[Hold, ...]:
    """The healing of every hold of a run under a constant normal stress, fitted with both laws."""
    end = float(record.relative_time[-1])
    chosen = find_holds(events, end)
    out = []
    for number, (event, start, back, stop) in enumerate(chosen, 1):
        progress(f"hold {number} of {len(chosen)}, at {event.time:.6g} s")
        try:
            part = record.window(start, stop)
        except InputError:
            continue
        begin = float(part.time[0] - record.time[0])
        seen = _heal(part, event.time - begin, back - begin)
        if seen is None:
            continue
        steps = VelocitySteps(
            np.array([0.0, event.time - begin, back - begin]),
            np.array([event.before, 0.0, event.before]),
            time_errors=np.array([0.0, event.time_error, event.time_error]),
        )
        fits = {law: found for law in LAWS if (found := _fitted(part, steps, event, how, law))}
        both = len(fits) == len(LAWS)
        preference = log_likelihood(fits["slip"]) - log_likelihood(fits["ageing"]) if both else None
        lasts = back - event.time
        out.append(
            Hold(event.time, lasts, event.before, event.normal_stress, *seen, fits, preference)
        )
    return tuple(out)


def _fitted(
    part: Record, steps: VelocitySteps, event: Event, how: HowFitted, law: str
) -> Fit | None:
    """The fit of one law; None where it is not possible or does not converge."""
    try:
        found = replace(how, law=law, states=1).fit(part, steps, event.normal_stress)
    except InputError:
        return None
    return found if found.converged else None


def _heal(part: Record, hold: float, back: float) -> tuple[float | None, float, float] | None:
    """Creep, healing and its error; None without rows, and where the normal stress changes."""
    t, f = part.relative_time, part.friction
    before, after = f[t < hold], f[t >= back]
    held = f[(t >= hold) & (t < back)]
    if len(before) < 2 * _PEAK or len(after) < 2 * _PEAK:
        return None
    if not is_constant(part.normal_stress, 8):
        return None
    steady = before[-max(int(_LEVEL * len(before)), _PEAK) :]
    level, spread = float(np.median(steady)), float(np.std(steady))
    means = np.convolve(after, np.full(_PEAK, 1 / _PEAK), mode="valid")
    late = t[(t < back)][-1] > back - _LATE * (back - hold) if len(held) >= _PEAK else False
    creep = level - float(np.median(held[-_PEAK:])) if late else None
    return creep, float(means.max()) - level, spread


def log_likelihood(found: Fit) -> float:
    """ln L of what a fit leaves, its noise being the likeliest for it (up to a constant of the
    record)."""
    time = found.record.relative_time
    clock = clock_of(time, found.steps)
    weight = np.ones(len(time))
    weight[list(found.noise.glitches.rows)] = 0.0
    scale = max(float(np.std(found.record.friction)), 1e-300)
    nothing = np.zeros((len(time), 1))
    rows = noise_rows(clock, weight, found.residual / scale, nothing, longest_memory(clock))
    return float(estimate_noise(rows).value)


def healing_rate(holds: Sequence[Hold]) -> WeightedLine | None:
    """Healing by log10 of hold time [s], a weighted line; None for fewer than three holds, or
    hold times within a factor of two."""
    x = np.log10([hold.lasts for hold in holds])
    if len(holds) < 3 or np.ptp(x) < np.log10(2):
        return None
    y, error = (np.array([getattr(hold, name) for hold in holds]) for name in ("healing", "error"))
    return weighted_line(x, y, error)


def preferred(holds: Sequence[Hold]) -> tuple[str | None, float]:
    """The law that all holds together prefer (None: neither); ln L of slip less that of ageing."""
    total = float(sum(hold.preference for hold in holds if hold.preference is not None))
    if abs(total) < _STRONG:
        return None, total
    return ("slip" if total > 0 else "ageing"), total


def rows(holds: Sequence[Hold]) -> list[dict[str, Cell]]:
    """A row for every hold, units in the names; what is not known is None."""
    out: list[dict[str, Cell]] = []
    for number, hold in enumerate(holds, 1):
        stress = hold.normal_stress
        row: dict[str, Cell] = {
            "hold": number,
            "time [s]": round(hold.time, 4),
            "hold time [s]": round(hold.lasts, 4),
            "velocity [um/s]": float(f"{1e6 * hold.velocity:.7g}"),
            "normal_stress [MPa]": None if stress is None else round(stress / 1e6, 4),
            "creep": None if hold.creep is None else float(f"{hold.creep:.6g}"),
            "healing": float(f"{hold.healing:.6g}"),
            "std healing": float(f"{hold.error:.4g}"),
        }
        for law, found in hold.fits.items():
            p = found.parameters
            for name, scale, unit in (("A", 1.0, ""), ("B", 1.0, ""), ("L", 1e6, " [um]")):
                known = p[name].determined
                row[f"{name} {law}{unit}"] = (
                    float(f"{scale * p[name].value:.6g}") if known else None
                )
        row["ln L slip - ageing"] = None if hold.preference is None else round(hold.preference, 2)
        out.append(row)
    return out


def told(holds: Sequence[Hold]) -> list[str]:
    """Lines on the holds of a run."""
    if not holds:
        return []
    lines = [
        f"hold of {hold.lasts:.4g} s at {hold.time:.6g} s: friction"
        + ("" if hold.creep is None else f" creeps by {hold.creep:.4f},")
        + f" heals by {measured(hold.healing, hold.error)}"
        for hold in holds
    ]
    if rate := healing_rate(holds):
        lines.append(f"healing: {measured(rate.slope, rate.error)} per decade of hold time")
    compared = [hold for hold in holds if hold.preference is not None]
    if compared:
        law, total = preferred(holds)
        count = f"{len(compared)} hold{'s' if len(compared) > 1 else ''}"
        by = f"ln L {abs(total):.3g} higher over {count}"
        if law is None:
            lines.append(
                f"{count} cannot tell the slip law from the ageing law (ln L differs by"
                f" {abs(total):.2g})"
            )
        else:
            lines.append(f"through the holds the {law} law fits better ({by})")
    return lines
