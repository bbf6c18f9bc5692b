"""The counts of tests/house.py on texts whose counts are known, and their limits in the package."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import house
import pytest

ROOT = Path(__file__).parents[1]

LIMITS = {"lines": 64492, "long": 0, "wide": 14, "unannotated": 14, "any": 11, "twice": 0}
"""What the package may have of each at most; lowered as it gets less."""

TEN_LINES = "\n".join(f"    x = {k}" for k in range(10))
SIXTY = "\n".join(f"    x = {k}" for k in range(60))


def number(counts, name):
    value = getattr(counts, name)
    return value if isinstance(value, int) else len(value)


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        ("a.py", "def f(x: int):\n" + TEN_LINES, {"lines": 11}),
        ("a.py", "def f():\n" + SIXTY, {"long": 1}),
        ("a.py", "def f():\n" + SIXTY.rsplit("\n", 1)[0], {"long": 0}),
        ("cli/f.py", "def f():\n" + SIXTY, {"long": 0}),
        ("cli/f.py", "def f():\n" + SIXTY + "\n    x = 60", {"long": 1}),
        ("a.py", "def f(a, b, c, d, e, f, *, g, h=1): ...", {"wide": 1, "unannotated": 8}),
        ("cli/f.py", "def f(a, b, c, d, e, f, *, g, h=1): ...", {"wide": 0, "unannotated": 8}),
        ("a.py", "class A:\n    def f(self, a, b, c, d, e, f, g): ...", {"wide": 0}),
        ("a.py", "def f(*a, **b): ...", {"unannotated": 2}),
        ("a.py", "def f(*a: int, **b: int): ...", {"unannotated": 0}),
        ("a.py", "from typing import Any\nx: Any = 1\ny: list[Any]", {"any": 2}),
        ("a.py", "class A: ...\nclass B:\n    class A: ...", {"twice": 1}),
        ("a.py", "class A: ...\nclass B: ...", {"twice": 0}),
    ],
)
def test_counts_of_known_texts(file, text, expected):
    found = house.count({file: text})
    assert {name: number(found, name) for name in expected} == expected


def test_the_package_keeps_its_limits():
    found = house.count(house.read())
    over = {n: number(found, n) for n, most in LIMITS.items() if number(found, n) > most}
    assert not over, f"more than {LIMITS}; `python tests/house.py --places` says where"


@pytest.mark.parametrize(
    "file", sorted((ROOT / "tests" / "benchmarks").glob("*.py")), ids=lambda f: f.stem
)
def test_a_benchmark_finds_what_it_measures(file, monkeypatch):
    """Benchmarks are run by hand: a name that they import and that is gone shows here."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(ROOT), str(file.parent)])
    spec = importlib.util.spec_from_file_location(f"benchmark_{file.stem}", file)
    spec.loader.exec_module(importlib.util.module_from_spec(spec))


def test_nothing_else_is_kept_at_the_top():
    """What a command leaves here is easily added with the rest."""
    known = {"pyproject.toml", "jaxfric", "tests", "fits", "data", "README.md", "LICENSE"}
    told = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if told.returncode:
        pytest.skip("not a checkout")
    top = {name.split("/", 1)[0] for name in told.stdout.splitlines()}
    assert {name for name in top - known if not name.startswith(".")} == set()
    large = [name for name in told.stdout.splitlines() if (ROOT / name).stat().st_size > 3e6]
    assert large == []
