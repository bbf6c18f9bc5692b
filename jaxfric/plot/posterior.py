"""The figure of a posterior: every parameter, and every pair of them."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from scipy.stats import norm

from ..posterior.inference_data import unit_name, unit_size
from ..posterior.result import DIFFERENCE, Posterior
from .label import printable
from .palette import BLUE, GREY, ORANGE
from .written import write

_DRAWS, _LAPLACE, _PRIOR = BLUE, ORANGE, GREY
_BINS, _MOST = 30, 2000
_LOW = 0.04
"""A prior of less than this part of the height of a panel is told in words."""
_REACH = 3.6
"""Half width of a panel in standard deviations."""


def draw_posterior(posterior: Posterior, *paths: str | Path) -> None:
    """Write the figure of a posterior to each of `paths` (PNG, SVG or PDF by its ending)."""
    write(posterior_figure(posterior), *paths)


def posterior_figure(posterior: Posterior) -> Figure:
    """Figure of a posterior: densities on the diagonal, pairs of parameters below it."""
    names = (DIFFERENCE, *posterior.names)
    about, drawn = _columns(posterior, posterior.laplace.draws), None
    if posterior.draws is not None:
        values = posterior.draws.values
        drawn = _columns(posterior, values.reshape(-1, values.shape[-1]))
    size, count = 1.75, len(names)
    figure = Figure(figsize=(1.2 + size * count, 1.2 + size * count))
    FigureCanvasAgg(figure)
    axes = figure.subplots(count, count, squeeze=False)
    edge = 0.95 / (1.2 + size * count)
    figure.subplots_adjust(
        left=edge, right=1 - edge / 4, bottom=edge, top=1 - edge / 1.6, wspace=0.08, hspace=0.08
    )
    limits = {name: _limits(about[name], None if drawn is None else drawn[name]) for name in names}
    for i, row in enumerate(names):
        for j, column in enumerate(names):
            axis: Axes = axes[i, j]
            if j > i:
                axis.set_axis_off()
                continue
            axis.set_xlim(*limits[column])
            if i == j:
                _density(axis, posterior, row, about[row], None if drawn is None else drawn[row])
            else:
                _pair(axis, (column, row), about, drawn)
                axis.set_ylim(*limits[row])
            _labels(axis, posterior, (column, row), bottom=i == count - 1, left=j == 0 and i > 0)
    _legend(figure, axes[0, 0], posterior)
    return figure


def _columns(posterior: Posterior, values: np.ndarray) -> dict[str, np.ndarray]:
    """Draws by name in the units that are shown."""
    columns = posterior.named(values)
    return {name: column / unit_size(name, posterior.fit) for name, column in columns.items()}


def _limits(about: np.ndarray, drawn: np.ndarray | None) -> tuple[float, float]:
    seen = about if drawn is None else drawn
    middle, std = float(np.median(seen)), float(np.std(seen))
    return middle - _REACH * std, middle + _REACH * std


def _density(
    axis: Axes, posterior: Posterior, name: str, about: np.ndarray, drawn: np.ndarray | None
) -> None:
    """Histogram of the draws, the Laplace approximation and the prior, each of area 1."""
    low, high = axis.get_xlim()
    edges = np.linspace(low, high, _BINS + 1).tolist()
    if drawn is not None:
        axis.hist(drawn, edges, density=True, color=_DRAWS, alpha=0.45, label="draws (NUTS)")
    one, unit = posterior.fitted()[name], unit_size(name, posterior.fit)
    if one.determined:
        x = np.linspace(low, high, 200)
        curve = norm.pdf(x, one.value / unit, one.std / unit)
        label = f"{posterior.fit_name}, no prior"
        axis.plot(x, curve, color="black", lw=1.2, ls=":", label=label)
    heights, _ = np.histogram(about, edges, density=True)
    axis.stairs(heights, edges, color=_LAPLACE, lw=1.3, label="Laplace approximation")
    if name in posterior.names:
        x, density = _prior(posterior, name, low, high)
        axis.plot(x, density, color=_PRIOR, lw=1.8, ls="--", label="prior", zorder=4, clip_on=False)
        if np.max(density, initial=0.0) < _LOW * heights.max():
            told = posterior.priors[posterior.names.index(name)].text()
            words = f"prior: {told}" if not len(x) else "prior: far wider, a line near 0"
            axis.text(0.02, 1.0, words, transform=axis.transAxes, fontsize=7, va="bottom")
    axis.set_yticks([])
    axis.set_ylim(bottom=0.0)
    axis.spines[["top", "right", "left"]].set_visible(False)


def _prior(posterior: Posterior, name: str, low: float, high: float) -> tuple[np.ndarray, ...]:
    """Density of the prior in the units that are shown; nothing where it is flat."""
    prior = posterior.priors[posterior.names.index(name)]
    return prior.curve(np.linspace(low, high, 200), unit_size(name, posterior.fit))


def _pair(
    axis: Axes,
    pair: tuple[str, str],
    about: dict[str, np.ndarray],
    drawn: dict[str, np.ndarray] | None,
) -> None:
    """Draws of two parameters, and the 95 % ellipse of the Laplace approximation's covariance."""
    x, y = pair
    shown = about if drawn is None else drawn
    # at random: every second of the approximation's draws, a Sobol sequence, lies to one side
    some = np.random.default_rng(0).permutation(len(shown[x]))[:_MOST]
    colour = _LAPLACE if drawn is None else _DRAWS
    points = shown[x][some], shown[y][some]
    axis.plot(*points, ".", color=colour, ms=3.0, alpha=0.4, mew=0, rasterized=True)
    both = np.stack([about[x], about[y]])
    angle = np.linspace(0, 2 * np.pi, 100)
    values, vectors = np.linalg.eigh(np.cov(both))
    root = vectors * np.sqrt(np.maximum(values, 0.0) * _CONTOUR)
    ellipse = both.mean(axis=1)[:, None] + root @ np.stack([np.cos(angle), np.sin(angle)])
    axis.plot(*ellipse, color=_LAPLACE, lw=1.3, ls=(0, (4, 2)), label="its 95 % ellipse")
    axis.spines[["top", "right"]].set_visible(False)


_CONTOUR = 5.991
"""chi-square of two degrees of freedom that 95 % are below."""


def _labels(
    axis: Axes, posterior: Posterior, pair: tuple[str, str], *, bottom: bool, left: bool
) -> None:
    for axis_of, name, shown in ((axis.xaxis, pair[0], bottom), (axis.yaxis, pair[1], left)):
        if axis_of is axis.yaxis and pair[0] == pair[1]:
            continue
        axis_of.set_major_locator(MaxNLocator(3))
        if not shown:
            axis_of.set_tick_params(labelleft=False, labelbottom=False)
            continue
        unit = unit_name(name, posterior.fit).replace("um", "µm")
        word = "A − B" if name == DIFFERENCE else name
        axis_of.set_label_text(word if unit == "1" else f"{word} [{unit}]")
        axis_of.set_tick_params(labelsize=7.5)
        axis_of.set_major_formatter(ScalarFormatter(useOffset=False))
    axis.tick_params(axis="x", rotation=40)


def _legend(figure: Figure, axis: Axes, posterior: Posterior) -> None:
    name = printable(posterior.fit.record.provenance.path)
    title = f"{name}: posterior, {posterior.fit.model.law} law"
    title += "" if posterior.converged else "; it claims nothing, see the warnings"
    colour = "black" if posterior.converged else _LAPLACE
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, parse_math=False, color=colour)
    handles, labels = axis.get_legend_handles_labels()
    found = dict(zip(labels, handles, strict=True))
    for other in figure.axes:
        more = zip(*other.get_legend_handles_labels()[::-1], strict=True)
        found |= dict(more)
    figure.align_labels()
    figure.legend(
        found.values(), found.keys(), loc="upper right", bbox_to_anchor=(0.98, 0.93), frameon=False
    )
