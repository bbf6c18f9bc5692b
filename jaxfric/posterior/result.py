"""The result of a posterior: maximum, Laplace approximation, and optional draws."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..described import Described, Drawable, Drawn, Tabular
from ..findings import WarningCode, listed, marked, warned
from ..fitting.result import DIFFERENCE as DIFFERENCE
from ..fitting.result import Fit
from ..fitting.thresholds import ENDS
from ..quantity import numbered_names
from ..saved.entry import ENTRY, law_entry, law_name, open_words
from ..schemas import POSTERIOR
from ..stability.claims import rate_state_claim
from .distributions import AbstractPrior
from .laplace import Laplace
from .sampler import Draws

LAPLACE, NUTS = "Laplace", "NUTS"
RHAT, ESS = 1.01, 400
"""Largest R-hat and least effective sample size of reliable draws (Vehtari et al. 2021,
doi:10.1214/20-BA1221)."""


class Spread(NamedTuple):
    """Mean, standard deviation and 95 % interval (2.5 to 97.5 %) of draws [SI]."""

    mean: float
    std: float
    lower: float
    upper: float


class Fitted(NamedTuple):
    """A parameter of a fit without priors [SI], and whether the record determines it."""

    value: float
    std: float
    determined: bool


class Chains(NamedTuple):
    """Convergence diagnostics of a parameter, computed by ArviZ."""

    rhat: float
    ess_bulk: float
    ess_tail: float


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Described, Drawable, Drawn, Tabular):
    """The posterior of a fit's parameters under priors. SI.

    The noise is fixed at the fit's estimate (`posterior.target`). If `converged` is False, the
    posterior is unreliable, and `warnings` give the reasons.
    """

    fit: Fit
    names: tuple[str, ...]
    """Names of the parameters, in the order of the priors and of draws."""
    priors: tuple[AbstractPrior, ...]
    laplace: Laplace
    draws: Draws | None
    chains: dict[str, Chains]
    """By name, `A_minus_B` too; empty without draws."""
    converged: bool
    warnings: tuple[str, ...]
    noise: str = "the fit's estimate"
    """Origin of the fixed noise."""
    whitened: dict[str, Fitted] | None = None
    """The fit without priors, whitened by that noise, by name; None if `fit` is whitened."""

    @property
    def found(self) -> bool:
        """Whether the posterior has results to show; False if the maximum is unreliable."""
        return self.converged or self.draws is not None

    @property
    def parameters(self) -> dict[str, Spread]:
        """Mean, std and 95 % interval of `A_minus_B` and every parameter, by name [SI], from the
        draws or else the Laplace approximation."""
        return self.sampled() or self.approximation()

    @property
    def fit_name(self) -> str:
        """The name of `fitted` in reports: "whitened fit", or "fit" if the noise is white."""
        same = self.whitened is None and self.fit.weighting == "ordinary"
        return "fit" if same else "whitened fit"

    def fitted(self) -> dict[str, Fitted]:
        """`A_minus_B` and every parameter of the fit without priors, weighted as the posterior."""
        return self.ordinary() if self.whitened is None else self.whitened

    def ordinary(self) -> dict[str, Fitted]:
        """`A_minus_B` and every parameter of `fit` itself, with the weighting of `fit`."""
        own = {DIFFERENCE: self.fit.A_minus_B, **self.fit.parameters}
        return {
            n: Fitted(own[n].value, own[n].std, own[n].determined)
            for n in (DIFFERENCE, *self.names)
        }

    def reweighted(self) -> tuple[str, ...]:
        """Names of parameters for which `fit` and the whitened fit differ by more than the larger
        of the two errors. The cause of a difference between the two fits is the weighting, not the
        priors.
        """
        pairs = zip(self.fitted().items(), self.ordinary().values(), strict=True)
        return tuple(
            name
            for (name, a), b in pairs
            if a.determined and b.determined and abs(a.value - b.value) > max(a.std, b.std)
        )

    def maximum(self) -> dict[str, float]:
        """Parameters at the maximum of the posterior density of y, by name [SI]."""
        return {k: float(v) for k, v in self.named(self.laplace.values).items()}

    def named(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """Columns of parameters (..., p) by name, and A minus all B."""
        return named(self.names, values)

    def approximation(self) -> dict[str, Spread]:
        """The Laplace approximation by name."""
        return {k: spread(v) for k, v in self.named(self.laplace.draws).items()}

    def sampled(self) -> dict[str, Spread]:
        """The draws by name; empty without draws."""
        if self.draws is None:
            return {}
        return {k: spread(v) for k, v in self.named(self.draws.values).items()}

    def drawn(self) -> dict[str, np.ndarray]:
        """Columns (n,) of the draws [SI], by NUTS or else by the Laplace approximation."""
        values = self.laplace.draws if self.draws is None else self.draws.values
        return {name: np.ravel(column) for name, column in self.named(values).items()}

    def law_entry(self) -> dict[str, object]:
        """The entry "friction_law" of the posterior's file (`saved.entry`): the law of the fit at
        the maximum, with the covariance of the draws."""
        entry, method = law_entry(self.fit.to_json()), LAPLACE if self.draws is None else NUTS
        drawn, maximum = self.drawn(), {law_name(n): x for n, x in self.maximum().items()}
        amplitudes = [maximum[name] for name in numbered_names(self.fit.model.states)[0::2]]
        error = spread(drawn[DIFFERENCE]).std
        claim = rate_state_claim(maximum["A"], amplitudes, error, determined=True)
        return entry | {
            "origin": f"{self.fit.model.states} state(s), posterior ({method})",
            "parameters": {
                name: {**item, "value": maximum.get(name, item["value"]), "determined": True}
                for name, item in entry["parameters"].items()
            },
            "free": [law_name(name) for name in self.names],
            "covariance": np.atleast_2d(np.cov([drawn[name] for name in self.names])).tolist(),
            **listed((*self._warned(), *open_words("posterior", claim, "draws"))),
        }

    def _warned(self) -> tuple[str, ...]:
        """Warnings of the fit and of the posterior."""
        return (*marked("the fit warned", self.fit.warnings), *self.warnings)

    def attributes(self) -> dict[str, object]:
        """Metadata for the file; lists and tables are JSON, velocities and stiffness SI."""
        fit = self.fit
        noise = {"sigma": fit.noise.sigma, **fit.noise.to_json()}
        return {
            "schema": POSTERIOR,
            "method": LAPLACE if self.draws is None else NUTS,
            "converged": int(self.converged),
            "record": Path(fit.record.provenance.path).name,
            "law": fit.model.law,
            "states": fit.model.states,
            "friction_unit": fit.record.friction_unit,
            "stiffness": fit.parameters["K"].value,
            "reference_velocity": fit.parameters["V0"].value,
            "noise": json.dumps(noise),
            "noise_held": self.noise,
            **{name: json.dumps(one) for name, one in listed(self._warned()).items()},
            ENTRY: json.dumps(self.law_entry()),
        }


def named(names: Sequence[str], values: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of parameters (..., p) by name, and A minus all B."""
    columns = {name: values[..., i] for i, name in enumerate(names)}
    amplitudes = [columns[n] for n in names if n.rstrip("0123456789") == "B"]
    return {**columns, DIFFERENCE: columns["A"] - sum(amplitudes)}


def spread(values: np.ndarray) -> Spread:
    """`Spread` of all values."""
    flat = np.ravel(values)
    lower, upper = np.percentile(flat, ENDS)
    return Spread(float(np.mean(flat)), float(np.std(flat, ddof=1)), float(lower), float(upper))


def doubts(chains: dict[str, Chains], diverging: int) -> tuple[str, ...]:
    """Reasons why draws are unreliable, one sentence each; empty for reliable draws."""
    if not chains:
        return ()
    rhat = max(chains, key=lambda name: _worst(chains[name].rhat, 1))
    few = min(chains, key=lambda name: _worst(_least(chains[name]), -1))
    lines = []
    if not chains[rhat].rhat <= RHAT:
        lines.append(warned(WarningCode.CHAINS, name=rhat, rhat=chains[rhat].rhat, most=RHAT))
    if not _least(chains[few]) >= ESS:
        lines.append(warned(WarningCode.FEW_DRAWS, name=few, size=_least(chains[few]), least=ESS))
    if diverging:
        lines.append(warned(WarningCode.DIVERGED, number=diverging))
    return tuple(lines)


def _least(one: Chains) -> float:
    return float(np.minimum(one.ess_bulk, one.ess_tail))


def _worst(value: float, sign: int) -> float:
    """A number for comparison that ranks nan as the worst."""
    return sign * np.inf if np.isnan(value) else value
