"""Make the function, grid and outputs of a study from its study.toml, and run it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from jaxtyping import Array

from ..errors import InputError
from ..findings import Warned
from ..study import Output, Progress, run
from ..study.function import Cost, Function, refuse_clashes
from .computations import COMPUTATIONS
from .spec import Spec, StudyPart, choose_outputs, read_spec
from .tables import table_of

if TYPE_CHECKING:
    import xarray

# Members of a block for a user's function, written with JAX or in plain Python.
_CHUNK, _CHUNK_ONE_BY_ONE = 65536, 16


@dataclass(frozen=True, eq=False)
class Made:
    """A study, ready to run."""

    spec: Spec
    function: Function
    outputs: tuple[Output, ...]
    kind: Literal["member", "batch", "host"]
    cost: Cost | None
    chunk: int
    batch: int
    separate: bool = True


@dataclass(frozen=True, eq=False)
class Together:
    """A function that runs several computations on the same arrays of members."""

    parts: tuple[Function, ...]

    def __call__(self, varied: Mapping[str, Array]) -> dict[str, Array]:
        """Return the outputs of all computations."""
        return {name: x for part in self.parts for name, x in part(dict(varied)).items()}


def make(path: str | Path, own: str | None = None) -> Made:
    """Read a study.toml and make its function, or use the user's `own`, FILE.py:NAME.

    Raises
    ------
    InputError : see `spec.read_spec`.
    """
    if own is not None:
        return _own(path, own)
    spec = read_spec(path, COMPUTATIONS)
    parts = [_part(spec, name) for name in spec.compute]
    kept = [output for part in parts for output in part.kept(spec)]
    known = tuple(output for part in parts for output in part.outputs)
    outputs = choose_outputs(spec, known, tuple(output.name for output in kept))
    used = [part for part in parts if part.kept(spec)]
    functions = tuple(part.function for part in used)
    told = tuple(line for part in used for line in part.warnings)
    told += _left_out(spec, used)
    return Made(
        replace(spec, warnings=(*spec.warnings, *told)),
        functions[0] if len(functions) == 1 else Together(functions),
        outputs,
        used[0].kind,
        next((part.cost for part in used if part.cost is not None), None),
        spec.chunk or min(part.chunk for part in used),
        min(part.batch for part in used),
        all(part.separate for part in used),
    )


def _left_out(spec: Spec, parts: list[StudyPart]) -> tuple[str, ...]:
    """Warn if a mass is given, but simulations ignore it without `inertia = false`.

    Raises
    ------
    InputError : no computation uses the mass.
    """
    given = "m" in table_of(spec.content, "rig", spec.path.name) or "m" in spec.grid.names
    meant = "inertia" in spec.options.get("simulate", {})
    if not given or meant or all(part.mass for part in parts):
        return ()
    simulated = "simulate" in spec.compute
    advice = "write inertia = true in [simulate] to include it"
    if not any(part.mass for part in parts):
        raise InputError(
            f"{spec.path.name}: m would not be used: {' and '.join(spec.compute)} has a slider"
            f" without mass; leave m out{', or ' + advice if simulated else ''}"
        )
    return (
        "the mass m is in the margins, and the simulated slider has none:"
        f" {advice}, or inertia = false if this is intended",
    )


def _part(spec: Spec, name: str) -> StudyPart:
    table = spec.options.get(name, {})
    return COMPUTATIONS[name].make(spec, table, f"{spec.path.name} [{name}]")


def _own(path: str | Path, reference: str) -> Made:
    from .own import read_own

    spec, function, outputs, kind = read_own(path, reference)
    chunk = spec.chunk or (_CHUNK_ONE_BY_ONE if kind == "host" else _CHUNK)
    return Made(spec, function, outputs, kind, None, chunk, StudyPart.batch, separate=False)


def run_study(
    path: str | Path,
    out: str | Path,
    *,
    function: str | None = None,
    scheduler: str | None = None,
    processes: int = 1,
    ask: Callable[[str], None] | None = None,
    other_versions: bool = False,
    progress: Callable[[Progress], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> "xarray.Dataset":
    """Run or continue the study of a study.toml; return its store as an xarray Dataset.

    Warnings of its laws are reported at the start, and stored in the attribute "warnings".

    Raises
    ------
    InputError : see `spec.read_spec` and `study.run`.
    """
    made = make(path, function)
    refuse_clashes(made.spec.grid, made.outputs)
    for line in made.spec.warnings:
        if tell is not None:
            tell(Warned(f"warning: {line}"))
    return run(
        made.function,
        made.spec.grid,
        out,
        outputs=made.outputs,
        kind=made.kind,
        cost=made.cost,
        chunk=made.chunk,
        batch=made.batch,
        dtype=made.spec.dtype,
        precision="float64",
        separate=made.separate,
        scheduler=scheduler,
        processes=processes,
        ask=ask,
        description=made.spec.description(),
        other_versions=other_versions,
        toml=made.spec.text,
        warnings=made.spec.warnings,
        progress=progress,
        tell=tell,
    )
