"""How long do others take for the same motion, at which error?

    python tests/benchmarks/peers.py

A tenfold step of the command, 2000 outputs: slip law without mass, ageing law with mass 1.3 times
above and far below the critical stiffness. jaxfric alone and in a batch; SciPy's solvers with
equations of their own; without mass, where there is a C compiler, Dormand and Prince's method by
hand. Error is the largest of friction over A, against SciPy at rtol 1e-12 (with mass 1e-11).
Medians of five; one thread.
"""

import ctypes
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import jaxfric as jf

F0, A, B, L, V0 = 0.6, 0.010, 0.014, 1e-5, 1e-6
FASTER, AT, END = 10.0, 10.0, 30.0
TIMES = np.linspace(0.0, END, 2001)[1:]
AFTER = TIMES[TIMES > AT] - AT
MASS = 100.0

C = r"""
#include <math.h>
/* Dormand and Prince 5(4) with its interpolant; y = ln(V/V0), theta */
static void rate(const double *p, const double *y, double *d) {
    double V = p[4] * exp(y[0]);
    d[1] = -(V / p[3]) * (y[1] + p[2] * y[0]);
    d[0] = (p[0] * (p[5] - V) - d[1]) / p[1];
}
int follow(const double *p, double u, double theta, const double *ts, int n, double rtol,
           double *out) {
    static const double a[6][6] = {
        {1.0/5}, {3.0/40, 9.0/40}, {44.0/45, -56.0/15, 32.0/9},
        {19372.0/6561, -25360.0/2187, 64448.0/6561, -212.0/729},
        {9017.0/3168, -355.0/33, 46732.0/5247, 49.0/176, -5103.0/18656},
        {35.0/384, 0, 500.0/1113, 125.0/192, -2187.0/6784, 11.0/84}};
    static const double e[7] = {71.0/57600, 0, -71.0/16695, 71.0/1920, -17253.0/339200,
                                22.0/525, -1.0/40};
    static const double q[7] = {-12715105075.0/11282082432.0, 0, 87487479700.0/32700410799.0,
        -10690763975.0/1880347072.0, 701980252875.0/199316789632.0, -1453857185.0/822651844.0,
        69997945.0/29380423.0};
    double y[2] = {u, theta}, k[7][2], t = 0, h = 1e-3, z[2];
    int at = 0, steps = 0;
    rate(p, y, k[0]);
    while (at < n) {
        double error = 0;
        for (int s = 1; s < 7; s++) {
            for (int j = 0; j < 2; j++) {
                double x = 0;
                for (int r = 0; r < s; r++) x += a[s - 1][r] * k[r][j];
                z[j] = y[j] + h * x;
            }
            rate(p, z, k[s]);
        }
        for (int j = 0; j < 2; j++) {
            double x = 0, scale = j ? p[1] : 1;
            for (int r = 0; r < 7; r++) x += e[r] * k[r][j];
            x *= h / (rtol * (scale + fmax(fabs(y[j]), fabs(z[j]))));
            error += 0.5 * x * x;
        }
        error = sqrt(error);
        steps++;
        if (error <= 1) {
            for (; at < n && ts[at] <= t + h; at++) {
                double s = (ts[at] - t) / h, r = 1 - s, w[2];
                for (int j = 0; j < 2; j++) {
                    double change = z[j] - y[j], bend = h * k[0][j] - change, more = 0;
                    for (int i = 0; i < 7; i++) more += q[i] * k[i][j];
                    w[j] = y[j] + s * (change + r * (bend + s * (change - h * k[6][j] - bend
                           + r * h * more)));
                }
                out[at] = p[1] * w[0] + w[1];
            }
            t += h;
            for (int j = 0; j < 2; j++) { y[j] = z[j]; k[0][j] = k[6][j]; }
        }
        h *= fmin(10, fmax(0.2, 0.9 * pow(fmax(error, 1e-10), -0.2)));
    }
    return steps;
}
"""


def timed(function: Callable[[], object], repeats: int = 5) -> float:
    """Median of seconds, after a first call."""
    function()
    spent = []
    for _ in range(repeats):
        begun = time.perf_counter()
        function()
        spent.append(time.perf_counter() - begun)
    return float(np.median(spent))


def say(what: str, seconds: float, force: np.ndarray, truth: np.ndarray) -> None:
    error = float(np.max(np.abs(np.asarray(force) - truth))) / A
    print(f"  {what:34s} {1e3 * seconds:9.3f} ms   error/A {error:.1e}", flush=True)


def jaxfric(rig: Callable[[float], jf.Rig], K: float, truth: np.ndarray) -> None:
    """Alone, its Jacobian by K, A, B and L, and a member of a batch of 256."""
    step = jf.PiecewiseVelocity([0.0, AT], [V0, FASTER * V0])
    ts = jnp.asarray(np.append(0.0, TIMES))

    def force(K, rtol=1e-6):
        return jf.simulate(rig(K), step, ts, rtol=rtol, max_steps=2048).force[1:]

    for rtol in (1e-4, 1e-6):
        one = eqx.filter_jit(lambda K, rtol=rtol: force(K, rtol))
        spent = timed(lambda one=one: jax.block_until_ready(one(K)))
        say(f"jaxfric, rtol {rtol:g}", spent, one(K), truth)
    many = eqx.filter_jit(jax.vmap(force))
    batch = jnp.full(256, K)
    each = timed(lambda: jax.block_until_ready(many(batch))) / 256
    say("jaxfric, one of a batch, rtol 1e-06", each, many(batch)[7], truth)


def by_hand(K: float, truth: np.ndarray) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        print("  no C compiler: nothing by hand")
        return
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "follow.c"
        source.write_text(C)
        target = source.with_suffix(".so")
        options = ["-O3", "-march=native", "-shared", "-fPIC"]
        subprocess.run([compiler, *options, source, "-o", target, "-lm"], check=True)
        follow = ctypes.CDLL(str(target)).follow
    array = np.ctypeslib.ndpointer(float)
    number = ctypes.c_double
    follow.argtypes = [array, number, number, array, ctypes.c_int, number, array]
    law = np.array([K, A, B, L, V0, FASTER * V0])
    out = np.zeros(len(AFTER))
    before = np.zeros(len(TIMES) - len(AFTER))
    for rtol in (1e-6, 1e-8):
        spent = timed(lambda rtol=rtol: follow(law, 0.0, 0.0, AFTER, len(AFTER), rtol, out), 50)
        say(f"C, Dormand and Prince, rtol {rtol:g}", spent, F0 + np.append(before, out), truth)


def scipy_without_mass(K: float, method: str, rtol: float) -> np.ndarray:
    def rate(t, y):
        V = V0 * np.exp(y[0])
        theta = -(V / L) * (y[1] + B * y[0])
        return [(K * (FASTER * V0 - V) - theta) / A, theta]

    tolerance = [rtol, rtol * A]
    y = solve_ivp(rate, (0, AFTER[-1]), [0.0, 0.0], method, AFTER, rtol=rtol, atol=tolerance).y
    return F0 + np.append(np.zeros(len(TIMES) - len(AFTER)), A * y[0] + y[1])


def scipy_with_mass(K: float, method: str, rtol: float) -> np.ndarray:
    """Spring, state and p = friction/A, V = 2 V0 exp(-(f0 + theta)/A) sinh(p)."""
    steady = float(np.arcsinh(np.exp(F0 / A) / 2))

    def rate(t, y):
        e, theta, p = y
        unit = 2 * V0 * np.exp(-(F0 + theta) / A)
        V = unit * np.sinh(p)
        heals = (B * V0 / L) * (np.exp(-theta / B) - abs(V) / V0)
        gains = (A * (steady - p) + K * e) / MASS
        return [FASTER * V0 - V, heals, (gains / unit + np.sinh(p) * heals / A) / np.cosh(p)]

    tolerance = [rtol * A / K, rtol * A, rtol]
    start = [0.0, 0.0, steady]
    p = solve_ivp(rate, (0, AFTER[-1]), start, method, AFTER, rtol=rtol, atol=tolerance).y[2]
    return A * np.append(np.full(len(TIMES) - len(AFTER), steady), p)


def main() -> None:
    os.environ.setdefault("NPROC", "1")  # read when JAX computes for the first time
    jax.config.update("jax_enable_x64", True)
    K = 2e3
    truth = scipy_without_mass(K, "DOP853", 1e-12)
    print(f"without mass, K = {K * L / (B - A):.1f} K_cr")
    plain = jf.RateState(F0, A, [B], [L], V0)
    jaxfric(lambda K: jf.Rig(jf.QuasiStatic(K), plain), K, truth)
    by_hand(K, truth)
    for method, rtol in (("LSODA", 1e-6), ("LSODA", 1e-8)):
        spent = timed(lambda m=method, r=rtol: scipy_without_mass(K, m, r))
        say(f"SciPy, {method}, rtol {rtol:g}", spent, scipy_without_mass(K, method, rtol), truth)
    law = jf.RateState(
        F0, A, [B], [L], V0, evolution=jf.AgeingEvolution(), direct=jf.RegularisedEffect()
    )
    for K in (520.0, 60.0):
        truth = scipy_with_mass(K, "Radau", 1e-11)
        print(f"with mass, K = {K * L / (B - A):.2f} K_cr")
        jaxfric(lambda K: jf.Rig(jf.Inertial(MASS, K), law), K, truth)
        for method in ("LSODA", "Radau"):
            for rtol in (1e-6, 1e-8):
                spent = timed(lambda m=method, r=rtol, K=K: scipy_with_mass(K, m, r))
                force = scipy_with_mass(K, method, rtol)
                say(f"SciPy, {method}, rtol {rtol:g}", spent, force, truth)


if __name__ == "__main__":
    main()
