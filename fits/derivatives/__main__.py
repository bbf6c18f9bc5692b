"""Derivatives against differences, a line a function: `python -m fits.derivatives [WORD ...]`.

Prints the worst errors of first derivatives, |J - D|_i/(|D_i| + 1e-3 max|D|), and of second ones,
|H - F|_ij/(sqrt|F_ii F_jj| + 1e-3 max|F|), over the scalars and points of an entry, and which
scalar has the latter. D and F are central differences of values and of first derivatives.
WORD leaves out entries without it in their names. Exits with code 1 where an error is too large.
"""

import sys
import time

import jax
import numpy as np

from .entries import ENTRIES
from .measure import FIRST, SECOND, Derivatives


def main(words: list[str]) -> int:
    """A line for each entry; the number of those that are wrong."""
    jax.config.update("jax_enable_x64", True)
    wrong = 0
    print(f"{'function':40} {'first':>8} {'second':>8}  worst scalar")
    for name, entry in ENTRIES.items():
        if words and not any(word in name for word in words):
            continue
        begun = time.perf_counter()
        found = Derivatives(entry)
        first, second = (np.nanmax(e) for e in (found.first_error(), found.second_error()))
        worst = found.names[np.nanargmax(found.second_error()) % len(found.names)]
        took = time.perf_counter() - begun
        print(f"{name:40} {first:8.1e} {second:8.1e}  {worst} ({took:.1f} s)", flush=True)
        wrong += not (first <= FIRST and second <= SECOND)
    return wrong


if __name__ == "__main__":
    sys.exit(bool(main(sys.argv[1:])))
