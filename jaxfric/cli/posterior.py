"""`jaxfric fit --prior`: the posterior of a fit, in a file, a figure and tables."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..errors import InputError
from . import options
from .told import doing

if TYPE_CHECKING:
    from ..fitting import Fit
    from ..posterior import Posterior


@options.FLAT
@dataclass(frozen=True)
class PriorOptions:
    """Options: priors of the fit, and number of posterior draws."""

    prior: Path | None = None
    """Find the posterior too, with the priors of this TOML file. Example: [priors] A = {normal =
    [0.006, 0.001]}. Writes posterior.nc and a figure. Needs pip install "jaxfric\\[posterior]"."""
    draws: Annotated[int | None, options.MORE] = None
    """Draws of each NUTS chain, --draws 1000. Default: no draws."""
    chains: Annotated[int, options.MORE] = 4
    """Number of NUTS chains."""
    seed: Annotated[int, options.MORE] = 0
    """Seed of the draws."""

    def refuse_unusable(self) -> None:
        """Before the fit, refuse options that are impossible or would have no effect."""
        if self.draws is None and (self.chains, self.seed) != (4, 0):
            raise InputError(
                "--chains and --seed need draws of a posterior; ask for them, as in --prior"
                " priors.toml --draws 1000"
            )
        if self.prior is None:
            if self.draws is not None:
                raise InputError("--draws needs a posterior; give priors with --prior priors.toml")
            return
        from ..posterior.posterior import refuse_few
        from ..posterior.sampler import require_blackjax

        require_blackjax()
        if self.draws is not None:
            refuse_few(self.draws, self.chains)

    def check(self, law: str, of: options.ModelOptions, friction_unit: str) -> None:
        """Before the fit, refuse priors of parameters that the model does not have."""
        from ..fitting.problem import Model
        from ..laws.registry import known_law
        from ..posterior.priors import priors_of

        if self.prior is not None:
            model = Model(known_law(law), **of.model())
            priors_of(model, self._read, friction_unit, str(self.prior))

    @cached_property
    def _read(self) -> dict[str, object]:
        """The priors, read once: a pipe, as <(printf ...), has its lines only once."""
        from ..posterior.priors import read_priors

        assert self.prior is not None
        return read_priors(self.prior)

    def of(self, fit: "Fit") -> "Posterior | None":
        """Return the posterior of a fit; None without priors, or if the fit did not converge."""
        from ..posterior import find_posterior

        if self.prior is None or not fit.converged:
            return None
        return find_posterior(
            fit,
            self._read,
            draws=self.draws,
            chains=self.chains,
            seed=self.seed,
            progress=doing,
        )
