"""Show a posterior in words and tables: ordinary fit, maximum, Laplace approximation, draws."""

from collections.abc import Mapping

from ..errors import either, option
from ..posterior.result import DIFFERENCE, Fitted, Posterior, Spread
from ..units import with_unit
from .estimates import UNDETERMINED, Row, interval_cells
from .fit_text import shown_name, unit_for
from .report import Report
from .tables import TextTable
from .words import say


def report(posterior: Posterior) -> Report:
    """Report a posterior: ordinary fit, maximum, Laplace approximation and draws.

    A posterior whose maximum is unreliable has no numbers, only its warnings.
    """
    if not posterior.found:
        headline = f"{posterior.fit.law} law, posterior; did not converge: it claims nothing"
        return Report([headline], warnings=posterior.warnings)
    rows, drawn = (
        spread_rows(posterior, spreads)
        for spreads in (posterior.approximation(), posterior.sampled())
    )
    by = "NUTS" if drawn else "Laplace approximation"
    shown = ((row.name.partition(" ")[0], row.shown) for row in (drawn or rows).values())
    told = ", ".join(f"{name} = {text}" for name, text in shown if name[0] in "ABL")
    end = "" if posterior.converged else "; did not converge: it claims nothing"
    head = ("", "prior", posterior.fit_name, "maximum", "mean", "std", "95 % interval", "unit")
    priors = dict(zip(posterior.names, posterior.priors, strict=True))
    maximum, fitted, found = posterior.maximum(), posterior.fitted(), []
    for name, row in rows.items():
        size, std = unit_for(name, posterior.fit)[1], posterior.approximation()[name].std
        prior = priors[name].text(size) if name in priors else ""
        most, *_ = interval_cells(maximum[name], std, 0.0, 0.0, size)
        fit = _fitted(fitted[name], size)
        found.append((row.name, prior, fit, most, row.value, row.std, row.interval, row.unit))
    tables = [TextTable("posterior", head, found)]
    if drawn:
        head = ("", "mean", "std", "95 % interval", "R-hat", "ESS bulk", "tail", "unit")
        ends = {
            name: (f"{c.rhat:.3f}", f"{c.ess_bulk:.0f}", f"{c.ess_tail:.0f}")
            for name, c in posterior.chains.items()
        }
        found = [
            (row.name, row.value, row.std, row.interval, *ends[name], row.unit)
            for name, row in drawn.items()
        ]
        tables.append(TextTable("draws", head, found))
    headline = [f"{posterior.fit.law} law, {by}: {told}{end}"]
    notes = posterior_lines(posterior)
    return Report(headline, tables, notes=notes, warnings=posterior.warnings)


def spread_rows(posterior: Posterior, spreads: Mapping[str, Spread]) -> dict[str, Row]:
    """Make one row for A minus the sum of all B, and one row for each fitted parameter."""
    rows = {}
    for name in (DIFFERENCE, *posterior.names) if spreads else ():
        unit, size = unit_for(name, posterior.fit)
        rows[name] = Row(shown_name(name), "", *interval_cells(*spreads[name], size), unit)
    return rows


def posterior_lines(posterior: Posterior) -> list[str]:
    """Lines on a posterior besides the table of its parameters."""
    held = f"noise is held at {posterior.noise}"
    held += "" if posterior.whitened is None else say("fit.weighted")
    how = "Laplace approximation about the maximum"
    if posterior.draws is not None:
        chains, draws = posterior.draws.diverging.shape
        how = f"{chains} chains of {draws} draws by NUTS, {int(posterior.draws.diverging.sum())}"
        how += f" divergent, acceptance {posterior.draws.acceptance.mean():.2f}"
    return [f"{how}; {held}", *_reweighted(posterior)]


def _reweighted(posterior: Posterior) -> list[str]:
    """A sentence where the ordinary fit differs by how rows are weighted, else nothing."""
    ordinary, told = posterior.ordinary(), []
    for name in posterior.reweighted():
        unit, size = unit_for(name, posterior.fit)
        told.append(
            f"{shown_name(name).split()[0]} = {with_unit(_fitted(ordinary[name], size), unit)}"
        )
    if not told:
        return []
    gls = either(option("weighting", "gls"), "weighting='whitened'")
    return [say("fit.reweighted", told=", ".join(told), gls=gls)]


def _fitted(one: Fitted, size: float) -> str:
    """Value and standard deviation of a fit without priors."""
    value, std, _ = interval_cells(one.value, one.std, one.value, one.value, size)
    return f"{value} ± {std}" if one.determined else UNDETERMINED
