"""Read the friction law of a result object, or of a file that another command wrote."""

from pathlib import Path

from ..errors import InputError, option
from ..laws.fitted import law_of
from ..laws.registry import Law
from ..laws.source import LawSource, stack
from ..rig.friction import AbstractDelayLaw, AbstractLaw
from ..units import parse_quantity
from .entry import fitted_law
from .files import Saved
from .posterior_file import Posterior, PosteriorResult, is_posterior, posterior_law
from .table import ENDINGS, law_from_table

Result = Saved | Posterior
"""A Fit, a Loop or a Posterior, or the path of its file."""


def law_from_fit(
    source: Result,
    *,
    normal_force: float | str | None = None,
    samples: int = 64,
    seed: int = 0,
    memory: str | None = None,
) -> LawSource:
    """Return the law of a fit, posterior or loop in newtons, with samples of the law's uncertainty.

    Samples are drawn from the covariance of a fit or a loop, or taken from the draws of a
    posterior. The law has the regularised direct effect. The `warnings` of the law are the warnings
    of the result, and a warning of effects that the law omits.

    Parameters
    ----------
    source : a Fit, a Posterior or a Loop, or the path of a fit.json, posterior.nc or loop.json, or
        of a table of friction against speed (`law_from_table`), which has no samples.
    normal_force : [N] or "500 N"; required for a friction coefficient, which is multiplied by this
        force, and refused for a law of a force.
    samples : number of samples in addition to the estimate. seed : seed of the random samples.
    memory : for a table, the memory distance of friction, "1 mm" (`law_from_table`).

    Raises
    ------
    InputError : another source; a file missing, damaged or of another schema; a fit that did not
        converge, a posterior that cannot be trusted; a normal force missing, not used or not
        positive; parameters that the fit left undetermined, fewer draws than samples.
    """
    force = normal_force
    if isinstance(force, str):
        force = parse_quantity(force, "N", option("normal-force"))
    if force is not None and not force > 0:
        raise InputError(f"{option('normal-force')}: '{normal_force}' is not positive")
    if not isinstance(source, Result):
        raise InputError(
            f"the law is a {type(source).__name__}; give a Fit, a Posterior or a Loop, the path of"
            " a fit.json, posterior.nc or loop.json, jaxfric.law_from_parameters(...), or (to"
            " find_gains) a law itself, as RateState(...)"
        )
    in_file = isinstance(source, str | Path)
    if in_file and Path(source).suffix.lower() in ENDINGS:
        return law_from_table(source, memory=memory, normal_force=force)
    if memory is not None:
        raise InputError(
            f"{option('memory')} goes with a table of friction against speed; leave it out"
        )
    if isinstance(source, PosteriorResult) or (in_file and is_posterior(Path(source))):
        fitted = posterior_law(source)
    else:
        fitted = fitted_law(source)
    return law_of(fitted, normal_force=force, samples=samples, seed=seed)


def law_source(law: LawSource | Law | Result, normal_force: float | str | None) -> LawSource:
    """Return a law with its samples, from a law or from any source of `law_from_fit`.

    Raises `InputError` as `law_from_fit` does, and for a normal force with a law in newtons.
    """
    if not isinstance(law, LawSource | AbstractLaw | AbstractDelayLaw):
        return law_from_fit(law, normal_force=normal_force)
    if normal_force is not None:
        raise InputError(
            f"{option('normal-force')} would not be used: this law is in newtons already; it goes"
            " with a Fit, a Posterior or a Loop"
        )
    return (
        law
        if isinstance(law, LawSource)
        else LawSource(law, stack([law]), "law", None, coordinate=None)
    )
