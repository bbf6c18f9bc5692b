"""The thresholds of the step finder: for each a record on either side of it."""

import numpy as np
import pytest

from jaxfric.errors import InputError
from jaxfric.records import VelocitySteps, find_steps, from_arrays
from jaxfric.records.joints import BrokenLine
from jaxfric.records.steps import _without_creep, speeds_without_steps

UM = 1e-6
T = np.arange(0, 40, 0.1)
TWO = VelocitySteps(np.array([0, 20.0]), np.array([10, 10.0]) * UM)


def moved(before, after, scatter):
    """Displacement of two velocities [um/s], each for 20 s, with white noise of that size [um]."""
    steps = VelocitySteps(TWO.times, np.array([before, after]) * UM)
    return steps.displacement(T) + scatter * UM * np.random.default_rng(1).normal(size=len(T))


@pytest.mark.parametrize(
    ("before", "after", "seen"),
    [(10, 9.4, False), (10, 9.2, True), (9.4, 10, False), (9.2, 10, True), (10, -10, True),
     (-10, -9.4, False), (-10, -9.2, True), (10, 0, True)],
)  # fmt: skip
def test_a_step_changes_the_velocity_by_seven_per_cent_of_the_larger(before, after, seen):
    assert len(find_steps(T, moved(before, after, 1e-3))) == 1 + seen


@pytest.mark.parametrize(("scatter", "seen"), [(20 / 19, False), (20 / 33, True)])
def test_a_step_lifts_the_line_by_25_times_its_scatter(scatter, seen):
    """10 to 12 um/s, 20 s each: by 2 * 20 * 20/40 = 20 um."""
    assert len(find_steps(T, moved(10, 12, scatter))) == 1 + seen


@pytest.mark.parametrize(
    ("slow", "scatter", "still"),
    [
        (0.045, 0.5, True),  # moves by 0.9 in its 20 s: less than twice the scatter
        (0.055, 0.5, False),
        (-0.045, 0.5, True),
        (0.09, 3.0, True),
        (0.11, 3.0, False),  # more than a hundredth of the fastest
        (1e-8, 0.0, True),  # less than rounding leaves of the whole path, 400
        (3e-8, 0.0, False),
    ],
)
def test_what_hardly_moves_is_a_hold(slow, scatter, still):
    slopes, lengths = np.array([10, slow, 10]), np.full(3, 20.0)
    none = np.zeros(3)
    found = _without_creep(BrokenLine(none, slopes, none, none, np.full(3, scatter), lengths))
    np.testing.assert_array_equal(found, [10, 0 if still else slow, 10])


def changing(fastest, bump=0.0):
    """A speed that grows linearly from 1 um/s, and is `bump` larger for a twentieth of the time."""
    time = np.linspace(0, 400, 2001)
    speed = np.linspace(1, fastest, 2001) + bump * (np.abs(time - 210) < 10)
    path = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.2)])
    friction = np.full(2001, 0.6)
    return [
        from_arrays(time, friction, load_point_displacement=path * UM),
        from_arrays(time, friction, load_point_velocity=speed * UM),
    ]


ONE = VelocitySteps(np.zeros(1), np.array([UM]))


@pytest.mark.parametrize(
    ("fastest", "bump", "told"),
    # deciles of the speed: 1 + 0.12 x and 1 + 0.88 x where it grows by x; 1.43 and 1.59 times
    [(1.6, 0.0, None), (1.85, 0.0, "1.1 um/s to 1.75 um/s"), (1.0, 5.0, None)],
)
def test_several_speeds_are_those_that_differ_by_half(fastest, bump, told):
    for record in changing(fastest, bump):
        text = speeds_without_steps(record, ONE)
        assert (text is None) == (told is None) and (told is None or told in str(text))
        assert speeds_without_steps(record, TWO) is None  # its steps are known


@pytest.mark.parametrize(("end", "refused"), [(19.9, True), (20.0, True), (20.1, False)])
def test_a_last_velocity_needs_rows(end, refused):
    if not refused:
        return TWO.refuse_end(end)
    with pytest.raises(InputError, match="begins at 20 s, but the record ends at"):
        TWO.refuse_end(end)
