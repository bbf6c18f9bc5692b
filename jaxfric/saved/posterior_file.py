"""Read a law from a Posterior, or from the netCDF that `jaxfric fit --prior` wrote.

The netCDF file is HDF5, so h5py reads the file without ArviZ.
"""

import contextlib
import dataclasses
import json
import typing
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..laws.fitted import FittedLaw
from ..schemas import POSTERIOR, VERBS
from ..units import factor
from .entry import ENTRY, read_entry
from .files import refuse_damage

if TYPE_CHECKING:
    import h5py

_VERB = VERBS[POSTERIOR]
_MAGIC = b"\x89HDF\r\n\x1a\n"


def is_posterior(path: Path) -> bool:
    """Whether a file is a posterior by its suffix, or HDF5 by its first bytes."""
    if path.suffix == ".nc":
        return True
    with contextlib.suppress(OSError), path.open("rb") as stream:
        return stream.read(len(_MAGIC)) == _MAGIC
    return False


@typing.runtime_checkable
class PosteriorResult(typing.Protocol):
    """The interface of a Posterior."""

    def attributes(self) -> dict[str, object]: ...

    def drawn(self) -> dict[str, np.ndarray]: ...


Posterior = PosteriorResult | str | Path
"""A Posterior, or the path of its file."""


def posterior_law(source: Posterior) -> FittedLaw:
    """Return the law at the maximum of a posterior, with the draws of the posterior.

    Raises
    ------
    InputError : file missing, damaged or of another schema; a posterior that cannot be trusted.
    """
    if isinstance(source, PosteriorResult):
        about, draws = source.attributes(), source.drawn()
        fitted = _checked(Path(f"{type(source).__name__} of {about['record']}"), about)
        return dataclasses.replace(fitted, draws=draws)
    path = Path(source)
    with _opened(path) as file:
        import h5py

        group = file.get("posterior")
        if not isinstance(group, h5py.Group) or "schema" not in group.attrs:
            raise InputError(f"{path}: no posterior of jaxfric; make it again with: {_VERB}")
        fitted = _checked(path, {str(k): _plain(v) for k, v in group.attrs.items()})
        draws, known = {}, fitted.quantities()
        for name in (n for n in fitted.free if n in known and "." not in n):
            column, quantity = group.get(name), known[name]
            if not isinstance(column, h5py.Dataset) or "unit" not in column.attrs:
                refuse_damage(path, POSTERIOR, f"{name} or its unit is missing")
            si, unit = quantity.unit_for(fitted.friction_unit), str(_plain(column.attrs["unit"]))
            size = 1.0 if unit in (si, si.removeprefix("1 ")) else factor(unit, si, name)
            draws[name] = np.ravel(np.asarray(column[...], float)) * size
            within = bool(np.all(quantity.allows(draws[name])))
            refuse_damage(path, POSTERIOR, None if within else f"{name} is out of its bounds")
    return dataclasses.replace(fitted, draws=draws)


def _checked(path: Path, about: Mapping[str, object]) -> FittedLaw:
    """Return the law in the attributes of a posterior. Raises `InputError` for another file, and
    for a posterior that cannot be trusted."""
    if about["schema"] != POSTERIOR:
        raise InputError(
            f"{path}: its schema is '{about['schema']}'; a file of '{POSTERIOR}' is needed"
        )
    try:
        entry = json.loads(str(about.get(ENTRY)))
    except ValueError:
        entry = None
    fitted = read_entry(path, entry, POSTERIOR)
    if about.get("converged") != 1:
        why = "; ".join(fitted.warnings) or "no reason is given"
        raise InputError(f"{path}: this posterior claims nothing: {why}")
    return fitted


@contextlib.contextmanager
def _opened(path: Path) -> Generator["h5py.File"]:
    try:
        import h5py
    except ImportError:
        raise InputError(
            f'{path}: a posterior needs h5py; install it: pip install "jaxfric[posterior]"'
        ) from None
    if not path.is_file():
        raise InputError(f"{path}: no such file; make one with: {_VERB}")
    try:
        file = h5py.File(path, "r")
    except OSError:
        raise InputError(
            f"{path}: no netCDF file, or damaged; make it again with: {_VERB}"
        ) from None
    with file:
        yield file


def _plain(value: object) -> object:
    """Return a text or a number from an attribute, which netCDF stores as an array."""
    if isinstance(value, np.ndarray | np.generic) and value.size == 1:
        value = value.item()
    return value.decode() if isinstance(value, bytes) else value
