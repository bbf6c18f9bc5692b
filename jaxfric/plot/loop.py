"""Figures of a closed loop: record, model and residual, noise, candidates."""

import itertools
import textwrap
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..fitting.noise.autocorrelation import clocks, error_of_mean
from ..loop.result import CandidateScore, Loop
from ..loop.split import NAMES
from ..loop.thresholds import ACCEPT
from ..report.fit_text import noise_lines
from ..report.loop_text import base_name, sigma_texts
from . import style
from .aliasing import aliasing_figure
from .location import location_figure, profiles_figure
from .noise import draw_autocorrelation, mark_glitches
from .palette import BLACK, BLUE, GREY, LIGHT, MIDDLE, ORANGE, PALE, REPORT, SELECT, TRAIN

_BLOCKS = {
    "train": (TRAIN, "train: the model is fitted here"),
    "select": (SELECT, "validation: decides between models"),
    "report": (REPORT, "test: evaluated once, at the end"),
}
_MOST_BINS, _BIN_ROWS, _MOST_MARKS = 18, 10, 60
_MOST_CANDIDATES = 14
_NAME = 50
"""Letters of a line of a model's name beside its bar."""
_ROLES = {
    "model": (BLUE, "the chosen model; below, its effects"),
    "base": (MIDDLE, "the base, and models on the way"),
    "passed": (MIDDLE, ""),
    "tried": (LIGHT, "tried, not chosen"),
    "impossible": (PALE, "impossible, or not converged"),
    "failed": (PALE, ""),
}
"""Colours of the bars, and what the legend says of each."""


# ---- residual --------------------------------------------------------------------------------


def residual_figure(loop: Loop) -> Figure:
    """The figure `residual`: record, models before and after adding effects, and their residuals.

    Without an added effect the figure has one model and one residual. Dashed lines are the ends of
    the velocity steps or strokes of which at least `_BIN_ROWS` rows count; more than `_MOST_MARKS`
    would hide the rows.
    """
    place = style.along(
        loop.base_fit.steps, loop.record.relative_time, over_path=loop.words.over_path
    )
    scores = {"Before": loop.before} | ({"After": loop.after} if loop.effects else {})
    figure, axes = style.panels([0.6, 1.7] + [1.4] * len(scores))
    top, record, *residuals = axes
    words, friction = loop.words, np.asarray(loop.record.friction)
    name = "velocity\n", f"{loop.length_unit}/s"
    style.stairs(top, place, loop.base_fit.steps.velocities, name)
    counted = loop.blocks.train | loop.blocks.select | loop.blocks.report
    own = np.flatnonzero(np.bincount(loop.blocks.step[counted]) >= _BIN_ROWS)
    edges = np.intersect1d([0, *own, *own + 1], np.arange(len(place.starts)))
    marked = len(edges) <= _MOST_MARKS
    style.tidy(top, f"{words.velocity}; dashed: {words.marks}" if marked else words.velocity)
    style.samples(record, place.x, friction, colour=GREY)
    for (when, score), colour in zip(scores.items(), (ORANGE, BLUE), strict=False):
        label = f"model {when.lower()}" if loop.effects else "model"
        style.curve(record, place, friction + score.residual, label, colour)
    models = [friction + score.residual for score in scores.values()]
    limits, beyond = style.ordinary(np.stack([friction, *models]), counted)
    record.set_ylim(limits)
    name = style.friction_label(loop.record.friction_unit)
    if loop.kind == "axis":
        name = style.motor_label(loop.record.friction_unit, rotary=loop.length_unit == "rad")
    title = "; ".join(filter(None, ("Record and model", style.beyond(beyond))))
    style.tidy(record, title, y=name)
    for axis, (when, score) in zip(residuals, scores.items(), strict=True):
        _residual(axis, loop, -score.residual / loop.row_sigma(), place)
        mark_glitches(axis, place.x, score.noise.glitches)
        names = " + ".join([base_name(loop), *score.effects])
        when = when if loop.effects else "Residual"
        title = f"{when}, test error {loop.test_error(score):.2f} σ: {names}"
        style.tidy(axis, style.wrapped(title, 0.85 * style.DOUBLE))
    style.tidy(axes[-1], x=place.label)
    for axis in axes:
        _blocks(axis, loop, place.x)
        axis.grid(False)
    if marked:
        style.mark_steps(axes, place._replace(starts=place.starts[edges]), "")
    axes[-1].set_xlim(place.x.min(), place.x.max())
    shades = [Patch(fc=colour, ec="0.8", label=text) for colour, text in _BLOCKS.values()]
    title = f"noise σ = {', in rows held out '.join(sigma_texts(loop))}"
    return style.finish(figure, title, of=loop.record.provenance.path, legend=shades)


def _blocks(axis: Axes, loop: Loop, x: np.ndarray) -> None:
    """Shade the blocks: each row's share of the axis reaches half-way to its neighbours."""
    edges = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    for name in NAMES:
        change = np.diff(np.concatenate([[0], loop.blocks.of(name).astype(int), [0]]))
        starts, stops = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
        for a, b in zip(starts, stops, strict=True):
            axis.axvspan(edges[a], edges[b], color=_BLOCKS[name][0], lw=0, zorder=0)


def _residual(axis: Axes, loop: Loop, values: np.ndarray, place: style.Along) -> None:
    """Residual of the rows and means of neighbours, on a scale that a few extreme rows may leave,
    and on one of its own: what is left after an effect was added is seen too."""
    groups, mean, error = _bins(loop, values)
    highest = np.nanmax(np.abs(mean), initial=0.0)
    reach = max(4.0, 1.1 * np.nanquantile(np.abs(values), 0.998), 1.25 * highest)
    style.samples(axis, place.x, values, "", GREY)
    x = np.asarray([place.x[rows].mean() if len(rows) else np.nan for rows in groups])
    words = "mean ± 1 σ of the mean"
    axis.fill_between(x, mean - error, mean + error, color=BLUE, alpha=0.3, lw=0, label=words)
    axis.plot(x, mean, color=BLUE, lw=1.1, label="mean of neighbouring rows", zorder=3)
    axis.set_ylim(-reach, reach)
    style.tidy(axis, y="record − model [σ]", zero=True)


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


def _noise_figure(loop: Loop) -> Figure:
    """Autocorrelation of the residual where the model is fitted, and of the noise model."""
    figure, (axis,) = style.panels([2.45])
    scale = np.asarray(loop.after.noise.scale or (1.0,))
    scale = scale[np.minimum(loop.blocks.step, len(scale) - 1)]
    residual = np.where(loop.blocks.train, loop.after.residual / scale, np.nan)
    draw_autocorrelation(axis, _clocks(loop), residual, loop.after.noise)
    style.tidy(axis, "Residual of the train block")
    return style.finish(figure, noise_lines(loop.after.noise)[0])


# ---- candidates ------------------------------------------------------------------------------


def _candidates_figure(loop: Loop) -> Figure:
    """Bars of the change of BIC by every model and every single effect: below 0 it is better."""
    tried = loop.ranked()[:_MOST_CANDIDATES]
    screened = [s for s in loop.screened if np.isfinite(s.delta_bic)]
    names = [textwrap.fill(" + ".join(c.effects) or "base", _NAME) for c in tried]
    lines = max((name.count("\n") + 1 for name in names), default=1)
    heights = [max(n, 1) + 1.5 for n in (max(0.8 * lines, 1) * len(tried), len(screened))]
    figure = style.new_figure(style.DOUBLE, 1.2 + 0.16 * sum(heights))
    axes = figure.subplot_mosaic("ab;c.", width_ratios=[1.6, 1], height_ratios=heights)
    first, beside, second = (axes[k] for k in "abc")
    colours = [_ROLES[loop.role(c)][0] for c in tried]
    _bars(first, "Fitted models", names, [c.delta_bic for c in tried], colours)
    _held_out(beside, loop, tried, colours)
    beside.set_ylim(first.get_ylim())
    chosen = [BLUE if s.id in loop.effects else LIGHT for s in screened]
    title, changes = "Single effects, to first order", [s.delta_bic for s in screened]
    _bars(second, title, [s.id for s in screened], changes, chosen)
    legend = [style.square(colour, text) for colour, text in _ROLES.values() if text]
    accept = f"ΔBIC −{ACCEPT:g}: needed to add an effect"
    legend.append(Line2D([], [], color=ORANGE, ls="--", lw=1.2, label=accept))
    return style.finish(figure, legend=legend)


def _bars(
    axis: Axes, title: str, names: list[str], values: list[float], colours: list[str]
) -> None:
    """Horizontal bars, first on top, numbers beside; the line from which an effect is added."""
    lengths = np.where(np.isfinite(values), values, 0.0).tolist()
    texts = [f"{x:+.0f}" if abs(x) >= 1e4 else f"{x:+.1f}" for x in values]
    told = [
        t.replace("-", "−") if np.isfinite(x) else "failed"
        for t, x in zip(texts, values, strict=True)
    ]
    style.lying_bars(axis, names, lengths, colours, told)
    axis.set_xscale("symlog", linthresh=ACCEPT, linscale=0.7)
    axis.set_xlim(1.5 * min(-1.5 * ACCEPT, *lengths), 2 * max(4.0, *lengths))
    axis.axvline(0, color=BLACK, lw=0.8, zorder=3)
    axis.axvline(-ACCEPT, color=ORANGE, lw=1.2, ls="--", zorder=1)
    style.tidy(axis, title, x="ΔBIC = BIC − BIC of the base (below 0: better)")


def _held_out(axis: Axes, loop: Loop, tried: list[CandidateScore], colours: Sequence[str]) -> None:
    sigma = loop.sigma_of(loop.blocks.select)
    values = np.asarray([c.validation_rms / sigma for c in tried], float)
    known, places = np.isfinite(values), np.arange(len(tried))
    base = loop.before.rms["select"] / sigma
    worst = 1.5 * max(base, 1.0)
    dots = np.asarray(colours, object)[known].tolist()
    shown = np.minimum(values, worst)[known]
    axis.scatter(shown, places[known], s=22, zorder=3, c=dots, edgecolors=BLACK, lw=0.6)
    axis.axvline(1, color=BLACK, lw=0.9, label="error equal to the noise, 1 σ")
    axis.axvline(base, color=GREY, lw=1.2, ls=":", label="error of the base")
    axis.margins(x=0.1)
    texts = [f"{value:.3f}" if value < 100 else f"{value:.3g}" for value in values]
    style.beside_rows(axis, np.where(known, texts, "").tolist())
    axis.set_yticks(range(len(tried)), [""] * len(tried))
    style.tidy(axis, "Validation error", x="rms [σ]")


FIGURES: dict[str, Callable[[Loop], Figure]] = {
    "residual": residual_figure,
    "noise": _noise_figure,
    "location": location_figure,
    "profiles": profiles_figure,
    "aliasing": lambda loop: aliasing_figure(
        loop.alias_ids, loop.alias_cosines, added=loop.effects
    ),
    "candidates": _candidates_figure,
}
"""Functions that make the figures of a loop, by the name of the file."""
