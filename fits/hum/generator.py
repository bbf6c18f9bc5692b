"""Sliders on a spring through velocity steps, with mains hum in their noise; SciPy alone."""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from jaxfric.records import Record, from_arrays

_FRICTION = 0.6
_MAINS = (50.0, 60.0, 100.0)
_SPEEDS = 1e-6 * np.array([1.0, 3.0, 10.0, 30.0, 100.0, 300.0])
_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4)


class Drawn(NamedTuple):
    """What is true of a record, in SI; K is stiffness over normal force."""

    law: str
    A: float
    B: float
    L: float
    K: float
    velocities: tuple[float, ...]
    rows: tuple[int, ...]
    """Rows at every velocity."""
    rate: float
    """Rows a second."""
    sigma: float
    memory: float
    """Correlation of the noise of neighbouring rows."""
    hum: float
    """Frequency [Hz]."""
    share: float
    """Mean square of the hum over the variance of the other noise."""
    second: float = 0.0
    """B of a second state whose L is twelve times the first one's."""


def drawn(seed: int, *, second: bool = False) -> Drawn:
    """The truth of record `seed`; with a `second` state that the base lacks, or none."""
    random = np.random.default_rng(seed)
    law = ("slip", "ageing")[seed // 15 % 2]
    # slow steps take time, and rows are few
    first = int(random.integers(0, 4))
    rate = float(random.choice([200.0, 250.0] if first < 2 else [200.0, 250.0, 500.0, 1000.0]))
    number, places = int(random.integers(3, 6)), [first + int(random.integers(0, 3))]
    while len(places) < number:
        others = [p for p in range(first, first + 3) if p != places[-1]]
        places.append(int(random.choice(others)))
    velocities = _SPEEDS[places]
    weights = velocities**-0.2
    rows = np.round(random.uniform(900, 1900) * weights / weights.sum()).astype(int)
    L = float(np.min(velocities * rows) / rate / random.uniform(8, 14)) / (3 if second else 1)
    A = float(10 ** random.uniform(-2.5, -2))
    B = A * float(random.uniform(1.2, 1.8))
    K = float(10 ** random.uniform(np.log10(3), np.log10(15))) * (B - A) / L
    sigma = A * float(10 ** random.uniform(-1.7, -0.8))
    memory = float(random.choice([0.0, 0.4, 0.7]))
    hum, share = _MAINS[seed % 3], _SHARES[seed // 3 % 5]
    B2 = A * float(random.uniform(0.2, 0.4)) if second else 0.0
    speeds_, counts = tuple(velocities.tolist()), tuple(rows.tolist())
    return Drawn(law, A, B, L, K, speeds_, counts, rate, sigma, memory, hum, share, B2)


def friction_of(p: Drawn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, path of the load point and friction of a record without noise."""
    ends = np.cumsum(p.rows)
    time = np.arange(ends[-1]) / p.rate
    step = np.searchsorted(ends, np.arange(ends[-1]), side="right")
    begins = np.concatenate([[0], ends[:-1]]) / p.rate
    V0, lengths = p.velocities[0], np.array([p.L, 12 * p.L])
    sizes = np.array([p.B, p.second])

    def ahead(t: float, y: np.ndarray, speed: float) -> np.ndarray:
        """Of ln(V/V0) and ln(V0 theta/L) of two states."""
        V = V0 * np.exp(y[0])
        x = V / V0 * np.exp(y[1:])
        grown = V0 / lengths * np.exp(-y[1:]) * (1 - x)
        if p.law == "slip":
            grown = -V / lengths * np.log(x)
        return np.concatenate([[(p.K * (speed - V) - sizes @ grown) / p.A], grown])

    friction, y = np.empty(len(time)), np.zeros(3)
    for k, speed in enumerate(p.velocities):
        own = step == k
        stop = begins[k + 1] if k + 1 < len(begins) else time[-1] + 1 / p.rate
        when = np.append(time[own], stop)
        found = solve_ivp(
            ahead, (begins[k], stop), y, "LSODA", when, args=(speed,), rtol=1e-9, atol=1e-11
        )
        friction[own] = _FRICTION + p.A * found.y[0, :-1] + sizes @ found.y[1:, :-1]
        y = found.y[:, -1]
    path = np.interp(time, np.append(begins, time[-1] + 1 / p.rate), _moved(p, begins, time))
    return time, path, friction


def _moved(p: Drawn, begins: np.ndarray, time: np.ndarray) -> np.ndarray:
    lasting = np.diff(np.append(begins, time[-1] + 1 / p.rate))
    return np.concatenate([[0.0], np.cumsum(np.array(p.velocities) * lasting)])


def noise_of(p: Drawn, seed: int) -> np.ndarray:
    """White or first-order noise, and the hum: one phase, a size of its own at every velocity."""
    random = np.random.default_rng(1000 + seed)
    number = sum(p.rows)
    white = random.standard_normal(number + 100)
    noise = lfilter([np.sqrt(1 - p.memory**2)], [1, -p.memory], white)[100:]
    sizes = np.repeat(random.uniform(0.5, 1.5, len(p.rows)), p.rows)
    swing = sizes * np.sin(2 * np.pi * p.hum * np.arange(number) / p.rate + random.uniform(0, 6))
    return p.sigma * (noise + swing * np.sqrt(p.share / np.mean(swing**2)))


def record_of(p: Drawn, seed: int) -> Record:
    """The record of a drawing; `seed` is that of its noise."""
    time, path, friction = friction_of(p)
    return from_arrays(time, friction + noise_of(p, seed), load_point_displacement=path)
