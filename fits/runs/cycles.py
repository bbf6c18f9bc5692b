"""What the teeth of stick-slip tell: `python -m fits.runs.cycles [--seeds 4000 4048]`.

Generated runs that stick-slip at several velocities (`saw`: SciPy, a slider with mass, nothing of
jaxfric), slip and ageing law and four kinds of noise by turns, are given to what `jaxfric run`
does. Counted are the 95 % intervals of A, B, A-B, L and K under the true law that hold the truth,
how large the errors are, and how often the true law is told. Runs in cycles.json are kept.
"""

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from .saw import generate

HERE = Path(__file__).parent
NOISES = ("white", "p655-run", "sepiolite-1", "basalt")
NAMES = ("A", "B", "A-B", "L", "K")


def study(seed: int) -> dict:
    """One run: what is told under either law, and the truth."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jaxfric as jf
    from jaxfric.cache import cache_compiled
    from jaxfric.runs import find_events
    from jaxfric.runs.cycles import fit_stick_slip

    cache_compiled()
    law, noise = ("slip", "ageing")[seed % 2], NOISES[seed // 2 % len(NOISES)]
    made = generate(seed, law=law, noise=noise)
    p = made.slider
    truth = {"A": p.A, "B": p.B, "A-B": p.A - p.B, "L": p.L, "K": p.K}
    record = jf.from_arrays(made.time, made.friction, load_point_displacement=made.position)
    events = find_events(record)[1]
    found = fit_stick_slip(record, events)
    out = {
        "seed": seed,
        "law": law,
        "noise": noise,
        "softness": p.K * p.L / (p.B - p.A),
        "mass": p.T * max(made.velocities) / p.L,
        "velocities": len(made.velocities),
        "events": [event.kind for event in events],
    }
    if found is None:
        return out | {"told": None, "teeth": [], "claimed": {}, "doubt": "no stick-slip is found"}
    known = found.claimed(law)
    return out | {
        "told": found.law,
        "teeth": [one.count for one in found.stretches],
        "chi": {name: [fit.chi2, fit.freedom] for name, fit in found.fits.items()},
        "doubt": found.doubts.get(law, ""),
        "claimed": {
            name: {"off": (value - truth[name]) / error, "error": error / abs(truth[name])}
            for name, (value, error) in known.items()
        },
    }


def summary(runs: list[dict]) -> dict:
    """Counts over all runs."""
    out: dict = {
        "runs": len(runs),
        "the true law is told": sum(run["told"] == run["law"] for run in runs),
        "the other law is told": sum(run["told"] not in (None, run["law"]) for run in runs),
        "nothing is claimed": sum(not run["claimed"] for run in runs),
        "called a glitch": sum(run["events"].count("glitch") for run in runs),
        "stretches used": [
            sum(count > 0 for run in runs for count in run["teeth"]),
            sum(run["velocities"] for run in runs),
        ],
    }
    for name in NAMES:
        every = [run["claimed"][name] for run in runs if name in run["claimed"]]
        off = np.array([one["off"] for one in every])
        error = np.array([one["error"] for one in every])
        out[name] = {
            "determined": len(every),
            "truth in the 95 % interval": int(np.sum(np.abs(off) < 1.96)),
            "mean of (value - truth)/error": round(float(np.mean(off)), 2) if len(off) else None,
            "median error, of the value": round(float(np.median(error)), 4) if len(off) else None,
        }
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(4000, 4048), metavar=("FROM", "TO"))
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=HERE / "cycles.json")
    given = parser.parse_args()
    runs = json.loads(given.out.read_text(encoding="utf-8"))["runs"] if given.out.exists() else []
    done = {run["seed"] for run in runs}
    os.environ.setdefault("NPROC", "1")
    with ProcessPoolExecutor(given.cores) as pool:
        for run in pool.map(study, [s for s in range(*given.seeds) if s not in done]):
            runs.append(run)
            runs.sort(key=lambda run: run["seed"])
            content = {"summary": summary(runs), "runs": runs}
            given.out.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
            line = " ".join(
                f"{n} {one['off']:+.1f} ({100 * one['error']:.2g} %)"
                for n, one in run["claimed"].items()
            )
            told = f"told {run['told']}; {line or run['doubt'] or 'not determined'}"
            print(run["seed"], run["law"], run["noise"], told, flush=True)
    for name, value in summary(runs).items():
        print(f"{name}: {value}")


if __name__ == "__main__":
    main()
