"""f0, A, B, L of one step of 2000 rows (a .010, b .014, D_c 20 um, K 1e-3/um, noise 3e-4): others
beside `jaxfric.fit`.

Ageing law, which diabayes has. SciPy and lmfit move LSODA's solution by differences, from the
start that diabayes is given in its own tests (1.1 A, 1.2 B, .9 L), and are told when the step
was; `fit` finds start and step. diabayes keeps f0 and sees the rows from the step on. Errors are
those of the parameter that is farthest from the optimum of a solution of tolerance 1e-12, over
its standard error.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from peers_table import Table, timed
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import jaxfric as jf
from jaxfric.fitting.problem import Model
from jaxfric.fitting.solve import solve as descend
from jaxfric.fitting.stages import prepare

TRUTH = np.array([0.6, 0.010, 0.014, 20e-6])
START = TRUTH * [1.0, 1.1, 1.2, 0.9]
K, V0, V, AT, NOISE = 1e3, 1e-6, 1e-5, 10.0, 3e-4
TIMES = np.linspace(0.0, 30.0, 2000)
AFTER = TIMES > AT
STEPS = jf.VelocitySteps(np.array([0.0, AT]), np.array([V0, V]))


def friction(values: np.ndarray, rtol: float = 1e-6, method: str = "LSODA") -> np.ndarray:
    f0, A, B, L = values

    def rate(t, y):
        now = V0 * np.exp(y[0])
        theta = (B * V0 / L) * (np.exp(-y[1] / B) - now / V0)
        return [(K * (V - now) - theta) / A, theta]

    ts = TIMES[AFTER] - AT
    tolerance = [rtol, rtol * A]
    y = solve_ivp(rate, (0, ts[-1]), [0.0, 0.0], method, ts, rtol=rtol, atol=tolerance).y
    return f0 + np.append(np.zeros(np.sum(~AFTER)), A * y[0] + y[1])


def optimum(residual: Callable, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters and their standard errors. Differences are taken over parts of the parameters:
    SciPy's are at least 6e-6 wide, which is a third of L."""
    unit = TRUTH[-len(start) :]
    tight = {"jac": "3-point", "xtol": 1e-13, "ftol": 1e-13, "gtol": 1e-13}
    found = least_squares(lambda x: residual(unit * x) / NOISE, start / unit, **tight)
    return unit * found.x, unit * np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))


def fits(diabayes: str) -> None:
    rng = np.random.default_rng(1)
    measured = friction(TRUTH, 1e-12, "DOP853") + NOISE * rng.standard_normal(len(TIMES))
    load_point = STEPS.displacement(TIMES) + 2e-8 * rng.standard_normal(len(TIMES))
    best, std = optimum(lambda x: friction(x, 1e-12, "DOP853") - measured, START)

    def wrong(values) -> float:
        return float(np.max(np.abs(np.asarray(values) - best) / std))

    table = Table("Fit of f0, A, B, L to 2000 rows", "error/std")
    _ours(table, measured, load_point, wrong)

    def by_scipy() -> np.ndarray:
        residual = lambda x: (friction(TRUTH * x) - measured) / NOISE  # noqa: E731
        return TRUTH * least_squares(residual, START / TRUTH).x

    whole = "whole fit, step found"
    table.peer("SciPy, LSODA and least_squares", timed(by_scipy), wrong(by_scipy()), whole)
    _lmfit(table, measured, wrong)
    _diabayes(table, measured, diabayes)


def _ours(table: Table, measured: np.ndarray, load_point: np.ndarray, wrong: Callable) -> None:
    record = jf.from_arrays(TIMES, measured, load_point_displacement=load_point)

    names = ("f0", "A", "B", "L")

    def values(**more):
        found = jf.fit(record, stiffness=K, law="ageing", reference_velocity=V0, **more)
        return [found.parameters[name].value for name in names]

    table.ours("whole fit, step found", timed(values), wrong(values()))
    given = lambda: values(steps=STEPS)  # noqa: E731
    table.ours("whole fit, step given", timed(given), wrong(given()))
    problem = prepare(record, STEPS, Model(law="ageing"), stiffness=K, force_scale=0.01)
    start = problem.coordinates.to_free(START[None])

    def alone() -> np.ndarray:
        return descend(problem, start).z

    table.ours(
        "least squares alone",
        timed(alone),
        wrong(problem.coordinates.from_free(np.asarray(alone()))),
    )


def _lmfit(table: Table, measured: np.ndarray, wrong: Callable) -> None:
    try:
        import lmfit
    except ImportError:
        print("  lmfit is not installed")
        return
    given = lmfit.Parameters()
    for name, value in zip(("f0", "A", "B", "L"), START / TRUTH, strict=True):
        given.add(name, value=value, min=0.01)

    def residual(p) -> np.ndarray:
        return (friction(TRUTH * [p[n].value for n in p]) - measured) / NOISE

    def run() -> np.ndarray:
        found = lmfit.minimize(residual, given, method="leastsq", epsfcn=1e-8).params
        return TRUTH * [found[n].value for n in found]

    table.peer("lmfit, LSODA", timed(run), wrong(run()), "whole fit, step found")


OLDER = ["jax<=0.7.0", "jaxlib<=0.7.0", "optimistix<0.0.12", "diffrax"]
OLDER += ["jax_tqdm", "optax", "matplotlib"]
INSIDE = """
import json, sys, time
import jax, jax.numpy as jnp, numpy as np
import diabayes as db
from diabayes.forward_models import Forward, ageing_law, rsf, springblock
from diabayes.solver import ODESolver
given = np.load(sys.argv[1])
forward = Forward(rsf, {"theta": ageing_law}, springblock)
f0, A, B, L = given["truth"]
K, V0, V = given["machine"]
forward.set_initial_values(mu=jnp.atleast_1d(f0), theta=jnp.atleast_1d(L / V0))
solver, y0 = ODESolver(forward), forward.variables
constants, block = db.RSFConstants(v0=V0, mu0=f0), db.SpringBlockConstants(k=K, v_lp=V)
ts, mu = jnp.asarray(given["ts"]), jnp.asarray(given["mu"])
params = lambda x: db.RSFParams(a=x[0], b=x[1], Dc=x[2])
def simulate():
    found = solver._solve_forward(ts, y0, params([A, B, L]), constants, block)
    return np.asarray(jax.block_until_ready(found.ys.mu)).ravel()
def invert():
    start = params([float(x) for x in given["start"]])
    p = solver.max_likelihood_inversion(ts, mu, y0, start, constants, block).value
    return [float(p.a), float(p.b), float(p.Dc)]
def timed(function):
    spent = []
    for _ in range(6):
        begun = time.perf_counter(); function(); spent.append(time.perf_counter() - begun)
    return float(np.median(spent[1:]))
print(json.dumps({"simulate": timed(simulate), "mu": simulate().tolist(),
                  "invert": timed(invert), "found": invert()}))
"""


def _diabayes(table: Table, measured: np.ndarray, source: str) -> None:
    """In an environment of its own; theta(0) is L/V0 of the truth, since it cannot be found."""
    ts = np.append(0.0, TIMES[AFTER] - AT)
    mu = np.append(TRUTH[0], measured[AFTER])
    with tempfile.TemporaryDirectory() as folder:
        python = Path(folder) / "venv" / "bin" / "python"
        print("  (making an environment for diabayes)", flush=True)
        subprocess.run([sys.executable, "-m", "venv", python.parents[1]], check=True)
        for what in (OLDER, ["--no-deps", source]):
            done = subprocess.run(
                [python, "-m", "pip", "install", "--quiet", *what], capture_output=True, text=True
            )
            if done.returncode:
                print(f"  diabayes could not be installed: {done.stderr.strip().splitlines()[-1]}")
                return
        given = Path(folder) / "given.npz"
        np.savez(given, truth=TRUTH, start=START[1:], machine=[K, V0, V], ts=ts, mu=mu)
        done = subprocess.run([python, "-c", INSIDE, given], capture_output=True, text=True)
        if done.returncode:
            print(f"  diabayes failed: {done.stderr.strip().splitlines()[-1]}")
            return
        said = json.loads(done.stdout.splitlines()[-1])

    def model(x: np.ndarray, rtol: float = 1e-12) -> np.ndarray:
        return friction(np.append(TRUTH[0], x), rtol, "DOP853")[AFTER]

    best, std = optimum(lambda x: model(x) - measured[AFTER], START[1:])
    error = float(np.max(np.abs(np.asarray(said["found"]) - best) / std))
    table.peer("diabayes, A, B, L alone", said["invert"], error, "whole fit, step found")
    error = float(np.max(np.abs(np.asarray(said["mu"])[1:] - model(TRUTH[1:])))) / TRUTH[1]
    simulated = Table("Its motion, tolerance 1e-8", "error/A")
    _motion(simulated)
    simulated.peer("diabayes, 1334 outputs", said["simulate"], error, "rtol 1e-06")


def _motion(table: Table) -> None:
    """The same motion by `simulate`."""
    law = jf.RateState(*TRUTH[:2], [TRUTH[2]], [TRUTH[3]], V0, evolution=jf.AgeingEvolution())
    rig = jf.Rig(jf.QuasiStatic(K), law)
    step = jf.PiecewiseVelocity([0.0, AT], [V0, V])
    run = jax.jit(lambda rig: jf.simulate(rig, step, TIMES, rtol=1e-6).force)
    force = np.asarray(run(rig))
    error = float(np.max(np.abs(force - friction(TRUTH, 1e-12, "DOP853")))) / TRUTH[1]
    table.ours("rtol 1e-06", timed(lambda: jax.block_until_ready(run(rig))), error)
