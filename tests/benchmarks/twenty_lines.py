"""`simulate` beside the obvious program that solves the same equations with diffrax.

    python tests/benchmarks/twenty_lines.py [samples]

A tenfold step without mass, slip law. The other program integrates u = ln(V/V0) and theta with
Tsit5 to the same error (the first line gives both, against SciPy at 1e-12). Ratios ours/theirs of
the time to trace, lower and compile, and of the median of warm calls: one simulation, its Jacobian
by (A, B, L, K) in forward mode, the gradient of a sum of squares in reverse mode (theirs: diffrax's
`RecursiveCheckpointAdjoint`), and a batch of 1000 random laws (a decade of K and of L, some run
away) and of 1000 nearly equal ones. Theirs saves densely for one simulation and at the sample times
in a batch, each the better way. Default arguments. Both are measured four times, in turn, and the
least counts, as a time to compile varies by a third.
"""

import sys
import time
from collections.abc import Callable

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import jaxfric as jf

jax.config.update("jax_enable_x64", True)

V0, F0, AT, END = 1e-6, 0.6, 10.0, 40.0
LAW = np.array([0.010, 0.014, 20e-6, 1e3])
TS = np.linspace(0.0, END, next((int(x) for x in sys.argv[1:] if x.isdigit()), 100))


def ours(p: jax.Array) -> jax.Array:
    law = jf.RateState(f0=F0, A=p[0], B=p[1:2], L=p[2:3], V0=V0)
    motion = jf.PiecewiseVelocity([0.0, AT], [V0, 10 * V0])
    return jf.simulate(jf.Rig(jf.QuasiStatic(p[3]), law), motion, jnp.asarray(TS)).force


def theirs(
    p: jax.Array, adjoint: diffrax.AbstractAdjoint | None = None, *, dense: bool = True
) -> jax.Array:
    A, B, L, K = p

    def rates(t, y, args):
        u, theta = y
        V = V0 * jnp.exp(u)
        change = -(V / L) * (theta + B * u)
        return (K * (jnp.where(t < AT, V0, 10 * V0) - V) - change) / A, change

    control = diffrax.PIDController(rtol=5e-9, atol=5e-9)
    found = diffrax.diffeqsolve(
        diffrax.ODETerm(rates),
        diffrax.Tsit5(),
        0.0,
        END,
        0.01,
        (0.0 * A, 0.0 * B),
        saveat=diffrax.SaveAt(dense=True) if dense else diffrax.SaveAt(ts=jnp.asarray(TS)),
        stepsize_controller=diffrax.ClipStepSizeController(control, jump_ts=jnp.array([AT])),
        adjoint=diffrax.ForwardMode() if adjoint is None else adjoint,
        max_steps=4096,
        throw=False,
    )
    u, theta = jax.vmap(found.evaluate)(jnp.asarray(TS)) if dense else found.ys
    return F0 + A * u + theta


def truth() -> np.ndarray:
    A, B, L, K = LAW

    def rates(t, y):
        V = V0 * np.exp(y[0])
        change = -(V / L) * (y[1] + B * y[0])
        return [(K * (10 * V0 - V) - change) / A, change]

    after = TS >= AT
    y = solve_ivp(rates, (AT, END), [0.0, 0.0], "DOP853", TS[after], rtol=1e-12, atol=1e-13).y
    force = np.full(len(TS), F0)
    force[after] += A * y[0] + y[1]
    return force


def costs(function: Callable, x: np.ndarray, repeats: int) -> tuple[float, float]:
    """Seconds to compile, and of a warm call."""
    jax.clear_caches()
    begun = time.perf_counter()
    compiled = jax.jit(function).lower(x).compile()
    first, spent = time.perf_counter() - begun, []
    for _ in range(repeats):
        begun = time.perf_counter()
        jax.block_until_ready(compiled(x))
        spent.append(time.perf_counter() - begun)
    return first, float(np.median(spent))


def main() -> None:
    exact, rng = truth(), np.random.default_rng(5)
    wrong = [float(np.abs(np.asarray(f(jnp.asarray(LAW))) - exact).max()) for f in (ours, theirs)]
    print(f"error: ours {wrong[0]:.1e}, theirs {wrong[1]:.1e}")
    spread = np.c_[rng.uniform(-0.3, 0.3, (1000, 2)), rng.uniform(-1.15, 1.15, (1000, 2))]
    random, equal = LAW * np.exp(spread), LAW * (1 + 1e-6 * rng.uniform(size=(1000, 1)))
    by_ts = jax.vmap(lambda p: theirs(p, dense=False))
    backwards = diffrax.RecursiveCheckpointAdjoint()
    rows = {
        "simulation": (ours, theirs, LAW),
        "Jacobian": (jax.jacfwd(ours), jax.jacfwd(theirs), LAW),
        "gradient": (
            jax.grad(lambda p: jnp.sum(ours(p) ** 2)),
            jax.grad(lambda p: jnp.sum(theirs(p, backwards, dense=False) ** 2)),
            LAW,
        ),
        "1000 random laws": (jax.vmap(ours), by_ts, random),
        "1000 equal laws": (jax.vmap(ours), by_ts, equal),
    }
    print(f"{'':18}{'compile':>9}{'warm':>9}{'ours, each':>14}{'theirs, each':>14}")
    for name, (mine, other, x) in rows.items():
        repeats = 5 if x.ndim == 2 else 25
        turns = [[costs(f, x, repeats) for f in (mine, other)] for _ in range(4)]
        (first, warm), (other_first, other_warm) = np.min(turns, axis=0)
        each = 1e6 / len(x) if x.ndim == 2 else 1e6
        print(
            f"{name:18}{first / other_first:9.2f}{warm / other_warm:9.2f}"
            f"{each * warm:11.0f} us{each * other_warm:11.0f} us",
            flush=True,
        )


if __name__ == "__main__":
    main()
