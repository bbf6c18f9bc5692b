"""The Python blocks and the commands of README and of the documentation run as written.

That every command parses, and that its options take their values, is asked in `test_advice.py`.
Here those run that need nothing but `data/` and what the commands before them on a page wrote;
the ones that take minutes are left to `-m long`. Those that README has not are run without their
figures, which the tests of their verbs draw.
"""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from command import run
from pages import PAGES, ROOT, blocks_of

WITH_PYTHON = {"README", "gains", "python", "sharp", "study"}
"""Pages whose blocks of Python run below."""
SLOW = re.compile(r"jaxfric (axis|loop|protocol|study|gains --from) ")
USERS = re.compile(
    r"mine\.csv|other\.csv|long\.csv|DATA_EMPS\.mat|driveNo1|study\.toml|\.zarr|loop\.json|mine-fit"
)
"""Files that a user brings, or that a command of minutes writes."""
SCREEN = 20
"""Lines that a command prints, unless it is asked for details."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder that looks like the project to what runs in it, and keeps what was written."""
    folder = tmp_path_factory.mktemp("project")
    for name in ("data", "fits"):
        (folder / name).symlink_to(ROOT / name)
    return folder


def executed(name: str, most: int | None = None) -> dict:
    """What the blocks of a page, or the first `most`, leave behind, run one after the other."""
    (page,) = (page for page in PAGES if page.stem == name)
    names: dict = {}
    for block in blocks_of(page, "python")[:most]:
        exec(compile(block, page.name, "exec"), names)
    return names


def test_every_page_with_python_is_asked_for():
    assert {page.stem for page in PAGES if blocks_of(page, "python")} == WITH_PYTHON


@pytest.mark.parametrize("page", ["README", "python"])
def test_a_fit_and_a_slope(page, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    names = executed(page, 1 if page == "README" else None)
    first, second, *_ = capsys.readouterr().out.splitlines()
    L, std = map(float, first.split())
    assert abs(L - 20e-6) < 4 * std < 2e-6
    less, error = map(float, second.split())
    assert abs(less + 0.004) < 4 * error < 4e-4
    assert names["left"].shape == names["fit"].record.friction.shape
    if page == "python":
        assert names["gains"].kv > 0 and names["gains"].scenarios.laws.A.shape == (65,)
        assert np.isfinite(names["slope"]) and names["slope"] > 0
        assert names["Curvature"].id == "curvature"


@pytest.mark.long  # minutes of compiling
def test_the_rows_that_decide_the_gains(folder, monkeypatch):
    """A row is moved, and fit and gains are found again."""
    monkeypatch.chdir(folder)
    names = executed("README")
    rows, friction, gains = names["rows"], names["problem"].friction, names["gains"]
    row, step = int(np.argmax(np.abs(rows[0]))), 1e-3
    ends = [gains(friction.at[row].add(side * step)) for side in (1, -1)]
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), rows[:, row], rtol=1e-3)


def test_gains_on_the_curve(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    executed("gains")
    kp, kv, modulus = (float(word) for word in capsys.readouterr().out.split())
    # above the curve k_p = 1.5 k_cr(k_v) of (25), in the worse of the two scenarios
    worst = max(
        (3 - X) / 1e-3 * (2 * V**2 / (X * 1e-3) + 1) for V in (2e-3, 5e-3) for X in [1 + kv * V]
    )
    assert kp > 1.5 * worst
    # and where the loop (k_p + k_v s)/(m s^2 + s Z(s)) stays 0.5 from -1, which decides here
    s = 1j * np.geomspace(1e-3, 1e5, 400_001)
    nearest = []
    for V in (2e-3, 5e-3):
        Z = 1 / V - 3 / V * (V / 1e-3) / (s + V / 1e-3)
        nearest.append(np.min(np.abs(1 + (kp + kv * s) / (2 * s**2 + s * Z))))
    np.testing.assert_allclose(min(nearest), 0.5, rtol=1e-6)
    np.testing.assert_allclose(modulus, nearest[0], rtol=1e-6)


def test_a_study_of_a_function(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = executed("study")["found"].modulus
    X = 1 + 0.5 * found.V0  # (25) again
    k_cr = (3 - X) / 1e-3 * (2 * found.V0**2 / (X * 1e-3) + 1)
    np.testing.assert_array_equal(found > 0, found.k_p > k_cr)


def test_the_line_for_64_bits():
    assert "jax" in executed("sharp")


def commands(*, slow: bool) -> list[str]:
    """Commands that need nothing of a user, each once, in the order of the pages."""
    lines = [line for page in PAGES for line in blocks_of(page, "sh")]
    own = [x for x in lines if x.startswith("jaxfric ") and not USERS.search(x)]
    return [line for line in dict.fromkeys(own) if bool(SLOW.match(line)) == slow]


def shown_of(line: str) -> list[list[str]]:
    """The outputs that README and the pages show below a command, each by line."""
    block = rf"^{re.escape(line)}\n```\n\n```text\n(.*?)```"
    texts = (page.read_text(encoding="utf-8") for page in PAGES)
    found = (re.search(block, text, re.MULTILINE | re.DOTALL) for text in texts)
    return [one[1].splitlines() for one in found if one is not None]


def runs(line: str, folder: Path, monkeypatch) -> None:
    """The command ends with a result of one screen, which begins as the pages show it."""
    monkeypatch.chdir(folder)
    outcome = run(*shlex.split(line, comments=True)[1:])
    assert outcome.code == 0, outcome.err
    if "--json" not in line and "--details" not in line:
        assert len(outcome.out.splitlines()) <= SCREEN, outcome.out
    for block in shown_of(line):
        for shown, said in zip(block, outcome.out.splitlines(), strict=False):
            assert said.startswith(shown), said


def test_there_are_commands():
    assert commands(slow=False) and commands(slow=True)


@pytest.mark.parametrize("line", sorted(commands(slow=False), key=lambda x: "-fit/" in x))
def test_a_command(line, folder, monkeypatch):
    if line not in blocks_of(ROOT / "README.md", "sh"):
        monkeypatch.setattr("jaxfric.cli.folder.Folder.draw", lambda *_: [])
    runs(line, folder, monkeypatch)


@pytest.mark.long
@pytest.mark.parametrize("line", commands(slow=True))
def test_a_command_of_minutes(line, folder, monkeypatch):
    if "velocity_step-fit/" in line and not (folder / "velocity_step-fit").exists():
        made = (x for x in commands(slow=False) if x.startswith("jaxfric fit data/velocity_step."))
        runs(next(made), folder, monkeypatch)
    runs(line, folder, monkeypatch)


def test_pages_name_files_that_exist():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for path in re.findall(r"\b(?:data|fits|tests)/[\w./]+\w", text):
            assert (ROOT / path).exists(), f"{page.name}: {path}"
        for path in re.findall(r"\]\(((?:\.\./|\.ci/|fits/)[^)#\s]+)", text):
            assert (page.parent / path).exists(), f"{page.name}: {path}"
