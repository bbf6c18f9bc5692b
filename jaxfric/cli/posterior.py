"""`jaxfric fit --prior`: the posterior of a fit, in a file, a figure and tables."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..errors import InputError
from . import options
from .folder import Folder

if TYPE_CHECKING:
    from ..fitting import Fit
    from ..fitting.problem import Model
    from ..posterior import Posterior

FILE = "posterior.nc"
_CHAINS = 4


@options.FLAT
@dataclass(frozen=True)
class PriorOptions:
    """Priors of the fit, and number of posterior draws."""

    prior: Path | None = None
    """Find the posterior too, with the priors of this TOML file. Example: [priors] A = {normal =
    [0.006, 0.001]}. Writes posterior.nc and a figure. Needs pip install "jaxfric\\[posterior]"."""
    draws: Annotated[int | None, options.MORE] = None
    """Draws of each NUTS chain, --draws 1000. Default: no draws."""
    chains: Annotated[int | None, options.MORE] = None
    """Number of NUTS chains. Default: 4."""
    seed: Annotated[int | None, options.MORE] = None
    """Seed of the draws. Default: 0."""

    def refuse_unusable(self) -> None:
        """Refuse options that are impossible or would not be used; called before the fit."""
        given = {"--draws": self.draws, "--chains": self.chains, "--seed": self.seed}
        unused = [option for option, value in given.items() if value is not None]
        if self.prior is None:
            if unused:
                raise InputError(
                    f"{unused[0]} needs a posterior; give priors with --prior priors.toml"
                )
            return
        if self.draws is None and unused:
            raise InputError("--chains and --seed need draws; ask for them, as in --draws 1000")
        from ..posterior.posterior import refuse_few
        from ..posterior.sampler import require_blackjax

        require_blackjax()
        if self.draws is not None:
            refuse_few(self.draws, _CHAINS if self.chains is None else self.chains)

    def check(self, model: "Model", friction_unit: str) -> None:
        """Refuse priors of parameters that this model does not have; called before the fit."""
        from ..laws.registry import known_law
        from ..posterior.priors import priors_of, read_priors

        if self.prior is not None:
            model = model._replace(law=known_law(model.law))
            priors = read_priors(self.prior)
            priors_of(model, priors, friction_unit, str(self.prior))

    def of(self, fit: "Fit", progress: Callable[[str], None]) -> "Posterior | None":
        """Return the posterior of a fit; None without priors, or if the fit did not converge."""
        from ..posterior import find_posterior

        if self.prior is None or not fit.converged:
            return None
        return find_posterior(
            fit,
            self.prior,
            draws=self.draws,
            chains=_CHAINS if self.chains is None else self.chains,
            seed=self.seed or 0,
            progress=progress,
        )


def write_posterior(posterior: "Posterior | None", to: Path) -> None:
    """Write the posterior as netCDF to a folder, if there is a posterior."""
    if posterior is None or not posterior.found:
        return
    from ..posterior import write_netcdf

    write_netcdf(posterior, to / FILE)


def draw(posterior: "Posterior | None", folder: Folder) -> None:
    """Draw the posterior, if there is one."""
    if posterior is None or not posterior.found:
        return
    from ..plot.posterior import draw_posterior

    names = ("posterior.png", "posterior.svg")
    folder.draw("its figure", lambda to: draw_posterior(posterior, *(to / n for n in names)))
