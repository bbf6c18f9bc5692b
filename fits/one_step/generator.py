"""Records of one velocity step under the pure ageing law, integrated by SciPy."""

from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp

from jaxfric.records import Record, from_arrays

_BEFORE, _AFTER = 300, 900
_SLOW, _FAST = 1e-6, 1e-5
_FRICTION = 0.6


def drawn(seed: int) -> dict[str, float]:
    """Parameters of a record in SI, with stiffness over normal force K and noise."""
    random = np.random.default_rng(seed)
    A = 10 ** random.uniform(-3, -2)
    B = A * random.uniform(1.2, 2.0)
    L = 10 ** random.uniform(-5, -4)
    K = 10 ** random.uniform(np.log10(3), np.log10(20)) * (B - A) / L
    return {"A": A, "B": B, "L": L, "K": K, "noise": 10 ** random.uniform(np.log10(3e-5), -3)}


def record_of(p: Mapping[str, float], seed: int) -> Record:
    """The record of such parameters; `seed` is that of its noise."""
    A, B, L, K = (p[name] for name in "ABLK")
    begin, more = 4 * L / _SLOW, 12 * L / _FAST
    rest = L / _SLOW

    def rate(t: float, y: np.ndarray) -> list[float]:
        V, theta = _SLOW * np.exp(y[0]), rest * np.exp(y[1])
        healing = 1 / theta - V / L
        return [(K * (_FAST - V) - B * healing) / A, healing]

    after = np.linspace(0, more, _AFTER)
    found = solve_ivp(rate, (0, more), [0.0, 0.0], "LSODA", after, rtol=1e-9, atol=1e-11)
    friction = np.full(_BEFORE + _AFTER, _FRICTION)
    friction[_BEFORE:] += A * found.y[0] + B * found.y[1]
    random = np.random.default_rng(1000 + seed)
    friction += p["noise"] * random.standard_normal(len(friction))
    time = np.concatenate([np.linspace(0, begin, _BEFORE, endpoint=False), begin + after])
    moved = _SLOW * np.minimum(time, begin) + _FAST * np.maximum(time - begin, 0)
    return from_arrays(time, friction, load_point_displacement=moved)
