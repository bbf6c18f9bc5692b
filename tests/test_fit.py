"""Fits: published numbers, known truths, honest errors, and failure as a value."""

import dataclasses
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from generator import _integrate, random_record
from public_data import public_record
from reference import Law, Motion, solve

import jaxfric
from jaxfric import InputError, VelocitySteps
from jaxfric.fitting import NoiseEstimate, NoisePart
from jaxfric.fitting.assemble import _plausible, edge_warnings
from jaxfric.fitting.fit import _noise
from jaxfric.fitting.plausible import bounds_of
from jaxfric.fitting.problem import Model, most_steps
from jaxfric.fitting.result import Estimate, Fit
from jaxfric.fitting.solve import known_at
from jaxfric.fitting.stages import Begun, FitTask, prepare
from jaxfric.fitting.start import OneStateMotion, more_state_starts, one_state_starts
from jaxfric.fitting.uncertainty import QUANTILE
from jaxfric.laws.registry import rate_state
from jaxfric.motion import PiecewiseVelocity
from jaxfric.plot.fit import fit_figure
from jaxfric.report.fit_text import summary
from jaxfric.rig import QuasiStatic, Rig
from jaxfric.simulation import simulate

DATA = Path(__file__).resolve().parents[1] / "data"
# a, b, Dc [m] and their standard deviations as published for p655, step 1, slip law, k = 1.6e-3/um
PUBLISHED = {"A": (0.006005, 53e-6), "B": (0.004230, 51e-6), "L": (17.745e-6, 0.334e-6)}


def synthetic(seed: int, **options) -> tuple[jaxfric.Record, VelocitySteps, object]:
    made = random_record(seed, **options)
    record = jaxfric.from_arrays(
        made.time, made.friction, load_point_displacement=made.load_point_displacement
    )
    return record, VelocitySteps(np.array(made.truth.starts), np.array(made.truth.velocities)), made


def test_descents_are_counted_within_their_stage(monkeypatch):
    """Of one state and then of more; stand-ins for all that computes."""
    told, module, zeros = [], sys.modules["jaxfric.fitting.fit"], np.zeros(3)

    def solve(begun, given, progress):
        progress("descent 1 of at most 3")
        return SimpleNamespace(z=zeros)

    problem: Any = SimpleNamespace(rig=lambda z: None, motion=None, max_steps=4096)
    begun = Begun(problem, np.ones((1, 4)))
    monkeypatch.setattr(module, "_solve", solve)
    monkeypatch.setattr(module, "first_stage", lambda *_, **__: begun)
    monkeypatch.setattr(module, "one_state_starts", lambda *_, **__: begun.starts)
    monkeypatch.setattr(module, "second_stage", lambda *_: begun)
    monkeypatch.setattr(module, "averaged", lambda *_: SimpleNamespace(time=zeros))
    moved = SimpleNamespace(velocity=zeros, slip=zeros)
    monkeypatch.setattr(module, "simulate", lambda *_, **__: moved)
    record: Any = SimpleNamespace(relative_time=zeros, friction=zeros)
    for states in (1, 2):
        steps: Any = None
        task = FitTask(record, steps, 1.0, Model(states=states), 1.0, 1.0, None, (), steps)
        module._solve_in_stages(task, None, told.append)
    assert told == [
        "descent 1 of at most 3",
        "stage 1 of 2, one state: descent 1 of at most 3",
        "stage 2 of 2, 2 states: descent 1 of at most 3",
    ]


@pytest.mark.parametrize(
    ("options", "most"),
    [
        (dict(stiffness="1.6e-3/um"), 1.290e-4),
        (dict(stiffness="1e-3/um"), 3.23e-4),
        pytest.param(dict(stiffness="1e-3/um", law="ageing"), 3.54e-4, marks=pytest.mark.long),
        pytest.param(
            dict(stiffness="1.6e-3/um", states=2), 782 * 3.0e-4**2, marks=pytest.mark.long
        ),
        pytest.param(
            dict(fit_stiffness=True, slip_trend=True), 782 * 3.4e-4**2, marks=pytest.mark.long
        ),
    ],
)
def test_p655_misfits(options, most):
    fit = jaxfric.fit(jaxfric.read(public_record("p655_step1.csv")), **options)
    assert fit.converged
    assert fit.sum_of_squares <= most


@pytest.mark.long
def test_p655_published_parameters_with_the_step_where_that_fit_had_it():
    record = jaxfric.read(public_record("p655_step1.csv"))
    steps = "0 s: 2.289 um/s, 23.37 s: 22.86 um/s"
    fit = jaxfric.fit(record, stiffness="1.6e-3/um", steps=steps)
    assert fit.sum_of_squares <= 1.290e-4
    for name, (value, sigma) in PUBLISHED.items():
        assert abs(fit.parameters[name].value - value) <= 2 * sigma, name


def test_p655_step_time_agrees_with_all_rows_of_the_run():
    """The refined step lies where 2242 rows show it, not where the 782 thinned ones do."""
    few = jaxfric.read(public_record("p655_step1.csv"))
    every = jaxfric.read(public_record("p655_step1_allrows.csv"))
    shown = jaxfric.find_steps(every.relative_time, every.load_point_displacement)
    fit = jaxfric.fit(few, stiffness="1.6e-3/um")
    offset = few.time[0] - every.time[0]
    error = np.hypot(shown.time_errors[1], fit.steps.time_errors[1])
    assert abs(fit.steps.times[1] + offset - shown.times[1]) < 2 * error


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "most"),
    # rms of independent fits at their parameters (data/README.md of the records) plus 2 %
    [
        ("velstep1_TR2_exp013_sepiolite.txt", 1.02 * 1.5606e-3),
        ("velstep3_TR2_exp013_sepiolite.txt", 1.02 * 1.0670e-3),
        ("velstep4_BRAVA_expb819_basalt.txt", 1.02 * 8.6543e-4),
    ],
)
def test_gouge_and_basalt(name, most):
    fit = jaxfric.fit(jaxfric.read(public_record(name)), fit_stiffness=True, slip_trend=True)
    assert fit.converged
    assert fit.rms <= most
    assert all(np.isfinite(e.value) for e in fit.parameters.values())


@pytest.mark.parametrize(
    ("file", "options", "truth"),
    [
        pytest.param(  # in the default run it is the README's example
            "velocity_step.csv",
            dict(stiffness="5e-3/um"),
            dict(A=0.010, B=0.014, L=20e-6),
            marks=pytest.mark.long,
        ),
        pytest.param(
            "velocity_steps.csv",
            dict(stiffness="4e-3/um"),
            dict(A=0.008, B=0.012, L=15e-6),
            marks=pytest.mark.long,
        ),
        pytest.param(
            "ageing_steps.csv",
            dict(stiffness="6e-3/um", law="ageing"),
            dict(A=0.007, B=0.011, L=8e-6),
            marks=pytest.mark.long,
        ),
        pytest.param(
            "force_step.csv",
            dict(stiffness="4e5 N/m"),
            dict(A=0.40, B=0.60, L=5e-6),
            marks=pytest.mark.long,
        ),
        pytest.param(
            "hidden_state.csv",
            dict(stiffness="9.4e-4/um", states=2),
            dict(A=0.009, B=0.010, L=8e-6, B2=0.004, L2=60e-6),
            marks=pytest.mark.long,
        ),
    ],
)
def test_synthetic_truths(file, options, truth):
    fit = jaxfric.fit(jaxfric.read(DATA / file), **options)
    assert fit.converged
    for name, value in truth.items():
        estimate = fit.parameters[name]
        assert estimate.determined, name
        assert abs(estimate.value - value) < 3.5 * estimate.std, name
        assert estimate.std < 0.2 * value, name


@pytest.mark.long
def test_starts_reach_the_optimum_at_the_stability_edge():
    """Every start of this record runs away; the dashpots lead to the truth's own basin."""
    record, steps, made = synthetic(5047)
    fit = jaxfric.fit(record, stiffness=made.stiffness, law=made.truth.law, steps=steps)
    truth = np.sum((made.clean_friction - made.friction) ** 2)
    assert fit.converged
    assert fit.sum_of_squares < truth
    assert any("edge" in text for text in fit.warnings)


HOLDS = {
    "step and hold": [1.0, 10.0, 0.0, 10.0003, 1.0],  # found velocities are never quite the same
    "slide-hold-slide": [10.0, 0.0, 9.9998, 0.0, 10.0],
}


@pytest.mark.parametrize("law", ["slip", "ageing"])
@pytest.mark.parametrize("velocities", HOLDS.values(), ids=HOLDS)
def test_starts_come_from_records_with_holds(velocities, law):
    """A and L of the best start within a factor 2 of the truth; B - A within half a step of the
    grid, which is 0.6 of the largest jump."""
    A, B, L, V0 = 0.01, 0.014, 20e-6, velocities[0] * 1e-6
    starts = np.array([0.0, 40.0, 70.0, 100.0, 130.0])
    t = np.arange(0.0, 190.0, 0.1)
    r = np.array(velocities) / velocities[0]
    motion = _integrate(law, B / A, 5e3 * L / A, starts * V0 / L, r, t * V0 / L)
    assert motion is not None
    noise = 3e-4 * np.random.default_rng(0).standard_normal(len(t))
    friction = 0.6 + A * (motion[0] + motion[1]) + noise
    steps = VelocitySteps(starts, 1e-6 * np.array(velocities))
    best = one_state_starts(t, friction, steps, V0=V0, stiffness=5e3, model=Model(law))[0]
    assert 0.5 < best[1] / A < 2 and 0.5 < best[3] / L < 2
    assert abs(best[2] - best[1] - (B - A)) < 0.5 * A


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("L", 0.01 * 1e-6, 486e-6),  # the slip between rows at 1 um/s, and of all rows
        ("B2", -30 * 0.02 / np.log(10), 30 * 0.02 / np.log(10)),
        ("A", 0.0, 30 * 0.02 / np.log(10)),
        ("f0", 0.59 - 0.2, 0.61 + 0.2),
        ("K", 1e-4 / 486e-6, np.inf),
    ],
)
def test_bounds_of_a_parameter_are_of_the_size_of_the_record(name, low, high):
    t = np.arange(91.0)  # 46 s at 1 um/s, then 44 s at 10 um/s: 486 um
    steps = VelocitySteps(np.array([0.0, 46.0]), np.array([1e-6, 1e-5]))
    found = bounds_of(name, t, np.linspace(0.59, 0.61, 91), steps, 1e-4)
    assert found == pytest.approx((low, high), rel=1e-2)


def test_a_load_point_that_turns_back_is_fitted():
    """SciPy's friction, from 0.6 to -0.6, of a press that reverses."""
    truth = Law("slip", 0.6, 0.01, (0.014,), (20e-6,), regularised=True)
    times, velocities = (0.0, 30.0, 60.0), (2e-6, 10e-6, -10e-6)
    t = np.linspace(0.0, 150.0, 300)
    exact = solve(truth, Motion(times, velocities), 2e3, t)
    noise = 2e-4 * np.random.default_rng(0).standard_normal(len(t))
    record = jaxfric.from_arrays(t, exact.f + noise, load_point_displacement=exact.x_m)
    steps = VelocitySteps(np.array(times), np.array(velocities))
    fit = jaxfric.fit(record, stiffness=2e3, steps=steps)
    assert fit.converged and exact.f[-1] < -0.5
    for name, value in {"A": truth.A, "B": truth.B[0], "L": truth.L[0]}.items():
        found = fit.parameters[name]
        assert abs(found.value - value) < 4 * found.std < 0.1 * value


def test_a_slip_length_longer_than_the_record_is_no_value():
    record, steps, made = synthetic(12, law="slip", pattern="up", samples=(300, 400))
    problem = prepare(record, steps, Model(), stiffness=1e3)
    t, path = made.truth, made.load_point_displacement[-1]
    for L, expected in ((t.L, True), (2 * path, False)):
        within = _plausible(record, steps, 1.0, problem, np.array([t.f0, t.A, t.B, L]))
        assert within == [True, True, True, expected]


def test_a_residual_that_wanders_is_not_taken_for_large_noise():
    """A slow hump of rms 1.6e-3: its noise has that size, and a memory of a tenth of the record."""
    record, steps, _ = synthetic(12, law="slip", pattern="up", samples=(300, 400))
    problem = prepare(record, steps, Model(), stiffness=1e3)
    n = len(problem.time)
    share = np.linspace(0, 1, len(record))
    hump = np.pad(1.6e-3 * np.sqrt(2) * np.cos(2 * np.pi * share), (0, n - len(record)))
    left = SimpleNamespace(residual=jnp.asarray(hump), jacobian=jnp.ones((n, 1)))
    noise = _noise(problem, left).noise
    assert 1.2e-3 < float(noise.sigma) < 2.2e-3
    whole = np.ptp(np.asarray(problem.clock), axis=0)
    for part in noise.parts:  # of what a part forgets over a tenth of the record
        assert part.rates @ (0.1 * whole) >= 1 - 1e-9
    assert float(noise.white) < 0.1


@pytest.fixture(scope="module")
def clean():
    return jaxfric.fit(jaxfric.read(DATA / "velocity_step.csv"), stiffness="5e-3/um")


def test_a_given_start_far_off_survives(clean):
    """From (2A, 1.3B, 2L) a naive fit dies of a runaway in the middle of a step."""
    start = dict(A=0.020, B=0.0182, L=40e-6)
    far = jaxfric.fit(clean.record, stiffness="5e-3/um", start=start)
    assert far.sum_of_squares == pytest.approx(clean.sum_of_squares, rel=1e-4)


def test_glitches_are_passed_over(clean):
    """Rows of 12 to 300 sigma, two of them neighbours; none of the record without them."""
    record = clean.record
    assert clean.noise.glitches.rows == ()
    rows, friction = [57, 200, 201, 300], np.array(record.friction)
    friction[rows] += clean.noise.sigma * np.array([30.0, -12.0, -12.0, 300.0])
    fit = jaxfric.fit(dataclasses.replace(record, friction=friction), stiffness="5e-3/um")
    assert fit.noise.glitches.rows == tuple(rows)
    assert "4 rows stand out of the noise" in fit.warnings[0]
    assert "rows 64, 207, 208 and 1 more" in fit.warnings[0]  # lines of the file
    assert fit.to_json()["noise"]["outliers"]["rows"] == rows
    assert summary(fit)[0].startswith(f"{len(record)} rows, 4 passed over, ")
    np.testing.assert_allclose(fit.residual[rows], clean.residual[rows] + friction[rows]
                               - record.friction[rows], atol=clean.noise.sigma)  # fmt: skip
    assert fit.rms == pytest.approx(clean.rms, rel=0.01)
    for name in fit.free:
        one, other = fit.parameters[name], clean.parameters[name]
        assert one.value == pytest.approx(other.value, abs=0.3 * other.std)
        assert one.std == pytest.approx(other.std, rel=0.05)


@pytest.mark.long
def test_intervals_cover_and_scores_have_unit_spread():
    """A slice of tests/benchmarks/coverage.py: 24 records of correlated noise."""
    scores, inside = [], []
    for seed in range(40_000, 40_024):
        record, steps, made = synthetic(
            seed,
            law="slip",
            pattern="up",
            stiffness_ratio=(3.0, 30.0),
            samples=(700, 1000),
            white=2e-4,
            correlated=2e-4,
            correlation=0.01,
        )
        fit = jaxfric.fit(record, stiffness=made.stiffness, steps=steps)
        for name in "ABL":
            estimate, true = fit.parameters[name], getattr(made.truth, name)
            scores.append((estimate.value - true) / estimate.std)
            inside.append(estimate.lower <= true <= estimate.upper)
    assert 0.6 < np.std(scores) < 1.5
    assert np.mean(inside) > 0.85


@pytest.mark.long
def test_means_over_rows_keep_intervals_honest():
    """Steps found in the load point, white and correlated noise, about a fifth of the rows."""
    scores = []
    for seed in range(40_000, 40_012):
        record, steps, made = synthetic(
            seed,
            law="slip",
            pattern="up",
            stiffness_ratio=(3.0, 30.0),
            samples=(4000, 5000),
            white=6e-4,
            correlated=2e-4,
            correlation=0.01,
        )
        fit = jaxfric.fit(record, stiffness=made.stiffness, steps=steps, downsample_to=1000)
        assert len(fit.record) <= 1000
        for name in "ABL":
            estimate, true = fit.parameters[name], getattr(made.truth, name)
            scores.append((estimate.value - true) / estimate.std)
    assert 0.5 < np.std(scores) < 1.6
    assert np.mean(np.abs(scores) < QUANTILE) > 0.8


@pytest.mark.long
def test_whitened_weighting_is_at_least_as_precise():
    record, steps, made = synthetic(
        77, law="slip", pattern="up", samples=(900, 1000), white=1e-4, correlated=4e-4
    )
    plain, white = (
        jaxfric.fit(record, stiffness=made.stiffness, steps=steps, weighting=w)
        for w in ("ordinary", "whitened")
    )
    assert plain.sum_of_squares <= white.sum_of_squares * (1 + 1e-6)
    for name in "AL":
        assert white.parameters[name].std <= 1.05 * plain.parameters[name].std


def test_profile_agrees_with_covariance_where_the_fit_is_nearly_linear():
    record = jaxfric.read(DATA / "velocity_step.csv")
    options = dict(stiffness="5e-3/um", steps="0 s: 1 um/s, 20 s: 10 um/s")
    options["steps"] = jaxfric.find_steps(
        record.relative_time, record.load_point_displacement
    ).text(digits=9)
    plain = jaxfric.fit(record, **options)
    told: list[str] = []
    profile = jaxfric.fit(record, **options, profile=True, progress=told.append)
    assert told[-1] == "profile of L (4 of 4)"
    for name in "ABL":
        p, q = plain.parameters[name], profile.parameters[name]
        assert q.profiled
        assert q.lower == pytest.approx(p.lower, abs=0.15 * p.std)
        assert q.upper == pytest.approx(p.upper, abs=0.15 * p.std)


@pytest.mark.long
def test_a_record_cut_before_the_evolution_leaves_L_undetermined():
    record = jaxfric.read(DATA / "velocity_step.csv")
    steps = jaxfric.find_steps(record.relative_time, record.load_point_displacement)
    cut = record.window(0.0, steps.times[1] + 0.3)
    exact = VelocitySteps(steps.times, steps.velocities)
    fit = jaxfric.fit(cut, stiffness="5e-3/um", steps=exact)
    assert not fit.parameters["L"].determined
    # nothing holds them, so the descent does not come to rest either
    assert not fit.converged and not fit.parameters["B"].determined
    assert any("do not use its parameters" in text for text in fit.warnings)
    assert fit.to_json()["parameters"]["L"]["std"] is None


@pytest.mark.long
def test_a_mirrored_record_gives_the_same_parameters():
    record = jaxfric.read(DATA / "force_step.csv")
    mirrored = jaxfric.from_arrays(
        record.time,
        -record.friction,
        load_point_displacement=-record.load_point_displacement,
        friction_unit="N",
    )
    a, b = (jaxfric.fit(r, stiffness="4e5 N/m") for r in (record, mirrored))
    for name in "ABL":
        assert b.parameters[name].value == pytest.approx(a.parameters[name].value, rel=1e-3)
    np.testing.assert_allclose(b.predicted, -a.predicted, rtol=1e-6)


@pytest.mark.long
def test_a_stiffness_that_is_too_soft_is_told_from_the_critical_one():
    record = jaxfric.read(DATA / "velocity_step.csv")
    with pytest.raises(InputError, match=r"stiffness is 0\.00015/µm, and the rows contradict it"):
        jaxfric.fit(record, stiffness="1.5e-4/um")
    fit = jaxfric.fit(record, stiffness="1e-3/um")
    assert fit.parameters["K"].value > 2 * fit.critical_stiffness()
    assert not any("K/K_cr" in text for text in fit.warnings)
    assert any("stiffness 0.001/µm contradicts the rows" in text for text in fit.warnings)
    json.dumps(fit.to_json(), allow_nan=False)


def test_jacobian_against_finite_differences():
    record, steps, made = synthetic(12, law="slip", pattern="up", samples=(300, 400))
    problem = prepare(record, steps, Model(slip_trend=True, fit_stiffness=True), stiffness=1e3)
    t = made.truth
    values = np.array([[t.f0, t.A, t.B, t.L, made.stiffness, 1.0]])
    z = problem.coordinates.to_free(values)[0]
    problem = dataclasses.replace(problem, rtol=1e-9)  # differences see the solver's error
    jacobian = known_at(problem, z).jacobian
    for i, along in enumerate(np.eye(len(z))):
        h = 1e-3
        up, down = (known_at(problem, z + s * h * along).residual for s in (1, -1))
        slope = (up - down) / (2 * h)
        assert np.max(np.abs(slope - jacobian[:, i])) <= 1e-5 * np.max(np.abs(slope)), i


@pytest.mark.parametrize(
    ("velocities", "most"), [(1, 4096), (16, 4096), (17, 8192), (32, 8192), (55, 16384)]
)
def test_many_velocities_may_take_many_steps(velocities, most):
    assert most_steps(velocities) == most


def test_a_record_of_many_steps_is_followed_to_its_end():
    """64 velocities at 3 K_cr take more steps than a simulation takes by itself; at the end of
    each of them friction is its steady value, a closed form."""
    velocities = 1e-6 * np.resize([1.0, 10.0], 64)
    ends = np.cumsum(400e-6 / velocities)
    steps = VelocitySteps(np.concatenate([[0.0], ends[:-1]]), velocities)
    t = np.sort(np.concatenate([ends - 1e-3 * ends[0], np.linspace(0.0, ends[-1], 100)]))
    record = jaxfric.from_arrays(
        t, 0.6 + 1e-6 * np.sin(t), load_point_displacement=steps.displacement(t)
    )
    f0, A, B, L = 0.6, 0.010, 0.014, 1e-5
    problem = prepare(record, steps, Model(), stiffness=3.0 * (B - A) / L, force_scale=A)
    z = problem.coordinates.to_free(jnp.array([[f0, A, B, L]]))[0]
    predicted, _, ended = problem.predict(z)
    assert ended
    seen = np.asarray(predicted)[np.searchsorted(t, ends - 1e-3 * ends[0])]
    steady = f0 + (A - B) * np.log(velocities / velocities[0])
    np.testing.assert_allclose(seen, steady, rtol=0, atol=2e-5)
    few = dataclasses.replace(problem, max_steps=4096)
    assert not few.predict(z)[2]


def test_quantile_is_that_of_the_normal_distribution():
    from scipy.stats import norm

    assert pytest.approx(norm.ppf(0.975), rel=1e-12) == QUANTILE


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (dict(), "stiffness is needed"),
        (dict(stiffness=-1.0), "above 0"),
        (dict(stiffness="0/um"), "above 0"),
        (dict(stiffness="5 um"), "stiffness"),
        (dict(stiffness="1e-30/um"), "is its unit right"),
        (dict(stiffness=1e3, law="age"), "slip, ageing"),
        (dict(stiffness=1e3, states=4), "1 to 3"),
        (dict(stiffness=1e3, weighting="robust"), "ordinary or whitened"),
        (dict(stiffness=1e3, steps="0 s: 1 um/s"), "no velocity step"),
        (dict(stiffness=1e3, steps="0 s: 0 um/s, 5 s: 1 um/s"), "at rest"),
        (dict(stiffness=1e3, steps="0 s: 1 um/s, 1e6 s: 10 um/s"), "record ends"),
        (dict(stiffness=1e3, start=dict(K=1.0)), "no free parameter"),
        (dict(stiffness=1e3, start=dict(A=-1.0)), "must be above 0"),
        (dict(stiffness=1e3, reference_velocity="-1 um/s"), "must be above 0"),
    ],
)
def test_bad_arguments(options, word):
    record = jaxfric.read(DATA / "velocity_step.csv")
    with pytest.raises(InputError, match=word):
        jaxfric.fit(record, **options)


def test_friction_that_would_drive_the_motion_is_refused():
    record = jaxfric.read(DATA / "velocity_step.csv")
    turned = dataclasses.replace(record, friction=-record.friction)
    with pytest.raises(InputError, match="is the sign of friction reversed"):
        jaxfric.fit(turned, stiffness="1e-3/um")
    with pytest.raises(InputError, match=r"record 1: .*sign of friction reversed"):
        jaxfric.fit_many([record, turned], stiffness="1e-3/um")


@pytest.mark.parametrize("start", [0.7, 0.5])
def test_no_word_of_the_figure_lies_on_the_record(start):
    """A record that starts high, or low, and fills its panel."""
    t = np.linspace(0, 60, 400)
    friction = 0.6 + (start - 0.6) * np.cos(t / 9)
    steps = VelocitySteps(np.array([0.0, 20.0]), np.array([1e-6, 1e-5]))
    record = jaxfric.from_arrays(t, friction, load_point_displacement=steps.displacement(t))
    units = {"f0": "1", "A": "1", "B": "1", "L": "m", "K": "1/m", "V0": "m/s"}
    units |= {"slip_trend": "1/m"}  # the longest line of the box
    fit = Fit(
        record=record,
        steps=steps,
        model=Model(),
        parameters={
            name: Estimate(0.012345, 1e-5, 0.01, 0.02, unit, free=name not in ("K", "V0"))
            for name, unit in units.items()
        },
        free=("f0", "A", "B", "L"),
        covariance=np.eye(4),
        correlation=np.eye(4),
        predicted=friction + 1e-3,
        sum_of_squares=1e-3,
        rms=1e-3,
        noise=NoiseEstimate(1e-3, (NoisePart(0.5, "time", 1.0),)),
        converged=True,
        result="converged",
        iterations=3,
        weighting="ordinary",
        warnings=(),
    )
    figure = fit_figure(fit)
    figure.canvas.draw()
    whole = figure.bbox
    for axis in figure.axes:
        words = [*axis.texts, *filter(None, [axis.get_legend()])]
        for box in (word.get_window_extent() for word in words):
            assert whole.x0 <= box.x0 and box.x1 <= whole.x1
            for line in axis.lines:
                points = line.get_transform().transform(line.get_xydata())
                assert not box.count_contains(points), axis.get_ylabel()


def test_64_bit_numbers_are_asked_for():
    record = jaxfric.read(DATA / "velocity_step.csv")
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(InputError, match="jax_enable_x64"):
            jaxfric.fit(record, stiffness=5e3)
    finally:
        jax.config.update("jax_enable_x64", True)


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (0.99, "stick-slip regime: the stiffness is below the critical one of this fit"),
        (1.01, "near the stability edge (K/K_cr = 1.01)"),
        (1.99, "near the stability edge"),
        (2.0, None),
        (np.inf, None),
    ],
)
def test_a_stiffness_below_or_near_the_critical_one_is_said(ratio, words):
    said = edge_warnings(2e3 * ratio, 2e3)
    assert len(said) == (words is not None)
    assert words is None or said[0].startswith(words)


def test_a_law_without_a_critical_stiffness_has_no_edge():
    assert edge_warnings(1e-9, 0.0) == edge_warnings(1e-9, -3.0) == []


def test_a_record_that_begins_at_its_step():
    """No row of the velocity before it: refused with what to write, and fitted where it is said."""
    made = random_record(11, law="slip", pattern="up", white=1e-4)
    truth, begin = made.truth, int(np.searchsorted(made.time, made.truth.starts[1]))
    record = jaxfric.from_arrays(
        np.append(truth.starts[1], made.time[begin + 1 :]),
        np.append(made.friction[begin - 1], made.friction[begin + 1 :]),
        load_point_displacement=np.append(
            truth.starts[1] * truth.velocities[0], made.load_point_displacement[begin + 1 :]
        ),
    )
    with pytest.raises(jaxfric.InputError, match=r'no velocity step.*"before: '):
        jaxfric.fit(record, stiffness=made.stiffness)
    before, after = truth.velocities
    found = jaxfric.fit(
        record, stiffness=made.stiffness, steps=f"before: {before!r} m/s, 0 s: {after!r} m/s"
    )
    assert found.converged
    for name in "ABL":
        one = found.parameters[name]
        assert abs(one.value - getattr(truth, name)) < 4 * one.std < 0.2 * one.value


def test_a_state_that_overflows_is_no_start():
    """A one-state fit may end at a motion that nearly stops: theta grows there."""
    time = np.linspace(0, 100, 60)
    velocity = np.where(time < 50, 1e-60, 1e-5)
    slip, even = np.cumsum(velocity), np.ones(60)
    seen = OneStateMotion(time, 0.6 + 0.01 * np.sin(time), velocity, slip, even)
    model = Model("ageing", 2, False, True)
    assert more_state_starts(seen, V0=1e-6, stiffness=1e3, model=model).shape == (0, 7)


@pytest.mark.parametrize("seed", [3, 15, 17])
def test_a_model_far_from_its_record_is_descended_to_the_end(seed):
    """A law that misses its record by 50 standard deviations of noise and more: a descent of 80
    trials is still on its way. Where it ends, a fit that begins there stays."""
    made = random_record(seed, law="ageing", pattern="mixed", samples=(600, 600), white=1e-4)
    moved = made.load_point_displacement - made.load_point_displacement[0]
    friction = made.friction + 0.01 * np.log1p(moved / (3 * made.truth.L))
    record = jaxfric.from_arrays(
        made.time, friction, load_point_displacement=made.load_point_displacement
    )
    steps = VelocitySteps(np.array(made.truth.starts), np.array(made.truth.velocities))
    start = {name: getattr(made.truth, name) for name in "ABL"}
    for _ in range(2):
        end = jaxfric.fit(record, stiffness=made.stiffness, steps=steps, start=start)
        assert end.converged and end.rms > 40e-4
        start = {name: end.parameters[name].value for name in "ABL"}
    assert end.rms < 70e-4


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_a_quiet_record_of_another_law_is_fitted_all_the_same(noise):
    """The slip law misses a step of the ageing law by .0017 rms, thousands of times the noise."""
    law = rate_state("ageing", {"f0": 0.6, "A": 8e-3, "B": 0.01, "L": 1e-5, "V0": 1e-6}, 1)
    time = np.linspace(0.0, 120.0, 1201)
    motion = PiecewiseVelocity(np.array([0.0, 40.0, 80.0]), np.array([1e-6, 1e-4, 1e-6]))
    seen = simulate(Rig(QuasiStatic(jnp.asarray(5e3)), law), motion, jnp.asarray(time))
    friction = np.asarray(seen.force) + noise * np.random.default_rng(0).standard_normal(len(time))
    pulled = np.asarray(jax.vmap(motion.displacement)(jnp.asarray(time)))
    record = jaxfric.from_arrays(time, friction, load_point_displacement=pulled)
    found = jaxfric.fit(record, stiffness=5e3, law="slip")
    assert found.converged and found.result == "converged"
    assert found.rms == pytest.approx(1.7e-3, rel=0.1) and found.parameters["A"].determined


def test_a_slow_change_is_not_taken_for_the_memory():
    """Step 2 of p655: friction falls along 2.5 mm, which an L of a centimetre fits to .63e-3, and
    a slip trend beside an L of ten micrometres to .38e-3."""
    whole = jaxfric.read(public_record("p655intact100l"), reduce=public_record("p655_r"))
    part = whole.window("3069.344 s", "3092.298 s")
    at = 3081.2006 - float(part.time[0] - whole.time[0])
    velocities, errors = np.array([23.31e-6, 228.7e-6]), np.array([0.0, 0.0143])
    steps = VelocitySteps(np.array([0.0, at]), velocities, time_errors=errors)
    found = jaxfric.fit(part, stiffness=2144.0, slip_trend=True, steps=steps)
    assert found.converged and found.rms < 0.4e-3
    assert 8e-6 < found.parameters["L"].value < 14e-6
