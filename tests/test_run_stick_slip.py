"""Stick-slip of a run: its teeth, how friction rises in them, and what that tells."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxfric as jf
from fits.runs.saw import Slider, move
from jaxfric.fitting.stiffness import MachineStiffness
from jaxfric.records.teeth import find_spikes, turns
from jaxfric.runs import Event, find_events
from jaxfric.runs.cycles import (
    StickSlip,
    disagreement,
    doubt_of,
    drop_by_velocity,
    fit_stick_slip,
    law_rows,
    preferred,
    rows,
    to_json,
    told,
)
from jaxfric.runs.rise_fit import RiseFit, fit_rises
from jaxfric.runs.stick_slip import EDGES, MIDDLE, Rises, find_rises, is_stretch

pytestmark = pytest.mark.computes


# ---- teeth -----------------------------------------------------------------------------------

V, DROP, PERIOD, ROW = 1e-5, 0.03, 10.0, 0.1
"""Velocity [m/s], drop, time between drops and between rows [s] of straight teeth."""


def straight(count=8, *, row=ROW, off=(), noise=0.0, force=False):
    """A record of straight teeth that drop between two rows; teeth `off` are half as high."""
    t = np.arange(0.5 * row, count * PERIOD, row)
    number, share = np.divmod(t / PERIOD, 1.0)
    friction = 0.6 + DROP * (share - 0.5)
    friction -= 0.55 * DROP * np.isin(number, off) * share
    friction += noise * np.random.default_rng(0).standard_normal(len(t))
    if force:
        return jf.from_arrays(
            t, 1e3 * friction, load_point_displacement=V * t, friction_unit="N",
            normal_stress=np.full(len(t), 1e7),
        )  # fmt: skip
    return jf.from_arrays(
        t, friction, load_point_displacement=V * t, normal_stress=np.full(len(t), 1e7)
    )


def stretch(stop, start=0.0, after=V):
    return Event("stick_slip", start, V, after, start, stop)


def test_teeth_that_are_straight_are_measured():
    (found,) = find_rises(straight(), [stretch(80.0)])
    assert found.count == 5  # of 8: two are passed over, and the last one does not drop
    assert found.velocity == V and found.normal_stress == 1e7 and not found.why
    # friction drops within one row: between its tip and its foot it would have risen by a row
    np.testing.assert_allclose(found.drops, DROP * (1 - ROW / PERIOD), rtol=1e-9)
    np.testing.assert_allclose(found.periods, PERIOD, rtol=1e-9)
    np.testing.assert_allclose(found.lasts, PERIOD, rtol=1e-9)
    np.testing.assert_allclose(found.loading, DROP / PERIOD / V, rtol=1e-9)
    # the part before the tip is cut off by a row and a half
    inside = 0.6 + DROP * (MIDDLE[:-1] - 0.5)
    np.testing.assert_allclose(found.means[0, :-1], inside, atol=1e-9)
    last = 0.5 * (EDGES[-2] + 1 - 1.5 * ROW / PERIOD)
    np.testing.assert_allclose(found.means[:, -1], 0.6 + DROP * (last - 0.5), atol=1e-9)
    assert found.row == pytest.approx(ROW) and not found.resolved


@pytest.mark.parametrize("wide", [5, 10, 16])
def test_the_drop_of_running_means_is_told_as_it_was(wide):
    """A running mean takes off a drop what friction rises in the mean's time."""
    record = straight(10)
    means = np.convolve(record.friction, np.ones(wide) / wide, "valid")
    t = record.time[wide - 1 :]
    blurred = jf.from_arrays(t, means, load_point_displacement=V * t)
    (found,) = find_rises(blurred, [stretch(95.0)])
    # one row less: between its tip and its foot friction would have risen by a row
    assert np.mean(found.drops) == pytest.approx(DROP * (1 - wide * ROW / PERIOD), rel=1e-3)
    assert found.resolved and found.fall == pytest.approx(wide * ROW, rel=1e-2)
    assert np.mean(found.drops) + found.averaged == pytest.approx(DROP, rel=3e-3)
    (sharp,) = find_rises(record, [stretch(95.0)])
    assert sharp.averaged == 0.0


def test_a_force_has_teeth_of_no_normal_stress():
    (found,) = find_rises(straight(force=True), [stretch(80.0)])
    assert found.normal_stress is None and found.drops[0] == pytest.approx(29.7)


def test_teeth_that_are_not_like_the_others_are_passed_over():
    (found,) = find_rises(straight(9, off=(4,)), [stretch(90.0)])
    # that tooth, and the one after it, whose drop is that of a low tip
    assert found.count == 4 and np.ptp(found.drops) < 1e-9 and np.ptp(found.means[:, -1]) < 1e-9


def test_outliers_change_no_tooth():
    """Every fiftieth row is off by half of a drop, up or down."""
    clean = straight(12, row=0.02, noise=2e-4)
    off = np.zeros(len(clean))
    off[25::50] = 0.5 * DROP * np.where(np.arange(len(off[25::50])) % 2, 1, -1)
    record = jf.from_arrays(
        clean.time, clean.friction + off, load_point_displacement=clean.load_point_displacement
    )
    (one,), (other,) = (find_rises(r, [stretch(120.0)]) for r in (clean, record))
    assert one.count == other.count == 9  # of 12, without the first two and the last
    assert other.drop[0] == pytest.approx(DROP, rel=0.02)
    assert other.drop[0] == pytest.approx(one.drop[0], abs=3e-4)
    assert other.loading.mean() == pytest.approx(DROP / (V * PERIOD), rel=0.01)


def test_the_first_teeth_that_still_settle_are_passed_over():
    """After a change of stress a drop and its period are first longer, by 30 % and a third each."""
    longer = 1 + 0.3 * 3.0 ** -np.arange(16.0)
    ends = np.concatenate([[0.0], np.cumsum(PERIOD * longer)])
    t = np.arange(0.5 * ROW, ends[-1], ROW)
    tooth = np.searchsorted(ends, t) - 1
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(t))
    friction = 0.6 + DROP * (t - ends[tooth]) / PERIOD + noise
    record = jf.from_arrays(t, friction, load_point_displacement=V * t)
    (found,) = find_rises(record, [stretch(t[-1])])
    assert 9 <= found.count <= 12
    # the highest row of a noisy tooth is high by two scatters of its rows, its lowest is low
    assert found.drops.mean() == pytest.approx(DROP, abs=5e-4) and found.drops.std() < 3e-4
    assert found.periods.mean() == pytest.approx(PERIOD, abs=0.05)


def test_teeth_that_jump_up_to_a_plateau_are_not_fitted():
    t = np.arange(0.01, 120.0, 0.02)
    s = t / 10 % 1
    friction = 0.6 + 0.03 * np.minimum(1, s / 0.04) - 0.001 * s + 0.0018 * (s > 0.985)
    record = jf.from_arrays(t, friction, load_point_displacement=V * t)
    (found,) = find_rises(record, [stretch(120.0)])
    assert found.count == 0 and found.why == "friction does not rise steadily between its drops"


def test_a_stretch_between_two_rows_is_none():
    (found,) = find_rises(straight(8), [stretch(20.04, start=20.02)])
    assert found.count == 0 and found.normal_stress is None and found.why


def test_too_few_teeth_and_too_few_rows_say_why():
    (few,) = find_rises(straight(5), [stretch(50.0)])
    assert few.count == 0 and few.why == "2 teeth after the first 2; 4 are needed"
    (short,) = find_rises(straight(8, row=1.6), [stretch(80.0)])
    assert short.count == 0 and short.why == "fewer than 8 rows in a rise"


def test_a_velocity_step_in_teeth_is_no_stretch():
    assert is_stretch(stretch(80.0))
    assert not is_stretch(stretch(80.0, after=2 * V))
    assert not is_stretch(stretch(0.0))
    assert not is_stretch(replace(stretch(80.0), kind="step"))


def test_noise_of_a_steep_rise_is_no_glitch():
    t = np.arange(400.0)
    rng = np.random.default_rng(2)
    rise = 2e-3 * t + 2e-4 * rng.standard_normal(400)
    assert len(find_spikes(rise)) == 0
    rise[200] += 0.02
    assert find_spikes(rise).tolist() == [200]


# ---- how friction rises ----------------------------------------------------------------------

SLIDERS = {
    "slip": Slider("slip", 0.6, 0.006, 0.010, 1e-5, 0.3 * 0.004 / 1e-5, 0.015),
    "ageing": Slider("ageing", 0.6, 0.006, 0.010, 1e-5, 0.3 * 0.004 / 1e-5, 0.015),
}
SPEEDS = (1e-5, 1e-4)


def saw(law, *, teeth=8, rows=120, noise=2e-4, seed=0):
    """A record of a slider with mass at two velocities, by SciPy."""
    p = SLIDERS[law]
    u = np.log(SPEEDS[0] / 1e-6)
    y, now, where, parts = np.array([u + 0.5, -p.B * u, p.f0 + (p.A - p.B) * u]), 0.0, 0.0, []
    for v in SPEEDS:
        period = 0.135 / (p.K * v)
        y, _, _ = move(p, v, y, np.array([2 * period]))
        now, where = now + 2 * period, where + 2 * v * period
        t = (np.arange(teeth * rows) + 0.5) * period / rows
        y, _, friction = move(p, v, y, np.append(t, teeth * period))
        parts.append((now + t, where + v * t, friction[:-1]))
        now, where = now + teeth * period, where + v * teeth * period
    t, x, f = (np.concatenate(column) for column in zip(*parts, strict=True))
    f = f + noise * np.random.default_rng(seed).standard_normal(len(f))
    return jf.from_arrays(t - t[0], f, load_point_displacement=x - x[0])


@pytest.mark.parametrize("law", ["slip", "ageing"])
def test_noise_makes_no_drop_larger(law):
    """The extremes of rows are farther apart the noisier they are: by 3 % of a drop and more here.
    The truth is the distance of the extremes of the rows without noise."""
    clean, away = saw(law, rows=400, noise=0.0), []
    intervals = [event for event in find_events(clean)[1] if is_stretch(event)]
    assert len(intervals) == len(SPEEDS)
    for event in intervals:
        at = (clean.time >= event.time) & (clean.time < event.stop)
        rows = turns(clean.friction[at], 0.02)[4:]
        truth = np.abs(np.diff(clean.friction[at][rows]))[::-2].mean()
        for noise in (2e-4, 1e-3):
            for seed in range(5):
                rng = np.random.default_rng(seed)
                noisy = clean.friction + noise * rng.standard_normal(len(clean))
                record = jf.from_arrays(
                    clean.time, noisy, load_point_displacement=clean.load_point_displacement
                )
                (found,) = find_rises(record, [event])
                drop, error = found.drop
                away.append((drop / truth - 1, (drop - truth) / error))
    share, errors = np.array(away).reshape(len(SPEEDS) * 2, 5, 2).T
    assert np.abs(share.mean(axis=0)).max() < 0.01
    assert np.sqrt(np.mean(errors**2)) < 1.5 and np.abs(errors).max() < 4.5


def parameters(p):
    """Those of `rise_model.NAMES`, of a slider; f0 at 1 um/s."""
    over = p.B - p.A
    logs = np.log([p.A, over, p.K * p.L / over, p.K, p.T])
    return np.concatenate([[p.f0], logs])


@pytest.mark.parametrize("law", ["slip", "ageing"])
def test_the_rise_is_that_of_another_solver(law):
    import jax.numpy as jnp

    from jaxfric.runs.rise_model import rises

    p, V, drop, row = SLIDERS[law], 1e-5, 0.08, 5e-3
    foot = 0.52
    stopped = 2 * np.pi / p.T * np.sqrt(p.L * drop / p.K)
    steady = -p.B * np.log(stopped / 1e-6)
    theta = max(steady, foot - p.f0 - p.A * np.log(V / 1e-6))

    def slope(t, y):
        v = 1e-6 * np.exp(min((y[0] - p.f0 - y[1]) / p.A, 60.0))
        if law == "slip":
            change = -(v / p.L) * (y[1] + p.B * np.log(v / 1e-6))
        else:
            change = p.B / p.L * (1e-6 * np.exp(-y[1] / p.B) - v)
        return [p.K * (V - v), change]

    away = lambda t, y: (y[0] - p.f0 - y[1]) / p.A - np.log(1e4 * V / 1e-6)  # noqa: E731
    away.terminal = True
    done = solve_ivp(
        slope, (0, 1e3), [foot, theta], "Radau", events=away, dense_output=True, rtol=1e-10,
        atol=1e-13,
    )  # fmt: skip
    end = done.t_events[0][0]  # at 10,000 V there are 1e-4 of L/V left
    edges = np.clip(EDGES, 0.5 * row, 1 - 1.5 * row)
    true = [done.sol(np.linspace(a * end, b * end, 400))[0].mean() for a, b in
            pairwise(edges)]  # fmt: skip
    h = 1e-4
    feet = foot + h * np.array([0, 1, -1, 0])  # four stretches, as many as a fit pads to
    stretches = jnp.array(4 * [[V, drop, 0.9 * end, 1.0, row]])

    def risen(q):
        return [np.asarray(x) for x in rises(q, feet, stretches, law, np.asarray(1e-6))]

    q = parameters(p)
    found, slips, by_p, by_foot = risen(q)
    assert bool(slips[0])
    assert np.abs(found[0, :-1] - true).max() < 3e-5 * drop
    assert float(found[0, -1]) == pytest.approx(drop / 0.9, rel=2e-5)
    # derivatives against central differences
    for k, one in enumerate(np.eye(len(q))):
        up, down = (risen(q + s * h * one)[0] for s in (1, -1))
        size = np.abs(by_p[0, :, k]).max()
        np.testing.assert_allclose((up - down)[0] / (2 * h), by_p[0, :, k], atol=2e-3 * size + 1e-6)
    np.testing.assert_allclose((found[1] - found[2]) / (2 * h), by_foot[0], atol=2e-3)


@pytest.fixture(scope="module", params=["slip", "ageing"])
def seen(request):
    """A law, the events of its saw, and what is found in them."""
    record = saw(request.param)
    events = find_events(record)[1]
    return request.param, events, fit_stick_slip(record, events)


def test_the_teeth_tell_the_slider_and_its_law(seen):
    law, events, found = seen
    p = SLIDERS[law]
    truth = {"A-B": p.A - p.B, "L": p.L, "K": p.K}
    assert sum(is_stretch(event) for event in events) == len(SPEEDS)
    assert found is not None
    fit = found.fits[law]
    assert fit.converged and fit.misfit < 2e-3
    for name, true in truth.items():
        assert abs(fit.values[name] - true) < 3 * fit.errors[name], name
    assert fit.errors["A-B"] < 0.15 * abs(truth["A-B"]) and fit.errors["K"] < 0.01 * p.K
    other = found.fits["ageing" if law == "slip" else "slip"]
    assert other.chi2 > fit.chi2
    assert found.law in (None, law)


def test_the_stiffness_is_that_of_another_normal_stress(seen):
    law, _, found = seen
    rises = found.used
    # the same teeth, but the slower ones under half of the normal stress: K would be twice as large
    moved = [replace(rises[0], normal_stress=5e6), replace(rises[1], normal_stress=1e7)]
    both, apart = found.fits[law], fit_rises(moved, law)
    assert both.stress is None and apart.stress == 7.5e6
    assert both.misfit < 2e-3 < 1e-2 < apart.misfit


# ---- what is told ----------------------------------------------------------------------------

GOOD = {
    "f0": (0.6, 0.01), "A": (0.006, 0.001), "B": (0.010, 0.001), "A-B": (-0.004, 1e-4),
    "L": (1e-5, 1e-6), "K": (120.0, 0.5), "softness": (0.3, 0.03),
}  # fmt: skip


def rise_fit(chi2=20.0, law="slip", **changed):
    values = {name: value for name, (value, _) in GOOD.items()}
    errors = {name: error for name, (_, error) in GOOD.items()}
    for name, (value, error) in changed.pop("numbers", {}).items():
        values[name], errors[name] = value, error
    told = {"converged": True, "misfit": 1e-3, "stress": None, "period": 0.02} | changed
    return RiseFit(law, values=values, errors=errors, chi2=chi2, freedom=20, fitted=(), **told)


def teeth(velocity, drop, why=""):
    drops = drop + 1e-3 * np.array([-1.0, 0.0, 1.0, 0.0])
    empty = np.zeros((4, len(MIDDLE)))
    if why:
        drops, empty = drops[:0], empty[:0]
    return Rises(0.0, 9.0, velocity, None, empty + MIDDLE, drops * 0 + 2.0, drops, drops * 0 + 2,
                 why=why)  # fmt: skip


def stick_slip(slip, ageing, law=None, doubts=None):
    stretches = (teeth(1e-6, 0.09), teeth(1e-5, 0.08), teeth(1e-4, 0.07), teeth(1e-3, 0, "few"))
    return StickSlip(stretches, {"slip": slip, "ageing": ageing}, law, doubts or {})


@pytest.mark.parametrize(
    ("slip", "ageing", "law"),
    [
        (20, 33, "slip"),
        (33, 20, "ageing"),
        (20, 31, None),
        (60, 90, None),  # of 20 degrees of freedom: 30 are 10 of what is left
        (60, 100, "slip"),
    ],
)
def test_claims_a_law_is_preferred_by_much(slip, ageing, law):
    fits = {"slip": rise_fit(slip), "ageing": rise_fit(ageing)}
    assert preferred(fits, {}) == law


def test_claims_no_law_of_which_nothing_is_claimed_is_preferred():
    fits = {"slip": rise_fit(20.0), "ageing": rise_fit(90.0)}
    assert preferred(fits, {"slip": "why", "ageing": "why"}) is None
    assert preferred(fits, {"slip": "why"}) is None
    assert preferred(fits, {"ageing": "why"}) == "slip"
    assert preferred({}, {}) is None
    ended = {"slip": rise_fit(20.0), "ageing": rise_fit(5e6, converged=False)}
    assert preferred(ended, {"ageing": "the fit did not converge"}) is None


@pytest.mark.parametrize(
    ("fit", "words"),
    [
        (rise_fit(), ""),
        (rise_fit(converged=False), "did not converge"),
        (rise_fit(numbers={"L": (np.nan, 1e-6)}), "did not converge"),
        (rise_fit(misfit=0.03), "misfit is 3 % of a drop"),
        (rise_fit(misfit=0.019), ""),
        (rise_fit(period=0.04), "a drop would last 0.02 s (2 um of the load point,"),
        (rise_fit(period=0.04), "or rows are running means: record unfiltered rows"),
        (rise_fit(period=0.029), ""),
        (rise_fit(numbers={"softness": (0.95, 0.1)}), "K would be 0.95 of the critical stiffness"),
        (rise_fit(numbers={"softness": (0.85, 0.1)}), ""),
    ],
)
def test_claims_that_are_not_made_say_why(fit, words):
    why = doubt_of(fit, 1e-4)
    assert (words in why) if words else not why


def test_claims_are_of_what_is_determined():
    found = stick_slip(
        # 95 % intervals of less than a decade have an error of less than 59 %, as in any fit
        rise_fit(numbers={"A": (0.006, 0.0036), "L": (1e-5, 6e-6), "K": (120.0, 69.0)}),
        rise_fit(90.0),
        doubts={"ageing": "why"},
    )
    assert set(found.claimed("slip")) == {"A-B", "K"}  # B = A + (B - A)
    assert found.claimed("ageing") == {} and found.claimed("other") == {}


def test_drops_fall_with_velocity():
    line = drop_by_velocity(stick_slip(rise_fit(), rise_fit(90.0)))
    assert line is not None
    assert line.slope == pytest.approx(-0.01) and 0 < line.error < 1e-3
    few = StickSlip((teeth(1e-6, 0.09), teeth(1e-5, 0.08)), {}, None, {})
    assert drop_by_velocity(few) is None
    flat = [teeth(v, 0.08) for v in (1e-6, 1e-5, 1e-4)]
    text = "\n".join(told(StickSlip(tuple(flat), {}, None, {})))
    assert "the drop changes by less than" in text
    drops = (0.09, 0.081, 0.07)  # a slope of 17 errors; of three points 95 % are within 12.7
    bent = StickSlip(tuple(map(teeth, (1e-6, 1e-5, 1e-4), drops)), {}, None, {})
    few = StickSlip(tuple(map(teeth, (1e-6, 1e-5, 1e-4), (0.09, 0.083, 0.07))), {}, None, {})
    for found, less in ((bent, False), (few, True)):
        line = drop_by_velocity(found)
        assert line is not None and abs(line.slope) > 5 * line.error
        assert any("changes by less" in one for one in told(found)) == less
    near = StickSlip(tuple(teeth(v, 0.08) for v in (1e-6, 1.2e-6, 1.9e-6)), {}, None, {})
    assert drop_by_velocity(near) is None


@pytest.mark.parametrize(("fall", "words"), [(0.03, ""), (0.06, "the drop is 0.0927")])
def test_a_drop_that_may_be_of_running_means_says_so(fall, words):
    """`teeth` rise by .09 in 2 s at first: .0027 in .06 s is 3 %, twice the error and more."""
    one = replace(teeth(1e-5, 0.09), row=1e-3, fall=fall)
    scale = 0.09 / (one.loading.mean() * one.velocity * 2.0)
    (line,) = told(StickSlip((replace(one, means=scale * one.means),), {}, None, {}))
    assert f"a drop lasts {fall:.2g} s: inertial" in line
    assert line.endswith(
        f"running means over this time, {words}" if words else f"{one.swing:.2g} s"
    )
    (unresolved,) = told(StickSlip((replace(one, row=0.5),), {}, None, {}))
    assert unresolved.endswith("every 2 s")


def test_a_slider_that_swings_freely_is_inertial():
    """A mass that sticks up to .4 of its weight and slips at .3: half a swing about .3 takes it to
    .2, where it sticks again. Its swing has the period 2 pi sqrt(1/(g K)), friction as force over
    weight on a spring of K per weight."""
    K, V, row = 580.0, 1.1e-3, 5e-4
    w = np.sqrt(9.81 * K)
    time = np.arange(0.0, 4.0, row)
    cycle = 0.2 / (K * V) + np.pi / w
    since = time % cycle - 0.2 / (K * V)  # the tip
    swings = 0.3 + 0.1 * np.cos(w * since)
    friction = np.where(since < 0, 0.4 + K * V * since, swings)
    friction += 5e-4 * np.random.default_rng(0).normal(size=len(time))
    record = jf.from_arrays(time, friction, load_point_displacement=V * time)
    (found,) = find_rises(record, [Event("stick_slip", 0.0, V, V, 0.0, 4.0)])
    assert found.swing == pytest.approx(2 * np.pi / w, rel=0.05)
    (line,) = told(StickSlip((found,), {}, None, {}))
    assert f"inertial if the period of free oscillation is {found.swing:.2g} s" in line


def test_lines_tell_what_counts():
    text = "\n".join(told(stick_slip(rise_fit(), rise_fit(90.0), "slip")))
    assert "stick-slip at 1 um/s from 0 s: 4 teeth, drop 0.09000(41) every 2 s" in text
    assert "1000 um/s from 0 s: not used, few" in text
    assert "the drop falls by 0.01000(29) per decade" in text
    assert "slip law (it fits better): A 0.0060(10), B 0.0100(10), A-B -0.00400(10)" in text
    assert "L 10.0(10) um, K 0.00012000(50) 1/um" in text and "ageing" not in text
    both = "\n".join(told(stick_slip(rise_fit(stress=7.5e7), rise_fit(21.0))))
    assert "cannot distinguish the slip law from the ageing law" in both and "at 75 MPa" in both
    doubted = told(stick_slip(rise_fit(), rise_fit(), doubts={"slip": "why", "ageing": "why"}))
    assert sum("nothing is claimed, why" in line for line in doubted) == 2
    assert not any("cannot distinguish" in line for line in doubted)


def test_tables_have_units_and_no_number_that_is_not_claimed():
    found = stick_slip(rise_fit(stress=7.5e7), rise_fit(90.0), "slip", {"ageing": "why"})
    table = rows(found)
    assert [row["teeth"] for row in table] == [4, 4, 4, 0]
    assert table[0]["velocity [um/s]"] == 1.0 and table[0]["drop"] == 0.09
    assert table[3]["result"] == "few" and "drop" not in table[3]
    slip, ageing = law_rows(found)
    assert slip["L [um]"] == 10.0 and slip["K [1/um]"] == 1.2e-4 and slip["preferred"] is True
    assert slip["K at normal_stress [MPa]"] == 75.0 and slip["result"] == "converged"
    assert ageing["A"] is None and ageing["std K [1/um]"] is None and ageing["result"] == "why"
    content = to_json(found)
    assert content is not None and content["law"] == "slip"
    assert content["fits"]["slip"]["claimed"] == ["A", "A-B", "B", "K", "L"]
    assert content["fits"]["ageing"]["claimed"] == []
    odd = stick_slip(rise_fit(numbers={"L": (np.nan, np.inf)}), rise_fit(np.nan))
    json.dumps(to_json(odd), allow_nan=False)


@pytest.mark.parametrize(
    ("given", "share"),
    [
        (MachineStiffness(120.0), None),
        (MachineStiffness(131.0), None),
        (MachineStiffness(140.0), 0.17),
        (MachineStiffness(100.0), -0.17),
        (MachineStiffness(120.0 * 7.5e7, of_stress=True), None),
        (MachineStiffness(100.0 * 7.5e7, of_stress=True), -0.17),
        (None, None),
    ],
)
def test_claims_another_stiffness_is_told(given, share):
    found = stick_slip(rise_fit(stress=7.5e7), rise_fit(90.0), "slip")
    said = disagreement(found, given)
    assert (said is None) == (share is None)
    assert share is None or said.values["share"] == pytest.approx(share, abs=0.005)


def test_claims_a_stiffness_that_cannot_be_compared_is_not():
    found = stick_slip(rise_fit(), rise_fit(90.0), "slip")
    assert disagreement(found, MachineStiffness(1e10, of_stress=True)) is None
    undecided = stick_slip(rise_fit(), rise_fit(21.0))
    assert disagreement(undecided, MachineStiffness(1e6)) is None


def test_a_force_has_its_units():
    found = replace(stick_slip(rise_fit(), rise_fit(90.0), "slip"), unit="N")
    text = "\n".join(told(found))
    assert "drop 0.09000(41) N every" in text and "A 0.0060(10) N" in text
    assert "K 0.00012000(50) N/um" in text and "L 10.0(10) um" in text
    assert law_rows(found)[0]["A [N]"] == 0.006 and law_rows(found)[0]["K [N/um]"] == 1.2e-4
    assert rows(found)[0]["drop [N]"] == 0.09 and "loading [N/um]" in rows(found)[0]
