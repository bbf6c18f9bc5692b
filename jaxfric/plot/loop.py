"""Figures of a closed loop: residual before and after, location map, aliasing, candidates."""

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

from ..fitting.table import noise_lines
from ..loop.residual_tests import p_text
from ..loop.result import CandidateScore, LocationProfile, Loop
from ..loop.split import NAMES
from ..loop.thresholds import ACCEPT, ALIAS, SIGNIFICANT
from ..loop.where import share_text
from .label import printable
from .noise import clocks, draw_autocorrelation, error_of_mean, mark_glitches
from .palette import BLACK, BLUE, GREY, LIGHT, MIDDLE, ORANGE, PALE, REPORT, SELECT, TRAIN
from .stability import new_figure, prefixed, save, tidy
from .ticks import plain_log

_BLOCKS = {
    "train": (TRAIN, "train: the model is fitted here"),
    "select": (SELECT, "select: chooses between candidates"),
    "report": (REPORT, "report: scored once, at the end"),
}
_MOST_BINS, _BIN_ROWS = 18, 10
_MOST_CANDIDATES = 14
_TINY = 0.01
_TITLE_WIDTH = 105
_NOISE_WIDTH = 88
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
    """The text in lines no longer than a panel is wide: a model may have many effects."""
    whole = re.sub(r"\([^)]*\)", lambda found: found[0].replace(" ", "\N{NO-BREAK SPACE}"), text)
    lines = textwrap.fill(whole, _TITLE_WIDTH, break_on_hyphens=False)
    return lines.replace("\N{NO-BREAK SPACE}", " ")


def _save_residual(loop: Loop, folder: Path) -> list[str]:
    return save(residual_figure(loop), folder, "residual")


def residual_figure(loop: Loop) -> Figure:
    """The figure `residual`: what the record leaves of the model before and after, by row."""
    along, label, marks = _abscissa(loop)
    figure = new_figure(10.0, 8.4)
    axes = figure.subplots(3, 1, sharex=True, height_ratios=[0.75, 2, 2])
    _velocities(axes[0], loop, along, marks)
    added = " + ".join(loop.effects)
    after = f"After: with {added}" if added else "After: no effect was added, the same"
    reach, held = _reach(loop), loop.sigma_of(loop.blocks.select | loop.blocks.report)
    for axis, score, title in (
        (axes[1], loop.before, f"Before: {_base(loop)}"),
        (axes[2], loop.after, after),
    ):
        _residual(axis, loop, -score.residual / loop.row_sigma(), along, reach)
        mark_glitches(axis, along, score.noise.glitches)
        error = f"(held-out error {loop.heldout(score) / held:.2f} σ)".replace(
            " ", "\N{NO-BREAK SPACE}"
        )
        tidy(axis, panel_title(f"{title}   {error}"))
    for axis in axes:
        _blocks(axis, loop, along)
        axis.grid(False)
        for mark in marks[1:]:
            axis.axvline(mark, color="0.6", lw=0.8, ls="--", zorder=0.5)
    axes[2].set_xlim(along.min(), along.max())
    axes[2].set_xlabel(label)
    axes[1].legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncol=4,
        fontsize=8,
        frameon=False,
        borderpad=0.2,
    )
    shades = [Patch(fc=colour, ec="0.8", label=text) for colour, text in _BLOCKS.values()]
    figure.legend(handles=shades, loc="outside lower left", ncol=3, frameon=False, fontsize=9)
    name = printable(loop.record.provenance.path)
    noise = ", in rows held out ".join(loop.sigma_texts())
    title = f"{name}: record minus model, in units of the noise σ = {noise}"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, parse_math=False)
    figure.align_ylabels(list(axes))
    return figure


def _base(loop: Loop) -> str:
    """The base model in words: its law, and effects that were declared from the start."""
    return " with ".join([loop.base_name, *loop.before.effects])


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
    wide = np.abs(np.diff(ends)) > 0.03 * np.ptp(along)
    for k in np.flatnonzero(wide):
        at = 0.5 * (ends[k] + ends[k + 1]), shown[k]
        text = f"{float(f'{shown[k]:.3g}'):.15g}"  # 2000, not 2e+03
        axis.annotate(text, at, (0, 3), textcoords="offset points", ha="center", fontsize=8)
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


# ---- location --------------------------------------------------------------------------------


def _save_location(loop: Loop, folder: Path) -> list[str]:
    number = len(loop.location)
    columns = min(3, max(number, 1))
    rows = max(1, -(-number // columns))
    figure = new_figure(4.3 * columns, 3.3 * rows + 0.9)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    size, unit = loop.readable()
    left = loop.before.rms["train"]
    for axis, profile in zip(panels, loop.location, strict=False):
        _profile(axis, profile, loop, size)
    for axis in panels[::columns]:
        axis.set_ylabel("missing friction / rms left")
    for axis in panels[number:]:
        axis.set_axis_off()
    if number == 0:
        panels[0].text(0.5, 0.5, "no structure was searched for", ha="center", va="center")
    figure.suptitle(
        "Where friction differs from the base model. Each variable is asked alone: shares overlap"
        " and do not add up to 100 %.\nIn units of the rms that the base leaves in its train block,"
        f" {size * left:.3g} {unit}".rstrip()
        + ", of which the noise of a row is the dotted"
        f" {loop.sigma / left:.2g}.\nLeft out is what the base's own parameters take up. The"
        " machine shows a part only, and neighbours of opposite sign cancel. Bars: standard error."
        "\np: how often noise alone gains as much in likelihood by bumps over a variable, its size"
        " and memory found anew. Each variable by itself; the\ntable of tests corrects for all"
        " that is asked.",
        x=0.01,
        ha="left",
        fontsize=10.5,
    )
    return save(figure, folder, "location")


_VARIABLES = {
    "slip": ("slip", "slip since the first row"),
    "log_velocity": ("velocity", "velocity"),
    "state": ("state", "θ − θ_ss, state from its steady value"),
    "position": ("position", "position"),
    "velocity": ("velocity", "velocity"),
    "since_reversal": ("distance since the stop", "distance since the last stop or reversal"),
    "time": ("time", "time since the first row"),
    "time_since_step": ("time since the step", "time since the last velocity step"),
    "relaxation_length": ("relaxation", "slip over which friction relaxes after a step"),
    "wavelength": ("ripple (size)", "wavelength of friction along the slip"),
}


def _profile(axis: Axes, profile: LocationProfile, loop: Loop, size: float) -> None:
    name, label = _VARIABLES.get(profile.variable, (profile.variable, profile.variable))
    x, unit = np.asarray(profile.centres, float), profile.unit
    if profile.variable == "log_velocity" and unit != "m/s":
        x, unit = _velocity_of(x, loop), "m/s"
    if unit in ("m", "m/s", "rad", "rad/s", "s"):
        largest = float(np.max(np.abs(x)))
        factor, unit = prefixed(min(largest, loop.words.most.get(unit, np.inf)), unit)
        x = factor * x
    if unit == "F":
        x, unit = size * x, loop.readable()[1]
    left = loop.before.rms["train"]
    amplitude, error = profile.amplitudes / left, profile.errors / left
    known = np.isfinite(amplitude) & np.isfinite(error)
    for level in (-loop.sigma, loop.sigma):
        axis.axhline(level / left, color=GREY, lw=1.0, ls=":")
    axis.axhline(0, color=BLACK, lw=0.8)
    axis.errorbar(
        x[known], amplitude[known], error[known], fmt="o-", color=BLUE, ecolor=ORANGE, ms=4,
        lw=0.8, elinewidth=1.6, capsize=2.5,
    )  # fmt: skip
    even = dict.fromkeys(("position", "velocity", "time"), np.inf)
    many = {"log_velocity": 3, "wavelength": 5, **even}.get(profile.variable, 30)
    if np.all(x > 0) and np.max(x) > many * np.min(x):
        plain_log(axis, "x")
    axis.set_xlabel(label if unit in ("", "1") else f"{label} [{unit}]")
    tidy(axis, _share_and_p(name, profile))


def _share_and_p(name: str, profile: LocationProfile) -> str:
    """Title of a panel: what the variable explains, and whether that may be chance."""
    p = p_text(profile.p_value)
    if not profile.p_value < SIGNIFICANT:
        return f"{name}\n{p}{': no more than chance' if np.isfinite(profile.p_value) else ''}"
    if not np.isfinite(profile.explained):
        return f"{name}\n{p}; too little is left for a share"
    share = share_text(profile.explained)
    tiny = ": hardly chance, but a tiny share" if profile.explained < _TINY else ""
    return f"{name} alone explains {share}\n{p}{tiny}"


def _velocity_of(logarithm: np.ndarray, loop: Loop) -> np.ndarray:
    """Velocity [m/s] from its logarithm, of m/s or of V0: whichever is a velocity of the record."""
    V = np.abs(loop.base_fit.steps.velocities)
    middle = float(np.mean(np.log(V[V > 0]))) if np.any(V > 0) else 0.0
    V0 = loop.base_fit.values().get("V0", 1.0)
    of = min(1.0, V0, key=lambda unit: abs(np.mean(logarithm) + np.log(unit) - middle))
    return of * np.exp(logarithm)


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
    return save(figure, folder, "aliasing")


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
    _bars(second, ids, [s.delta_bic for s in screened], [LIGHT] * len(ids))
    tidy(second, "Single effects, screened: ΔBIC to first order")
    for axis in (first, second):
        axis.set_xlabel("ΔBIC (above 0: better than the base)")
    _key(figure.add_subplot(grid[1, 1]))
    return save(figure, folder, "candidates")


def _candidate_name(candidate: CandidateScore) -> str:
    return " + ".join(candidate.effects) or "base"


def _bars(axis: Axes, names: list[str], values: list[float], colours: list[str]) -> None:
    """Horizontal bars, first on top, numbers at their ends; the line from which one is taken."""
    places = np.arange(len(names))
    lengths = np.where(np.isfinite(values), values, 0.0)
    axis.barh(places, lengths, color=colours, height=0.68, zorder=2)
    low, high = min(0.0, *lengths, -1.0), max(1.5 * ACCEPT, *lengths, 0.0)
    if high > 40 * ACCEPT:
        axis.set_xscale("symlog", linthresh=ACCEPT, linscale=0.7)
        axis.set_xlim(8 * min(low, -4.0), 12 * high)
        axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}".replace("-", "−")))
    else:
        room = 0.16 * (high - low)
        axis.set_xlim(low - room, high + room)
    for place, value, length in zip(places, values, lengths, strict=True):
        text = f"{value:+.4g}" if abs(value) >= 1e4 else f"{value:+.1f}"
        text = text.replace("-", "−") if np.isfinite(value) else "failed"
        right = length >= 0
        axis.annotate(
            text, (length, place), (4 if right else -4, 0), textcoords="offset points",
            ha="left" if right else "right", va="center", fontsize=8, zorder=4,
            bbox=dict(fc="white", lw=0, pad=0.6),
        )  # fmt: skip
    axis.axvline(0, color=BLACK, lw=0.8, zorder=3)
    axis.axvline(ACCEPT, color=ORANGE, lw=1.3, ls="--", zorder=1)
    axis.set_yticks(places, names, fontsize=8.5, parse_math=False)
    axis.set_ylim(len(names) - 0.4 if names else 0.6, -0.6)


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
    axis.set_xlim(low - 0.1 * span, low + 1.35 * span)
    for place in places[known]:
        x = min(values[place], worst)
        text = f"{values[place]:.3f}" if values[place] < 100 else f"{values[place]:.3g}"
        axis.annotate(
            text, (x, place), (7, 0), textcoords="offset points", va="center", fontsize=8,
            bbox=dict(fc="white", lw=0, pad=0.6),
        )  # fmt: skip
    axis.set_xlabel("rms on the select block [σ]")
    tidy(axis, "Error on rows that were not fitted")


def _key(axis: Axes) -> None:
    axis.set_axis_off()
    colours = (
        (BLUE, "the model that was chosen"),
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
    "location": _save_location,
    "aliasing": _save_aliasing,
    "candidates": _save_candidates,
}
"""Functions that each write a figure of a loop to a folder and return the names written."""
FIGURES: tuple[str, ...] = tuple(DRAWERS)
