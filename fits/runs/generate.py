"""Synthetic runs of a press, with their truth. NumPy and SciPy only; nothing of jaxfric.

A slider without mass: shear stress tau on a spring of stiffness k, normal stress sigma(t),
    tau = sigma (f0 + A ln(V/V0) + theta),   dtau/dt = k (v(t) - V),
    dtheta/dt = -(V/L)(theta + B ln(V/V0)) - alpha (dsigma/dt)/sigma                (slip law)
    dtheta/dt = (B/L)(V0 exp(-theta/B) - V) - alpha (dsigma/dt)/sigma             (ageing law)
integrated by LSODA, rtol 1e-8, leg by leg. alpha: Linker & Dieterich (1992), J. Geophys. Res. 97.

How a run is drawn (from its seed alone)
    law         slip or ageing; A log-uniform in [.003, .012], B/A in [.7, 1.6], L in [4, 25] um,
                alpha in [.1, .3], f0 in [.45, .7]
    stiffness   K = k/sigma = ratio max(B - A, .2 B)/L, ratio log-uniform in [4, 12]
    events      the load comes on, then 50: velocity step 60 % (one rung up or down of 0.3, 1, 3,
                10, 30, 100 um/s, or two), hold of 10 (and 10 um) to 1000 s 12 %, stress by 5 to
                30 % in 0.3 to 3 s 8 %, with a velocity step 4 %, unloading to 20 to 70 % of the
                load and back 4 %, stick-slip 4 %, a glitch of the recorder 8 %
    legs        20 to 40 L of load-point motion, at most 400 um, after what loads the spring
    rates       of the recorder: "one" (some 25 rows per L at 3 um/s), or "many": a rate out of
                0.1, 1, 10, 100, 1000 Hz for each velocity, switched before its step
    recorder    friction: pieces of measured noise (`fits.blind.measured`) or white, sigma 2e-4 to
                6e-4; position: white, 0.02 to 1 um; normal stress: 1e-4 of itself
Runaways. A slider whose velocity passes 100 times the largest commanded one, which large steps of a
softer press do, is drawn again from the next stream of its seed.
Stick-slip is a saw-tooth drawn by hand: rises at K v, drops within two rows by .01 to .03.
Glitches: friction off by 20 to 100 sigma for one to three rows; the encoder set back by .2 to 5 mm.
"""

import contextlib
import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from fits.blind import measured

UM = 1e-6
LADDER = np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0]) * UM
KINDS = {
    "step": 0.60,
    "hold": 0.12,
    "stress": 0.08,
    "stress_with_step": 0.04,
    "unload": 0.04,
    "stick_slip": 0.04,
    "glitch": 0.08,
}
_LONGEST, _RUNAWAY = 600, 100.0
RATES = np.array([0.1, 1.0, 10.0, 100.0, 1000.0])


class RunawayError(RuntimeError):
    """The slider runs away from the load point: the run is drawn again."""


@dataclass(frozen=True)
class Press:
    """The slider of a run, SI."""

    law: str
    f0: float
    A: float
    B: float
    L: float
    alpha: float
    V0: float
    K: float
    sigma: float


@dataclass(frozen=True)
class Happening:
    """What happens at `time` [s]; velocities [m/s] before and after, and of what kind it is."""

    kind: str
    time: float
    before: float
    after: float


@dataclass
class Leg:
    """A stretch at one commanded velocity, in which the stress goes to `sigma` in `ramp`."""

    lasts: float
    velocity: float
    sigma: float
    ramp: float = 0.0
    saw: bool = False
    rate: float = 1.0


@dataclass
class Run:
    """The rows of a run, SI, and its truth."""

    time: np.ndarray
    position: np.ndarray
    friction: np.ndarray
    sigma: np.ndarray
    press: Press
    happenings: list[Happening]
    noise: float
    clean: np.ndarray = field(repr=False)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_press(rng: np.random.Generator, law: str | None = None) -> Press:
    A, L = log_uniform(rng, 0.003, 0.012), log_uniform(rng, 4 * UM, 25 * UM)
    B, ratio = A * log_uniform(rng, 0.7, 1.6), log_uniform(rng, 4, 12)
    return Press(
        law=law or ("slip", "ageing")[rng.integers(2)],
        f0=float(rng.uniform(0.45, 0.7)),
        A=A,
        B=B,
        L=L,
        alpha=float(rng.uniform(0.1, 0.3)),
        V0=3 * UM,
        K=ratio * max(B - A, 0.2 * B) / L,
        sigma=float(rng.uniform(5e6, 1e8)),
    )


def generate(
    seed: int,
    *,
    law: str | None = None,
    events: int = 50,
    rates: str = "many",
    noise: str = "white",
    kinds: dict[str, float] = KINDS,
) -> Run:
    """A run from its seed. `rates`: "one" or "many"; `noise`: "white" or a source of
    `fits.blind.measured`; `kinds`: probabilities of what happens."""
    for attempt in range(50):
        with contextlib.suppress(RunawayError):
            return _generate(
                np.random.default_rng([seed, 655, attempt]), law, events, rates, noise, kinds
            )
    raise RuntimeError(f"seed {seed}: every press ran away")


def _generate(rng, law, events: int, rates: str, noise: str, kinds: dict[str, float]) -> Run:
    press = draw_press(rng, law)
    legs, happenings, glitches = _schedule(rng, press, events, kinds)
    _set_rates(rng, press, legs, rates)
    time, position, friction, sigma, counts = _move(press, legs, rng)
    size = log_uniform(rng, 2e-4, 6e-4)
    clean = friction.copy()
    if noise == "white":
        friction = friction + size * rng.standard_normal(len(time))
    else:
        friction = friction + size * measured.cut(noise, _pieces(counts), rng)
    position = position + log_uniform(rng, 0.02, 1.0) * UM * rng.standard_normal(len(time))
    sigma = sigma * (1 + 1e-4 * rng.standard_normal(len(time)))
    for at, what in glitches:
        row = int(np.searchsorted(time, at))
        if what == "spike":
            wide = int(rng.integers(1, 4))
            friction[row : row + wide] += rng.choice((-1, 1)) * size * rng.uniform(20, 100)
        else:
            position[row:] += rng.choice((-1, 1)) * log_uniform(rng, 200, 5000) * UM
    return Run(time, position, friction, sigma, press, happenings, size, clean)


def _pieces(counts: list[int]) -> list[int]:
    """Rows of legs in pieces no longer than the shortest stretch of measured noise."""
    return [len(part) for n in counts for part in np.array_split(np.empty(n), -(-n // _LONGEST))]


def _schedule(rng, press: Press, events: int, kinds: dict[str, float]):
    """Legs, what happens at their joints, and glitches (time, what)."""
    rung, sigma = 2, press.sigma
    lasts = lambda v: min(rng.uniform(20, 40) * press.L, 400 * UM) / v  # noqa: E731
    load = 1.1 * press.f0 / press.K / LADDER[rung]
    legs = [Leg(60.0, 0.0, sigma), Leg(load + 2 * lasts(LADDER[rung]), LADDER[rung], sigma)]
    now = legs[0].lasts
    happenings, glitches = [Happening("reload", now, 0.0, LADDER[rung])], []
    now += legs[1].lasts

    def go(velocity: float, time: float, **more) -> None:
        nonlocal now
        legs.append(Leg(time, velocity, sigma, **more))
        now += time

    def change_stress() -> float:
        """Change the stress; the way [m] on which the spring takes up what it adds to friction."""
        nonlocal sigma
        before = sigma
        sigma *= math.exp(rng.choice((-1, 1)) * log_uniform(rng, 0.05, 0.3))
        return 1.2 * press.f0 * max(sigma - before, 0.0) / (press.K * press.sigma)

    names, shares = list(kinds), np.array(list(kinds.values()))
    for _ in range(events):
        kind = names[rng.choice(len(names), p=shares / shares.sum())]
        v = LADDER[rung]
        if kind in ("step", "stress_with_step"):
            options = [r for r in (rung - 2, rung - 1, rung - 1, rung + 1, rung + 1, rung + 2)]
            rung = int(rng.choice([r for r in options if 0 <= r < len(LADDER)]))
            happenings.append(
                Happening("step" if kind == "step" else "stress", now, v, LADDER[rung])
            )
            ramp = more = 0.0
            if kind != "step":
                more = change_stress() / LADDER[rung]
                ramp = float(rng.uniform(0.3, 1.0)) * min(3.0, press.L / LADDER[rung])
            go(LADDER[rung], lasts(LADDER[rung]) + more, ramp=ramp)
        elif kind == "hold":
            happenings.append(Happening("hold", now, v, 0.0))
            go(0.0, log_uniform(rng, max(10, 10 * UM / v), 1000))
            happenings.append(Happening("reload", now, 0.0, v))
            go(v, lasts(v))
        elif kind == "stress":
            happenings.append(Happening("stress", now, v, v))
            more = change_stress() / v
            go(v, lasts(v) + more, ramp=float(rng.uniform(0.3, 3.0)))
        elif kind == "unload":
            share = rng.uniform(0.3, 0.8)
            back = share * press.f0 * sigma / (press.K * press.sigma)
            happenings.append(Happening("unload", now, v, -v))
            go(-v, back / v)
            happenings.append(Happening("reload", now, -v, v))
            go(v, (1.3 * back) / v + lasts(v))
        elif kind == "stick_slip":
            happenings.append(Happening("stick_slip", now, v, v))
            go(v, 1.5 * lasts(v), saw=True)
            go(v, lasts(v))
        else:
            at = now + 0.3 * (end := 0.7 * lasts(v))
            what = ("spike", "reset")[rng.integers(2)]
            glitches.append((at, what))
            happenings.append(Happening("glitch", at, v, v))
            go(v, end)
    return legs, happenings, glitches


def _set_rates(rng, press: Press, legs: list[Leg], rates: str) -> None:
    """The sampling rate [1/s] of every leg."""
    for leg in legs:
        v = abs(leg.velocity) if rates == "many" else LADDER[2]
        wanted = rng.uniform(12, 40) * v / press.L if v else 1.0
        leg.rate = float(RATES[np.argmin(np.abs(np.log(RATES / wanted)))]) if v else 1.0
    if rates == "one":
        moving = [leg.rate for leg in legs if leg.velocity]
        fast = max(LADDER[2] * 25 / press.L, *moving)
        for leg in legs:
            leg.rate = fast


def _move(press: Press, legs: list[Leg], rng):
    """Rows of all legs: time, position, friction, normal stress; and rows per leg."""
    begin = 0.05 * press.f0
    tau, theta, sigma = begin * press.sigma, 0.0, press.sigma
    now = where = 0.0
    out = [[] for _ in range(4)]
    counts = []
    for number, leg in enumerate(legs):
        # the recorder is switched to the faster of two rates a little before the step
        rate = leg.rate
        count = max(int(leg.lasts * rate), 4)
        t = (np.arange(count) + 0.5) * leg.lasts / count
        if number + 1 < len(legs) and legs[number + 1].rate > rate:
            early = min(0.1 * leg.lasts, 60 / legs[number + 1].rate)
            fine = leg.lasts - early + np.arange(60) * early / 60
            t = np.concatenate([t[t < leg.lasts - early], fine])
        level = lambda s, a=sigma, b=leg.sigma, r=leg.ramp: (  # noqa: E731
            a + (b - a) * np.clip(s / r, 0, 1) if r else np.full_like(np.asarray(s, float), b)
        )
        tau, theta, friction = _leg(press, leg, tau, theta, sigma, t)
        if leg.saw:
            friction = _saw(rng, press, leg, t, friction)
        for column, values in zip(
            out, (now + t, where + leg.velocity * t, friction, level(t)), strict=True
        ):
            column.append(values)
        counts.append(len(t))
        now, where, sigma = now + leg.lasts, where + leg.velocity * leg.lasts, leg.sigma
    return *(np.concatenate(column) for column in out), counts


def _leg(press: Press, leg: Leg, tau: float, theta: float, sigma: float, t: np.ndarray):
    """Shear stress and state at the end of a leg, and friction at times t in it."""
    p, k = press, press.K * press.sigma
    slope = (leg.sigma - sigma) / leg.ramp if leg.ramp else 0.0
    edges = [0.0, leg.ramp, leg.lasts] if leg.ramp else [0.0, leg.lasts]
    if not leg.ramp:
        sigma = leg.sigma
    friction = np.empty(len(t))
    for i, (a, b) in enumerate(pairwise(edges)):
        rate_s = slope if leg.ramp and i == 0 else 0.0
        at = (lambda s: sigma + slope * s) if rate_s else (lambda s: leg.sigma)

        def rate(s, y, rate_s=rate_s, at=at):
            u = min((y[0] / at(s) - p.f0 - y[1]) / p.A, 25.0)
            V = p.V0 * math.exp(u) if u > -200 else 0.0
            if p.law == "slip":
                change = -(V / p.L) * (y[1] + p.B * u)
            else:
                change = (p.B / p.L) * (p.V0 * math.exp(min(-y[1] / p.B, 600.0)) - V)
            return [k * (leg.velocity - V), change - p.alpha * rate_s / at(s)]

        inside = (t >= a) & (t < b) if b < leg.lasts else t >= a
        stops = np.append(t[inside], b) if not inside.any() or t[inside][-1] < b else t[inside]
        found = solve_ivp(
            rate, (a, b), [tau, theta], "LSODA", stops, rtol=1e-8, atol=[1e-8 * p.sigma, 1e-10]
        )
        fastest = (found.y[0] / np.array([at(s) for s in found.t]) - p.f0 - found.y[1]) / p.A
        if found.status or not fastest.max() < math.log(_RUNAWAY * LADDER[-1] / p.V0):
            raise RunawayError(f"a leg at {leg.velocity} m/s: {found.message}")
        levels = np.array([at(s) for s in t[inside]])
        friction[inside] = found.y[0, : inside.sum()] / levels
        tau, theta = float(found.y[0, -1]), float(found.y[1, -1])
    return tau, theta, friction


def _saw(rng, press: Press, leg: Leg, t: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """Saw teeth about a leg's friction: drops within two rows, then a rise at K v."""
    drop = rng.uniform(0.01, 0.03)
    period = drop / (press.K * leg.velocity)
    period = min(period, leg.lasts / 5)
    edges = np.cumsum(rng.uniform(0.9, 1.1, int(leg.lasts / period / 0.9) + 2)) * period
    tooth = np.searchsorted(edges, t)
    begin = np.concatenate([[0.0], edges])[tooth]
    ahead = (t - begin) / np.diff(np.concatenate([[0.0], edges]))[tooth]
    fade = np.minimum(t / period, 1.0) * np.minimum((leg.lasts - t) / period, 1.0)
    return friction + drop * (ahead - 0.5) * fade
