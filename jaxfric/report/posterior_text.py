"""A posterior in words and tables: the fit beside the maximum, its normal law and the draws."""

from typing import NamedTuple

from ..fitting.table import decimals, shown_name
from ..posterior.inference_data import unit_name, unit_size
from ..posterior.result import DIFFERENCE, Posterior, Spread


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
        """Mean and deviation, of the draws where there are some: "14.3 ± 1.3 µm"."""
        mean, std, *_ = self.draws or self.laplace
        return f"{mean} ± {std}{f' {self.unit}' if self.unit else ''}"


def posterior_rows(posterior: Posterior) -> list[PosteriorRow]:
    """A less all B, then the parameters in the order of the fit."""
    priors = dict(zip(posterior.names, posterior.priors, strict=True))
    maximum, about = posterior.maximum(), posterior.approximation()
    drawn, rows = posterior.sampled(), []
    for name in (DIFFERENCE, *posterior.names):
        size, unit = unit_size(name, posterior.fit), unit_name(name, posterior.fit)
        digits = decimals(about[name].std / size)
        row = PosteriorRow(
            name=shown_name(name),
            prior=priors[name].text(size) if name in priors else "",
            fit=_of_fit(posterior, name, size),
            maximum=f"{maximum[name] / size:.{digits}f}",
            laplace=_spread(about[name], size),
            draws=_drawn(posterior, name, drawn[name], size) if drawn else (),
            unit="" if unit == "1" else unit.replace("um", "µm"),
        )
        rows.append(row)
    return rows


def posterior_lines(posterior: Posterior) -> list[str]:
    """Lines on a posterior beyond its parameters."""
    held = f"noise is held at {posterior.noise}"
    if posterior.fit.weighting == "ordinary" and posterior.fit.noise.parts:
        held += "; rows are weighted by it here, and alike in the fit (--weighting whitened)"
    if posterior.draws is None:
        return [f"Laplace approximation about the maximum; {held}"]
    chains, draws = posterior.draws.diverging.shape
    diverging = int(posterior.draws.diverging.sum())
    return [
        f"{chains} chains of {draws} draws by NUTS, {diverging} divergent,"
        f" acceptance {posterior.draws.acceptance.mean():.2f}; {held}"
    ]


def _of_fit(posterior: Posterior, name: str, size: float) -> str:
    """Value and standard deviation of the fit alone."""
    fit = posterior.fit
    one = fit.A_minus_B if name == DIFFERENCE else fit.parameters[name]
    value, std, known = one.value, one.std, one.determined
    digits = decimals(std / size)
    return f"{value / size:.{digits}f} ± {std / size:.{digits}f}" if known else "undetermined"


def _spread(one: Spread, size: float) -> tuple[str, str, str]:
    digits = decimals(one.std / size)
    mean, std, low, high = (f"{x / size:.{digits}f}" for x in one)
    return mean, std, f"{low} to {high}"


def _drawn(posterior: Posterior, name: str, one: Spread, size: float) -> tuple[str, ...]:
    chains = posterior.chains[name]
    ess = f"{chains.ess_bulk:.0f}", f"{chains.ess_tail:.0f}"
    return (*_spread(one, size), f"{chains.rhat:.3f}", *ess)
