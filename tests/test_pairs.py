"""NAME=VALUE texts: what is read, and what is refused."""

import pytest

from jaxfric.errors import InputError
from jaxfric.pairs import read_pairs


@pytest.mark.parametrize(
    ("given", "pairs"),
    [
        ("A=1 N, L = 1 mm,", [("A", "1 N"), ("L", "1 mm")]),
        ("", []),
        (["b=2", " a = x=y "], [("b", "2"), ("a", "x=y")]),
        (["friction=mu, dry [1]"], [("friction", "mu, dry [1]")]),  # a column's name has a comma
        ((), []),
    ],
)
def test_pairs_in_their_order(given, pairs) -> None:
    assert list(read_pairs(given, "parameters", "A=1").items()) == pairs


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("A", "parameters 'A' is not NAME=VALUE, as in A=1"),
        ("B=1, =2", "parameters '=2' is not NAME=VALUE"),
        ("A=", "parameters 'A=' is not NAME=VALUE"),
        ([""], "parameters '' is not NAME=VALUE"),
        ("A=1, B=2, A=1", "parameters: A is given twice"),
        (["A=1", "A=2"], "parameters: A is given twice"),
    ],
)
def test_what_is_no_pair_is_refused(given, words) -> None:
    with pytest.raises(InputError) as refused:
        read_pairs(given, "parameters", "A=1")
    assert words in str(refused.value)
    with pytest.raises(InputError, match="is not ROLE=NAME"):
        read_pairs(["A"], "column", "A=1", form="ROLE=NAME")
