"""How often is the loop right on servo axes? `python -m fits.blind.axis_study --out DIR`.

Every effect of `axis_generate` but rate_and_state, and two axes that lack nothing, `--count`
records of each at three noise levels. The structure of an effect is as large at every level, 1 N
rms beyond the base fit: rho is 2, 1 and 0.5 where the noise is 0.5, 1 and 2 N. Seeds are 1000,
1001, ..., fixed before the first run. A run that was stopped goes on where it was;
DIR/loops/NAME.json holds one record, DIR/axis_results.md and .json the numbers.
"""

import argparse
import json
import multiprocessing
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .axis_generate import Request, UnreachableError, make
from .cores import one_thread
from .score import wilson
from .scored import CONFIRMED

RHO = {"low": 2.0, "medium": 1.0, "high": 0.5}
NOTHING = ("viscous", "coulomb")
EFFECTS = (
    "cubic",
    "stribeck",
    "direction_asymmetry",
    "position_periodic",
    "position_dependence",
    "presliding",
    "time_drift",
    "sensor_lag",
    "sensor_delay",
)
GROUPS = (("sensor_lag", "sensor_delay", "servo_lag"),)
"""Effects that no record of this kind tells apart."""
FIRST_SEED = 1000
_RECORDS_PER_PROCESS = 25


def requests(count: int, first: int = FIRST_SEED) -> list[Request]:
    """All records of the study, level by level; the first seed is 1000."""
    return [
        Request(first + k, (effect,), RHO[noise], noise)
        for k in range(count)
        for noise in RHO
        for effect in (*NOTHING, *EFFECTS)
    ]


def label(request: Request) -> str:
    """Name of a record in the study."""
    return f"{request.noise}-{request.effects[0]}-{request.seed}"


def treat(job: tuple[Request, Path]) -> str:
    """One record: made, loop closed, what was found written; a line about it."""
    request, out = job
    from jaxfric.axis import close_axis_loop
    from jaxfric.cli.common import prepare_jax
    from jaxfric.records import axis_from_arrays

    prepare_jax()
    row: dict = {"noise": request.noise, "asked": request.effects[0], "seed": request.seed}
    begun = time.monotonic()
    try:
        blind = make(request)
        t, q, reference, force = blind.columns.values()
        record = axis_from_arrays(t, force, position=1e-6 * q, reference_position=1e-6 * reference)
        made = time.monotonic()
        loop = close_axis_loop(record, zero_order_hold=True)
        row |= {
            "verdict": loop.verdict,
            "effects": list(loop.effects),
            "heldout_before": loop.test_error(loop.before),
            "heldout_after": loop.test_error(loop.after),
            "parameters": {n: [e.value, e.std] for n, e in loop.after.parameters.items()},
            "before": {n: e.value for n, e in loop.before.parameters.items()},
            "truth": blind.truth,
            "seconds": time.monotonic() - made,
        }
    except UnreachableError as error:
        row["unreachable"] = str(error)
    except Exception as error:
        row["error"] = f"{type(error).__name__}: {error}"
    path = out / "loops" / f"{label(request)}.json"
    part = path.with_suffix(".part")
    part.write_text(json.dumps(row, default=str) + "\n", encoding="utf-8")
    part.replace(path)
    said = row.get("verdict") or row.get("error") or "unreachable"
    return f"{time.monotonic() - begun:6.1f} s  {label(request):32} {said} {row.get('effects', '')}"


def alike(a: str, b: str) -> bool:
    """Whether two effects are the same or not to be told apart."""
    return a == b or any(a in group and b in group for group in GROUPS)


def publish(out: Path) -> str:
    """Score all that is in DIR; the page."""
    rows = [json.loads(path.read_text()) for path in sorted((out / "loops").glob("*.json"))]
    good = [r for r in rows if "verdict" in r]
    lines = ["# Servo axes: what the loop found where nobody told it", ""]
    unreachable, failed = sum("unreachable" in r for r in rows), [r for r in rows if "error" in r]
    lines.append(
        f"{len(good)} records ({unreachable} could not be made, {len(failed)} failed), by"
        " `python -m fits.blind.axis_study`. Right group: the effect or one that no such record"
        " tells from it was added, and nothing else. Alone: exact, of those that no other effect"
        " of the catalogue resembles so. Held-out: rms error over sigma of the noise, whose own"
        " scatter is that of the records with nothing in them."
    )
    lines += [
        "",
        "| noise | nothing: named | right group | exact | alone | confirmed |"
        " held-out median, 90 % | of nothing |",
    ]
    lines.append("|---|---|---|---|---|---|---|---|")
    numbers: dict[str, dict] = {}
    for noise in RHO:
        here = [r for r in good if r["noise"] == noise]
        null = [r for r in here if r["asked"] in NOTHING]
        one = [r for r in here if r["asked"] in EFFECTS]
        right = [r for r in one if _right(r)]
        exact = [r for r in one if r["effects"] == [r["asked"]]]
        confirmed = [r for r in right if r["verdict"] in CONFIRMED]
        alone = [r for r in one if not any(r["asked"] in group for group in GROUPS)]
        found = [r for r in exact if r in alone]
        held, still = _heldout(one), _heldout(null)
        named = sum(bool(r["effects"]) for r in null)
        numbers[noise] = {
            "nothing named": [named, len(null)],
            "right group": [len(right), len(one)],
            "exact": [len(exact), len(one)],
            "confirmed": [len(confirmed), len(one)],
            "alone": [len(found), len(alone)],
            "held-out": list(held),
            "held-out of nothing": list(still),
        }
        lines.append(
            f"| {noise} | {_share(named, len(null))} | {_share(len(right), len(one))} |"
            f" {_share(len(exact), len(one))} | {_share(len(found), len(alone))} |"
            f" {_share(len(confirmed), len(one))} |"
            f" {held[0]:.3f}, {held[1]:.3f} | {still[0]:.3f}, {still[1]:.3f} |"
        )
    lines += ["", "| asked | found (times) | verdicts |", "|---|---|---|"]
    for asked in (*NOTHING, *EFFECTS):
        here = [r for r in good if r["asked"] == asked]
        found = Counter(" + ".join(r["effects"]) or "nothing" for r in here)
        verdicts = Counter(r["verdict"] for r in here)
        lines.append(f"| {asked} | {_counted(found)} | {_counted(verdicts)} |")
    spent = [r["seconds"] for r in good] or [np.nan]
    lines += ["", f"Seconds for a record: median {np.median(spent):.0f}, longest {max(spent):.0f}."]
    lines += [f"- failed: {r['noise']} {r['asked']} {r['seed']}: {r['error']}" for r in failed]
    text = "\n".join(lines) + "\n"
    (out / "axis_results.md").write_text(text, encoding="utf-8")
    kept = [{k: v for k, v in r.items() if k != "truth"} for r in rows]
    content = {"numbers": numbers, "records": kept}
    (out / "axis_results.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return text


def _heldout(rows: list[dict]) -> tuple[float, float]:
    """Median and 90 % of the error on held-out strokes, over sigma."""
    errors = [r["heldout_after"] for r in rows] or [np.nan]
    return float(np.median(errors)), float(np.quantile(errors, 0.9))


def _right(row: dict) -> bool:
    return len(row["effects"]) == 1 and alike(row["effects"][0], row["asked"])


def _share(count: int, total: int) -> str:
    if not total:
        return "-"
    low, high = wilson(count, total)
    return f"{count}/{total} ({100 * low:.0f} to {100 * high:.0f} %)"


def _counted(counts: Counter) -> str:
    return ", ".join(f"{name} ({n})" for name, n in counts.most_common())


def main(arguments: Sequence[str] | None = None) -> None:
    """See the module."""
    parser = argparse.ArgumentParser(prog="python -m fits.blind.axis_study", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=10, help="records of each kind and level")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="seed to begin with")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args(arguments)
    (given.out / "loops").mkdir(parents=True, exist_ok=True)
    todo = [
        (request, given.out)
        for request in requests(given.count, given.first)
        if not (given.out / "loops" / f"{label(request)}.json").exists()
    ]
    context = multiprocessing.get_context("spawn")
    crew = {"initializer": one_thread, "maxtasksperchild": _RECORDS_PER_PROCESS}
    with context.Pool(given.workers, **crew) as pool:
        for k, line in enumerate(pool.imap_unordered(treat, todo), start=1):
            print(f"{k}/{len(todo)} {line}", flush=True)
    print(publish(given.out))


if __name__ == "__main__":
    main()
