"""A friction law for control with samples of its uncertainty; a law from parameters as text."""

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..coordinate import Coordinate, agreed, unit_of
from ..effects.effect import id_of
from ..errors import InputError
from ..findings import WarningCode, warned
from ..pairs import read_pairs
from ..quantity import Quantity, numbered_names, quantities
from ..rig.friction import AbstractRateState
from ..units import parse_quantity
from .registry import (
    REGISTRY,
    Law,
    count_states,
    is_rate_state,
    law_quantity,
    rate_state,
)
from .thresholds import BEYOND, USUAL_F0


@dataclass(frozen=True, eq=False)
class LawSource:
    """A law and samples of its uncertainty; SI, linear or rotary."""

    law: Law
    """The law at the estimated parameters."""
    samples: Law
    """The estimate and then the samples: every array has a leading axis."""
    text: str
    """The law and its origin, in one line."""
    velocity: float | None
    """Default velocity [m/s], V0 of the law; None: it has none."""
    warnings: tuple[str, ...] = ()
    """Warnings to read before using the law, one line each."""
    seen: tuple[float, float] | None = None
    """Lowest and highest velocity of the record [m/s]; None: no record."""
    mass: float | None = None
    """Default mass [kg]: the moving mass of the fitted axis, or the mass stated for the fit of a
    slider; None: no mass is known."""
    coordinate: Coordinate | None = "linear"
    """Whether the law is in m and N or in rad and N m; None: its units are unknown."""
    level_known: bool = True
    """Whether the absolute level of friction is known; False if f0 is assumed."""

    def unseen(self, velocities: Sequence[float] | np.ndarray) -> tuple[str, ...]:
        """Warn if some `velocities` [m/s] are a factor of 2 outside the range of the record."""
        V = np.abs(np.asarray(velocities, float))
        V = V[V > 0]
        if self.seen is None or V.size == 0:
            return ()
        low, high = self.seen
        if V.min() >= low / BEYOND and V.max() <= BEYOND * high:
            return ()
        worst = max(V.max() / high, low / V.min())
        asked = {"least": V.min(), "most": V.max(), "times": worst}
        return (warned(WarningCode.UNSEEN, slowest=low, fastest=high, **asked),)


def law_from_parameters(kind: str, text: str) -> LawSource:
    """Build a law from its name and its parameters, "A=1 N, B=3 N, L=1 mm, V0=2 mm/s".

    Rate-and-state laws need A, B, L (B2, L2, ... for more states) and V0. The steady friction f0
    matters only for a start at rest; its default is 50 A, noted in `text`. Other laws need the
    parameters that their class declares. For a joint use rad and N m:
    "A=10 mN m, B=30 mN m, L=1 mrad, V0=2 mrad/s".

    Raises
    ------
    InputError : no such law or parameter; one is missing, given twice or out of bounds.
    """
    kind = id_of(kind)
    if kind not in REGISTRY:
        raise InputError(f"law '{kind}' does not exist; there are: {', '.join(REGISTRY)}")
    pairs = read_pairs(text, "parameters", "'A=1 N, L=1 mm'")
    law, coordinate = _built(kind, pairs)
    unsaid = is_rate_state(kind) and "f0" not in pairs
    V0 = getattr(law, "V0", None)
    name = f"{kind} law: {text}"
    if unsaid and isinstance(law, AbstractRateState):
        force = unit_of("N", coordinate)
        name += (
            f"; f0, the steady friction at V0, is not given: {float(law.f0):.4g} {force}"
            f" ({USUAL_F0:g} times A) is assumed, which matters to rest and stick-slip and hardly"
            " to linear stability"
        )
    return LawSource(
        law,
        stack([law]),
        name,
        None if V0 is None else float(V0),
        coordinate=coordinate,
        level_known=not unsaid,
    )


def stack(laws: Sequence[Law]) -> Law:
    """A batch of laws of one kind."""
    parts = [eqx.partition(law, eqx.is_array) for law in laws]
    arrays = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(arrays for arrays, _ in parts))
    return eqx.combine(arrays, parts[0][1])


def without_first(laws: Law) -> Law | None:
    """Drop the first law of a batch, the estimate; None if nothing remains."""
    arrays, _ = eqx.partition(laws, eqx.is_array)
    few = all(leaf.shape[0] < 2 for leaf in jax.tree.leaves(arrays))
    return None if few else taken(laws, slice(1, None))


def taken(laws: Law, which: int | slice) -> Law:
    """Select one law of a batch, or a slice of it."""
    arrays, rest = eqx.partition(laws, eqx.is_array)
    return eqx.combine(jax.tree.map(lambda leaf: leaf[which], arrays), rest)


def _built(kind: str, pairs: Mapping[str, str]) -> tuple[Law, Coordinate]:
    """Build the law from parameters as text; return it and whether it is linear or rotary."""
    entry = REGISTRY[kind]
    if is_rate_state(kind):
        states = count_states(kind, pairs)
        needed = ["A", *numbered_names(states), "V0"]
        known = {name: law_quantity(name) for name in (*needed, "f0")}
    else:
        assert isinstance(entry, type)
        known = quantities(entry)
        defaults = inspect.signature(entry).parameters
        needed = [n for n in known if defaults[n].default is inspect.Parameter.empty]
    names = {about.symbol: name for name, about in known.items()} | {name: name for name in known}
    si = {n: _si(known[names[n]]) if n in names else "1" for n in pairs}
    coordinate = agreed({f"parameter {n}": (x, si[n]) for n, x in pairs.items()})
    given = {names.get(n, n): x for n, x in pairs.items()}
    for name in needed:
        if name not in given:
            raise InputError(
                f"parameters: {name} is missing; the {kind} law needs {', '.join(needed)}"
            )
    values = {}
    for name in (name for name in known if name in given):
        unit = unit_of(_si(known[name]), coordinate)
        value = parse_quantity(given[name], unit, f"parameter {name}")
        values[name] = known[name].check(value, "parameters")
    for name in given:
        if name not in known:
            raise InputError(
                f"parameters: '{name}' is no parameter of the {kind} law; it has:"
                f" {', '.join(known)}"
            )
    if is_rate_state(kind):
        return rate_state(kind, {"f0": USUAL_F0 * values["A"], **values}, states), coordinate
    assert isinstance(entry, type)
    return entry(**values), coordinate


def _si(about: Quantity) -> str:
    return about.unit_for("N").removeprefix("1 ").replace(" ", "*")
