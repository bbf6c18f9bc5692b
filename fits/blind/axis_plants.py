"""A servo axis with effects, in NumPy and SciPy: the equations behind the blind axis records.

Symbols, SI: t time [s], q position [m], v = dq/dt [m/s], s = sgn v, F motor force [N], h = 1 ms.

Plant   M dv/dt = F - [A s + Fv v] - o,   A = Fc,   and at rest it stays while |F - o| <= A.
Drive   at the instants t_k = k h, F held in between (EMPS, two nested loops):
        v_k = (q_k - q_{k-2})/(2 h), the difference of two-sample averages of the encoder's q,
        u_k = kv (kp (q_ref,k - q_k) - v_k),   F_k = gtau u_k.   The record is F_k.
It begins at rest on the reference.

What an effect changes (`EFFECTS`: its id and its parameters)
    cubic                + c v^3                                            c [N s3/m3]
    stribeck             A + fs exp(-(v/vs)^2)                              fs [N], vs [m/s]
    direction_asymmetry  v < 0: Fc (1 + dFc), Fv (1 + dFv)                  dFc, dFv [1]
    position_periodic    + a cos(2 pi q/lambda + phase)                     a [N], lambda [m], phase
    position_dependence  A + p (q - centre)                                 p [N/m], centre [m]
    presliding           A z + sigma1 length dz/dt in place of A s, with    length [m]
                         dz/dt = (v - |v| z)/length, |z| <= 1 (Dahl;        sigma1 [N s/m]
                         LuGre of constant level where sigma1 > 0)
    rate_and_state       A + Ad ln(1 + |v|/v_c) + theta                     A, B [N], L [m],
                         (Ad is its parameter A) with dtheta/dt =           v_c [m/s]
                         -(|v|/L) (theta + B ln(1 + |v|/v_c))
    time_drift           o + r t                                            r [N/s]
    sensor_lag           tau dy/dt = F - y                                  tau [s]
    sensor_delay         y(t) = F(t - d)                                    d [s]
For the two sensors F is the line through the F_k, so that they vanish with tau and d. Several
effects at once: A collects what is added to it, a bristle takes its direction from the sign of
z, the force is read through lag, then delay.

How it is solved. F is constant from sample to sample. Sliding with the sign s is smooth and
stepped by the classical Runge-Kutta formula, in parts of h where ripple, Stribeck peak or
bristle ask for it; the instant of v = 0 is found by regula falsi on the length of the step.
There the axis sticks, with q constant, or goes on with the sign of the force in excess. The
bristle has a closed form along sliding of one sign, z = s + (z0 - s) exp(-|q - q0|/length),
so that only q and v are stepped, however stiff it is. Nothing is regularised.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

EFFECTS: dict[str, tuple[str, ...]] = {
    "cubic": ("c",),
    "stribeck": ("fs", "vs"),
    "direction_asymmetry": ("dFc", "dFv"),
    "position_periodic": ("a", "lambda", "phase"),
    "position_dependence": ("p", "centre"),
    "presliding": ("length", "sigma1"),
    "rate_and_state": ("A", "B", "L", "v_c"),
    "time_drift": ("r",),
    "sensor_lag": ("tau",),
    "sensor_delay": ("d",),
}
Parameters = Mapping[str, Mapping[str, float]]
"""Parameters by the id of the effect and their name."""

PERIOD = 1e-3  # s, of the controller and of the record
_SATURATED = 45.0  # exp(-45) is beyond what a double resolves
_ASTRAY = 0.02  # m from the reference
_QUIET = 1e-8  # N: a bristle in balance to this much is at rest
_PHASES = 2000  # in one interval; a plant that has more chatters


class RunawayError(RuntimeError):
    """The axis left its reference, or chatters without end."""


@dataclass(frozen=True)
class Base:
    """The base plant: mass [kg], viscous [N s/m] and Coulomb [N] friction, offset [N]."""

    M: float
    Fv: float
    Fc: float
    offset: float


@dataclass(frozen=True)
class Controller:
    """The nested loops: kp [1/s], kv [V s/m], gtau [N/V]."""

    kp: float
    kv: float
    gtau: float


@dataclass(frozen=True)
class Encoder:
    """The measured position: an error per sample [m] is added, then `quantum` [m] rounds."""

    error: np.ndarray
    quantum: float

    def read(self, q: float, k: int) -> float:
        seen = q + float(self.error[k])
        return self.quantum * round(seen / self.quantum) if self.quantum > 0 else seen


@dataclass(frozen=True)
class Trajectory:
    """What the axis does at the samples. `record` is the force channel without noise."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    measured: np.ndarray
    force: np.ndarray  # commanded, held until the next sample
    record: np.ndarray
    stuck: np.ndarray  # at the sample and until the next one
    bristle: np.ndarray  # z; the sign of sliding where there is no bristle


def simulate(
    base: Base,
    controller: Controller,
    reference: np.ndarray,
    effects: Parameters,
    *,
    encoder: Encoder | None = None,
) -> Trajectory:
    """The axis with `effects` along the reference [m], one value a `PERIOD`.

    Without an encoder the controller sees the position itself. Raises `RunawayError` for an
    axis that leaves its reference, ValueError for an unknown effect or parameter.
    """
    wanted = reference.tolist()
    axis = _Axis(base, effects, wanted[0])
    count, kd = len(wanted), controller.kv / (2.0 * PERIOD)
    q, v, seen, force, stuck, z = ([0.0] * count for _ in range(6))
    for k, r in enumerate(wanted):
        q[k], v[k], z[k] = axis.q, axis.v, axis.state()
        if not abs(axis.q - r) < _ASTRAY:
            raise RunawayError(f"{axis.q - r:.3g} m from the reference at {k * PERIOD:.3f} s")
        seen[k] = encoder.read(axis.q, k) if encoder else axis.q
        moved = seen[k] - seen[max(k - 2, 0)]
        force[k] = controller.gtau * (controller.kv * controller.kp * (r - seen[k]) - kd * moved)
        stuck[k] = axis.advance(force[k], k * PERIOD, PERIOD)
    commanded = np.array(force)
    return Trajectory(
        t=PERIOD * np.arange(count),
        q=np.array(q),
        v=np.array(v),
        measured=np.array(seen),
        force=commanded,
        record=sensed(commanded, effects),
        stuck=np.array(stuck, dtype=bool),
        bristle=np.array(z),
    )


def sensed(force: np.ndarray, effects: Parameters) -> np.ndarray:
    """The recorded force: through the lag and the delay, along the line through the samples."""
    t = PERIOD * np.arange(len(force))
    tau = effects.get("sensor_lag", {}).get("tau", 0.0)
    if tau > 0:
        decay = math.exp(-PERIOD / tau)
        out, values = [float(force[0])], force.tolist()
        for now, then in pairwise(values):
            behind = tau * (then - now) / PERIOD  # of a ramp
            out.append(then - behind + (out[-1] - now + behind) * decay)
        force = np.array(out)
    delay = effects.get("sensor_delay", {}).get("d", 0.0)
    return np.interp(t - delay, t, force) if delay else force.copy()


class _Axis:
    """Position, velocity and phase: s = +1, -1 sliding, 0 stuck (or a bristle in balance)."""

    def __init__(self, base: Base, effects: Parameters, start: float):
        for name, values in effects.items():
            if name not in EFFECTS or set(values) != set(EFFECTS[name]):
                raise ValueError(f"effect {name} with {sorted(values)}: EFFECTS has {EFFECTS}")

        def number(effect: str, name: str, null: float = 0.0) -> float:
            return effects.get(effect, {}).get(name, null)

        less = number("direction_asymmetry", "dFc"), number("direction_asymmetry", "dFv")
        self.M, self.o = base.M, base.offset
        self.Fc = {1: base.Fc, -1: base.Fc * (1.0 + less[0])}
        self.Fv = {1: base.Fv, -1: base.Fv * (1.0 + less[1])}
        self.c, self.r = number("cubic", "c"), number("time_drift", "r")
        self.fs, self.vs = number("stribeck", "fs"), number("stribeck", "vs", 1.0)
        self.a = number("position_periodic", "a")
        self.wave = 2.0 * math.pi / number("position_periodic", "lambda", 1.0)
        self.phase = number("position_periodic", "phase")
        self.p = number("position_dependence", "p")
        self.centre = number("position_dependence", "centre")
        self.length = number("presliding", "length")
        self.sigma1 = number("presliding", "sigma1")
        self.Ad, self.B = number("rate_and_state", "A"), number("rate_and_state", "B")
        self.L, self.v_c = number("rate_and_state", "L"), number("rate_and_state", "v_c", 1.0)
        self.theta = 0.0
        self.q, self.v, self.s, self.F = start, 0.0, 0, 0.0
        self.q0 = start
        net = -self.o - self.ripple(start)
        level = self.amplitude(start, 0.0, 1 if net > 0 else -1, 0.0)
        self.z0 = max(-1.0, min(1.0, net / level))
        if self.length:
            omega = math.sqrt((max(self.Fc.values()) + abs(self.fs)) / (self.length * self.M))
            self.shortest = 0.04 / max(omega, self.sigma1 / self.M)

    def state(self) -> float:
        return self.bristle(self.q) if self.length else float(self.s)

    def ripple(self, q: float) -> float:
        return self.a * math.cos(self.wave * q + self.phase) if self.a else 0.0

    def amplitude(self, q: float, v: float, s: int, theta: float) -> float:
        """A: what multiplies the sign of sliding, or the bristle."""
        level = self.Fc[s] + self.p * (q - self.centre)
        if self.L:
            level += self.Ad * math.log1p(abs(v) / self.v_c) + theta
        return level + self.fs * math.exp(-((v / self.vs) ** 2)) if self.fs else level

    def bristle(self, q: float) -> float:
        """z at q, on the branch that began at q0."""
        if not self.s:
            return self.z0
        x = self.s * (q - self.q0) / self.length
        return self.s + (self.z0 - self.s) * math.exp(-x) if x < _SATURATED else float(self.s)

    def ageing(self, v: float, theta: float) -> float:
        """dtheta/dt."""
        if not self.L:
            return 0.0
        return -abs(v) / self.L * (theta + self.B * math.log1p(abs(v) / self.v_c))

    def acceleration(self, q: float, v: float, theta: float, t: float) -> float:
        """dv/dt while sliding with the sign s."""
        s = self.s
        if self.length:
            z = self.bristle(q)
            level = self.amplitude(q, v, 1 if z > 0 else -1, theta)
            held = level * z + self.sigma1 * v * (1.0 - s * z)
        else:
            held = s * self.amplitude(q, v, s, theta)
        force = self.F - self.o - self.r * t - held - (self.Fv[s] + self.c * v * v) * v
        return (force - self.ripple(q)) / self.M

    def step(self, t: float, h: float) -> tuple[float, float, float]:
        """q, v and theta after h: the classical Runge-Kutta formula."""
        half, q, v, theta = 0.5 * h, self.q, self.v, self.theta
        a1, b1 = self.acceleration(q, v, theta, t), self.ageing(v, theta)
        v2, theta2 = v + half * a1, theta + half * b1
        a2, b2 = self.acceleration(q + half * v, v2, theta2, t + half), self.ageing(v2, theta2)
        v3, theta3 = v + half * a2, theta + half * b2
        a3, b3 = self.acceleration(q + half * v2, v3, theta3, t + half), self.ageing(v3, theta3)
        v4, theta4 = v + h * a3, theta + h * b3
        a4, b4 = self.acceleration(q + h * v3, v4, theta4, t + h), self.ageing(v4, theta4)
        q_next = q + h / 6.0 * (v + 2.0 * (v2 + v3) + v4)
        v_next = v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        return q_next, v_next, theta + h / 6.0 * (b1 + 2.0 * (b2 + b3) + b4)

    def pull(self, t: float) -> float:
        """The acceleration now."""
        return self.acceleration(self.q, self.v, self.theta, t)

    def longest(self, left: float, t: float) -> float:
        """The step that ripple, Stribeck peak and bristle allow, at most `left` [s]."""
        speed, h = abs(self.v), left
        if self.a:
            h = min(h, 0.1 / (self.wave * (speed + 1e-3)))
        if self.fs and speed < 6.0 * self.vs + 5e-3:
            h = min(h, 0.06 * self.vs / (abs(self.pull(t)) + 1e-9))
        if self.L:
            h = min(h, 0.04 * self.L / (speed + 1e-12))
            h = min(h, 0.06 * (self.v_c + speed) / (abs(self.pull(t)) + 1e-9))
        if self.length and abs(self.q - self.q0) < _SATURATED * self.length:
            h = min(h, self.shortest, 0.04 * self.length / (speed + 1e-12))
        return left / math.ceil(left / h - 1e-9) if h < left else left

    def advance(self, force: float, t: float, span: float) -> bool:
        """Hold the force for `span` [s] from t on. True if it did not move at all."""
        self.F, left, still = force, span, True
        for _ in range(_PHASES):
            if not self.s:
                left -= self.hold(left, t + span - left)
            if left <= 1e-16:
                return still
            still = False
            left -= self.slide(left, t + span - left)
            if left <= 1e-16:
                return still
        raise RunawayError(f"more than {_PHASES} phases in {span:g} s at {t:.3f} s")

    def hold(self, left: float, t: float) -> float:
        """At v = 0: stay for the returned time, then slide with the sign that is left in s."""
        net = self.F - self.o - self.r * t - self.ripple(self.q)
        if self.length:
            net -= self.amplitude(self.q, 0.0, 1 if self.z0 > 0 else -1, self.theta) * self.z0
            if abs(net) < _QUIET:
                return left
            self.s = 1 if net > 0 else -1
            return 0.0
        forward, back = (self.amplitude(self.q, 0.0, s, self.theta) for s in (1, -1))
        if -back <= net <= forward:
            if not self.r:
                return left
            wait = (forward - net) / -self.r if self.r < 0 else (net + back) / self.r
            if wait >= left:
                return left
            self.s = 1 if self.r < 0 else -1
            return wait
        self.s = 1 if net > 0 else -1
        return 0.0

    def slide(self, left: float, t: float) -> float:
        """One step with the sign s, cut short where v = 0; the time it took."""
        h = self.longest(left, t)
        q, v, theta = self.step(t, h)
        if v * self.s > 0:
            self.q, self.v, self.theta = q, v, theta
            return h
        if self.v == 0.0:  # the force in excess is lost in rounding
            self.rest(self.q, self.theta)
            return left
        h = self.stop(t, h, v)
        q, _, theta = self.step(t, h)
        self.rest(q, theta)
        return h

    def rest(self, q: float, theta: float) -> None:
        if self.length:
            self.z0 = self.bristle(q)
        self.q, self.v, self.s, self.q0, self.theta = q, 0.0, 0, q, theta

    def stop(self, t: float, h: float, v: float) -> float:
        """When, after t, v vanishes: regula falsi (Illinois) on the step's length."""
        low, high, at_low, at_high = 0.0, h, self.v, v
        if v == 0.0:
            return h
        middle = h
        for _ in range(80):
            middle = (low * at_high - high * at_low) / (at_high - at_low)
            here = self.step(t, middle)[1]
            if abs(here) < 1e-17 or abs(high - low) < 1e-18:
                break
            if here * at_high < 0:
                low, at_low = high, at_high
            else:
                at_low *= 0.5
            high, at_high = middle, here
        return middle
