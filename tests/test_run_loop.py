"""The loop over a run: windows as one motion, levels, and whole steps held out."""

from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from command import assert_refused, run
from public_data import public_record

import jaxfric as jf
from jaxfric.errors import InputError
from jaxfric.fitting.problem import Model, ProblemSizes, make_problem
from jaxfric.fitting.stiffness import MachineStiffness
from jaxfric.laws.registry import rate_state
from jaxfric.loop import run as run_module
from jaxfric.loop.location import _log_steps
from jaxfric.loop.run import RunDetails, _in_stretches, _levels, _thinned, asked_twice
from jaxfric.loop.split import split_again, split_units
from jaxfric.motion import PiecewiseVelocity
from jaxfric.plain import plain
from jaxfric.rig import QuasiStatic, Rig
from jaxfric.rig.friction import LogarithmicEffect
from jaxfric.rig.normal_stress import stress_of_levels
from jaxfric.runs.events import Event
from jaxfric.runs.fits import decided_events
from jaxfric.runs.joined import join
from jaxfric.simulation import simulate

UM = 1e-6
TRUE = {"f0": 0.6, "A": 0.01, "B": 0.013, "L": 10 * UM, "V0": 1 * UM}
K = 2000.0


def step(time, before, after, start, stop, *, fitted=True, stress=None, kind="step"):
    return Event(kind, time, before, after, start, stop, 0.01, stress, fitted=fitted)


def record(end=1000.0, dt=0.5, *, position=None, friction=None, stress=None):
    t = np.arange(0.0, end, dt)
    return jf.from_arrays(
        t + 7.0,
        0.6 + 1e-3 * np.sin(t) if friction is None else friction(t),
        load_point_displacement=t * UM if position is None else position(t),
        normal_stress=None if stress is None else stress(t),
    )


def two_stretches(**more):
    """Two steps that touch, something else from 300 to 700 s, a third step."""
    places = np.array([0, 300, 100, 450, 750]) * UM
    events = [
        step(100.0, 1 * UM, 3 * UM, 50.0, 200.0, stress=more.get("first")),
        step(200.0, 3 * UM, 1 * UM, 150.0, 300.0, stress=more.get("first")),
        step(400.0, 1 * UM, -1 * UM, 300.0, 500.0, fitted=False, kind="unload"),
        step(800.0, 2 * UM, 6 * UM, 700.0, 900.0, stress=more.get("second")),
    ]
    position = partial(np.interp, xp=[0, 300, 500, 700, 1000], fp=places)
    return join(record(position=position), events)


def test_windows_that_touch_are_one_stretch():
    joined = two_stretches()
    assert [(s.start, s.stop) for s in joined.stretches] == [(50.0, 300.0), (700.0, 900.0)]
    assert [p.velocity / UM for p in joined.phases] == pytest.approx([1, 3, 1, 2, 6])
    assert [p.unit for p in joined.phases] == [-1, 0, 1, -1, 2]
    assert [p.stretch for p in joined.phases] == [0, 0, 0, 1, 1]
    rows = joined.rows.time - 7.0
    assert rows.min() == 50.0 and not np.any((rows >= 300) & (rows < 700)) and rows.max() < 900
    assert np.array_equal(np.unique(joined.phase), np.arange(5))
    assert np.all(np.abs(rows - 100)[(joined.phase == 0) & (rows > 60)] <= 40)


def test_slip_goes_on_as_in_the_run():
    """From 300 um the encoder was at the second stretch's begin 150 um further, and the joined
    motion goes at least the typical way of a phase: 300 um here, of 300, 100 and 600."""
    joined = two_stretches()
    steps = joined.steps()
    begin, first = joined.begins[0], joined.phases[3].joined
    assert begin == pytest.approx(250.0)  # 50 to 300 s
    assert (first - begin) * 2 * UM == pytest.approx(300 * UM)
    assert steps.displacement(np.array([first]))[0] == pytest.approx((50 + 300 + 100 + 300) * UM)
    far = lambda t: np.interp(t, [0, 300, 700, 1000], np.array([0, 300, 1300, 2000]) * UM)  # noqa: E731
    events = [
        step(100.0, 1 * UM, 3 * UM, 50.0, 300.0),
        step(800.0, 2 * UM, 6 * UM, 700.0, 900.0),
    ]
    joined = join(record(position=far), events)
    assert (joined.phases[2].joined - joined.begins[0]) * 2 * UM == pytest.approx(1000 * UM)


def test_a_hold_and_what_follows_is_one_unit():
    events = [
        step(100.0, 1 * UM, 3 * UM, 50.0, 200.0),
        step(200.0, 3 * UM, 0.0, 100.0, 300.0, fitted=False, kind="hold"),
        step(300.0, 0.0, 3 * UM, 200.0, 400.0, fitted=False, kind="reload"),
        step(400.0, 3 * UM, 1 * UM, 350.0, 600.0),
    ]
    joined = join(record(), events)
    assert len(joined.stretches) == 1
    assert [(p.velocity / UM, p.unit) for p in joined.phases] == [
        (1, -1), (3, 0), (0, 1), (3, 1), (1, 2),
    ]  # fmt: skip
    assert [p.time for p in joined.phases] == [50.0, 100.0, 200.0, 300.0, 400.0]
    text = "0 s: 1 um/s, 50 s: 3 um/s, 150 s: 0 um/s, 250 s: 3 um/s, 350 s: 1 um/s"
    assert joined.steps().text() == text


def unsteady(time=300.0, stop=500.0, before=3 * UM, after=1 * UM):
    """What is called a reload, for its friction is not steady before it."""
    return step(time, before, after, 200.0, stop, fitted=False, kind="reload")


@pytest.mark.parametrize(
    ("between", "units", "stretches"),
    [
        ([unsteady()], [-1, 0, 1, 2], 1),
        ([unsteady(time=310.0)], [-1, 0, -1, 1], 2),  # something else is between
        ([unsteady(before=0.0)], [-1, 0, -1, 1], 2),
        ([unsteady(before=-1 * UM)], [-1, 0, -1, 1], 2),
        ([unsteady(stop=304.0)], [-1, 0, -1, 1], 2),  # eight rows
        ([step(300.0, 3 * UM, 1 * UM, 200.0, 500.0, fitted=False)], [-1, 0, -1, 1], 2),
    ],
)
def test_what_follows_before_friction_is_steady_is_in_the_motion(between, units, stretches):
    events = [
        step(100.0, 1 * UM, 3 * UM, 50.0, 300.0),
        *between,
        step(500.0, 1 * UM, 6 * UM, 400.0, 600.0),
    ]
    joined = join(record(), events)
    assert [p.unit for p in joined.phases] == units and len(joined.stretches) == stretches
    alone = join(record(), [unsteady(), step(500.0, 1 * UM, 6 * UM, 400.0, 600.0)])
    assert [p.unit for p in alone.phases] == [-1, 0]  # nothing says how it began
    late = record(stress=lambda t: 5e6 * (1 + 0.1 * (t > 400)))
    assert len(join(late, events).stretches) == 2


def test_a_hold_under_a_changing_stress_is_left_out():
    events = [
        step(100.0, 1 * UM, 3 * UM, 50.0, 200.0),
        step(200.0, 3 * UM, 0.0, 100.0, 300.0, fitted=False, kind="hold"),
        step(300.0, 0.0, 3 * UM, 200.0, 400.0, fitted=False, kind="reload"),
    ]
    moving = record(stress=lambda t: 5e6 * (1 + 0.1 * (t > 250)))
    assert {p.unit for p in join(moving, events).phases} == {-1, 0}
    constant = record(stress=lambda t: np.full_like(t, 5e6))
    assert {p.unit for p in join(constant, events).phases} == {-1, 0, 1}


def test_what_cannot_be_joined_is_told():
    with pytest.raises(InputError, match="no velocity step to fit among 1 events"):
        join(record(), [step(100.0, 1 * UM, 3 * UM, 50.0, 200.0, fitted=False)])
    with pytest.raises(InputError, match="moves backwards in a window"):
        join(record(), [step(100.0, -1 * UM, -3 * UM, 50.0, 200.0)])


def alone(velocities, times, t, stiffness):
    """Friction of the slider that begins in steady sliding; times from 0."""
    law = rate_state("slip", TRUE, 1, direct=LogarithmicEffect())
    motion = PiecewiseVelocity(np.asarray(times), np.asarray(velocities)).padded(4)
    rig = Rig(QuasiStatic(jnp.asarray(stiffness)), law)
    found = simulated(rig, motion, np.pad(t, (0, 600 - len(t)), "edge"))
    return np.asarray(found.recorded)[: len(t)]


@eqx.filter_jit
def simulated(rig, motion, ts):
    return simulate(rig, motion, ts, rtol=1e-8)


def problem_of(joined, levels=0):
    steps = joined.steps(fine=True)
    made = make_problem(
        joined.record.time,
        joined.record.friction,
        steps,
        ProblemSizes(TRUE["V0"], K, 1e-3, 0.01),
        Model(levels=levels),
    )
    return replace(_in_stretches(made, joined), rtol=1e-8)


@pytest.mark.parametrize("pressed", [1.0, 1.3])
def test_a_stretch_is_predicted_as_if_it_were_alone(pressed):
    """What was before it has been forgotten; the stiffness is that of its normal stress."""
    joined = two_stretches(first=5e6, second=5e6 * pressed)
    problem = problem_of(joined, levels=1)
    values = np.array([TRUE[n] for n in ("f0", "A", "B", "L")] + [0.02])
    predicted, _, ok = problem.predict(problem.coordinates.to_free(jnp.asarray(values)))
    assert bool(ok)
    t, predicted = joined.record.time, np.asarray(predicted)[: len(joined.record)]
    later = joined.stretch == 1
    begin = joined.phases[3].joined
    expected = alone([2 * UM, 6 * UM], [0, 100.0], t[later] - begin, K / pressed)
    assert np.abs(predicted[later] - 0.02 - expected).max() < 2e-6
    expected = alone([1 * UM, 3 * UM, 1 * UM], [0, 50.0, 150.0], t[~later], K)
    assert np.abs(predicted[~later] - expected).max() < 2e-6


def test_noise_over_rows_is_forgotten_between_two_stretches():
    """The rows that are left out count, at the pace of those that follow: every half second."""
    joined = two_stretches()
    n, time = len(joined.record), joined.record.time
    clock = np.asarray(problem_of(joined).clock)[:, 2]
    [begin] = np.flatnonzero(np.diff(joined.stretch)) + 1
    between = (time[begin] - time[begin - 1]) / 0.5
    assert between > 50
    expected = np.arange(n) + np.where(np.arange(n) >= begin, between - 1, 0.0)
    np.testing.assert_allclose(clock[:n], expected, rtol=1e-9)
    assert (clock[n:] == clock[n - 1]).all()


def test_one_normal_stress_is_none():
    assert two_stretches(first=5e6, second=5.02e6).stress() is None
    assert two_stretches(first=5e6).stress() is None
    assert two_stretches(first=5e6, second=6e6).stress() is not None


def test_the_stress_goes_from_level_to_level():
    stress = stress_of_levels(
        np.array([10.0, 50.0]), np.array([12.0, 54.0]), np.array([1, 1.4, 0.8])
    )
    at = lambda t: float(stress.padded(8).ratio(jnp.asarray(t)))  # noqa: E731
    assert [at(t) for t in (0.0, 9.9, 12.0, 40.0, 54.0, 1e3)] == pytest.approx(
        [1, 1, 1.4, 1.4, 0.8, 0.8]
    )
    assert at(11.0) == pytest.approx(1.2) and at(52.0) == pytest.approx(1.1)
    assert at(10.5) == pytest.approx(1 + 0.4 * (3 * 0.25**2 - 2 * 0.25**3))


def test_levels_are_those_of_the_ends_of_phases():
    """f = f0 + level + c ln V at the end of every phase, whatever happens before."""
    offsets, c, joined = np.array([0.0, 0.013]), -0.004, two_stretches()
    friction = np.full(len(joined.record), np.nan)
    for k, phase in enumerate(joined.phases):
        rows = np.flatnonzero(joined.phase == k)
        friction[rows] = 0.6 + offsets[phase.stretch] + c * np.log(phase.velocity)
        friction[rows[: int(0.75 * len(rows))]] += 0.05
    joined = replace(joined, record=replace(joined.record, friction=friction))
    assert _levels(joined, np.ones(len(friction), bool)) == pytest.approx(offsets, abs=1e-12)
    wrong = joined.phase == 4  # held out: not looked at
    joined.record.friction[wrong] += 1.0
    assert _levels(joined, ~wrong) == pytest.approx(offsets, abs=1e-12)


UNITS = [
    # velocities of the phases [um/s], their units; the phases that report, and that select
    ([1, 3, 10, 3, 1], [-1, 0, 1, 2, 3], {3}, {1}),
    ([1, 3, 10, 3, 1, 3, 10], [-1, 0, 1, 2, 3, 4, 5], {6}, {5}),
    ([1, 3, 0, 3, 10, 1, 3], [-1, 0, 1, 1, 2, 3, 4], {6}, {1}),
    ([1, 3, 10, 1, 10, 3, 1], [-1, 0, 1, -1, 2, 3, 4], {5}, {4}),
]


@pytest.mark.parametrize("velocities, units, report, select", UNITS)
def test_whole_units_are_held_out(velocities, units, report, select):
    """The last within the velocities that train: the first at the fastest and the slowest do."""
    phase = np.repeat(np.arange(len(units)), 30)
    time = np.arange(float(len(phase)))
    blocks = split_units(time, phase, np.array(units), np.array(velocities) * UM, "run")
    assert set(phase[blocks.report]) == report
    assert set(phase[blocks.select]) == select
    assert np.array_equal(blocks.train, ~(blocks.select | blocks.report))
    assert np.array_equal(blocks.step, phase) and blocks.by_step


@pytest.mark.parametrize("lasts, trains", [([30, 300], 3), ([300, 30], 1), ([30, 30], 1)])
def test_the_longest_hold_trains(lasts, trains):
    """It alone: another one may be held out."""
    units = np.array([-1, 0, 1, 1, 2, 3, 3])
    velocities = np.array([1, 10, 0, 3, 1, 0, 3]) * UM
    phase = np.repeat(np.arange(7), 30)
    spans = np.array([30.0, 30, lasts[0], 30, 30, lasts[1], 30])
    time = np.concatenate([[0.0], np.cumsum(spans[phase[1:]] / 30)])
    blocks = split_units(time, phase, units, velocities, "run")
    of = units[phase]
    assert blocks.train[of == trains].all() and not blocks.train[of == 4 - trains].any()


@pytest.mark.parametrize(("gap", "trains"), [(300, 3), (3, 1)])
def test_a_hold_without_rows_lasts_as_long_as_the_rows_are_apart(gap, trains):
    """As of p655, whose script leaves one row of a hold, and means over rows none."""
    units = np.array([-1, 0, 1, 1, 2, 3, 3])
    velocities = np.array([1, 10, 0, 3, 1, 0, 3]) * UM
    phase = np.repeat([0, 1, 2, 3, 4, 6], 30)
    time = np.arange(180.0) + np.where(phase == 6, gap, 0.0)
    blocks = split_units(time, phase, units, velocities, "run")
    of = units[phase]
    assert blocks.train[of == trains].all() and not blocks.train[of == 4 - trains].any()


def test_the_blocks_of_the_run_p655():
    """Its hold, of which no row is left, trains; whole steps are held out."""
    whole = jf.read(public_record("p655intact100l"), reduce=public_record("p655_r"))
    stiffness = MachineStiffness.parse("0.16 MPa/um", whole.friction_unit)
    joined, _ = _thinned(join(*decided_events(whole, None, stiffness)), 6000)
    blocks = split_units(*run_module._units(joined), "run")
    used = np.unique(joined.phase)
    (hold,) = (k for k, p in enumerate(joined.phases) if p.velocity == 0 and k not in used)
    of = np.array([p.unit for p in joined.phases])[joined.phase]
    assert blocks.train[of == joined.phases[hold].unit].all()
    assert len({*of[blocks.select]}) == len({*of[blocks.report]}) == 1


def held(blocks, phase, units):
    of = np.array(units)[phase]
    return set(of[blocks.select].tolist()), set(of[blocks.report].tolist())


def test_another_split_holds_out_others():
    """What was held out trains, and the ends in velocity still do; where two are left."""
    velocities = np.array([3, 1, 3, 10, 3, 5, 3, 5, 3]) * UM
    units = np.arange(9) - 1
    phase = np.repeat(np.arange(9), 30)
    given = np.arange(270.0), phase, units, velocities
    first = split_units(*given, "run")
    assert held(first, phase, units) == ({6}, {7})
    second = split_again(*given, first)
    assert held(second, phase, units) == ({4}, {5})
    assert np.array_equal(second.train, ~(second.select | second.report))
    few = np.arange(150.0), phase[:150], units[:5], velocities[:5]
    assert split_again(*few, split_units(*few, "run")) is None
    short = np.repeat(np.arange(9), [30, 30, 30, 30, 30, 9, 30, 30, 30])
    given = np.arange(float(len(short))), short, units, velocities
    assert split_again(*given, split_units(*given, "run")) is None  # too few rows select


@dataclass(frozen=True)
class _Told:
    verdict: str
    effects: tuple[str, ...]
    fall: float = 30.0
    size: float = 0.9
    left: float = 1e-6
    reasons: tuple[str, ...] = ("structure is left",)
    before: float = 1.0
    warnings: tuple[str, ...] = ("one",)
    seconds: float = 1.0

    @property
    def after(self):
        return SimpleNamespace(size=self.size, tests={"slip": self.left, "time": 1.0})

    def gain(self):
        return self.fall

    def test_error(self, error):
        return error if error == self.before else error.size


TWO_REASONS = ("structure is left", "the held-out error is 2 sigma")


TURNS = [
    # what the first and the second search tell, and which of them counts
    (("effects", ("a",)), None, 0),
    (("outside_catalogue", ("a",)), ("effects", ("b",)), 1),
    (("outside_catalogue", ("a",)), ("effects", ("a",)), 0),  # what the same leaves, it leaves
    # 2 sqrt(.001 .026) = .0102, with .024 .0098
    (("outside_catalogue", ("a",), 30.0, 0.9, 1e-3), ("effects", ("a",), 30.0, 0.9, 0.026), 1),
    (("outside_catalogue", ("a",), 30.0, 0.9, 1e-3), ("effects", ("a",), 30.0, 0.9, 0.024), 0),
    (("outside_catalogue", ("a",), 30.0, 0.9, 1e-3), ("effects", ("a",), 19.0, 0.9, 0.5), 0),
    (("outside_catalogue", ("a",), 30.0, 0.9, 1e-3), ("effects", ("a",), 30.0, 1.0, 0.5), 0),
    (
        ("outside_catalogue", ("a",), 30.0, 0.9, 1e-3, TWO_REASONS),
        ("effects", ("a",), 30.0, 0.9, 0.5),
        0,
    ),
    (("outside_catalogue", ("a",), 30.0, 0.9, 0.02), ("effects", ("a",), 30.0, 0.9, 0.5), 0),
    (
        ("outside_catalogue", ("a",), 30.0, 0.9, 1e-3),
        ("outside_catalogue", ("a",), 30.0, 0.9, 0.5),
        0,
    ),
    (("outside_catalogue", ("a",)), ("ambiguous", ("a", "b")), 1),
    (("outside_catalogue", ("a", "b")), ("effects", ("b", "a")), 0),  # in whatever order
    (("ambiguous", ("a",)), None, 0),
    (("no_missing_effect", ()), ("effects", ("b",)), 1),
    (("too_weak", ()), ("ambiguous", ("b",)), 1),
    (("outside_catalogue", ()), ("effects", ("b",), 20.1), 1),
    (("too_weak", ()), ("effects", ("b",), 19.9), 0),  # asked twice: twice the evidence
    (("too_weak", ()), ("effects", ("b",), 30.0, 1.0), 0),  # nothing is gained in rows held out
    (("too_weak", ()), ("outside_catalogue", ("b",)), 0),
    (("no_missing_effect", ()), ("too_weak", ()), 0),
]


@pytest.mark.parametrize("first, second, counts", TURNS)
def test_a_run_is_asked_twice_only_where_no_name_is_confirmed(first, second, counts):
    told = [_Told(*one) for one in (first, second) if one]
    left = list(told)

    def search(blocks):
        return left.pop(0)

    found = asked_twice(search, "blocks", lambda: "others", progress=lambda text: None)
    expected = told[counts]
    assert (found.verdict, found.effects) == (expected.verdict, expected.effects) and not left
    assert ("others are held out" in found.warnings[-1]) == (counts == 1)
    why = "a model with a is not confirmed (structure is left)" if first[1] else "no effect"
    assert (why in found.warnings[-1]) == (counts == 1)
    same = counts == 1 and first[1] == second[1]
    assert ("noise alone leaves as much in both together: p = 0.01" in found.warnings[-1]) == same
    left[:] = told[:1]
    assert asked_twice(search, "blocks", lambda: None, progress=print) == told[0]


@pytest.mark.parametrize(
    "end, told",
    [
        (KeyboardInterrupt(), "held out, was interrupted: this is the first"),
        (ValueError("no"), "held out, ended in an error (ValueError: no): this is the first"),
    ],
)
def test_what_ends_in_a_second_search_loses_no_first(end, told):
    first, turns = _Told("too_weak", ()), iter((None, end))

    def search(blocks):
        if (ends := next(turns)) is not None:
            raise ends
        return first

    given = {"again": lambda: "others", "progress": lambda text: None}
    try:
        found = asked_twice(search, "blocks", **given)
    except KeyboardInterrupt:  # pytest would end with it
        pytest.fail("the first is lost")
    assert found.verdict == "too_weak" and found.warnings[0] == "one"
    assert found.warnings[1].endswith(told)
    turns = iter((end,))  # of the first search nothing is there
    with pytest.raises(type(end)):
        asked_twice(search, "blocks", **given)


def test_two_units_are_too_few():
    def divided(phase, units, velocities):
        return split_units(
            np.arange(len(phase)), phase, np.array(units), np.array(velocities) * UM, "run"
        )

    with pytest.raises(InputError, match=r"2 steps and holds can be fitted; .* needs 3"):
        divided(np.repeat([0, 1, 2], 30), [-1, 0, 1], [1, 3, 1])
    with pytest.raises(InputError, match="its select block would have 9 rows"):
        divided(np.repeat(np.arange(5), [30, 9, 30, 30, 30]), [-1, 0, 1, 2, 3], [1, 3, 10, 3, 1])


def test_a_hold_has_a_log_step():
    found = _log_steps(np.array([1.0, 10.0, 0.0, 10.0]))
    assert found == pytest.approx([0, np.log(10), -np.log(10) - 3, np.log(10) + 3])
    assert _log_steps(np.array([0.0, 2.0]))[1] == pytest.approx(3.0)


def test_means_reach_over_no_phase():
    joined = two_stretches()
    few, said = _thinned(joined, 300)
    assert not said and len(few.record) == len(few.rows) == len(few.phase)
    assert 200 < len(few.record) <= 301
    for k in range(5):
        mine, all_ = few.record.time[few.phase == k], joined.record.time[joined.phase == k]
        assert all_.min() <= mine.min() and mine.max() <= all_.max()
    t = few.rows.time - 7.0 - few.record.time
    offsets = [t[few.stretch == s] for s in (0, 1)]
    assert all(np.ptp(o) < 1e-9 for o in offsets)
    assert _thinned(joined, 10_000)[0] is joined


def test_the_stretches_of_a_run_in_the_file():
    joined = two_stretches(first=5e6, second=6e6)
    stretches = plain(RunDetails(joined).to_json())["stretches"]
    assert stretches[1] == {
        "start": 700.0,
        "stop": 900.0,
        "normal_stress": 6e6,
    }


def test_steps_are_not_stated_of_a_run(tmp_path):
    file = tmp_path / "mine.csv"
    file.write_text("time [s],load_point_displacement [um],friction [1]\n0,0,.6\n")
    for more in (["--run"], ["--events", "events.toml"]):
        outcome = run("loop", file, "--stiffness", "1e-3/um", "--steps", "0 s: 1 um/s", *more)
        assert_refused(outcome, "--steps gives the steps of a record")
