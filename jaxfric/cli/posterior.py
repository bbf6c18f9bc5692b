"""What `jaxfric fit --prior` adds to a fit: its posterior in a file, a figure and tables."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..errors import InputError
from .folder import Folder

if TYPE_CHECKING:
    from ..fitting import Fit
    from ..fitting.problem import Model
    from ..posterior import Posterior

FILE = "posterior.nc"
_CHAINS = 4


class PosteriorCall(NamedTuple):
    """The priors of a call and how many draws it wants."""

    file: Path
    draws: int | None
    chains: int
    seed: int

    def check(self, model: "Model", friction_unit: str) -> None:
        """Refuse priors that are none of this model, before it is fitted."""
        from ..laws.registry import known_law
        from ..posterior.priors import priors_of, read_priors

        model = model._replace(law=known_law(model.law))
        priors_of(model, read_priors(self.file), friction_unit, str(self.file))

    def of(self, fit: "Fit", progress: Callable[[str], None]) -> "Posterior | None":
        """The posterior of a fit; None where it did not converge."""
        from ..posterior import find_posterior

        if not fit.converged:
            return None
        return find_posterior(
            fit,
            self.file,
            draws=self.draws,
            chains=self.chains,
            seed=self.seed,
            progress=progress,
        )


def asked(
    prior: Path | None, draws: int | None, chains: int | None, seed: int | None
) -> PosteriorCall | None:
    """What the options ask for; None without `--prior`. Refuses what cannot be done, or would not
    be used, before anything is fitted."""
    given = {"--draws": draws, "--chains": chains, "--seed": seed}
    if prior is None:
        unused = [option for option, value in given.items() if value is not None]
        if unused:
            raise InputError(
                f"{unused[0]} is of a posterior; give its priors with --prior priors.toml"
            )
        return None
    if draws is None and (chains is not None or seed is not None):
        raise InputError("--chains and --seed are of draws; ask for these, as in --draws 1000")
    from ..posterior.posterior import refuse_few
    from ..posterior.sampler import require_blackjax

    require_blackjax()
    chains = _CHAINS if chains is None else chains
    if draws is not None:
        refuse_few(draws, chains)
    return PosteriorCall(prior, draws, chains, seed or 0)


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
