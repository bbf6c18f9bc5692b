"""How fast are the roots and the counts of the delay law?

    python tests/benchmarks/delay.py [--points 20000]

Random sliders, alpha sqrt(k_p/m) from 0.1 to 60: the rightmost root in a batch, six roots, the
decay rate with its gradient in five arguments, the number of unstable roots, the intervals.
`peers.py` has tdscontrol beside the rightmost root.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

from jaxfric.stability.delay import stable_intervals, unstable_roots
from jaxfric.stability.delay_roots import rightmost_roots


def sliders(number: int, seed: int = 1) -> np.ndarray:
    """mass, k_p, k_v, k_f, alpha: shape (5, number)."""
    rng = np.random.default_rng(seed)
    mass, alpha = 10 ** rng.uniform(-1, 1, number), 10 ** rng.uniform(-2, 1, number)
    k_p = mass * (10 ** rng.uniform(-1, np.log10(60.0), number) / alpha) ** 2
    k_f = mass / alpha * 10 ** rng.uniform(-1, 1.7, number)
    return np.stack([mass, k_p, k_f * rng.uniform(-1.2, 1.2, number), k_f, alpha])


def report(name: str, function, cases, repeats: int = 7) -> None:
    compiled = jax.jit(jax.vmap(function))
    jax.block_until_ready(compiled(*cases))
    spent = []
    for _ in range(repeats):
        begun = time.perf_counter()
        jax.block_until_ready(compiled(*cases))
        spent.append((time.perf_counter() - begun) / cases.shape[1] * 1e6)
    middle, low, high = np.median(spent), min(spent), max(spent)
    print(f"{name:28s} {middle:9.3f} us a point   ({low:.3f} to {high:.3f})", flush=True)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=20000)
    cases = sliders(parser.parse_args().points)
    report("rightmost root", rightmost_roots, cases)
    report("six roots", lambda *values: rightmost_roots(*values, number=6), cases)
    decay_rate = lambda *values: -rightmost_roots(*values)[0].real  # noqa: E731
    slopes = jax.value_and_grad(decay_rate, argnums=(0, 1, 2, 3, 4))
    report("decay rate and its gradient", slopes, cases)
    report("number of unstable roots", unstable_roots, cases)
    report(
        "four stable intervals",
        lambda m, _, *rest: jnp.stack(stable_intervals(m, *rest, number=4)),
        cases,
    )


if __name__ == "__main__":
    main()
