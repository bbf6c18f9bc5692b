"""How near alpha comes: `python -m fits.runs.stress [--seeds 2000 2024]`.

Generated runs (`generate`: SciPy's LSODA, nothing of jaxfric) of velocity steps and steps of the
normal stress, under the slip and the ageing law by turns, with white noise and noise cut from
measured records, are given to what `jaxfric run` does. Counted are the 95 % intervals of alpha that
hold the truth, the mean of the deviations in errors, and why no alpha was claimed.
"""

import argparse
import json
from collections import Counter
from pathlib import Path

import numpy as np

from .generate import generate

HERE = Path(__file__).parent
NOISES = ("white", "p655-run", "sepiolite-1", "basalt")
KINDS = {"step": 0.6, "stress": 0.4}


def study(seed: int, events: int) -> dict:
    """One run: every step of its normal stress, fitted."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jaxfric as jf
    from jaxfric.cache import cache_compiled
    from jaxfric.fitting.stiffness import MachineStiffness
    from jaxfric.runs import find_events
    from jaxfric.runs.fits import HowFitted, fit_run, without_resets_of
    from jaxfric.runs.stress_steps import fit_stress_steps

    cache_compiled()
    law, noise = ("slip", "ageing")[seed % 2], NOISES[seed // 2 % len(NOISES)]
    run = generate(seed, law=law, noise=noise, events=events, kinds=KINDS)
    record = jf.from_arrays(
        run.time, run.friction, load_point_displacement=run.position, normal_stress=run.sigma
    )
    k = MachineStiffness(run.press.K * run.press.sigma, of_stress=True)
    motion, found = find_events(record, stiffness=k)
    record, how = without_resets_of(record, motion.position), HowFitted(k, law)
    steps = fit_run(record, found, how).steps
    done = fit_stress_steps(record, found, steps, how)
    out = []
    for one in done:
        entry = {"time": one.time, "ratio": one.after / one.before, "why": one.why}
        if one.alpha is not None and one.error is not None:
            off = (one.alpha - run.press.alpha) / one.error
            entry |= {"alpha": one.alpha, "error": one.error, "off": off}
            assert one.fit is not None
            entry |= {"widened": one.fit.widened, "rms": one.fit.rms / one.fit.noise}
        out.append(entry)
    true = sum(h.kind == "stress" and h.before == h.after for h in run.happenings)
    return {
        "seed": seed, "law": law, "noise": noise, "alpha": run.press.alpha, "true": int(true),
        "stress steps": out,
    }  # fmt: skip


def summary(runs: list[dict]) -> dict:
    """Counts over all runs."""
    every = [one for run in runs for one in run["stress steps"]]
    off = np.array([one["off"] for one in every if "off" in one])
    errors = np.array([one["error"] for one in every if "off" in one])
    why = Counter(one["why"].split(":")[0] for one in every if one["why"])
    return {
        "stress steps": [len(every), int(sum(run["true"] for run in runs))],
        "alpha claimed": len(off),
        "truth in the 95 % interval": int(np.sum(np.abs(off) < 1.96)),
        "mean of (alpha - truth)/error": round(float(np.mean(off)), 3),
        "its standard error": round(float(np.std(off) / np.sqrt(len(off))), 3),
        "median error of alpha": round(float(np.median(errors)), 5),
        "not claimed": dict(why.most_common()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=[2000, 2024])
    parser.add_argument("--events", type=int, default=8)
    parser.add_argument("--out", type=Path, default=HERE / "stress.json")
    options = parser.parse_args()
    runs = []
    for seed in range(*options.seeds):
        runs.append(study(seed, options.events))
        print(seed, runs[-1]["law"], [
            f"{x['alpha']:.4f}({x['error']:.4f}) {x['off']:+.1f}" if "off" in x else x["why"][:60]
            for x in runs[-1]["stress steps"]
        ], f"true {runs[-1]['alpha']:.4f}", flush=True)  # fmt: skip
    found = summary(runs)
    for name, value in found.items():
        print(f"{name}: {value}")
    content = {"seeds": options.seeds, "summary": found, "runs": runs}
    options.out.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
