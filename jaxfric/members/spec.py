"""Read and check a study.toml: varied parameters, computations and stored outputs.

compute = ["margins", "simulate"]
outputs = ["modulus", "end"]        # default: all outputs of the computations
chunk = 65536
dtype = "float64"                   # of stored numbers, or "float32"; computed in float64

[rig]                               # fixed parameters
law = "slip"                        # or from = "fit.json" and normal_force = "500 N"
A = "4.5 N"
m = "2 kg"

[axes]
k_p = { logspace = ["100 kN/m", "1 MN/m"], points = 60 }
V0 = { values = ["1 um/s", "10 um/s"] }
B = { sobol = ["4 N", "10 N"], log = true }
law = { from = "fit.json", normal_force = "500 N" }      # draws; or from = "posterior.nc"

[samples]                           # of the axes sobol, latin, random and from
number = 4096
seed = 0

[simulate]
ratio = 10                          # the command steps from V0/ratio to V0
samples = 100                       # of the outputs force and velocity
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..errors import InputError, did_you_mean
from ..laws.registry import count_states, known_law
from ..rig.friction import AbstractLaw
from ..saved import law_from_fit
from ..study import Grid, Output
from ..study.function import DTYPES, Cost, Function, Kind
from ..tables import (
    Table,
    file_of,
    names_of,
    placed,
    positive,
    read_toml,
    refuse_unknown,
    table_of,
    whole,
)
from .axes import parameters_of, posterior, read_grid
from .parameters import LAW, needed, parameter, value_of

_TOP = ("compute", "outputs", "chunk", "dtype", "rig", "axes", "samples")
_RIG = ("law", "from", "normal_force", "A", "B", "L", "f0", "V_ref", "m", "k_p", "k_v", "V0")
# By default the command steps from V0/ratio to V0 with this ratio.
_RATIO = 10.0


@dataclass(frozen=True, eq=False)
class Spec:
    """A study.toml, read and checked."""

    path: Path
    text: str
    content: dict[str, object]
    compute: tuple[str, ...]
    outputs: tuple[str, ...] | None
    chunk: int | None
    dtype: str
    fixed: dict[str, float]
    grid: Grid
    files: dict[str, str]
    """Files that the study reads, with their checksums."""
    law: str | AbstractLaw | None = None
    """Name of a rate-and-state law, or another law of a file; None for a function of the user."""
    states: int = 1
    options: Mapping[str, Table] = field(default_factory=dict)
    """The tables of the computations, by name."""
    warnings: tuple[str, ...] = ()
    """Warnings about the study's laws, one line each."""

    def description(self) -> dict[str, object]:
        """Return plain values that identify this study."""
        return {**self.content, **({"files": self.files} if self.files else {})}


@dataclass(frozen=True, eq=False)
class StudyPart:
    """The part of a study that one entry of `compute` provides."""

    function: Function
    outputs: tuple[Output, ...]
    """All possible outputs."""
    usual: tuple[str, ...] | None = None
    """Names of the outputs that are stored by default; None: all."""
    kind: Kind = "batch"
    """Kind of the function as in `study.Task`, like `cost`, `batch` and `separate`."""
    cost: Cost | None = None
    chunk: int = 65536
    """Number of members of a block, which computes in about a second and fits into memory."""
    batch: int = 512
    separate: bool = True
    warnings: tuple[str, ...] = ()
    mass: bool = True
    """Whether it uses the mass m."""

    def kept(self, spec: Spec) -> tuple[Output, ...]:
        """Return the outputs of this part that the study stores."""
        usual = tuple(o.name for o in self.outputs) if self.usual is None else self.usual
        return tuple(o for o in self.outputs if o.name in (spec.outputs or usual))


@dataclass(frozen=True)
class Computation:
    """A possible entry of `compute` in a study.toml: one entry of `COMPUTATIONS`."""

    make: Callable[[Spec, Table, str], StudyPart]
    """Makes a part from a study, the computation's table, and that table's name."""
    needs: tuple[str, ...] = ("V0", "k_p")
    """Required parameters, set or varied, in addition to those of the law."""
    alone: bool = False
    """Whether it must be the only computation of its study, because it works member by member."""


def read_spec(path: str | Path, known: Mapping[str, Computation]) -> Spec:
    """Read and check a study.toml. `known` are all computations.

    Raises
    ------
    InputError : an unknown or invalid entry; the message names the entry, its table, and the
        nearest valid entry.
    """
    path = Path(path)
    text, content = read_toml(path)
    where = path.name
    refuse_unknown(content, (*_TOP, *known), where)
    compute = _compute(content, where, known)
    options = {name: table_of(content, name, where) for name in known if name in content}
    for name in options:
        if name not in compute:
            raise InputError(
                f"{where}: [{name}] would not be used: compute has no '{name}'; add it or leave"
                " the table out"
            )
    files: dict[str, str] = {}
    law, fixed, warnings = _rig(table_of(content, "rig", where), path, files)
    grid = read_grid(content, path, files)
    name, own, more = posterior(content, path, grid)
    law, warnings = law or name, (*warnings, *more)
    fixed = {**own, "ratio": _RATIO, **fixed}
    name = law if isinstance(law, str) else None
    spec = replace(
        spec_of(path, text, content, compute, fixed, grid, files),
        law=law,
        states=count_states(name, (*fixed, *grid.names)),
        options=options,
        warnings=tuple(dict.fromkeys(warnings)),
    )
    _refuse_missing(spec, where, {name for one in compute for name in known[one].needs})
    return spec


def spec_of(
    path: Path,
    text: str,
    content: dict[str, object],
    compute: tuple[str, ...],
    fixed: dict[str, float],
    grid: Grid,
    files: dict[str, str],
) -> Spec:
    """Return a study without law; `fixed` also has parameters that the grid varies.

    Raises
    ------
    InputError : a parameter is in [rig] and in [axes], or `outputs`, `chunk` or `dtype` is invalid.
    """
    where = path.name
    both = [name for name in grid.names if name in table_of(content, "rig", where)]
    if both:
        raise InputError(f"{where}: {both[0]} is in [rig] and in [axes]; leave one out")
    dtype = content.get("dtype", "float64")
    if dtype not in DTYPES:
        raise InputError(f"{where}: dtype is {dtype!r}; it is 'float64' or 'float32'")
    fixed = {name: value for name, value in fixed.items() if name not in grid.names}
    outputs, chunk = names_of(content, "outputs", where), whole(content, "chunk", where)
    return Spec(path, text, content, compute, outputs, chunk, str(dtype), fixed, grid, files)


def refuse_outputs(spec: Spec, known: tuple[Output, ...]) -> None:
    """Raise `InputError` for an output that no computation has; name the nearest output."""
    names = [output.name for output in known]
    for name in spec.outputs or ():
        if name not in names:
            raise InputError(
                f"{spec.path.name}: no output '{name}' of {' and '.join(spec.compute)}"
                f"{did_you_mean(name, names)}"
            )


def _compute(content: Table, where: str, known: Mapping[str, Computation]) -> tuple[str, ...]:
    found = names_of(content, "compute", where)
    if not found:
        raise InputError(f"{where}: compute is missing; say what, as in compute = ['margins']")
    for name in found:
        if name not in known:
            raise InputError(f"{where}: compute: no '{name}'{did_you_mean(name, known)}")
    alone = [name for name in found if known[name].alone]
    if alone and len(found) > 1:
        raise InputError(
            f"{where}: compute: '{alone[0]}' is computed member by member and must be alone; make a"
            " separate study for it"
        )
    return found


def _rig(
    rig: Table, path: Path, files: dict[str, str]
) -> tuple[str | AbstractLaw | None, dict[str, float], tuple[str, ...]]:
    """Return the law of [rig], the fixed parameters, and the warnings of the law."""
    where = f"{path.name} [rig]"
    fixed = {
        key: value_of(value, parameter(key, where, known=_RIG), f"{where} {key}")
        for key, value in rig.items()
        if key not in ("law", "from", "normal_force")
    }
    if "from" not in rig:
        if "normal_force" in rig:
            raise InputError(
                f"{where}: normal_force goes with from (that of an axis, law = {{ from = ... }},"
                " stands beside it in [axes]); give parameters in newtons"
            )
        with placed(where):
            return known_law(rig["law"]) if "law" in rig else None, fixed, ()
    if "law" in rig:
        raise InputError(f"{where}: law and from exclude each other; give one")
    source = file_of(rig["from"], path, f"{where} from", files)
    force = positive(rig, "normal_force", "N", where)
    read = law_from_fit(source, normal_force=force, samples=0)
    if not isinstance(read.law, AbstractLaw):
        raise InputError(f"{source}: a delay law has no states; a study cannot take it")
    kind, own = parameters_of(read)
    given = [name for name in fixed if name in LAW or name[:-1] in ("B", "L")]
    if kind is None and given:
        raise InputError(f"{where}: {given[0]} cannot be set: it is fixed by the law of {source}")
    return kind or read.law, {**own, **fixed}, read.warnings


def _refuse_missing(spec: Spec, where: str, needs: set[str]) -> None:
    """Raise if a parameter of the rig or of a computation is neither set nor varied."""
    given = {*spec.fixed, *spec.grid.names}
    wanted = sorted(needs)
    if isinstance(spec.law, str):
        wanted += needed(spec.states)
    elif spec.law is None:
        raise InputError(f"{where} [rig]: law is missing; law = 'slip', or from = 'fit.json'")
    else:
        odd = [n for n in spec.grid.names if n in LAW or n[:-1] in ("B", "L")]
        if odd:
            raise InputError(
                f"{where} [axes] {odd[0]}: it is fixed by the law of the file in [rig]; vary"
                " m, k_p, k_v, V0"
            )
    for name in wanted:
        if name not in given:
            unit = parameter(name, where).unit
            raise InputError(
                f"{where}: {name} is missing; set it in [rig], {name} = '1 {unit}', or vary it"
                " in [axes]"
            )
    if "k_v" not in given:
        spec.fixed["k_v"] = 0.0
