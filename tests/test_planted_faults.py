"""The faults of `plant_faults.py` still find their place, and the script tells what it should."""

import ast
from pathlib import Path

import plant_faults
import pytest
from faults import FAULTS, Fault
from plant_faults import ROOT, altered, main


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_still_finds_its_place(fault):
    """Its text is in the package once, what comes of it is Python, and its guard is there."""
    text = (ROOT / "jaxfric" / fault.file).read_text(encoding="utf-8")
    made = altered(fault, text)
    assert made != text
    ast.parse(made)
    assert (ROOT / fault.guard.split()[0]).is_file()


def test_text_that_is_not_there_once_is_told():
    for old, count in (("x", 2), ("y", 0)):
        with pytest.raises(
            ValueError, match=rf"'n': the text to replace is {count} times in .*f.py"
        ):
            altered(Fault("n", "f.py", old, "z", "t.py"), "x x")


@pytest.mark.parametrize("caught", [True, False])
def test_a_fault_that_is_not_caught_is_told(monkeypatch, capsys, caught):
    """With tests that fail wherever the fault is, or never."""

    def run(folder: Path, *guards: str) -> str | None:
        assert guards == ("t.py", "-k", "k")
        there = "broken" in (folder / "jaxfric" / "errors.py").read_text(encoding="utf-8")
        return "t.py::test" if there and caught else None

    text = (ROOT / "jaxfric" / "errors.py").read_text(encoding="utf-8")
    fault = Fault("n", "errors.py", text, "broken", "t.py -k k")
    monkeypatch.setattr(plant_faults, "FAULTS", (fault,))
    monkeypatch.setattr(plant_faults, "first_failure", run)
    assert main([]) == (not caught)
    said = "caught by t.py::test" if caught else "NOT CAUGHT"
    assert f"errors.py: n | {said}" in capsys.readouterr().out
