"""A tenfold step of the command, 2000 outputs, without mass and with: others beside `simulate`.

Slip law without mass, ageing law with mass 1.3 times above and far below the critical stiffness.
SciPy's solvers with equations of their own; compiled loops by hand (`limit.c`), where there is a C
compiler: Dormand and Prince's method without mass, with mass a Rosenbrock method with the
coefficients of ours.
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from peers_table import Table, timed
from scipy.integrate import solve_ivp

import jaxfric as jf
from jaxfric.simulation import rodas

F0, A, B, L, V0 = 0.6, 0.010, 0.014, 1e-5, 1e-6
FASTER, AT, END = 10.0, 10.0, 30.0
TIMES = np.linspace(0.0, END, 2001)[1:]
AFTER = TIMES[TIMES > AT] - AT
BEFORE = len(TIMES) - len(AFTER)
MASS = 100.0
STEADY = float(np.arcsinh(np.exp(F0 / A) / 2))


def wrong(force: np.ndarray, truth: np.ndarray) -> float:
    return float(np.max(np.abs(np.asarray(force) - truth))) / A


def jaxfric(table: Table, rig: Callable[[float], jf.Rig], K: float, truth: np.ndarray) -> None:
    """Alone, and a member of a batch of 256."""
    step = jf.PiecewiseVelocity([0.0, AT], [V0, FASTER * V0])
    ts = jnp.asarray(np.append(0.0, TIMES))

    def motion(K, rtol=1e-6):
        return jf.simulate(rig(K), step, ts, rtol=rtol)

    for rtol in (1e-4, 1e-6):
        one = eqx.filter_jit(lambda K, rtol=rtol: motion(K, rtol).force[1:])
        spent = timed(lambda one=one: jax.block_until_ready(one(K)))
        table.ours(f"rtol {rtol:g}", spent, wrong(one(K), truth))
    many = eqx.filter_jit(jax.vmap(lambda K, rtol: motion(K, rtol).force[1:], (0, None)))
    batch = jnp.full(256, K)
    for rtol in (1e-4, 1e-6):
        each = timed(lambda r=rtol: jax.block_until_ready(many(batch, r))) / 256
        table.ours(f"one of a batch, rtol {rtol:g}", each, wrong(many(batch, rtol)[7], truth))


def scipy_without_mass(K: float, method: str, rtol: float) -> np.ndarray:
    def rate(t, y):
        V = V0 * np.exp(y[0])
        theta = -(V / L) * (y[1] + B * y[0])
        return [(K * (FASTER * V0 - V) - theta) / A, theta]

    tolerance = [rtol, rtol * A]
    y = solve_ivp(rate, (0, AFTER[-1]), [0.0, 0.0], method, AFTER, rtol=rtol, atol=tolerance).y
    return F0 + np.append(np.zeros(BEFORE), A * y[0] + y[1])


def scipy_with_mass(K: float, method: str, rtol: float) -> np.ndarray:
    """Spring, state and p = friction/A, V = 2 V0 exp(-(f0 + theta)/A) sinh(p)."""

    def rate(t, y):
        e, theta, p = y
        unit = 2 * V0 * np.exp(-(F0 + theta) / A)
        V = unit * np.sinh(p)
        heals = (B * V0 / L) * (np.exp(-theta / B) - abs(V) / V0)
        gains = (A * (STEADY - p) + K * e) / MASS
        return [FASTER * V0 - V, heals, (gains / unit + np.sinh(p) * heals / A) / np.cosh(p)]

    tolerance = [rtol * A / K, rtol * A, rtol]
    start = [0.0, 0.0, STEADY]
    p = solve_ivp(rate, (0, AFTER[-1]), start, method, AFTER, rtol=rtol, atol=tolerance).y[2]
    return A * np.append(np.full(BEFORE, STEADY), p)


def compiled(folder: Path) -> ctypes.CDLL | None:
    """`limit.c`, compiled into a folder; None where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    target = folder / "limit.so"
    options = ["-O3", "-march=native", "-shared", "-fPIC"]
    source = Path(__file__).with_name("limit.c")
    subprocess.run([compiler, *options, source, "-o", target, "-lm"], check=True)
    library = ctypes.CDLL(str(target))
    array, number = np.ctypeslib.ndpointer(float), ctypes.c_double
    library.follow.argtypes = [array, number, number, array, ctypes.c_int, number, array]
    method = [array, array, array, number]
    library.follow_with_mass.argtypes = [
        *(array, array, array, ctypes.c_int, number, *method, array)
    ]
    return library


def by_hand(library: ctypes.CDLL, K: float, rtol: float, mass: float | None) -> np.ndarray:
    out = np.zeros(len(AFTER))
    law = np.array([K, A, B, L, V0, FASTER * V0])
    if mass is None:
        library.follow(law, 0.0, 0.0, AFTER, len(AFTER), rtol, out)
        return F0 + np.append(np.zeros(BEFORE), out)
    law, start = np.append(law, [mass, F0]), np.array([0.0, 0.0, STEADY])
    method = (rodas.A, rodas.C, rodas.DENSE, rodas.GAMMA)
    library.follow_with_mass(law, start, AFTER, len(AFTER), rtol, *method, out)
    return np.append(np.full(BEFORE, A * STEADY), out)


def in_c(table: Table, library: ctypes.CDLL | None, K: float, mass, truth: np.ndarray) -> None:
    if library is None:
        print("  no C compiler: nothing by hand")
        return
    name = "Dormand and Prince" if mass is None else "Rodas5P"
    for rtol in (1e-4, 1e-5, 1e-6, 1e-8):
        spent = timed(lambda rtol=rtol: by_hand(library, K, rtol, mass), 50)
        error = wrong(by_hand(library, K, rtol, mass), truth)
        table.peer(f"C, {name}, rtol {rtol:g}", spent, error, "one of a batch, rtol 1e-06")


def motion() -> None:
    with tempfile.TemporaryDirectory() as folder:
        library = compiled(Path(folder))
        K = 2e3
        truth = scipy_without_mass(K, "DOP853", 1e-12)
        table = Table(f"Motion without mass, K = {K * L / (B - A):.1f} K_cr", "error/A")
        plain = jf.RateState(F0, A, [B], [L], V0)
        jaxfric(table, lambda K: jf.Rig(jf.QuasiStatic(K), plain), K, truth)
        in_c(table, library, K, None, truth)
        scipy(table, scipy_without_mass, K, ("LSODA", "DOP853"), truth)
        law = jf.RateState(
            F0, A, [B], [L], V0, evolution=jf.AgeingEvolution(), direct=jf.RegularisedEffect()
        )
        for K in (520.0, 60.0):
            truth = scipy_with_mass(K, "Radau", 1e-12)
            table = Table(f"Motion with mass, K = {K * L / (B - A):.2f} K_cr", "error/A")
            jaxfric(table, lambda K: jf.Rig(jf.Inertial(MASS, K), law), K, truth)
            in_c(table, library, K, MASS, truth)
            scipy(table, scipy_with_mass, K, ("LSODA", "Radau"), truth)


def scipy(table: Table, solve: Callable, K: float, methods: tuple[str, ...], truth) -> None:
    for method in methods:
        for rtol in (1e-6, 1e-8):
            spent = timed(lambda m=method, r=rtol: solve(K, m, r))
            error = wrong(solve(K, method, rtol), truth)
            table.peer(f"SciPy, {method}, rtol {rtol:g}", spent, error, "rtol 1e-06")
