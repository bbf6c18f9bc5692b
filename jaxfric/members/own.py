"""A study of the user's own function, `--function FILE.py:NAME`, with this study.toml:

kind = "member"          # with JAX, of one member; "batch": of arrays; "host": any Python

[units]                  # of parameters and outputs; others have none
x = "m"
height = "m"

[rig]                    # fixed parameters, also passed to the function
g = "9.81 m/s^2"

[axes]
x = { linspace = ["0 m", "10 mm"], points = 20 }

The function takes a dict of numbers in SI by name, and returns a dict of outputs.
"""

import importlib.util
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import ArrayLike

from ..errors import InputError, option
from ..quantity import Quantity
from ..study import Grid, Output
from ..study.function import Function, Kind
from ..study.local import error_text, infer_outputs, outputs_of_shapes
from ..tables import Table, number, read_toml, refuse_unknown, table_of
from ..units import WrongDimension, is_unit
from .axes import read_grid
from .spec import Spec, StudyPart, refuse_outputs, spec_of

# Members of a block, for a function written with JAX or in plain Python.
_CHUNK, _CHUNK_ONE_BY_ONE = 65536, 16
KINDS: tuple[Kind, ...] = ("member", "batch", "host")
_TOP = ("kind", "outputs", "chunk", "dtype", "units", "rig", "axes", "samples")


@dataclass(frozen=True, eq=False)
class Own:
    """The user's function with the fixed parameters filled in."""

    wrapped: Function
    fixed: dict[str, float]

    @property
    def __wrapped__(self) -> Function:
        """The user's function, whose fingerprint the store keeps."""
        return self.wrapped

    def __call__(self, varied: Mapping[str, ArrayLike]) -> Mapping[str, ArrayLike]:
        """Return the outputs of a member, or of many."""
        return self.wrapped({**self.fixed, **varied})


def read_own(path: str | Path, reference: str) -> tuple[Spec, StudyPart]:
    """Read a study.toml and a function; return the study, and the function with its outputs.

    Raises
    ------
    InputError : no such function, a function that fails or returns no dict, or an unknown key.
    """
    path = Path(path)
    text, content = read_toml(path)
    refuse_unknown(content, _TOP, f"{path.name} (with {option('function')})")
    kind = _kind(content, path.name)
    units = _units(content, path.name)

    def about(name: str, where: str) -> Quantity:
        return Quantity(name, units.get(name, "1"), "")

    files: dict[str, str] = {}
    try:
        grid = read_grid(content, path, files, about=about)
        fixed = {
            name: number(value, units.get(name, "1"), f"{path.name} [rig] {name}")
            for name, value in table_of(content, "rig", path.name).items()
        }
    except WrongDimension as error:
        raise InputError(f"{error}, or state its unit in [units], as in x = 'm'") from None
    content = {**content, "function": reference}
    spec = spec_of(path, text, content, ("the function",), fixed, grid, files)
    own = Own(load_function(reference), fixed)
    known = tuple(
        replace(output, unit=units.get(output.name, "1"))
        for output in _outputs(own, grid, kind, reference, path.name)
    )
    refuse_outputs(spec, known)
    chunk = spec.chunk or (_CHUNK_ONE_BY_ONE if kind == "host" else _CHUNK)
    part = StudyPart(own, known, kind=kind, chunk=chunk, separate=False)
    return spec, replace(part, outputs=part.kept(spec))


def _kind(content: Table, where: str) -> Kind:
    found = content.get("kind", "member")
    for kind in KINDS:
        if found == kind:
            return kind
    raise InputError(f"{where}: kind is {found!r}; it is one of {', '.join(KINDS)}")


def _units(content: Table, where: str) -> dict[str, str]:
    """Return units by the names of parameters and outputs."""
    units: dict[str, str] = {}
    for name, unit in table_of(content, "units", where).items():
        if not isinstance(unit, str) or not is_unit(unit):
            raise InputError(f"{where} [units] {name}: {unit!r} is no unit, as in 'm/s'")
        units[name] = unit
    return units


def load_function(reference: str) -> Function:
    """Load the function NAME of FILE.py, given as FILE.py:NAME. Workers receive its code.

    Raises
    ------
    InputError : no such file or function, or the file fails.
    """
    file, colon, name = reference.rpartition(":")
    path = Path(file)
    if not colon or not name.isidentifier() or path.suffix != ".py":
        raise InputError(f"{option('function', reference)}: write it as FILE.py:NAME")
    if not path.is_file():
        raise InputError(f"{option('function', reference)}: {path}: no such file")
    module_name = f"study_{path.stem}"
    about = importlib.util.spec_from_file_location(module_name, path)
    assert about is not None
    module = importlib.util.module_from_spec(about)
    sys.modules[module_name] = module
    sys.path.insert(0, str(path.resolve().parent))  # lets the file import from its own folder
    try:
        # the file's loader would use cached bytecode, which hides a change within the same second
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    except Exception as error:
        raise InputError(f"{path}: {error_text(error)}") from None
    function: Function | None = getattr(module, name, None)
    if function is None or not callable(function):
        raise InputError(f"{option('function', reference)}: {path} has no function '{name}'")
    try:
        import cloudpickle
    except ImportError:  # without Dask there are no workers
        return function
    cloudpickle.register_pickle_by_value(module)
    return function


def _outputs(own: Own, grid: Grid, kind: Kind, reference: str, where: str) -> tuple[Output, ...]:
    """Find the outputs of the function, by tracing or by computing the first member."""
    try:
        if kind != "host":
            return infer_outputs(own, grid, kind, "float64")
        first = grid.members([slice(0, 1)] * len(grid.shape))
        found = own({name: float(x[0]) for name, x in first.items()})
        shapes = {name: np.shape(np.asarray(x, float)) for name, x in found.items()}
    except Exception as error:
        advice = "mend it"
        if kind != "host":
            advice = f"correct it or, if it is not written with JAX, write kind = 'host' in {where}"
        raise InputError(f"{reference} fails: {error_text(error)}; {advice}") from None
    return outputs_of_shapes(shapes)
