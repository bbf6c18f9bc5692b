"""Axes whose motion is new only every so many rows: which they are, and what they are fitted as."""

import numpy as np
import pytest
from test_axis_reading import H, motion

from jaxfric.loop.axis.reading import read_rows
from jaxfric.loop.axis.rows import rough_fit
from jaxfric.records import axis_from_arrays
from jaxfric.records.held import columns_renewed, held_for

RNG = np.random.default_rng(5)
N = np.arange(6000)
COUNT = 1e-3


def counted(position):
    return np.round(position / COUNT) * COUNT


def sine(rows, size=1.0):
    return size * np.sin(2 * np.pi * rows / 2000)


@pytest.mark.parametrize(
    ("values", "rows"),
    [
        (sine(N // 15 * 15), 15),
        (counted(sine(N // 15 * 15)), 15),
        (sine(N // 2 * 2), 2),
        (sine(np.concatenate([N[: 5 * 300] // 5 * 5, N[: 4 * 300] // 4 * 4])), 4),
        # a slot may be written a row too long or too short
        (np.repeat(sine(15 * np.arange(390)), 15 + RNG.integers(-1, 2, 390)), 15),
        # every row has its own: a quick one, a slow one on its counts, one that stops
        (sine(N), 1),
        (counted(sine(N)), 1),
        (counted(sine(N, 0.05)), 1),
        (counted(0.15 * N * COUNT), 1),
        (np.where(N % 1000 < 500, counted(sine(N)), 0.0), 1),
        (counted(0.2 * N * COUNT + 0.3 * COUNT * RNG.standard_normal(len(N))), 1),
        # half slow and half quick: what is long as a rule is not so where it moves
        (counted(np.cumsum(np.where(N < 4400, 0.4, 4.0)) * COUNT), 1),
        (sine(N[:900] // 15 * 15), 1),  # too few to say
    ],
)
def test_for_how_many_rows_a_value_is_written(values, rows):
    assert held_for(values) == rows


def test_one_row_of_each_value_is_kept():
    """The force of a sample is written one row later; the command is new in every row."""
    slots = 400
    q, f = counted(sine(15 * np.arange(slots))), np.arange(slots) * 1.0
    q[100:103] = q[99]  # it rests for three samples
    late = np.concatenate([[-1.0], np.repeat(f, 15)])[:-1]
    time, command = np.arange(15 * slots) * H, np.arange(15.0 * slots)
    given = {"time": time, "position": np.repeat(q, 15), "motor_force": late}
    found, kept, note = columns_renewed({**given, "reference_position": command})
    assert "new every 15 rows (15 ms)" in note
    np.testing.assert_array_equal(kept, 15 * np.arange(slots))
    np.testing.assert_array_equal(found["position"], q)
    np.testing.assert_array_equal(found["motor_force"], f)
    np.testing.assert_allclose(found["time"], 15 * H * np.arange(slots))
    inner = slice(1, -1)
    np.testing.assert_allclose(found["reference_position"][inner], 15.0 * np.arange(slots)[inner])


def test_a_record_with_a_value_in_every_row_is_left_as_it_is():
    given = {"time": N * H, "position": counted(sine(N)), "motor_force": sine(N // 15 * 15)}
    found, kept, note = columns_renewed(given)
    assert kept is None and not note
    assert all(found[name] is given[name] for name in given)


def test_the_mass_of_an_axis_that_is_written_fifteen_times():
    """95 kg, 203 N s/m, 20 N, -3 N, read from a file of 1 kHz whose motion is new at 67 Hz."""
    _, q, v, a = (x[::3] for x in motion(90.0))
    t, v, a = np.arange(len(q)) * H, 3 * v, 9 * a  # three times as fast
    force = 95 * a + 203 * v + 20 * np.tanh(v / 1e-3) - 3
    force += 0.3 * np.random.default_rng(2).standard_normal(len(t))
    slot = np.arange(len(t)) // 15 * 15
    held = np.round(q[slot] / 1e-6) * 1e-6
    record = axis_from_arrays(t, np.roll(force[slot], 1), position=held)
    whole = record.provenance
    assert len(record) == len(t) / 15
    assert len(record) + sum(whole.dropped.values()) == whole.rows_read == len(t)
    reading = read_rows(record, preparation=None, width=None, held=False)
    rough = rough_fit(reading.prepared, reading.rows.used, reading.rows.width)
    np.testing.assert_allclose(rough.values, [95, 203, 20, -3], rtol=0.03)
