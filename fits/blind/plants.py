"""Sliders with effects, in NumPy and SciPy: the equations behind the blind records.

Symbols, SI: t time [s], x slip of the slider [m], V = dx/dt [m/s], u = ln(V/V0) with V0 the first
commanded velocity, f friction coefficient [1], theta state [1], K stiffness over normal force
[1/m], m mass over normal force [s2/m], k_v damping over normal force [s/m], V_m velocity of
the load point, s its lead over the slider beyond the start [m], n = sigma_n(t)/sigma_n0.

Base    f = f0 + A u + theta,   dtheta/dt = -(V/L) (theta - theta_ss),   theta_ss = -B u
        or, with q = 1, under the ageing law; the effect `ageing` adds its q to that of the base
        ds/dt = V_m - V,   quasi-static:  n f = F0 + K s + k_v (V_m - V)
                           inertial:      m dV/dt = F0 + K s + k_v (V_m - V) - n f
        It begins in steady sliding at V0 with s = 0, which sets F0. The record is f.

What an effect changes (`EFFECTS`: its id and its parameters)
    second_state          f + theta2, dtheta2/dt = -(V/L2) (theta2 + B2 u)        B2 [1], L2 [m]
    ageing                dtheta/dt = (1 - q) slip law + q ageing law, which is   q [1], 0..1
                          (B V0/L) [exp(-theta/B) (1 + V/Vc) - V/V0]
    velocity_dependent_L  L (V/V0)^n in place of L                                n [1]
    evolution_cutoff      theta_ss = -B [u - ln(1 + V/Vc)]                        Vc [m/s]
    viscous               f + c V                                                 c [s/m]
    stribeck              f + fs exp(-(V/Vs)^d)                                   fs, Vs [m/s], d
    slip_trend            f + s x                                                 s [1/m]
    run_in                f + d (1 - exp(-x/dc))                                  d [1], dc [m]
    position_periodic     f + a sin(2 pi x/lambda) + b cos(2 pi x/lambda)         a, b, lambda [m]
    normal_stress         dtheta/dt - alpha n'/n (Linker and Dieterich)           alpha [1]
                          (that the force is n f holds wherever sigma_n moves)
    thermal               f - a_T T, tau_T dT/dt = f V/(f0 V0) - T, that is       a_T, tau_T [s]
                          T' = (p f V - h T)/C with T in units of p f0 V0/h
    frictional_delay      theta_ss at V(t - alpha), slip law                      alpha [s]
    stiffness             K exp(kappa) in place of K                              kappa [1]
    damping, inertia      k_v, m more than declared (zero)                       k_v [s/m], m [s2/m]
    servo_lag             tau dV_m/dt = V_cmd - V_m                               tau [s]
    sensor_lag            tau dy/dt = f - y                                       tau [s]
    sensor_delay          y(t) = f(t - d)                                         d [s]
    time_drift            y = f + r t                                             r [1/s]
    gain                  y = (1 + g) f                                           g [1]
Several at once: the force is read through lag, then delay, then gain and drift.

How it is solved. Without mass the balance of forces is differentiated in time,
    [n (A + V df/dV) + k_v V] du/dt = K (V_m - V) + k_v V_m' - n' f - n (df/dt at constant V),
with a jump of u where a dashpot meets a velocity step. LSODA runs from one velocity step to the
next. The delay equation is stepped by the classical Runge-Kutta formula on a grid that is
finest after each velocity step, with the past from its own cubic Hermite interpolant.
"""

import math
import warnings
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import ODEintWarning, odeint
from scipy.interpolate import CubicHermiteSpline

EFFECTS: dict[str, tuple[str, ...]] = {
    "second_state": ("B2", "L2"),
    "ageing": ("q",),
    "velocity_dependent_L": ("n",),
    "evolution_cutoff": ("Vc",),
    "viscous": ("c",),
    "stribeck": ("fs", "Vs", "d"),
    "slip_trend": ("s",),
    "run_in": ("d", "dc"),
    "position_periodic": ("a", "b", "lambda"),
    "normal_stress": ("alpha",),
    "thermal": ("a_T", "tau_T"),
    "frictional_delay": ("alpha",),
    "stiffness": ("kappa",),
    "damping": ("k_v",),
    "inertia": ("m",),
    "servo_lag": ("tau",),
    "sensor_lag": ("tau",),
    "sensor_delay": ("d",),
    "time_drift": ("r",),
    "gain": ("g",),
}
Parameters = Mapping[str, Mapping[str, float]]
"""Parameters by the id of the effect and their name."""

RUNAWAY = 3.5  # in u, above the fastest command
_HISTORY_STEP = 0.07  # of the shorter slip, L or A/K, per step of a delay plant
_HISTORY_GROWTH = 0.05  # a step is at most this part of the time since the velocity step


class RunawayError(RuntimeError):
    """The slider left the neighbourhood of steady sliding, or could not be integrated."""


@dataclass(frozen=True)
class Base:
    """The base plant. SI; friction is a coefficient."""

    f0: float
    A: float
    B: float
    L: float
    K: float
    m: float = 0.0  # 0: quasi-static
    k_v: float = 0.0
    q: float = 0.0  # 0: slip law, 1: ageing law


@dataclass(frozen=True)
class Protocol:
    """Commanded velocities [m/s], each for a duration [s]."""

    velocities: tuple[float, ...]
    durations: tuple[float, ...]

    @property
    def starts(self) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(self.durations[:-1])])

    @property
    def corners(self) -> np.ndarray:
        """Commanded displacement at the starts [m]."""
        moved = np.multiply(self.velocities, self.durations)
        return np.concatenate([[0.0], np.cumsum(moved[:-1])])

    def displacement(self, t: np.ndarray) -> np.ndarray:
        """Commanded displacement [m] at the times `t` [s]."""
        k = np.clip(np.searchsorted(self.starts, t, side="right") - 1, 0, None)
        return self.corners[k] + np.take(self.velocities, k) * (t - self.starts[k])


@dataclass(frozen=True)
class Stress:
    """sigma_n/sigma_n0 = exp(sum_i a_i [sin(w_i t + p_i) - sin p_i]): a servo that hunts."""

    amplitudes: tuple[float, ...] = ()
    frequencies: tuple[float, ...] = ()  # rad/s
    phases: tuple[float, ...] = ()

    def logarithm(self, t):
        terms = zip(self.amplitudes, self.frequencies, self.phases, strict=True)
        return sum((a * (np.sin(w * t + p) - math.sin(p)) for a, w, p in terms), 0.0 * t)

    def at(self, t: float) -> tuple[float, float]:
        """The ratio n and n'/n [1/s]."""
        log = rate = 0.0
        for a, w, p in zip(self.amplitudes, self.frequencies, self.phases, strict=True):
            log += a * (math.sin(w * t + p) - math.sin(p))
            rate += a * w * math.cos(w * t + p)
        return math.exp(log), rate


@dataclass(frozen=True)
class Trajectory:
    """What the plant does at the sample times. `record` is the force channel without noise."""

    t: np.ndarray
    record: np.ndarray
    friction: np.ndarray
    u: np.ndarray
    slip: np.ndarray
    load_point: np.ndarray
    stress: np.ndarray  # n


def simulate(
    base: Base,
    protocol: Protocol,
    effects: Parameters,
    t: np.ndarray,
    *,
    stress: Stress | None = None,
    rtol: float = 1e-9,
) -> Trajectory:
    """The plant with `effects` at the times `t`, ascending from 0.

    Raises `RunawayError` for a plant that slips away, ValueError for an unknown effect or
    parameter, and for a frictional delay with mass (the delay solver is explicit).
    """
    plant = _Plant(base, protocol, effects, stress)
    delay = effects.get("sensor_delay", {}).get("d", 0.0)
    late = np.clip(t - delay, 0.0, None) if delay else t
    times = np.union1d(t, late) if delay else t
    looks_back = plant.number("frictional_delay", "alpha") > 0
    solve = plant.delayed if looks_back else plant.integrate
    z = solve(times, rtol)
    friction = np.array([plant.friction(*each) for each in zip(times, z, strict=True)])
    seen = z[:, plant.reading] if plant.reading is not None else friction
    now, then = np.searchsorted(times, t), np.searchsorted(times, late)
    gain, drift = plant.number("gain", "g"), plant.number("time_drift", "r")
    load_point = np.array([plant.load_point(each) for each in t])
    return Trajectory(
        t=t,
        record=(1.0 + gain) * seen[then] + drift * t,
        friction=friction[now],
        u=z[now, 1],
        slip=load_point - z[now, 0],
        load_point=load_point,
        stress=np.exp(plant.stress.logarithm(t)),
    )


def simulate_base(
    base: Base,
    protocol: Protocol,
    t: np.ndarray,
    *,
    stress: Stress | None = None,
    rtol: float = 1e-9,
) -> np.ndarray:
    """Friction of the quasi-static base alone: two variables, u and theta. For refits.

    Raises `RunawayError`.
    """
    A, B, L, K = base.A, base.B, base.L, base.K
    V0 = protocol.velocities[0]

    def rates(z, _, V_m, _t0):
        V = V0 * math.exp(min(z[0], 60.0))
        dtheta = -(V / L) * (z[1] + B * z[0])
        return (K * (V_m - V) - dtheta) / A, dtheta

    def rates_under(z, t, V_m, t0):
        V = V0 * math.exp(min(z[0], 60.0))
        slip = -(V / L) * (z[1] + B * z[0])
        ageing = (B * V0 / L) * (math.exp(min(-z[1] / B, 60.0)) - V / V0)
        dtheta = (1.0 - base.q) * slip + base.q * ageing
        n, dn = (stress or Stress()).at(t0 + t)
        f = base.f0 + A * z[0] + z[1]
        return (K * (V_m - V) / n - dn * f - dtheta) / A, dtheta

    law, z, out = rates_under if stress or base.q else rates, np.zeros(2), np.empty((len(t), 2))
    for t0, (here, ts, V_m) in zip(protocol.starts, _segments(protocol, t), strict=True):
        path = _lsoda(law, z, ts, (V_m, t0), rtol, 1e-3 * rtol)
        out[here], z = path[1:-1], path[-1]
    if np.max(out[:, 0]) > math.log(max(protocol.velocities) / V0) + RUNAWAY:
        raise RunawayError("the base plant runs away")
    return base.f0 + A * out[:, 0] + out[:, 1]


def _segments(protocol: Protocol, t: np.ndarray):
    """Per commanded velocity: its samples, local times with both ends, and the velocity."""
    edges = np.searchsorted(t, protocol.starts, side="left")
    edges = np.append(edges, len(t))
    for k, (V_m, span) in enumerate(zip(protocol.velocities, protocol.durations, strict=True)):
        here = slice(edges[k], edges[k + 1])
        local = np.clip(t[here] - protocol.starts[k], 0.0, span)
        yield here, np.concatenate([[0.0], local, [span]]), V_m


def _lsoda(rates, z, ts, args, rtol, atol) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ODEintWarning)
        try:
            path, info = odeint(
                rates, z, ts, args=args, rtol=rtol, atol=atol, mxstep=1500, full_output=True
            )
        except (OverflowError, ZeroDivisionError) as error:
            raise RunawayError(str(error)) from error
    if info["message"] != "Integration successful." or not np.all(np.isfinite(path)):
        raise RunawayError(info["message"])
    return path


@dataclass
class _Plant:
    """The right-hand side. Variables z: s, u, theta, then theta2, T, y where they are there."""

    base: Base
    protocol: Protocol
    effects: Parameters
    hunting: Stress | None
    past: "_Past | None" = field(default=None, init=False)

    def __post_init__(self):
        for name, values in self.effects.items():
            if name not in EFFECTS or set(values) != set(EFFECTS[name]):
                raise ValueError(f"effect {name} with {sorted(values)}: EFFECTS has {EFFECTS}")
        self.stress = self.hunting or Stress()
        self.V0 = self.protocol.velocities[0]
        self.K = self.base.K * math.exp(self.number("stiffness", "kappa"))
        self.m = self.base.m + self.number("inertia", "m")
        self.k_v = self.base.k_v + self.number("damping", "k_v")
        self.tau_m = self.number("servo_lag", "tau")
        self.starts, self.corners = self.protocol.starts.tolist(), self.protocol.corners.tolist()
        self.lags = self._trailing()
        self.Vc = self.number("evolution_cutoff", "Vc", math.inf)
        self.q = self.base.q + self.number("ageing", "q")
        self.n = self.number("velocity_dependent_L", "n")
        self.c, self.trend = self.number("viscous", "c"), self.number("slip_trend", "s")
        self.fs, self.Vs, self.d = self.numbers("stribeck", (0.0, 1.0, 1.0))
        self.run, self.dc = self.numbers("run_in", (0.0, 1.0))
        a, b, wavelength = self.numbers("position_periodic", (0.0, 0.0, 1.0))
        self.wave = (a, b, 2.0 * math.pi / wavelength)
        self.linker = self.number("normal_stress", "alpha")
        self.B2, self.L2 = self.numbers("second_state", (0.0, 1.0))
        self.a_T, self.tau_T = self.numbers("thermal", (0.0, 1.0))
        self.tau_y = self.number("sensor_lag", "tau")
        start = [0.0, 0.0, self.base.B * math.log1p(self.V0 / self.Vc)]
        self.second = self.heat = self.reading = None
        if "second_state" in self.effects:
            self.second = len(start)
            start.append(0.0)
        if "thermal" in self.effects:
            # T = f/f0 in steady sliding, where f is what T itself lowers
            level = self.friction(0.0, start)
            self.heat = len(start)
            start.append(level / (self.base.f0 + self.a_T))
        if self.tau_y > 0:
            self.reading = len(start)
            start.append(self.friction(0.0, start))
        self.start = np.array(start)
        self.F0 = self.friction(0.0, start)

    def number(self, effect: str, name: str, null: float = 0.0) -> float:
        return self.effects.get(effect, {}).get(name, null)

    def numbers(self, effect: str, null: tuple[float, ...]) -> list[float]:
        return [self.number(effect, *pair) for pair in zip(EFFECTS[effect], null, strict=True)]

    def drive(self, t: float, k: int) -> tuple[float, float, float]:
        """Load-point displacement, velocity and acceleration in segment `k`, time t in it."""
        V, corner = self.protocol.velocities[k], self.corners[k]
        if not self.tau_m > 0:
            return corner + V * t, V, 0.0
        behind, slower = self.lags[k]  # x_cmd - x_m and V_cmd - V_m at the start of the segment
        decay = math.exp(-t / self.tau_m)
        lag = behind + slower * self.tau_m * (1.0 - decay)
        return corner + V * t - lag, V - slower * decay, slower * decay / self.tau_m

    def _trailing(self) -> list[tuple[float, float]]:
        """x_cmd - x_m and V_cmd - V_m at the start of every segment, the step included."""
        out, behind, slower, before = [], 0.0, 0.0, self.V0
        for V, span in zip(self.protocol.velocities, self.protocol.durations, strict=True):
            slower, before = slower + V - before, V
            out.append((behind, slower))
            decay = math.exp(-span / self.tau_m) if self.tau_m > 0 else 0.0
            behind += slower * self.tau_m * (1.0 - decay)
            slower *= decay
        return out

    def load_point(self, t: float) -> float:
        k = max(bisect_right(self.starts, t) - 1, 0)
        return self.drive(t - self.starts[k], k)[0]

    def friction(self, t: float, z, slip: float | None = None) -> float:
        """The law: f at time t [s] of the record. `slip` [m] is given where it is known."""
        x: float = self.load_point(t) - z[0] if slip is None else slip
        u = min(z[1], 60.0)
        V = self.V0 * math.exp(u)
        f = self.base.f0 + self.base.A * u + z[2] + self.c * V + self.trend * x
        if self.second is not None:
            f += z[self.second]
        if self.heat is not None:
            f -= self.a_T * z[self.heat]
        if self.fs:
            f += self.fs * math.exp(-((V / self.Vs) ** self.d))
        if self.run:
            f -= self.run * math.expm1(-x / self.dc)
        a, b, w = self.wave
        return f + a * math.sin(w * x) + b * math.cos(w * x)

    def rates(self, z, t: float, k: int, t0: float) -> list[float]:
        """dz/dt at time t [s] after the start t0 of segment k."""
        x_m, V_m, dV_m = self.drive(t, k)
        x, u = x_m - z[0], min(z[1], 60.0)
        V, f = self.V0 * math.exp(u), self.friction(t0 + t, z, x)
        n, dn = self.stress.at(t0 + t)
        out = [V_m - V, 0.0, self._evolution(t0 + t, u, V, z[2]) - self.linker * dn]
        if self.second is not None:
            out.append(-(V / self.L2) * (z[self.second] + self.B2 * u))
        if self.heat is not None:
            out.append((f * V / (self.base.f0 * self.V0) - z[self.heat]) / self.tau_T)
        if self.reading is not None:
            out.append((f - z[self.reading]) / self.tau_y)
        if self.m > 0:
            pull = self.F0 + self.K * z[0] + self.k_v * (V_m - V) - n * f
            out[1] = pull / (self.m * V)
            return out
        still = out[2] + V * self._gradient(x)
        if self.second is not None:
            still += out[self.second]
        if self.heat is not None:
            still -= self.a_T * out[self.heat]
        pull = self.K * (V_m - V) + self.k_v * dV_m - n * (dn * f + still)
        out[1] = pull / (n * (self.base.A + self._slope(V)) + self.k_v * V)
        return out

    def _evolution(self, t: float, u: float, V: float, theta: float) -> float:
        B, L = self.base.B, self.base.L * math.exp(self.n * u)
        if self.past is not None:
            u = self.past.value(t - self.number("frictional_delay", "alpha"))
        cut = math.log1p(self.V0 * math.exp(min(u, 60.0)) / self.Vc)
        slip = -(V / L) * (theta + B * (u - cut))
        if not self.q:
            return slip
        ageing = (B * self.V0 / L) * (math.exp(min(cut - theta / B, 60.0)) - V / self.V0)
        return (1.0 - self.q) * slip + self.q * ageing

    def _gradient(self, x: float) -> float:
        """df/dx at constant V and states."""
        a, b, w = self.wave
        return (
            self.trend
            + (self.run / self.dc) * math.exp(-x / self.dc)
            + w * (a * math.cos(w * x) - b * math.sin(w * x))
        )

    def _slope(self, V: float) -> float:
        """V df/dV of what is added to A u."""
        slope = self.c * V
        if self.fs:
            z = (V / self.Vs) ** self.d
            slope -= self.fs * self.d * z * math.exp(-z)
        return slope

    def _balance(self, z: np.ndarray, k: int) -> np.ndarray:
        """u just after a velocity step: with a dashpot and no mass it jumps."""
        t0 = self.starts[k]
        x_m, V_m, _ = self.drive(0.0, k)
        z, n = z.copy(), self.stress.at(t0)[0]
        for _ in range(60):
            V = self.V0 * math.exp(z[1])
            excess = n * self.friction(t0, z, x_m - z[0]) - self.F0 - self.K * z[0]
            excess -= self.k_v * (V_m - V)
            step = excess / (n * (self.base.A + self._slope(V)) + self.k_v * V)
            z[1] -= max(-1.0, min(1.0, step))
            if abs(step) < 1e-14:
                return z
        if abs(step) > 1e-9:
            raise RunawayError("no balance of forces after a velocity step")
        return z

    def _check(self, z: np.ndarray) -> np.ndarray:
        """A path, if it stays near steady sliding."""
        if np.max(z[:, 1]) > math.log(max(self.protocol.velocities) / self.V0) + RUNAWAY:
            raise RunawayError("the plant runs away")
        return z

    def _enter(self, z: np.ndarray, k: int) -> np.ndarray:
        """The variables just after the start of segment k."""
        jumps = k > 0 and self.m == 0 and self.k_v > 0 and not self.tau_m > 0
        return self._balance(z, k) if jumps else z

    def integrate(self, t: np.ndarray, rtol: float) -> np.ndarray:
        """The variables at the times t, by LSODA.

        It differences the Jacobian with steps relative to a variable, which fails for a stiff
        plant where u or theta passes 0: what it sees is K s + 1, u + 10, theta + 1, ...
        """
        z, out = self.start, np.empty((len(t), len(self.start)))
        size, shift = np.ones(len(z)), np.ones(len(z))
        size[0], shift[1] = self.K, 10.0
        K = self.K

        def rates(w, t, k, t0):
            seen = (w - shift).tolist()
            seen[0] /= K
            dz = self.rates(seen, t, k, t0)
            dz[0] *= K
            return dz

        for k, (here, ts, _) in enumerate(_segments(self.protocol, t)):
            w = self._enter(z, k) * size + shift
            path = _lsoda(rates, w, ts, (k, self.starts[k]), 0.1 * rtol, 1e-3 * rtol)
            path = self._check((path - shift) / size)
            out[here], z = path[1:-1], path[-1]
        return out

    def delayed(self, t: np.ndarray, rtol: float) -> np.ndarray:
        """The variables at the times t where theta_ss looks back: classical Runge-Kutta."""
        if self.m > 0:
            raise ValueError("frictional_delay needs a plant without mass: its solver is explicit")
        self.past = _Past()
        z, out = self.start, np.empty((len(t), len(self.start)))
        for k, (here, ts, _) in enumerate(_segments(self.protocol, t)):
            z = self._enter(z, k)
            try:
                nodes, values, slopes = self._march(z.tolist(), k, (rtol / 1e-9) ** 0.25)
            except OverflowError as error:
                raise RunawayError("the delay plant runs away") from error
            out[here], z = CubicHermiteSpline(nodes, values, slopes)(ts[1:-1]), np.array(values[-1])
        return self._check(out)

    def _march(self, z: list[float], k: int, part: float):
        """Nodes, values and slopes over segment k."""
        t0, V_m, span = self.starts[k], self.protocol.velocities[k], self.protocol.durations[k]
        alpha, t, rates = self.number("frictional_delay", "alpha"), 0.0, self.rates
        self.past = self.past or _Past()
        dz = rates(z, 0.0, k, t0)
        self.past.add(t0, z[1], dz[1], begins=True)
        nodes, values, slopes = [t], [z], [dz]
        while t < span:
            u = min(z[1], 60.0)
            fastest = max(V_m, self.V0 * math.exp(u))
            length = min(self.base.L * math.exp(min(self.n * u, 0.0)), self.base.A / self.K)
            h = part * min(_HISTORY_STEP * length / fastest, self.tau_y or math.inf)
            h = min(h, max(_HISTORY_GROWTH * t, min(0.05 * h, 0.25 * alpha)))
            h = h if t + 1.01 * h < span else span - t
            k2 = rates([a + 0.5 * h * b for a, b in zip(z, dz, strict=True)], t + 0.5 * h, k, t0)
            k3 = rates([a + 0.5 * h * b for a, b in zip(z, k2, strict=True)], t + 0.5 * h, k, t0)
            k4 = rates([a + h * b for a, b in zip(z, k3, strict=True)], t + h, k, t0)
            steps = zip(z, dz, k2, k3, k4, strict=True)
            z = [a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e) for a, b, c, d, e in steps]
            t = t + h
            dz = rates(z, t, k, t0)
            self.past.add(t0 + t, z[1], dz[1])
            nodes.append(t)
            values.append(z)
            slopes.append(dz)
            if z[1] > 40.0:
                raise RunawayError("the delay plant runs away")
        return nodes, values, slopes


class _Past:
    """u of the past: 0 before the start, then cubic Hermite between the nodes."""

    def __init__(self):
        self.t: list[float] = []
        self.u: list[float] = []
        self.du: list[float] = []
        self.begin = 0

    def add(self, t: float, u: float, du: float, *, begins: bool = False) -> None:
        """A node; `begins` says that a velocity step lies between it and the one before."""
        self.begin = len(self.t) if begins else self.begin
        self.t.append(t)
        self.u.append(u)
        self.du.append(du)

    def value(self, t: float) -> float:
        """u(t); past the last node by the last cubic, which is there for steps beyond the delay."""
        if t <= 0.0 or not self.t:
            return 0.0
        i = bisect_right(self.t, t) - 1
        if i == len(self.t) - 1:
            if i == self.begin:
                return self.u[i] + self.du[i] * (t - self.t[i])
            i -= 1
        h = self.t[i + 1] - self.t[i]
        p = (t - self.t[i]) / h
        rise, left, right = self.u[i + 1] - self.u[i], h * self.du[i], h * self.du[i + 1]
        return self.u[i] + p * (
            left + p * (3 * rise - 2 * left - right + p * (left + right - 2 * rise))
        )
