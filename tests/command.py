"""Running the command inside the test's process, and a small record to give it."""

import contextlib
import io
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxfric.cli import app as cli

STIFFNESS = ("--stiffness", "5e-3/um")
"""The stiffness that goes with `record_text`."""

STEPS = ("--steps", "0 s: 2 um/s, 20 s: 10 um/s")
"""The velocity steps of `record_text`. Given steps are exact, which compiles the least."""


class Outcome(NamedTuple):
    """What a command came to: exit code, stdout, stderr."""

    code: int
    out: str
    err: str


def run(*arguments: object) -> Outcome:
    """`jaxfric ARGUMENTS`, without a process of its own."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli._run([str(argument) for argument in arguments])
    return Outcome(code, out.getvalue(), without_beats(err.getvalue()))


def without_beats(err: str) -> str:
    """What was said on stderr but for the lines that break the silence of long work, which come
    where a machine is slow: "jaxfric: 15 s: searching"."""
    return re.sub(r"(?m)^jaxfric: \d+ s: .*\n", "", err)


def assert_refused(outcome: Outcome, *words: str) -> None:
    """Exit code 2, nothing on stdout, and one line on stderr that has all of `words`."""
    code, out, err = outcome
    assert code == 2, f"exit code {code}: {err}"
    assert out == ""
    assert err.startswith("jaxfric: error: ")
    assert err.endswith("\n")
    assert err.count("\n") == 1, err
    assert "Traceback" not in err and "internal error" not in err, err
    missing = [word for word in words if word not in err]
    assert not missing, f"{missing} not in: {err}"


def record_cells(rows: int = 91) -> list[list[str]]:
    """Header and cells of a record of one step, 2 to 10 um/s after 20 s of 45 s.

    Friction is a sketch of the answer of the slip law, f0 = 0.6, with noise of 2e-4.
    """
    random = np.random.default_rng(1)
    time = np.linspace(0, 45, rows)
    after = np.maximum(time - 20, 0)
    load = 2 * time + 8 * after + random.normal(0, 0.02, rows)
    answer = np.where(after > 0, -0.006 + 0.016 * np.exp(-after / 2), 0.0)
    friction = 0.6 + answer * (1 - np.exp(-after / 0.2)) + random.normal(0, 2e-4, rows)
    cells = [
        [f"{t:.4f}", f"{x:.4f}", f"{f:.6f}"] for t, x, f in zip(time, load, friction, strict=True)
    ]
    return [["time [s]", "load_point_displacement [um]", "friction [1]"], *cells]


def record_text(rows: int = 91) -> str:
    """The cells of `record_cells` as CSV."""
    return "\n".join(",".join(row) for row in record_cells(rows)) + "\n"


def written(path: Path, content: str | bytes) -> Path:
    """`path`, with `content` in it."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path
