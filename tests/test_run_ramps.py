"""The stiffness from ramps on which the slider sticks."""

import numpy as np
import pytest

import jaxfric as jf
from jaxfric.errors import InputError
from jaxfric.fitting.stiffness import MachineStiffness
from jaxfric.runs import Event
from jaxfric.runs.ramps import (
    Ramp,
    disagreement,
    find_ramps,
    ramp_stiffness,
    rows,
    stiffness_from_ramps,
    told,
)

V, SIGMA, K = 3e-6, 1e7, 1.5e-3 / 1e-6
"""Velocity [m/s], normal stress [Pa] and stiffness of friction [1/m] of the run below."""


def event(kind, time, before, after):
    return Event(kind, time, before, after, time, time)


EVENTS = [
    event("reload", 0.0, 0.0, V),
    event("unload", 400.0, V, -V),
    event("hold", 480.0, -V, 0.0),
    event("reload", 500.0, 0.0, V),
]


def run(*, bend=0.0, noise=1e-4, stress=True, jump=0.0):
    """A run with EVENTS: it slides at friction .6, is unloaded to .24, waits, is loaded again.

    `bend`: friction of the ramps that is not straight; `jump` of the normal stress on the way.
    """
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 800.0, 0.5)
    v = np.where(t < 400, V, np.where(t < 480, -V, np.where(t < 500, 0.0, V)))
    x = np.concatenate([[0.0], np.cumsum(v[:-1] * np.diff(t))])
    friction = np.minimum(K * x, 0.6)
    back = t >= 400
    friction[back] = np.minimum(0.6 + K * (x[back] - x[t < 400][-1] - V * 0.5), 0.6)
    friction += bend * (0.6 - friction) * (friction - 0.3) * back
    friction += noise * rng.standard_normal(len(t))
    sigma = SIGMA * (1 + jump * ((t > 440) & (t < 520)))
    return jf.from_arrays(
        t,
        friction,
        load_point_displacement=x + 2e-8 * rng.standard_normal(len(t)),
        normal_stress=sigma if stress else None,
    )


def test_a_reload_and_an_unload_tell_the_stiffness():
    found = find_ramps(run(), EVENTS)
    assert [ramp.kind for ramp in found] == ["unload", "reload"]  # the first loading is none
    for ramp in found:
        assert ramp.of_stress and ramp.normal_stress == pytest.approx(SIGMA)
        assert ramp.slope == pytest.approx(K * SIGMA, abs=4 * ramp.error)
        assert ramp.error < 0.01 * ramp.slope
    mean = ramp_stiffness(found)
    assert mean.value == pytest.approx(K * SIGMA, rel=2e-3) and mean.count == 2
    assert mean.machine().at(2 * SIGMA) == pytest.approx(K / 2, rel=2e-3)


def test_without_a_normal_stress_it_is_that_of_friction():
    found = find_ramps(run(stress=False), EVENTS)
    assert not found[0].of_stress and found[0].slope == pytest.approx(K, rel=5e-3)
    assert told(found)[0].startswith("stiffness from 2 ramps: ") and "1/um" in told(found)[0]


def test_a_ramp_ends_a_tenth_below_sliding():
    unload, reload = find_ramps(run(), EVENTS)
    assert unload.start - 400 == pytest.approx(0.06 / (K * V), abs=1.0)
    assert 800 > reload.stop > reload.start + (0.54 - 0.24) / (K * V) - 2


def s_shaped(slopes, noise, seed=1, before=0.6):
    """A run that slides at .6, stops, and is loaded again from .1 to .54 by parts of equal length
    with so many times the slope K; SIGMA everywhere."""
    rng = np.random.default_rng(seed)
    way = np.full(len(slopes), 0.44 / K / len(slopes))
    corners = np.concatenate([[0.0], np.cumsum(way)])
    friction = 0.1 + np.concatenate([[0.0], np.cumsum(K * way * np.array(slopes))])
    t = np.arange(0.0, 400.0, 0.25)
    x = V * np.where(t < 100, t, np.where(t < 120, 100, t - 20))
    since = x - V * 100
    f = np.where(t < 100, before, np.where(t < 120, 0.1, np.interp(since, corners, friction)))
    f = np.where(since > corners[-1], np.minimum(friction[-1] + K * (since - corners[-1]), 0.6), f)
    record = jf.from_arrays(
        t,
        f + noise * rng.standard_normal(len(t)),
        load_point_displacement=x,
        normal_stress=np.full(len(t), SIGMA),
    )
    return record, [event("hold", 100.0, V, 0.0), event("reload", 120.0, 0.0, V)]


S_SHAPE = np.array([0.7, 1.0, 1.3, 1.3, 1.0, 0.7])
"""Slopes of sixths whose halves have the same slope."""


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_an_s_is_not_straight_though_its_halves_are_alike(noise):
    [line] = find_ramps(*s_shaped(np.ones(6), noise))
    assert line.slope == pytest.approx(K * SIGMA, rel=0.01)
    [bent] = find_ramps(*s_shaped(S_SHAPE, noise))
    assert bent.slope is None and bent.why == "it is not straight"


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2])
def test_noise_does_not_bend_a_ramp(noise):
    """No more than one straight ramp in ten is refused for its noise, or cut."""
    found = [find_ramps(*s_shaped(np.ones(6), noise, seed=seed))[0] for seed in range(60)]
    whole = [ramp for ramp in found if ramp.slope and ramp.stop - ramp.start > 80]
    assert len(whole) >= 54
    off = [(ramp.slope / (K * SIGMA) - 1) / (ramp.error / ramp.slope) for ramp in whole]
    assert np.sqrt(np.mean(np.square(off))) < 2.0


def test_a_velocity_that_follows_on_another_is_no_ramp():
    """Whether it is called a step or a reload hangs on the stiffness, which a ramp is to tell."""
    record = run()
    kinds = []
    for kind in ("step", "reload"):
        faster = [*EVENTS, event(kind, 540.0, V, 2 * V)]
        kinds.append(find_ramps(record, faster))
    assert kinds[0] == kinds[1] and len(kinds[0]) == 2


def test_where_halves_differ_the_first_straight_part_counts():
    bent = find_ramps(run(bend=1.5), EVENTS)
    assert all(ramp.why == "it is not straight" or ramp.stop - ramp.start < 50 for ramp in bent)
    straight = find_ramps(run(), EVENTS)
    assert straight[0].stop - straight[0].start > 50


@pytest.mark.parametrize(
    ("change", "why"),
    [({"jump": 0.02}, "the normal stress is not constant"), ({"noise": 0.3}, "its slope is lost")],
)
def test_what_tells_no_stiffness(change, why):
    record = run(**change)
    found = find_ramps(record, EVENTS)
    assert any(why in ramp.why for ramp in found)
    if all(ramp.why for ramp in found):
        with pytest.raises(InputError, match=why):
            stiffness_from_ramps(record, EVENTS)


def test_a_run_without_ramps_is_refused():
    with pytest.raises(InputError, match=r"never moves back.*give the stiffness"):
        stiffness_from_ramps(run(), EVENTS[:1])
    with pytest.raises(InputError, match="never moves back"):
        stiffness_from_ramps(run(), [])


def ramp(slope, error):
    return Ramp("unload", 0.0, 1.0, SIGMA, True, slope, error)


def test_the_mean_has_the_scatter_of_its_ramps():
    alike = ramp_stiffness([ramp(1.0, 0.02), ramp(1.02, 0.02)])
    assert alike.value == pytest.approx(1.01) and alike.error == pytest.approx(0.02 / np.sqrt(2))
    apart = ramp_stiffness([ramp(1.0, 0.02), ramp(1.2, 0.02)])
    assert apart.error == pytest.approx(0.1)  # as far as either is from the mean
    sure = ramp_stiffness([ramp(1.0, 1e-9), ramp(1.1, 1e-7)])
    assert sure.value == pytest.approx(1.05)  # none is known so well that it outweighs the other
    assert ramp_stiffness([Ramp("unload", 0.0, 1.0, SIGMA, True, why="bent")]) is None


@pytest.mark.parametrize(
    ("given", "of_stress", "share"),
    [
        (1.05, True, None),
        (0.8, True, -0.2),
        (1.3, True, 0.3),
        (1.3 / SIGMA, False, 0.3),
        (1.05 / SIGMA, False, None),
    ],
)
def test_another_stiffness_than_that_of_the_ramps_is_told(given, of_stress, share):
    found = ramp_stiffness([ramp(1.0, 0.01)])
    doubt = disagreement(found, MachineStiffness(given, of_stress), SIGMA)
    assert (doubt is None) == (share is None)
    assert share is None or 'stiffness="ramps"' in doubt
    assert share is None or doubt.values["share"] == pytest.approx(share, abs=0.005)


def test_what_is_unsure_disagrees_with_nothing():
    vague = ramp_stiffness([ramp(1.0, 0.15)])
    assert disagreement(vague, MachineStiffness(1.3, True), SIGMA) is None
    assert disagreement(None, MachineStiffness(1.3, True), SIGMA) is None
    assert disagreement(vague, None, SIGMA) is None
    assert (
        disagreement(ramp_stiffness([ramp(1.0, 0.01)]), MachineStiffness(9.0, False), None) is None
    )


def test_a_row_for_every_ramp():
    assert told(()) == [] and "bent" in told([Ramp("unload", 0, 1, None, True, why="bent")])[0]
    table = rows(find_ramps(run(), EVENTS))
    assert [row["result"] for row in table] == ["straight"] * 2
    assert table[0]["stiffness [MPa/um]"] == pytest.approx(K * SIGMA / 1e12, rel=0.01)
    assert rows([Ramp("unload", 0.0, 1.0, None, True, why="bent")])[0]["result"] == "bent"
