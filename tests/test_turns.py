"""Angles that are recorded within one turn go on where the recorder begins a turn anew."""

import numpy as np
import pytest

from jaxfric.records import axis_from_arrays, read_steady
from jaxfric.records.turns import in_turn_with, unwound

TURN = 2 * np.pi


def wrapped(angle, low):
    """Within [low, low + a turn)."""
    return np.mod(angle - low, TURN) + low


@pytest.mark.parametrize("low", [0.0, -np.pi, 1.0])
@pytest.mark.parametrize("speed", [0.01, 1.0, 30.0, 150.0], ids=str)
def test_a_wrapped_angle_is_that_of_the_motion_but_for_whole_turns(low, speed):
    """Up to a quarter of a turn a row: 150 rad/s every 10 ms."""
    t = np.arange(1000) * 1e-2
    angle = 0.3 + speed * t - 0.4 * speed * np.maximum(t - 6, 0) ** 1.5
    angle = 0.3 + (angle - 0.3) * min(1, 1.5 / 1e-2 / np.abs(np.gradient(angle, t)).max())
    found, jumps = unwound(wrapped(angle, low))
    turns = (found - angle) / TURN
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-9)
    assert jumps == np.count_nonzero(np.diff(np.floor((angle - low) / TURN)))


def test_at_the_edge_noise_goes_over_it_back_and_forth():
    rng = np.random.default_rng(0)
    angle = TURN + 0.01 * rng.standard_normal(200)
    found, jumps = unwound(wrapped(angle, 0.0))
    assert jumps > 50 and np.ptp(found) < 0.1


@pytest.mark.parametrize(
    "angle",
    [
        np.linspace(0, 6.2, 100),  # no jump
        np.linspace(0, 20, 100),  # counts turns
        np.where(np.arange(100) == 50, 0.0, np.linspace(3, 4, 100)),  # a wrong cell
        np.append(np.linspace(0, 12, 100), 6.0),  # set back, after more than a turn
        wrapped(2.5 * np.arange(100), 0.0),  # .4 of a turn a row: which way?
    ],
    ids=["within", "counted", "cell", "reset", "fast"],
)
def test_another_angle_is_left_as_it_is(angle):
    found, jumps = unwound(angle)
    assert jumps == 0 and found is angle


def test_a_reference_is_in_the_turn_of_the_position():
    """They wrap at the same angle, but not in the same row, and begin on either side of it."""
    t = np.arange(3000) * 1e-3
    reference = -0.01 + 2.0 * np.sin(3 * t)
    position = reference + 0.02
    angles = [unwound(wrapped(x, 0.0))[0] for x in (reference, position)]
    assert abs(np.median(angles[0] - angles[1])) > 6
    found = in_turn_with(*angles)
    np.testing.assert_allclose(found - angles[1], -0.02, atol=1e-9)


def test_a_record_tells_that_it_was_unwound():
    t = np.arange(600) * 1e-2
    angle = 3.0 * np.sin(2 * t) + 0.1
    force = np.sign(np.cos(2 * t)) + 0.01 * np.sin(99 * t)
    record = axis_from_arrays(
        t,
        force,
        position=wrapped(angle, 0.0),
        reference_position=wrapped(angle - 0.15, 0.0),
        coordinate="rotary",
    )
    assert np.ptp(record.position) == pytest.approx(np.ptp(angle))
    np.testing.assert_allclose(record.reference_position - record.position, -0.15, atol=1e-9)
    first, second = record.provenance.notes
    assert first.startswith(
        "the position is given within one turn: unwound where it jumps, 3 times"
    )
    assert second.startswith("the reference position")
    linear = axis_from_arrays(t, force, position=wrapped(angle, 0.0))
    assert not linear.provenance.notes and np.ptp(linear.position) < TURN


def test_runs_that_were_unwound_are_named(tmp_path):
    """Six runs at steady speeds; two of them go over the end of a turn."""
    t = np.arange(1000) * 1e-2
    rng = np.random.default_rng(0)
    for k, speed in enumerate([-0.5, -0.3, -0.1, 0.1, 0.3, 0.5]):
        force = 0.2 * np.sign(speed) + speed + 0.01 * rng.standard_normal(1000)
        angle = wrapped(3.0 + speed * t, 0.0)
        rows = np.column_stack([t, angle, force])
        head = "time [s],position [rad],motor_force [N m]"
        np.savetxt(tmp_path / f"{k}.csv", rows, delimiter=",", header=head, comments="")
    curve = read_steady(tmp_path)
    np.testing.assert_allclose(curve.speed, [-0.5, -0.3, -0.1, 0.1, 0.3, 0.5], rtol=1e-6)
    (told,) = (note for note in curve.provenance.notes if "turn" in note)
    assert told.endswith("unwound where it jumps, 1 time (0.csv, 5.csv)")
