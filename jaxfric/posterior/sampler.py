"""Draws of a log posterior by NUTS, the no-U-turn sampler of Hoffman & Gelman (2014, JMLR 15, 1593)
in the form of blackjax.

Chains move in the units of the Laplace approximation, y = y_MAP + R u, where the posterior is about
a standard normal law, so the mass matrix is the identity and only the step size is adapted. They
run one after another: side by side all would wait for the longest tree and the slowest simulation
of them, which takes longer on few cores. Each chain starts at a draw of the Laplace approximation.
"""

import importlib.util
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from .laplace import Laplace
from .target import Target, natural_of, value_and_gradient

MISSING = 'draws by NUTS need blackjax and arviz; install them: pip install "jaxfric[posterior]"'
_ACCEPTANCE, _DOUBLINGS = 0.8, 8
_WARMUP = 250
"""Draws at the begin of a chain in which the step size is adapted; they are not kept."""
_SLACK = 50.0
"""A start whose log density is so much below the maximum, beyond its share of chance, is moved
towards the maximum."""


class Draws(NamedTuple):
    """Draws of all chains: parameters [SI] (c, n, p), variables y (c, n, q), and what the sampler
    says of each (c, n)."""

    values: np.ndarray
    y: np.ndarray
    log_density: np.ndarray
    diverging: np.ndarray
    acceptance: np.ndarray
    depth: np.ndarray
    steps: np.ndarray
    step_size: np.ndarray
    """Of every chain, in standard deviations."""


def require_blackjax() -> None:
    """Raises `InputError` where the sampler is not installed."""
    if any(importlib.util.find_spec(name) is None for name in ("arviz", "blackjax")):
        raise InputError(MISSING)


def nuts(
    target: Target,
    about: Laplace,
    *,
    draws: int = 1000,
    chains: int = 4,
    seed: int = 0,
    warmup: int = _WARMUP,
    progress: Callable[[str], None] = lambda text: None,
) -> Draws:
    """NUTS from the Laplace approximation `about` of a target.

    Raises `InputError` where blackjax is not installed.
    """
    require_blackjax()
    y, root = jax.device_put(about.y), jax.device_put(about.root)
    found = []
    for c in range(chains):
        progress(f"NUTS, chain {c + 1} of {chains}" + (", compiling first" if c == 0 else ""))
        start, key = jax.random.split(jax.random.fold_in(jax.random.key(seed), c))
        u = _start(target, about, np.asarray(jax.random.normal(start, (len(about.y),))))
        found.append(jax.tree.map(np.asarray, _chain(target, y, root, u, key, warmup, draws)))
    position, density, info, size = (np.stack(x) for x in zip(*map(_flat, found), strict=True))
    ys = about.y + position @ about.root.T
    values = natural_of(target, jax.device_put(ys.reshape(-1, len(about.y))))
    values = np.asarray(values).reshape(*ys.shape[:2], -1)
    diverging, acceptance, depth, steps = np.moveaxis(info, -1, 0)
    counts = depth.astype(int), steps.astype(int)
    return Draws(values, ys, density, diverging > 0, acceptance, *counts, size)


def _flat(out: tuple[np.ndarray, np.ndarray, tuple, np.ndarray]) -> tuple[np.ndarray, ...]:
    position, density, info, size = out
    return position, density, np.stack([np.asarray(x, float) for x in info], axis=-1), size


def _start(target: Target, about: Laplace, u: np.ndarray) -> Array:
    """A draw of the Laplace approximation, nearer to the maximum where the posterior has none."""
    allowed = about.log_density - _SLACK
    for _ in range(8):
        value = _value(target, jax.device_put(about.y + about.root @ u))
        if float(value) > allowed - 0.5 * float(u @ u):
            break
        u = 0.5 * u
    return jax.device_put(u)


@eqx.filter_jit
def _value(target: Target, y: Float[Array, " q"]) -> Float[Array, ""]:
    return value_and_gradient(target, y)[0]


def _log_density(
    target: Target, y: Float[Array, " q"], root: Float[Array, "q q"]
) -> Callable[[Float[Array, " q"]], Float[Array, ""]]:
    """The log posterior in units of standard errors, whose gradient comes with its value."""

    def both(u: Array) -> tuple[Array, Array]:
        value, slope = value_and_gradient(target, y + root @ u)
        good = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope))
        return jnp.where(good, value, -jnp.inf), jnp.where(good, slope @ root, 0.0)

    @jax.custom_vjp
    def density(u: Array) -> Array:
        return both(u)[0]

    density.defvjp(both, lambda slope, g: (g * slope,))
    return density


@eqx.filter_jit
def _chain(
    target: Target,
    y: Float[Array, " q"],
    root: Float[Array, "q q"],
    u: Float[Array, " q"],
    key: Array,
    warmup: int,
    draws: int,
) -> tuple[Array, Array, tuple, Array]:
    """One chain from `u`: positions, log densities, what the sampler says, and its step size."""
    from blackjax.adaptation.step_size import dual_averaging_adaptation
    from blackjax.mcmc import nuts as sampler

    density, kernel = _log_density(target, y, root), sampler.build_kernel()
    begin, adapt, end = dual_averaging_adaptation(_ACCEPTANCE)
    mass = jnp.ones_like(u)

    def warm(carry: tuple, key: Array) -> tuple[tuple, None]:
        state, sizes = carry
        size = jnp.exp(sizes.log_step_size)
        state, info = kernel(key, state, density, size, mass, _DOUBLINGS)
        return (state, adapt(sizes, info.acceptance_rate)), None

    first, second = jax.random.split(key)
    state = sampler.init(u, density)
    keys = jax.random.split(first, warmup)
    (state, sizes), _ = jax.lax.scan(warm, (state, begin(_ACCEPTANCE)), keys)
    size = end(sizes)

    def draw(state: tuple, key: Array) -> tuple:
        state, info = kernel(key, state, density, size, mass, _DOUBLINGS)
        told = info.is_divergent, info.acceptance_rate
        told += info.num_trajectory_expansions, info.num_integration_steps
        return state, (state.position, state.logdensity, told)

    _, (position, log_density, told) = jax.lax.scan(draw, state, jax.random.split(second, draws))
    return position, log_density, told, size
