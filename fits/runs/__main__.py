"""How well runs are taken apart and fitted: `python -m fits.runs [--seeds 0 20] [--no-fits]`.

`--events 20 --rates many --out FILE` makes shorter runs, at many sampling rates only.

Generated runs of fifty events (`generate`), by turns with white noise and with noise cut from
measured records, at one and at many sampling rates. Counted are velocity steps that are found and
fitted as such (recall; precision: how many of those fitted are steps), events whose kind is right,
and the 95 % intervals of A, B, L and A-B that hold the truth.
"""

import argparse
import json
import os
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from .generate import Run, generate

HERE = Path(__file__).parent
NOISES = ("white", "p655-run", "sepiolite-1", "basalt")


def matched(run: Run, events: list) -> tuple[list[tuple], list]:
    """Pairs of what happened and the event of the run that is it (None: missed), and events that
    are nothing: by time, within 2 L of load-point motion (stick-slip: 7 L)."""
    left, pairs = list(events), []
    for happening in run.happenings:
        at = happening.time - run.time[0]
        speed = max(abs(happening.before), abs(happening.after))
        within = max((7 if happening.kind == "stick_slip" else 2) * run.press.L / speed, 0.05)
        near = [e for e in left if abs(e.time - at) < within]
        same = [e for e in near if e.kind == happening.kind]
        best = min(same or near, key=lambda e: abs(e.time - at), default=None)
        if best is not None:
            left.remove(best)
        pairs.append((happening, best))
    return pairs, left


def study(task: tuple[int, str, bool, int]) -> dict:
    """One run: counts of its events, and how far its fits are from the truth in errors."""
    seed, rates, fits, number = task
    import jax

    jax.config.update("jax_enable_x64", True)
    import jaxfric as jf
    from jaxfric.cache import cache_compiled
    from jaxfric.fitting.stiffness import MachineStiffness
    from jaxfric.runs import find_events
    from jaxfric.runs.fits import HowFitted, fit_run, without_resets_of
    from jaxfric.runs.joint import share
    from jaxfric.runs.table import difference

    cache_compiled()
    run = generate(seed, rates=rates, noise=NOISES[seed % len(NOISES)], events=number)
    record = jf.from_arrays(
        run.time, run.friction, load_point_displacement=run.position, normal_stress=run.sigma
    )
    k = MachineStiffness(run.press.K * run.press.sigma, of_stress=True)
    motion, events = find_events(record, stiffness=k)
    pairs, extra = matched(run, list(events))
    found = Counter(f"{h.kind} > {'missed' if e is None else e.kind}" for h, e in pairs)
    found.update(f"nothing > {e.kind}" for e in extra)
    true = [e for h, e in pairs if h.kind == "step" and e is not None and e.kind == "step"]
    off, joint = [], None
    if fits and any(e.fitted for e in true):
        chosen = [e for e in true if e.fitted]
        how = HowFitted(k, run.press.law)
        done = fit_run(without_resets_of(record, motion.position), chosen, how)
        shared = share(done.steps)
        joint = None if shared is None else shared.p
        for step in done.steps:
            if step.fit is None or not step.fit.converged:
                off.append(None)
                continue
            p = step.fit.parameters
            z = {
                name: float(
                    np.log(p[name].value / getattr(run.press, name)) * p[name].value / p[name].std
                )
                for name in "ABL"
                if p[name].determined
            }
            value, error = difference(step.fit)
            z["A-B"] = float((value - run.press.A + run.press.B) / error)
            z["inside"] = {
                name: bool(p[name].lower <= getattr(run.press, name) <= p[name].upper)
                for name in "ABL"
                if p[name].determined
            }
            off.append(z)
    return {
        "seed": seed,
        "rates": rates,
        "noise": NOISES[seed % len(NOISES)],
        "rows": len(run.time),
        "events": dict(found),
        "steps": sum(h.kind == "step" for h in run.happenings),
        "fitted": sum(e.fitted for e in events),
        "fitted steps": sum(e.fitted for e in true),
        "off": off,
        "p shared": joint,
    }


def summary(runs: list[dict]) -> dict:
    """Shares over all runs."""
    events: Counter = Counter()
    for run in runs:
        events.update(run["events"])
    happened = {k: n for k, n in events.items() if not k.startswith("nothing")}
    right = sum(n for k, n in happened.items() if k.split(" > ")[0] == k.split(" > ")[1])
    steps = sum(n for k, n in happened.items() if k.startswith("step > "))
    named = sum(n for k, n in events.items() if k.endswith("> step"))
    offs = [z for run in runs for z in run["off"] if z is not None]
    inside = {
        name: [sum(z["inside"][name] for z in offs if name in z["inside"]),
               sum(name in z["inside"] for z in offs)]
        for name in "ABL"
    }  # fmt: skip
    inside["A-B"] = [sum(abs(z["A-B"]) < 1.96 for z in offs), len(offs)]
    p = [run["p shared"] for run in runs if run["p shared"] is not None]
    return {
        "runs": len(runs),
        "recall of steps": [events["step > step"], steps],
        "precision of steps": [events["step > step"], named],
        "kinds right": [right, sum(happened.values())],
        "events that are nothing": sum(n for k, n in events.items() if k.startswith("nothing")),
        "fits": [len(offs), sum(len(run["off"]) for run in runs)],
        "shared, called separate at p < .05": [sum(x < 0.05 for x in p), len(p)],
        "truth in the 95 % interval": inside,
        "events": dict(sorted(events.items())),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=[1000, 1020])
    parser.add_argument("--no-fits", action="store_true")
    parser.add_argument("--events", type=int, default=50)
    parser.add_argument("--rates", nargs="*", default=["many", "one"])
    parser.add_argument("--out", type=Path, default=HERE / "results.json")
    options = parser.parse_args()
    tasks = [
        (seed, rates, not options.no_fits and rates == "many", options.events)
        for seed in range(*options.seeds)
        for rates in options.rates
    ]
    os.environ.setdefault("NPROC", "1")
    runs: list[dict] = []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for run in pool.map(study, tasks):
            runs.append(run)
            kept = [{name: value for name, value in run.items() if name != "off"} for run in runs]
            seeds = [options.seeds[0], run["seed"] + 1]
            content = {"seeds": seeds, "summary": summary(runs), "runs": kept}
            options.out.write_text(json.dumps(content, indent=1) + "\n")
            print(run["seed"], run["rates"], run["p shared"], flush=True)
    for name, value in summary(runs).items():
        print(f"{name}: {value}")


if __name__ == "__main__":
    main()
