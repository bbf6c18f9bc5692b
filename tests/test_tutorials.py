"""The notebooks of fits/tutorials/ run, and print what is stored in them.

Cells run in this process, one after the other, as a kernel would run them. Numbers may differ by
what another processor rounds. The two that close a loop take minutes: `-m long`.
"""

import contextlib
import io
import json
import re
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import pytest

TUTORIALS = Path(__file__).parents[1] / "fits" / "tutorials"
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")
NAMES = ("axis", "press", "study")


def code(name: str) -> list[dict]:
    """The cells of code of a notebook."""
    cells = json.loads((TUTORIALS / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def stored(cell: dict) -> str:
    """What a cell printed when the notebook was made."""
    outputs = [out for out in cell["outputs"] if out.get("name") == "stdout"]
    return "".join("".join(out["text"]) for out in outputs)


def differing(found: str, expected: str, rtol: float = 2e-2) -> bool:
    """Whether two texts differ, but for the rounding of their numbers."""
    if NUMBER.sub("#", found) != NUMBER.sub("#", expected):
        return True
    pairs = zip(NUMBER.findall(found), NUMBER.findall(expected), strict=True)
    return any(abs(float(a) - float(b)) > rtol * abs(float(b)) for a, b in pairs)


def test_every_notebook_is_known():
    assert tuple(sorted(path.stem for path in TUTORIALS.glob("*.ipynb"))) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_are_stored_as_executed(name):
    cells = code(name)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    kinds = {out["output_type"] for cell in cells for out in cell["outputs"]}
    assert "error" not in kinds and "display_data" in kinds


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name == "study" else pytest.mark.long) for name in NAMES],
)
def test_a_notebook_prints_what_is_stored(name, monkeypatch):
    monkeypatch.chdir(TUTORIALS)
    matplotlib.use("Agg")
    names: dict = {}
    for cell in code(name):
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile("".join(cell["source"]), f"{name}.ipynb", "exec"), names)
        assert not differing(said.getvalue(), stored(cell)), said.getvalue()
    plt.close("all")


def test_what_differs_is_seen():
    assert not differing("a 1.0001 b", "a 1.0000 b")
    assert differing("a 1.1 b", "a 1.0 b")
    assert differing("c 1.0 b", "a 1.0 b")
    assert differing("a b", "a 1.0 b")
