"""Random velocity-step records for blind checks, with their truth.

NumPy and SciPy only; nothing here comes from `jaxfric` or from `tests/reference.py`. SI units.
A record is a quasi-static slider with one state, f = f0 + A u + theta, u = ln(V/V0), on a
spring of known stiffness K [1/m]:  A du/dt = K (V_m - V) - dtheta/dt.  It begins in steady
sliding at V0, the first commanded velocity. It is integrated in dimensionless form with
LSODA at relative tolerance 1e-9, once per segment.

How a record is drawn (each choice from the seed alone)
    A           log-uniform in [0.002, 0.02];   f0 uniform in [0.4, 0.8]
    B/A         log-uniform in [0.75, 3]: B < A, velocity strengthening, in one case of five
    L           log-uniform in [3, 30] um
    K           ratio * max(B - A, 0.2 B)/L, ratio log-uniform in [1.5, 30]. For B > 1.25 A the
                ratio is K/K_cr; else K_cr is zero, negative or tiny, and 0.2 B/L stands in for it
    V0          log-uniform in [0.3, 30] um/s;   each step a factor in [3, 10], log-uniform
    pattern     "up" or "down": one step; "mixed": 3 to 5 steps, both directions occur
    segments    each lasts 8 to 30 L of load-point motion (the first 4 to 10 L)
    samples     600 to 2500, uniform within a segment, its rate not that of its neighbours

Runaways. With the slip law a finite step can destabilise a slider that is linearly stable
(K/K_cr near 2 and below): without inertia the velocity then diverges in finite time. A draw
whose velocity exceeds 1e4 times the largest commanded velocity, or whose integration fails,
is refused and the pattern and its factors are drawn again, the n-th time with each factor to
the power 0.8^n (a plant that no step of factor 3 leaves in one piece still gives a record, so A,
B, L and K keep their distributions). It is the plant that refuses, before noise is added and
before anything is fitted; `Truth.refused` counts how often.
"""

import math
import warnings
from dataclasses import dataclass

import numpy as np
from scipy.integrate import ODEintWarning, odeint

RUNAWAY = 1e4  # times the largest commanded velocity
LAWS = ("slip", "ageing")
PATTERNS = ("up", "down", "mixed")


@dataclass(frozen=True)
class Plant:
    """The slider: law and stiffness."""

    law: str
    f0: float
    A: float
    B: float
    L: float
    V0: float
    stiffness: float
    stiffness_ratio: float  # K L / max(B - A, 0.2 B)


@dataclass(frozen=True)
class Truth(Plant):
    """What a fit should find, and how the record was made."""

    starts: tuple[float, ...]  # s, when each commanded velocity begins
    velocities: tuple[float, ...]
    white: float  # standard deviation of the white friction noise
    correlated: float  # of the exponentially correlated one
    correlation_time: float  # s
    displacement_noise: float  # m
    refused: int  # runaways drawn before this record


@dataclass(frozen=True)
class SyntheticRecord:
    """What a fitter may see (time, load point, friction, stiffness), then what it may not."""

    time: np.ndarray
    load_point_displacement: np.ndarray
    friction: np.ndarray
    stiffness: float
    truth: Truth
    clean_friction: np.ndarray
    velocity: np.ndarray


def random_record(
    seed: int,
    *,
    law: str | None = None,
    pattern: str | None = None,
    stiffness_ratio: tuple[float, float] = (1.5, 30.0),
    samples: tuple[int, int] = (600, 2500),
    white: float = 3e-4,
    correlated: float = 0.0,
    correlation: float = 0.02,
    displacement_noise: float = 0.0,
) -> SyntheticRecord:
    """One record. `law` and `pattern` are drawn too where they are None.

    `white` and `correlated` are standard deviations of friction noise, `correlation` the
    correlation time of the second as a fraction of the record; `displacement_noise` [m]
    is white and enters the recorded load point only.
    """
    rng = np.random.default_rng(seed)
    drawn = LAWS[rng.integers(len(LAWS))]  # drawn even where given: the seed then fixes the rest
    plant = _draw_plant(rng, law or drawn, stiffness_ratio)
    starts, r, t, u, theta, refused = _draw_motion(rng, seed, plant, pattern, samples)
    unit = plant.L / plant.V0
    time, tau = t * unit, correlation * t[-1] * unit
    clean = plant.f0 + plant.A * (u + theta)
    noise = white * rng.standard_normal(len(t)) + ornstein_uhlenbeck(rng, time, correlated, tau)
    load_point = plant.L * np.interp(t, *_corners(starts, r, t[-1]))
    load_point = load_point + displacement_noise * rng.standard_normal(len(t))
    truth = Truth(
        **vars(plant),
        starts=tuple((starts * unit).tolist()),
        velocities=tuple((r * plant.V0).tolist()),
        white=white,
        correlated=correlated,
        correlation_time=tau,
        displacement_noise=displacement_noise,
        refused=refused,
    )
    velocity = plant.V0 * np.exp(u)
    stiffness = plant.stiffness
    return SyntheticRecord(time, load_point, clean + noise, stiffness, truth, clean, velocity)


def ornstein_uhlenbeck(
    rng: np.random.Generator, time: np.ndarray, sigma: float, tau: float
) -> np.ndarray:
    """Stationary noise of standard deviation sigma and correlation exp(-dt/tau), exact at
    uneven sampling: n[i+1] = a n[i] + sigma sqrt(1 - a^2) xi, a = exp(-dt/tau)."""
    draws = sigma * rng.standard_normal(len(time))
    if sigma == 0.0:
        return draws
    keep = np.exp(-np.diff(time) / tau)
    new = np.sqrt(-np.expm1(-2.0 * np.diff(time) / tau)) * draws[1:]
    noise = [draws[0]]
    for a, n in zip(keep.tolist(), new.tolist(), strict=True):
        noise.append(a * noise[-1] + n)
    return np.array(noise)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _draw_plant(rng: np.random.Generator, law: str, ratios: tuple[float, float]) -> Plant:
    if law not in LAWS:
        raise ValueError(f"law {law!r} is none of {LAWS}")
    A, L = _log_uniform(rng, 0.002, 0.02), _log_uniform(rng, 3e-6, 3e-5)
    B, ratio = A * _log_uniform(rng, 0.75, 3.0), _log_uniform(rng, *ratios)
    V0, f0 = _log_uniform(rng, 3e-7, 3e-5), float(rng.uniform(0.4, 0.8))
    return Plant(law, f0, A, B, L, V0, ratio * max(B - A, 0.2 * B) / L, ratio)


def _draw_motion(
    rng: np.random.Generator, seed: int, p: Plant, pattern: str | None, samples: tuple[int, int]
):
    """Starts, velocity factors, sample times, u, theta/A and the runaways refused on the way."""
    for refused in range(50):
        drawn = PATTERNS[rng.integers(len(PATTERNS))]
        r = _velocity_factors(rng, pattern or drawn, 0.8**refused)
        starts, t = _schedule(rng, r, int(rng.integers(samples[0], samples[1] + 1)))
        motion = _integrate(p.law, p.B / p.A, p.stiffness * p.L / p.A, starts, r, t)
        if motion is not None:
            return starts, r, t, *motion, refused
    raise RuntimeError(f"seed {seed}: every pattern ran away")


def _velocity_factors(rng: np.random.Generator, pattern: str, shrink: float) -> np.ndarray:
    """Commanded velocities over the first one; shrink < 1 takes that power of each step."""
    if pattern not in PATTERNS:
        raise ValueError(f"pattern {pattern!r} is none of {PATTERNS}")
    if pattern == "mixed":
        signs = rng.choice([-1.0, 1.0], size=rng.integers(3, 6))
        if abs(signs.sum()) == len(signs):
            signs[rng.integers(len(signs))] *= -1.0
    else:
        signs = np.array([1.0 if pattern == "up" else -1.0])
    steps = signs * shrink * rng.uniform(np.log(3.0), np.log(10.0), size=len(signs))
    return np.exp(np.concatenate([[0.0], np.cumsum(steps)]))


def _schedule(rng: np.random.Generator, r: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Start of each segment and sample times, both in units of L/V0."""
    slips = np.concatenate([rng.uniform(4.0, 10.0, 1), rng.uniform(8.0, 30.0, len(r) - 1)])
    edges = np.concatenate([[0.0], np.cumsum(slips / r)])
    weights = rng.uniform(0.5, 1.5, len(r)) * np.concatenate([[0.5], np.ones(len(r) - 1)])
    counts = np.maximum(np.round(n * weights / weights.sum()).astype(int), 40)
    parts = [
        np.linspace(a, b, c, endpoint=False)
        for a, b, c in zip(edges, edges[1:], counts, strict=False)
    ]
    return edges[:-1], np.append(np.concatenate(parts), edges[-1])


def _corners(starts: np.ndarray, r: np.ndarray, end: float) -> tuple[np.ndarray, np.ndarray]:
    times = np.append(starts, end)
    return times, np.concatenate([[0.0], np.cumsum(r * np.diff(times))])


def _integrate(
    law: str, b: float, k: float, starts: np.ndarray, r: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """u and theta/A at times t (units L/V0), b = B/A, k = K L/A; None for a runaway."""
    ceiling = math.log(RUNAWAY * r.max())
    exp = math.exp
    slip = law == "slip"

    def rate(y, _, r_m):
        u, theta = y.tolist()
        if u > ceiling:
            return 0.0, 0.0  # frozen: the runaway is told by u itself
        V = exp(u)
        d_theta = -V * (theta + b * u) if slip else b * (exp(-theta / b) - V)
        return k * (r_m - V) - d_theta, d_theta

    edges = np.append(starts, t[-1])
    y, u, theta = np.zeros(2), [], []
    for t0, t1, r_m in zip(edges, edges[1:], r, strict=False):
        inside = t[(t >= t0) & (t < t1)]
        out, ok = _lsoda(rate, y, np.append(inside, t1), float(r_m))
        if not ok or out[-1, 0] > 0.999 * ceiling or out[:, 0].max() > 0.999 * ceiling:
            return None
        u.append(out[:-1, 0])
        theta.append(out[:-1, 1])
        y = out[-1]
    return np.append(np.concatenate(u), y[0]), np.append(np.concatenate(theta), y[1])


def _lsoda(rate, y: np.ndarray, ts: np.ndarray, r_m: float) -> tuple[np.ndarray, bool]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ODEintWarning)
        out, told = odeint(
            rate, y, ts, args=(r_m,), rtol=1e-9, atol=1e-11, full_output=True, mxstep=5000
        )
    return out, told["message"] == "Integration successful."
