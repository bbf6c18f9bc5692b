"""Do the 95 % intervals of A, B and L contain the truth 95 % of the time?

    python tests/benchmarks/coverage.py [--records 300] [--weighting ordinary] [--steps given]

Synthetic records of `tests/generator.py` (SciPy, none of jaxfric's code), stiffness from 3 to 30
times K_cr, 1000 to 1500 samples. Three kinds of noise of standard deviation 3e-4: white; and half
of the variance exponentially correlated, with a correlation time of 1 % and of 5 % of the record.
Steps are found in the record, as for a user who gives none, or given.
"""

import argparse
import sys
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from generator import random_record

import jaxfric

FIRST_SEED = 20_000
SIGMA = 3e-4
NOISES = {
    "white": dict(white=SIGMA),
    "correlated 1 %": dict(white=SIGMA / 2**0.5, correlated=SIGMA / 2**0.5, correlation=0.01),
    "correlated 5 %": dict(white=SIGMA / 2**0.5, correlated=SIGMA / 2**0.5, correlation=0.05),
}


def coverage(
    noise: str,
    records: int,
    weighting: str,
    first_seed: int = FIRST_SEED,
    *,
    given: bool = True,
) -> dict[str, tuple[float, float]]:
    """Share of intervals that contain the truth, and median of std/true error scale, by name."""
    inside: dict[str, list[bool]] = {"A": [], "B": [], "L": []}
    score: dict[str, list[float]] = {"A": [], "B": [], "L": []}
    for seed in range(first_seed, first_seed + records):
        record = random_record(
            seed, stiffness_ratio=(3.0, 30.0), samples=(1000, 1500), **NOISES[noise]
        )
        truth = record.truth
        steps = jaxfric.VelocitySteps(np.array(truth.starts), np.array(truth.velocities))
        measured = jaxfric.from_arrays(
            record.time, record.friction, load_point_displacement=record.load_point_displacement
        )
        fit = jaxfric.fit(
            measured,
            stiffness=record.stiffness,
            law=truth.law,
            steps=steps if given else None,
            weighting=weighting,
        )
        for name in inside:
            estimate, true = fit.parameters[name], getattr(truth, name)
            inside[name].append(estimate.lower <= true <= estimate.upper)
            score[name].append((estimate.value - true) / estimate.std)
    return {
        name: (float(np.mean(inside[name])), float(1.4826 * np.median(np.abs(score[name]))))
        for name in inside
    }


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=300)
    parser.add_argument("--steps", default="found", choices=["found", "given"])
    parser.add_argument("--weighting", default="ordinary", choices=["ordinary", "whitened"])
    options = parser.parse_args()
    words = f"{options.weighting} least squares, steps {options.steps}"
    print(f"{options.records} records each, {words}")
    print("noise             coverage of A      B      L     spread of (fit - truth)/std  A  B  L")
    for noise in NOISES:
        given = options.steps == "given"
        found = coverage(noise, options.records, options.weighting, given=given)
        share = "  ".join(f"{100 * found[n][0]:5.1f}" for n in "ABL")
        spread = "  ".join(f"{found[n][1]:.2f}" for n in "ABL")
        print(f"{noise:16s}  {share} %   {spread}", flush=True)


if __name__ == "__main__":
    main()
