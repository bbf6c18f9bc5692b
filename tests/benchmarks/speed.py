"""How long does a fit take?

    python tests/benchmarks/speed.py

In this process: a warm fit of three parameters (A, B, L; f0 too) to one synthetic step of 2000
samples, 1 -> 10 um/s, a=.010 b=.014 Dc=20 um k=1e-3/um, white noise 3e-4: the descent alone, the
whole `jaxfric.fit` with its starting values and error bars, the same with the steps found, and
the first fit of a record of another length. In fresh processes: the command again, and --help.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reference import Law, Motion, solve

import jaxfric
from jaxfric.cli.xla import whole_loops
from jaxfric.fitting.problem import Model
from jaxfric.fitting.solve import solve as descend_from
from jaxfric.fitting.stages import prepare

STIFFNESS = 1e3
STEPS = jaxfric.VelocitySteps(np.array([0.0, 10.0]), np.array([1e-6, 1e-5]))
ROOT = Path(__file__).resolve().parents[2]


def synthetic(samples: int) -> jaxfric.Record:
    """The record of the benchmark, by SciPy."""
    time_ = np.linspace(0.0, 30.0, samples)
    clean = solve(
        Law("slip", 0.6, 0.010, (0.014,), (20e-6,)),
        Motion(tuple(STEPS.times), tuple(STEPS.velocities)),
        STIFFNESS,
        time_,
        rtol=1e-9,
    ).f
    rng = np.random.default_rng(1)
    return jaxfric.from_arrays(
        time_,
        clean + 3e-4 * rng.standard_normal(samples),
        load_point_displacement=STEPS.displacement(time_) + 2e-8 * rng.standard_normal(samples),
    )


def milliseconds(function, repeats: int = 15) -> str:
    """Minimum, median and maximum of warm calls."""
    function()
    spent = []
    for _ in range(repeats):
        begun = time.perf_counter()
        function()
        spent.append(1e3 * (time.perf_counter() - begun))
    return f"median {np.median(spent):6.1f} ms   ({min(spent):.1f} to {max(spent):.1f})"


def in_process() -> None:
    record = synthetic(2000)
    problem = prepare(record, STEPS, Model(), stiffness=STIFFNESS, force_scale=0.01)
    start = problem.coordinates.to_free(np.array([[0.601, 0.013, 0.017, 30e-6]]))
    print("least squares from a given start:", milliseconds(lambda: descend_from(problem, start)))
    fit = lambda **more: jaxfric.fit(record, stiffness=STIFFNESS, **more)  # noqa: E731
    print("whole fit, steps given:          ", milliseconds(lambda: fit(steps=STEPS)))
    print("whole fit, steps found:          ", milliseconds(fit))
    for samples in (1990, 1800):
        other = synthetic(samples)
        begun = time.perf_counter()
        jaxfric.fit(other, stiffness=STIFFNESS, steps=STEPS)
        spent = 1e3 * (time.perf_counter() - begun)
        print(f"first fit of {samples} samples:       {spent:6.1f} ms (no compilation)")


def command() -> None:
    program = Path(sys.executable).with_name("jaxfric")
    record = ROOT / "data" / "velocity_step.csv"
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"XDG_CACHE_HOME": folder}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # with which all is compiled from source
        arguments = [program, "fit", record, "--stiffness", "5e-3/um", "--out", f"{folder}/fit"]
        for which in ("first", "second", "third", "fourth"):
            print(f"jaxfric fit, {which} time: {_seconds(arguments, environment):.2f} s")
    times = sorted(_seconds([program, "--help"], os.environ) for _ in range(5))
    print(f"jaxfric --help: median {times[2]:.2f} s")


def _seconds(arguments: list, environment) -> float:
    begun = time.perf_counter()
    subprocess.run(arguments, check=True, env=dict(environment), stdout=subprocess.DEVNULL)
    return time.perf_counter() - begun


if __name__ == "__main__":
    whole_loops()  # as the command does
    jax.config.update("jax_enable_x64", True)
    in_process()
    command()
