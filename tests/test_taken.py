"""Which parameters of the base an effect takes for its own, by tables of made-up fits."""

import math

import pytest

from jaxfric.fitting import Estimate
from jaxfric.loop.close import moves_far
from jaxfric.loop.gates import taken
from jaxfric.loop.refusal import Move
from jaxfric.report.verdict_text import words_of_moves


def estimate(value, std, *, determined=True):
    return Estimate(value, std, value - 2 * std, value + 2 * std, "1", determined=determined)


def names(moves):
    return tuple(move.name for move in moves)


def both(name, before, after):
    return {name: estimate(*before), "f0": estimate(0.6, 1e-4)}, {
        name: estimate(*after), "f0": estimate(-0.6, 1.0)
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "before", "after", "is_taken"),
    [
        ("B", (1.8e-3, 2e-5), (1.5e-3, 4e-5), False),
        ("B", (1.8e-3, 2e-5), (-1.4e-3, 7e-4), True),  # heat with an evolution that weakens
        ("B", (-1.8e-3, 2e-5), (1.4e-3, 2e-4), True),
        ("B", (-1.8e-3, 2e-5), (-1.4e-3, 2e-4), False),  # clays have such a B
        ("B", (7e-5, 2e-5), (-1.4e-3, 7e-4), False),  # it was not known before
        ("A", (1.8e-3, 2e-5), (1.8e-3, 1e-3), True),  # lost in its error
        ("A", (1.8e-3, 2e-5), (1.8e-3, 8e-4), False),
        ("L", (2e-5, 1e-6), (2e-6, 1e-7), False),  # a second length may be the longer one
        ("M", (14.5, 0.1), (3.1, 0.2), True),
        ("M", (14.5, 0.1), (4.6, 0.2), False),
        ("F_c", (11.2, 0.3), (1.4, 7.2), True),
        ("F_c", (-0.3, 0.01), (0.1, 0.2), False),  # there was none to take
        ("F_v", (200.0, 3.0), (10.0, 90.0), False),  # a curve of velocity stands for it
        ("F_v", (200.0, 3.0), (-90.0, 30.0), True),
        ("F_0", (5.0, 0.1), (-5.0, 0.1), False),  # an offset has no sign
    ],
)
def test_what_is_taken_of_a_base(name, before, after, is_taken):
    pair = both(name, before, after)
    assert names(taken(*pair)) == ((name,) if is_taken else ())


def test_what_is_not_determined_is_lost():
    before, after = both("A", (1.8e-3, 2e-5), (1.8e-3, 2e-5))
    for lost in (estimate(1.8e-3, 2e-5, determined=False), estimate(1.8e-3, math.inf)):
        found = taken(before, after | {"A": lost})
        assert names(found) == ("A",) and "undetermined" in words_of_moves(found)
    assert taken(before | {"A": estimate(1e-3, 1e-5, determined=False)}, after) == ()


def test_a_weight_may_take_the_mass_that_stood_for_it():
    pair = both("M", (96.0, 0.5), (14.5, 0.1))
    assert names(taken(*pair)) == ("M",)
    assert taken(*pair, of_place=True) == () == taken(*both("A", (1, 0.1), (1, 0.1)), of_place=True)
    assert names(taken(*both("B", (2.0, 0.1), (-2.0, 0.1)), of_place=True)) == ("B",)


@pytest.mark.parametrize(("after", "said"), [(-1.1e-3, False), (1.6e-3, True), (-0.8e-3, True)])
def test_a_headline_parameter_that_moves_by_many_of_its_errors(after, said):
    assert moves_far(Move("A-B", estimate(-1.11e-3, 5e-5), estimate(after, 1e-3))) is said
