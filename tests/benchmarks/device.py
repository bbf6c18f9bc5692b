"""How long do many motions at once take on the device that JAX has, a GPU where there is one?

    python tests/benchmarks/device.py [--only motion lorenz studies]

A tenfold step of the command, 102 outputs, by `simulate` under `vmap`; where CuPy is installed
beside it the loops by hand of `limit.c`, a thread for each trajectory (`device.cu`). Lorenz'
equations as GPUODEBenchmarks (doi:10.1016/j.cma.2023.116591) has them: 2^23 from (1, 0, 0) for a
time of 1, rho from 0 to 21, 32 bit, tolerance 1e-8; on a V100 it gives 8.3 ns each for DiffEqGPU,
5.8 ns for MPGOS and 311 ns for diffrax. Studies by blocks of several sizes. Everything compiled and
warm, medians of five; errors against SciPy at a tolerance of 1e-12.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import peers_motion
import study
from peers_motion import (
    AT,
    F0,
    FASTER,
    MASS,
    STEADY,
    V0,
    A,
    B,
    L,
    scipy_with_mass,
    scipy_without_mass,
)
from peers_table import timed
from scipy.integrate import solve_ivp

import jaxfric as jf
from jaxfric.cli.xla import whole_loops
from jaxfric.simulation import rodas

RTOL = 1e-6
ROWS = slice(12, None, 13)
AFTER = peers_motion.AFTER[ROWS]
SAMPLES = len(AFTER)
PUBLISHED = 2**23


def say(name: str, number: int, seconds: float, error: float | None = None) -> None:
    each = f"{1e9 * seconds / number:12.4g} ns each"
    wrong = "" if error is None else f"   error {error:.1e}"
    print(f"  {name:34s} {number:8d} at once {1e3 * seconds:10.4g} ms {each}{wrong}", flush=True)


def by_hand() -> Any:
    """Kernels of `device.cu` by the type of their numbers, and CuPy; None where there is none."""
    try:
        import cupy
    except ImportError:
        print("  no CuPy: nothing by hand")
        return None
    here = Path(__file__).parent
    text = (here / "limit.c").read_text().replace("#include <math.h>", "")
    text += (here / "device.cu").read_text()

    def module(real: str) -> Any:
        options = ("-default-device", "-std=c++17", f"-DREAL={real}")
        return cupy.RawModule(code=text, options=options)

    return cupy, {real: module(real) for real in ("double", "float")}


def launched(kernel: Any, number: int, arguments: tuple) -> Callable[[], None]:
    import cupy

    threads = 64

    def run() -> None:
        kernel((-(-number // threads),), (threads,), arguments)
        cupy.cuda.get_current_stream().synchronize()

    return run


def stiffnesses(first: float, number: int) -> np.ndarray:
    """The first one is that of the reference."""
    return np.linspace(first, 1.5 * first, number)


def after_the_step(force: np.ndarray, truth: np.ndarray) -> float:
    return float(np.max(np.abs(np.asarray(force) - truth))) / A


def reference(solve: Callable, K: float) -> np.ndarray:
    """Friction at `AFTER`, from that of `peers_motion`, whose samples these are among."""
    method = "Radau" if solve is scipy_with_mass else "DOP853"
    return solve(K, method, 1e-12)[peers_motion.BEFORE :][ROWS]


def simulated(rig: Callable, K: float, numbers: tuple[int, ...], truth: np.ndarray) -> None:
    step = jf.PiecewiseVelocity([0.0, AT], [V0, FASTER * V0])
    ts = jnp.asarray(np.append(0.0, AT + AFTER))
    steps = int(jf.simulate(rig(K), step, ts, rtol=RTOL).num_steps)

    def force(K: jax.Array) -> jax.Array:
        most = 1 << steps.bit_length()
        return jf.simulate(rig(K), step, ts, rtol=RTOL, max_steps=most).force[1:]

    many = eqx.filter_jit(jax.vmap(force))
    for number in numbers:
        stiffness = jnp.asarray(stiffnesses(K, number))
        spent = timed(lambda k=stiffness: jax.block_until_ready(many(k)))
        say("simulate", number, spent, after_the_step(many(stiffness)[0], truth))


def motion() -> None:
    gpu = jax.default_backend() != "cpu"
    numbers = (1, 256, 4096, 65536) if gpu else (1, 256)
    kernels = by_hand() if gpu else None
    K = 2e3
    print("\nMotion without mass")
    truth = reference(scipy_without_mass, K)
    plain = jf.RateState(F0, A, [B], [L], V0)
    simulated(lambda K: jf.Rig(jf.QuasiStatic(K), plain), K, numbers, truth)
    if kernels is not None:
        cupy, modules = kernels
        law = cupy.asarray([K, A, B, L, V0, FASTER * V0])
        for number in (4096, 65536, 2**20):
            out = cupy.zeros((number, SAMPLES))
            arguments = (
                *(np.int32(number), cupy.asarray(stiffnesses(K, number)), law, 0.0, 0.0),
                *(cupy.asarray(AFTER), np.int32(SAMPLES), RTOL, out),
                cupy.zeros(number, dtype=np.int32),
            )
            run = launched(modules["double"].get_function("follow_all"), number, arguments)
            spent = timed(run)
            force = F0 + cupy.asnumpy(out[0])
            say(f"by hand, rtol {RTOL:g}", number, spent, after_the_step(force, truth))
    mass = jf.RateState(
        F0, A, [B], [L], V0, evolution=jf.AgeingEvolution(), direct=jf.RegularisedEffect()
    )
    for K in (520.0, 60.0):
        print(f"\nMotion with mass, K = {K * L / (B - A):.2f} K_cr and more")
        truth = reference(scipy_with_mass, K)
        simulated(lambda K: jf.Rig(jf.Inertial(MASS, K), mass), K, numbers, truth)
        if kernels is None:
            continue
        cupy, modules = kernels
        law = cupy.asarray([K, A, B, L, V0, FASTER * V0, MASS, F0])
        method = tuple(cupy.asarray(x) for x in (rodas.A, rodas.C, rodas.DENSE))
        for number in (4096, 65536):
            out = cupy.zeros((number, SAMPLES))
            arguments = (
                *(np.int32(number), cupy.asarray(stiffnesses(K, number)), law),
                *(cupy.asarray([0.0, 0.0, STEADY]), cupy.asarray(AFTER), np.int32(SAMPLES)),
                *(RTOL, *method, rodas.GAMMA, out, cupy.zeros(number, dtype=np.int32)),
            )
            run = launched(
                modules["double"].get_function("follow_all_with_mass"), number, arguments
            )
            spent = timed(run)
            error = after_the_step(cupy.asnumpy(out[0]), truth)
            say(f"by hand, rtol {RTOL:g}", number, spent, error)


def lorenz_rate(t: Any, y: Any, rho: Any) -> list:
    del t
    return [10.0 * (y[1] - y[0]), y[0] * (rho - y[2]) - y[1], y[0] * y[1] - 8 / 3 * y[2]]


def lorenz() -> None:
    gpu = jax.default_backend() != "cpu"
    number = PUBLISHED if gpu else 4096
    print("\nLorenz for a time of 1")
    truth = solve_ivp(
        lorenz_rate, (0, 1), [1.0, 0, 0], "DOP853", rtol=1e-12, atol=1e-12, args=(21,)
    )

    def wrong(y: Any) -> float:
        return float(np.max(np.abs(np.asarray(y, float) - truth.y[:, -1])))

    for real, rtol in (("float32", 1e-6), ("float32", 1e-8), ("float64", 1e-8)):
        controller = diffrax.PIDController(rtol=rtol, atol=rtol)

        def one(rho: jax.Array, controller=controller) -> jax.Array:
            term = diffrax.ODETerm(lambda t, y, rho: jnp.stack(lorenz_rate(t, y, rho)))
            y0 = jnp.asarray([1.0, 0, 0], rho.dtype)
            end = diffrax.diffeqsolve(
                term,
                diffrax.Tsit5(),
                *(jnp.asarray(t, rho.dtype) for t in (0.0, 1.0, 1e-3)),
                y0,
                rho,
                stepsize_controller=controller,
                adjoint=diffrax.ForwardMode(),
                throw=False,
            ).ys
            assert end is not None
            return end[0]

        many = jax.jit(jax.vmap(one))
        rho = jnp.linspace(0, 21, number, dtype=real)
        spent = timed(lambda many=many, rho=rho: jax.block_until_ready(many(rho)))
        say(f"diffrax, {real}, {rtol:g}", number, spent, wrong(many(rho)[-1]))
    kernels = by_hand() if gpu else None
    if kernels is None:
        return
    cupy, modules = kernels
    for name, rtol in (("float", 1e-6), ("float", 1e-8), ("double", 1e-8), ("float", 0.0)):
        real = np.float32 if name == "float" else np.float64
        out = cupy.zeros((number, 3), dtype=real)
        arguments = (np.int32(number), real(1.0), real(1e-3), real(rtol), out)
        run = launched(modules[name].get_function("lorenz_all"), number, arguments)
        spent = timed(run)
        how = f"{rtol:g}" if rtol else "1000 steps"
        say(f"by hand, {name}, {how}", number, spent, wrong(cupy.asnumpy(out[-1])))


def studies() -> None:
    """Blocks of a study: all members of one at once on a GPU."""
    gpu = jax.default_backend() != "cpu"
    print("\nStudies")
    sizes = (16384, 65536, 2**18) if gpu else (16384, 65536)
    for name, text in (("margins", study.MARGINS), ("ends", study.ENDS), ("steps", study.STEPS)):
        for size in sizes:
            with tempfile.TemporaryDirectory() as folder:
                path = study.spec(Path(folder), f"chunk = {size}\n" + text, 2 * size)
                first, spent = study.computed(study.task_of(path), 2)
            say(f"{name} (first block {first:.1f} s)", size, spent / 2)
    for size in (1024, 16384) if gpu else (1024,):
        text = study.ENDS.replace("inertia = false", "inertia = true")
        with tempfile.TemporaryDirectory() as folder:
            path = study.spec(Path(folder), f"chunk = {size}\n" + text, size)
            first, spent = study.computed(study.task_of(path), 1)
        say(f"ends with mass (first {first:.1f} s)", size, spent)


PARTS = {"motion": motion, "lorenz": lorenz, "studies": studies}


def main() -> None:
    whole_loops()
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_num_cpu_devices", study.CORES)  # as the command has it for a study
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    print(
        f"{study.CORES} cores, {jax.device_count()} x {jax.devices()[0].device_kind},"
        f" JAX {jax.__version__}"
    )
    for name in parser.parse_args().only:
        PARTS[name]()


if __name__ == "__main__":
    main()
