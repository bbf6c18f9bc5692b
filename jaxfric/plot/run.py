"""Draw a run: its events, A-B of its velocity steps, and its holds."""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..records import Record
from ..runs.events import Event, mean_velocity
from ..runs.fits import RunFit
from ..runs.holds import Hold, healing_rate
from ..runs.joint import has_trend, rate_of
from ..runs.stick_slip import is_stretch
from ..runs.table import misses
from . import style
from .palette import BLACK, BLUE, GOLD, MAGENTA, MINT, ORANGE, SKY, SLATE
from .ticks import whole_numbers

_COLOURS = {
    "step": ORANGE,
    "stress": GOLD,
    "hold": SKY,
    "reload": MINT,
    "unload": BLACK,
    "stick_slip": MAGENTA,
    "glitch": SLATE,
}
_LINES = {"hold": (2.6, "-"), "reload": (1.2, "--")}
"""Widths and dashes of lines, where others are at the same place."""
_WORDS = {"stress": "normal stress", "stick_slip": "stick-slip"}
_LONG = 4.0
"""Bars so many times as long as the usual one may leave the panel."""
_LEAST = 0.01
"""An axis of normal stress spans so much of it or more: less is the servo's."""
_NUMBER = 0.014
"""Room that a digit above a panel takes, of the panel's width."""


# ---- events ------------------------------------------------------------------------------------


def events_figure(record: Record, events: Sequence[Event]) -> Figure:
    """Figure of the events of a run.

    Friction, load-point speed and normal stress are drawn against the load-point displacement.
    """
    figure, axes = style.panels([2.0, 1.0, *([] if record.normal_stress is None else [1.0])])
    x = record.moved() - record.moved()[0]
    style.samples(axes[0], x, record.friction)
    style.tidy(axes[0], y=style.friction_label(record.friction_unit), grid=False)
    low, high = np.quantile(record.friction, [0.002, 0.998])  # a few outliers do not decide
    room = 0.12 * max(high - low, 1e-12)
    axes[0].set_ylim(low - room, high + 2 * room)
    _speeds(axes[1], record, events, x)
    if record.normal_stress is not None:
        style.samples(axes[2], x, record.normal_stress, "")
        whole_numbers(axes[2], "y", most=4, least=_LEAST)
        style.tidy(axes[2], y=("normal\nstress", "Pa"), grid=False)
    at = x[_rows(record, [event.time for event in events])]
    for axis in axes:
        _mark(axis, record, events, at, x)
    fitted = [place for place, event in zip(at, events, strict=True) if event.fitted]
    _number(axes[0], fitted)
    style.tidy(axes[-1], x=("load-point displacement since the first row", "m"), grid=False)
    title = f"{len(events)} events"
    title += f", {len(fitted)} steps to fit (shaded and numbered)" if fitted else ""
    return style.finish(figure, title, of=record.provenance.path)


def _rows(record: Record, times: Sequence[float]) -> np.ndarray:
    """The rows at some times."""
    return np.minimum(np.searchsorted(record.relative_time, times), len(record) - 1).astype(int)


def _speeds(axis: Axes, record: Record, events: Sequence[Event], x: np.ndarray) -> None:
    """Speeds between events; dotted where the load point moves back."""
    joints = [event for event in events if event.before != event.after]
    if not events:  # one velocity, which no event states
        axis.text(0.5, 0.5, "no step", transform=axis.transAxes, ha="center", color="0.5")
        return
    ends = x[[0, *_rows(record, [event.time for event in joints]), len(record) - 1]]
    speeds = [(joints or events)[0].before, *(event.after for event in joints)]
    v = np.where(np.equal(speeds, 0), np.nan, speeds)
    lines = axis.hlines(np.abs(v), ends[:-1], ends[1:], BLUE, lw=1.8)
    lines.set_linestyle([":" if back else "-" for back in v < 0])
    style.tidy(axis, y=("speed\n", "m/s"), log="y", grid=False)


def _mark(
    axis: Axes, record: Record, events: Sequence[Event], at: np.ndarray, x: np.ndarray
) -> None:
    """A line at every event, and shades of the windows that are fitted and of stick-slip."""
    for place, event in zip(at, events, strict=True):
        width, dash = _LINES.get(event.kind, (0.8, "-"))
        colour, words = _COLOURS[event.kind], _WORDS.get(event.kind, event.kind)
        axis.axvline(place, color=colour, lw=width, ls=dash, zorder=0, label=words)
        if event.fitted or is_stretch(event):
            begin = event.start if event.fitted else event.time
            kind = "step" if event.fitted else "stick_slip"
            ends = x[_rows(record, [begin, event.stop])]
            axis.axvspan(*ends, color=_COLOURS[kind], alpha=0.12, lw=0, zorder=0)


def _number(axis: Axes, places: Sequence[float]) -> None:
    """The numbers of the steps that are fitted, above their windows, in the first of two lines
    that has room; where none has, the neighbours' numbers tell."""
    ends = [-np.inf, -np.inf]  # ends of the numbers in the lower and the upper line
    digit = _NUMBER * np.ptp(axis.get_xlim())
    for number, place in enumerate(places, 1):
        line = next((k for k, end in enumerate(ends) if place >= end), None)
        if line is None:
            continue
        ends[line] = place + digit * len(str(number))
        axis.annotate(
            str(number), (place, 1.0), (0, 1 + 8 * line), xycoords=axis.get_xaxis_transform(),
            textcoords="offset points", ha="center", va="bottom", fontsize=style.LETTERS,
            color=_COLOURS["step"],
        )  # fmt: skip


# ---- rates -------------------------------------------------------------------------------------


def rates_figure(run: RunFit) -> Figure:
    """Figure of A-B of the steps against velocity, displacement and normal stress, as tested: of
    fits with a slip trend if this trend is significant.

    Only velocity steps that determine A-B are drawn. A hollow point marks a fit that does not
    describe its step.
    """
    found = [s for s in run.steps if s.fit and s.fit.converged and s.fit.A_minus_B.determined]
    trend = has_trend(run.steps)
    pairs = np.array([rate_of(step.fit, trend=trend) for step in found if step.fit is not None])
    missed = np.array([misses(step) for step in found], bool)
    stress = [step.event.normal_stress for step in found]
    sides = [
        ("mean velocity of the step", "m/s", [mean_velocity(s.event) for s in found]),
        ("load-point displacement", "m", [s.position for s in found]),
    ]
    if found and None not in stress:
        sides.append(("normal stress", "Pa", stress))
    figure, axes = style.side_by_side(len(sides), height=2.2, sharey=True)
    up = np.array([abs(s.event.after) > abs(s.event.before) for s in found], bool)
    kinds = [
        (chosen & (missed == hollow), marker, colour, words + ", missed (*)" * hollow, hollow)
        for hollow in (False, True)
        for chosen, marker, colour, words in (
            (up, "^", BLUE, "step up"),
            (~up, "v", ORANGE, "step down"),
        )
    ]
    for axis, (label, unit, x) in zip(axes, sides, strict=True):
        for chosen, marker, colour, words, hollow in kinds:
            if chosen.any():
                at, (y, error) = np.array(x)[chosen], pairs[chosen].T
                style.bars(axis, at, y, 1.96 * error, words, colour, marker, hollow=hollow)
        if unit != "m/s":
            whole_numbers(axis, "x", most=4, least=_LEAST)
        style.tidy(axis, x=(label, unit), log="x" if unit == "m/s" else "", zero=True)
    _fill(axes[0], pairs)
    low, high = axes[0].get_ylim()
    words = "all below 0: velocity weakening" if high < 0 else "below the line: velocity weakening"
    words = "all above 0: velocity strengthening" if low > 0 else words
    y = f"A − B{' with slip trend' * trend} (bars: 95 %)"
    style.tidy(axes[0], words, y=y)  # inside, text would hide the line at 0
    return style.finish(figure)


def _fill(axis: Axes, pairs: np.ndarray) -> None:
    """Limits in which pairs (n, 2) of a value and its error fill an axis."""
    if not len(pairs):
        return
    # a step with a large error must not hide the others
    bars = 1.96 * pairs[:, 1]
    told = bars <= _LONG * np.median(bars)
    ends = np.concatenate([pairs[:, 0], (pairs[:, 0] - bars)[told], (pairs[:, 0] + bars)[told]])
    room = 0.08 * np.ptp(ends) + 1e-12
    axis.set_ylim(ends.min() - room, ends.max() + 2 * room)
    whole_numbers(axis, "y", least=_LEAST)


# ---- holds -------------------------------------------------------------------------------------


def holds_figure(record: Record, holds: Sequence[Hold]) -> Figure:
    """Figure of holds: healing and creep against hold time, and friction after each hold."""
    figure, (left, right) = style.side_by_side(2, height=2.6)
    force = " N" if record.friction_unit == "N" else ""
    lasts = np.array([hold.lasts for hold in holds])
    healing, error = (np.array([getattr(h, name) for h in holds]) for name in ("healing", "error"))
    creep = np.array([np.nan if hold.creep is None else hold.creep for hold in holds])
    style.bars(left, lasts, healing, 1.96 * error, "healing")
    if np.isfinite(creep).any():
        left.plot(lasts, creep, "s", color=SKY, ms=3, label="creep")
    if rate := healing_rate(holds):
        ends = np.array([lasts.min(), lasts.max()])
        words = f"{rate.slope:.4f}{force} per decade"
        left.plot(ends, rate.at(np.log10(ends)), color=ORANGE, lw=1.2, label=words)
    unit = record.friction_unit
    style.tidy(left, x=("hold time", "s"), y=("change of friction (bars: 95 %)", unit), log="x")
    t, x, f = record.relative_time, record.load_point_displacement, record.friction
    assert x is not None
    shades = colormaps["cividis"](np.linspace(0.0, 0.85, max(len(holds), 2)))
    for shade, hold in zip(shades, sorted(holds, key=lambda one: one.lasts), strict=False):
        back = hold.time + hold.lasts
        moved = x - np.interp(back, t, x)
        near = (t >= back) & (np.abs(moved) < 1e-4)
        level = np.median(f[(t < hold.time) & (t > hold.time - 5 / hold.velocity * 1e-6)])
        label = f"hold of {hold.lasts:.4g} s"
        style.samples(right, moved[near], f[near] - level, label, shade)
    x, y = ("load point after the hold", "m"), ("friction less that before", unit)
    style.tidy(right, x=x, y=y, zero=True)
    return style.finish(figure, "Slide-hold-slide")
