"""The figure of a posterior: every parameter, and every pair of parameters."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import norm

from ..fitting.result import display_unit
from ..posterior.result import DIFFERENCE, Posterior
from . import style
from .palette import BLACK, BLUE, GREY, ORANGE
from .ticks import whole_numbers

_DRAWS, _LAPLACE, _PRIOR = BLUE, ORANGE, GREY
_BINS, _MOST = 30, 2000
_LOW = 0.04
"""A prior of less than this part of the height of a panel is told in words."""
_REACH = 3.6
"""Half width of a panel in standard deviations."""
_CONTOUR = 5.991
"""chi-square of two degrees of freedom that 95 % are below."""


def posterior_figure(posterior: Posterior) -> Figure:
    """Figure of a posterior: densities on the diagonal, pairs of parameters below the diagonal."""
    names = (DIFFERENCE, *posterior.names)
    about, drawn = _columns(posterior, posterior.laplace.draws), None
    if posterior.draws is not None:
        values = posterior.draws.values
        drawn = _columns(posterior, values.reshape(-1, values.shape[-1]))
    count = len(names)
    figure = style.new_figure(style.DOUBLE, style.DOUBLE)
    axes = figure.subplots(count, count, squeeze=False)
    for i, row in enumerate(names):
        for j, column in enumerate(names):
            axis: Axes = axes[i, j]
            if j > i:
                axis.set_axis_off()
                continue
            _scale(axis, "x", posterior, column, (drawn or about)[column])
            if i == j:
                _density(axis, posterior, row, about[row], None if drawn is None else drawn[row])
            else:
                _pair(axis, (column, row), about, drawn)
                _scale(axis, "y", posterior, row, (drawn or about)[row])
            axis.tick_params(axis="x", rotation=40)
            axis.label_outer()
    title = f"posterior, {posterior.fit.model.law} law"
    title += "" if posterior.converged else "; it claims nothing, see the warnings"
    colour = BLACK if posterior.converged else _LAPLACE
    return style.finish(figure, title, of=posterior.fit.record.provenance.path, colour=colour)


def _columns(posterior: Posterior, values: np.ndarray) -> dict[str, np.ndarray]:
    """Draws by name in the units that are shown."""
    columns = posterior.named(values)
    return {name: column / display_unit(name, posterior.fit)[1] for name, column in columns.items()}


def _density(
    axis: Axes, posterior: Posterior, name: str, about: np.ndarray, drawn: np.ndarray | None
) -> None:
    """Histogram of the draws, the Laplace approximation and the prior, each of area 1."""
    low, high = axis.get_xlim()
    edges = np.linspace(low, high, _BINS + 1).tolist()
    x = np.linspace(low, high, 200)
    if drawn is not None:
        axis.hist(drawn, edges, density=True, color=_DRAWS, alpha=0.45, label="draws (NUTS)")
    one, unit = posterior.fitted()[name], display_unit(name, posterior.fit)[1]
    if one.determined:
        density = norm.pdf(x, one.value / unit, one.std / unit)
        label = f"{posterior.fit_name}, no prior"
        axis.plot(x, density, color=BLACK, lw=1.0, ls=":", label=label)
    heights, _ = np.histogram(about, edges, density=True)
    axis.stairs(heights, edges, color=_LAPLACE, lw=1.1, label="Laplace approximation")
    if name in posterior.names:
        prior = posterior.priors[posterior.names.index(name)]
        along, density = prior.curve(x, unit)  # no curve for a flat prior
        axis.plot(along, density, color=_PRIOR, lw=1.5, ls="--", label="prior", clip_on=False)
        if np.max(density, initial=0.0) < _LOW * heights.max():
            words = "prior: far wider" if len(along) else f"prior: {prior.text()}"
            axis.text(0.02, 1.0, words, transform=axis.transAxes, va="bottom")
    axis.set_yticks([])
    axis.set_ylim(bottom=0.0)
    axis.spines["left"].set_visible(False)


def _pair(
    axis: Axes, pair: tuple[str, str], about: dict[str, np.ndarray],
    drawn: dict[str, np.ndarray] | None,
) -> None:  # fmt: skip
    """Draws of two parameters, and the 95 % ellipse of the Laplace approximation's covariance."""
    shown = about if drawn is None else drawn
    # chosen at random: the draws are a Sobol sequence, of which every second lies on one side
    some = np.random.default_rng(0).permutation(len(shown[pair[0]]))[:_MOST]
    x, y = (shown[name][some] for name in pair)
    colour = _LAPLACE if drawn is None else _DRAWS
    axis.plot(x, y, ".", color=colour, ms=2.0, alpha=0.4, mew=0, rasterized=True)
    both = np.stack([about[name] for name in pair])
    angle = np.linspace(0, 2 * np.pi, 100)
    values, vectors = np.linalg.eigh(np.cov(both))
    root = vectors * np.sqrt(np.maximum(values, 0.0) * _CONTOUR)
    ellipse = both.mean(axis=1)[:, None] + root @ np.stack([np.cos(angle), np.sin(angle)])
    axis.plot(*ellipse, color=_LAPLACE, lw=1.1, ls=(0, (4, 2)), label="its 95 % ellipse")


def _scale(axis: Axes, which: str, posterior: Posterior, name: str, seen: np.ndarray) -> None:
    """Limits, numbers and name of the axis, "x" or "y", of a parameter."""
    middle, reach = float(np.median(seen)), _REACH * float(np.std(seen))
    axis.set(**{f"{which}lim": (middle - reach, middle + reach)})
    whole_numbers(axis, which, most=3)
    unit = display_unit(name, posterior.fit)[0].replace("um", "µm")
    axis.set(**{f"{which}label": style.named("A − B" if name == DIFFERENCE else name, unit)})
