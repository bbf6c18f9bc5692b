"""What `jaxfric fit --prior` adds to a fit: its posterior in a file, a figure and tables."""

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
    """The priors of a posterior, and how many draws of it are wanted."""

    prior: Path | None = None
    """Find the posterior too, by this TOML file of priors. Priors: [priors] A = {normal = [0.006,
    0.001]}. Writes posterior.nc and a figure. Needs pip install "jaxfric\\[posterior]"."""
    draws: Annotated[int | None, options.MORE] = None
    """Draws of each chain by NUTS, as in --draws 1000. Otherwise none."""
    chains: Annotated[int | None, options.MORE] = None
    """Chains of draws, 4 where not given."""
    seed: Annotated[int | None, options.MORE] = None
    """Seed of the draws, 0 where not given."""

    def refuse_unusable(self) -> None:
        """Refuse what cannot be done, or would not be used, before anything is fitted."""
        given = {"--draws": self.draws, "--chains": self.chains, "--seed": self.seed}
        unused = [option for option, value in given.items() if value is not None]
        if self.prior is None:
            if unused:
                raise InputError(
                    f"{unused[0]} is of a posterior; give its priors with --prior priors.toml"
                )
            return
        if self.draws is None and unused:
            raise InputError("--chains and --seed are of draws; ask for these, as in --draws 1000")
        from ..posterior.posterior import refuse_few
        from ..posterior.sampler import require_blackjax

        require_blackjax()
        if self.draws is not None:
            refuse_few(self.draws, _CHAINS if self.chains is None else self.chains)

    def check(self, model: "Model", friction_unit: str) -> None:
        """Refuse priors that are none of this model, before it is fitted."""
        from ..laws.registry import known_law
        from ..posterior.priors import priors_of, read_priors

        if self.prior is not None:
            model = model._replace(law=known_law(model.law))
            priors = read_priors(self.prior)
            priors_of(model, priors, friction_unit, str(self.prior))

    def of(self, fit: "Fit", progress: Callable[[str], None]) -> "Posterior | None":
        """The posterior of a fit; None where it did not converge, and without priors."""
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
    """The posterior as netCDF in a folder, where one was found."""
    if posterior is None or not posterior.found:
        return
    from ..posterior import write_netcdf

    write_netcdf(posterior, to / FILE)


def draw(posterior: "Posterior | None", folder: Folder) -> None:
    """The figure of the posterior, where one was found."""
    if posterior is None or not posterior.found:
        return
    from ..plot.posterior import draw_posterior

    names = ("posterior.png", "posterior.svg")
    folder.draw("its figure", lambda to: draw_posterior(posterior, *(to / n for n in names)))
