"""`python -m fits.many [--records N]`: time of `jaxfric.fit_many`, and share at the maximum.

Each record is a step by a factor of 3 to 10 with 500 rows and white noise, made by SciPy's LSODA.
A fit is at the maximum of the likelihood where a descent from the true parameters ends no lower.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

ROWS, NOISE = 500, 3e-4


def made(seed: int) -> tuple[np.ndarray, np.ndarray, tuple, dict[str, float], float]:
    """Time, friction, steps, true parameters and stiffness of a record of the slip law. SI."""
    rng = np.random.default_rng(seed)
    A = rng.uniform(0.005, 0.015)
    B, L, V0 = A * rng.uniform(1.1, 1.8), 10 ** rng.uniform(-5.3, -4.6), 1e-6
    factor = 10 ** rng.uniform(0.5, 1.0)
    K = 10 ** rng.uniform(0.7, 1.3) * (B - A) / L
    first, last = 5 * L / V0, 25 * L / (factor * V0)
    ts = np.linspace(0.0, first + last, ROWS)

    def rate(_: float, y: np.ndarray) -> list[float]:
        V = V0 * np.exp(y[0])
        change = -V / L * (y[1] + B * y[0])
        return [(K * (factor * V0 - V) - change) / A, change]

    after = ts[ts > first]
    how = {
        "method": "LSODA",
        "rtol": 1e-9,
        "atol": 1e-11,
        "t_eval": np.minimum(after - first, last),
    }
    y = solve_ivp(rate, (0.0, last), [0.0, 0.0], **how).y
    friction = np.full(ROWS, 0.6)
    friction[ts > first] += A * y[0] + y[1]
    friction += NOISE * rng.standard_normal(ROWS)
    steps = (np.array([0.0, first]), np.array([V0, factor * V0]))
    return ts, friction, steps, {"f0": 0.6, "A": A, "B": B, "L": L}, K


def main() -> None:
    """Make, fit and count."""
    parser = argparse.ArgumentParser(prog="python -m fits.many", description=__doc__)
    parser.add_argument("--records", type=int, default=1000)
    parser.add_argument("--compared", type=int, default=50, help="records to compare the fits of")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    import jaxfric
    from jaxfric.fitting import minimise
    from jaxfric.fitting.problem import free_of

    records, steps, truths, stiffness = [], [], [], []
    for seed in range(asked.records):
        ts, friction, (times, velocities), truth, K = made(seed)
        load = np.where(
            ts > times[1],
            velocities[0] * times[1] + velocities[1] * (ts - times[1]),
            velocities[0] * ts,
        )
        records.append(jaxfric.from_arrays(ts, friction, load_point_displacement=load))
        steps.append(jaxfric.VelocitySteps(times, velocities))
        truths.append(truth)
        stiffness.append(K)
    seconds = []
    for _ in range(2):
        begun = time.perf_counter()
        fits = jaxfric.fit_many(records, stiffness=stiffness, steps=steps)
        seconds.append(time.perf_counter() - begun)
    each = 1e3 * seconds[1] / len(fits)
    tried = np.mean([fit.iterations for fit in fits])
    print(f"{len(fits)} records x {ROWS} rows: {seconds[0]:.1f} s, warm {seconds[1]:.1f} s,")
    print(f"{each:.1f} ms a record, {tried:.1f} points tried in the descent that was kept")
    print(f"converged: {np.mean([fit.converged for fit in fits]):.1%}")
    descend = jax.jit(minimise)
    at_maximum = []
    for fit, truth in list(zip(fits, truths, strict=True))[: asked.compared]:
        solved = fit.solved
        assert solved is not None
        start = jnp.asarray(free_of(solved.problem, list(truth.values())))
        best = float(descend(solved.problem, start).cost)
        at_maximum.append(fit.converged and solved.solution.cost <= best * (1 + 1e-6))
    share = np.mean(at_maximum)
    print(f"at the maximum of the likelihood: {share:.1%} of {len(at_maximum)} compared")


if __name__ == "__main__":
    main()
