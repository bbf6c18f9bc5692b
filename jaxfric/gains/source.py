"""Where a friction law for control comes from: a fit's file, or parameters given one by one."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..quantity import Quantity, quantities
from ..rig.friction import (
    AbstractDelayLaw,
    AbstractLaw,
    AgeingEvolution,
    Dahl,
    GaussianStribeck,
    GeneralStribeck,
    HessSoom,
    RateState,
    RegularisedEffect,
    SlipEvolution,
)
from ..units import parse_quantity

SCHEMA = "jaxfric.fit/1"
_EVOLUTIONS = {"slip": SlipEvolution, "ageing": AgeingEvolution}
_CURVES = {
    "stribeck": GeneralStribeck,
    "gaussian-stribeck": GaussianStribeck,
    "delay": HessSoom,
    "dahl": Dahl,
}
LAWS = (*_EVOLUTIONS, *_CURVES)


@dataclass(frozen=True, eq=False)
class LawSource:
    """A law, and samples of it that its uncertainty allows; forces in newtons."""

    law: AbstractLaw | AbstractDelayLaw
    """The estimate."""
    samples: AbstractLaw | AbstractDelayLaw
    """The estimate and then the samples: every array has a leading axis."""
    text: str
    """What it is, in a line."""
    velocity: float | None
    """A velocity of the record [m/s], for where none is given."""


def law_from_fit(
    path: str | Path, *, normal_force: float | None = None, samples: int = 64, seed: int = 0
) -> LawSource:
    """The law of a `fit.json` in newtons, and samples from the fit's covariance.

    Parameters with a lower bound (A, L) are sampled by their logarithms, the others as they are.
    The direct effect is the regularised one, so that the law can be carried through rest.

    Parameters
    ----------
    normal_force : [N], by which a friction coefficient is multiplied; must be given for a fit
        of a coefficient and not for one of a force.
    samples : number drawn besides the estimate.

    Raises
    ------
    InputError : file missing, damaged or of another schema; a normal force missing or
        not wanted; parameters that the fit left undetermined.
    """
    content = _read(Path(path))
    unit = content["friction_unit"]
    if unit == "1" and normal_force is None:
        raise InputError(
            f"{path}: this is a fit of a friction coefficient; give the normal force that turns it"
            " into newtons, as in --normal-force '500 N'"
        )
    if unit != "1" and normal_force is not None:
        raise InputError(f"{path}: this is a fit of a force, so --normal-force is not wanted")
    values = {name: float(item["value"]) for name, item in content["parameters"].items()}
    free = list(content["free"])
    draws = np.tile(np.asarray([values[name] for name in free]), (samples + 1, 1))
    if samples:
        draws[1:] = _draw(content, free, values, samples, seed, path)
    scale = 1.0 if normal_force is None else normal_force
    states, evolution = int(content["states"]), _EVOLUTIONS[content["law"]]()
    columns = {name: np.full(samples + 1, value) for name, value in values.items()}
    columns |= dict(zip(free, draws.T, strict=True))
    text = f"{content['law']} law, {states} state(s), fitted: {path}"
    law = _law(values, states, evolution, scale)
    return LawSource(law, _law(columns, states, evolution, scale), text, values["V0"])


def law_from_parameters(kind: str, text: str) -> LawSource:
    """A law by its name and its parameters, "A=1 N, B=3 N, L=1 mm, V0=2 mm/s".

    Rate-and-state laws: A, B, L (B2, L2, ... for more states), V0, and f0, which matters only for
    a start at rest (default 50 A). Other laws: their own fields. Forces in newtons.

    Raises
    ------
    InputError : no such law or parameter; one is missing, given twice or out of bounds.
    """
    if kind not in LAWS:
        raise InputError(f"law '{kind}' does not exist; there are: {', '.join(LAWS)}")
    pairs = _pairs(text)
    law = (_rate_state if kind in _EVOLUTIONS else _curve)(kind, pairs)
    V0 = getattr(law, "V0", None)
    return LawSource(law, stack([law]), f"{kind} law: {text}", None if V0 is None else float(V0))


def _read(path: Path) -> dict:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; make one with: jaxfric fit") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        place = f" (line {error.lineno})" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{path}: not a JSON file, or damaged{place}; make it again") from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != SCHEMA:
        found = f"its schema is '{schema}'" if schema else "it names no schema"
        raise InputError(f"{path}: {found}; a file of schema '{SCHEMA}' (jaxfric fit) is needed")
    problem = _damage(content)
    if problem:
        raise InputError(f"{path}: damaged: {problem}; make it again with: jaxfric fit")
    return content


def _damage(content: dict) -> str | None:
    """What is missing from or wrong in a file of the right schema."""
    for key in ("law", "states", "friction_unit", "parameters", "free", "covariance"):
        if key not in content:
            return f"'{key}' is missing"
    if content["law"] not in _EVOLUTIONS:
        return f"law '{content['law']}' is not known"
    parameters, states, free = content["parameters"], content["states"], content["free"]
    if isinstance(states, bool) or not isinstance(states, int) or states < 1:
        return f"the number of states is '{states}'"
    if not isinstance(parameters, dict):
        return "the parameters are no table"
    if not isinstance(free, list) or not all(isinstance(name, str) for name in free):
        return "the free parameters are no list of names"
    needed = ["f0", "A", "V0", *_numbered(states)]
    for name in needed:
        if name not in parameters:
            return f"parameter {name} is missing"
    for name, item in parameters.items():
        value = item.get("value") if isinstance(item, dict) else None
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            return f"parameter {name} has no value"
    try:
        matrix = np.asarray(content["covariance"], float)
    except (TypeError, ValueError):
        return "the covariance is not a matrix of numbers"
    size = len(free)
    if matrix.shape != (size, size) and size:
        return f"the covariance has shape {matrix.shape} for {size} free parameters"
    if not set(free) <= set(parameters):
        return "a free parameter is not among the parameters"
    return None


def _numbered(states: int) -> list[str]:
    """B, L, B2, L2, ..."""
    return [f"{letter}{'' if i == 0 else i + 1}" for i in range(int(states)) for letter in "BL"]


def _quantity(name: str) -> Quantity:
    return quantities(RateState)[name if name in ("f0", "V0", "slip_trend") else name[0]]


def _draw(content, free, values, samples, seed, path) -> np.ndarray:
    """Samples of the free parameters, one row each (SI, unit of the fit)."""
    parameters = content["parameters"]
    loose = [name for name in free if not parameters[name].get("determined", True)]
    covariance = np.asarray(content["covariance"], float)
    if loose or not np.all(np.isfinite(covariance)):
        names = ", ".join(loose) or "a parameter"
        raise InputError(
            f"{path}: the fit leaves {names} undetermined, so nothing can be sampled;"
            " use --samples 0 for the estimate alone, or a record that fixes it"
        )
    mean = np.asarray([values[name] for name in free])
    positive = np.asarray([name != "K" and _quantity(name).lower == 0.0 for name in free])
    jacobian = np.where(positive, 1 / np.where(positive, mean, 1.0), 1.0)
    spread = covariance * np.outer(jacobian, jacobian)
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    lowered, vectors = np.linalg.eigh(spread / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(lowered, 0.0))
    z = np.random.default_rng(seed).standard_normal((samples, len(free))) @ root.T
    return np.where(positive, mean * np.exp(np.where(positive, z, 0.0)), mean + z)


def _law(
    p: Mapping[str, float] | Mapping[str, np.ndarray], states: int, evolution, scale: float = 1.0
) -> RateState:
    """The law with forces `scale` times those given; a batch where the values are arrays."""
    names = _numbered(states)
    p = {name: np.asarray(value, float) for name, value in p.items()}
    return RateState(
        jnp.asarray(p["f0"] * scale),
        jnp.asarray(p["A"] * scale),
        jnp.asarray(np.stack([p[name] * scale for name in names[0::2]], axis=-1)),
        jnp.asarray(np.stack([p[name] for name in names[1::2]], axis=-1)),
        jnp.asarray(p["V0"]),
        evolution,
        RegularisedEffect(),
        jnp.asarray(p.get("slip_trend", np.zeros_like(p["V0"])) * scale),
    )


def stack(laws):
    """A batch of laws of one kind."""
    parts = [eqx.partition(law, eqx.is_array) for law in laws]
    arrays = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(arrays for arrays, _ in parts))
    return eqx.combine(arrays, parts[0][1])


def _pairs(text: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or not name:
            raise InputError(f"parameters: '{part}' is not NAME=VALUE, as in 'A=1 N, L=1 mm'")
        if name in found:
            raise InputError(f"parameters: {name} is given twice")
        found[name] = value
    return found


def _value(pairs: dict[str, str], name: str, about: Quantity) -> float:
    unit = about.unit_for("N").removeprefix("1 ")
    value = parse_quantity(pairs.pop(name), unit.replace(" ", "*"), f"parameter {name}")
    return about.check(value, "parameters")


def _rate_state(kind: str, pairs: dict[str, str]) -> RateState:
    states = 1 + sum(name[0] == "B" and name[1:].isdigit() for name in pairs)
    names = _numbered(states)
    for name in ("A", *names, "V0"):
        if name not in pairs:
            raise InputError(f"parameters: {name} is missing; the {kind} law needs A, B, L, V0")
    values = {name: _value(pairs, name, _quantity(name)) for name in ("A", *names, "V0")}
    values["f0"] = _value(pairs, "f0", _quantity("f0")) if "f0" in pairs else 50 * values["A"]
    _refuse_rest(pairs, kind, "A, B, L, V0, f0")
    return _law(values, states, _EVOLUTIONS[kind]())


def _curve(kind: str, pairs: dict[str, str]):
    known = quantities(_CURVES[kind])
    fields = {about.symbol: name for name, about in known.items()}
    pairs = {fields.get(name, name): value for name, value in pairs.items()}
    optional = {"width", "gamma", "viscous"}
    for name in known:
        if name not in pairs and name not in optional:
            needed = ", ".join(n for n in known if n not in optional)
            raise InputError(f"parameters: {name} is missing; the {kind} law needs {needed}")
    values = {name: _value(pairs, name, known[name]) for name in known if name in pairs}
    _refuse_rest(pairs, kind, ", ".join(known))
    return _CURVES[kind](**values)


def _refuse_rest(pairs: dict[str, str], kind: str, known: str) -> None:
    if pairs:
        raise InputError(
            f"parameters: '{next(iter(pairs))}' is no parameter of the {kind} law; it has: {known}"
        )
