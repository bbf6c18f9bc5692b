"""Plants faults in copies of the package and tells which test notices each: an alarm's fire drill.

    python tests/plant_faults.py              # all of them, ten minutes on two cores
    python tests/plant_faults.py verdict      # those with the word in their name or file

Every fault replaces a piece of text, which must be there exactly once, and runs the tests that
guard it; those tests also run on the package as it is, and must pass. Exit status 1 where a fault
is not caught. The table of faults is `faults.py`.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from faults import FAULTS, Fault

ROOT = Path(__file__).parents[1]
FOLDERS = ("jaxfric", "tests")


@contextmanager
def planted(fault: Fault | None) -> Iterator[Path]:
    """A copy of package and tests, with the fault in it."""
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        for folder in FOLDERS:
            shutil.copytree(ROOT / folder, copy / folder)
        shutil.copy(ROOT / "pyproject.toml", copy)
        for folder in ("fits", "data"):  # records and their generators, which stay as they are
            (copy / folder).symlink_to(ROOT / folder)
        kept = ROOT / ".pytest_cache" / "jax"  # what is compiled need not be compiled again
        if kept.is_dir():
            (copy / ".pytest_cache").mkdir()
            (copy / ".pytest_cache" / "jax").symlink_to(kept)
        if fault is not None:
            file = copy / "jaxfric" / fault.file
            file.write_text(altered(fault, file.read_text(encoding="utf-8")), encoding="utf-8")
        yield copy


def altered(fault: Fault, text: str) -> str:
    """The text with the fault in it.

    Raises
    ------
    ValueError : the text to be replaced is not there exactly once.
    """
    found = text.count(fault.old)
    if found != 1:
        raise ValueError(
            f"fault '{fault.name}': the text to replace is {found} times in jaxfric/{fault.file},"
            f" not once; give it the new one in tests/faults.py:\n{fault.old}"
        )
    return text.replace(fault.old, fault.new)


def first_failure(folder: Path, *guards: str) -> str | None:
    """The first test that fails in a copy; None where all pass.

    Raises
    ------
    RuntimeError : the tests could not run, or ran another copy of the package.
    """
    where = "import jaxfric.errors as found; print(found.__file__)"
    done = subprocess.run([sys.executable, "-c", where], cwd=folder, capture_output=True, text=True)
    if not Path(done.stdout.strip() or "/").resolve().is_relative_to(folder.resolve()):
        raise RuntimeError(f"the copy in {folder} is not what is imported: {done.stderr[-2000:]}")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", *guards]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    failed = re.search(r"^(?:FAILED|ERROR) (\S+::.+?)(?: - |$)", done.stdout, re.MULTILINE)
    if done.returncode not in (0, 1) or (done.returncode == 1) != bool(failed):
        raise RuntimeError(f"{' '.join(command)} did not run:\n{done.stdout[-2000:]}{done.stderr}")
    return failed[1] if failed else None


def main(words: list[str]) -> int:
    """Plant the faults whose name or file has one of the words; all without words."""
    chosen = [f for f in FAULTS if not words or any(w in f"{f.name} {f.file}" for w in words)]
    for guard in sorted({f.guard for f in chosen}):
        with planted(None) as copy:
            failed = first_failure(copy, *guard.split())
        print(f"as it is: {guard}: {f'FAILS in {failed}' if failed else 'passes'}", flush=True)
        if failed:
            return 1
    missed = 0
    for fault in chosen:
        with planted(fault) as copy:
            failed = first_failure(copy, *fault.guard.split())
        missed += failed is None
        caught = "NOT CAUGHT" if failed is None else f"caught by {failed}"
        print(f"{fault.file}: {fault.name} | {caught}", flush=True)
    print(f"{len(chosen) - missed} of {len(chosen)} faults caught")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
