"""A posterior as ArviZ InferenceData, and as a netCDF file.

Groups: `posterior` (every parameter and A_minus_B in the units of the record, with `unit`, `map`,
`prior`, `laplace_mean` and `laplace_std` as attributes; `step_shift`, fitted shifts of step times
[s]), `sample_stats` (of NUTS), `observed_data` (friction) and `constant_data` (time, weight: 0 for
an excluded row). Attributes of `posterior` describe the origin of the posterior. Without NUTS the
group `posterior` holds draws of the Laplace approximation, as `method` records. The likelihood of
every row at every draw is omitted: 4000 draws of 2000 rows are 64 MB.
"""

import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..fitting.problem import quantity_of
from ..fitting.result import Fit, display_unit
from .result import Chains, Posterior, named
from .sampler import MISSING, Draws

if TYPE_CHECKING:
    from types import ModuleType

    from arviz import InferenceData


def imported_arviz(tries: int = 3) -> "ModuleType":
    """Import ArviZ without its FutureWarning.

    On import ArviZ writes the date of its FutureWarning into a cache folder. If two processes write
    to the cache folder of ArviZ at once, one process misses its file and imports ArviZ again.

    Raises
    ------
    InputError : ArviZ is not installed, or cannot write to its cache.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)
            import arviz
    except ImportError:
        raise InputError(MISSING) from None
    except OSError as error:
        if tries > 1:
            return imported_arviz(tries - 1)
        raise InputError(f"ArviZ cannot be imported; it writes to its cache: {error}") from None
    return arviz


def diagnosed(names: Sequence[str], draws: Draws) -> dict[str, Chains]:
    """Rank-normalised R-hat, and effective sample sizes of bulk and tail, by name."""
    arviz = imported_arviz()
    data = arviz.convert_to_dataset(named(names, draws.values))
    rhat, bulk = arviz.rhat(data), arviz.ess(data, method="bulk")
    tail = arviz.ess(data, method="tail")
    return {str(n): Chains(float(rhat[n]), float(bulk[n]), float(tail[n])) for n in data.data_vars}


def inference_data(posterior: Posterior) -> "InferenceData":
    """The posterior as ArviZ InferenceData; draws come from NUTS or the Laplace approximation."""
    arviz, fit, draws = imported_arviz(), posterior.fit, posterior.draws
    values = posterior.laplace.draws[None] if draws is None else draws.values
    columns = {
        name: column / display_unit(name, fit)[1]
        for name, column in posterior.named(values).items()
    }
    coords, dims, shifts = _shifts(posterior)
    if shifts is not None:
        columns["step_shift"] = shifts
    made = arviz.from_dict(
        posterior=columns,
        sample_stats=None if draws is None else _stats(draws),
        observed_data={"friction": np.asarray(fit.record.friction)},
        constant_data={"time": fit.record.relative_time, "weight": _weight(fit)},
        coords={"row": np.arange(len(fit.record)), **coords},
        dims={"friction": ["row"], "time": ["row"], "weight": ["row"], **dims},
    )
    made.posterior.attrs.update(posterior.attributes())
    for name, about in _of_variables(posterior).items():
        made.posterior[name].attrs.update(about)
    if shifts is not None:
        made.posterior["step_shift"].attrs["unit"] = "s"
    made.observed_data["friction"].attrs["unit"] = fit.record.friction_unit
    made.constant_data["time"].attrs["unit"] = "s"
    return made


def write_netcdf(posterior: Posterior, file: str | Path) -> None:
    """Write the posterior as netCDF, atomically."""
    path = Path(file)
    partial = path.with_name(f".{path.name}.partial")
    try:
        inference_data(posterior).to_netcdf(str(partial), engine="h5netcdf")
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _shifts(posterior: Posterior) -> tuple[dict, dict, np.ndarray | None]:
    """Coordinates, dimensions and draws (c, n, k) [s] of the shifts of step times."""
    solved, p = posterior.fit.solved, len(posterior.names)
    assert solved is not None
    scale = np.asarray(solved.problem.shift_scale)
    real = np.flatnonzero(scale > 0)  # as `target_of_problem` counts them
    if posterior.draws is None or not len(real):
        return {}, {}, None
    shifts = posterior.draws.y[..., p:] * scale[real]
    steps = np.asarray(solved.problem.shifted)[real]
    return {"velocity_step": steps}, {"step_shift": ["velocity_step"]}, shifts


def _stats(draws: Draws) -> dict[str, np.ndarray]:
    return {
        "lp": draws.log_density,
        "diverging": draws.diverging,
        "acceptance_rate": draws.acceptance,
        "tree_depth": draws.depth,
        "n_steps": draws.steps,
    }


def _weight(fit: Fit) -> np.ndarray:
    assert fit.solved is not None
    return np.asarray(fit.solved.problem.weight)[: len(fit.record)]


def _of_variables(posterior: Posterior) -> dict[str, dict[str, object]]:
    """Attributes of every variable; numbers in its unit."""
    fit, maximum, found = posterior.fit, posterior.maximum(), {}
    priors = dict(zip(posterior.names, posterior.priors, strict=True))
    for name, one in posterior.approximation().items():
        unit, size = display_unit(name, fit)
        found[name] = {
            "unit": unit,
            "map": maximum[name] / size,
            "laplace_mean": one.mean / size,
            "laplace_std": one.std / size,
        }
        if name in priors:
            found[name] |= {"prior": priors[name].text(size), "text": quantity_of(name).text}
    return found
