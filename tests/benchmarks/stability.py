"""How many sliders a second do margins, closed form and generic theorem treat?

    python tests/benchmarks/stability.py

One line per number, on all cores, compiled and warm: the best of five batches. Sliders with mass
and one-state (or two-state) friction over wide ranges, about half of them stable.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np

from jaxfric.stability.kernel import FunctionKernel, StateSpaceKernel
from jaxfric.stability.linear import LinearFriction, LinearSlider
from jaxfric.stability.margin_table import MARGINS
from jaxfric.stability.margins import margins, stability_margin
from jaxfric.stability.theorem import critical_points, rice_ruina_criterion

LOW = np.log([1e-1, 1e-1, 1e-5, 1e-5, 0.1, 1e-2, 1.0])
HIGH = np.log([10.0, 10.0, 1e-2, 1e-2, 10.0, 10.0, 1e5])


def sets(n: int) -> jax.Array:
    """Rows of A, B, L, V, m, k_v, k_p."""
    rng = np.random.default_rng(0)
    return jnp.asarray(np.exp(rng.uniform(LOW, HIGH, (n, 7))))


def exponentials(g: jax.Array, r: jax.Array) -> StateSpaceKernel:
    """The kernel g(t) = sum_i g_i exp(-r_i t)."""
    return StateSpaceKernel(jnp.diag(-r), jnp.ones_like(r), g)


def slider(p, states: int) -> LinearSlider:
    A, B, L, V, m, k_v, k_p = p
    share, length = jnp.array([1.0, 0.4])[:states], jnp.array([1.0, 7.0])[:states]
    kernel = exponentials(B * share / (L * length), V / (L * length))
    friction = LinearFriction(A / V, kernel, jnp.zeros_like(A))
    return LinearSlider(m, k_p, k_v, friction)


def rate(function, *arguments) -> float:
    """Rows per second."""
    function = jax.jit(function)
    jax.block_until_ready(function(*arguments))
    best = np.inf
    for _ in range(5):
        begun = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        best = min(best, time.perf_counter() - begun)
    return len(arguments[0]) / best


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    rows = sets(1 << 15)
    for states in (1, 2):
        for name in MARGINS:
            speed = rate(
                jax.vmap(lambda p, name=name, n=states: stability_margin(name, slider(p, n))), rows
            )
            print(f"margin {name:9s} {states} state(s): {speed:9.3g} per second")
        speed = rate(jax.vmap(lambda p, n=states: margins(slider(p, n))), rows)
        print(f"all seven margins, {states} state(s): {speed:.3g} per second")
    damping = jnp.asarray(np.random.default_rng(1).uniform(0.01, 0.99, 1 << 14))
    mass = jnp.ones_like(damping)
    exponential = exponentials(jnp.ones(1), jnp.ones(1))
    sampled = FunctionKernel(lambda t: jnp.exp(-t), 40.0)
    options = {"number": 4, "points": 512}
    search = jax.vmap(lambda d, m: critical_points(exponential, d, m, **options))
    print(f"generic search, exponential kernel: {rate(search, damping, mass):.3g} per second")
    table = jax.vmap(lambda d, m: rice_ruina_criterion(sampled, d, m))
    print(
        f"theorem, one function g(t), many k_v and m: {rate(table, damping, mass):.3g} per second"
    )
    slope = jax.vmap(jax.grad(lambda d, m: rice_ruina_criterion(sampled, d, m).critical_stiffness))
    print(f"its derivative by k_v: {rate(slope, damping, mass):.3g} per second")


if __name__ == "__main__":
    main()
