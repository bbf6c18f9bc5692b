"""The least gains of many laws at once: how long they take, and whether they are `find_gains`'s.

    python -m fits.many_gains [--laws 1000] [--scenarios 64] [--margin modulus=0.5] [--every]

First, 5 laws for each of some margins, with and without mass, at two velocities: `minimum_gains`
of them in one batch, `find_gains` one by one. With --every it is 50 laws under ten requirements.
Where `find_gains` adds a velocity between the given ones, both are asked with that velocity, too.
Then the time of a batch of all laws with all scenarios, with what is compiled and without.
"""

import argparse
import time
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

import jaxfric as jf
from jaxfric.gains import DERIVATIVE, GAINS, MinimumGains

MARGINS = {"modulus": 0.5, "decay": 0.3, "damping": 0.1, "gain": 2.0, "phase": 0.5}
"""What is required; of decay by the slowest V/L."""
FEW = (("modulus", True), ("decay", True), ("decay", False))
EACH = 5
_AT_ONCE = 250
VELOCITIES, MASSES = np.asarray([1e-3, 4e-3]), np.asarray([1.0, 3.0])


def law_of(A: jax.Array, B: jax.Array, L: jax.Array) -> jf.RateState:
    """A slip law of one state about 2 mm/s."""
    return jf.RateState(50.0, A, B[None], L[None], 2e-3)


def drawn(number: int, seed: int = 0) -> tuple[jax.Array, ...]:
    """A, B and L of some laws."""
    rng = np.random.default_rng(seed)
    A = 10 ** rng.uniform(-0.5, 0.5, number)
    B, L = A * rng.uniform(1.5, 5, number), 10 ** rng.uniform(-4, -2.5, number)
    return jnp.asarray(A), jnp.asarray(B), jnp.asarray(L)


def scenarios(velocities: np.ndarray, masses: np.ndarray | None) -> tuple:
    """All pairs of a velocity and a mass."""
    if masses is None:
        return velocities, None
    V, m = np.meshgrid(velocities, masses, indexing="ij")
    return V.ravel(), m.ravel()


def of(name: str, L: jax.Array) -> Mapping[str, jax.Array | float]:
    """The requirement of a law, that margin alone."""
    least = MARGINS[name] * (VELOCITIES[0] / L if name == "decay" else 1.0)
    return {"modulus": 0.0, name: least}


def compared(name: str, masses: np.ndarray | None, seed: int) -> tuple[float, float]:
    """Largest relative differences of the norm, and of the gains (over the norm), of some laws.

    Of those of which `minimum_gains` says that it found the optimum.
    """
    laws = drawn(EACH, seed)

    @jax.jit
    @jax.vmap
    def batch(V: jax.Array, A: jax.Array, B: jax.Array, L: jax.Array) -> MinimumGains:
        _, m = scenarios(VELOCITIES, masses)
        return jf.minimum_gains(law_of(A, B, L), V, m, of(name, L))

    V = np.tile(scenarios(VELOCITIES, masses)[0], (EACH, 1))
    found, worst = batch(V, *laws), [0.0, 0.0]
    for i, (A, B, L) in enumerate(zip(*laws, strict=True)):
        asked = {k: float(x) for k, x in of(name, L).items()}
        law = law_of(A, B, L)
        given = VELOCITIES
        try:
            known = jf.find_gains(law, velocity=given, mass=masses, margin=asked)
        except jf.InputError:
            known = None
        got = jax.tree.map(lambda x, i=i: x[i], found)
        if known is not None and len(known.scenarios) > V.shape[1]:
            given = np.unique(known.scenarios.velocity)
            got = jf.minimum_gains(law, *scenarios(given, masses), asked)
            known = jf.find_gains(law, velocity=given, mass=masses, margin=asked)
        ended, code = int(got.result._value), int(got.derivative._value)
        if known is None or ended not in (GAINS.optimal._value, GAINS.none_needed._value):
            other = "none" if known is None else f"{known.norm:.8g}"
            print(f"  {name}: norm {float(got.norm):.8g} (result {ended}), find_gains: {other}")
            continue
        s_p, s_v = known.region.scale
        apart = np.hypot((got.k_p - known.kp) / s_p, (got.k_v - known.kv) / s_v) / known.norm
        norm = abs(float(got.norm) / known.norm - 1)
        print(
            f"  {name}: norm {known.norm:.8g}, off by {norm:.1e}, gains by {apart:.1e}"
            f" (result {ended}, derivative {code}, {len(given)} velocities, kkt"
            f" {known.certificate.kkt_residual:.1e})",
            flush=True,
        )
        worst = [max(worst[0], norm), max(worst[1], float(apart))]
    return worst[0], worst[1]


def timed(number: int, size: int, margin: Mapping[str, float]) -> None:
    """Time a batch cold and warm."""
    laws, side = drawn(number), max(1, int(size**0.5))
    pairs = scenarios(np.geomspace(1e-3, 1e-2, -(-size // side)), np.linspace(1, 3, side))

    @jax.jit
    def batch(*laws: jax.Array) -> MinimumGains:
        # a batch lasts as long as its slowest member, so a few are quicker than one of all
        def one(law: tuple[jax.Array, ...]) -> MinimumGains:
            return jf.minimum_gains(law_of(*law), *pairs, margin)

        return jax.lax.map(one, laws, batch_size=_AT_ONCE)

    print(f"{number} laws x {len(pairs[0])} scenarios, {margin}, {_AT_ONCE} at once")
    for what in ("cold", "warm"):
        begun, cpu = time.perf_counter(), time.process_time()
        found = jax.block_until_ready(batch(*laws))
        wall, cpu = time.perf_counter() - begun, time.process_time() - cpu
        print(f"{what}: {wall:.3g} s ({cpu:.3g} s of processors)", flush=True)
    for kind, codes in ((GAINS, found.result), (DERIVATIVE, found.derivative)):
        values, counts = np.unique(np.asarray(codes._value), return_counts=True)
        for code, count in zip(values, counts, strict=True):
            print(f"{count}: {kind.__name__} {code}")


def main() -> None:
    """Compare some laws, then time all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laws", type=int, default=1000)
    parser.add_argument("--scenarios", type=int, default=64)
    parser.add_argument("--margin", default="modulus=0.5")
    parser.add_argument("--every", action="store_true")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    every = [(name, heavy) for name in MARGINS for heavy in (True, False)]
    worst = np.zeros(2)
    for seed, (name, heavy) in enumerate(every if asked.every else FEW):
        print(f"{name}, {'with' if heavy else 'without'} mass")
        worst = np.maximum(worst, compared(name, MASSES if heavy else None, seed))
    print(f"largest relative difference of norms {worst[0]:.1e}, of gains {worst[1]:.1e}")
    name, _, value = asked.margin.partition("=")
    timed(asked.laws, asked.scenarios, {name: float(value)})


if __name__ == "__main__":
    main()
