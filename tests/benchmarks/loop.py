"""How long does it take to close the loop on a record of 3000 rows?

    python tests/benchmarks/loop.py [--record FILE --stiffness TEXT]

By default a blind record of 12 velocity steps with a second state hidden in it (SciPy,
`fits/blind/generate.py`), the whole catalogue offered. Prints: a fresh process with an empty
compilation cache, a fresh one with that cache filled, how many compiled functions it holds, and
records of that length, one after the other and then again, in a running process.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from fits.blind.generate import Request, make, write  # noqa: E402

SEED = 880_000
STIFFNESS = "stiffness [1/m]"


def command(record: Path, stiffness: str, cache: str, out: Path) -> float:
    """Wall seconds of `jaxfric loop`."""
    program = Path(sys.executable).with_name("jaxfric")
    environment = {**os.environ, "XDG_CACHE_HOME": cache}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # with which all is compiled from source
    begun = time.perf_counter()
    subprocess.run(
        [program, "loop", record, "--stiffness", stiffness, "--out", out],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )
    return time.perf_counter() - begun


def running(records: list[tuple[Path, str]], cache: str) -> None:
    """Wall seconds of `close_loop`, record after record in this process."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jaxfric
    from jaxfric.cli.xla import whole_loops

    whole_loops()  # as the command does
    jaxfric.cache_compiled(Path(cache) / "jaxfric" / "compiled")
    for path, stiffness in records:
        record = jaxfric.read(path)
        begun = time.perf_counter()
        loop = jaxfric.close_loop(record, stiffness=stiffness)
        spent = time.perf_counter() - begun
        print(
            f"in one process: {spent:6.1f} s for {len(record)} rows"
            f" ({loop.verdict}: {' '.join(loop.effects) or '-'})",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--record", type=Path, help="a record of your own")
    parser.add_argument("--stiffness", default="", help="that goes with it")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place, records = Path(folder), []
        if given.record:
            records = [(given.record, given.stiffness)] * 3
        for k, effect in enumerate(("second_state", "slip_trend", "viscous")):
            if given.record:
                break
            made = make(Request(SEED + k, (effect,), 1.0, sampling="uniform"))
            name = write(made, place)
            stiffness = f"{made.declared[STIFFNESS]!r}/m"
            records.append((place / "records" / name / "record.csv", stiffness))
        cache = str(place / "cache")
        for words in ("empty", "filled"):
            spent = command(*records[0], cache, place / "out")
            kept = len(list(Path(cache, "jaxfric", "compiled").glob("*-cache")))
            print(
                f"a process, {words} cache: {spent:6.1f} s, {kept} compiled functions", flush=True
            )
        running(2 * records, cache)


if __name__ == "__main__":
    main()
