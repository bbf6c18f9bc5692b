"""How long the least gains of many laws take at once, and how far they are from `find_gains`.

    python -m fits.many_gains [--laws 100] [--scenarios 64] [--margin stiffness=1.5] [--check 3]

Slip laws drawn at random; each with all scenarios, of which the velocity and the mass differ. The
laws are one batch of `jax.vmap`.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

import jaxfric as jf
from jaxfric.gains import DERIVATIVE, GAINS, MinimumGains


def law_of(A: jax.Array, B: jax.Array, L: jax.Array) -> jf.RateState:
    """A slip law of one state about 2 mm/s."""
    return jf.RateState(50.0, A, B[None], L[None], 2e-3)


def main() -> None:
    """Time the batch cold and warm, and compare some of it with `find_gains`."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laws", type=int, default=100)
    parser.add_argument("--scenarios", type=int, default=64)
    parser.add_argument("--margin", default="stiffness=1.5")
    parser.add_argument("--check", type=int, default=3)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(0)
    A = 10 ** rng.uniform(-0.5, 0.5, asked.laws)
    B, L = A * rng.uniform(1.5, 5, asked.laws), 10 ** rng.uniform(-4, -2.5, asked.laws)
    side = max(1, int(asked.scenarios**0.5))
    velocities = np.geomspace(1e-3, 1e-2, -(-asked.scenarios // side))
    masses = np.linspace(1, 3, side)
    pairs = np.stack(np.meshgrid(velocities, masses, indexing="ij"), -1).reshape(-1, 2)
    name, _, value = asked.margin.partition("=")
    margin = {name: float(value)}

    @jax.jit
    @jax.vmap
    def batch(A: jax.Array, B: jax.Array, L: jax.Array) -> MinimumGains:
        return jf.minimum_gains(law_of(A, B, L), pairs[:, 0], pairs[:, 1], margin)

    print(f"{asked.laws} laws x {len(pairs)} scenarios, {asked.margin}")
    for what in ("cold", "warm"):
        begun = time.perf_counter()
        found = jax.block_until_ready(batch(*map(jnp.asarray, (A, B, L))))
        print(f"{what}: {time.perf_counter() - begun:.3g} s")
    for kind, codes in ((GAINS, found.result), (DERIVATIVE, found.derivative)):
        values, counts = np.unique(np.asarray(codes._value), return_counts=True)
        for code, count in zip(values, counts, strict=True):
            print(f"{count}: {kind.__name__} {code}")
    worst = 0.0
    for i in range(min(asked.check, asked.laws)):
        known = jf.find_gains(
            law_of(*(jnp.asarray(x[i]) for x in (A, B, L))),
            velocity=velocities,
            mass=masses,
            margin=margin,
        )
        print(f"norm {float(found.norm[i]):.8g}, by find_gains {known.norm:.8g}")
        worst = max(worst, abs(float(found.norm[i]) / known.norm - 1))
    print(f"largest relative difference of the norm: {worst:.2g}")


if __name__ == "__main__":
    main()
