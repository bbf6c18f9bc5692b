"""Figures of a closed loop: record, model and residual, noise, aliasing, candidates."""

import itertools
import re
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter

from ..loop.result import CandidateScore, Loop
from ..loop.split import NAMES
from ..loop.thresholds import ACCEPT, ALIAS
from ..records.joints import gaps
from ..report.fit_text import noise_lines
from ..report.loop_text import base_name, sigma_texts
from .label import printable
from .location import save_location, save_profiles
from .noise import clocks, draw_autocorrelation, error_of_mean, mark_glitches
from .palette import BLACK, BLUE, GREY, LIGHT, MIDDLE, ORANGE, PALE, REPORT, SELECT, TRAIN
from .stability import new_figure, prefixed, save, tidy
from .ticks import plain_log

_BLOCKS = {
    "train": (TRAIN, "train: the model is fitted here"),
    "select": (SELECT, "select: predicted, has a say in the choice"),
    "report": (REPORT, "report: scored once, at the end"),
}
_MOST_BINS, _BIN_ROWS = 18, 10
_MOST_CANDIDATES = 14
_TITLE_WIDTH = 105
_NOISE_WIDTH = 118
_LETTER, _SMALLEST = 0.0012, 5.5
"""Part of a panel's width that a letter of one point takes; the smallest letters."""
_ROLE_COLOURS = {
    "model": BLUE,
    "base": MIDDLE,
    "passed": MIDDLE,
    "tried": LIGHT,
    "impossible": PALE,
    "failed": PALE,
}


def draw_loop(loop: Loop, folder: str | Path) -> list[str]:
    """Write the figures of `DRAWERS` to `folder` as PNG and SVG; the names written."""
    return [name for draw in DRAWERS.values() for name in draw(loop, Path(folder))]


# ---- residual --------------------------------------------------------------------------------


def panel_title(text: str) -> str:
    """The text in lines no longer than a panel is wide: a model may have many effects.

    No line ends within brackets, or in a number as 1.3 × 10⁻³ or 2.4 N m.
    """
    kept = r"\([^)]*\)|\S+ × \S+|\S+ [a-zA-Zµ]*N m\b"
    whole = re.sub(kept, lambda found: found[0].replace(" ", "\N{NO-BREAK SPACE}"), text)
    lines = textwrap.fill(whole, _TITLE_WIDTH, break_on_hyphens=False)
    return lines.replace("\N{NO-BREAK SPACE}", " ")


def _save_residual(loop: Loop, folder: Path) -> list[str]:
    return save(residual_figure(loop), folder, "residual")


def residual_figure(loop: Loop) -> Figure:
    """The figure `residual`: record with the model before and after, and what each leaves."""
    along, label, marks = _abscissa(loop)
    figure = new_figure(10.0, 10.6)
    top, record, *axes = figure.subplots(4, 1, sharex=True, height_ratios=[0.75, 2, 1.7, 1.7])
    _velocities(top, loop, along, marks)
    _record_and_model(record, loop, along)
    added = " + ".join(loop.effects)
    after = f"After: with {added}" if added else "After: no effect was added, the same"
    reach = _reach(loop)
    for axis, score, title in (
        (axes[0], loop.before, f"Before: {_base(loop)}"),
        (axes[1], loop.after, after),
    ):
        _residual(axis, loop, -score.residual / loop.row_sigma(), along, reach)
        mark_glitches(axis, along, score.noise.glitches)
        error = f"(test error {loop.test_error(score):.2f} σ)".replace(" ", "\N{NO-BREAK SPACE}")
        tidy(axis, panel_title(f"{title}   {error}"))
    for axis in (top, record, *axes):
        _blocks(axis, loop, along)
        axis.grid(False)
        for mark in marks[1:]:
            axis.axvline(mark, color="0.6", lw=0.8, ls="--", zorder=0.5)
    axes[1].set_xlim(along.min(), along.max())
    axes[1].set_xlabel(label)
    # below all panels, whose titles may be long: a row of blocks, a row of what is drawn
    shades = [Patch(fc=colour, ec="0.8", label=text) for colour, text in _BLOCKS.values()]
    drawn = axes[0].get_legend_handles_labels()[0]
    both = [one for pair in itertools.zip_longest(shades, drawn) for one in pair if one is not None]
    columns = max(len(shades), len(drawn))
    figure.legend(handles=both, loc="outside lower left", ncol=columns, frameon=False, fontsize=8.5)
    name = printable(loop.record.provenance.path)
    noise = ", in rows held out ".join(sigma_texts(loop))
    title = f"{name}: record and model; what is left in units of the noise σ = {noise}"
    figure.suptitle(panel_title(title), x=0.01, ha="left", fontsize=11, parse_math=False)
    figure.align_ylabels([top, record, *axes])
    return figure


def _record_and_model(axis: Axes, loop: Loop, along: np.ndarray) -> None:
    """The rows, and the model through them before and after."""
    friction, unit = np.asarray(loop.record.friction), loop.record.friction_unit
    axis.plot(along, friction, ".", color=GREY, ms=2, rasterized=True, label="record", zorder=1)
    lines = [(loop.before, ORANGE, "model before")]
    if loop.effects:
        lines.append((loop.after, BLUE, "model after"))
    pauses = gaps(np.asarray(loop.record.relative_time)) + 1  # no line across what was not recorded
    x = np.insert(along, pauses, np.nan)
    for score, colour, label in lines:
        y = np.insert(friction + score.residual, pauses, np.nan)
        axis.plot(x, y, color=colour, lw=1.1, label=label, zorder=2)
    axis.set_ylabel(loop.words.force if unit == "1" else f"{loop.words.force} [{unit}]")
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncol=3, fontsize=8, frameon=False)
    tidy(axis, "Record and model")


def _base(loop: Loop) -> str:
    """The base model in words: its law, and effects that were declared from the start."""
    return " with ".join([base_name(loop), *loop.before.effects])


def _abscissa(loop: Loop) -> tuple[np.ndarray, str, np.ndarray]:
    """Load-point displacement where it always advances, else time; its label; where velocities
    begin."""
    steps, time = loop.base_fit.steps, loop.record.relative_time
    one_way = np.all(steps.velocities > 0) or np.all(steps.velocities < 0)
    if loop.words.over_path and one_way:
        along, marks = steps.displacement(time), steps.displacement(steps.times)
        size, unit = prefixed(min(float(np.max(np.abs(along))), 9e-3), "m")
        return size * along, f"load-point displacement since the first row [{unit}]", size * marks
    return time, "time since the first row [s]", steps.times


def _reach(loop: Loop) -> float:
    """Half the height of the residual panels [sigma]: a few extreme rows may lie outside."""
    both = [s.residual / loop.row_sigma() for s in (loop.before, loop.after)]
    sizes = np.abs(np.concatenate(both))
    means = np.concatenate([_bins(loop, values)[1] for values in both])
    return float(max(4.0, 1.1 * np.nanquantile(sizes, 0.998), 1.25 * np.nanmax(np.abs(means))))


def _velocities(axis: Axes, loop: Loop, along: np.ndarray, marks: np.ndarray) -> None:
    velocities = loop.base_fit.steps.velocities
    middle = float(np.sqrt(_slowest(velocities) * np.max(np.abs(velocities))))
    size, unit = prefixed(middle, f"{loop.length_unit}/s")
    shown = size * velocities
    ends = np.append(marks, along[-1])
    axis.stairs(shown, ends, baseline=None, color=BLACK, lw=1.5)
    positive = np.all(shown > 0)
    if positive:
        axis.set_yscale("log")
        axis.set_ylim(shown.min() / 2, shown.max() * 5)
        plain_log(axis, "y")
    else:
        axis.margins(y=0.4)
    for k, share in enumerate(np.abs(np.diff(ends)) / np.ptp(along)):
        at = 0.5 * (ends[k] + ends[k + 1]), shown[k]
        text = f"{float(f'{shown[k]:.3g}'):.15g}".replace("-", "−")  # 2000, not 2e+03
        points = min(8.0, share / _LETTER / len(text))
        if points >= _SMALLEST:  # larger, it would lie on the line at its side
            axis.annotate(
                text, at, (0, 3), textcoords="offset points", ha="center", fontsize=points
            )
    axis.set_ylabel(f"velocity\n[{unit}]")
    tidy(axis, f"{loop.words.velocity} [{unit}]; dashed lines: {loop.words.marks}")


def _slowest(velocities: np.ndarray) -> float:
    moving = np.abs(velocities[velocities != 0])
    return float(moving.min()) if len(moving) else 1e-6


def _blocks(axis: Axes, loop: Loop, along: np.ndarray) -> None:
    """Shade the blocks: each row's share of the axis reaches half-way to its neighbours."""
    edges = np.concatenate([along[:1], 0.5 * (along[1:] + along[:-1]), along[-1:]])
    for name in NAMES:
        mask = loop.blocks.of(name).astype(int)
        change = np.diff(np.concatenate([[0], mask, [0]]))
        starts, stops = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
        for a, b in zip(starts, stops, strict=True):
            axis.axvspan(edges[a], edges[b], color=_BLOCKS[name][0], lw=0, zorder=0)


def _residual(axis: Axes, loop: Loop, values: np.ndarray, along: np.ndarray, reach: float) -> None:
    axis.plot(along, values, ".", color="0.62", ms=2, rasterized=True, label="rows", zorder=1)
    groups, mean, error = _bins(loop, values)
    x = np.asarray([along[rows].mean() if len(rows) else np.nan for rows in groups])
    axis.fill_between(
        x, mean - error, mean + error, color=BLUE, alpha=0.3, lw=0, zorder=2,
        label="mean ± 1 σ of the mean",
    )  # fmt: skip
    axis.plot(x, mean, color=BLUE, lw=1.4, label="mean of neighbouring rows", zorder=3)
    axis.axhline(0, color=BLACK, lw=0.8, zorder=2)
    axis.set_ylim(-reach, reach)
    axis.set_ylabel("record − model [σ]")


def _bins(loop: Loop, values: np.ndarray) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Means of neighbouring rows of a velocity, finer after its start, and their standard errors.

    An empty group, of mean nan, parts the velocities. Errors [sigma] know that noise is correlated.
    """
    noise, clock = loop.after.noise, _clocks(loop)
    groups: list[np.ndarray] = []
    for step in np.unique(loop.blocks.step):
        rows = np.flatnonzero((loop.blocks.step == step) & np.isfinite(values))
        number = int(np.clip(len(rows) // _BIN_ROWS, 1, _MOST_BINS))
        share = np.linspace(0, 1, number + 1) ** 1.5
        cuts = np.unique(np.round(len(rows) * share).astype(int))
        groups += [rows[a:b] for a, b in itertools.pairwise(cuts)]
        groups.append(rows[:0])
    mean = np.asarray([values[rows].mean() if len(rows) else np.nan for rows in groups])
    errors = [error_of_mean(clock[rows], noise) if len(rows) else np.nan for rows in groups]
    return groups, mean, np.asarray(errors)


def _clocks(loop: Loop) -> np.ndarray:
    """Clocks over which the noise may forget, at every row."""
    time = loop.record.relative_time
    path, pace = np.asarray(loop.base_fit.steps.displacement(time)), loop.after.noise.pace
    return clocks(time, path, np.asarray(pace)[loop.blocks.step] if pace else None)


# ---- noise -----------------------------------------------------------------------------------


def _save_noise(loop: Loop, folder: Path) -> list[str]:
    """Autocorrelation of what the model leaves where it is fitted, and of the noise model."""
    figure = new_figure(10.4, 4.8)
    axis = figure.subplots()
    scale = np.asarray(loop.after.noise.scale or (1.0,))
    scale = scale[np.minimum(loop.blocks.step, len(scale) - 1)]
    residual = np.where(loop.blocks.train, loop.after.residual / scale, np.nan)
    draw_autocorrelation(axis, _clocks(loop), residual, loop.after.noise)
    axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8)
    tidy(axis, _noise_words(loop))
    return save(figure, folder, "noise")


def _noise_words(loop: Loop) -> str:
    """The lines of `noise_lines`, wrapped."""
    lines = noise_lines(loop.after.noise)
    return "\n".join(textwrap.fill(line, _NOISE_WIDTH) for line in lines)


# ---- aliasing --------------------------------------------------------------------------------


def _save_aliasing(loop: Loop, folder: Path) -> list[str]:
    return save_aliasing(loop.alias_ids, loop.alias_cosines, folder, added=loop.effects)


def save_aliasing(
    ids: Sequence[str],
    cosines: np.ndarray,
    folder: Path,
    *,
    added: Sequence[str] = (),
    what: str = "this record",
) -> list[str]:
    """Draw |cosine| between effects, as `what` shows them; the names of the files written."""
    figure = aliasing_figure(ids, cosines, added=added, what=what)
    return save(figure, folder, "aliasing")


def aliasing_figure(
    ids: Sequence[str], cosines: np.ndarray, *, added: Sequence[str] = (), what: str = "this record"
) -> Figure:
    """Figure of the |cosine| between effects, as `what` shows them; those `added` are marked."""
    cosines, number = np.asarray(cosines, float), len(ids)
    side = 3.2 + 0.4 * max(number, 5)
    figure = new_figure(side, side - 0.6)
    axis = figure.subplots()
    shown = np.where(np.tri(number, k=-1, dtype=bool), cosines, np.nan)
    axis.imshow(shown, cmap="Blues", vmin=0, vmax=1.15)
    for i in range(number):
        for j in range(i):
            _cell(axis, i, j, cosines[i, j])
        axis.add_patch(Rectangle((i - 0.5, i - 0.5), 1, 1, fc="0.9", lw=0))
    axis.set_xticks(range(number), ids, rotation=60, ha="right", rotation_mode="anchor", fontsize=9)
    axis.set_yticks(range(number), ids, fontsize=9)
    for labels in (axis.get_xticklabels(), axis.get_yticklabels()):
        for text, id in zip(labels, ids, strict=True):
            if id in added:
                text.set(color=ORANGE, fontweight="bold")
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)
    notes = [f"0: nothing alike, {what} tells them apart", "1: the same, no fit can tell"]
    notes.append(f"framed: {ALIAS:.2f} or more, not told apart to first order")
    if added:
        notes.append("orange names: effects that were added")
    if np.any(~np.isfinite(cosines[np.tri(number, k=-1, dtype=bool)])):
        notes.append(f"–: {what} does not show one of the two at all")
    axis.text(0.42, 0.985, "\n".join(notes), transform=axis.transAxes, va="top", fontsize=9.5)
    figure.suptitle(
        f"How alike two effects look in {what}"
        " (|cosine|, after what the fitted model can absorb)",
        x=0.01, ha="left", fontsize=11,
    )  # fmt: skip
    return figure


def _cell(axis: Axes, i: int, j: int, value: float) -> None:
    if not np.isfinite(value):
        axis.text(j, i, "–", ha="center", va="center", color="0.6")
        return
    alike = value >= ALIAS
    text = "1.0" if value >= 0.995 else f"{value:.2f}".removeprefix("0")
    if not alike and float(text) >= ALIAS:  # rounded up to what is framed
        text = f"{ALIAS - 0.01:.2f}".removeprefix("0")
    colour = "white" if value > 0.7 else BLACK
    weight = "bold" if alike else "normal"
    axis.text(j, i, text, ha="center", va="center", fontsize=8, color=colour, fontweight=weight)
    if alike:
        axis.add_patch(Rectangle((j - 0.46, i - 0.46), 0.92, 0.92, fill=False, ec=ORANGE, lw=2.2))


# ---- candidates ------------------------------------------------------------------------------


def _save_candidates(loop: Loop, folder: Path) -> list[str]:
    tried = loop.ranked()[:_MOST_CANDIDATES]
    screened = [s for s in loop.screened if np.isfinite(s.delta_bic)]
    rows = len(tried), len(screened)
    names = [_candidate_name(c) for c in tried]
    longest = max(map(len, names), default=0)
    figure = new_figure(10.5 + 0.07 * max(longest - 25, 0), 2.7 + 0.27 * sum(rows))
    heights = [max(n, 1) + 1.5 for n in rows]
    grid = figure.add_gridspec(2, 2, width_ratios=[1.6, 1], height_ratios=heights)
    first, beside, second = (
        figure.add_subplot(place) for place in (grid[0, 0], grid[0, 1], grid[1, 0])
    )
    colours = [_ROLE_COLOURS[loop.role(c)] for c in tried]
    _bars(first, names, [c.delta_bic for c in tried], colours)
    tidy(first, "Models that were fitted: ΔBIC against the base")
    _held_out(beside, loop, tried, colours)
    beside.set_yticks(range(len(tried)), [""] * len(tried))
    beside.set_ylim(first.get_ylim())
    ids = [s.id for s in screened]
    chosen = [BLUE if id in loop.effects else LIGHT for id in ids]
    _bars(second, ids, [s.delta_bic for s in screened], chosen)
    tidy(second, "Single effects, screened: ΔBIC to first order")
    for axis in (first, second):
        axis.set_xlabel("ΔBIC (above 0: better than the base)")
    _key(figure.add_subplot(grid[1, 1]))
    return save(figure, folder, "candidates")


def _candidate_name(candidate: CandidateScore) -> str:
    return " + ".join(candidate.effects) or "base"


def _bars(axis: Axes, names: list[str], values: list[float], colours: list[str]) -> None:
    """Horizontal bars, first on top, numbers beside; the line from which an effect is taken."""
    places = np.arange(len(names))
    lengths = np.where(np.isfinite(values), values, 0.0)
    axis.barh(places, lengths, color=colours, height=0.68, zorder=2)
    low, high = min(0.0, *lengths, -1.0), max(1.5 * ACCEPT, *lengths, 0.0)
    if high > 40 * ACCEPT:
        axis.set_xscale("symlog", linthresh=ACCEPT, linscale=0.7)
        axis.set_xlim(2 * min(low, -4.0), 1.5 * high)
        axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}".replace("-", "−")))
    else:
        room = 0.03 * (high - low)
        axis.set_xlim(low - room, high + room)
    for place, value in zip(places, values, strict=True):
        text = f"{value:+.4g}" if abs(value) >= 1e4 else f"{value:+.1f}"
        _number(axis, float(place), text.replace("-", "−") if np.isfinite(value) else "failed")
    axis.axvline(0, color=BLACK, lw=0.8, zorder=3)
    axis.axvline(ACCEPT, color=ORANGE, lw=1.3, ls="--", zorder=1)
    axis.set_yticks(places, names, fontsize=8.5, parse_math=False)
    axis.set_ylim(len(names) - 0.4 if names else 0.6, -0.6)


def _number(axis: Axes, place: float, text: str) -> None:
    """A number in a column at the right of a panel, where no line passes through it."""
    axis.text(
        1.015, place, text, transform=axis.get_yaxis_transform(), ha="left", va="center", fontsize=8
    )


def _held_out(axis: Axes, loop: Loop, tried: list[CandidateScore], colours: Sequence[str]) -> None:
    sigma = loop.sigma_of(loop.blocks.select)
    values = np.asarray([c.heldout_rms / sigma for c in tried], float)
    known = np.isfinite(values)
    places = np.arange(len(tried))
    base = loop.before.rms["select"] / sigma
    worst = 1.5 * max(base, 1.0)
    axis.scatter(
        np.minimum(values, worst)[known], places[known], s=42, zorder=3,
        c=np.asarray(colours, object)[known].tolist(), edgecolors=BLACK, lw=0.6,
    )  # fmt: skip
    axis.axvline(1, color=BLACK, lw=0.9)
    axis.axvline(base, color=GREY, lw=1.2, ls=":")
    low = min(1.0, float(values[known].min()) if known.any() else 1.0)
    span = max(min(worst, float(values[known].max()) if known.any() else 1.0), base) - low
    span = max(span, 0.02)
    axis.set_xlim(low - 0.1 * span, low + 1.1 * span)
    for place in places[known]:
        value = values[place]
        _number(axis, float(place), f"{value:.3f}" if value < 100 else f"{value:.3g}")
    axis.set_xlabel("rms on the select block [σ]")
    tidy(axis, "Error on rows that were not fitted")


def _key(axis: Axes) -> None:
    axis.set_axis_off()
    colours = (
        (BLUE, "the model that was chosen; below, its effects"),
        (MIDDLE, "the base, and models on the way"),
        (LIGHT, "tried, not taken"),
        (PALE, "impossible, or not converged"),
    )
    handles: list = [Patch(fc=colour, label=text) for colour, text in colours]
    handles += axis.plot(
        [], [], color=ORANGE, ls="--", label=f"ΔBIC {ACCEPT:g}: gain needed to take an effect"
    )
    handles += axis.plot([], [], color=BLACK, lw=0.9, label="error equal to the noise, 1 σ")
    handles += axis.plot([], [], color=GREY, ls=":", label="error of the base")
    axis.legend(handles=handles, loc="upper left", frameon=False, fontsize=9)


DRAWERS: dict[str, Callable[[Loop, Path], list[str]]] = {
    "residual": _save_residual,
    "noise": _save_noise,
    "location": save_location,
    "profiles": save_profiles,
    "aliasing": _save_aliasing,
    "candidates": _save_candidates,
}
"""Functions that each write a figure of a loop to a folder and return the names written."""
FIGURES: tuple[str, ...] = tuple(DRAWERS)
