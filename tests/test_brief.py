"""The answer of a loop in a few lines: numbers with errors, against the decimal module."""

from decimal import Decimal

import numpy as np
import pytest

from jaxfric.units import measured


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (-0.011008, 1.3e-5, "-0.011008(13)"),
        (0.00903, 4.1e-5, "0.00903(4)"),
        (247.89, 90.2, "250(90)"),
        (19.35, 10.78, "19(11)"),
        (1234.0, 160.0, "1230(160)"),
        (2.983, 0.0201, "2.98(2)"),
        (2.983, 0.0195, "2.983(20)"),
        (0.005, 0.0, "0.005"),
        (0.12345678, float("nan"), "0.1235"),
    ],
)
def test_a_value_with_its_error(value, std, text):
    assert measured(value, std, short=True) == text


def test_the_digits_are_those_of_the_error():
    """Both numbers, read again: the error to a quarter of itself, the value to half an error."""
    rng = np.random.default_rng(0)
    for value, std in zip(rng.normal(0, 100, 500), 10 ** rng.uniform(-6, 2.9, 500), strict=True):
        shown, _, error = measured(value, std, short=True).partition("(")
        unit = Decimal(1).scaleb(int(Decimal(shown).as_tuple().exponent))
        read = Decimal(error.rstrip(")")) * unit
        assert abs(read - Decimal(std)) < Decimal(std) / 4
        assert abs(Decimal(shown) - Decimal(value)) < Decimal(std) / 2
