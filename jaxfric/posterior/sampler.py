"""Draws of a log posterior by NUTS, in the form of blackjax. NUTS is the no-U-turn sampler of
Hoffman & Gelman (2014, JMLR 15, 1593).

Chains move in the variables and units of the Laplace approximation, y = y_MAP + R u. In these units
the posterior is roughly standard normal, so the mass matrix is the identity. Only the step size is
adapted. Chains run one after another. Parallel chains would all wait for the longest tree and the
slowest simulation, so parallel chains take longer on few cores. Each chain starts at a draw of the
Laplace approximation.
"""

import importlib.metadata
import importlib.util
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from ..silent import silent
from ..traced import traced
from .laplace import Laplace
from .target import Target, natural_of, point, value_and_gradient

MISSING = 'draws by NUTS need blackjax and arviz; install them: pip install "jaxfric[posterior]"'
_ACCEPTANCE, _NEAR_AN_END, _DOUBLINGS = 0.8, 0.9, 8
"""Acceptance that the step size is adapted to; where a uniform prior ends inside the posterior its
density falls steeply on one side, and shorter steps diverge less."""
_WARMUP = 250
"""Warm-up draws of a chain, which adapt the step size and are discarded."""
_SLACK, _HALVINGS = 50.0, 8
"""A start is moved halfway to the maximum, at most `_HALVINGS` times, while its log density is
`_SLACK` below that of the Laplace approximation."""


class Draws(NamedTuple):
    """Draws of all chains: parameters [SI] (c, n, p), variables y (c, n, q), and the sampler's
    diagnostics of each (c, n)."""

    values: np.ndarray
    y: np.ndarray
    log_density: np.ndarray
    diverging: np.ndarray
    acceptance: np.ndarray
    depth: np.ndarray
    steps: np.ndarray
    step_size: np.ndarray
    """Step size of every chain, in standard deviations."""


def require_blackjax() -> None:
    """Raise `InputError` if the sampler is not installed."""
    if any(importlib.util.find_spec(name) is None for name in ("arviz", "blackjax")):
        raise InputError(MISSING)


def nuts(
    about: Laplace,
    *,
    draws: int = 1000,
    chains: int = 4,
    seed: int = 0,
    warmup: int = _WARMUP,
    progress: Callable[[str], None] = silent,
) -> Draws:
    """Draw from a log posterior by NUTS, starting from its Laplace approximation `about`.

    Raises `InputError` if blackjax is not installed.
    """
    require_blackjax()
    target, y, root = about.target, jax.device_put(about.y), jax.device_put(about.root)
    aim = _NEAR_AN_END if about.cut else _ACCEPTANCE
    found, version = [], importlib.metadata.version("blackjax")
    for c in range(chains):
        progress(f"NUTS, chain {c + 1} of {chains}" + (", compiling first" if c == 0 else ""))
        first, key = jax.random.split(jax.random.fold_in(jax.random.PRNGKey(seed), c))
        begin = _start(about, np.asarray(jax.random.normal(first, (len(about.y),))))
        out = _chain(target, y, root, begin, key, (warmup, draws), aim, version)
        found.append([np.asarray(x) for x in out])
    position, density, told, size = (np.stack(x) for x in zip(*found, strict=True))
    every = jax.device_put((about.y + position @ about.root.T).reshape(-1, len(about.y)))
    values, ys = (
        np.asarray(x).reshape(*position.shape[:2], -1)
        for x in (natural_of(target, every), jax.vmap(target.unsheared)(every))
    )
    diverging, acceptance, depth, steps = np.moveaxis(told, -1, 0)
    counts = depth.astype(int), steps.astype(int)
    return Draws(values, ys, density, diverging > 0, acceptance, *counts, size)


def _start(about: Laplace, u: np.ndarray) -> tuple[Array, Array, Array]:
    """Start at a draw of the Laplace approximation, moved towards the maximum if the posterior is
    negligible there; return it with log density and gradient."""
    target = about.target
    at = point(target, jax.device_put(about.y + about.root @ u))
    for _ in range(_HALVINGS):
        if float(at.log_density) > about.log_density - _SLACK - 0.5 * float(u @ u):
            break
        u = 0.5 * u
        at = point(target, jax.device_put(about.y + about.root @ u))
    slope = about.root.T @ np.asarray(at.gradient)
    return jax.device_put(u), jax.device_put(np.asarray(at.log_density)), jax.device_put(slope)


def _log_density(
    target: Target, y: Float[Array, " q"], root: Float[Array, "q q"]
) -> Callable[[Float[Array, " q"]], Float[Array, ""]]:
    """The log posterior in units of standard errors; one solve gives value and gradient."""

    def both(u: Array) -> tuple[Array, Array]:
        value, slope = value_and_gradient(target, y + root @ u)
        good = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope))
        return jnp.where(good, value, -jnp.inf), jnp.where(good, slope @ root, 0.0)

    @jax.custom_vjp
    def density(u: Array) -> Array:
        return both(u)[0]

    density.defvjp(both, lambda slope, g: (g * slope,))
    return density


@traced
def _chain(
    target: Target,
    y: Float[Array, " q"],
    root: Float[Array, "q q"],
    begin: tuple[Float[Array, " q"], Float[Array, ""], Float[Array, " q"]],
    key: Array,
    counts: tuple[int, int],
    acceptance: float,
    version: str,
) -> tuple[Array, Array, Array, Array]:
    """Run one chain from `begin`: a position, its log density and its gradient.

    `counts` are the numbers of warm-up and of kept draws; the step size is adapted to `acceptance`.
    Returns positions, log densities and
    diagnostics of the kept draws, and the step size. The cached trace depends on `version`."""
    from blackjax.adaptation import step_size
    from blackjax.mcmc import hmc
    from blackjax.mcmc import nuts as sampler

    density, kernel = _log_density(target, y, root), sampler.build_kernel()
    start, adapt, end = step_size.dual_averaging_adaptation(acceptance)
    mass, warmup = jnp.ones_like(y), counts[0]

    def draw(carry: tuple, turn: tuple[Array, Array]) -> tuple[tuple, tuple]:
        state, sizes = carry
        number, key = turn
        warming = number < warmup
        size = jnp.where(warming, jnp.exp(sizes.log_step_size), end(sizes))
        state, info = kernel(key, state, density, size, mass, _DOUBLINGS)
        adapted = adapt(sizes, info.acceptance_rate)
        sizes = jax.tree.map(lambda new, old: jnp.where(warming, new, old), adapted, sizes)
        told = info.is_divergent, info.acceptance_rate
        told += info.num_trajectory_expansions, info.num_integration_steps
        return (state, sizes), (state.position, state.logdensity, jnp.stack([*map(_real, told)]))

    turns = jnp.arange(sum(counts)), jax.random.split(key, sum(counts))
    # blackjax annotates traced numbers as floats
    begun = hmc.HMCState(*begin)  # ty: ignore[invalid-argument-type]
    first = begun, jax.tree.map(_real, start(acceptance))
    (_, sizes), out = jax.lax.scan(draw, first, turns)
    position, log_density, told = (x[warmup:] for x in out)
    return position, log_density, told, jnp.asarray(end(sizes))


def _real(x: Array | float) -> Array:
    return jnp.asarray(x, float)
