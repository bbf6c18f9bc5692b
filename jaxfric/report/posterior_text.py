"""Show a posterior in words and tables: ordinary fit, maximum, Laplace approximation, draws."""

from typing import NamedTuple

from ..errors import either, option
from ..fitting.result import display_unit
from ..posterior.result import DIFFERENCE, Fitted, Posterior
from ..units import decimals, read_as
from .estimates import interval_cells
from .fit_text import shown_name
from .report import Report
from .tables import TextTable


class PosteriorRow(NamedTuple):
    """One parameter in display units; text only, ready for a table."""

    name: str
    prior: str
    fit: str
    maximum: str
    laplace: tuple[str, str, str]
    """Mean, standard deviation and 95 % interval of the Laplace approximation."""
    draws: tuple[str, ...]
    """The same of the draws, then R-hat and effective sample sizes of bulk and tail; or empty."""
    unit: str

    @property
    def shown(self) -> str:
        """Write mean and standard deviation of the posterior as "14.3 ± 1.3 µm"."""
        mean, std, *_ = self.draws or self.laplace
        return f"{mean} ± {std}{f' {self.unit}' if self.unit else ''}"


def report(posterior: Posterior) -> Report:
    """Report a posterior: ordinary fit, maximum, Laplace approximation and draws."""
    rows = posterior_rows(posterior)
    by = "Laplace approximation" if posterior.draws is None else "NUTS"
    told = [f"{r.name.partition(' ')[0]} = {r.shown}" for r in rows if r.name[0] in "ABL"]
    end = "" if posterior.converged else "; did not converge: it claims nothing"
    head = ("", "prior", posterior.fit_name, "maximum", "mean", "std", "95 % interval", "unit")
    found = [(r.name, r.prior, r.fit, r.maximum, *r.laplace, r.unit) for r in rows]
    tables = [TextTable("posterior", head, found)]
    if posterior.draws is not None:
        head = ("", "mean", "std", "95 % interval", "R-hat", "ESS bulk", "tail", "unit")
        tables.append(TextTable("draws", head, [(r.name, *r.draws, r.unit) for r in rows]))
    headline = [f"{posterior.fit.law} law, {by}: {', '.join(told)}{end}"]
    notes = posterior_lines(posterior)
    return Report(headline, tables, notes=notes, warnings=posterior.warnings)


def posterior_rows(posterior: Posterior) -> list[PosteriorRow]:
    """Make one row for A minus the sum of all B, and one row for each fitted parameter."""
    priors = dict(zip(posterior.names, posterior.priors, strict=True))
    maximum, about = posterior.maximum(), posterior.approximation()
    drawn, fitted, rows = posterior.sampled(), posterior.fitted(), []
    for name in (DIFFERENCE, *posterior.names):
        unit, size = display_unit(name, posterior.fit)
        cells: tuple[str, ...] = ()
        if drawn:
            chains = posterior.chains[name]
            ess = f"{chains.ess_bulk:.0f}", f"{chains.ess_tail:.0f}"
            cells = (*interval_cells(*drawn[name], size), f"{chains.rhat:.3f}", *ess)
        row = PosteriorRow(
            name=shown_name(name),
            prior=priors[name].text(size) if name in priors else "",
            fit=_fitted(fitted[name], size),
            maximum=f"{maximum[name] / size:.{decimals(about[name].std / size)}f}",
            laplace=interval_cells(*about[name], size),
            draws=cells,
            unit="" if unit == "1" else read_as(unit),
        )
        rows.append(row)
    return rows


def posterior_lines(posterior: Posterior) -> list[str]:
    """Lines on a posterior besides the table of its parameters."""
    held = f"noise is held at {posterior.noise}"
    if posterior.whitened is not None:
        held += (
            "; rows are weighted by it, in the whitened fit too; the ordinary fit weighs all alike"
        )
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
        unit, size = display_unit(name, posterior.fit)
        value = _fitted(ordinary[name], size)
        told.append(
            f"{shown_name(name).split()[0]} = {value}"
            + ("" if unit == "1" else f" {read_as(unit)}")
        )
    if not told:
        return []
    gls = either(option("weighting", "gls"), "weighting='whitened'")
    return [
        f"the ordinary fit has {', '.join(told)}: its difference to the whitened fit comes from"
        f" how rows are weighted, not from a prior; {gls} makes that fit"
    ]


def _fitted(one: Fitted, size: float) -> str:
    """Value and standard deviation of a fit without priors."""
    value, std, _ = interval_cells(one.value, one.std, one.value, one.value, size)
    return f"{value} ± {std}" if one.determined else "undetermined"
