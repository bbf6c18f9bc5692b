"""Sources of a friction law for control: the file of a fit, or parameters given one by one."""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..coordinate import Coordinate, agreed, unit_of
from ..effects.effect import id_of
from ..errors import InputError
from ..pairs import read_pairs
from ..quantity import Quantity, numbered_names, quantities
from ..rig.friction import AbstractRateState
from ..stability.claims import held_with_trend, rate_state_claim
from ..units import between, parse_quantity
from .registry import (
    REGISTRY,
    Law,
    count_states,
    fixed_states,
    is_rate_state,
    law_quantity,
    names_of_laws,
    rate_state,
)
from .saved import (
    FIT,
    Saved,
    content_of,
    missing_key,
    own_warnings,
    refuse_damage,
    sampled,
    table_damage,
    values_of,
)

_BEYOND = 2.0
_F0 = 50.0
"""Steady friction in units of A where f0 is not given; rock and metal have 30 to 100."""


@dataclass(frozen=True, eq=False)
class LawSource:
    """A law, and samples of it that its uncertainty allows; in SI, of a line or of a rotation."""

    law: Law
    """The law at the estimated parameters."""
    samples: Law
    """The estimate and then the samples: every array has a leading axis."""
    text: str
    """The law and its origin, in a line."""
    velocity: float | None
    """A velocity of the record [m/s], for where none is given."""
    warnings: tuple[str, ...] = ()
    """Warnings to read before the law is relied on, a line each."""
    seen: tuple[float, float] | None = None
    """Slowest and fastest velocity of the record [m/s]; None where there is none."""
    mass: float | None = None
    """Moving mass of the axis that the law is of [kg], for where none is given; None: of none."""
    coordinate: Coordinate | None = "linear"
    """Whether the law is in m and N or in rad and N m; None: a law of numbers, which fits both."""
    level_known: bool = True
    """Whether the level of friction is known, not only how it changes (f0 may be assumed)."""

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


def law_of_fit(
    source: Saved, *, normal_force: float | None = None, samples: int = 64, seed: int = 0
) -> LawSource:
    """The law of a Fit, or of its `fit.json`, in newtons, and samples from the fit's covariance.

    Parameters with a lower bound (A, L) are sampled by their logarithms, the others as they are.
    The direct effect is the regularised one, so that the law can be carried through rest. A slip
    trend is left out, as by `law_from_loop`: it is of the run-in of the record, and with it no
    motion is steady. That, and what the fit itself warned of, is in `warnings`.

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
    path, content = content_of(source, FIT)
    refuse_damage(path, FIT, fit_damage(content))
    scale = force_of_unit(content["friction_unit"], normal_force, path)
    kind, states = content["law"], int(content["states"])
    values = values_of(content)
    own = {name: values[name] for name in ("f0", "A", *numbered_names(states), "V0")}
    positive = {name: law_quantity(name).lower == 0.0 for name in own}
    columns = sampled(content, positive, samples, seed, path)
    law = rate_state(kind, own, states, scale=scale)
    text = f"{kind} law, {states} state(s), fitted: {path}"
    samples_of = rate_state(kind, columns, states, scale=scale)
    steps = content.get("steps")
    seen = seen_velocities(steps.get("velocities") if isinstance(steps, dict) else None)
    return LawSource(law, samples_of, text, values["V0"], fit_warnings(content, scale), seen)


def fit_warnings(content: Mapping, scale: float) -> tuple[str, ...]:
    """Warnings of a fit.json, whose forces are in `scale` newtons: those that it holds, a line
    where it says nothing of stability, and one where its slip trend is left out."""
    doubts = _doubts(content, int(content["states"]))
    trend = values_of(content).get("slip_trend")
    return (*own_warnings(content), *doubts, *trend_words(trend, scale))


def trend_words(trend: float | None, scale: float) -> tuple[str, ...]:
    """A line where a file has a slip trend [its force/m], which its law is without."""
    return () if not trend else (left_out_words("slip_trend", scale * trend),)


def left_out_words(
    id: str, stiffness: float, moves: str = "slider", coordinate: Coordinate = "linear"
) -> str:
    """That the law is without an effect that acts as a spring [N/m] beside k_p, and what to do."""
    motion = "sliding" if moves == "slider" else "motion"
    unit = unit_of("N/m", coordinate)
    why = f"it depends on where the {moves} is, so no steady {motion} exists with it"
    acts = "It acts as a spring that stiffens k_p, so leaving it out is safe"
    if stiffness < 0:
        acts = (
            f"It acts as a spring of {stiffness:.3g} {unit} beside k_p: add {-stiffness:.3g} {unit}"
        )
        acts += " to k_p"
    return f"{id} is left out of the law: {why}. {acts}"


def seen_velocities(velocities: object) -> tuple[float, float] | None:
    """Slowest and fastest [m/s] of the velocities in a file, rest left out; None without any."""
    if not isinstance(velocities, list):
        return None
    sizes = [abs(v) for v in velocities if isinstance(v, int | float) and v != 0]
    return (min(sizes), max(sizes)) if sizes else None


def _doubts(content: Mapping, states: int) -> tuple[str, ...]:
    """A warning where the fit itself says nothing of stability, else nothing."""
    table, free = content["parameters"], content["free"]
    amplitudes = numbered_names(states)[0::2]
    weight = np.array([(name == "A") - (name in amplitudes) for name in free], float)
    variance = float(weight @ np.asarray(content["covariance"], float) @ weight) if free else 0.0
    claim = rate_state_claim(
        table["A"]["value"],
        [table[name]["value"] for name in amplitudes],
        math.sqrt(variance) if variance >= 0 else math.nan,
        determined=all(table[n].get("determined", True) for n in ("A", *numbered_names(states))),
    )
    claim = held_with_trend(claim, content.get("A_minus_B_with_trend"))
    if claim.kind != "open":
        return ()
    return (
        f"this fit says nothing of stability ({'; '.join(claim.reasons)}): what follows is of its"
        " values and samples, not of the record",
    )


def law_from_parameters(kind: str, text: str) -> LawSource:
    """A law by its name and its parameters, "A=1 N, B=3 N, L=1 mm, V0=2 mm/s".

    Rate-and-state laws: A, B, L (B2, L2, ... for more states), V0, and f0, which matters only for
    a start at rest (default 50 A, told in `text`). Other laws: their own fields. Of a joint all
    are in rad and N m: "A=10 mN m, B=30 mN m, L=1 mrad, V0=2 mrad/s".

    Raises
    ------
    InputError : no such law or parameter; one is missing, given twice or out of bounds.
    """
    kind = id_of(kind)
    if kind not in REGISTRY:
        raise InputError(f"law '{kind}' does not exist; there are: {', '.join(names_of_laws())}")
    pairs = read_pairs(text, "parameters", "'A=1 N, L=1 mm'")
    law, coordinate = _built(kind, pairs)
    unsaid = is_rate_state(kind) and "f0" not in pairs
    V0 = getattr(law, "V0", None)
    name = f"{kind} law: {text}"
    if unsaid and isinstance(law, AbstractRateState):
        force = unit_of("N", coordinate)
        name += (
            f"; f0, the steady friction at V0, is not given: {float(law.f0):.4g} {force}"
            f" ({_F0:g} times A) is assumed, which matters to rest and stick-slip and hardly to"
            " linear stability"
        )
    return LawSource(
        law,
        stack([law]),
        name,
        None if V0 is None else float(V0),
        coordinate=coordinate,
        level_known=not unsaid,
    )


def force_of_unit(unit: str, normal_force: float | None, path: Path) -> float:
    """Factor by which forces of a file in `unit` ("1" or "N") are multiplied to be in newtons.

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
    """The fault of a fit.json, in words: what is missing or wrong."""
    keys = ("law", "states", "friction_unit", "parameters", "free", "covariance")
    problem = missing_key(content, keys)
    if problem:
        return problem
    if not is_rate_state(content["law"]):
        return f"law '{content['law']}' is not known"
    states, always = content["states"], fixed_states(content["law"])
    if isinstance(states, bool) or not isinstance(states, int) or states < 1:
        return f"the number of states is '{states}'"
    if always not in (None, states):
        return f"the number of states is '{states}'"
    return table_damage(content, ["f0", "A", "V0", *numbered_names(states)])


def stack(laws: Sequence[Law]) -> Law:
    """A batch of laws of one kind."""
    parts = [eqx.partition(law, eqx.is_array) for law in laws]
    arrays = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(arrays for arrays, _ in parts))
    return eqx.combine(arrays, parts[0][1])


def without_first(laws: Law) -> Law | None:
    """A batch of laws without its first, which is the estimate; None where it has no other."""
    arrays, rest = eqx.partition(laws, eqx.is_array)
    if all(leaf.shape[0] < 2 for leaf in jax.tree.leaves(arrays)):
        return None
    return eqx.combine(jax.tree.map(lambda leaf: leaf[1:], arrays), rest)


def first_of(laws: Law) -> Law:
    """The first law of a batch."""
    arrays, rest = eqx.partition(laws, eqx.is_array)
    return eqx.combine(jax.tree.map(lambda leaf: leaf[0], arrays), rest)


def _built(kind: str, pairs: Mapping[str, str]) -> tuple[Law, Coordinate]:
    """The law with parameters as text, and whether they are of a line or of a rotation."""
    entry = REGISTRY[kind]
    if is_rate_state(kind):
        states = count_states(kind, pairs)
        needed = ["A", *numbered_names(states), "V0"]
        known = {name: law_quantity(name) for name in (*needed, "f0")}
        least = ["A", *numbered_names(fixed_states(kind) or 1), "V0"]
        listed = "A, B, L, V0, f0"
    else:
        assert isinstance(entry, type)
        known = quantities(entry)
        defaults = inspect.signature(entry).parameters
        needed = [n for n in known if defaults[n].default is inspect.Parameter.empty]
        least, listed = needed, ", ".join(known)
    names = {about.symbol: name for name, about in known.items()} | {name: name for name in known}
    si = {n: _si(known[names[n]]) if n in names else "1" for n in pairs}
    coordinate = agreed({f"parameter {n}": (x, si[n]) for n, x in pairs.items()})
    given = {names.get(n, n): x for n, x in pairs.items()}
    for name in needed:
        if name not in given:
            raise InputError(
                f"parameters: {name} is missing; the {kind} law needs {', '.join(least)}"
            )
    values = {}
    for name in (name for name in known if name in given):
        unit = unit_of(_si(known[name]), coordinate)
        value = parse_quantity(given[name], unit, f"parameter {name}")
        values[name] = known[name].check(value, "parameters")
    for name in given:
        if name not in known:
            raise InputError(
                f"parameters: '{name}' is no parameter of the {kind} law; it has: {listed}"
            )
    if is_rate_state(kind):
        return rate_state(kind, {"f0": _F0 * values["A"], **values}, states), coordinate
    assert isinstance(entry, type)
    return _with(entry, values), coordinate


def _with(law: Callable[..., Law], values: Mapping[str, float]) -> Law:
    return law(**values)


def _si(about: Quantity) -> str:
    return about.unit_for("N").removeprefix("1 ").replace(" ", "*")
