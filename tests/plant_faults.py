"""Plants faults in copies of the package and tells which test notices each: an alarm's fire drill.

    python tests/plant_faults.py              # all of them, a few minutes
    python tests/plant_faults.py verdict      # those with the word in their name or file

Every fault replaces a piece of text, which must be there exactly once, and runs the tests that
guard it; those tests also run on the package as it is, and must pass. Exit status 1 where a fault
is not caught. Where a change moves such a piece of text, give the fault the new one; where it takes
the matter away, take the fault away.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
FOLDERS = ("jaxfric", "tests")
VERDICT, SPLIT = "tests/test_verdict_tables.py", "tests/test_loop_parts.py -k two_steps"
FIT, GAINS, AXIS = (f"tests/test_{name}_tables.py" for name in ("fit", "gains", "axis"))


class Fault(NamedTuple):
    """What is altered, where, and which tests should notice."""

    name: str
    file: str
    """Below `jaxfric/`."""
    old: str
    new: str
    guard: str
    """Arguments of pytest."""


FAULTS = (
    Fault(
        "BIC without its penalty", "loop/engine.py",
        "parameters * np.log(effective)", "0 * parameters * np.log(effective)", VERDICT,
    ),
    Fault(
        "BIC counts correlated rows as independent", "loop/engine.py",
        "effective = min(max(effective, 2.0), float(self.weight.sum()))",
        "effective = float(self.weight.sum())", VERDICT,
    ),
    Fault(
        "any fall of BIC is enough", "loop/search.py",
        "current.bic - candidate.bic > ACCEPT,", "current.bic - candidate.bic > 0,", VERDICT,
    ),
    Fault("BIC need fall by 1 only", "loop/search.py", "ACCEPT = 10.0", "ACCEPT = 1.0", VERDICT),
    Fault(
        "what may be chance is taken", "loop/search.py",
        "if not why and one.p_value > _CHANCE:", "if False:", VERDICT,
    ),
    Fault(
        "what may be chance is fitted", "loop/search.py",
        "(s.delta_bic >= 0 and s.p_value <= _CHANCE)", "s.delta_bic >= 0", VERDICT,
    ),
    Fault(
        "the select block is not asked", "loop/search.py",
        'not candidate.rms["select"] <= limit', "False", VERDICT,
    ),
    Fault(
        "what the record does not fix is taken", "loop/search.py",
        "if not why and (loose := not_fixed(engine, candidate, scales)):\n            why",
        "if (loose := ()):\n            why", VERDICT,
    ),
    Fault(
        "effects are confirmed whatever is left", "loop/verdict.py",
        '        if reasons:\n            return "outside_catalogue"\n', "", VERDICT,
    ),
    Fault(
        "nothing is ever outside the catalogue", "loop/verdict.py",
        'return "outside_catalogue" if strong and not weak else "too_weak"', 'return "too_weak"',
        VERDICT,
    ),
    Fault(
        "nothing is ever too weak", "loop/verdict.py",
        'return "outside_catalogue" if strong and not weak else "too_weak"',
        'return "outside_catalogue"', VERDICT,
    ),
    Fault(
        "an effect that nearly explains it does not count", "loop/verdict.py",
        "_HINT < max(gains) <= ACCEPT", "False", VERDICT,
    ),
    Fault(
        "rivals are forgotten", "loop/verdict.py",
        'return "ambiguous" if rivals else "effects"', 'return "effects"', VERDICT,
    ),
    Fault(
        "the held-out error is that of the train block", "loop/verdict.py",
        "    rows = engine.blocks.select | engine.blocks.report\n    scale",
        "    rows = engine.blocks.train\n    scale", VERDICT,
    ),
    Fault(
        "the held-out error is not compared with the noise", "loop/verdict.py",
        "if not value <= most:", 'if name == "train" and not value <= most:', VERDICT,
    ),
    Fault("no edge of stability", "loop/verdict.py", "_EDGE = 1.1", "_EDGE = 0.0", VERDICT),
    Fault(
        "a base fit that runs away gets a verdict", "loop/verdict.py",
        "if base.failed or (edge", "if (edge", VERDICT,
    ),
    Fault(
        "structure is left out of the verdict", "loop/verdict.py",
        "if p < _SIGNIFICANT]", "if p < 0]", VERDICT,
    ),
    Fault(
        "the end of the first of two steps trains, its begin selects", "loop/split.py",
        "(_share(time, steps, 1) >= _QUARTER)", "(_share(time, steps, 1) < _QUARTER)", SPLIT,
    ),
    Fault(
        "of two steps the first reports", "loop/split.py",
        "report = segment == 2", "report = segment == 0", SPLIT,
    ),
    Fault(
        "a step time's variance is its weight", "fitting/uncertainty.py",
        "np.asarray(problem.hold) ** 4", "np.asarray(problem.hold) ** 2", FIT,
    ),
    Fault(
        "the noise of a fit is taken as white", "fitting/uncertainty.py",
        "return inverse @ middle @ inverse\n", "return inverse\n", FIT,
    ),
    Fault(
        "two decades determine a parameter", "fitting/uncertainty.py",
        "_HALF_DECADE = 0.5", "_HALF_DECADE = 1.0", FIT,
    ),
    Fault(
        "the certificate of gains finds nothing", "gains/solve.py",
        "return tried, (grid if len(grid) else None)", "return tried, None", GAINS,
    ),
    Fault(
        "the certificate of gains tells nothing", "gains/solve.py",
        "found = 0 if smaller is None else len(smaller)", "found = 0", GAINS,
    ),
    Fault(
        "the search ends where smaller gains were found", "gains/solve.py",
        "if smaller is None or rounds == _ROUNDS:", "if True:", GAINS,
    ),
    Fault(
        "the frontier is left at its coarse points", "gains/frontier.py",
        "low, high = np.where(good, low, middle), np.where(good, middle, high)", "pass", GAINS,
    ),
    Fault(
        "only the last basin counts", "gains/frontier.py",
        "norm[i] <= left and norm[i] < right", "norm[i] <= left and right == np.inf", GAINS,
    ),
    Fault(
        "multipliers of either sign", "gains/kkt.py",
        "if np.all(m >= 0) and rest", "if rest", GAINS,
    ),
    Fault(
        "multipliers of the other sign", "gains/kkt.py",
        "if np.all(m >= 0) and rest", "if np.all(m <= 0) and rest", GAINS,
    ),
    Fault(
        "a step that constraints pull inwards", "gains/kkt.py",
        "system[:2, 2:] = -g[rows].T", "system[:2, 2:] = g[rows].T", GAINS,
    ),
    Fault(
        "a bristle without damping", "axis/state.py",
        " + self.sigma_1 * bend", " + 0.0 * bend", AXIS,
    ),
    Fault(
        "lag and lead do not act on each other", "axis/prepare.py",
        "lag * (lead - late)", "-lag * late", AXIS,
    ),
)  # fmt: skip


@contextmanager
def planted(fault: Fault | None) -> Iterator[Path]:
    """A copy of package and tests, with the fault in it."""
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        for folder in FOLDERS:
            shutil.copytree(ROOT / folder, copy / folder)
        shutil.copy(ROOT / "pyproject.toml", copy)
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
            f" not once; give it the new one in tests/plant_faults.py:\n{fault.old}"
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
    failed = re.search(r"^FAILED (.+?)(?: - |$)", done.stdout, re.MULTILINE)
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
