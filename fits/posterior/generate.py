"""Records of one velocity step by SciPy, and draws of their parameters. Nothing of jaxfric.

A slider without mass, slip law, on a spring of stiffness K [1/m], u = ln(V/V0):
    f = f0 + A u + theta,   df/dt = K (v - V),   dtheta/dt = -(V/L)(theta + B u),
in steady sliding at V0 first; integrated by LSODA, rtol 1e-9, each velocity by itself. SI units.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

V0, V1, STEP = 1e-6, 1e-5, 10.0
"""Velocities before and after the step [m/s], and its time [s]."""
STIFFNESS = 2e4
NAMES = ("f0", "A", "B", "L")


class RunawayError(RuntimeError):
    """The slider runs away from the load point."""


@dataclass(frozen=True)
class StepRecord:
    """What a fit may see, SI."""

    time: np.ndarray
    position: np.ndarray
    friction: np.ndarray
    clean: np.ndarray


def times(rows: int) -> np.ndarray:
    """A third of the rows before the step, the others ever rarer after it, 20 s long."""
    before = rows // 3
    after = STEP + np.geomspace(0.01, 20.0, rows - before)
    return np.concatenate([np.linspace(0.0, STEP - 0.01, before), after])


def motion(p: np.ndarray, time: np.ndarray, stiffness: float = STIFFNESS) -> np.ndarray:
    """Friction at the times of a record with the parameters `p` (f0, A, B, L)."""
    f0, A, B, L = p

    def slope(t: float, y: np.ndarray, v: float) -> list[float]:
        u, theta = y
        V = V0 * np.exp(min(u, 50.0))
        evolved = -(V / L) * (theta + B * u)
        return [(stiffness * (v - V) - evolved) / A, evolved]

    after = time >= STEP
    found = solve_ivp(
        slope, (STEP, time[-1]), [0.0, 0.0], "LSODA", time[after], args=(V1,), rtol=1e-9, atol=1e-12
    )
    if not found.success or np.max(found.y[0]) > np.log(1e3 * V1 / V0):
        raise RunawayError(f"parameters {p}")
    friction = np.full(len(time), f0)
    friction[after] = f0 + A * found.y[0] + found.y[1]
    return friction


def record(p: np.ndarray, rows: int, sigma: float, rng: np.random.Generator) -> StepRecord:
    """A record of parameters `p` with white noise of standard deviation `sigma`."""
    time = times(rows)
    clean = motion(p, time)
    position = V0 * time + (V1 - V0) * np.maximum(time - STEP, 0.0)
    return StepRecord(time, position, clean + sigma * rng.standard_normal(rows), clean)


PRIORS = {
    "f0": {"normal": [0.6, 0.02]},
    "A": {"normal": [0.008, 0.0012]},
    "B": {"uniform": [0.004, 0.014]},
    "L": {"lognormal": [15.0, 0.3], "unit": "um"},
}
"""The priors of the calibration, as a file of priors has them."""


def draw(rng: np.random.Generator) -> np.ndarray:
    """Parameters (f0, A, B, L) drawn from `PRIORS`; A above 0."""
    while True:
        A = rng.normal(*PRIORS["A"]["normal"])
        if A > 0:
            break
    median, width = PRIORS["L"]["lognormal"]
    L = 1e-6 * median * np.exp(width * rng.standard_normal())
    return np.array([rng.normal(*PRIORS["f0"]["normal"]), A, rng.uniform(0.004, 0.014), L])
