"""From a study.toml to the function, grid and outputs of a study, and running it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..rig.friction import AbstractInvertibleLaw, AbstractLaw
from ..study import Output, Progress, run
from ..study.function import refuse_clashes
from ..units import parse_quantity
from .sliders import ENDINGS, MARGINS, Sliders, traces
from .spec import Spec, choose_outputs, read_spec

# Members of a block: as many as compute in about a second, and their traces fit into memory.
_CHUNK, _CHUNK_WITH_TRACES, _CHUNK_SLOW, _CHUNK_ONE_BY_ONE = 65536, 16384, 256, 16
_CHUNKS = {"gains": 16, "fit": 4, "loop": 1}
# Members that share a loop: what fits into a cache; a stiff solver's are held by the slowest.
_BATCH, _BATCH_SLOW = 512, 16
_SAMPLES = 100
# Steady friction in units of A above which the regularised and the logarithmic direct effect are
# the same to rounding, and samples that are looked at for the least of it.
_FAR_FROM_REST, _SEEN = 20.0, 4096


@dataclass(frozen=True, eq=False)
class Made:
    """A study, ready to run."""

    spec: Spec
    function: Callable
    outputs: tuple[Output, ...]
    kind: Any
    cost: Callable | None
    chunk: int
    batch: int
    separate: bool = True


def make(path: str | Path, own: str | None = None) -> Made:
    """Read a study.toml and make its function, or take one's `own`, FILE.py:NAME.

    Raises
    ------
    InputError : see `spec.read_spec`.
    """
    if own is not None:
        return _own(path, own)
    spec = read_spec(path)
    if spec.compute[0] in ("gains", "fit", "loop"):
        from .one_by_one import one_by_one

        function, known = one_by_one(spec)
        outputs = choose_outputs(spec, known, tuple(o.name for o in known))
        chunk = spec.chunk or _CHUNKS[spec.compute[0]]
        return Made(spec, function, outputs, "host", None, chunk, 1)
    return _sliders(spec)


def _own(path: str | Path, reference: str) -> Made:
    from .own import read_own

    spec, function, outputs, kind = read_own(path, reference)
    chunk = spec.chunk or (_CHUNK_ONE_BY_ONE if kind == "host" else _CHUNK)
    return Made(spec, function, outputs, kind, None, chunk, _BATCH, separate=False)


def _sliders(spec: Spec) -> Made:
    known: tuple[Output, ...] = ()
    usual: list[str] = []
    table = spec.options.get("simulate", {})
    samples = table.get("samples", _SAMPLES)
    law = _law(spec)
    inertia = table.get("inertia", not isinstance(law, str | AbstractInvertibleLaw))
    _refuse_massless(spec, law, inertia)
    slow = inertia or not isinstance(law, str)
    if "margins" in spec.compute:
        known += MARGINS
        usual += [output.name for output in MARGINS]
    if "simulate" in spec.compute:
        known += ENDINGS + traces(samples)
        usual += [output.name for output in ENDINGS]
        usual += [output.name for output in traces(samples)] if "samples" in table else []
    outputs = choose_outputs(spec, known, tuple(usual))
    wanted = tuple(output.name for output in outputs)
    traced = bool({"force", "velocity"} & set(wanted))
    if traced and slow:
        raise InputError(
            f"{spec.path.name}: force and velocity in time are for massless sliders under the slip"
            " or ageing law; leave these outputs out"
        )
    simulated = {"end", "force", "velocity"} & set(wanted)
    if simulated and not slow:
        spec = replace(spec, warnings=(*spec.warnings, *_logarithmic(spec)))
    duration = table.get("duration")
    function = Sliders(
        law,
        spec.states,
        spec.fixed,
        wanted,
        samples,
        None if duration is None else parse_quantity(duration, "s", "duration"),
        float(table.get("rtol", 1e-6)),
        table.get("max_steps", 16384),
        inertia,
    )
    slow = slow and "end" in wanted
    chunk = _CHUNK_SLOW if slow else _CHUNK_WITH_TRACES if traced else _CHUNK
    return Made(
        spec,
        function,
        outputs,
        "batch",
        function.cost if simulated else None,
        spec.chunk or chunk,
        _BATCH_SLOW if slow else _BATCH,
        not slow,
    )


def _logarithmic(spec: Spec) -> list[str]:
    """A line where massless motions are not those of the regularised direct effect."""
    if "f0" not in (*spec.fixed, *spec.grid.names):
        return []  # 50 A
    least = _range_of(spec, "f0")[0] / _range_of(spec, "A")[1]
    if least > _FAR_FROM_REST:
        return []
    return [
        "motions without mass are simulated with the direct effect A ln(V/V_ref), with which they"
        " need no root, and margins with the regularised one: f0 is down to"
        f" {least:.3g} A here, where the two differ; for one law in both give m and inertia = true"
    ]


def _range_of(spec: Spec, name: str) -> tuple[float, float]:
    """Least and largest value of a parameter, among the first samples where it is drawn."""
    if name in spec.fixed:
        return spec.fixed[name], spec.fixed[name]
    values = [np.asarray(axis.values) for axis in spec.grid.axes if axis.name == name]
    samples = spec.grid.samples
    if samples is not None and not values:
        values = [samples.draw(0, min(samples.number, _SEEN))[name]]
    return float(np.min(values)), float(np.max(values))


def _refuse_massless(spec: Spec, law, inertia: bool) -> None:
    """Raise `InputError` where a motion is asked for that only mass makes unique."""
    if "simulate" not in spec.compute or inertia or isinstance(law, str | AbstractInvertibleLaw):
        return
    raise InputError(
        f"{spec.path.name} [simulate]: the law of {spec.source} has no velocity of its own at a"
        " given force; leave inertia = false out, so that its mass takes part"
    )


def _law(spec: Spec):
    if spec.law is not None:
        return spec.law
    from .saved_law import law_from_file

    assert spec.source is not None
    law = law_from_file(spec.source, normal_force=spec.normal_force, samples=0).law
    if not isinstance(law, AbstractLaw):
        raise InputError(f"{spec.source}: a delay law has no states; a study cannot take it")
    return law


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
) -> Any:
    """Run, or go on with, the study of a study.toml; its store as an xarray Dataset.

    What its laws warn of is told as it begins, and is in the attribute "warnings" of the store.

    Raises
    ------
    InputError : see `spec.read_spec` and `study.run`.
    """
    made = make(path, function)
    refuse_clashes(made.spec.grid, made.outputs)
    for line in made.spec.warnings:
        if tell is not None:
            tell(f"warning: {line}")
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
