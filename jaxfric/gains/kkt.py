"""Exact optimum near a start: sequential quadratic programming in two unknowns.

    W^2 x = sum_i l_i grad c_i(x),   c_i(x) = 0 and l_i >= 0 for the active i,   c_i(x) >= 0

x = (u, v) are gains in natural units, W the weights of the norm. Each step solves the quadratic
model of norm and Lagrangian under the linearised constraints exactly: in two unknowns at most
two of them decide, so all singles and pairs are tried. Gradients are exact; their derivative, which
only sets the speed, is by central differences: second derivatives of roots took a minute to
compile.
"""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..stability.linear import LinearFriction
from .frontier import Region, Start
from .requirement import Requirement
from .scenarios import Scenarios, padded

_LIKELY = 6
_STEPS = 30
_DIFFERENCE = 1e-5
# Limits of the gains, the last constraints: k_p and k_v, low and high.
_LIMITS = 4
_ALIKE = 1e-9
# How far a solution may miss a constraint, relative to its requirement.
FEASIBLE = 1e-10


class Optimum(NamedTuple):
    """A solution of the KKT equations, gains in SI."""

    gains: np.ndarray
    norm: float
    residual: float
    """|W^2 x - sum l grad c| relative to |W^2 x|."""
    active: tuple[int, ...]
    """Indices of the active scenarios among those given."""
    at_limit: bool
    """Whether a limit of the gains is active."""


class _Model(NamedTuple):
    """Constraints c >= 0 with gradients g, and the gradient of the norm p, at a point."""

    c: np.ndarray
    g: np.ndarray
    p: np.ndarray


def polish(requirement: Requirement, scenarios: Scenarios, region: Region, start: Start) -> Optimum:
    """The optimum near `start`; the better of it and `start` where the steps do not converge."""
    number = len(scenarios)
    scenarios = scenarios.take(padded(np.arange(number)))
    weight = np.square(region.unit / region.scale)
    x = best = np.asarray([start.u, start.v])
    least = np.linalg.norm(weight * x)

    def model(x: np.ndarray) -> _Model:
        c, g = _constraints(requirement, scenarios, region, x)
        return _Model(c, g, weight * x / least)

    bounds = region.lower / region.unit, region.upper / region.unit
    multipliers: dict[int, float] = {}
    trust, residual = 0.3, np.inf
    for _ in range(_STEPS):
        here = model(x)
        multipliers = _multipliers(here)
        rest = _residual(here, multipliers)
        if np.min(here.c) > -FEASIBLE and rest < residual:
            best, residual = x, rest
        if residual < 1e-12:
            break
        bend = np.diag(weight / least) - _curvature(model, x, multipliers)
        step = _quadratic(here, bend)
        size = np.max(np.abs(step) / np.maximum(np.abs(x), 1e-3 * np.max(np.abs(x))))
        if not np.isfinite(size) or size < 1e-15:
            break
        x = np.clip(x + step * min(1.0, trust / size), *bounds)
    here = model(best)
    multipliers = _multipliers(here)
    count = len(scenarios) * requirement.number
    rows = {i // requirement.number for i in multipliers if i < count}
    active = sorted({row if row < number else 0 for row in rows})
    gains = best * region.unit
    return Optimum(
        gains,
        float(region.norm(gains)),
        _residual(here, multipliers),
        tuple(active),
        any(i >= count for i in multipliers),
    )


def _constraints(requirement, scenarios: Scenarios, region: Region, x: np.ndarray):
    """All constraints and their gradients: slacks, scenario by scenario, then the four limits."""
    mass = None if scenarios.mass is None else jnp.asarray(scenarios.mass)
    unit = jnp.asarray(region.unit)
    delay = None if scenarios.delay is None else jnp.asarray(scenarios.delay)
    slack, slope = _slacks(requirement, scenarios.friction, mass, delay, unit, jnp.asarray(x))
    low, high = region.lower / region.unit, np.minimum(region.upper / region.unit, 1e30)
    limits = np.concatenate([x - low, high - x])
    c = np.concatenate([np.asarray(slack), limits])
    return c, np.concatenate([np.asarray(slope), np.eye(2), -np.eye(2)])


@eqx.filter_jit
def _slacks(
    requirement: Requirement,
    friction: LinearFriction,
    mass: Float[Array, " n"] | None,
    delay: Float[Array, " n"] | None,
    unit: Float[Array, " 2"],
    x: Float[Array, " 2"],
) -> tuple[Float[Array, " k"], Float[Array, "k 2"]]:
    def all_of(x):
        def one(friction, mass, delay):
            return requirement.slack(x * unit, friction, mass, unit, delay)

        axes = (0, *(None if x is None else 0 for x in (mass, delay)))
        return jax.vmap(one, in_axes=axes)(friction, mass, delay).reshape(-1)

    return all_of(x), jax.jacfwd(all_of)(x)


def _near(here: _Model) -> np.ndarray:
    """Constraints that may be active: those that a small step would reach, and the limits.

    Of scenarios that answer alike one is enough: they would crowd out the others.
    """
    count = len(here.c) - _LIMITS
    size = np.maximum(np.linalg.norm(here.g, axis=1), 1e-300)
    distance, direction = here.c / size, here.g / size[:, None]
    chosen: list[int] = []
    for i in np.argsort(distance[:count]):
        new = [
            abs(distance[i] - distance[j]) > _ALIKE * abs(distance[i]) + 1e-300
            or np.max(np.abs(direction[i] - direction[j])) > _ALIKE
            for j in chosen
        ]
        if all(new):
            chosen.append(int(i))
        if len(chosen) == _LIKELY:
            break
    return np.asarray([*chosen, *range(count, count + _LIMITS)])


def _combinations(near: np.ndarray):
    singles = [(int(i),) for i in near]
    return [*singles, *itertools.combinations((int(i) for i in near), 2)]


def _multipliers(here: _Model, *, close: float = 1e-7) -> dict[int, float]:
    """Non-negative multipliers of the constraints met within `close` that balance best."""
    likely = _near(here)
    near = [i for i in likely if here.c[i] < close]
    if not near:
        near = [int(likely[np.argmin(here.c[likely])])]
    best, found = np.linalg.norm(here.p), {}
    for some in _combinations(np.asarray(near)):
        g = here.g[list(some)]
        m, *_ = np.linalg.lstsq(g.T, here.p, rcond=None)
        rest = np.linalg.norm(here.p - g.T @ m)
        if np.all(m >= 0) and rest < best * (1 - 1e-9) - 1e-15:
            best, found = rest, dict(zip(some, (float(v) for v in m), strict=True))
    return found


def _residual(here: _Model, multipliers: dict[int, float]) -> float:
    pull = sum((m * here.g[i] for i, m in multipliers.items()), start=np.zeros(2))
    return float(np.linalg.norm(here.p - pull) / np.linalg.norm(here.p))


def _curvature(model, x: np.ndarray, multipliers: dict[int, float]) -> np.ndarray:
    """Hessian of sum l_i c_i, by central differences of gradients."""
    columns = []
    for j in range(2):
        h = np.zeros(2)
        h[j] = _DIFFERENCE * max(abs(x[j]), 1e-3 * np.max(np.abs(x)))
        ahead, behind = model(x + h).g, model(x - h).g
        pull = sum((m * (ahead[i] - behind[i]) for i, m in multipliers.items()), np.zeros(2))
        columns.append(pull / (2 * h[j]))
    matrix = np.stack(columns, axis=1)
    return 0.5 * (matrix + matrix.T)


def _quadratic(here: _Model, bend: np.ndarray) -> np.ndarray:
    """The step that minimises p.d + d.H.d/2 under c + g.d >= 0, over the likely constraints."""
    near = _near(here)
    c, g = here.c[near], here.g[near]
    best, found = np.inf, np.full(2, np.nan)
    for some in _combinations(np.arange(near.size)):
        rows = list(some)
        n = len(rows)
        system = np.zeros((2 + n, 2 + n))
        system[:2, :2] = bend
        system[:2, 2:] = -g[rows].T
        system[2:, :2] = g[rows]
        try:
            solved = np.linalg.solve(system, np.concatenate([-here.p, -c[rows]]))
        except np.linalg.LinAlgError:
            continue
        step, m = solved[:2], solved[2:]
        allowed = np.all(c + g @ step >= -1e-9 * (1 + np.abs(c))) and np.all(m >= -1e-9)
        value = here.p @ step + 0.5 * step @ bend @ step
        if allowed and value < best:
            best, found = value, step
    return found
