"""The figure of a fit: record and model, residual, autocorrelation of the residual."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..findings import WarningCode, is_of
from ..fitting import Fit
from ..fitting.misfit import excess, scatter
from ..fitting.noise.autocorrelation import clocks
from ..report.fit_text import rows
from . import style
from .noise import draw_autocorrelation, mark_glitches
from .palette import BLACK, ORANGE

_BAND, _WIDE = "0.82", "0.93"
_ALIKE = 1.1
"""Up to such a ratio two bands are drawn as one."""


def fit_figure(fit: Fit) -> Figure:
    """Figure of a fit: record and model, residual and its autocorrelation, parameters as text."""
    figure, (top, middle, bottom) = style.panels([2.1, 1.1, 1.1], last_alone=True)
    record, place = fit.record, style.along(fit.steps, fit.record.relative_time)
    style.samples(top, place.x, record.friction)
    style.curve(top, place, fit.predicted, "fit", ORANGE, width=1.3)
    style.tidy(top, y=style.friction_label(record.friction_unit))
    style.beside(top, _parameters(fit))
    _residual(middle, fit, place)
    style.mark_steps([top, middle], place)
    path = np.asarray(fit.steps.displacement(record.relative_time))
    clock = clocks(record.relative_time, path)
    draw_autocorrelation(bottom, clock, _counted(fit), fit.noise, model=fit.converged)
    states = "" if fit.model.states == 1 else f", {fit.model.states} states"
    title = f"{fit.model.law} law{states}"
    title += "" if fit.converged else "; did not converge, its numbers mean nothing"
    colour = BLACK if fit.converged else ORANGE
    return style.finish(figure, title, of=record.provenance.path, colour=colour)


def _parameters(fit: Fit) -> str:
    """A line for every parameter, with its error and unit."""
    return "\n".join(f"{row.name} = {row.shown}" for row in rows(fit))


def _residual(axis: Axes, fit: Fit, place: style.Along) -> None:
    if fit.converged:
        near, whole = scatter(fit), fit.noise.sigma
        if whole > _ALIKE * near:
            style.band(axis, 1.96 * whole, "±1.96 σ of all residuals", _WIDE)
        style.band(axis, 1.96 * near, "±1.96 σ of neighbouring rows", _BAND)
        if any(is_of(text, WarningCode.MISFIT) for text in fit.warnings):
            said = f"residual: {excess(fit):.2g} times the scatter of neighbouring rows"
            style.tidy(axis, said)
    style.samples(axis, place.x, _counted(fit), "residual")
    mark_glitches(axis, place.x, fit.noise.glitches)
    style.tidy(axis, x=place.label, y=("record − fit", fit.record.friction_unit), zero=True)


def _counted(fit: Fit) -> np.ndarray:
    """The residual; nan where a row is passed over."""
    residual = np.array(fit.residual)
    residual[list(fit.noise.glitches.rows)] = np.nan
    return residual
