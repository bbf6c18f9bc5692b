"""How long does one simulation take, its Jacobian, and a check of gains by simulation?

    python tests/benchmarks/simulation.py

Warm calls, compiled as the command compiles, in 64 bit, on one thread. A tenfold step without mass:
its friction at 2000 samples, all that a trajectory has, the friction's Jacobian by (A, B, L, K),
and one of a batch of 256 at 100 samples. With mass: a stick-slip simulation and a tenfold step
(301 samples), the five standard starts of one rig. A delay law over 50 delays, alone and in a
batch of 256.
"""

import os
import time

os.environ.setdefault("NPROC", "1")  # read when JAX starts

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxfric as jf
from jaxfric.cli.xla import whole_loops

UM = 1e-6
LAW = (0.6, 0.010, [0.015], [10 * UM], UM)


def report(
    name: str, function, *arguments, repeats: int = 9, calls: int = 1, members: int = 1
) -> float:
    """Prints the median of repeats, each a mean of calls; returns it [ms]."""
    begun = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    first = time.perf_counter() - begun
    spent = []
    for _ in range(repeats):
        begun = time.perf_counter()
        for _ in range(calls):
            jax.block_until_ready(function(*arguments))
        spent.append((time.perf_counter() - begun) / (calls * members) * 1e3)
    middle, low, high = np.median(spent), min(spent), max(spent)
    print(
        f"{name:32s} {middle:8.3f} ms each   ({low:.3f} to {high:.3f}); first call {first:.1f} s",
        flush=True,
    )
    return float(middle)


def without_mass() -> None:
    """The record of `speed.py`: A .010, B .014, L 20 um, K 1e-3/um, 1 to 10 um/s after 10 s."""
    step = jf.PiecewiseVelocity([0.0, 10.0], [UM, 10 * UM])
    values = jnp.array([0.010, 0.014, 20 * UM, 1e3])

    def motion(values, ts):
        A, B, L, K = values
        rig = jf.Rig(jf.QuasiStatic(K), jf.RateState(0.6, A, [B], [L], UM))
        return jf.simulate(rig, step, ts)

    ts, few = jnp.linspace(0.0, 30.0, 2000), jnp.linspace(0.0, 30.0, 100)
    force = jax.jit(lambda values: motion(values, ts).force)
    one = report("tenfold step, friction", force, values, calls=50)
    whole = eqx.filter_jit(lambda values: motion(values, ts))
    report("the same, all of a trajectory", whole, values, calls=50)
    slopes = jax.jit(jax.jacfwd(lambda values: motion(values, ts).force))
    four = report("the same, friction's Jacobian", slopes, values, calls=50)
    print(f"{'':32s} {four / one:8.2f} times its friction")
    many = jax.jit(jax.vmap(lambda values: motion(values, few).force))
    batch = values * jnp.linspace(0.95, 1.05, 256)[:, None]
    report("tenfold step, batch of 256", many, batch, calls=5, members=256)


def with_mass() -> None:
    law = jf.RateState(*LAW, evolution=jf.AgeingEvolution(), direct=jf.RegularisedEffect())
    step = jf.PiecewiseVelocity([0.0, 10.0], [UM, 10 * UM])
    ts = jnp.linspace(0.0, 100.0, 301)
    simulate = eqx.filter_jit(lambda rig: jf.simulate(rig, step, ts).force)
    report("tenfold step, with mass", simulate, jf.Rig(jf.Inertial(100.0, 2e3), law))
    report("tenfold step, stick-slip", simulate, jf.Rig(jf.Inertial(100.0, 3e2), law))


def with_delay() -> None:
    """The slider of the paper's delay example: m = 1, k_f = 0.5, k_v = 0.2, alpha = 0.3."""
    ts = jnp.linspace(0.0, 15.0, 301)

    def simulate(k):
        rig = jf.Rig(jf.Inertial(1.0, k, 0.2), jf.HessSoom(0.1, 1.2, 1.0, 0.3))
        return jf.simulate_delay(rig, 1.0, ts, start=jf.InitialState(1.1), intervals=50).velocity

    report("delay law, 50 delays", jax.jit(simulate), jnp.asarray(100.0))
    batch = jnp.linspace(20.0, 280.0, 256)
    report("delay law, batch of 256", jax.jit(jax.vmap(simulate)), batch, members=256)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    whole_loops()
    without_mass()
    with_mass()
    with_delay()
