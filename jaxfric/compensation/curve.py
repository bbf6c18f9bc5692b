"""The steady friction of an axis over velocity, with standard errors and slopes.

    F(v) = R(v) + s(v) G(v)

s is the (smoothed) sign of v. R is continuous at v = 0. The level G is the friction that changes
sign with v. States of friction are steady. All numbers come from `AxisRig`, the fitted model.
Above the speed `held`, F keeps its value at that speed: an extrapolated fall of friction with speed
would end in friction that drives the axis.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..effects import AbstractEffect, made
from ..quantity import quantities
from ..rig.axis import AxisRig
from .identified import Identified

_BUCKET = 1024
_SHARP, _NONE = 1e-300, 1e300
"""Widths for which the sign is a jump, and 0 everywhere."""


class FrictionValues(NamedTuple):
    """Friction at some velocities (n). SI; forces in the unit of the model."""

    force: np.ndarray
    std: np.ndarray
    """Standard error of `force`."""
    slope: np.ndarray
    """dF/dv."""


class FrictionCurve:
    """Friction over velocity of an identified axis, at one position and with some effects."""

    def __init__(
        self,
        about: Identified,
        effects: Sequence[type[AbstractEffect]],
        place: float,
        held: float = math.inf,
    ):
        self.about, self.effects, self.place, self.held = about, tuple(effects), place, held
        self.names = tuple(about.values)
        self.row = np.asarray([about.values[name] for name in self.names])

    def at(self, velocity: np.ndarray, fade: float | None) -> FrictionValues:
        """Friction with s = tanh(v/fade); None: with a discontinuous sign."""
        width = _SHARP if fade is None else fade
        force, by, slope = self._numbers(velocity, width)
        return FrictionValues(force, self._error(by), slope)

    def level(self, velocity: np.ndarray) -> np.ndarray:
        """G, averaged over both directions [F]."""
        v = np.abs(np.asarray(velocity, float))
        ends = [self._numbers(s * v, _SHARP)[0] - self._numbers(s * v, _NONE)[0] for s in (1, -1)]
        return 0.5 * (ends[0] - ends[1])

    def mean(self, velocity: np.ndarray) -> FrictionValues:
        """(F(v) - F(-v))/2, half the difference of both directions without fade, with its error."""
        v = np.abs(np.asarray(velocity, float))
        (f, by, slope), (g, other, back) = (self._numbers(s * v, _SHARP) for s in (1, -1))
        return FrictionValues(0.5 * (f - g), self._error(0.5 * (by - other)), 0.5 * (slope + back))

    def _error(self, by: np.ndarray) -> np.ndarray:
        """Standard errors (n) of values with the derivatives `by` (n, p) in the parameters."""
        index = [self.names.index(name) for name in self.about.free]
        # covariances differ by many orders of magnitude; correlations avoid loss of precision
        size = np.sqrt(np.maximum(np.diag(self.about.covariance), 0.0))
        scale = np.where(size > 0, size, 1.0)
        correlation = self.about.covariance / scale[:, None] / scale
        g = by[:, index] * scale
        variance = np.einsum("ni,ij,nj->n", g, correlation, g)
        return np.sqrt(np.maximum(variance, 0.0))

    def _numbers(self, velocity: np.ndarray, width: float) -> tuple[np.ndarray, ...]:
        """Force (n), its derivatives in the parameters (n, p) and in velocity (n)."""
        free = np.asarray(velocity, float)
        v = np.clip(free, -self.held, self.held)
        padded = np.pad(v, (0, -len(v) % _BUCKET))  # one shape, compiled once
        with jax.enable_x64(True):  # independent of the user's precision
            row, at = jnp.asarray(self.row), jnp.asarray(padded)
            widths = jnp.asarray([self.about.width, width])
            place = jnp.asarray(self.place, float)
            found = _numbers(self.names, self.effects, row, at, widths, place)
            force, by, slope = (np.asarray(x)[: len(v)] for x in found)
        return force, by, np.where(v == free, slope, 0.0)


@eqx.filter_jit
def _numbers(
    names: tuple[str, ...],
    effects: tuple[type[AbstractEffect], ...],
    row: Array,
    velocity: Array,
    widths: Array,
    place: Array,
) -> tuple[Array, Array, Array]:
    """Friction at velocities (n) for the values `row` of `names` (p), and its derivatives."""

    def force(row: Array, velocity: Array) -> Array:
        p = dict(zip(names, row, strict=True))
        rig = AxisRig(
            p.get("M", 0.0), p["F_v"], p["F_c"], p["F_0"], width=widths[0]
        )  # the record's width: effects resolve no speed scale below it
        for effect in effects:
            fields = {name: p[f"{effect.id}.{name}"] for name in quantities(effect)}
            rig = made(effect, fields).embed(rig)
        rig = eqx.tree_at(lambda r: r.width, rig, widths[1])
        return rig.steady_friction(place, velocity)

    _, slope = jax.jvp(lambda v: force(row, v), (velocity,), (jnp.ones_like(velocity),))
    return force(row, velocity), jax.jacfwd(force)(row, velocity), slope
