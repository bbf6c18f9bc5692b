"""`python -m fits.many [step|mass|velocities] [--records N]`: time of `jaxfric.fit_many`.

Records of 500 rows with white noise, made by SciPy's LSODA: "step" by a factor of 3 to 10; "mass",
the same with a mass that is stated (5 to 30 % of what makes the slider unstable); "velocities", 12
of them up and down. A fit is at the maximum of the likelihood where a descent from the true
parameters ends no lower.
"""

import argparse
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

ROWS, NOISE = 500, 3e-4
RECORDS = {"step": 1000, "mass": 1000, "velocities": 200}


class Made(NamedTuple):
    """A record with what made it. SI; friction is a coefficient."""

    time: np.ndarray
    friction: np.ndarray
    load_point: np.ndarray
    times: np.ndarray
    velocities: np.ndarray
    truth: dict[str, float]
    stiffness: float
    mass: float | None


def made(seed: int, kind: str = "step") -> Made:
    """A record of the slip law on a spring, from steady sliding."""
    rng = np.random.default_rng(seed)
    A = rng.uniform(0.005, 0.015)
    B, L, V0 = A * rng.uniform(1.1, 1.8), 10 ** rng.uniform(-5.3, -4.6), 1e-6
    factor = 10 ** rng.uniform(0.5, 1.0)
    K = 10 ** rng.uniform(0.7, 1.3) * (B - A) / L
    number = 12 if kind == "velocities" else 2
    velocities = np.where(np.arange(number) % 2, factor * V0, V0)
    slips = np.where(np.arange(number) % 2, 25.0, 10.0 if number > 2 else 5.0) * L
    ends = np.cumsum(slips / velocities)
    times = np.concatenate([[0.0], ends[:-1]])
    # the mass at which a slider of this stiffness begins to stick and slip: (K/K_cr - 1) A L/V^2
    most = (K / ((B - A) / L) - 1) * A * L / (factor * V0) ** 2
    m = rng.uniform(0.05, 0.3) * most if kind == "mass" else None

    def rate(_: float, y: np.ndarray, load: float) -> list[float]:
        """Of u = ln(V/V0), the state, and the stretch of the spring [friction]."""
        V = V0 * np.exp(y[0])
        change, stretch = -V / L * (y[1] + B * y[0]), K * (load - V)
        if m is None:
            return [(stretch - change) / A, change, stretch]
        return [(y[2] - A * y[0] - y[1]) / (m * V), change, stretch]

    ts = np.linspace(0.0, ends[-1], ROWS)
    y, seen = np.zeros(3), np.zeros((3, ROWS))
    for begin, end, velocity in zip(times, ends, velocities, strict=True):
        inside = (ts > begin) & (ts <= end)
        how = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-11, "args": (velocity,)}
        found = solve_ivp(rate, (0.0, end - begin), y, dense_output=True, **how)
        seen[:, inside], y = found.sol(ts[inside] - begin), found.y[:, -1]
    friction = 0.6 + A * seen[0] + seen[1] + NOISE * rng.standard_normal(ROWS)
    load = np.interp(ts, np.append(times, ends[-1]), np.append(0.0, np.cumsum(slips)))
    return Made(ts, friction, load, times, velocities, {"f0": 0.6, "A": A, "B": B, "L": L}, K, m)


def main() -> None:
    """Make, fit and count."""
    parser = argparse.ArgumentParser(prog="python -m fits.many", description=__doc__)
    parser.add_argument("kind", nargs="?", choices=tuple(RECORDS), default="step")
    parser.add_argument("--records", type=int, help="1000, or 200 with many velocities")
    parser.add_argument("--compared", type=int, default=50, help="records to compare the fits of")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    import jaxfric
    from jaxfric.fitting import minimise

    number = asked.records or RECORDS[asked.kind]
    all_made = [made(seed, asked.kind) for seed in range(number)]
    records = [
        jaxfric.from_arrays(one.time, one.friction, load_point_displacement=one.load_point)
        for one in all_made
    ]
    seconds = []
    for _ in range(2):
        begun = time.perf_counter()
        fits = jaxfric.fit_many(
            records,
            stiffness=[one.stiffness for one in all_made],
            mass=None if asked.kind != "mass" else [one.mass or 0.0 for one in all_made],
            steps=[jaxfric.VelocitySteps(one.times, one.velocities) for one in all_made],
            noise="white",
        )
        seconds.append(time.perf_counter() - begun)
    each = 1e3 * seconds[1] / len(fits)
    tried = np.mean([fit.iterations for fit in fits])
    print(f"{len(fits)} records x {ROWS} rows: {seconds[0]:.1f} s, warm {seconds[1]:.1f} s,")
    print(f"{each:.1f} ms a record, {tried:.1f} points tried in the descent that was kept")
    print(f"converged: {np.mean([fit.converged for fit in fits]):.1%}")
    descend = jax.jit(minimise)
    at_maximum = []
    for fit, one in list(zip(fits, all_made, strict=True))[: asked.compared]:
        solved = fit.solved
        assert solved is not None
        start = jnp.asarray(solved.problem.coordinates.to_free(np.asarray([*one.truth.values()])))
        best = float(descend(solved.problem, start).cost)
        at_maximum.append(fit.converged and solved.solution.cost <= best * (1 + 1e-6))
    share = np.mean(at_maximum)
    print(f"at the maximum of the likelihood: {share:.1%} of {len(at_maximum)} compared")


if __name__ == "__main__":
    main()
