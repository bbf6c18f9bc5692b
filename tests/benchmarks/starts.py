"""Does the fit find the global optimum without a start from the user?

    python tests/benchmarks/starts.py [--records 200] [--steps given]

Random synthetic records of `tests/generator.py` (A, B, L over a decade each, K/K_cr from 1.5 to
30, up, down and mixed steps, both laws). Steps are found in the record, as for a user who gives
none, or given. The optimum to compare with, for the same steps, is the best of 20 starts: the
truth, and 19 points scattered around it by a factor of up to three in A, B and L.
"""

import argparse
import sys
import time
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from generator import random_record

import jaxfric
from jaxfric.fitting.fit import steps_of
from jaxfric.fitting.solve import misfits, solve
from jaxfric.fitting.stages import prepare
from jaxfric.fitting.thresholds import FAILED_MISFIT

FIRST_SEED = 5_000
STARTS = 20


def one(seed: int, given: bool) -> tuple[bool, float, float, str]:
    """Whether the fit's cost is within 0.1 % of the best, both costs, and the fit's result."""
    record = random_record(seed)
    truth = record.truth
    exact = jaxfric.VelocitySteps(np.array(truth.starts), np.array(truth.velocities))
    measured = jaxfric.from_arrays(
        record.time, record.friction, load_point_displacement=record.load_point_displacement
    )
    steps = exact if given else steps_of(measured, None)
    fit = jaxfric.fit(
        measured, stiffness=record.stiffness, law=truth.law, steps=exact if given else None
    )
    problem = prepare(measured, steps, fit.model, stiffness=record.stiffness)
    scatter = np.random.default_rng(seed).uniform(-np.log(3), np.log(3), (STARTS, 3))
    scatter[0] = 0.0
    starts = np.tile([truth.f0, truth.A, truth.B, truth.L], (STARTS, 1))
    starts[:, 1:] *= np.exp(scatter)
    free = problem.coordinates.to_free(starts)
    scale = float(problem.noise_scale) ** 2
    able = free[misfits(problem, free) < FAILED_MISFIT**2]  # the others run away at once
    best = min(solve(problem, z[None], refine=1).cost for z in able) * scale
    return fit.sum_of_squares <= 1.001 * best, fit.sum_of_squares, best, fit.result


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--steps", default="found", choices=["found", "given"])
    options = parser.parse_args()
    begun, good, raised = time.perf_counter(), 0, 0
    for seed in range(FIRST_SEED, FIRST_SEED + options.records):
        try:
            reached, cost, best, result = one(seed, options.steps == "given")
        except Exception as error:
            raised += 1
            print(f"seed {seed} raised {error!r}")
            continue
        good += reached
        if not reached:
            print(f"seed {seed}: sum of squares {cost:.6g}, best {best:.6g} ({result})")
    print(
        f"global optimum reached in {good} of {options.records} records, {raised} raised; "
        f"{time.perf_counter() - begun:.0f} s"
    )


if __name__ == "__main__":
    main()
