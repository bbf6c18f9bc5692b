"""What records of the blind studies are drawn from: plants, effects, protocols and samplings.

Ranges are told in `generate`. Imports nothing of jaxfric.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .plants import Base, Protocol, Stress

UM = 1e-6
SIGMA = 3e-4
SLIP_PER_STEP = 150 * UM
LEVELS = tuple(v * UM for v in (1.0, 3.0, 10.0, 30.0, 100.0))
LEAST_RATIO = 3.0


@dataclass(frozen=True)
class Draw:
    """A plant without its effects, and when it is sampled."""

    base: Base
    ratio: float  # K L/max(B - A, 0.2 B)
    protocol: Protocol
    t: np.ndarray
    stress: Stress | None
    sigma: float = SIGMA  # of the noise
    least_ratio: float = LEAST_RATIO
    stiffness_error: float = 0.0  # ln of the true over the declared; not 0: declared as uncertain
    quantum: float = 0.0  # m, of the recorded load point
    sampling: str = "uniform"

    @property
    def fastest(self) -> float:
        return max(self.protocol.velocities)

    @property
    def crossing(self) -> float:
        """Time to slip L at the fastest command [s]: the shortest time of the friction law."""
        return self.base.L / self.fastest


@dataclass(frozen=True)
class Recipe:
    """How an effect is drawn.

    shape(rng, draw) : what is fixed before the amplitude is sought
    parameters(amplitude, shape) : those of the plant
    start, limit(draw) : amplitude to begin with, and the largest physical one
    signed : whether the amplitude may be negative
    """

    shape: Callable[[np.random.Generator, Draw], dict[str, float]]
    parameters: Callable[[float, dict[str, float]], dict[str, float]]
    start: Callable[[Draw], float]
    limit: Callable[[Draw], float]
    signed: bool = False


def _plain(name: str, start, limit, *, signed: bool = False) -> Recipe:
    """An effect with one parameter, its amplitude."""
    return Recipe(lambda rng, draw: {}, lambda a, shape: {name: a}, start, limit, signed)


def _shaped(name: str, shape, start, limit, *, signed: bool = False) -> Recipe:
    """An effect with an amplitude and shapes."""
    return Recipe(shape, lambda a, shape: {name: a, **shape}, start, limit, signed)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _total(draw: Draw) -> float:
    return SLIP_PER_STEP * len(draw.protocol.velocities)


RECIPES: dict[str, Recipe] = {
    "second_state": _shaped(
        "B2",
        lambda rng, w: {"L2": min(w.base.L * log_uniform(rng, 3, 10), SLIP_PER_STEP / 2.5)},
        lambda w: 0.02 * w.base.B,
        lambda w: w.base.B,
    ),
    "ageing": _plain("q", lambda w: 0.05, lambda w: 1.0),
    "velocity_dependent_L": _plain("n", lambda w: 0.02, lambda w: 0.5, signed=True),
    "evolution_cutoff": Recipe(
        lambda rng, w: {},
        lambda a, shape: {"Vc": 1.0 / a if a > 0 else math.inf},
        lambda w: 0.02 / w.fastest,
        lambda w: 1.0 / min(w.protocol.velocities),
    ),
    "viscous": _plain("c", lambda w: SIGMA / w.fastest, lambda w: 0.3 * w.base.f0 / w.fastest),
    "stribeck": _shaped(
        "fs",
        lambda rng, w: {
            "Vs": log_uniform(rng, 3 * min(w.protocol.velocities), w.fastest / 3),
            "d": float(rng.uniform(1, 2)),
        },
        lambda w: SIGMA,
        lambda w: w.base.A,  # beyond, A + V df/dV may be negative
    ),
    "slip_trend": _plain(
        "s", lambda w: SIGMA / _total(w), lambda w: 0.3 * w.base.f0 / _total(w), signed=True
    ),
    "run_in": _shaped(
        "d",
        lambda rng, w: {"dc": log_uniform(rng, 80 * UM, 0.4 * _total(w))},
        lambda w: SIGMA,
        lambda w: 0.3 * w.base.f0,
        signed=True,
    ),
    "position_periodic": Recipe(
        lambda rng, w: {
            "lambda": log_uniform(rng, 25 * UM, 250 * UM),
            "phase": float(rng.uniform(0, 2 * math.pi)),
        },
        lambda a, shape: {
            "a": a * math.cos(shape["phase"]),
            "b": a * math.sin(shape["phase"]),
            "lambda": shape["lambda"],
        },
        lambda w: SIGMA,
        lambda w: 0.1 * w.base.f0,
    ),
    "normal_stress": _plain("alpha", lambda w: 0.1, lambda w: w.base.f0),
    "thermal": _shaped(
        "a_T",
        lambda rng, w: {"tau_T": log_uniform(rng, 2, 40)},
        lambda w: SIGMA * w.protocol.velocities[0] / w.fastest,
        lambda w: 0.3 * w.base.f0 * w.protocol.velocities[0] / w.fastest,
    ),
    "frictional_delay": _plain("alpha", lambda w: 0.1 * w.crossing, lambda w: 10 * w.crossing),
    "stiffness": _plain("kappa", lambda w: 0.03, lambda w: 0.7, signed=True),
    "damping": _plain(
        "k_v", lambda w: 0.05 * w.base.A / w.fastest, lambda w: 30 * w.base.A / w.fastest
    ),
    "inertia": _plain(
        "m",
        lambda w: w.base.K * (0.1 * w.crossing) ** 2,
        lambda w: w.base.K * (3 * w.crossing) ** 2,
    ),
    "servo_lag": _plain("tau", lambda w: 0.05 * w.crossing, lambda w: 10 * w.crossing),
    "sensor_lag": _plain("tau", lambda w: 0.05 * w.crossing, lambda w: 10 * w.crossing),
    "sensor_delay": _plain("d", lambda w: 0.05 * w.crossing, lambda w: 10 * w.crossing),
    "time_drift": _plain(
        "r",
        lambda w: SIGMA / sum(w.protocol.durations),
        lambda w: 0.3 * w.base.f0 / sum(w.protocol.durations),
        signed=True,
    ),
    "gain": _plain("g", lambda w: 0.03, lambda w: 0.5, signed=True),
}


def draw_protocol(rng: np.random.Generator) -> Protocol:
    """Twelve velocities: every level occurs, and neighbours differ by at most two levels."""
    while True:
        path = [int(rng.integers(0, 3))]
        while len(path) < 12:
            near = [i for i in range(5) if 0 < abs(i - path[-1]) <= 2]
            path.append(int(rng.choice(near)))
        if len(set(path)) == 5:
            velocities = tuple(LEVELS[i] for i in path)
            return Protocol(velocities, tuple(SLIP_PER_STEP / v for v in velocities))


def draw_times(rng: np.random.Generator, protocol: Protocol, sampling: str) -> np.ndarray:
    """Sample times [s]; the first is 0, the other velocities begin between two samples."""
    out = []
    for start, span in zip(protocol.starts, protocol.durations, strict=True):
        count = int(rng.integers(225, 276))
        part = (np.arange(count) + (rng.uniform(0.1, 0.9) if start else 0.0)) / count
        part = np.expm1(2.5 * part) / math.expm1(2.5) if sampling == "thinned" else part
        out.append(start + span * part)
    return np.concatenate(out)
