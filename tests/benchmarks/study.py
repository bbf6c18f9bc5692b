"""How many members a second does a study compute, in how much memory, on how many workers?

    python tests/benchmarks/study.py [--quick]

One line per number. Compiled once before, unless the line says otherwise; every device of JAX is a
core. The last lines are ratios: sorted over unsorted members, two Dask workers over one.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import textwrap
import time
from pathlib import Path

import jax
import numpy as np

from jaxfric.cli.xla import whole_loops
from jaxfric.members import make, run_study
from jaxfric.study import local
from jaxfric.study.function import Task
from jaxfric.study.grid import Tiling

CORES = len(os.sched_getaffinity(0))
RIG = """
[rig]
law = "slip"
A = "4.5 N"
L = "5 um"
m = "2 kg"
"""
MARGINS = """
compute = ["margins"]
{dtype}
{rig}
[samples]
number = {number}
[axes]
B = {{ sobol = ["5 N", "9 N"] }}
k_p = {{ sobol = ["100 kN/m", "3 MN/m"], log = true }}
k_v = {{ sobol = ["1 kN*s/m", "200 kN*s/m"] }}
V0 = {{ sobol = ["1 um/s", "100 um/s"], log = true }}
"""
STEPS = """
compute = ["simulate"]
outputs = ["trace", "force"]
{rig}
[simulate]
inertia = false
samples = 100
rtol = 1e-6
[samples]
number = {number}
[axes]
B = {{ sobol = ["5 N", "9 N"] }}
k_p = {{ sobol = ["300 kN/m", "5 MN/m"], log = true }}
k_v = {{ sobol = ["1 kN*s/m", "200 kN*s/m"] }}
V0 = {{ sobol = ["1 um/s", "100 um/s"], log = true }}
"""
ENDS = STEPS.replace('outputs = ["trace", "force"]\n', "").replace("samples = 100\n", "")


def say(text: str) -> None:
    print(text, flush=True)


def spec(folder: Path, text: str, number: int, dtype: str = "") -> Path:
    path = folder / "study.toml"
    path.write_text(text.format(rig=RIG, number=number, dtype=dtype))
    return path


def task_of(path: Path, *, batch: int | None = None, sort: bool = True) -> Task:
    of, made = make(path)
    blocks = Tiling.of(of.grid.shape, made.chunk)
    return Task(
        made.function,
        of.grid,
        blocks,
        made.outputs,
        made.kind,
        made.cost if sort else None,
        batch or made.batch,
        of.dtype,
    )


def computed(task: Task, blocks: int) -> tuple[float, float]:
    """Seconds to compile (and compute a block), and then to compute `blocks` of them."""
    begun = time.perf_counter()
    local.compute(task, 0)
    first = time.perf_counter() - begun
    begun = time.perf_counter()
    for number in range(blocks):
        local.compute(task, number)
    return first, time.perf_counter() - begun


def throughput(folder: Path, text: str, name: str, number: int, goal: str) -> None:
    task = task_of(spec(folder, text, number))
    blocks = min(len(task.blocks), max(1, len(task.blocks)))
    first, spent = computed(task, blocks)
    members = task.grid.size
    say(f"{members} {name}: {spent:.2f} s computed ({goal}); first block {first:.1f} s")


def general(folder: Path, number: int, fewer: int) -> None:
    """Ends by the solver that serves all laws and masses, over those of massless sliders."""
    each = []
    for name, inertia, members in (
        ("ends", "inertia = false", number),
        ("ends with mass", "inertia = true", fewer),
    ):
        text = ENDS.replace("inertia = false", inertia)
        task = task_of(spec(folder, text, members))
        first, spent = computed(task, len(task.blocks))
        each.append(spent / members)
        say(f"{members} {name}: {1e3 * each[-1]:.3f} ms each; first block {first:.1f} s")
    say(f"with mass {each[1] / each[0]:.0f} times as long (20)")


def stored(folder: Path, number: int, goal: str) -> None:
    """The whole of it: grid, compilation, computation, checksums, store."""
    path = spec(folder, MARGINS, number)
    spent = []
    for turn in range(2):
        begun = time.perf_counter()
        run_study(path, folder / f"store{turn}")
        spent.append(time.perf_counter() - begun)
    again = time.perf_counter()
    run_study(path, folder / "store0")
    again = time.perf_counter() - again
    say(
        f"{number} margins into a store, tracing and compilation included: {spent[0]:.1f} s, from"
        f" the cache {spent[1]:.1f} s ({goal}); checked by checksum in {again:.2f} s"
    )


def sorting(folder: Path, number: int) -> None:
    for text, name in ((STEPS, "steps in time"), (ENDS, "ends")):
        path = spec(folder, text, number)
        times = {}
        for sort in (True, False):
            task = task_of(path, sort=sort)
            times[sort] = _better_of_two(task)
        alone = _better_of_two(task_of(path, sort=False, batch=10**9))
        say(
            f"{number} {name}: sorted {times[True]:.2f} s, not sorted {times[False]:.2f} s, in one"
            f" batch {alone:.2f} s: sorting gives {times[False] / times[True]:.2f} x, batches and"
            f" sorting {alone / times[True]:.2f} x"
        )


def _better_of_two(task: Task) -> float:
    return min(computed(task, len(task.blocks))[1] for _ in range(2))


def precision(folder: Path, number: int) -> None:
    """What 32-bit numbers cost: the margin of error of each output."""
    found = {}
    for dtype in ("float64", "float32"):
        path = spec(folder, MARGINS, number, f'dtype = "{dtype}"')
        task = task_of(path)
        parts = [local.compute(task, i).values for i in range(len(task.blocks))]
        _, spent = computed(task, len(task.blocks))
        found[dtype] = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}, spent
    (double, t64), (single, t32) = found["float64"], found["float32"]
    say(f"{number} margins: x64 {t64:.2f} s, x32 {t32:.2f} s")
    for name in ("stiffness", "decay", "modulus", "gain", "phase", "k_cr"):
        a, b = double[name], single[name].astype(float)
        kept = np.isfinite(a) & np.isfinite(b) & (a != 0)
        error = np.abs(b[kept] - a[kept]) / np.abs(a[kept])
        high = np.percentile(error, 99)
        say(f"  x32 error of {name}: median {np.median(error):.1e}, 99 % below {high:.1e}")
    wrong = np.mean(double["stability"] != single["stability"])
    say(f"  x32: {100 * wrong:.3f} % of the members change stability")


def memory(folder: Path, number: int) -> None:
    """Peak memory of a process that runs a study of `number` members and nothing else."""
    path = spec(folder, STEPS, number)
    code = textwrap.dedent(f"""
        import resource, jax
        jax.config.update("jax_enable_x64", True)
        jax.config.update("jax_num_cpu_devices", {CORES})
        from jaxfric.members import run_study
        run_study({str(path)!r}, {str(folder / "memory")!r})
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
    """)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    say(f"peak memory of {number} steps with 100 outputs: {float(done.stdout):.2f} GiB (2 GiB)")


def workers(folder: Path, number: int) -> None:
    """Throughput by the clock, and by the CPU time of the workers: what a busy machine leaves."""
    import psutil
    from distributed import LocalCluster

    path = spec(folder, ENDS.replace("{rig}", "chunk = 1024\n{rig}"), number)
    clock, cpu = {}, {}
    for count in (1, 2):
        with LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            dashboard_address=None,
            worker_dashboard_address=None,
        ) as cluster:
            processes = [psutil.Process(worker.pid) for worker in cluster.workers.values()]
            marks: list[tuple[float, float]] = []

            def mark(_, processes=processes, marks=marks):
                spent = sum(sum(process.cpu_times()[:2]) for process in processes)
                marks.append((time.perf_counter(), spent))

            store = folder / f"cluster{count}"
            run_study(path, store, scheduler=cluster.scheduler_address, progress=mark)
        # every worker compiles with its first chunk
        chunks = len(marks) - 1 - 2 * count
        clock[count], cpu[count] = (
            (b - a) / chunks for a, b in zip(marks[2 * count], marks[-1], strict=True)
        )
    say(
        f"{number} ends on Dask: {1024 / clock[1]:.0f} members/s with one worker,"
        f" {1024 / clock[2]:.0f} with two: {clock[1] / clock[2]:.2f} x (1.7 x); CPU time of a"
        f" member: {1e6 * cpu[1] / 1024:.0f} us with one, {1e6 * cpu[2] / 1024:.0f} us with two:"
        f" {2 * cpu[1] / cpu[2]:.2f} x where both have a core to themselves"
    )


def main() -> None:
    whole_loops()  # as the command does
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_num_cpu_devices", CORES)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of the members")
    parser.add_argument(
        "--only", default="", help="margins, steps, ends, store, sort, x32, memory, dask"
    )
    given = parser.parse_args()
    tenth = 10 if given.quick else 1
    say(f"{jax.device_count()} x {jax.devices()[0].device_kind}, {CORES} cores")
    parts = {
        "margins": lambda f: throughput(f, MARGINS, "margins", 2**20 // tenth, "5 s for 1e6"),
        "steps": lambda f: throughput(f, STEPS, "steps", 102_400 // tenth, "10 s for 1e5"),
        "ends": lambda f: general(f, 16384 // tenth, 512 // tenth),
        "store": lambda f: stored(f, 2**20 // tenth, "5 s for 1e6"),
        "sort": lambda f: sorting(f, 16384 // tenth),
        "x32": lambda f: precision(f, 2**18 // tenth),
        "memory": lambda f: memory(f, 200_000 // tenth),
        "dask": lambda f: workers(f, 65536 // tenth),
    }
    for name, part in parts.items():
        if given.only in ("", name):
            with tempfile.TemporaryDirectory() as folder:
                part(Path(folder))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    say(f"peak memory of this process: {peak:.2f} GiB")


if __name__ == "__main__":
    main()
