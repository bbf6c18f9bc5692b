"""Read the varied parameters of a study.toml, from its tables [axes] and [samples]."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import InputError, did_you_mean
from ..laws import LawSource, law_of, name_of
from ..laws.fitted import FittedLaw, force_of_unit
from ..quantity import Quantity, numbered_names
from ..rig.friction import AbstractRateState
from ..saved.entry import fitted_law
from ..saved.posterior_file import is_posterior, posterior_law
from ..schemas import FIT
from ..study import Axis, Grid, Normal, Samples, Uniform, linspace, logspace, values
from ..study.grid import KINDS, Tabled
from ..tables import Table, file_of, flag, placed, positive, refuse_unknown, table_of, whole
from .parameters import parameter, value_of

About = Callable[[str, str], Quantity]
# Largest number of values of one axis, which are held in memory.
_MOST = 10_000_000
_AXIS = ("linspace", "logspace", "values", *KINDS, "from")


def read_grid(
    content: Table, path: Path, files: dict[str, str], *, about: About = parameter
) -> Grid:
    """Return the grid of [axes] and [samples]; `about` returns a parameter by its name."""
    where = f"{path.name} [axes]"
    table = table_of(content, "axes", path.name)
    if not table:
        raise InputError(f"{path.name}: [axes] is missing or empty; vary a parameter or more")
    axes: list[Axis] = []
    columns: list[Uniform | Normal | Tabled] = []
    for name, axis in table.items():
        if not isinstance(axis, dict):
            raise InputError(f"{where} {name}: write it as {{ linspace = [...], points = 20 }}")
        kind = _kind(axis, f"{where} {name}")
        if kind == "from":
            columns.append(_draws(axis, path, f"{where} {name}", files))
        elif kind in KINDS:
            columns.append(_column(about(name, where), kind, axis, where))
        else:
            axes.append(_axis(about(name, where), kind, axis, where))
    samples = table_of(content, "samples", path.name)
    refuse_unknown(samples, ("number", "seed"), f"{path.name} [samples]")
    count = whole(samples, "number", f"{path.name} [samples]")
    seed = whole(samples, "seed", f"{path.name} [samples]", 0) or 0
    if columns and count is None:
        raise InputError(f"{path.name}: [samples] number is missing; say how many, number = 1024")
    if count is not None and not columns:
        raise InputError(f"{path.name}: [samples] would not be used: no axis is sampled")
    return Grid(tuple(axes), Samples(count, tuple(columns), seed) if count and columns else None)


def _kind(axis: Table, where: str) -> str:
    kinds = [key for key in axis if key in _AXIS]
    extras = {"from": ("normal_force",), "linspace": ("points",), "logspace": ("points",)}
    if len(kinds) != 1:
        unknown = [key for key in axis if key not in (*_AXIS, "points", "log", "normal_force")]
        if unknown:
            raise InputError(f"{where}: no key '{unknown[0]}'{did_you_mean(unknown[0], _AXIS)}")
        raise InputError(f"{where}: give one of {', '.join(_AXIS)}")
    kind = kinds[0]
    allowed = extras.get(kind, ("log",) if kind in KINDS else ())
    refuse_unknown(axis, (kind, *allowed), where)
    return kind


def _axis(about: Quantity, kind: str, axis: Table, where: str) -> Axis:
    name = about.symbol
    given = axis[kind]
    place = f"{where} {name}"
    if not isinstance(given, list):
        raise InputError(f"{place}: {kind} is a list, as in {kind} = ['1 um/s', '10 um/s']")
    numbers = [value_of(x, about, place) for x in given]
    labels = {"unit": about.unit, "long_name": about.text}
    if kind == "values":
        if len(set(numbers)) < len(numbers):
            raise InputError(f"{place}: a value is given twice")
        with placed(place):
            return values(name, numbers, **labels)
    if len(numbers) != 2:
        raise InputError(f"{place}: {kind} takes two ends, not {len(numbers)} values")
    points = whole(axis, "points", place)
    if points is None:
        raise InputError(f"{place}: points is missing; say how many values, points = 20")
    if points > _MOST:
        raise InputError(f"{place}: {points} points; an axis has no more than {_MOST}")
    low, high = numbers
    if points > 1 and low == high:
        raise InputError(f"{place} is empty: both ends are {given[0]}")
    make = linspace if kind == "linspace" else logspace
    with placed(place):
        return make(name, low, high, points, **labels)


def _column(about: Quantity, kind: str, axis: Table, where: str) -> Uniform:
    name = about.symbol
    given, place = axis[kind], f"{where} {name}"
    if not isinstance(given, list) or len(given) != 2:
        raise InputError(f"{place}: {kind} takes two ends, as in {kind} = ['1 N', '2 N']")
    low, high = (value_of(x, about, place) for x in given)
    log = flag(axis, "log", place)
    with placed(place):
        return Uniform(name, low, high, about.unit, about.text, log, kind)


def _fitted(source: Path) -> FittedLaw:
    """Read the law of a fit.json or a posterior.nc."""
    return posterior_law(source) if is_posterior(source) else fitted_law(source, FIT)


def _draws(axis: Table, path: Path, where: str, files: dict[str, str]) -> Normal | Tabled:
    """Return columns from the draws of a posterior.nc, or from the covariance of a fit.json, which
    are lognormal for parameters with a lower bound."""
    source = file_of(axis["from"], path, where, files)
    fitted = _fitted(source)
    force = positive(axis, "normal_force", "N", where)
    scale = force_of_unit(fitted.friction_unit, force, fitted.where)
    names = [n for n in fitted.free if n in ("A", "f0") or n[0] in "BL"]
    index = [fitted.free.index(n) for n in names]
    loose = [n for n in names if n in fitted.loose]
    covariance = fitted.covariance[np.ix_(index, index)]
    if not names or loose or not np.all(np.isfinite(covariance)):
        what = ", ".join(loose) or "a parameter"
        raise InputError(f"{where}: {source}: the fit leaves {what} undetermined; nothing to draw")
    abouts = [parameter(n, where) for n in names]
    size = np.asarray([scale if a.unit == "N" else 1.0 for a in abouts])
    labels = tuple(a.unit for a in abouts), tuple(a.text for a in abouts)
    if fitted.draws is not None:
        return Tabled(
            tuple(names), np.stack([fitted.draws[n] for n in names], axis=-1) * size, *labels
        )
    mean = size * [fitted.parameters[n] for n in names]
    log = np.asarray([a.lower == 0.0 for a in abouts])
    spread = np.where(log, size / mean, size)
    lowered, vectors = np.linalg.eigh(covariance * np.outer(spread, spread))
    root = vectors * np.sqrt(np.maximum(lowered, 0.0))
    return Normal(tuple(names), mean, root, tuple(bool(x) for x in log), *labels)


def posterior(
    content: Table, path: Path, grid: Grid
) -> tuple[str | None, dict[str, float], tuple[str, ...]]:
    """Return law, parameters and warnings of the result that an axis names by `from`.

    The returned parameters are those that the axis does not draw.
    """
    table = table_of(content, "axes", path.name)
    sources = [axis for axis in table.values() if isinstance(axis, dict) and "from" in axis]
    if not sources:
        return None, {}, ()
    if len(sources) > 1:
        raise InputError(f"{path.name} [axes]: two axes with from; a member has one law")
    (axis,) = sources
    fitted = _fitted(path.parent / axis["from"])
    force = positive(axis, "normal_force", "N", f"{path.name} [axes]")
    read = law_of(fitted, normal_force=force, samples=0)
    kind, own = parameters_of(read)
    kept = {name: value for name, value in own.items() if name not in grid.names}
    return kind, kept, read.warnings


def parameters_of(source: LawSource) -> tuple[str | None, dict[str, float]]:
    """Return name and parameters (SI) of a rate-and-state law, under the names of a study.

    For a law other than rate-and-state the name is None, and the only parameter is the mass, if
    given.
    """
    law, kind = source.law, name_of(source.law)
    if kind is None or not isinstance(law, AbstractRateState):
        return None, {} if source.mass is None else {"m": source.mass}
    pairs = np.stack([law.B, law.L], axis=-1).ravel()
    own = {"f0": float(law.f0), "A": float(law.A), "V_ref": float(law.V0)}
    own |= {name: float(x) for name, x in zip(numbered_names(len(law.B)), pairs, strict=True)}
    return kind, own
