"""What is each piece of the loop worth? `python -m fits.ablation --out DIR [--workers 2]`.

Closes the loop on blind records of seeds of their own, then once more without each piece of
`pieces`, and prints the table of `table`. A run that was stopped goes on where it was. Pieces of
noise, fit and speed are taken out on every third record: they need fits of their own.

Files: DIR/records and DIR/truth as of `fits.blind`, DIR/found/NAME.json with one row a piece.
"""

import argparse
import importlib
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from fits.blind.cores import one_thread

_RECORDS_PER_PROCESS = 12


def treat(job: tuple[int, Path, tuple[str, ...]]) -> tuple[str, bool]:
    """One record with all its loops: a line about it, and whether it did not fail."""
    from .loops import weigh

    place, out, only = job
    begun, whole = time.monotonic(), True
    try:
        said = weigh(place, out, only)
    except Exception as failure:
        said, whole = f"FAILED {type(failure).__name__}: {failure}".splitlines()[0], False
    return f"{time.monotonic() - begun:6.1f} s  {said}", whole


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m fits.ablation", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", action="append", default=[], help="a piece, or a group of them")
    parser.add_argument("--records", type=int, help="only the first so many")
    parser.add_argument("--table", action="store_true", help="print the table of what is there")
    asked = parser.parse_args(arguments)
    from .records import blind

    failed = 0
    if not asked.table:
        places = range(len(blind()))[: asked.records]
        jobs = [(place, asked.out, tuple(asked.only)) for place in places]
        context = multiprocessing.get_context("spawn")
        with context.Pool(asked.workers, one_thread, maxtasksperchild=_RECORDS_PER_PROCESS) as pool:
            for done, (said, whole) in enumerate(pool.imap_unordered(treat, jobs), start=1):
                print(f"{done:4}/{len(jobs)} {said}", flush=True)
                failed += not whole
    from .table import published

    print(published(asked.out))
    if failed:
        sys.exit(f"{failed} of {len(jobs)} records failed")


def write(path: Path, content: dict) -> None:
    """All of a file or nothing of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(
        json.dumps(content, indent=1, default=lambda number: number.item()) + "\n", encoding="utf-8"
    )
    os.replace(part, path)


if __name__ == "__main__":
    importlib.import_module("fits.ablation.__main__").main()
