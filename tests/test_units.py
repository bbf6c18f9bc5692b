"""Units at the edge: what is understood, what is refused, and in which words."""

import subprocess
import sys
from itertools import pairwise

import pint
import pytest

from jaxfric import units
from jaxfric.errors import InputError
from jaxfric.units import (
    between,
    factor,
    format_si,
    has_dimension,
    is_unit,
    parse_quantity,
    parse_values,
    prefixed,
    read_as,
    scale,
)


@pytest.mark.parametrize(
    ("text", "si_unit", "value"),
    [
        ("1.6e-3/um", "1/m", 1600.0),
        ("1.6e-3 um^-1", "1/m", 1600.0),
        ("1.6e-3 um-1", "1/m", 1600.0),
        ("2.289 um/s", "m/s", 2.289e-6),
        ("2.289um/s", "m/s", 2.289e-6),
        ("10 µm/s", "m/s", 1e-5),  # micro sign
        ("10 μm/s", "m/s", 1e-5),  # Greek mu
        ("5 microns/s", "m/s", 5e-6),
        ("5 micron/sec", "m/s", 5e-6),
        ("5 um s-1", "m/s", 5e-6),
        ("-3 mm/min", "m/s", -5e-5),
        ("99.9 MPa", "Pa", 99.9e6),
        ("12 kN", "N", 12e3),
        ("73.2 sec", "s", 73.2),
        ("0.6", "1", 0.6),
        ("0.6 -", "1", 0.6),
        ("5 %", "1", 0.05),
        ("10 N*s/m", "N*s/m", 10.0),
        ("0.05 N/A", "N/A", 0.05),  # newtons per ampere, not "not available"
        ("0.6 N/A", "1", 0.6),
        ("0.6 n/a", "1", 0.6),
        ("50 Hz", "Hz", 50.0),
        ("314.159265358979 rad/s", "Hz", 50.0),  # pint's radian is a pure number
        ("3000 rpm", "Hz", 50.0),
        ("50 1/s", "Hz", 50.0),
        ("50 turn/s", "Hz", 50.0),
        ("18000 deg/s", "Hz", 50.0),
        ("50 revolution/s", "Hz", 50.0),
        ("3000 1/min", "Hz", 50.0),
        ("0.05 kHz", "Hz", 50.0),
        ("3000 rpm", "rad/s", 314.159265358979),
        ("180 deg/s", "rad/s", 3.14159265358979),
        ("1 bar", "Pa", 1e5),
        ("3 psi", "Pa", 3 * 4.4482216152605 / 0.0254**2),  # pounds (force) per square inch
        ("2 kN/mm", "N/m", 2e6),
        ("4 N*s/mm", "N*s/m", 4e3),
        ("3 mm/hour", "m/s", 3e-3 / 3600),
        ("2.5 min", "s", 150.0),
        ("250 ms", "s", 0.25),
        ("250 g", "kg", 0.25),
        ("35.15 N/V", "N/V", 35.15),
        ("9.84 mN m", "N m", 9.84e-3),
        ("0.02 lbf", "N", 0.02 * 4.4482216152605),
    ],
)
def test_quantities(text: str, si_unit: str, value: float) -> None:
    assert parse_quantity(text, si_unit, "x") == pytest.approx(value, rel=1e-14)


def test_decimal_text_gives_the_nearest_number() -> None:
    assert parse_quantity("10 um/s", "m/s", "x") == 1e-5
    assert parse_quantity("2.289 um/s", "m/s", "x") == 2.289e-6


@pytest.mark.parametrize(
    ("text", "si_unit", "words"),
    [
        ("3", "m/s", ["V0", "has no unit", "m/s", "um/s"]),
        ("3 MPa", "m", ["V0", "not a unit of m"]),
        ("3 N", "1", ["V0", "not dimensionless"]),
        ("3 mpa", "Pa", ["not a known unit", "did you mean 'MPa'"]),
        ("3 umm", "m", ["did you mean 'um'"]),
        ("um", "m", ["has no number"]),
        ("", "m", ["has no number"]),
        ("nan m", "m", ["has no number"]),
        ("2,5 um", "m", ["V0", "decimal point"]),
        ("1e999 m", "m", ["too large"]),
        ("3 bits", "m", ["machine unit"]),
        ("3 um(", "m", ["not a known unit"]),
        ("3 degC", "m", ["not a known unit"]),
        ("3 __import__('os')", "m", ["not a known unit"]),
    ],
)
def test_refused(text: str, si_unit: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        parse_quantity(text, si_unit, "V0")
    message = str(caught.value)
    assert "\n" not in message
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("unit", "si_unit", "value"),
    [
        ("um", "m", 1e-6),
        ("microns", "m", 1e-6),
        ("0.0764 um", "m", 7.64e-8),
        ("", "1", 1.0),
        ("-", "1", 1.0),
        ("1", "1", 1.0),
        ("MPa", "Pa", 1e6),
        ("2 kN", "N", 2e3),
    ],
)
def test_factors(unit: str, si_unit: str, value: float) -> None:
    assert factor(unit, si_unit, "column") == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(("unit", "si_unit"), [("", "m"), ("bits", "1"), ("0 um", "m"), ("s", "m")])
def test_refused_factors(unit: str, si_unit: str) -> None:
    with pytest.raises(InputError, match="column"):
        factor(unit, si_unit, "column")
    assert not has_dimension(unit, si_unit)


@pytest.mark.parametrize(
    ("text", "si_unit", "values"),
    [
        ("5 um/s", "m/s", [5e-6]),
        ("5, 1, 2 um/s", "m/s", [1e-6, 2e-6, 5e-6]),
        ("1 um/s, 1 mm/s, 1 um/s", "m/s", [1e-6, 1e-3]),
        ("1..100 um/s", "m/s", [1e-6, 1e-5, 1e-4]),
        ("1 um/s..1e-2 m/s", "m/s", [1e-6, 1e-4, 1e-2]),
        ("2..8", "1", [2.0, 4.0, 8.0]),
    ],
)
def test_values(text: str, si_unit: str, values: list[float]) -> None:
    """One, a list, or a range of three: its middle is the geometric mean of its ends."""
    assert parse_values(text, si_unit, "x", count=3) == pytest.approx(values, rel=1e-13)


def test_a_range_holds_its_ends_exactly_and_as_many_values_as_asked() -> None:
    found = parse_values("0.1..7 kg", "kg", "x", count=8)
    assert (found[0], found[-1], len(found)) == (0.1, 7.0, 8)
    assert [b / a for a, b in pairwise(found)] == pytest.approx([70 ** (1 / 7)] * 7)


@pytest.mark.parametrize(
    ("text", "words"),
    [("5..1 kg", "range"), ("1..1 kg", "range"), ("1..2..3 kg", "not a value"),
     ("1,,2 kg", "not a value"), ("0 kg", "not positive"), ("-1..2 kg", "not positive")],
)  # fmt: skip
def test_values_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse_values(text, "kg", "mass")


@pytest.mark.parametrize(
    ("value", "size", "scaled"),
    # 10 * 1e-6 is not 1e-5 to the last digit; the others are no whole parts of 1
    [(10.0, 1e-6, 1e-5), (3.0, 0.3, 3.0 * 0.3), (3.0, 7.0, 21.0), (3.0, -0.5, -1.5)],
)
def test_scaled_to_the_last_digit(value: float, size: float, scaled: float) -> None:
    assert scale(value, size) == scaled


def test_what_is_a_unit() -> None:
    assert all(is_unit(text) for text in ("MPa", "um/s", "-", "1", "bits", "s"))
    assert not any(is_unit(text) for text in ("Friction", "Displ", "normal_stress"))


def test_shown_and_read_back() -> None:
    assert format_si(22.86e-6, "m/s", "um/s") == "22.86 um/s"
    assert format_si(0.25, "1", "1") == "0.25"
    assert format_si(1234.0, "s", "min", 3) == "20.6 min"
    assert format_si(5e6, "N/m", "kN/mm") == "5 kN/mm"
    assert parse_quantity(format_si(1600.0, "1/m", "1/um"), "1/m", "k") == pytest.approx(1600)


def test_an_unwritable_cache_is_no_obstacle() -> None:
    code = "from jaxfric.units import factor; print(factor('um', 'm', 'x'))"
    env = {"HOME": "/nonexistent", "XDG_CACHE_HOME": "/dev/null/none", "PATH": "/usr/bin"}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert done.stdout.strip() == "1e-06", done.stderr


def test_records_and_units_need_no_jax() -> None:
    code = (
        "import sys, jaxfric.records, jaxfric.units; print(*({'jax', 'pint'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout.split()) == (0, []), done.stderr


def test_a_range_whose_ends_read_the_same_is_one_number() -> None:
    assert between(0.001999, 0.0021, "s") == "0.002 to 0.0021 s"
    assert between(0.0019999, 0.0020001, "s") == "0.002 s"


def test_common_units_are_what_pint_says() -> None:
    registry = pint.UnitRegistry()
    for unit, (si_unit, size) in units._COMMON.items():
        wanted = (1.0 * registry.parse_expression(unit)).to(si_unit) if unit else 1.0
        assert float(getattr(wanted, "magnitude", wanted)) == pytest.approx(size, rel=1e-15)
        for other in units._COMMON_SI - {si_unit}:
            with pytest.raises(InputError, match="is not"):
                factor(unit, other, "x")


def test_common_units_do_not_load_pint() -> None:
    asked = "from jaxfric.units import factor; import sys; factor('um/s', 'm/s', 'x')"
    command = [sys.executable, "-c", f"{asked}; sys.exit('pint' in sys.modules)"]
    assert subprocess.run(command, check=False).returncode == 0


@pytest.mark.parametrize(
    ("typed", "read"),
    [
        ("2 um/s", "2 µm/s"),
        ("1.6e-3 1/um, 0.2 N/um", "1.6e-3 1/µm, 0.2 N/µm"),
        ("maximum 5 mm", "maximum 5 mm"),
        ("2 µm", "2 µm"),
    ],
)
def test_units_that_are_read_have_one_sign_for_micro(typed, read):
    assert read_as(typed) == read


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1757.0, "N/m", "1.757 kN/m"),
        (2e-6, "m", "2 µm"),
        (2000.0, "kg", "2000 kg"),
        (0.05, "kg m^2", "0.05 kg m^2"),
        (1340.0, "N*s/m", "1.34 kN s/m"),
        (-5e8, "N/m", "-500 MN/m"),
        (7200.0, "s", "7200 s"),
        (0.5, "%", "0.5 %"),
        (2500.0, "1/s", "2500 1/s"),
        (0.0125, "1", "0.0125"),
        (0, "s", "0 s"),
    ],
)
def test_a_prefix_makes_the_number_readable(value, unit, text):
    assert prefixed(value, unit) == text
