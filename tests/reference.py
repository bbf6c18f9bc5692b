"""Independent reference solutions of a spring-slider with rate-and-state friction.

NumPy and SciPy only. Nothing here comes from `jaxfric`, so nothing here can share
its mistakes. SI units; with a friction coefficient in place of a force, stiffness is in 1/m.

    friction   f = f0 + A ln(V/V0) + sum_i theta_i + s x          (s: linear trend in slip x)
    slip law   dtheta_i/dt = -(|V|/L_i) (theta_i + B_i ln(|V|/V0))
    ageing law dtheta_i/dt = (B_i V0/L_i) exp(-theta_i/B_i) - B_i |V|/L_i
    regularised f = A asinh( V/(2 V0) exp((f0 + sum theta_i)/A) ) + s x,  |V| -> 0 and V < 0 allowed
    spring     F = F_start + K (x_m - x)
    quasi-static  f = F            inertial  m dV/dt = F + k_v (V_m - V) - f

V0 is the first commanded velocity, and the start is steady sliding at it: V = V0,
theta = 0, F = f, x = x_m = 0. The commanded velocity V_m is constant between breaks, and
the integration restarts at each of them.

The same motion can be computed in different variables, which check each other:

    speed   "force"     V follows from F and theta by inverting the law    (quasi-static)
            "logarithm" u = ln(V/V0) is integrated                         (law not regularised)
            "velocity"  V itself is integrated                             (inertial, V > 0)
            "friction"  w = asinh(...) of the regularised law is integrated (inertial)
    memory  "theta"     theta_i as above
            "contact"   Theta_i = (L_i/V0) exp(theta_i/B_i) [s], Dieterich's contact age
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import xlogy


@dataclass(frozen=True)
class Law:
    """Parameters of the friction law; `B` and `L` hold one number per state."""

    kind: str  # "slip" or "ageing"
    f0: float
    A: float
    B: tuple[float, ...]
    L: tuple[float, ...]
    trend: float = 0.0
    regularised: bool = False


@dataclass(frozen=True)
class Motion:
    """Commanded velocity: `velocities[i]` from `starts[i]` to the next start; starts[0] = 0."""

    starts: tuple[float, ...]
    velocities: tuple[float, ...]

    def displacement(self, ts: np.ndarray) -> np.ndarray:
        """Load-point displacement x_m at the times `ts`, zero at time zero."""
        corners = np.concatenate([[0.0], np.cumsum(np.diff(self.starts) * self.velocities[:-1])])
        index = np.clip(np.searchsorted(self.starts, ts, side="right") - 1, 0, None)
        return corners[index] + np.take(self.velocities, index) * (ts - np.take(self.starts, index))


@dataclass(frozen=True)
class Solution:
    """What a solve returns, at its sample times `t`; `theta` has one row per state.

    `f` is the friction force at the slider, `spring` the force in the spring. They are
    the same without inertia.
    """

    t: np.ndarray
    x_m: np.ndarray
    x: np.ndarray
    V: np.ndarray
    f: np.ndarray
    spring: np.ndarray
    theta: np.ndarray


@dataclass(frozen=True)
class _Slider:
    """The parameters of one solve, and the algebra that all formulations share."""

    law: Law
    motion: Motion
    K: float
    mass: float
    damping: float
    memory: str

    @property
    def V0(self) -> float:
        return self.motion.velocities[0]

    @property
    def B(self) -> np.ndarray:
        return np.asarray(self.law.B, float)

    @property
    def L(self) -> np.ndarray:
        return np.asarray(self.law.L, float)

    @property
    def start_force(self) -> float:
        if self.law.regularised:
            return self.law.A * float(np.arcsinh(0.5 * np.exp(self.law.f0 / self.law.A)))
        return self.law.f0

    def memory_start(self) -> np.ndarray:
        return self.L / self.V0 if self.memory == "contact" else np.zeros(len(self.L))

    def theta(self, memory: np.ndarray) -> np.ndarray:
        """theta_i of the memory variables; states run along the first axis."""
        if self.memory == "theta":
            return memory
        B, L = (v.reshape(-1, *[1] * (memory.ndim - 1)) for v in (self.B, self.L))
        return B * np.log(memory * self.V0 / L)

    def memory_rate(self, V: np.ndarray, memory: np.ndarray) -> np.ndarray:
        speed = abs(V)
        if self.memory == "contact":
            turnover = speed * memory / self.L
            slip = self.law.kind == "slip"
            return -xlogy(turnover, turnover) if slip else 1.0 - turnover
        if self.law.kind == "slip":
            r = speed / self.V0
            return -(self.V0 / self.L) * (r * memory + self.B * xlogy(r, r))
        return self.B / self.L * (self.V0 * np.exp(-memory / self.B) - speed)

    def theta_rate(self, V: np.ndarray, memory: np.ndarray) -> np.ndarray:
        rate = self.memory_rate(V, memory)
        return rate if self.memory == "theta" else self.B * rate / memory

    def speed_of(self, f: np.ndarray, theta_sum: np.ndarray) -> np.ndarray:
        """Invert the law without its trend: V at friction f."""
        A, f0 = self.law.A, self.law.f0
        forward = np.exp((f - f0 - theta_sum) / A)
        backward = np.exp((-f - f0 - theta_sum) / A) if self.law.regularised else 0.0
        return self.V0 * (forward - backward)

    def slip(self, F: np.ndarray, x_m: np.ndarray) -> np.ndarray:
        return x_m - (F - self.start_force) / self.K


# One formulation: its start, its right-hand side (y, x_m, V_m) -> dy/dt, the size of each
# variable (for the absolute tolerance), and how to read (spring force, V, f, memory) from y.
@dataclass(frozen=True)
class _Formulation:
    start: np.ndarray
    rate: Callable[[np.ndarray, float, float], np.ndarray]
    size: np.ndarray
    read: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]


def _by_force(s: _Slider) -> _Formulation:
    """Quasi-static, y = (F, memory)."""

    def speed(y, x_m):
        f = y[0] - s.law.trend * s.slip(y[0], x_m)
        return s.speed_of(f, s.theta(y[1:]).sum(0))

    def rate(y, x_m, V_m):
        V = speed(y, x_m)
        return np.concatenate([[s.K * (V_m - V)], s.memory_rate(V, y[1:])])

    start = np.concatenate([[s.start_force], s.memory_start()])
    size = np.concatenate([[s.law.A], _memory_size(s)])
    return _Formulation(start, rate, size, lambda y, x_m: (y[0], speed(y, x_m), y[0], y[1:]))


def _by_logarithm(s: _Slider) -> _Formulation:
    """Quasi-static, y = (x, u, memory): the time derivative of f = F gives du/dt."""
    law = s.law

    def rate(y, x_m, V_m):
        V = s.V0 * np.exp(y[1])
        du = (s.K * (V_m - V) - law.trend * V - s.theta_rate(V, y[2:]).sum()) / law.A
        return np.concatenate([[V, du], s.memory_rate(V, y[2:])])

    def read(y, x_m):
        f = law.f0 + law.A * y[1] + s.theta(y[2:]).sum(0) + law.trend * y[0]
        return f, s.V0 * np.exp(y[1]), f, y[2:]

    start = np.concatenate([[0.0, 0.0], s.memory_start()])
    size = np.concatenate([[min(law.L), 1.0], _memory_size(s)])
    return _Formulation(start, rate, size, read)


def _inertial(s: _Slider, speed: str) -> _Formulation:
    """y = (F, V or u or w, memory), by Newton's equation."""
    law, V0 = s.law, s.V0

    def state(y, x_m):
        """V and f; w is friction over A without the trend."""
        theta, trend = s.theta(y[2:]).sum(0), law.trend * s.slip(y[0], x_m)
        if speed == "friction":
            return s.speed_of(law.A * y[1], theta), law.A * y[1] + trend
        V = V0 * np.exp(y[1]) if speed == "logarithm" else y[1]
        u = y[1] if speed == "logarithm" else np.log(y[1] / V0)
        return V, law.f0 + law.A * u + theta + trend

    def rate(y, x_m, V_m):
        V, f = state(y, x_m)
        acceleration = (y[0] + s.damping * (V_m - V) - f) / s.mass
        if speed == "friction":  # d/dt of sinh(w) = V/(2 V0) exp(psi), psi = (f0 + theta)/A
            psi = (law.f0 + s.theta(y[2:]).sum()) / law.A
            stir = np.tanh(y[1]) * s.theta_rate(V, y[2:]).sum() / law.A
            dz = acceleration * np.exp(psi) / (2.0 * V0 * np.cosh(y[1])) + stir
        else:
            dz = acceleration / V if speed == "logarithm" else acceleration
        return np.concatenate([[s.K * (V_m - V), dz], s.memory_rate(V, y[2:])])

    z0 = {"logarithm": 0.0, "velocity": V0, "friction": s.start_force / law.A}[speed]
    start = np.concatenate([[s.start_force, z0], s.memory_start()])
    z_size = V0 if speed == "velocity" else 1.0
    size = np.concatenate([[law.A, z_size], _memory_size(s)])
    return _Formulation(start, rate, size, lambda y, x_m: (y[0], *state(y, x_m), y[2:]))


def _memory_size(s: _Slider) -> np.ndarray:
    return s.L / s.V0 if s.memory == "contact" else np.abs(s.B)


def _choose(s: _Slider, speed: str | None) -> _Formulation:
    regularised = s.law.regularised
    if s.mass == 0.0:
        if s.damping != 0.0 or speed not in (None, "force", "logarithm"):
            raise ValueError("without mass: no damping, and speed 'force' or 'logarithm'")
        if speed == "logarithm" and regularised:
            raise ValueError("the regularised law has no logarithm of V: use speed 'force'")
        return _by_logarithm(s) if speed == "logarithm" else _by_force(s)
    speed = speed or ("friction" if regularised else "logarithm")
    if speed not in ("logarithm", "velocity", "friction") or (speed == "friction") != regularised:
        raise ValueError("with mass: 'friction' if regularised, else 'logarithm' or 'velocity'")
    return _inertial(s, speed)


def solve(
    law: Law,
    motion: Motion,
    stiffness: float,
    ts: Sequence[float] | np.ndarray,
    *,
    mass: float = 0.0,
    damping: float = 0.0,
    speed: str | None = None,
    memory: str = "theta",
    method: str | None = None,
    rtol: float = 1e-12,
) -> Solution:
    """Integrate from steady sliding at time zero and return the motion at `ts` (increasing, >= 0).

    `method` is one of SciPy's: by default DOP853 without mass and Radau with it. Raises
    `RuntimeError` where the integrator stops early (a quasi-static runaway, for instance).
    """
    ts = np.asarray(ts, float)
    s = _Slider(law, motion, stiffness, mass, damping, memory)
    form = _choose(s, speed)
    x_m = motion.displacement(ts)
    y = _march(form, motion, ts, method or ("Radau" if mass > 0.0 else "DOP853"), rtol)
    F, V, f, remembered = form.read(y, x_m)
    return Solution(ts, x_m, s.slip(F, x_m), V, f, F, s.theta(remembered))


def _march(
    form: _Formulation, motion: Motion, ts: np.ndarray, method: str, rtol: float
) -> np.ndarray:
    """The state at `ts`, one column per time, integrated from each break to the next."""
    y, columns = form.start, np.empty((len(form.start), len(ts)))
    corners = motion.displacement(np.asarray(motion.starts))
    ends = [*motion.starts[1:], np.inf]
    for t0, end, corner, V_m in zip(motion.starts, ends, corners, motion.velocities, strict=True):
        inside = (ts >= t0) & (ts < end)
        t1 = end if np.isfinite(end) else max(ts[-1], np.nextafter(t0, np.inf))

        def rate(t, y, t0=t0, corner=corner, V_m=V_m):
            return form.rate(y, corner + V_m * (t - t0), V_m)

        grid, atol = np.unique(np.append(ts[inside], t1)), 1e-2 * rtol * form.size
        with np.errstate(over="ignore", invalid="ignore"):  # trial steps that are refused
            result = solve_ivp(rate, (t0, t1), y, method=method, t_eval=grid, rtol=rtol, atol=atol)
        if not result.success:
            raise RuntimeError(f"stopped near t = {t0:.6g} s: {result.message}")
        columns[:, inside], y = result.y[:, : inside.sum()], result.y[:, -1]
    return columns
