"""The frontier of feasible gains: for every k_v the smallest k_p that meets the requirement.

Gains are in natural units here: u = k_p/K0, v = k_v/C0 (`natural_units`). The norm grows with u,
so the smallest norm lies on the frontier u(v), and its local minima along v are the basins.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..stability.kernel import kernel_total
from ..stability.linear import LinearFriction
from ..stability.theorem import theorem
from .requirement import Requirement
from .scenarios import Scenarios

_BISECTIONS = 28
_ZOOMS = 5
_ZOOM_POINTS = 17
_LOCAL_POINTS = 16


class Region(NamedTuple):
    """Natural units, scales of the norm, limits of the gains; pairs (k_p, k_v) in SI."""

    unit: np.ndarray
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def norm(self, gains) -> np.ndarray:
        """sqrt((k_p/s_p)^2 + (k_v/s_v)^2), of the last axis."""
        return np.sqrt(np.sum(np.square(np.asarray(gains) / self.scale), axis=-1))


def natural_units(scenarios: Scenarios) -> np.ndarray:
    """(K0, C0): the stiffness that stabilises without damping, the damping that needs no stiffness.

    The largest over the scenarios; where none is needed, or no stiffness suffices, stiffness and
    damping at which the gains begin to matter take their place.
    """
    k_cr, fall, slope, rate, mass = (np.asarray(x) for x in _sizes(scenarios))
    need = np.max(fall - slope)
    C0 = need if need > 0 else np.max(np.abs(slope) + np.abs(fall))
    finite = np.isfinite(k_cr) & (k_cr > 0)
    if finite.any():
        K0 = np.max(k_cr[finite])
    else:
        K0 = np.max(np.abs(fall) * rate + mass * rate**2)
        if K0 == 0 and np.any(mass > 0):
            K0 = C0**2 / np.max(mass)
    return np.where(np.asarray([K0, C0]) > 0, [K0, C0], 1.0)


@eqx.filter_jit
def _sizes_of(friction: LinearFriction, mass):
    def one(friction, mass):
        low, high = friction.kernel.frequencies()
        known = theorem(friction.kernel, friction.slope, mass)
        rate = jnp.where(low == high, low, jnp.sqrt(low * high))
        return (known.critical_stiffness, kernel_total(friction.kernel), friction.slope, rate, mass)

    return jax.vmap(one)(friction, mass)


def _sizes(scenarios: Scenarios):
    mass = np.zeros(len(scenarios)) if scenarios.mass is None else scenarios.mass
    return _sizes_of(scenarios.friction, jnp.asarray(mass))


def axes(region: Region) -> tuple[np.ndarray, np.ndarray]:
    """Values of u and of v that cover all the gains that can matter, ascending, within limits."""
    u = np.concatenate([np.geomspace(1e-9, 1e4, 53), np.linspace(0.2, 2.0, 10)])
    v = np.concatenate([np.geomspace(1e-5, 1e3, 57), np.linspace(0.05, 1.5, 30), [0.0]])
    low, high = region.lower / region.unit, region.upper / region.unit
    return _within(u, low[0], high[0]), _within(v, low[1], high[1])


def _within(values, low, high) -> np.ndarray:
    ends = [low, high] if np.isfinite(high) else [low]
    kept = values[(values > low) & (values < high)]
    return np.unique(np.concatenate([kept, ends]))


@eqx.filter_jit
def worst_slack(
    requirement: Requirement,
    friction: LinearFriction,
    mass: Float[Array, " n"] | None,
    unit: Float[Array, " 2"],
    gains: Float[Array, "p 2"],
) -> Float[Array, "p n"]:
    """Least slack of every scenario at every pair of gains."""

    def one(gains, friction, mass):
        return jnp.min(requirement.slack(gains, friction, mass, unit))

    over = jax.vmap(one, in_axes=(None, 0, None if mass is None else 0))
    return jax.vmap(over, in_axes=(0, None, None))(gains, friction, mass)


@eqx.filter_jit
def lowest(
    requirement: Requirement,
    friction: LinearFriction,
    mass: Float[Array, " n"] | None,
    unit: Float[Array, " 2"],
    u: Float[Array, "p q"],
    v: Float[Array, " p"],
) -> Float[Array, " p"]:
    """For each v the smallest u of its row that all scenarios accept, refined; inf if none."""

    def accepted(u, v):
        def one(friction, mass):
            gains = jnp.stack([u, v]) * unit
            return jnp.min(requirement.slack(gains, friction, mass, unit))

        axes = (0, None if mass is None else 0)
        return jnp.min(jax.vmap(one, in_axes=axes)(friction, mass)) >= 0

    def at(u, v):
        good = jax.vmap(accepted, in_axes=(0, None))(u, v)
        first = jnp.argmax(good)
        low, high = u[jnp.maximum(first - 1, 0)], u[first]

        def halve(_, ends):
            low, high = ends
            middle = jnp.where(low > 0, jnp.sqrt(low * high), 0.5 * high)
            good = accepted(middle, v)
            return jnp.where(good, low, middle), jnp.where(good, middle, high)

        low, high = jax.lax.fori_loop(0, _BISECTIONS, halve, (low, high))
        return jnp.where(jnp.any(good), high, jnp.inf)

    return jax.vmap(at)(u, v)


class Start(NamedTuple):
    """A local minimum of the norm along the frontier, in natural units, and its distance."""

    u: float
    v: float
    norm: float


def basins(requirement: Requirement, scenarios: Scenarios, region: Region) -> list[Start]:
    """Local minima of the norm along the whole frontier, each refined by zooming in."""
    u, v = axes(region)
    found = _lowest(requirement, scenarios, region, np.tile(u, (v.size, 1)), v)
    norm = region.norm(np.stack([found, v], axis=1) * region.unit)
    starts = []
    for i in range(v.size):
        left = norm[i - 1] if i else np.inf
        right = norm[i + 1] if i + 1 < v.size else np.inf
        if np.isfinite(norm[i]) and norm[i] <= left and norm[i] < right:
            near = slice(max(i - 1, 0), i + 2)
            starts.append(zoom(requirement, scenarios, region, found[near], v[near]))
    return starts


def zoom(
    requirement: Requirement,
    scenarios: Scenarios,
    region: Region,
    u: np.ndarray,
    v: np.ndarray,
) -> Start:
    """The least norm of the frontier between the first and the last of some of its points."""
    best = Start(np.inf, float(v[0]), np.inf)
    limits = region.lower[0] / region.unit[0], region.upper[0] / region.unit[0]
    for _ in range(_ZOOMS):
        inside = u[np.isfinite(u)]
        if not inside.size:
            break
        row = np.geomspace(0.1 * max(np.min(inside), limits[0]), 10 * np.max(inside), _LOCAL_POINTS)
        row = np.clip(row, *limits)
        v = np.linspace(v[0], v[-1], _ZOOM_POINTS)
        u = _lowest(requirement, scenarios, region, np.tile(row, (v.size, 1)), v)
        norm = region.norm(np.stack([u, v], axis=1) * region.unit)
        i = int(np.argmin(norm))
        if norm[i] < best.norm:
            best = Start(float(u[i]), float(v[i]), float(norm[i]))
        near = slice(max(i - 1, 0), i + 2)
        u, v = u[near], v[near]
    return best


def _lowest(requirement, scenarios: Scenarios, region: Region, u, v) -> np.ndarray:
    mass = None if scenarios.mass is None else jnp.asarray(scenarios.mass)
    unit = jnp.asarray(region.unit)
    found = lowest(requirement, scenarios.friction, mass, unit, jnp.asarray(u), jnp.asarray(v))
    return np.asarray(found)
