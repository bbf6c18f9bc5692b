"""Run the loop on one-step records of the ageing law; see README.md."""

import argparse
import json
from collections import Counter

import jax
import numpy as np

import jaxfric as jf

from .generator import drawn, record_of


def main() -> None:
    """Print a line for every record, and how many end how."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--number", type=int, default=40, help="how many records")
    asked = parser.parse_args()
    ends: Counter[tuple[str, str, str]] = Counter()
    for seed in range(asked.first, asked.first + asked.number):
        drawing = drawn(seed)
        loop = jf.close_loop(record_of(drawing, seed), stiffness=drawing["K"])
        rho = float(np.sqrt(max(loop.before.rms["train"] / loop.sigma, 1.0) ** 2 - 1))
        names = " + ".join(loop.effects) or "none"
        about = {"seed": seed, "verdict": loop.verdict, "effects": names, "rho": round(rho, 2)}
        print(json.dumps(about), flush=True)
        ends[loop.verdict, names, "rho >= 0.5" if rho >= 0.5 else "rho < 0.5"] += 1
    for (verdict, names, size), count in sorted(ends.items()):
        print(f"{count:3d}  {verdict}: {names}, {size}")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
