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
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..study import Grid, Output
from .axes import posterior, read_grid
from .parameters import LAW, nearest, needed, number, parameter, read_value, states_of
from .tables import file_of, names_of, refuse_unknown, table_of, whole

COMPUTE = ("margins", "simulate", "gains", "fit", "loop")
_ONE_BY_ONE = ("gains", "fit", "loop")
_TOP = ("compute", "outputs", "chunk", "dtype", "rig", "axes", "samples")
_RIG = ("law", "from", "normal_force", "A", "B", "L", "f0", "V_ref", "m", "k_p", "k_v", "V0")
_SIMULATE = ("ratio", "samples", "duration", "rtol", "max_steps", "inertia")


@dataclass(frozen=True, eq=False)
class Spec:
    """A study.toml, read and checked."""

    path: Path
    text: str
    content: dict[str, Any]
    compute: tuple[str, ...]
    outputs: tuple[str, ...] | None
    chunk: int | None
    dtype: str
    law: str | None
    """"slip" or "ageing"; None where the law is taken whole from a file."""
    source: Path | None
    """The fit.json or loop.json of the law, and the normal force [N] that goes with it."""
    normal_force: float | None
    fixed: dict[str, float]
    states: int
    grid: Grid
    options: dict[str, dict[str, Any]]
    """The tables of what is computed, by name."""
    files: dict[str, str]
    """Files that the study reads, and a checksum of each."""
    warnings: tuple[str, ...] = ()
    """What must be known of its laws before results are relied on, a line each."""

    def description(self) -> dict[str, Any]:
        """What tells this study from another."""
        return {**self.content, **({"files": self.files} if self.files else {})}


def read_spec(path: str | Path) -> Spec:
    """Read and check a study.toml.

    Raises
    ------
    InputError : anything that is not understood: what, in which table, and the nearest that is.
    """
    path = Path(path)
    text, content = parsed(path)
    where = path.name
    refuse_unknown(content, (*_TOP, *COMPUTE), where)
    compute = _compute(content, where)
    options = {name: table_of(content, name, where) for name in COMPUTE if name in content}
    for name in options:
        if name not in compute:
            raise InputError(
                f"{where}: [{name}] would not be used: compute has no '{name}'; add it or leave"
                " the table out"
            )
    files: dict[str, str] = {}
    law, source, force, fixed = _rig(table_of(content, "rig", where), path, files)
    grid = read_grid(content, path, files)
    _check_simulate(options, f"{where} [simulate]", fixed, grid)
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
    states = states_of((*fixed, *grid.names))
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
    _refuse_missing(spec, where)
    return spec


def choose_outputs(spec: Spec, known: tuple[Output, ...], usual: tuple[str, ...]) -> tuple:
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
                f"{nearest(name, names)}"
            )
    wanted = spec.outputs or usual
    return tuple(output for output in known if output.name in wanted)


def parsed(path: Path) -> tuple[str, dict[str, Any]]:
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


def _compute(content: Mapping[str, Any], where: str) -> tuple[str, ...]:
    found = names_of(content, "compute", where)
    if not found:
        raise InputError(f"{where}: compute is missing; say what, as in compute = ['margins']")
    for name in found:
        if name not in COMPUTE:
            raise InputError(f"{where}: compute: no '{name}'{nearest(name, COMPUTE)}")
    alone = [name for name in found if name in _ONE_BY_ONE]
    if alone and len(found) > 1:
        raise InputError(
            f"{where}: compute: '{alone[0]}' is computed member by member and stands alone; make a"
            " study of its own for it"
        )
    return found


def dtype_of(content: Mapping[str, Any], where: str) -> str:
    """The type of the numbers that are kept."""
    found = content.get("dtype", "float64")
    if found not in ("float64", "float32"):
        raise InputError(f"{where}: dtype is {found!r}; it is 'float64' or 'float32'")
    return found


def _rig(rig: dict[str, Any], path: Path, files: dict[str, str]):
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
                raise InputError(f"{where}: no key '{key}'{nearest(key, _RIG)}") from None
        fixed[key] = read_value(rig[key], key, f"{where} {key}")
    if law is not None and law not in ("slip", "ageing"):
        raise InputError(f"{where}: no law {law!r} in studies; there are: slip, ageing")
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
        raise InputError(f"{where}: normal_force goes with from; give parameters in newtons")
    return law, source, force, fixed


def _law_of_file(source: Path, force: float | None, fixed: dict[str, float], where: str):
    """The evolution and the parameters of a file, None and only a velocity for another law; and
    what it warns of."""
    from ..rig.friction import AgeingEvolution, RateState
    from .saved_law import law_from_file

    read = law_from_file(source, normal_force=force, samples=0)
    found = read.law
    if not isinstance(found, RateState) or float(found.slip_trend) != 0:
        given = [name for name in fixed if name in LAW or name[:-1] in ("B", "L")]
        if given:
            raise InputError(f"{where}: {given[0]} cannot be set: the law of {source} is whole")
        own_mass = {} if read.mass is None else {"m": read.mass}
        return None, {**own_mass, **fixed}, read.warnings
    states = found.B.shape[0]
    own = {"f0": float(found.f0), "A": float(found.A), "V_ref": float(found.V0)}
    for i in range(states):
        own |= {f"{letter}{i + 1 if i else ''}": 0.0 for letter in "BL"}
        own["B" if i == 0 else f"B{i + 1}"] = float(found.B[i])
        own["L" if i == 0 else f"L{i + 1}"] = float(found.L[i])
    kind = "ageing" if isinstance(found.evolution, AgeingEvolution) else "slip"
    return kind, {**own, **fixed}, read.warnings


def _check_simulate(options, where: str, fixed: dict[str, float], grid: Grid) -> None:
    """[simulate]: its keys; the ratio of the step is a parameter like others."""
    table = options.get("simulate", {})
    refuse_unknown(table, _SIMULATE, where)
    if "ratio" in table:
        fixed["ratio"] = read_value(table["ratio"], "ratio", f"{where} ratio")
    elif "ratio" not in grid.names:
        fixed["ratio"] = 10.0
    axis = next((axis.values for axis in grid.axes if axis.name == "ratio"), ())
    if 1.0 in (fixed.get("ratio"), *axis):
        raise InputError(
            f"{where}: ratio is 1: without a step even an unstable slider stays where it is; give"
            " another, as 1.01"
        )
    if "inertia" in table and not isinstance(table["inertia"], bool):
        raise InputError(f"{where}: inertia is {table['inertia']!r}; it is true or false")
    if "duration" in table:
        table["duration_s"] = number(table["duration"], "s", f"{where} duration")
        if not table.pop("duration_s") > 0:
            raise InputError(f"{where}: duration must be positive")
    for key, least in (("samples", 1), ("max_steps", 16)):
        whole(table, key, where, least)
    rtol = table.get("rtol", 1e-6)
    if isinstance(rtol, bool) or not isinstance(rtol, float | int) or not 1e-10 <= rtol <= 1e-2:
        raise InputError(f"{where}: rtol is {rtol!r}; it is a number from 1e-10 to 1e-2")


def _refuse_missing(spec: Spec, where: str) -> None:
    """Every parameter of a rig must be set or vary."""
    given = {*spec.fixed, *spec.grid.names}
    wanted = ["V0"]
    if "gains" not in spec.compute:
        wanted += ["k_p"]
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
    inertia = spec.options.get("simulate", {}).get("inertia", False)
    if inertia and "m" not in given:
        raise InputError(f"{where} [simulate]: inertia needs a mass, m = '2 kg' in [rig]")
