"""Required margins, as functions that must be nonnegative."""

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
"""Margin added to the named ones unless modulus is named; modulus=0 switches it off."""


class Requirement(eqx.Module):
    """Margins by name and the values that the margins must reach, in the units of `MARGINS`."""

    names: tuple[str, ...] = eqx.field(static=True)
    values: tuple[float, ...]
    kept: bool = eqx.field(static=True)
    """Whether `DEFAULT` was added without being named."""

    def __init__(self, margins: Mapping[str, float | Array], *, kept: bool = False):
        if not margins:
            raise InputError(f"margin: none is required; give one, as in {DEFAULT}")
        for name, value in margins.items():
            known_margin(name)
            if not isinstance(value, Tracer):
                _check(name, float(value))
        self.kept = kept
        self.names = tuple(margins)
        # jit traces NumPy's numbers but not Python's: one compilation serves all values
        values = [x if isinstance(x, Tracer) else np.float64(x) for x in margins.values()]
        self.values = cast("tuple[float, ...]", tuple(values))

    @staticmethod
    def parse(texts: Sequence[str]) -> "Requirement":
        """Read texts such as "stiffness=2" or "phase=30 deg"; then apply `with_default`."""
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
        """Add modulus=0.5 to the margins unless modulus is named; modulus=0 removes modulus.

        A loop that is not robust can meet every margin other than modulus. For example, a loop with
        a delay margin of 1 ms can have a gain margin of only 1.0003.
        """
        name, _, least = DEFAULT.partition("=")
        if name not in margins:
            return Requirement({name: float(least), **margins}, kept=True)
        off = not isinstance(margins[name], Tracer) and float(margins[name]) == 0
        return Requirement({n: x for n, x in margins.items() if not (off and n == name)})

    def slack(self, slider: LinearSlider, unit: Float[Array, " 2"]) -> Float[Array, ""]:
        """Least relative excess of the margins over the required values.

        The slack is zero if the margins just meet the requirement, negative if a margin misses its
        requirement, and at most 9. `unit` holds the natural units of (k_p, k_v). For the slack of
        the stiffness margin see `constraints`.
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
        """Smooth functions; all are nonnegative exactly if the margins are met (see `branches`).

        Most of the smooth functions are branches of `slack`. The stiffness margin has one entry for
        each critical frequency, (k_p + f_x - required stiffness)/`unit[0]`. A further entry is (f_v
        + k_v)/`unit[1]`, because the theorem of Rice and Ruina requires f_v + k_v > 0. For friction
        without memory, f_v + k_v > 0 is the only condition. The theorem does not apply to a delay
        law. For a delay law the condition is f_v + k_v > |k_f|.
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
    """Raise `InputError` for a controller incompatible with the law or a required margin.

    `told` is the name of the argument that gave the controller's delay."""
    late, integrates = delay is not None, integral is not None
    if late and mass is None:
        raise InputError(f"{told} needs a mass: without mass no controller delay is stable")
    refuse_meaningless(requirement.names, late=late, integral=integrates)
    if (late or integrates) and isinstance(law, AbstractDelayLaw):
        what = "a controller delay" if late else "integral action"
        raise InputError(f"{what} cannot be combined with a delay law; use another law")


def _limited(beyond: Array, required: float) -> Array:
    """Excess relative to the requirement, clipped to finite bounds."""
    scale = jnp.where(required > 0, required, 1.0)
    return jnp.clip(beyond, -1e9 * scale, (ENOUGH - 1) * scale) / scale


def _stiffness_slack(
    slider: LinearSlider, required: float, unit: Float[Array, " 2"]
) -> Float[Array, " n"]:
    """k_p + f_x - required k(w_n) for every critical frequency, then f_v + k_v, in `unit`."""
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
        raise InputError(f"margin {name}=0 requires nothing; give a positive number")
