"""One velocity step of the pure ageing law: no other effect is confirmed in its place."""

import pytest

import jaxfric as jf
from fits.one_step.generator import drawn, record_of


def named(p, seed):
    loop = jf.close_loop(record_of(p, seed), stiffness=p["K"])
    return loop.verdict, loop.effects


def test_ageing_is_named_where_heat_would_need_an_evolution_that_weakens():
    """From the fit of a small part of it: the first-order start runs away."""
    p = {"A": 1.1e-3, "B": 1.6e-3, "L": 120e-6, "K": 50.0, "noise": 1e-4}
    assert named(p, 0) == ("effects", ("ageing",))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(40))
def test_no_other_name_is_confirmed(seed):
    verdict, effects = named(drawn(seed), seed)
    assert verdict != "effects" or effects == ("ageing",)
