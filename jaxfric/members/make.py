"""Make the function, grid and outputs of a study from its study.toml, and run the study."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..findings import WarningCode, warned
from ..study import Progress, run
from ..study.function import refuse_clashes
from ..tables import table_of
from .computations import COMPUTATIONS
from .own import read_own
from .spec import Spec, StudyPart, read_spec, refuse_outputs
from .together import Together

if TYPE_CHECKING:
    import xarray


def make(path: str | Path, own: str | None = None) -> tuple[Spec, StudyPart]:
    """Read a study.toml and make its function, or use the user's `own`, FILE.py:NAME.

    Raises
    ------
    InputError : see `spec.read_spec`.
    """
    if own is not None:
        return read_own(path, own)
    spec = read_spec(path, COMPUTATIONS)
    makers = {name: COMPUTATIONS[name].make for name in spec.compute}
    parts = {
        name: maker(spec, spec.options.get(name, {}), f"{spec.path.name} [{name}]")
        for name, maker in makers.items()
    }
    refuse_outputs(spec, tuple(output for part in parts.values() for output in part.outputs))
    kept = {name: part for name, part in parts.items() if part.kept(spec)}
    used = list(kept.values())
    outputs = tuple(output for part in used for output in part.kept(spec))
    functions = {name: (makers[name], part.function) for name, part in kept.items()}
    told = (*(line for part in used for line in part.warnings), *_left_out(spec, used))
    part = StudyPart(
        Together.of(functions, spec, outputs),
        outputs,
        kind=used[0].kind,
        cost=next((part.cost for part in used if part.cost is not None), None),
        chunk=spec.chunk or min(part.chunk for part in used),
        batch=min(part.batch for part in used),
        separate=all(part.separate for part in used),
    )
    return replace(spec, warnings=(*spec.warnings, *told)), part


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
    return (warned(WarningCode.MASS, advice=advice),)


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

    Warnings on the friction laws are reported at the start, and stored in the attribute "warnings".

    Raises
    ------
    InputError : see `spec.read_spec` and `study.run`.
    """
    spec, part = make(path, function)
    refuse_clashes(spec.grid, part.outputs)
    for line in spec.warnings:
        if tell is not None:
            tell(line)
    return run(
        part.function,
        spec.grid,
        out,
        outputs=part.outputs,
        kind=part.kind,
        cost=part.cost,
        chunk=part.chunk,
        batch=part.batch,
        dtype=spec.dtype,
        precision="float64",
        separate=part.separate,
        scheduler=scheduler,
        processes=processes,
        ask=ask,
        description=spec.description(),
        other_versions=other_versions,
        toml=spec.text,
        warnings=spec.warnings,
        progress=progress,
        tell=tell,
    )
