"""A posterior in one line, a report, a figure and a table."""

from ..plot.label import printable
from ..posterior.result import DIFFERENCE, Posterior
from ..report.posterior_text import posterior_lines, posterior_rows
from ..report.report import Report
from ..report.tables import TextTable
from .view import Frame, View


def line(posterior: Posterior) -> str:
    """Mean and standard deviation of A-B, A, B and L, of the draws if there are any."""
    by = "Laplace" if posterior.draws is None else "NUTS"
    told = ", ".join(
        f"{row.name.partition(' ')[0]} = {row.shown}"
        for row in posterior_rows(posterior)
        if row.name[0] in "ABL"
    )
    name = printable(posterior.fit.record.provenance.path)
    end = "converged" if posterior.converged else "did not converge: it claims nothing"
    return f"Posterior({name}, {posterior.fit.law} law, by {by}: {told}; {end})"


def report(posterior: Posterior) -> Report:
    """The fit with the same weighting, the maximum, its Laplace approximation, and the draws."""
    rows = posterior_rows(posterior)
    head = ("", "prior", posterior.fit_name, "maximum", "mean", "std", "95 % interval", "unit")
    found = [(r.name, r.prior, r.fit, r.maximum, *r.laplace, r.unit) for r in rows]
    tables = [TextTable("posterior", head, found)]
    if posterior.draws is not None:
        head = ("", "mean", "std", "95 % interval", "R-hat", "ESS bulk", "tail", "unit")
        tables.append(TextTable("draws", head, [(r.name, *r.draws, r.unit) for r in rows]))
    return Report((), tables, notes=posterior_lines(posterior), warnings=posterior.warnings)


def frame(posterior: Posterior) -> Frame:
    """One row for A-B and each parameter, SI, of the draws or else of the Laplace approximation.

    The first columns are in words.
    """
    spreads, maximum, fitted = posterior.parameters, posterior.maximum(), posterior.fitted()
    of = {DIFFERENCE: posterior.fit.A_minus_B, **posterior.fit.parameters}
    rows: list[dict[str, object]] = [
        {"name": name, "shown": row.shown, "maximum": maximum[name], **spreads[name]._asdict()}
        | {"unit": of[name].unit, "fit": fitted[name].value, "fit_std": fitted[name].std}
        | (posterior.chains[name]._asdict() if name in posterior.chains else {})
        for name, row in zip((DIFFERENCE, *posterior.names), posterior_rows(posterior), strict=True)
    ]
    attrs = {
        "method": "Laplace" if posterior.draws is None else "NUTS",
        "fit": posterior.fit_name,
        "converged": posterior.converged,
        "warnings": list(posterior.warnings),
    }
    return Frame(rows, "name", attrs)


def figure(posterior: Posterior):
    """The figure posterior.png."""
    from ..plot.posterior import posterior_figure

    return posterior_figure(posterior)


VIEW = View(line, report, figure, frame)
