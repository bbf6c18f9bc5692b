"""Required margins, as functions that must not be negative."""

import math
from collections.abc import Mapping, Sequence
from typing import cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from ..errors import InputError
from ..laws.registry import Law
from ..pairs import read_pairs
from ..rig.friction import AbstractDelayLaw
from ..stability.kernel import DelayKernel
from ..stability.linear import LinearSlider
from ..stability.margin_table import known_margin, refuse_meaningless
from ..stability.margins import several
from ..stability.theorem import apply_theorem
from ..units import parse_quantity
from .branches import branches
from .thresholds import ENOUGH, POSITIVE

DEFAULT = "modulus=0.5"
"""What is required beside whatever is named, unless modulus is named too; modulus=0: nothing."""
FRAGILE = 0.2
"""A modulus below which a loop bears hardly any error of the model."""


class Requirement(eqx.Module):
    """Margins by name and the values they must reach, in the units of `MARGINS`."""

    names: tuple[str, ...] = eqx.field(static=True)
    values: tuple[float, ...]
    kept: bool = eqx.field(static=True)
    """Whether `DEFAULT` is among them without having been named."""

    def __init__(self, margins: Mapping[str, float | Array], *, kept: bool = False):
        if not margins:
            raise InputError(f"margin: none is required; give one, as in {DEFAULT}")
        for name, value in margins.items():
            known_margin(name)
            if not isinstance(value, Tracer):
                _check(name, float(value))
        self.kept = kept
        self.names = tuple(margins)
        # NumPy's numbers are traced by jit, Python's are not: one compilation for all values
        values = [x if isinstance(x, Tracer) else np.float64(x) for x in margins.values()]
        self.values = cast("tuple[float, ...]", tuple(values))

    @staticmethod
    def parse(texts: Sequence[str]) -> "Requirement":
        """`with_default` of texts such as "stiffness=2", "phase=30 deg"; SI without a unit."""
        for text in texts:
            known_margin(text.partition("=")[0].strip())
        margins = {}
        example, form = DEFAULT, "NAME=NUMBER"
        for name, value in read_pairs(list(texts), "margin", example, form=form).items():
            unit = known_margin(name).unit
            try:
                margins[name] = float(value)
            except ValueError:
                if unit == "1":
                    raise InputError(
                        f"margin '{name}={value}' is not {form}, as in {example}"
                    ) from None
                margins[name] = parse_quantity(value, unit, f"margin {name}")
        return Requirement.with_default(margins)

    @staticmethod
    def with_default(margins: Mapping[str, float | Array]) -> "Requirement":
        """The margins and modulus=0.5, unless modulus is among them; modulus=0 asks for none.

        Other margins may be met beside a modulus that bears no error of the model: a delay of 1 ms
        by a loop whose gain margin is 1.0003.
        """
        name, _, least = DEFAULT.partition("=")
        if name not in margins:
            return Requirement({name: float(least), **margins}, kept=True)
        off = not isinstance(margins[name], Tracer) and float(margins[name]) == 0
        return Requirement({n: x for n, x in margins.items() if not (off and n == name)})

    def slack(self, slider: LinearSlider, unit: Float[Array, " 2"]) -> Float[Array, ""]:
        """How far the margins exceed their requirements, relative to these; the least of all.

        Zero at the requirement, negative where it is missed, at most 9. `unit` are the natural
        units of (k_p, k_v). For stiffness see `constraints`.
        """
        values = several([name for name in self.names if name != "stiffness"], slider)
        slacks = [
            jnp.min(_stiffness_slack(slider, required, unit))
            if name == "stiffness"
            else _limited(values[name] - required, required)
            for name, required in zip(self.names, self.values, strict=True)
        ]
        return jnp.min(jnp.stack(slacks))

    def constraints(self, slider: LinearSlider, unit: Float[Array, " 2"]) -> Float[Array, " n"]:
        """Smooth functions that are at least 0 where the margins are met (`branches`).

        Most are branches of `slack`. The margin of stiffness has entries k_p + f_x less the
        stiffness required, over `unit[0]`, one for each critical frequency, and one more: the
        theorem's hypothesis f_v + k_v > 0, over `unit[1]`, the only limit of friction without
        memory. For a delay law, of which the theorem does not hold, it is f_v + k_v > |k_f|.
        """
        found = []
        for name, required in zip(self.names, self.values, strict=True):
            if name == "stiffness":
                found.append(_stiffness_slack(slider, required, unit))
            else:
                beyond = branches(name, slider, required, unit[0] / unit[1])
                found.append(_limited(beyond, required))
        return jnp.concatenate(found)


def refuse_controller(
    requirement: Requirement,
    law: Law,
    mass: ArrayLike | None,
    delay: ArrayLike | None,
    integral: ArrayLike | None,
    told: str = "a delay of the controller",
) -> None:
    """Raise `InputError` for a controller that the law or a required margin does not go with;
    `told` names how its delay was given."""
    late, integrates = delay is not None, integral is not None
    if late and mass is None:
        raise InputError(f"{told} needs a mass: without one no delay of the controller is survived")
    refuse_meaningless(requirement.names, late=late, integral=integrates)
    if (late or integrates) and isinstance(law, AbstractDelayLaw):
        what = "a controller that answers late" if late else "integral action"
        raise InputError(f"{what} under a delay law is not analysed; take another law")


def _limited(beyond: Array, required: float) -> Array:
    """Relative to the requirement, and between the numbers that stand for infinite ones."""
    scale = jnp.where(required > 0, required, 1.0)
    return jnp.clip(beyond, -1e9 * scale, (ENOUGH - 1) * scale) / scale


def _stiffness_slack(
    slider: LinearSlider, required: float, unit: Float[Array, " 2"]
) -> Float[Array, " n"]:
    """k_p + f_x - required k(w_n) for every critical frequency, and the damping f_v + k_v."""
    friction = slider.friction
    damping = slider.damping + friction.slope
    if isinstance(friction.kernel, DelayKernel):  # no critical stiffness, only damping
        damping = damping - jnp.abs(friction.kernel.strength)
    found = apply_theorem(slider)
    some = (found.stiffnesses > 0) & jnp.isfinite(found.critical_stiffness)
    k = jnp.where(some, jnp.where(some, found.stiffnesses, 0.0), 0.0)
    k = jnp.where(jnp.isfinite(found.critical_stiffness), k, jnp.inf)
    needed = required * jnp.where(damping > 0, jnp.minimum(k, 1e9 * unit[0]), 0.0)
    stiff = (slider.stiffness + friction.trend - needed) / unit[0]
    return jnp.append(stiff, damping / unit[1] - POSITIVE)


def _check(name: str, value: float) -> None:
    about = known_margin(name)
    low, high = about.limit, about.highest
    if not (math.isfinite(value) and low <= value <= high):
        limit = f"at least {low:g}" if math.isinf(high) else f"between {low:g} and {high:.4g}"
        unit = "no unit" if about.unit == "1" else f"unit {about.unit}"
        degrees = f"; in degrees: '{name}={value:g} deg'" if about.unit == "rad" else ""
        raise InputError(f"margin {name}={value:g}: it must be {limit} ({unit}){degrees}")
    if value == 0 and not about.zero:
        raise InputError(f"margin {name}=0 asks for nothing; give a positive number")
