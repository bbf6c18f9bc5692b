"""The figure of a comparison of laws: the record with each law's friction, and what each leaves."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..loop.compare import LawComparison, LawScore
from ..runs.table import amount
from .label import friction_label, printable
from .palette import BLACK, EIGHT, HELD, SLATE
from .written import write

_COLOURS = EIGHT[:6]
_RECORD, _STEP, _HELD = BLACK, SLATE, HELD


def draw_comparison(found: LawComparison, *paths: str | Path) -> None:
    """Write the figure to each of `paths` (PNG, SVG or PDF by its ending)."""
    write(comparison_figure(found), *paths)


def comparison_figure(found: LawComparison) -> Figure:
    """The figure."""
    scores = [score for score in found.scores if score.bic is not None]
    figure = Figure(figsize=(10.5, 3.2 + 1.25 * len(scores)))
    FigureCanvasAgg(figure)
    axes = figure.subplots(
        1 + len(scores), 1, sharex=True, squeeze=False, height_ratios=[2.2, *[1] * len(scores)]
    )[:, 0]
    figure.subplots_adjust(left=0.09, right=0.8, top=0.9, bottom=0.08, hspace=0.12)
    time = found.record.relative_time
    axes[0].plot(time, found.record.friction, color=_RECORD, lw=0.8, label="record")
    limit, cut = _limit(found, scores), False
    for k, (axis, score) in enumerate(zip(axes[1:], scores, strict=True)):
        colour = _COLOURS[k % len(_COLOURS)]
        axes[0].plot(time, score.fit.predicted, color=colour, lw=1.2, label=score.name)
        residual = np.clip(score.fit.residual / found.sigma, -limit, limit)
        cut |= bool(np.any(np.abs(residual) == limit))
        axis.plot(time, residual, color=colour, lw=0.7)
        axis.axhline(0, color="0.3", lw=0.6)
        axis.set_ylim(-1.05 * limit, 1.05 * limit)
        axis.set_ylabel("record − fit\n[σ]")
        axis.text(1.015, 0.98, _words(found, score), transform=axis.transAxes, va="top",
                  fontsize=8.5)  # fmt: skip
    axes[0].set_ylabel(friction_label(found.record.friction_unit))
    axes[0].legend(loc="upper left", bbox_to_anchor=(1.005, 1.02), frameon=False, fontsize=9)
    axes[-1].set_xlabel("time since the first row [s]")
    _mark(found, axes)
    figure.align_ylabels(list(axes))
    name = printable(found.record.provenance.path)
    unit = " N" if found.record.friction_unit == "N" else ""
    told = f"dashed: velocity steps; σ = {found.sigma:.3g}{unit}, the noise under the likeliest law"
    told += f"; beyond ±{limit:.2g} σ lines are cut" if cut else ""
    figure.suptitle(
        f"{name}: {_answer(found)}\n{told}", x=0.01, ha="left", fontsize=11, parse_math=False
    )
    return figure


def _answer(found: LawComparison) -> str:
    """Which law the record supports, in a few words."""
    law = found.supported
    if law is not None:
        states = "" if law.states == 1 else f" with {law.states} states"
        return f"the record supports the {law.fit.law} law{states}"
    if not found.of_laws:
        return "no fit of a law converged"
    if not found.rivals:
        return f"only the {found.of_laws[0].fit.law} law could be fitted"
    return f"the record cannot tell which law, {' or '.join(found.untold)}"


def _limit(found: LawComparison, scores: list[LawScore]) -> float:
    """Common y-limit [σ] of the residual panels: the residual of the worst law, capped."""
    worst = max(float(np.quantile(np.abs(score.fit.residual), 0.995)) for score in scores)
    return float(np.clip(1.2 * worst / found.sigma, 4.0, 40.0))


def _words(found: LawComparison, score: LawScore) -> str:
    lines, above = [score.name], found.above(score)
    if above is not None:
        lines.append("the least BIC" if above == 0 else f"BIC higher by {amount(above)}")
    if not score.fit.converged:
        lines.append("did not converge")
    if score.held_out is not None:
        lines.append(f"held-out error {score.held_out / found.sigma:.2f} σ")
    return "\n".join(lines)


def _mark(found: LawComparison, axes: np.ndarray) -> None:
    """Velocity steps as lines; those that were held out shaded."""
    ends = np.append(found.steps.times, found.record.relative_time[-1])
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.margins(x=0.01)
        for time in found.steps.times[1:]:
            axis.axvline(time, color=_STEP, lw=0.7, ls="--", zorder=0)
        for k in found.held_out_steps:
            axis.axvspan(ends[k], ends[k + 1], color=_HELD, lw=0, zorder=-1)
    if found.held_out_steps:
        place, across = ends[found.held_out_steps[0]], axes[0].get_xaxis_transform()
        axes[0].text(place, 1.01, " held out of a second fit", transform=across, fontsize=8)
