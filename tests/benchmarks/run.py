"""How long does a whole run take?

    python tests/benchmarks/run.py

In this process, warm: the events of one synthetic run of 50 velocity steps of 2000 rows each, 1 and
10 um/s by turns, a=.010 b=.014 Dc=20 um k=1e-3/um, white noise 3e-4; the fits of its steps, with
starts, noise and errors as `jaxfric run` makes them; and the least squares of all of them alone.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from peers_table import timed

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reference import Law, Motion, solve

import jaxfric
from jaxfric.cli.xla import whole_loops
from jaxfric.fitting.problem import Model
from jaxfric.fitting.solve import solve as descend_from
from jaxfric.fitting.stages import prepare
from jaxfric.fitting.stiffness import MachineStiffness
from jaxfric.runs import find_events
from jaxfric.runs.fits import HowFitted, fit_run, window_of

STEPS, ROWS, STIFFNESS = 50, 2000, 1e3
V = (1e-6, 1e-5)
WAY = 400e-6
"""Load-point motion at every velocity [m]."""


def synthetic() -> jaxfric.Record:
    """The run, by SciPy."""
    speeds = [V[k % 2] for k in range(STEPS + 1)]
    lasts = WAY / np.array(speeds)
    begins = np.concatenate([[0.0], np.cumsum(lasts)])
    # a window has half of the rows before its step, and all after it
    each = (np.arange(2 * ROWS // 3) + 0.5) / (2 * ROWS // 3)
    t = np.concatenate([b + each * last for b, last in zip(begins[:-1], lasts, strict=True)])
    clean = solve(
        Law("slip", 0.6, 0.010, (0.014,), (20e-6,)),
        Motion(tuple(begins[:-1]), tuple(speeds)),
        STIFFNESS,
        t,
        rtol=1e-8,
    ).f
    x = np.interp(t, begins, WAY * np.arange(STEPS + 2))
    rng = np.random.default_rng(1)
    return jaxfric.from_arrays(
        t,
        clean + 3e-4 * rng.standard_normal(len(t)),
        load_point_displacement=x + 2e-8 * rng.standard_normal(len(t)),
    )


def seconds(function: Callable[[], object]) -> str:
    """Median of warm calls."""
    return f"median {timed(function):.2f} s"


def main() -> None:
    record, k = synthetic(), MachineStiffness(STIFFNESS)
    print(f"events of {len(record)} rows:", seconds(lambda: find_events(record, stiffness=k)))
    events = find_events(record, stiffness=k).events
    chosen = [event for event in events if event.fitted]
    rows = [len(window_of(record, event)[0]) for event in chosen]
    print(f"{len(chosen)} steps, {min(rows)} to {max(rows)} rows")
    print("their fits:", seconds(lambda: fit_run(record, events, HowFitted(k))))
    problems = [
        prepare(*window_of(record, event), Model(), stiffness=STIFFNESS, force_scale=0.01)
        for event in chosen
    ]
    starts = [p.coordinates.to_free(np.array([[0.601, 0.013, 0.017, 30e-6]])) for p in problems]
    alone = seconds(lambda: [descend_from(*one) for one in zip(problems, starts, strict=True)])
    print("least squares alone, one after the other:", alone)


if __name__ == "__main__":
    whole_loops()  # as the command does
    jax.config.update("jax_enable_x64", True)
    jaxfric.cache_compiled()
    main()
