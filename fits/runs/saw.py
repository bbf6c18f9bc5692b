"""Stick-slip by SciPy: a slider with mass, at several velocities of the load point, with its truth.

NumPy and SciPy only; nothing of jaxfric. u = ln(V/V0), f the force of the spring over the normal
force, m = K (T/2 pi)^2:
    df/dt = K (v - V),   m dV/dt = f - f0 - A u - theta,
    dtheta/dt = -(V/L)(theta + B u)                     (slip law)
    dtheta/dt = (B/L)(V0 exp(-theta/B) - V)           (ageing law)
integrated by Radau, rtol 1e-7, velocity by velocity. Where the slider is at rest, V of 1e-9 m/s and
less, mass is that at 1e-9 m/s: as good as none, and finite steps of time.

How a run is drawn (from its seed alone)
    law         slip or ageing; A log-uniform in [.004, .012], B/A in [1.25, 2.5], L in [2, 30] um,
                f0 in [.45, .7], T log-uniform in [5, 50] ms
    stiffness   K L/(B - A) log-uniform in [.08, .5], of the critical one
    velocities  three or four of 1, 3, 10, 30, 100 um/s, 12 to 20 teeth each, none at which the
                slider moves T V > L/10 in a period of a slip, where mass counts while it creeps
    rows        60 to 300 a tooth, one rate for all teeth of a velocity
    recorder    friction: pieces of measured noise (`fits.blind.measured`) or white, sigma 1e-4 to
                5e-4; position: white, 0.02 um
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from fits.blind import measured

UM = 1e-6
LADDER = np.array([1.0, 3.0, 10.0, 30.0, 100.0]) * UM
V0 = 1e-6
_PIECE, _FAST, _REST = 600, 60.0, 1e-9


@dataclass(frozen=True)
class Slider:
    """The slider of a run, SI; T the period with which it swings on its spring [s]."""

    law: str
    f0: float
    A: float
    B: float
    L: float
    K: float
    T: float

    @property
    def m(self) -> float:
        """Mass over normal force [s^2/m]."""
        return self.K * (self.T / (2 * math.pi)) ** 2


@dataclass
class Saw:
    """The rows of a run, SI, and its truth."""

    time: np.ndarray
    position: np.ndarray
    friction: np.ndarray
    slider: Slider
    velocities: list[float]


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw(rng: np.random.Generator, law: str) -> tuple[Slider, list[float]]:
    """A slider, and the velocities of its load point."""
    while True:
        A = log_uniform(rng, 0.004, 0.012)
        B, L = A * log_uniform(rng, 1.25, 2.5), log_uniform(rng, 2 * UM, 30 * UM)
        f0, T = float(rng.uniform(0.45, 0.7)), log_uniform(rng, 0.005, 0.05)
        slider = Slider(law, f0, A, B, L, log_uniform(rng, 0.08, 0.5) * (B - A) / L, T)
        allowed = [v for v in LADDER if T * v < 0.1 * L]
        count = int(rng.integers(3, 5))
        if len(allowed) >= count:
            first = int(rng.integers(len(allowed) - count + 1))
            return slider, [float(v) for v in allowed[first : first + count]]


def generate(seed: int, *, law: str = "slip", noise: str = "white") -> Saw:
    """A run from its seed; `noise`: "none", "white" or a source of `fits.blind.measured`."""
    rng = np.random.default_rng([seed, 1994])
    slider, velocities = draw(rng, law)
    teeth = [int(rng.integers(12, 21)) for _ in velocities]
    rows = [int(rng.integers(60, 301)) for _ in velocities]
    # it swings from the begin
    u = math.log(velocities[0] / V0)
    y = np.array([u + 0.3, -slider.B * u, slider.f0 + (slider.A - slider.B) * u])
    y, first, _ = move(slider, velocities[0], y, np.array([_load(slider, velocities[0])]))
    now = where = 0.0
    parts = []
    for velocity, number, each in zip(velocities, teeth, rows, strict=True):
        period = first if velocity == velocities[0] else _load(slider, velocity)
        lasts = number * period
        t = (np.arange(number * each) + 0.5) * period / each
        y, _, friction = move(slider, velocity, y, np.append(t, lasts))
        parts.append((now + t, where + velocity * t, friction[:-1]))
        now, where = now + lasts, where + velocity * lasts
    time, position, friction = (np.concatenate(x) for x in zip(*parts, strict=True))
    sigma = log_uniform(rng, 1e-4, 5e-4)
    if noise == "white":
        friction = friction + sigma * rng.standard_normal(len(time))
    elif noise != "none":
        pieces = [len(p) for p in np.array_split(np.empty(len(time)), -(-len(time) // _PIECE))]
        friction = friction + sigma * measured.cut(noise, pieces, rng)
    position = position + 0.02 * UM * rng.standard_normal(len(time))
    return Saw(time, position, friction, slider, velocities)


def _load(slider: Slider, velocity: float) -> float:
    """About the time between two slips [s]: a drop is some 3.5 (B - A) ln(slip speed/velocity)."""
    drop = 3.5 * (slider.B - slider.A) * math.log(2e-2 / velocity)
    return drop / (slider.K * velocity)


def move(slider: Slider, velocity: float, y: np.ndarray, t: np.ndarray):
    """u, theta and f at the last of the times t, that time, and f at all of them."""
    p = slider

    def rate(s, y):
        u, theta, f = y
        v = V0 * math.exp(min(u, _FAST))
        off = (f - p.f0 - p.A * u - theta) / (p.m * (v + _REST))
        if p.law == "slip":
            change = -(v / p.L) * (theta + p.B * u)
        else:
            change = (p.B / p.L) * (V0 * math.exp(min(-theta / p.B, 600.0)) - v)
        return [off, change, p.K * (velocity - v)]

    slips = lambda s, y: y[0] - math.log(30 * velocity / V0)  # noqa: E731
    rests = lambda s, y: y[0] - math.log(0.5 * velocity / V0)  # noqa: E731
    slips.direction, rests.direction = 1, -1
    slips.terminal = rests.terminal = True
    begin, out, sliding = 0.0, [], False
    while begin < t[-1]:  # a clock of its own for every slip, whose steps of time are short
        left = t[t >= begin] - begin
        found = solve_ivp(
            rate, (0, left[-1]), y, "Radau", left, events=rests if sliding else slips,
            rtol=1e-7, atol=[1e-7, 1e-9, 1e-9], max_step=t[-1] / 50,
        )  # fmt: skip
        if found.status < 0:
            raise RuntimeError(f"the slider could not be followed: {found.message}")
        out.append(found.y[2] if len(found.t) else [])
        if not found.status:
            break
        begin, y, sliding = begin + found.t_events[0][0], found.y_events[0][0], not sliding
    return found.y[:, -1], float(t[-1]), np.concatenate(out)
