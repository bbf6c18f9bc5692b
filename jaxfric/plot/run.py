"""The figures of a run: what was decided about it, and A-B of its steps."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..records import Record
from ..runs.events import Event, mean_velocity
from ..runs.fits import RunFit
from ..runs.holds import Hold, healing_rate
from ..runs.stick_slip import is_stretch
from ..runs.table import difference, misses
from .label import printable
from .palette import BLACK, BLUE, GOLD, MAGENTA, MINT, ORANGE, SKY, SLATE
from .ticks import plain_log, whole_numbers
from .written import write

_DATA = BLUE
_COLOURS = {
    "step": ORANGE,
    "stress": GOLD,
    "hold": SKY,
    "reload": MINT,
    "unload": BLACK,
    "stick_slip": MAGENTA,
    "glitch": SLATE,
}
_LONG = 4.0
"""Bars so many times as long as the usual one may leave the panel."""
_LEAST = 0.01
"""An axis of normal stress spans so much of it or more: less is the servo's."""
_NUMBER = 0.008
"""Room that a digit above a panel takes, of the panel's width."""
_WORDS = {"stress": "normal stress", "stick_slip": "stick-slip"}


def draw_events(record: Record, events: Sequence[Event], *paths: str | Path) -> None:
    """Write the figure of the decisions to `paths`: friction, speed of the load point and normal
    stress against rows, for a recorder takes many where something happens and few in a hold."""
    rows = np.arange(len(record))
    panels = 3 if record.normal_stress is not None else 2
    figure = Figure(figsize=(13, 2.6 + 1.9 * panels), layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(
        figure.subplots(panels, 1, sharex=True, height_ratios=[2.2, 1, 1][:panels])
    )
    axes[0].plot(rows, record.friction, color=_DATA, lw=0.5)
    axes[0].set_ylabel("friction force [N]" if record.friction_unit == "N" else "friction")
    _limits(axes[0], record.friction)
    _speeds(axes[1], record, events)
    if panels == 3:
        assert record.normal_stress is not None
        axes[2].plot(rows, record.normal_stress / 1e6, color=_DATA, lw=0.7)
        axes[2].set_ylabel("normal stress [MPa]")
        whole_numbers(axes[2], "y", most=4, least=_LEAST)
    for axis in axes:
        _mark(axis, record, events)
        axis.margins(x=0.005)
        axis.spines[["top", "right"]].set_visible(False)
    _number(axes[0], record, events)
    axes[-1].set_xlabel("row")
    _times(axes[0], record)
    kinds = [kind for kind in _COLOURS if any(e.kind == kind for e in events)]
    handles = [
        axes[0].plot([], [], color=_COLOURS[k], lw=2, label=_WORDS.get(k, k))[0] for k in kinds
    ]
    figure.legend(handles=handles, loc="outside lower left", ncol=8, frameon=False, fontsize=9)
    fitted = sum(event.fitted for event in events)
    name = printable(record.provenance.path)
    title = f"{name}: events: {len(events)}, steps to fit: {fitted}"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, parse_math=False)
    write(figure, *paths)


def _limits(axis: Axes, values: np.ndarray) -> None:
    """Limits that a few wild rows do not decide."""
    low, high = np.quantile(values, [0.002, 0.998])
    room = 0.12 * max(high - low, 1e-12)
    axis.set_ylim(low - room, high + 2 * room)


def _speeds(axis: Axes, record: Record, events: Sequence[Event]) -> None:
    joints = [event for event in events if event.before != event.after]
    if not events:  # one velocity, and no event that tells it
        axis.text(0.5, 0.5, "no step", transform=axis.transAxes, ha="center", color="0.5")
        return
    rows = np.searchsorted(record.relative_time, [event.time for event in joints])
    edges = np.concatenate([[0], rows, [len(record)]])
    speeds = np.array([(joints or events)[0].before] + [e.after for e in joints])
    for a, b, v in zip(edges[:-1], edges[1:], 1e6 * speeds, strict=True):
        if v:
            axis.plot([a, b], [abs(v)] * 2, color=_DATA, lw=1.8, ls="-" if v > 0 else ":")
    plain_log(axis, "y")
    axis.set_ylabel("speed [µm/s]")


def _mark(axis: Axes, record: Record, events: Sequence[Event]) -> None:
    t = record.relative_time
    for event in events:
        row = int(np.searchsorted(t, event.time))
        axis.axvline(row, color=_COLOURS[event.kind], lw=0.9, zorder=0)
        if event.fitted:
            ends = np.searchsorted(t, [event.start, event.stop])
            axis.axvspan(*ends, color=_COLOURS["step"], alpha=0.12, lw=0, zorder=0)
        elif is_stretch(event):
            ends = np.searchsorted(t, [event.time, event.stop])
            axis.axvspan(*ends, color=_COLOURS["stick_slip"], alpha=0.1, lw=0, zorder=0)


def _number(axis: Axes, record: Record, events: Sequence[Event]) -> None:
    """The numbers of the steps that are fitted, above their windows, in the first of two lines
    that has room; where none has, the neighbours' numbers tell."""
    fitted = [event.time for event in events if event.fitted]
    rows = np.searchsorted(record.relative_time, fitted)
    ends = [-np.inf, -np.inf]  # of the numbers in the lower and the upper line
    for number, row in enumerate(rows, 1):
        line = next((k for k, end in enumerate(ends) if row >= end), None)
        if line is None:
            continue
        ends[line] = row + _NUMBER * len(str(number)) * len(record)
        axis.annotate(
            str(number), (row, 1.0), (0, 1 + 9 * line), xycoords=axis.get_xaxis_transform(),
            textcoords="offset points", ha="center", va="bottom", fontsize=8,
            color=_COLOURS["step"],
        )  # fmt: skip


def _times(axis: Axes, record: Record) -> None:
    """Times at the rows where the ticks are, written above them."""
    second = axis.secondary_xaxis(1.12)
    places = np.linspace(0, len(record) - 1, 8).astype(int)
    second.set_xticks(places, [f"{record.relative_time[p]:.0f} s" for p in places])
    second.spines["top"].set_visible(False)
    second.tick_params(length=0, labelsize=8, colors="0.4")


def draw_rates(run: RunFit, *paths: str | Path) -> None:
    """Write A-B of all fitted steps against velocity, displacement and normal stress."""
    write(rates_figure(run), *paths)


def rates_figure(run: RunFit) -> Figure:
    """Figure of A-B of all steps that determine it against velocity, displacement and normal
    stress; hollow are those whose fit misses a part of its record."""
    found = [s for s in run.steps if s.fit and s.fit.converged and s.fit.A_minus_B.determined]
    pairs = np.array([difference(step.fit) for step in found if step.fit is not None])
    missed = np.array([misses(step) for step in found], bool)
    stress = [step.event.normal_stress for step in found]
    sides = [
        ("mean velocity of the step [µm/s]", [1e6 * mean_velocity(s.event) for s in found], True),
        ("load-point displacement [mm]", [1e3 * s.position for s in found], False),
    ]
    if all(s is not None for s in stress) and found:
        sides.append(("normal stress [MPa]", [s / 1e6 for s in stress if s is not None], False))
    figure = Figure(figsize=(4.2 * len(sides), 3.9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(1, len(sides), sharey=True))
    up = np.array([abs(s.event.after) > abs(s.event.before) for s in found], bool)
    for axis, (label, along, log) in zip(axes, sides, strict=True):
        x = np.array(along)
        for chosen, mark, words in (
            (up & ~missed, "^", "step up"),
            (~up & ~missed, "v", "step down"),
            (up & missed, "^", "step up, missed (*)"),
            (~up & missed, "v", "step down, missed (*)"),
        ):
            if not chosen.any():
                continue
            axis.errorbar(
                x[chosen],
                pairs[chosen, 0],
                1.96 * pairs[chosen, 1],
                fmt=mark,
                color=_DATA if mark == "^" else ORANGE,
                mfc="white" if words.endswith("(*)") else None,
                label=words,
                capsize=2,
                lw=1,
            )
        axis.axhline(0, color="0.4", lw=0.7)
        axis.set_xlabel(label)
        if log:
            plain_log(axis, "x")
        else:
            whole_numbers(axis, "x", most=4, least=_LEAST)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("A − B (bars: 95 %)")
    _fill(axes[0], pairs)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside upper right", ncol=2, frameon=False
    )
    low, high = axes[0].get_ylim()
    words = "all below 0: velocity weakening" if high < 0 else "below 0: velocity weakening"
    words = "all above 0: velocity strengthening" if low > 0 else words
    axes[0].set_title(words, loc="left", fontsize=8.5)  # within, it would lie on the line of 0
    return figure


def _fill(axis: Axes, pairs: np.ndarray) -> None:
    """Limits in which pairs (n, 2) of a value and its error fill an axis."""
    if not len(pairs):
        return
    # a step that tells little must not hide what others tell
    bars = 1.96 * pairs[:, 1]
    told = bars <= _LONG * np.median(bars)
    ends = np.concatenate([pairs[:, 0], (pairs[:, 0] - bars)[told], (pairs[:, 0] + bars)[told]])
    room = 0.08 * np.ptp(ends) + 1e-12
    axis.set_ylim(ends.min() - room, ends.max() + 2 * room)
    whole_numbers(axis, "y", least=_LEAST)


def draw_healing(record: Record, holds: Sequence[Hold], *paths: str | Path) -> None:
    """Write the holds of a run: healing and creep against hold time, and friction after each."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    force = " N" if record.friction_unit == "N" else ""
    lasts = np.array([hold.lasts for hold in holds])
    healing, error = (np.array([getattr(h, name) for h in holds]) for name in ("healing", "error"))
    creep = np.array([np.nan if hold.creep is None else hold.creep for hold in holds])
    left.errorbar(lasts, healing, 1.96 * error, fmt="o", color=_DATA, capsize=2, label="healing")
    if np.isfinite(creep).any():
        left.plot(lasts, creep, "s", color=_COLOURS["hold"], ms=4, label="creep")
    if rate := healing_rate(holds):
        ends = np.array([lasts.min(), lasts.max()])
        left.plot(
            ends,
            rate.at(np.log10(ends)),
            color=_COLOURS["step"],
            label=f"{rate.slope:.4f}{force} per decade",
        )
    plain_log(left, "x")
    left.set_xlabel("hold time [s]")
    left.set_ylabel(f"change of friction{force and ' [N]'} (bars: 95 %)")
    left.legend(loc="lower left", bbox_to_anchor=(0, 1), ncol=3, frameon=False, fontsize=8.5)
    t, x, f = record.relative_time, record.load_point_displacement, record.friction
    assert x is not None
    shades = colormaps["cividis"](np.linspace(0.0, 0.85, max(len(holds), 2)))
    for shade, hold in zip(shades, sorted(holds, key=lambda one: one.lasts), strict=False):
        back = hold.time + hold.lasts
        moved = x - np.interp(back, t, x)
        near = (t >= back) & (np.abs(moved) < 1e-4)
        level = np.median(f[(t < hold.time) & (t > hold.time - 5 / hold.velocity * 1e-6)])
        right.plot(
            1e6 * moved[near], f[near] - level, lw=0.9, color=shade, label=f"{hold.lasts:.4g} s"
        )
    right.axhline(0, color="0.4", lw=0.7)
    right.set_xlabel("load point after the hold [\u00b5m]")
    right.set_ylabel(f"friction less that before{force and ' [N]'}")
    right.legend(title="hold", frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
    figure.suptitle("slide-hold-slide", x=0.01, ha="left", fontsize=11)
    write(figure, *paths)
