"""Draws of the study `wide`: records that ask more than the loop assumes.

Every record draws all of these, each by itself, from the record's seed:
    stability   K/K_cr log-uniform in [1.5, 20] (as in `generate`: K L/max(B - A, 0.2 B))
    velocities  4 to 30 of them (log-uniform), each 2 to 30 times (log-uniform) the one before or
                that much less, between 0.3 and 300 um/s; 60 to 400 um of load-point motion each
    law         the slip law, or in one case of two the ageing law; it is declared which
    stiffness   in one case of two the declared one is 5 % too large or too small, and declared as
                known to 5 %. Never where `stiffness` or `gain` is the effect, which a stiffness
                that nobody knows explains, too
    noise       white, standard deviation 1e-4, 3e-4 or 1e-3
    sampling    60 to 400 rows a velocity (log-uniform), at a constant rate, finer after the step,
                or uneven: gaps log-normal (0.6), one in thirty eight times as long
    load point  recorded in steps of 0.05, 0.1, 0.2 or 0.5 um, or in one case of three not
    shapes      in one case of two inside `beyond`'s range, else up to three times beyond it. The
                ranges are those where a search would start: L2 from L/5 to the slip of a velocity,
                Vs between the slowest and the fastest velocity, dc from a third of the slip of a
                velocity to all slip, lambda from two L (or a sixtieth of all slip) to half of all
                slip, tau_T from L at the fastest velocity (or three rows) to half of
                the time
A frictional delay has the slip law. f0, A, B/A are as in `generate`, L is 3 to 20 um. The normal
stress hunts in proportion to noise and rho, and its gauge's noise in proportion to the noise.

`wide-law`: the ageing law without any effect, and it is not declared that it is: `ageing` is
what is missing, with q = 1.

Imports nothing of jaxfric.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from .draws import RECIPES, SIGMA, UM, Draw, Recipe, log_uniform
from .plants import Base, Protocol, Stress

NOISES = ("wide", "wide-law")
SIGMAS = (1e-4, 3e-4, 1e-3)
SAMPLINGS = ("uniform", "thinned", "uneven")
QUANTA = (0.05 * UM, 0.1 * UM, 0.2 * UM, 0.5 * UM)
STIFFNESS = 0.05  # how well it is declared to be known
SLOWEST, FASTEST = 0.3 * UM, 300 * UM
_LEAST_RATIO = 1.5
_KNOWN_STIFFNESS = {"stiffness", "gain"}


@dataclass(frozen=True)
class Conditions:
    """Under which a record is made. `stiffness_error` is ln of the true over the declared."""

    ratio: float
    count: int
    sigma: float
    q: float  # 0: slip law, 1: ageing law
    stiffness_error: float
    sampling: str
    quantum: float


def draw_conditions(rng: np.random.Generator, noise: str, effects: tuple[str, ...]) -> Conditions:
    """Conditions of a record; which effect it has changes no random number."""
    ratio, count = log_uniform(rng, _LEAST_RATIO, 20.0), round(log_uniform(rng, 3.5, 30.5))
    sigma, sampling = float(rng.choice(SIGMAS)), str(rng.choice(SAMPLINGS))
    ageing, wrong, sign, quantised = rng.random(4) < (0.5, 0.5, 0.5, 2 / 3)
    quantum = float(rng.choice(QUANTA)) if quantised else 0.0
    unknown = noise == "wide-law"
    if unknown or _KNOWN_STIFFNESS & set(effects):
        wrong = False
    error = math.log1p(STIFFNESS) * (1.0 if sign else -1.0) if wrong else 0.0
    q = 1.0 if unknown or (ageing and "frictional_delay" not in effects) else 0.0
    return Conditions(ratio, count, sigma, q, error, sampling, quantum)


def draw_protocol(rng: np.random.Generator, count: int) -> Protocol:
    """`count` velocities and as many slips of the load point, all unequal."""
    velocities = [log_uniform(rng, UM, 10 * UM)]
    while len(velocities) < count:
        factor, up = log_uniform(rng, 2.0, 30.0), rng.random() < 0.5
        for one in (factor, 1 / factor) if up else (1 / factor, factor):
            if SLOWEST <= velocities[-1] * one <= FASTEST:
                velocities.append(velocities[-1] * one)
                break
    slips = [log_uniform(rng, 60 * UM, 400 * UM) for _ in velocities]
    return Protocol(tuple(velocities), tuple(s / v for s, v in zip(slips, velocities, strict=True)))


def draw_times(rng: np.random.Generator, protocol: Protocol, sampling: str) -> np.ndarray:
    """Sample times [s]; the first is 0, the other velocities begin between two samples."""
    out = []
    for start, span in zip(protocol.starts, protocol.durations, strict=True):
        gaps = np.ones(round(log_uniform(rng, 60, 400)))
        if sampling == "uneven":
            gaps = np.exp(0.6 * rng.standard_normal(len(gaps)))
            gaps[rng.random(len(gaps)) < 1 / 30] *= 8
        inside = rng.uniform(0.1, 0.9) if start else 0.0
        part = (np.cumsum(gaps) - (1 - inside) * gaps) / np.sum(gaps)
        part = np.expm1(2.5 * part) / math.expm1(2.5) if sampling == "thinned" else part
        out.append(start + span * part)
    return np.concatenate(out)


def draw_plant(rng: np.random.Generator, given: Conditions, *, hunting: float = 0.0) -> Draw:
    """The plant under its conditions, without effects and mass.

    `hunting` is the amplitude of the normal stress over that of `generate` (0: none).
    """
    A, L = log_uniform(rng, 0.004, 0.02), log_uniform(rng, 3 * UM, 20 * UM)
    strengthens = rng.random() < 0.2
    B = A * (log_uniform(rng, 0.6, 0.9) if strengthens else log_uniform(rng, 1.15, 2.2))
    stiffness = given.ratio * max(B - A, 0.2 * B) / L
    base = Base(float(rng.uniform(0.5, 0.75)), A, B, L, stiffness, q=given.q)
    protocol = draw_protocol(rng, given.count)
    t = draw_times(rng, protocol, given.sampling)
    size, weight = log_uniform(rng, 0.003, 0.008), rng.dirichlet((4.0, 4.0, 4.0))
    duration = sum(protocol.durations)
    periods = [log_uniform(rng, duration / 60, duration / 10) for _ in range(3)]
    phases = rng.uniform(0, 2 * math.pi, 3)
    stress = None
    if hunting:
        size = size * math.sqrt(2) * hunting * given.sigma / SIGMA
        stress = Stress(
            tuple((size * weight).tolist()),
            tuple(2 * math.pi / p for p in periods),
            tuple(phases.tolist()),
        )
    return Draw(
        base,
        given.ratio,
        protocol,
        t,
        stress,
        sigma=given.sigma,
        least_ratio=_LEAST_RATIO,
        stiffness_error=given.stiffness_error,
        quantum=given.quantum,
        sampling=given.sampling,
    )


def beyond(rng: np.random.Generator, low: float, high: float) -> float:
    """In one case of two between `low` and `high`, else up to three times below or above them."""
    where = rng.random()
    if where < 0.5:
        return log_uniform(rng, low, high)
    return log_uniform(rng, low / 3, low) if where < 0.75 else log_uniform(rng, high, 3 * high)


def _step(w: Draw) -> float:
    """Median slip of a velocity [m]."""
    return float(np.median(np.multiply(w.protocol.velocities, w.protocol.durations)))


def _total(w: Draw) -> float:
    return float(np.dot(w.protocol.velocities, w.protocol.durations))


def _spacing(w: Draw) -> float:
    """Median slip from row to row [m]."""
    return float(np.median(np.diff(w.protocol.displacement(w.t))))


def _wavelength(rng: np.random.Generator, w: Draw) -> dict[str, float]:
    drawn = beyond(rng, min(2 * w.base.L, _total(w) / 60), _total(w) / 2)
    return {
        "lambda": max(drawn, 3 * _spacing(w)),  # a wave that no three rows see is none
        "phase": float(rng.uniform(0, 2 * math.pi)),
    }


def _reshaped(id: str, shape) -> Recipe:
    return replace(RECIPES[id], shape=shape)


WIDE: dict[str, Recipe] = RECIPES | {
    "second_state": _reshaped(
        "second_state",
        lambda rng, w: {"L2": beyond(rng, 0.2 * w.base.L, max(_step(w), 5 * w.base.L))},
    ),
    "ageing": Recipe(
        lambda rng, w: {"sign": -1.0 if w.base.q else 1.0},
        lambda a, shape: {"q": a * shape["sign"]},
        lambda w: 0.05,
        lambda w: 1.0,
    ),
    "stribeck": _reshaped(
        "stribeck",
        lambda rng, w: {
            "Vs": beyond(rng, min(w.protocol.velocities), w.fastest),
            "d": float(rng.uniform(0.5, 2.5)),
        },
    ),
    "slip_trend": replace(
        RECIPES["slip_trend"],
        start=lambda w: SIGMA / _total(w),
        limit=lambda w: 0.3 * w.base.f0 / _total(w),
    ),
    "run_in": _reshaped("run_in", lambda rng, w: {"dc": beyond(rng, 0.3 * _step(w), _total(w))}),
    "position_periodic": _reshaped("position_periodic", _wavelength),
    "thermal": _reshaped(
        "thermal",
        lambda rng, w: {
            "tau_T": beyond(
                rng,
                max(3 * float(np.median(np.diff(w.t))), w.crossing),
                sum(w.protocol.durations) / 2,
            )
        },
    ),
}
"""How effects are drawn: as in `generate`, but for these."""
