"""study.toml: what varies, what is computed, what is kept; read, checked, made a study.

compute = ["margins", "simulate"]
outputs = ["modulus", "end"]        # all of what is computed where not given
chunk = 65536
dtype = "float64"                   # of what is kept, or "float32"; computed in float64

[rig]                               # what does not vary
law = "slip"                        # or from = "fit.json" and normal_force = "500 N"
A = "4.5 N"
m = "2 kg"

[axes]
k_p = { logspace = ["100 kN/m", "1 MN/m"], points = 60 }
V0 = { values = ["1 um/s", "10 um/s"] }
B = { sobol = ["4 N", "10 N"], log = true }
law = { from = "fit.json", normal_force = "500 N" }      # draws from the posterior of a fit

[samples]                           # of the axes sobol, latin, random and from
number = 4096
seed = 0

[simulate]
ratio = 10                          # the command steps from V0/ratio to V0
samples = 100                       # of the outputs force and velocity
"""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..errors import InputError, did_you_mean
from ..laws.registry import count_states, known_law
from ..saved import law_from_fit
from ..study import Grid, Output
from ..study.function import Cost, Function
from .axes import parameters_of, posterior, read_grid
from .parameters import LAW, needed, number, parameter, read_value
from .tables import Table, file_of, names_of, refuse_unknown, table_of, whole

_TOP = ("compute", "outputs", "chunk", "dtype", "rig", "axes", "samples")
_RIG = ("law", "from", "normal_force", "A", "B", "L", "f0", "V_ref", "m", "k_p", "k_v", "V0")
# The command steps from V0/ratio to V0, unless a computation says otherwise.
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
    law: str | None
    """A rate-and-state law by its name; None where the law is taken whole from a file."""
    source: Path | None
    """The fit.json or loop.json of the law, and the normal force [N] that goes with it."""
    normal_force: float | None
    fixed: dict[str, float]
    states: int
    grid: Grid
    options: dict[str, dict[str, object]]
    """The tables of what is computed, by name."""
    files: dict[str, str]
    """Files that the study reads, and a checksum of each."""
    warnings: tuple[str, ...] = ()
    """Warnings about its laws to read before results are relied on, a line each."""

    def description(self) -> dict[str, object]:
        """Plain values that tell this study from another."""
        return {**self.content, **({"files": self.files} if self.files else {})}


@dataclass(frozen=True, eq=False)
class StudyPart:
    """The part of a study that one computation provides."""

    function: Function
    outputs: tuple[Output, ...]
    """All outputs that it can give."""
    usual: tuple[str, ...] | None = None
    """Names of the outputs that are kept where the study names none; None: all."""
    kind: Literal["batch", "host"] = "batch"
    """Kind of the function as in `study.Task`, and so are `cost`, `batch` and `separate`."""
    cost: Cost | None = None
    chunk: int = 65536
    """Members of a block: as many as compute in about a second and fit into memory."""
    batch: int = 512
    separate: bool = True
    warnings: tuple[str, ...] = ()
    mass: bool = True
    """Whether the mass m takes part."""

    def kept(self, spec: Spec) -> tuple[Output, ...]:
        """Outputs of this part that the study keeps."""
        usual = tuple(o.name for o in self.outputs) if self.usual is None else self.usual
        return tuple(o for o in self.outputs if o.name in (spec.outputs or usual))


@dataclass(frozen=True)
class Computation:
    """A computation that a study may ask for in `compute`: one entry of `COMPUTATIONS`."""

    make: Callable[[Spec, Table, str], StudyPart]
    """Makes a part from a study, the computation's own table in it, and that table's name."""
    needs: tuple[str, ...] = ("V0", "k_p")
    """Parameters that must be set or vary, besides those of the law."""
    alone: bool = False
    """Whether it must be the only computation of its study, as it works member by member."""


def read_spec(path: str | Path, known: Mapping[str, Computation]) -> Spec:
    """Read and check a study.toml. `known` are the computations that there are.

    Raises
    ------
    InputError : anything that is not understood: what, in which table, and the nearest that is.
    """
    path = Path(path)
    text, content = parsed(path)
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
    law, source, force, fixed = _rig(table_of(content, "rig", where), path, files)
    grid = read_grid(content, path, files)
    fixed["ratio"] = _RATIO
    law, fixed, warnings = posterior(content, path, law, fixed, grid)
    if source is not None:
        law, fixed, more = _law_of_file(source, force, fixed, f"{where} [rig]")
        warnings = (*warnings, *more)
    in_both = [
        name for name in grid.names if name in fixed and name in table_of(content, "rig", where)
    ]
    if in_both:
        raise InputError(f"{where}: {in_both[0]} is in [rig] and in [axes]; leave one out")
    fixed = {name: value for name, value in fixed.items() if name not in grid.names}
    states = count_states(law, (*fixed, *grid.names))
    spec = Spec(
        path,
        text,
        content,
        compute,
        names_of(content, "outputs", where),
        whole(content, "chunk", where),
        dtype_of(content, where),
        law,
        source,
        force,
        fixed,
        states,
        grid,
        options,
        files,
        tuple(dict.fromkeys(warnings)),
    )
    _refuse_missing(spec, where, {name for one in compute for name in known[one].needs})
    return spec


def choose_outputs(
    spec: Spec, known: tuple[Output, ...], usual: tuple[str, ...]
) -> tuple[Output, ...]:
    """The outputs that are kept, in the order of `known`.

    Raises
    ------
    InputError : one that nothing computes; the nearest is named.
    """
    names = [output.name for output in known]
    for name in spec.outputs or ():
        if name not in names:
            raise InputError(
                f"{spec.path.name}: no output '{name}' of {' and '.join(spec.compute)}"
                f"{did_you_mean(name, names)}"
            )
    wanted = spec.outputs or usual
    return tuple(output for output in known if output.name in wanted)


def parsed(path: Path) -> tuple[str, dict[str, object]]:
    """Text and tables of a study.toml."""
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no text; a study is described in TOML") from None
    try:
        return text, tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not TOML: {error}") from None


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
            f"{where}: compute: '{alone[0]}' is computed member by member and stands alone; make a"
            " study of its own for it"
        )
    return found


def dtype_of(content: Table, where: str) -> str:
    """The type of the numbers that are kept."""
    found = content.get("dtype", "float64")
    if found == "float64" or found == "float32":
        return str(found)
    raise InputError(f"{where}: dtype is {found!r}; it is 'float64' or 'float32'")


def _rig(
    rig: Table, path: Path, files: dict[str, str]
) -> tuple[str | None, Path | None, float | None, dict[str, float]]:
    where = f"{path.name} [rig]"
    fixed: dict[str, float] = {}
    law = rig.get("law")
    for key in rig:
        if key in ("law", "from", "normal_force"):
            continue
        known = tuple(name for name in _RIG if name not in ("law", "from", "normal_force"))
        if key not in known:
            try:
                parameter(key, where, known=known)
            except InputError:
                raise InputError(f"{where}: no key '{key}'{did_you_mean(key, _RIG)}") from None
        fixed[key] = read_value(rig[key], key, f"{where} {key}")
    if law is not None:
        try:
            law = known_law(law)
        except InputError as wrong:
            raise InputError(f"{where}: {wrong}") from None
    if ("from" in rig) and law is not None:
        raise InputError(f"{where}: law and from exclude each other; give one")
    force = None
    if "normal_force" in rig:
        force = number(rig["normal_force"], "N", f"{where} normal_force")
        if not force > 0:
            raise InputError(f"{where}: normal_force is {force:g} N; it must be positive")
    source = None
    if "from" in rig:
        source = file_of(rig["from"], path, f"{where} from", files)
    elif force is not None:
        raise InputError(
            f"{where}: normal_force goes with from (that of an axis, law = {{ from = ... }}, stands"
            " beside it in [axes]); give parameters in newtons"
        )
    return law, source, force, fixed


def _law_of_file(source: Path, force: float | None, fixed: dict[str, float], where: str):
    """The evolution and the parameters of a file, None and only a velocity for another law; and
    what it warns of."""
    read = law_from_fit(source, normal_force=force, samples=0)
    kind, own = parameters_of(read)
    given = [name for name in fixed if name in LAW or name[:-1] in ("B", "L")]
    if kind is None and given:
        raise InputError(f"{where}: {given[0]} cannot be set: the law of {source} is whole")
    return kind, {**own, **fixed}, read.warnings


def _refuse_missing(spec: Spec, where: str, needs: set[str]) -> None:
    """Every parameter of a rig, and those that the computations need, must be set or vary."""
    given = {*spec.fixed, *spec.grid.names}
    wanted = sorted(needs)
    if spec.law is not None:
        wanted += needed(spec.states)
    elif spec.source is None:
        raise InputError(f"{where} [rig]: law is missing; law = 'slip', or from = 'fit.json'")
    else:
        odd = [n for n in spec.grid.names if n in LAW or n[:-1] in ("B", "L")]
        if odd:
            raise InputError(
                f"{where} [axes] {odd[0]}: the law of {spec.source} is whole; vary m, k_p, k_v, V0"
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
