"""How the time of a simulation, a fit and a loop grows with the size of what they are given.

    python -m fits.benchmark [--out fits/benchmark] [--only simulate fit loop]

Seconds against the number of samples, velocity steps, states and members of a batch; log-log, with
the exponent of a line through the larger half of each. Everything compiled and warm, one thread of
XLA, medians of 3 to 15 (one where a run takes ten seconds). The fit of a million rows runs in a
process of its own, whose peak memory is told. Slip law, A .010, B .014, L 20 um, K 1e-3/um, tenfold
steps, white noise of 3e-4.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

os.environ.setdefault("NPROC", "1")  # read when JAX starts

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import jaxfric as jf
from fits.blind.plants import Base, Protocol, simulate
from jaxfric.cli.xla import whole_loops

F0, A, B, L, K, V0, FASTER = 0.6, 0.010, 0.014, 20e-6, 1e3, 1e-6, 10.0
AT, END = 10.0, 30.0
HERE = Path(__file__).parent
WHAT = {
    "samples": "simulate: samples of one step",
    "steps": "simulate: velocity steps, 40 samples each",
    "states": "simulate: states of the law, 2000 samples",
    "batch": "simulate: members of a batch, 100 samples",
    "rows": "fit: rows, step found",
    "loop rows": "loop: rows, 18 effects",
}


def median(function: Callable[[], object]) -> float:
    """Median of the seconds of calls after a first one: 15 of those shorter than 50 ms, three of
    others, one where it takes ten seconds."""
    function()
    spent: list[float] = []
    while not spent or len(spent) < (15 if spent[0] < 0.05 else 3 if spent[0] < 10 else 1):
        begun = time.perf_counter()
        function()
        spent.append(time.perf_counter() - begun)
    return float(np.median(spent))


def rig(states: int = 1, stiffness: float | jax.Array = K) -> jf.Rig:
    lengths = [L * 3.0**i for i in range(states)]
    return jf.Rig(
        jf.QuasiStatic(stiffness), jf.RateState(F0, A, [B / states] * states, lengths, V0)
    )


def simulated(rig: jf.Rig, motion: jf.PiecewiseVelocity, ts: np.ndarray) -> float:
    run = jax.jit(lambda rig: jf.simulate(rig, motion, ts, max_steps=1 << 16).force)
    return median(lambda: jax.block_until_ready(run(rig)))


def in_simulate() -> dict[str, list[tuple[int, float]]]:
    step = jf.PiecewiseVelocity([0.0, AT], [V0, FASTER * V0])
    samples = [10**k for k in range(2, 7)]
    found = {"samples": [(n, simulated(rig(), step, np.linspace(0, END, n))) for n in samples]}
    found["steps"] = []
    for number in (1, 2, 5, 10, 20, 50):
        lasts = np.where(np.arange(number) % 2 == 0, 10.0, 100.0)  # 100 um of slip at each speed
        starts = np.append(0.0, 10.0 + np.append(0.0, np.cumsum(lasts)[:-1]))
        speeds = V0 * np.where(np.arange(number + 1) % 2 == 0, 1.0, FASTER)
        ts = np.linspace(0, starts[-1] + lasts[-1], 40 * number)
        motion = jf.PiecewiseVelocity(starts, speeds)
        found["steps"].append((number, simulated(rig(), motion, ts)))
    ts = np.linspace(0, END, 2000)
    found["states"] = [(n, simulated(rig(n), step, ts)) for n in (1, 2, 3, 4)]
    few = np.linspace(0, END, 100)

    @jax.jit
    def many(stiffness):
        one = lambda K: jnp.mean(jf.simulate(rig(1, K), step, few).force)  # noqa: E731
        return jax.lax.map(one, stiffness, batch_size=min(256, len(stiffness)))

    found["batch"] = [
        (n, median(lambda n=n: jax.block_until_ready(many(np.linspace(K, 2 * K, n)))))
        for n in (1, 10, 100, 1000, 10_000, 100_000, 1_000_000)
    ]
    return found


def record(rows: int) -> jf.Record:
    """One tenfold step, by SciPy."""
    ts = np.linspace(0.0, END, rows)
    after = ts > AT

    def rate(t, y):
        V = V0 * np.exp(y[0])
        theta = -(V / L) * (y[1] + B * y[0])
        return [(K * (FASTER * V0 - V) - theta) / A, theta]

    span = (0, END - AT)
    y = solve_ivp(rate, span, [0.0, 0.0], "DOP853", ts[after] - AT, rtol=1e-10, atol=1e-12).y
    friction = F0 + np.append(np.zeros(np.sum(~after)), A * y[0] + y[1])
    moved = V0 * ts + (FASTER - 1) * V0 * np.maximum(ts - AT, 0)
    rng = np.random.default_rng(1)
    return jf.from_arrays(
        ts,
        friction + 3e-4 * rng.standard_normal(rows),
        load_point_displacement=moved + 2e-8 * rng.standard_normal(rows),
    )


def fitted(rows: int) -> tuple[float, float, float]:
    """Seconds of a warm fit, peak memory [GiB], and A's distance from the truth in errors."""
    jax.config.update("jax_enable_x64", True)
    given = record(rows)
    found = []
    spent = median(lambda: found.append(jf.fit(given, stiffness=K)))
    estimate = found[-1].parameters["A"]
    return spent, peak_memory(), (estimate.value - A) / estimate.std


def peak_memory() -> float:
    """Of this process [GiB]; Linux counts to `ru_maxrss` what the process had that started it."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def in_fit(out: dict) -> list[tuple[int, float]]:
    found = []
    for rows in (300, 1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000):
        words = f"import fits.benchmark.__main__ as b; print(*b.fitted({rows}))"
        done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(done.stderr)
        seconds, peak, off = (float(x) for x in done.stdout.split())
        print(f"fit of {rows} rows: {seconds:.3g} s, {peak:.2f} GiB, A {off:+.1f} errors off")
        found.append((rows, seconds))
        out["fit of a million rows"] = {"seconds": seconds, "peak_GiB": peak}
    return found


def in_loop() -> list[tuple[int, float]]:
    """`jaxfric.loop` on one run of twelve steps (SciPy) with a second state hidden in it, sampled
    more and more finely, each time in white noise that no row shares with another."""
    speeds = V0 * np.array([1, 10, 1, 3, 10, 3, 1, 10, 3, 1, 3, 10, 1])
    protocol = Protocol(tuple(speeds), tuple(250e-6 / speeds))
    hidden = {"second_state": {"B2": 0.003, "L2": 100e-6}}
    found, named = [], set()
    for each in (55, 110, 221, 443, 886):
        share = (np.arange(each) + 0.5) / each
        parts = zip(protocol.starts, protocol.durations, strict=True)
        t = np.concatenate([start + share * lasts for start, lasts in parts])
        t -= t[0]
        noise = 3e-4 * np.random.default_rng(2).standard_normal(len(t))
        given = jf.from_arrays(
            t,
            simulate(Base(F0, A, B, L, K), protocol, hidden, t).record + noise,
            load_point_displacement=protocol.displacement(t),
        )

        def run(given: jf.Record = given) -> None:
            named.add(jf.close_loop(given, stiffness=K).effects)

        found.append((len(t), median(run)))
        print(f"loop of {len(t)} rows: {found[-1][1]:.3g} s", flush=True)
    print(f"named: {named}")
    return found


def exponent(pairs: Iterable[tuple[int, float]]) -> float:
    """Slope of a line through the larger half of the pairs, in logarithms."""
    some = np.log(np.array(list(pairs), float))
    some = some[len(some) // 2 :] if len(some) > 4 else some
    return float(np.polyfit(some[:, 0], some[:, 1], 1)[0])


def draw(found: dict[str, list[tuple[int, float]]], path: Path) -> None:
    figure, axes = plt.subplots(figsize=(7.2, 4.6), layout="constrained")
    marks = "osD^vP"
    for mark, (name, pairs) in zip(marks, found.items(), strict=False):
        sizes, seconds = np.array(pairs, float).T
        label = f"{WHAT[name]} (exponent {exponent(pairs):.2f})"
        axes.loglog(sizes, seconds, f"{mark}-", label=label, markersize=4)
    axes.set_xlabel("how many")
    axes.set_ylabel("time, compiled and warm [s]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, frameon=False, loc="upper left")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * 30)
    figure.savefig(path, dpi=150)


def main() -> None:
    whole_loops()  # as the command does
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE)
    parser.add_argument("--only", nargs="+", default=["simulate", "fit", "loop"])
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "growth.json"
    kept = json.loads(path.read_text()) if path.exists() else {"seconds": {}}
    if "simulate" in options.only:
        kept["seconds"] |= in_simulate()
    if "fit" in options.only:
        kept["seconds"]["rows"] = in_fit(kept)
    if "loop" in options.only:
        kept["seconds"]["loop rows"] = in_loop()
    kept["exponents"] = {name: exponent(pairs) for name, pairs in kept["seconds"].items()}
    path.write_text(json.dumps(kept, indent=1) + "\n")
    draw(kept["seconds"], options.out / "growth.png")
    for name, pairs in kept["seconds"].items():
        each = ", ".join(f"{n}: {1e3 * s:.3g} ms" for n, s in pairs)
        print(f"{WHAT[name]}: {each}; exponent {kept['exponents'][name]:.2f}")


if __name__ == "__main__":
    main()
