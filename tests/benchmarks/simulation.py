"""How long does one simulation take, and a check of gains by simulation?

    python tests/benchmarks/simulation.py

Warm calls, compiled, in 64 bit: one stick-slip simulation with mass and a tenfold step with mass
(301 samples), the five standard starts of one rig, and a delay law over 50 delays, alone and in a
batch of 256.
"""

import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxfric as jf
from jaxfric.gains.check import check_starts

UM = 1e-6
LAW = (0.6, 0.010, [0.015], [10 * UM], UM)


def report(name: str, function, *arguments, repeats: int = 9, members: int = 1) -> None:
    begun = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    first = time.perf_counter() - begun
    spent = []
    for _ in range(repeats):
        begun = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        spent.append((time.perf_counter() - begun) / members * 1e3)
    middle, low, high = np.median(spent), min(spent), max(spent)
    print(
        f"{name:32s} {middle:8.3f} ms each   ({low:.3f} to {high:.3f}); first call {first:.1f} s",
        flush=True,
    )


def with_mass() -> None:
    law = jf.RateState(*LAW, evolution=jf.AgeingEvolution(), direct=jf.RegularisedEffect())
    step = jf.PiecewiseVelocity([0.0, 10.0], [UM, 10 * UM])
    ts = jnp.linspace(0.0, 100.0, 301)
    simulate = eqx.filter_jit(lambda rig: jf.simulate(rig, step, ts).force)
    report("tenfold step, with mass", simulate, jf.Rig(jf.Inertial(100.0, 2e3), law))
    report("tenfold step, stick-slip", simulate, jf.Rig(jf.Inertial(100.0, 3e2), law))
    for name, stiffness in (("five starts, steady", 1.5e3), ("five starts, stick-slip", 3e2)):
        rig = jf.Rig(jf.Inertial(100.0, stiffness), law)
        report(name, lambda rig: check_starts(rig, UM, horizon=2000.0).period, rig)


def with_delay() -> None:
    """The slider of the paper's delay example: m = 1, k_f = 0.5, k_v = 0.2, alpha = 0.3."""
    ts = jnp.linspace(0.0, 15.0, 301)

    def simulate(k):
        rig = jf.Rig(jf.Inertial(1.0, k, 0.2), jf.HessSoom(0.1, 1.2, 1.0, 0.3))
        return jf.simulate_delay(rig, 1.0, ts, start=jf.Start(1.1), intervals=50).velocity

    report("delay law, 50 delays", jax.jit(simulate), jnp.asarray(100.0))
    batch = jnp.linspace(20.0, 280.0, 256)
    report("delay law, batch of 256", jax.jit(jax.vmap(simulate)), batch, members=256)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    with_mass()
    with_delay()
