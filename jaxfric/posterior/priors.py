"""Priors written as TOML, by the names of a fit's parameters:

    [priors]
    A = {normal = [0.006, 0.001]}                  # mean and standard deviation
    L = {lognormal = [20.0, 0.5], unit = "um"}     # median, and standard deviation of ln L
    B = {uniform = [0, 0.05]}                      # ends

`unit` may be omitted for a dimensionless parameter. A parameter without entry has a flat prior, in
ln A, ln L, ln K, f0, B or the slip trend.
"""

import dataclasses
import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path

import jax
import numpy as np
from jaxtyping import ArrayLike

from ..errors import InputError, did_you_mean
from ..fitting.abstract_problem import ParametricModel
from ..fitting.result import unit_of
from ..units import factor
from .distributions import DISTRIBUTIONS, AbstractPrior, FlatPrior

_EXAMPLE = "[priors] A = {normal = [0.006, 0.001]}"


def read_priors(file: str | Path) -> dict[str, object]:
    """Read the table [priors] of a TOML file.

    Raises `InputError` if the file cannot be read, is not TOML or has no such table.
    """
    path = Path(file)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not TOML: {error}; write it as in {_EXAMPLE}") from None
    for key in content:
        if key != "priors":
            raise InputError(f"{path}: '{key}' is not known; there is one table: {_EXAMPLE}")
    table = content.get("priors")
    if not isinstance(table, dict) or not table:
        raise InputError(f"{path}: it has no priors; write them as in {_EXAMPLE}")
    return table


def priors_of(
    model: ParametricModel,
    given: Mapping[str, object],
    friction_unit: str,
    where: str = "priors",
    *,
    scale: Callable[[str], ArrayLike] | None = None,
) -> tuple[AbstractPrior, ...]:
    """Build the prior of every parameter of a model, in its order; flat unless `given`.

    Parameters
    ----------
    given : by name, `{"normal": [0.006, 0.001]}` or with a `"unit"`, as in the file.
    friction_unit : "1" or "N", unit of the record's friction.
    where : the file, for messages.
    scale : of the unbounded variable of a parameter, as in `Problem.coordinates`; None: 1, to check
        the priors only.

    Raises
    ------
    InputError : a name that is not fitted, an unknown distribution or key, invalid numbers, a
        unit of another dimension, or a prior outside the parameter's bounds.
    """
    names = model.names()
    for name in given:
        if name not in names:
            raise InputError(f"{where}: '{name}' is not fitted{did_you_mean(name, names)}")
    found: list[AbstractPrior] = []
    for name in names:
        own = 1.0 if scale is None else scale(name)
        about, size = model.quantity(name), jax.device_put(np.asarray(own, float))
        if name not in given:
            found.append(FlatPrior(dataclasses.replace(about, symbol=name), size))
            continue
        what = f"{where}: prior of {name}"
        kind, numbers, unit = _parts(given[name], what)
        si = unit_of(name, friction_unit)
        one = _size(unit, si, what)
        found.append(DISTRIBUTIONS[kind](about, size, numbers, one, what))
    return tuple(found)


def _parts(entry: object, what: str) -> tuple[str, tuple[float, float], str | None]:
    """Name of the distribution, its two numbers, and their unit."""
    if not isinstance(entry, Mapping):
        raise InputError(f"{what}: '{entry}' is no prior; write it as in {_EXAMPLE}")
    kinds = [key for key in entry if key != "unit"]
    for kind in kinds:
        if kind not in DISTRIBUTIONS:
            raise InputError(f"{what}: '{kind}' is no law{did_you_mean(kind, DISTRIBUTIONS)}")
    if len(kinds) != 1:
        known = ", ".join(DISTRIBUTIONS)
        raise InputError(f"{what} has {len(kinds)} laws; give it one of {known}")
    numbers, unit = entry[kinds[0]], entry.get("unit")
    if not isinstance(numbers, list | tuple) or len(numbers) != 2:
        raise InputError(f"{what}: {kinds[0]} takes two numbers, as in [0.006, 0.001]: {numbers}")
    for number in numbers:
        good = isinstance(number, int | float) and not isinstance(number, bool)
        if not good or not math.isfinite(number):
            raise InputError(f"{what}: {kinds[0]} takes two numbers, and '{number}' is none")
    if unit is not None and not isinstance(unit, str):
        raise InputError(f"{what}: the unit '{unit}' is no text; write it as in unit = 'um'")
    return kinds[0], (float(numbers[0]), float(numbers[1])), unit


def _size(unit: str | None, si: str, what: str) -> float:
    """Size of the unit of a prior in SI."""
    if unit is None:
        if si == "1":
            return 1.0
        raise InputError(f"{what} has no unit; give it one of {si}, as in unit = '{si}'")
    return factor(unit, si, what)
