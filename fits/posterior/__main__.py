"""Is the posterior right? `python -m fits.posterior [--records 400]`.

Calibration: ranks of the true A, B and L in the posteriors of records whose parameters are drawn
from the priors. Bound: standard deviations on a clean step of 2000 rows. Records that are in
results.json are not computed again; `--again` forgets them.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from . import bound, calibration
from .generate import NAMES

FILE = Path(__file__).parent / "results.json"
_EVERY, _PART = 10, 200


def load() -> dict:
    """What is known, or nothing."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.is_file() else {"records": []}


def save(known: dict) -> None:
    """Write at once or not at all."""
    part = FILE.with_suffix(".part")
    records = ",\n".join(json.dumps(one) for one in known["records"])
    rest = [f'"{k}": {json.dumps(v, indent=1)}' for k, v in known.items() if k != "records"]
    text = "{\n" + ",\n".join([*rest, f'"records": [\n{records}\n]']) + "\n}\n"
    part.write_text(text, encoding="utf-8")
    part.replace(FILE)


def calibrate(known: dict, number: int) -> None:
    """Compute the records that are missing."""
    done = {one["seed"] for one in known["records"]}
    left = [seed for seed in range(number) if seed not in done]
    for k, seed in enumerate(left):
        begun = time.perf_counter()
        known["records"].append(calibration.one(seed))
        known["records"][-1]["seconds"] = time.perf_counter() - begun
        if (k + 1) % _EVERY == 0 or seed == left[-1]:
            save(known)
            print(f"{k + 1} of {len(left)} records", flush=True)


def told(known: dict, number: int) -> list[str]:
    """The numbers in lines."""
    records = [one for one in known["records"] if one["seed"] < number]
    good = [one for one in records if "ranks" in one]
    lines = [
        f"{len(records)} records of {calibration.ROWS} rows,"
        f" {len(records) - len(good)} fits failed,"
        f" {sum(one['refused'] for one in records)} draws ran away,"
        f" {sum(one['diverging'] for one in good)} divergent transitions,"
        f" {np.sum([one['seconds'] for one in records]):.0f} s"
    ]
    for name in (*NAMES, "A_minus_B"):
        p = calibration.uniform([one["ranks"][name] for one in good])
        parts = [
            [o["ranks"][name] for o in good if o["seed"] // _PART == k]
            for k in range(number // _PART)
        ]
        each = ", ".join(f"{calibration.uniform(ranks):.3f}" for ranks in parts)
        ratio = np.array([one["laplace_std"][name] / one["nuts_std"][name] for one in good])
        low, high = np.percentile(ratio, [5, 95])
        lines.append(
            f"{name:10s} ranks uniform: p = {p:.3f} (by {_PART} records: {each});"
            f" Laplace/NUTS sd: median {np.median(ratio):.3f}, 5 to 95 % {low:.3f} to {high:.3f}"
        )
    at = known["bound"]
    for name in (*NAMES, "A_minus_B"):
        lines.append(
            f"{name:10s} sd over the Cramer-Rao bound:"
            f" Laplace {at['laplace_over_bound'][name]:.3f}, NUTS {at['nuts_over_bound'][name]:.3f}"
        )
    first, second = at["seconds"]
    lines.append(
        f"noise {at['sigma_over_true']:.3f} of the true one; R-hat {at['rhat']:.4f}, ESS"
        f" {at['ess']:.0f}; 4 x 1000 draws in {first:.0f} s with compiling, {second:.0f} s without"
    )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=400)
    parser.add_argument("--again", action="store_true")
    options = parser.parse_args()
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxfric.cache import cache_compiled

    cache_compiled()
    known = {"records": []} if options.again else load()
    if "bound" not in known:
        known["bound"] = bound.measured()
        save(known)
    calibrate(known, options.records)
    print("\n".join(told(known, options.records)))


if __name__ == "__main__":
    main()
