"""The drill exchanges one piece of a made-up module, and tells what is caught, missed and gone."""

import ast

import drill
import pytest

MODULE = '''
LIMIT = 3.0

class Rig:
    def push(self, x):
        """Twice x."""
        if x > 0:
            self.count = 1
            return 2 * x  # far
        return 2 * x
'''
AGAIN = (
    MODULE.replace("Twice", "Double").replace("x > 0", "(x\n            > 0)").replace("far", "")
)
"""The same with other words and layout."""


@pytest.mark.parametrize(
    ("where", "old", "new", "lines"),
    [
        ("Rig.push", "x > 0", "x >= 0", {7: "        if x >= 0:"}),
        ("Rig.push", "2 * x", "3 * x", {9: "            return 3 * x"}),
        ("Rig.push#2", "2 * x", "3 * x", {10: "        return 3 * x"}),
        ("push", "self.count", "self.known", {8: "            self.known = 1"}),
        ("LIMIT", "3.0", "4.0", {2: "LIMIT = 4.0"}),
        ("push", "self.count = 1\nreturn 2 * x", "pass", {8: "            pass", 9: ""}),
    ],
)
@pytest.mark.parametrize("source", [MODULE, AGAIN])
def test_one_piece_is_exchanged_and_nothing_else(source, where, old, new, lines):
    expected = source.replace("(x\n            > 0)", "x > 0").split("\n")
    for number, line in lines.items():
        expected[number - 1] = line
    assert drill.mutated(source, where, old, new) == ast.unparse(ast.parse("\n".join(expected)))


@pytest.mark.parametrize(
    ("where", "old"),
    [("pull", "2 * x"), ("Rig.push#3", "2 * x"), ("LIMIT", "2 * x"), ("push", "x < 0")],
)
def test_a_piece_that_is_not_there_is_gone(where, old):
    assert drill.mutated(MODULE, where, old, "1") is None


def test_what_is_caught_missed_and_gone_is_counted(tmp_path, monkeypatch, capsys):
    """With tests of a made-up module: one looks at 1 and 5 only, one fails whatever is there."""

    def failures(sources: dict[str, str], *arguments: str) -> list[str]:
        there: dict = {}
        exec(sources["a.py"], there)
        works = there["above"](5) and not there["above"](1)
        asked = [name for name in arguments if name in ("looks", "broken")]
        return [name for name in asked if name == "broken" or not works]

    (tmp_path / "jaxfric").mkdir()
    (tmp_path / "jaxfric" / "a.py").write_text("def above(x):\n    return x > 3\n")
    monkeypatch.setattr(drill, "ROOT", tmp_path)
    monkeypatch.setattr(drill, "failures", failures)
    faults = [
        drill.Fault("a.py", "any", "above", "x > 3", "True", "a looks"),
        drill.Fault("a.py", "two", "above", "3", "2", "a looks"),
        drill.Fault("a.py", "odd", "above", "3", "0", "a broken"),
        drill.Fault("a.py", "other", "below", "3", "0", "a looks"),
        drill.Fault("b.py", "none", "above", "3", "0", "a looks"),
    ]
    assert drill.drill(faults) == 1
    told = capsys.readouterr().out
    assert "a.py: any | looks\n" in told and "b.py: none | gone\n" in told
    assert "1 caught of 3 planted, 2 gone\n" in told
    assert "missed: a.py: two\nmissed: a.py: odd (that test fails without" in told
    assert drill.drill(faults[:1]) == 0


def test_every_fault_can_be_planted():
    """One that is gone from the package tells nothing of its tests."""
    package = drill.ROOT / "jaxfric"
    gone = [
        fault.name
        for fault in drill.read()
        if drill.mutated((package / fault.file).read_text(), fault.where, fault.old, fault.new)
        is None
    ]
    assert gone == []
