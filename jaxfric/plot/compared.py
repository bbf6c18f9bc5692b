"""Draw a comparison of friction laws: record, and friction and residual of each law."""

import numpy as np
from matplotlib.figure import Figure

from ..loop.compare import LawComparison, LawScore
from ..report.comparison import answer
from ..runs.table import amount
from . import style
from .palette import BLACK, EIGHT, HELD


def comparison_figure(found: LawComparison) -> Figure:
    """Figure of a comparison of laws."""
    scores = [score for score in found.scores if score.bic is not None]
    record, place = found.record, style.along(found.steps, found.record.relative_time)
    figure, (top, *below) = style.panels([1.9, *[0.85] * len(scores)])
    style.samples(top, place.x, record.friction, colour=BLACK)
    limit, cut = _limit(found, scores), False
    for axis, score, colour in zip(below, scores, EIGHT, strict=False):
        style.curve(top, place, score.fit.predicted, score.name, colour)
        residual = np.clip(score.fit.residual / found.sigma, -limit, limit)
        cut |= bool(np.any(np.abs(residual) == limit))
        style.samples(axis, place.x, residual, "", colour)
        axis.set_ylim(-1.05 * limit, 1.05 * limit)
        style.tidy(axis, y="record − fit\n[σ]", zero=True)
        style.beside(axis, _words(found, score))
    style.tidy(top, y=style.friction_label(record.friction_unit))
    style.mark_steps([top, *below], place)
    ends = np.append(place.starts, place.x[-1])
    for axis in (top, *below):
        for k in found.held_out_steps:
            axis.axvspan(
                ends[k], ends[k + 1], fc=HELD, lw=0, zorder=-1, label="held out of a second fit"
            )
    unit = " N" if record.friction_unit == "N" else ""
    told = f"σ = {found.sigma:.3g}{unit}, the noise under the likeliest law"
    style.tidy(below[0], told + (f"; beyond ±{limit:.2g} σ points are cut" if cut else ""))
    style.tidy(below[-1], x=place.label)
    return style.finish(figure, answer(found), of=record.provenance.path)


def _limit(found: LawComparison, scores: list[LawScore]) -> float:
    """Common y-limit [σ] of the residual panels: the residual of the worst law, capped."""
    worst = max(float(np.quantile(np.abs(score.fit.residual), 0.995)) for score in scores)
    return float(np.clip(1.2 * worst / found.sigma, 4.0, 40.0))


def _words(found: LawComparison, score: LawScore) -> str:
    lines, above = [score.name], found.above(score)
    if above is not None:
        lines.append("ΔBIC 0, the least" if above == 0 else f"ΔBIC +{amount(above)}")
    if not score.fit.converged:
        lines.append("did not converge")
    if score.held_out is not None:
        lines.append(f"held-out error {score.held_out / found.sigma:.2f} σ")
    return "\n".join(lines)
