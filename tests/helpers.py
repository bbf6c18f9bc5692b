"""What the tests share: the registry of laws and rigs, and comparisons that can fail.

A new law goes into `LAWS`, a new machine or drive into `RIGS`; the generic tests
(`test_laws.py`, `test_simulate.py`) then run over it. Every comparison here is shown to
catch a planted error in `test_laws.py`. Numbers are SI with friction as a coefficient.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import reference
from jax.flatten_util import ravel_pytree
from scipy.integrate import solve_ivp
from scipy.special import lambertw

import jaxfric as jf
from jaxfric.stability.kernel import StateSpaceKernel

UM = 1e-6
EVOLUTIONS = {"slip": jf.SlipEvolution(), "ageing": jf.AgeingEvolution()}


def make_law(kind="slip", B=(0.014,), L=(10 * UM,), *, regularised=False, trend=0.0, f0=0.6):
    """A rate-and-state law with A = 0.01 and V0 = 1 um/s."""
    direct = jf.RegularisedEffect() if regularised else jf.LogarithmicEffect()
    return jf.RateState(f0, 0.01, B, L, UM, EVOLUTIONS[kind], direct, slip_trend=trend)


_TWO = {"B": (0.010, -0.004), "L": (10 * UM, 60 * UM)}
_VARIANTS = {
    "slip": lambda **k: make_law("slip", **k),
    "ageing": lambda **k: make_law("ageing", **k),
    "two states": lambda **k: make_law("slip", **_TWO, **k),
    "slip with trend": lambda **k: make_law("slip", trend=300.0, **k),
}
LAWS = {
    f"{name}, {'regularised' if regularised else 'logarithmic'}": make(regularised=regularised)
    for name, make in _VARIANTS.items()
    for regularised in (False, True)
}


@dataclass(frozen=True)
class RigCase:
    """A family of rigs and motions by a vector of parameters, at a typical value of it."""

    names: tuple[str, ...]
    typical: tuple[float, ...]
    build: Callable[[dict], tuple[jf.Rig, jf.PiecewiseVelocity]]

    def __call__(self, parameters):
        return self.build(dict(zip(self.names, parameters, strict=True)))


def _family(machine, extra=(), kind="slip", drive=None) -> RigCase:
    def build(p):
        law = jf.RateState(p["f0"], p["A"], p["B"][None], p["L"][None], UM, EVOLUTIONS[kind])
        motion = jf.PiecewiseVelocity([0.0, 10.0], jnp.stack([p["V1"], p["V2"]]))
        return jf.Rig(machine(p), law, jf.IdealDrive() if drive is None else drive(p)), motion

    common = ("f0", "A", "B", "L", "K", "V1", "V2")
    values = (0.6, 0.010, 0.014, 10 * UM, 2e3, 1 * UM, 10 * UM)
    return RigCase(
        common + tuple(name for name, _ in extra),
        values + tuple(value for _, value in extra),
        build,
    )


RIGS = {
    "quasi-static": _family(lambda p: jf.QuasiStatic(p["K"])),
    "dashpot and slow drive": _family(
        lambda p: jf.QuasiStatic(p["K"], p["k_v"]),
        (("k_v", 1000.0), ("tau", 0.4)),
        "ageing",
        lambda p: jf.FirstOrderDrive(p["tau"]),
    ),
    "mass and dashpot": _family(
        lambda p: jf.Inertial(p["m"], p["K"], p["k_v"]), (("m", 100.0), ("k_v", 1000.0))
    ),
}


def solve_with_drive(law: reference.Law, motion, stiffness, ts, *, damping=0.0, tau=0.0):
    """Friction, slip, velocity and states of a massless slider, with dashpot and slow drive.

    By SciPy alone, for one state of a logarithmic law: y = (spring force, theta, V_m), where
    tau dV_m/dt = V_cmd - V_m, and A u + c e^u = pull - f0 - theta by Lambert's W.
    """
    V0, B, L = motion.velocities[0], law.B[0], law.L[0]

    def read(y, command):
        load = y[2] if tau else command
        z = (y[0] + damping * load - law.f0 - y[1]) / law.A
        c = damping * V0 / law.A
        V = V0 * np.exp(z - lambertw(c * np.exp(z)).real)
        return V, load, y[0] + damping * (load - V)

    def rate(t, y, command):
        V, load, _ = read(y, command)
        slip = -V / L * (y[1] + B * np.log(V / V0))
        ageing = B / L * (V0 * np.exp(-y[1] / B) - V)
        relax = (command - y[2]) / tau if tau else 0.0
        return [stiffness * (load - V), slip if law.kind == "slip" else ageing, relax, V]

    y, out = np.array([law.f0, 0.0, V0, 0.0]), []
    for t0, t1, command in zip(
        motion.starts, [*motion.starts[1:], ts[-1] + 1e-9], motion.velocities, strict=True
    ):
        inside = ts[(ts >= t0) & (ts < t1)]
        grid = np.append(inside, t1)
        s = solve_ivp(rate, (t0, t1), y, "DOP853", grid, args=(command,), rtol=1e-12, atol=1e-15)
        V, _, f = read(s.y[:, :-1], command)
        out.append([f, s.y[3, :-1], V, s.y[1, :-1]])
        y = s.y[:, -1]
    f, x, V, theta = np.concatenate(out, axis=1)
    return reference.Solution(ts, motion.displacement(ts), x, V, f, f, theta[None])


def simulate_at(rtol, rig, motion, ts, **policy):
    """`simulate` with `rtol` as an argument, so that one compilation serves all tolerances."""
    return jf.simulate(rig, motion, ts, rtol=rtol, **policy)


def trajectory_errors(trajectory, truth: reference.Solution) -> dict[str, float]:
    """Largest error of each quantity relative to the range over which that quantity moves.

    Velocity is compared by its logarithm where it keeps its sign, else as it is.
    """
    logarithm = np.all(truth.V > 0)
    V, V_true = np.asarray(trajectory.velocity), truth.V
    pairs = {
        "force": (trajectory.force, truth.f),
        "velocity": (np.log(V), np.log(V_true)) if logarithm else (V, V_true),
        "slip": (trajectory.slip, truth.x),
    }
    for i, theta in enumerate(truth.theta):
        pairs[f"state {i}"] = (trajectory.state[:, i], theta)
    return {
        name: float(np.max(np.abs(np.asarray(value) - true)) / np.ptp(true))
        for name, (value, true) in pairs.items()
    }


def central_difference(function, parameters, scales, step):
    """Derivative of a batched function with respect to each parameter, in units of `scales`.

    `function` maps a batch of parameter vectors to a batch of outputs; the result has one
    row per parameter.
    """
    offsets = np.diag(np.asarray(scales) * step)
    points = np.concatenate([parameters + offsets, parameters - offsets])
    up, down = np.split(np.asarray(function(jnp.asarray(points))), 2)
    return (up - down) / (2 * step)


def assert_close_to_largest(value, truth, tolerance, *, axis=None, what="value"):
    """|value - truth| <= tolerance x the largest |truth| along `axis` (default: of all)."""
    value, truth = np.asarray(value), np.asarray(truth)
    assert value.shape == truth.shape, f"{what}: shape {value.shape}, not {truth.shape}"
    assert np.all(np.isfinite(truth)), f"{what}: the truth is not finite"
    size = np.max(np.abs(truth), axis=axis, keepdims=True)
    excess = np.abs(value - truth) / np.where(size > 0, size, 1.0)
    assert np.all(excess <= tolerance), f"{what}: relative error {np.max(excess):.3g}"


def assert_same(one, other, *, rtol=1e-12, atol=0.0):
    """Two pytrees of the same structure hold the same numbers, to rounding."""
    assert jax.tree.structure(one) == jax.tree.structure(other)
    a, b = ravel_pytree(one)[0], ravel_pytree(other)[0]
    np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=rtol, atol=atol)


def exponentials(amplitude, rate):
    """The kernel g(t) = sum_i g_i exp(-r_i t)."""
    g, r = jnp.asarray(amplitude), jnp.asarray(rate)
    return StateSpaceKernel(jnp.diag(-r), jnp.ones_like(r), g)


def kernel_function(kernel):
    """g(t) of a kernel with states, by the matrix exponential."""
    return lambda t: kernel.c @ jax.scipy.linalg.expm(kernel.a * t) @ kernel.b


def critical_rate_state(A, B, L, velocity, damping, mass):
    """w_cr [rad/s] and k_cr [force/m] of one-state rate-and-state friction, elementwise.

        w_cr = (V0/L) sqrt(B/(A + k_v V0) - 1)                                    (24)
        k_cr = (B - (A + k_v V0))/L [m V0^2/((A + k_v V0) L) + 1]                  (25)

    A, B [force], L [m], velocity V0 [m/s], damping k_v [force s/m], mass [force s^2/m]. The same
    for slip and ageing evolution. 0, 0 where A + k_v V0 >= B: stable for every k_p > 0;
    inf, inf where A + k_v V0 <= 0: stable for none.
    Source: the 1994 note, after Rice & Ruina (1983, doi:10.1115/1.3167042).
    """
    X = jnp.asarray(A + damping * velocity)
    damped = X > 0
    X = jnp.where(damped, X, 1.0)
    excess = jnp.maximum(B - X, 0.0)
    some = excess > 0
    rate = velocity / L
    frequency = jnp.where(some, rate * jnp.sqrt(jnp.where(some, excess / X, 1.0)), 0.0)
    stiffness = excess / L * (mass * velocity * rate / X + 1)
    return jnp.where(damped, frequency, jnp.inf), jnp.where(damped, stiffness, jnp.inf)
