"""Tables on a terminal: no number is cut or broken, however narrow it is."""

import io
import re

import pytest
from rich.console import Console

from jaxfric.cli.common import stdout_console
from jaxfric.report.tables import TextTable, print_tables
from jaxfric.units import measured

HEAD = ("law", "A-B", "A", "B", "L [µm]", "misfit", "BIC above least", "held-out error [σ]", "")
TWO = ("slip, 2 states", "-0.003996(30)", "0.00694(87)", "-0.00108(81), 0.012011(88)")
TWO = (*TWO, "-, 15.02(17)", "1.83", "948", "14.82", "")
ROWS = [TWO, ("slip", "-0.0039952(75)", *[""] * 6, "did not converge")]


@pytest.mark.parametrize("width", [62, 80, 100, 120, 200])
def test_numbers_stay_whole(width: int) -> None:
    console = Console(file=io.StringIO(), width=width)
    print_tables(console, [TextTable("records", HEAD, ROWS, "note")])
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert max(map(len, lines)) <= width
    for row in ROWS:
        for cell in filter(None, row[1:-1]):
            assert any(cell in line for line in lines), cell
    assert sum("records" in line for line in lines) == 1
    assert sum("note" in line for line in lines) == 1


def test_columns_without_anything_take_no_room() -> None:
    console = Console(file=io.StringIO(), width=80)
    print_tables(console, [TextTable("", ("a", "b", ""), [("x", "1", ""), ("y", "2", "")])])
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert [line.split() for line in lines] == [[], ["a", "b"], ["x", "1"], ["y", "2"]]


def test_a_wide_terminal_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    for told, wide in (("200", 200), ("80", 120), ("", 120), ("many", 120)):
        monkeypatch.setenv("COLUMNS", told)
        assert stdout_console().width == wide


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.005923, 0.000294, "0.00592(29)"),
        (52.46, 9.96, "52(10)"),
        (52.46, 9.94, "52.5(99)"),
        (293.2, 117.4, "293(117)"),
        (293.2, 11.74, "293(12)"),
        (333648686.0, 36137588.0, "3.34(36)e8"),
        (-2.0e3, 4.04e4, "-0.2(40)e4"),
        (12345.0, 999.6, "1.23(10)e4"),
        (0.6, 0.0, "0.6"),
    ],
)
def test_an_error_in_brackets_is_in_units_of_the_last_digit(value, error, text) -> None:
    assert measured(value, error) == text
    found = re.fullmatch(r"(-?\d+)\.?(\d*)\((\d+)\)(?:e(\d+))?", text)
    if found:
        unit = 10.0 ** (int(found[4] or 0) - len(found[2]))
        assert int(found[3]) * unit == pytest.approx(error, rel=0.05)
        assert float(f"{found[1]}.{found[2]}e{found[4] or 0}") == pytest.approx(value, abs=unit)
