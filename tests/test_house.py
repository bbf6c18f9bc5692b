"""Benchmarks can be run, and nothing lies at the top that does not belong there."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


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
