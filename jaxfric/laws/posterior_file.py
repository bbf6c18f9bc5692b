"""The friction law of a Posterior, or of the netCDF that `jaxfric fit --prior` wrote of it.

A file is read by h5py alone: it is HDF5, and ArviZ is not needed to use it.
"""

import contextlib
import json
import typing
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import InputError
from ..quantity import numbered_names
from ..stability.claims import rate_state_claim
from ..units import factor
from .registry import fixed_states, is_rate_state, law_quantity, rate_state
from .source import LawSource, force_of_unit, seen_velocities, trend_words

if TYPE_CHECKING:
    import h5py

POSTERIOR = "jaxfric.posterior/1"
_MAGIC = b"\x89HDF\r\n\x1a\n"
_AGAIN = "make it again with jaxfric fit and a file of priors"
_NEEDED = ("schema", "converged", "law", "states", "friction_unit", "reference_velocity")


def is_posterior(path: Path) -> bool:
    """Whether a file is a posterior by its ending, or HDF5 by its first bytes."""
    if path.suffix == ".nc":
        return True
    with contextlib.suppress(OSError), path.open("rb") as stream:
        return stream.read(len(_MAGIC)) == _MAGIC
    return False


class PosteriorContent(NamedTuple):
    """Attributes of a posterior; draws and maximum of its parameters by name [SI]."""

    about: Mapping[str, object]
    draws: Mapping[str, np.ndarray]
    maximum: Mapping[str, float]


@typing.runtime_checkable
class PosteriorResult(typing.Protocol):
    """A Posterior at hand."""

    def content(self) -> PosteriorContent: ...


Posterior = PosteriorResult | str | Path
"""A Posterior, or the path of its file."""


def law_from_posterior(
    source: Posterior, *, normal_force: float | None = None, samples: int = 64, seed: int = 0
) -> LawSource:
    """The law at the maximum of a posterior in newtons, and draws of the posterior as its samples.

    The draws are thinned to `samples` of them: whole ones, so that parameters stay correlated as
    they are, and each only once. The direct effect is the regularised one, so that the law can be
    carried through rest; a slip trend is left out, as by `law_of_fit`.

    Parameters
    ----------
    normal_force : [N], as in `law_of_fit`.
    samples : number of draws besides the maximum. seed : of the choice of them.

    Raises
    ------
    InputError : file missing, damaged or of another schema; a posterior that claims nothing; fewer
        draws than samples; a normal force missing or not wanted.
    """
    if isinstance(source, PosteriorResult):
        about, draws, maximum = source.content()
        path = Path(f"{type(source).__name__} of {about['record']}")
        _refuse(path, about)
    else:
        path = Path(source)
        about, draws, maximum = _read(path)
    scale = force_of_unit(str(about["friction_unit"]), normal_force, path)
    kind, states = str(about["law"]), int(str(about["states"]))
    V0 = float(str(about["reference_velocity"]))
    names = ["f0", "A", *numbered_names(states)]
    chosen = _chosen(path, len(draws["A"]), samples, seed)
    columns = {n: np.concatenate([[maximum[n]], draws[n][chosen]]) for n in names}
    columns["V0"] = np.full(samples + 1, V0)
    values = {**{name: maximum[name] for name in names}, "V0": V0}
    law = rate_state(kind, values, states, scale=scale)
    text = f"{kind} law, {states} state(s), posterior ({about.get('method', '')}): {path}"
    trend = trend_words(maximum.get("slip_trend"), scale)
    warnings = (*_warnings(path, about), *_doubts(draws, maximum, states), *trend)
    seen = seen_velocities(_json(path, about, "velocities"))
    return LawSource(law, rate_state(kind, columns, states, scale=scale), text, V0, warnings, seen)


def _chosen(path: Path, number: int, samples: int, seed: int) -> np.ndarray:
    if samples > number:
        raise InputError(
            f"{path}: it has {number} draws; use --samples {number} or fewer, or draw more"
        )
    return np.sort(np.random.default_rng(seed).choice(number, samples, replace=False))


def _read(path: Path) -> PosteriorContent:
    """The content of the file, checked."""
    with _opened(path) as file:
        import h5py

        group = file.get("posterior")
        if not isinstance(group, h5py.Group) or "schema" not in group.attrs:
            raise InputError(f"{path}: no posterior of jaxfric; {_AGAIN}")
        about = {str(k): _plain(v) for k, v in group.attrs.items()}
        _refuse(path, about)
        needed = ["f0", "A", *numbered_names(int(str(about["states"])))]
        draws, maximum = {}, {}
        for name in [*needed, *(n for n in ("slip_trend",) if n in group)]:
            entry = group.get(name)
            if not isinstance(entry, h5py.Dataset) or not {"unit", "map"} <= set(entry.attrs):
                raise InputError(f"{path}: damaged: {name} or its unit is missing; {_AGAIN}")
            size = _size(str(about["friction_unit"]), name, _plain(entry.attrs["unit"]))
            draws[name] = np.ravel(np.asarray(entry[...], float)) * size
            maximum[name] = float(str(_plain(entry.attrs["map"]))) * size
            if not np.all(law_quantity(name).allows(np.append(draws[name], maximum[name]))):
                raise InputError(f"{path}: damaged: {name} is out of its bounds; {_AGAIN}")
    return PosteriorContent(about, draws, maximum)


@contextlib.contextmanager
def _opened(path: Path) -> Generator["h5py.File"]:
    try:
        import h5py
    except ImportError:
        raise InputError(
            f'{path}: a posterior needs h5py; install it: pip install "jaxfric[posterior]"'
        ) from None
    if not path.is_file():
        raise InputError(f"{path}: no such file; make one with jaxfric fit and a file of priors")
    try:
        file = h5py.File(path, "r")
    except OSError:
        raise InputError(f"{path}: no netCDF file, or damaged; {_AGAIN}") from None
    with file:
        yield file


def _refuse(path: Path, about: Mapping[str, object]) -> None:
    """Raise `InputError` for attributes that are of no posterior, or of one that claims nothing."""
    if about["schema"] != POSTERIOR:
        raise InputError(
            f"{path}: its schema is '{about['schema']}'; a file of '{POSTERIOR}' is needed"
        )
    missing = next((key for key in _NEEDED if key not in about), None)
    if missing:
        raise InputError(f"{path}: damaged: '{missing}' is missing; {_AGAIN}")
    kind, states = about["law"], about["states"]
    if not is_rate_state(kind) or fixed_states(str(kind)) not in (None, states):
        raise InputError(f"{path}: damaged: law '{kind}' of {states} states is not known; {_AGAIN}")
    if about["converged"] != 1:
        why = "; ".join(_json(path, about, "warnings") or ["no reason is given"])
        raise InputError(f"{path}: this posterior claims nothing: {why}")


def _size(friction_unit: str, name: str, unit: object) -> float:
    """The unit of a parameter in SI."""
    si = law_quantity(name).unit_for(friction_unit)
    return 1.0 if unit == si or unit == si.removeprefix("1 ") else factor(str(unit), si, name)


def _plain(value: object) -> object:
    """A text or a number of an attribute, which netCDF keeps as an array."""
    if isinstance(value, np.ndarray | np.generic) and value.size == 1:
        value = value.item()
    return value.decode() if isinstance(value, bytes) else value


def _json(path: Path, about: Mapping[str, object], key: str) -> list:
    try:
        found = json.loads(str(about.get(key, "[]")))
    except ValueError:
        found = None
    if not isinstance(found, list):
        raise InputError(f"{path}: damaged: its {key} are no list; {_AGAIN}")
    return found


def _warnings(path: Path, about: Mapping[str, object]) -> tuple[str, ...]:
    """What the fit and the posterior warned of."""
    return tuple(" ".join(str(line).split()) for line in _json(path, about, "warnings"))


def _doubts(
    draws: Mapping[str, np.ndarray], maximum: Mapping[str, float], states: int
) -> tuple[str, ...]:
    """A warning where the posterior says nothing of stability, as a fit warns of itself."""
    amplitudes = numbered_names(states)[0::2]
    error = float(np.std(draws["A"] - sum(draws[name] for name in amplitudes), ddof=1))
    values = [maximum[name] for name in amplitudes]
    claim = rate_state_claim(maximum["A"], values, error, determined=True)
    if claim.kind != "open":
        return ()
    return (
        f"this posterior says nothing of stability ({'; '.join(claim.reasons)}): what follows is of"
        " its draws, not of the record",
    )
