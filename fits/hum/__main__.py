"""Run the loop on records with mains hum in their noise; see README.md."""

import argparse
import json
from collections import Counter

import jax

import jaxfric as jf

from .generator import drawn, record_of


def main() -> None:
    """Print a line for every record, and how many end how."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--number", type=int, default=30, help="how many records")
    parser.add_argument("--second", action="store_true", help="with a state that the base lacks")
    asked = parser.parse_args()
    ends: Counter[tuple[str, str]] = Counter()
    for seed in range(asked.first, asked.first + asked.number):
        p = drawn(seed, second=asked.second)
        loop = jf.close_loop(record_of(p, seed), stiffness=p.K, law=p.law)
        names = " + ".join(loop.effects) or "none"
        about = {
            "seed": seed,
            "law": p.law,
            "hum": p.hum,
            "share": p.share,
            "rows": sum(p.rows),
            "verdict": loop.verdict,
            "effects": names,
            "found": [round(one.frequency, 2) for one in loop.after.noise.hum],
            "seconds": round(loop.seconds, 1),
        }
        print(json.dumps(about), flush=True)
        ends[loop.verdict, names] += 1
    for (verdict, names), count in sorted(ends.items()):
        print(f"{count:3d}  {verdict}: {names}")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
