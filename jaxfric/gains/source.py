"""Where a friction law for control comes from: a fit's file, or parameters given one by one."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

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
from ..stability.claims import rate_state_claim
from ..units import between, parse_quantity
from .saved import (
    FIT,
    missing_key,
    own_warnings,
    read_saved,
    refuse_damage,
    sampled,
    table_damage,
    values_of,
)

EVOLUTIONS = {"slip": SlipEvolution, "ageing": AgeingEvolution}
_CURVES = {
    "stribeck": GeneralStribeck,
    "gaussian-stribeck": GaussianStribeck,
    "delay": HessSoom,
    "dahl": Dahl,
}
LAWS = (*EVOLUTIONS, *_CURVES)
_BEYOND = 2.0
_F0 = 50.0
"""Steady friction in units of A where f0 is not given: of rock and metal it is 30 to 100."""


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
    warnings: tuple[str, ...] = ()
    """What must be known before it is relied on, a line each."""
    seen: tuple[float, float] | None = None
    """Slowest and fastest velocity of the record [m/s]; None where there is none."""
    mass: float | None = None
    """Moving mass of the axis that the law is of [kg], for where none is given; None: of none."""

    def unseen(self, velocities: Sequence[float] | np.ndarray) -> tuple[str, ...]:
        """A line where some of the `velocities` [m/s] lie more than twice beyond the record's."""
        V = np.abs(np.asarray(velocities, float))
        V = V[V > 0]
        if self.seen is None or V.size == 0:
            return ()
        low, high = self.seen
        if V.min() >= low / _BEYOND and V.max() <= _BEYOND * high:
            return ()
        worst = max(V.max() / high, low / V.min())
        return (
            f"the law is fitted to velocities of {between(low, high, 'm/s')} and asked at"
            f" {between(V.min(), V.max(), 'm/s')}, up to {worst:.3g} times beyond: no row of the"
            " record tested it there",
        )


def law_from_fit(
    path: str | Path, *, normal_force: float | None = None, samples: int = 64, seed: int = 0
) -> LawSource:
    """The law of a `fit.json` in newtons, and samples from the fit's covariance.

    Parameters with a lower bound (A, L) are sampled by their logarithms, the others as they are.
    The direct effect is the regularised one, so that the law can be carried through rest. What the
    fit itself warned of is in `warnings`.

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
    if not isinstance(path, str | Path):
        raise InputError(
            f"law_from_fit takes the path of a fit.json, not a {type(path).__name__}; of a Fit at"
            " hand, write it first: Path('fit.json').write_text(json.dumps(fit.to_json()))"
        )
    path = Path(path)
    content = read_saved(path, FIT)
    refuse_damage(path, FIT, fit_damage(content))
    scale = force_of_unit(content["friction_unit"], normal_force, path)
    states, evolution = int(content["states"]), EVOLUTIONS[content["law"]]()
    values = values_of(content)
    names = [n for n in ("f0", "A", *numbered(states), "V0", "slip_trend") if n in values]
    positive = {name: law_quantity(name).lower == 0.0 for name in names}
    columns = sampled(content, positive, samples, seed, path)
    law = rate_state(values, states, evolution, scale)
    text = f"{content['law']} law, {states} state(s), fitted: {path}"
    samples_of = rate_state(columns, states, evolution, scale)
    steps = content.get("steps")
    seen = seen_velocities(steps.get("velocities") if isinstance(steps, dict) else None)
    return LawSource(law, samples_of, text, values["V0"], fit_warnings(content), seen)


def fit_warnings(content: Mapping) -> tuple[str, ...]:
    """What the content of a fit.json warned of itself, and a line where it says nothing of
    stability."""
    return (*own_warnings(content), *_doubts(content, int(content["states"])))


def seen_velocities(velocities: object) -> tuple[float, float] | None:
    """Slowest and fastest [m/s] of the velocities in a file, rest left out; None without any."""
    if not isinstance(velocities, list):
        return None
    sizes = [abs(v) for v in velocities if isinstance(v, int | float) and v != 0]
    return (min(sizes), max(sizes)) if sizes else None


def _doubts(content: Mapping, states: int) -> tuple[str, ...]:
    """A line where the fit itself says nothing of stability."""
    table, free = content["parameters"], content["free"]
    amplitudes = [f"B{'' if i == 0 else i + 1}" for i in range(states)]
    weight = np.array([(name == "A") - (name in amplitudes) for name in free], float)
    variance = float(weight @ np.asarray(content["covariance"], float) @ weight) if free else 0.0
    claim = rate_state_claim(
        table["A"]["value"],
        [table[name]["value"] for name in amplitudes],
        math.sqrt(variance) if variance >= 0 else math.nan,
        determined=all(table[n].get("determined", True) for n in ("A", *numbered(states))),
    )
    if claim.kind != "open":
        return ()
    return (
        f"this fit says nothing of stability ({'; '.join(claim.reasons)}): what follows is of its"
        " values and samples, not of the record",
    )


def law_from_parameters(kind: str, text: str) -> LawSource:
    """A law by its name and its parameters, "A=1 N, B=3 N, L=1 mm, V0=2 mm/s".

    Rate-and-state laws: A, B, L (B2, L2, ... for more states), V0, and f0, which matters only for
    a start at rest (default 50 A, told in `text`). Other laws: their own fields. Forces in
    newtons.

    Raises
    ------
    InputError : no such law or parameter; one is missing, given twice or out of bounds.
    """
    if kind not in LAWS:
        raise InputError(f"law '{kind}' does not exist; there are: {', '.join(LAWS)}")
    pairs = _pairs(text)
    unsaid = kind in EVOLUTIONS and "f0" not in pairs
    law = (_from_pairs if kind in EVOLUTIONS else _curve)(kind, pairs)
    V0 = getattr(law, "V0", None)
    name = f"{kind} law: {text}"
    if unsaid:
        name += (
            f"; f0, the steady friction at V0, is not given: {float(law.f0):.4g} N ({_F0:g} A) are"
            " assumed, which matter to rest and stick-slip and hardly to linear stability"
        )
    return LawSource(law, stack([law]), name, None if V0 is None else float(V0))


def force_of_unit(unit: str, normal_force: float | None, path: Path) -> float:
    """What forces of a file in `unit` ("1" or "N") are multiplied by to have newtons.

    Raises
    ------
    InputError : a normal force [N] is missing or not wanted.
    """
    if unit == "1" and normal_force is None:
        raise InputError(
            f"{path}: this is a fit of a friction coefficient; give the normal force that turns it"
            " into newtons, as in --normal-force '500 N'"
        )
    if unit != "1" and normal_force is not None:
        raise InputError(f"{path}: this is a fit of a force, so --normal-force is not wanted")
    return 1.0 if normal_force is None else normal_force


def fit_damage(content: dict) -> str | None:
    """What is missing from or wrong in a fit.json."""
    keys = ("law", "states", "friction_unit", "parameters", "free", "covariance")
    problem = missing_key(content, keys)
    if problem:
        return problem
    if content["law"] not in EVOLUTIONS:
        return f"law '{content['law']}' is not known"
    states = content["states"]
    if isinstance(states, bool) or not isinstance(states, int) or states < 1:
        return f"the number of states is '{states}'"
    return table_damage(content, ["f0", "A", "V0", *numbered(states)])


def numbered(states: int) -> list[str]:
    """B, L, B2, L2, ..."""
    return [f"{letter}{'' if i == 0 else i + 1}" for i in range(int(states)) for letter in "BL"]


def law_quantity(name: str) -> Quantity:
    """The quantity behind a name of `numbered`, or f0, A, V0, slip_trend."""
    return quantities(RateState)[name if name in ("f0", "V0", "slip_trend") else name[0]]


def rate_state(p: Mapping[str, ArrayLike], states: int, evolution, scale: float = 1.0) -> RateState:
    """The law with forces `scale` times those given; a batch where the values are arrays."""
    names = numbered(states)
    p = {name: jnp.asarray(value, float) for name, value in p.items()}
    return RateState(
        p["f0"] * scale,
        p["A"] * scale,
        jnp.stack([p[name] * scale for name in names[0::2]], axis=-1),
        jnp.stack([p[name] for name in names[1::2]], axis=-1),
        p["V0"],
        evolution,
        RegularisedEffect(),
        p.get("slip_trend", jnp.zeros_like(p["V0"])) * scale,
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


def _from_pairs(kind: str, pairs: dict[str, str]) -> RateState:
    states = 1 + sum(name[0] == "B" and name[1:].isdigit() for name in pairs)
    names = numbered(states)
    for name in ("A", *names, "V0"):
        if name not in pairs:
            raise InputError(f"parameters: {name} is missing; the {kind} law needs A, B, L, V0")
    values = {name: _value(pairs, name, law_quantity(name)) for name in ("A", *names, "V0")}
    values["f0"] = _value(pairs, "f0", law_quantity("f0")) if "f0" in pairs else _F0 * values["A"]
    _refuse_rest(pairs, kind, "A, B, L, V0, f0")
    return rate_state(values, states, EVOLUTIONS[kind]())


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
