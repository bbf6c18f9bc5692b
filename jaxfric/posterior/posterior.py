"""`find_posterior(fit, priors)`: the posterior of a fit's parameters under priors."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, option
from ..findings import WarningCode, warned
from ..fitting.fit import require_float64
from ..fitting.noise import Noise
from ..fitting.result import Fit
from ..fitting.uncertainty import determined
from ..silent import silent
from .distributions import FlatPrior
from .inference_data import diagnosed
from .laplace import Laplace, laplace
from .priors import priors_of, read_priors
from .result import DIFFERENCE, Fitted, Posterior, doubts, named, spread
from .sampler import nuts, require_blackjax
from .target import Target, target_of_problem

_FEWEST_DRAWS, _FEWEST_CHAINS = 4, 2


def find_posterior(
    fit: Fit,
    priors: Mapping[str, object] | str | Path | None = None,
    *,
    draws: int | None = None,
    chains: int = 4,
    seed: int = 0,
    noise: Noise | None = None,
    progress: Callable[[str], None] = silent,
) -> Posterior:
    """Compute maximum, Laplace approximation and draws of a posterior.

    log p = -|r|^2/2 + log prior, see `posterior.target`; the noise is fixed.

    Parameters
    ----------
    fit : of `jaxfric.fit`, in this process (a fit.json does not contain the record).
    priors : by name, {"A": {"normal": [0.006, 0.001]}, "L": {"lognormal": [20, 0.5], "unit":
        "um"}}, see `posterior.priors`, or their TOML file. Parameters without a prior are flat (in
        ln A, ln L, ln K, f0 and B). None: all are flat.
    draws : per chain, by NUTS; None: no draws. Needs `pip install "jaxfric[posterior]"`.
    chains, seed : number of chains, at least 2, and random seed.
    noise : known noise in units of the fit's `solved.problem.noise_scale`; default: the noise
        found by the fit.
    progress : called with a text at every stage.

    Returns
    -------
    Posterior. Check `converged` and `warnings` of the posterior. Near the end of a uniform prior
    the Laplace approximation is inexact; a warning then asks for draws.

    Raises
    ------
    InputError : float64 is off; the fit did not converge; an invalid prior (`priors_of`); too few
        draws or chains.

    Correlated priors and a prior of the noise are not available.
    """
    require_float64()
    target, start = target_of(fit, {} if priors is None else priors, noise=noise)
    if draws is not None:
        refuse_few(draws, chains)
    progress("the maximum of the posterior")
    about = laplace(target, start)
    names = target.problem.model.names()
    refused = _of_maximum(fit, target, about)
    held = "the fit's estimate" if noise is None else "given"
    whitened = None
    if not refused and target.whitening is not None and fit.weighting == "ordinary":
        progress("the fit without priors of the same weighting")
        whitened = _whitened(fit, noise)
    if draws is None or refused:
        said = refused or _cut(names, about)
        return Posterior(
            fit, names, target.priors, about, None, {}, not refused, said, held, whitened
        )
    found = nuts(about, draws=draws, chains=chains, seed=seed, progress=progress)
    agreed = diagnosed(names, found)
    said = doubts(agreed, int(found.diverging.sum()))
    return Posterior(
        fit, names, target.priors, about, found, agreed, not said, said, held, whitened
    )


def refuse_few(draws: int, chains: int) -> None:
    """Raise `InputError` for too few draws or chains, or if the sampler is not installed."""
    require_blackjax()
    if draws < _FEWEST_DRAWS:
        raise InputError(f"{option('draws')} is {draws}; it must be {_FEWEST_DRAWS} or more")
    if chains < _FEWEST_CHAINS:
        raise InputError(
            f"{option('chains')} is {chains}; R-hat compares at least {_FEWEST_CHAINS}"
        )


def target_of(
    fit: Fit, priors: Mapping[str, object] | str | Path, *, noise: Noise | None = None
) -> tuple[Target, np.ndarray]:
    """Return the log posterior of a fit, and variables at which its maximisation starts."""
    if not fit.converged or fit.solved is None:
        why = fit.result if not fit.converged else "it is read from a file; fit the record again"
        raise InputError(f"this fit has no posterior: {why}")
    solved, where = fit.solved, "priors"
    if isinstance(priors, str | Path):
        priors, where = read_priors(priors), str(priors)
    sizes = dict(zip(fit.model.names(), solved.problem.coordinates.scales, strict=True))
    own = priors_of(fit.model, priors, fit.record.friction_unit, where, scale=sizes.__getitem__)
    held = solved.noise if noise is None else noise
    target = target_of_problem(solved.problem, held, own)
    return target, target.start(np.asarray(solved.solution.z))


def _whitened(fit: Fit, noise: Noise | None) -> dict[str, Fitted]:
    """Maximise the likelihood (the posterior under flat priors); return values and errors."""
    target, start = target_of(fit, {}, noise=noise)
    about, names = laplace(target, start), target.problem.model.names()
    values, errors = named(names, about.values), named(names, about.draws)
    known = dict(zip(names, _determined(fit, target, about), strict=True))
    known[DIFFERENCE] = all(known[name] for name in names if name[0] in "AB")
    return {
        name: Fitted(float(values[name]), spread(errors[name]).std, known[name] and about.converged)
        for name in (DIFFERENCE, *names)
    }


def _determined(fit: Fit, target: Target, about: Laplace) -> list[bool]:
    """Whether the Laplace approximation determines each parameter."""
    std = np.sqrt(np.diag(about.covariance))
    z = target.problem.coordinates.to_free(np.asarray(about.values))
    return determined(target.problem, z, std, float(np.ptp(fit.record.friction)))


def _of_maximum(fit: Fit, target: Target, about: Laplace) -> tuple[str, ...]:
    """Reasons why a maximum and its Laplace approximation are unreliable."""
    if not about.converged:
        return (warned(WarningCode.NO_MAXIMUM),)
    known = _determined(fit, target, about)
    pairs = zip(target.problem.model.names(), target.priors, known, strict=True)
    loose = [name for name, prior, fixed in pairs if isinstance(prior, FlatPrior) and not fixed]
    return (warned(WarningCode.NO_PRIOR, parameters=loose, first=loose[0]),) if loose else ()


def _cut(names: Sequence[str], about: Laplace) -> tuple[str, ...]:
    """A warning of uniform priors that end inside the Laplace approximation."""
    cut = [names[i] for i in about.cut]
    return (warned(WarningCode.PRIOR_ENDS, parameters=cut),) if cut else ()
