"""What a prediction says of its numbers: every threshold from both sides, without a simulation."""

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from jaxfric.prediction import axis, slider
from jaxfric.prediction.chance import chance_of_gain, chance_of_shifts
from jaxfric.prediction.model import SavedModel
from jaxfric.prediction.noise import noise_of_record, structure_columns
from jaxfric.prediction.result import Comparison, Prediction, Shift
from jaxfric.records import VelocitySteps
from jaxfric.records.record import Provenance

UM = 1e-6
NONE = np.zeros(3)


def prediction(rms, refit, sigma, *shifts):
    first = Comparison("fit", "friction", rms, "N", 0.1, rms / sigma)
    second = Comparison("fit", "closed loop", 99.0, "m", 0.1, None)  # is not what is spoken of
    return Prediction(
        "fit.json", Provenance(), "slider", "N", (first, second), {"f0": (0.0, 1.0)}, sigma, refit,
        shifts, NONE, NONE, NONE, None, (), (), 1.3, 0.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("rms", "refit", "sigma", "verdict"),
    [
        (1.09, 1.0, 1.0, "noise"),
        (1.11, 1.0, 1.0, "parameters"),
        (1.29, 1.29, 1.0, "noise"),
        (1.31, 1.31, 1.0, "model"),
        (1.45, 1.31, 1.0, "parameters"),
        (1.0, 1.2, 1.0, "noise"),  # a refit that went astray: no worse than what was predicted
    ],
)
def test_the_verdict_of_a_prediction(rms, refit, sigma, verdict):
    assert prediction(rms, refit, sigma).verdict == verdict


@pytest.mark.parametrize(
    ("rms", "refit", "chance", "verdict", "words"),
    [
        (1.3, 1.15, 0.0009, "parameters", "its parameters"),
        (1.3, 1.15, 0.0011, "noise", "which noise and the errors of the fitted parameters explain"),
        (1.19, 1.19, 0.5, "noise", "which is consistent with noise"),
        (1.21, 1.21, 0.5, "model", "(noise explains up to 1.2). Refitted to this record, the same"),
        (1.5, 1.21, 0.0011, "model", "is not significantly better (1.21 N)"),
        (1.5, 1.21, 0.0009, "parameters", "still above the noise"),
    ],
)
def test_the_verdict_counts_the_noise_and_the_errors_of_parameters(
    rms, refit, chance, verdict, words
):
    """A slider whose noise explains up to 1.2 times its standard deviation."""
    shift = Shift("A", 1.0, 9.0, 0.1)
    found = dataclasses.replace(prediction(rms, refit, 1.0, shift), largest=1.2, chance=chance)
    assert found.verdict == verdict and words in found.sentence
    assert found.sentence.startswith("Yes" if verdict == "noise" else "No")
    table = found.to_json()
    assert table["noise"] == {"sigma": 1.0, "largest_ratio": 1.2}
    assert table["chance_of_refit"] == chance


@pytest.mark.parametrize("refit", [1.31, 1.45])
def test_what_asks_further_is_the_verb_of_the_rig(refit):
    found = prediction(1.45, refit, 1.0)
    assert found.sentence.count("(find out with jaxfric loop)") == 1
    text = dataclasses.replace(found, kind="axis").sentence
    assert text == found.sentence.replace("jaxfric loop", "jaxfric axis")


@pytest.mark.parametrize(
    ("rms", "refit", "sigma", "shares"),
    [
        (2.0, 1.0, 0.5, (0.75, 0.1875, 0.0625)),
        (2.0, 2.0, 1.0, (0.0, 0.75, 0.25)),
        (2.0, 3.0, 1.0, (0.0, 0.75, 0.25)),  # a refit that is worse takes nothing away
        (2.0, 1.0, 1.5, (0.75, 0.0, 0.25)),  # the scatter is no more than what a refit leaves
    ],
)
def test_shares_of_the_mean_square(rms, refit, sigma, shares):
    found = prediction(rms, refit, sigma).shares()
    assert tuple(found[n] for n in ("parameters", "model", "noise")) == pytest.approx(shares)


@pytest.mark.parametrize(
    ("shift", "named"),
    [
        (Shift("A", 1.0, 1.29, 0.1), False),
        (Shift("A", 1.0, 1.31, 0.1), True),
        (Shift("A", 1.0, 0.69, 0.1), True),
        (Shift("A", 1.0, 9.0, math.nan), False),
        (Shift("A", 1.0, 9.0, 0.0), False),
        (Shift("f0", 0.0, 9.0, 0.1), False),  # it was fitted to this record
    ],
)
def test_parameters_that_differ_do_so_by_three_errors(shift, named):
    text = prediction(2.0, 1.0, 1.0, shift).sentence
    assert (f"its parameters have changed ({shift.name} differ)" in text) == named
    assert ("none differs by more than 3 of its errors" in text) != named


@pytest.mark.parametrize(
    ("here", "error", "in_sigma"), [(1.4, 0.2, 2.0), (0.6, 0.2, -2.0), (1.4, 0.0, math.nan)]
)
def test_a_shift_in_standard_errors(here, error, in_sigma):
    found = Shift("A", 1.0, here, error).in_sigma
    assert found == pytest.approx(in_sigma, nan_ok=True)


# ---- the saved model -------------------------------------------------------------------------


def saved(velocities, *, effects=("viscous",), **changes):
    def table(*names):
        return {"parameters": {n: {"value": 1.0, "std": 0.1} for n in names}, "free": list(names)}

    content = {
        "schema": "jaxfric.loop/2", "law": "slip", "friction_unit": "1", "effects": list(effects),
        "steps": [[10.0 * k, v] for k, v in enumerate(velocities)],
        "before": table("f0", "A", "gain.g"), "after": table("f0", "A", "gain.g", "viscous.c"),
    }  # fmt: skip
    return SavedModel(Path("loop.json"), {**content, **changes})


def test_a_loop_has_a_model_before_and_after():
    found = saved([UM])
    assert list(found.tables()) == ["before", "after"]
    assert list(saved([UM], effects=()).tables()) == ["before"]
    assert found.effects() == ("gain", "viscous")
    assert found.values("before") == {"f0": 1.0, "A": 1.0, "gain.g": 1.0}
    found.content["after"]["parameters"]["A"]["determined"] = False
    found.content["before"]["parameters"]["f0"]["determined"] = False
    assert found.undetermined() == ["A"]


@pytest.mark.parametrize(
    ("velocities", "speeds"),
    [([2 * UM, -9 * UM, 0.0, 3 * UM], (2 * UM, 9 * UM)), ([-UM], (UM, UM)), ([0.0], (0.0, np.inf))],
)
def test_speeds_that_a_model_has_seen(velocities, speeds):
    assert saved(velocities).speeds() == speeds
    steps = {"times": [0.0], "velocities": velocities}
    assert saved(velocities, steps=steps).speeds() == speeds


@pytest.mark.parametrize(
    ("here", "told"),
    [
        ([1, 10], None), ([11.9, 10], None), ([12.1, 10], "12.1"), ([-12.1, 0], "12.1"),
        ([0.84, 1, 0], None), ([0.82, 10], "0.82"), ([0.5, 1, 20], "0.5, 20"),
    ],
)  # fmt: skip
def test_velocities_beyond_those_of_the_model(here, told):
    """A model of 1 to 10 um/s, on a record of others: a fifth more is no extrapolation."""
    steps = VelocitySteps(np.arange(len(here)) * 9.0, np.asarray(here) * UM)
    texts = slider._warnings(SimpleNamespace(saved=saved([UM, 10 * UM]), steps=steps))
    assert len(texts) == (told is not None)
    assert told is None or f"({told} um/s) are outside" in texts[0]


# ---- an axis ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("share", "speed", "told"),
    [(0.04, 1.0, False), (0.06, 1.0, True), (1.0, 0.359, False), (1.0, 0.361, True),
     (0.06, -1.0, True)],
)  # fmt: skip
def test_rows_faster_than_any_of_the_model(share, speed, told):
    """A model of 0.3 m/s at most: of more than one row in twenty beyond a fifth more it is told."""
    velocity = np.where(np.arange(100) < 100 * share, speed, 0.1)
    velocity = velocity * np.where(np.arange(100) % 2, 1, -1)
    rows = SimpleNamespace(velocity=velocity, used=np.ones(100, bool))
    record = SimpleNamespace(length_unit="m")
    for made in (
        saved([0.3, -0.2]),
        saved([0.1], location_map=[{"variable": "velocity", "centres": [-0.3, None, 0.2]}]),
    ):
        texts = axis._warnings(SimpleNamespace(saved=made, rows=rows, record=record))
        assert len(texts) == told
        assert not told or "are faster than 0.3 m/s" in texts[0]


def test_a_record_of_one_direction_is_told():
    record = SimpleNamespace(length_unit="m")
    for back, told in ((-0.2, 0), (-1e-4, 1), (0.1, 1)):
        velocity = np.where(np.arange(100) < 50, 0.2, back)
        rows = SimpleNamespace(velocity=velocity, used=np.ones(100, bool))
        texts = axis._warnings(SimpleNamespace(saved=saved([0.3]), rows=rows, record=record))
        assert len(texts) == told and all("in one direction only" in text for text in texts)


def test_an_error_is_compared_with_what_was_recorded():
    error, recorded = np.asarray([3.0, -4.0]), np.asarray([6.0, 8.0])
    found = Comparison.of("fit", "m", error, recorded, "N", 0.5)
    assert found.rms == pytest.approx(np.sqrt(12.5)) and found.relative_error == pytest.approx(0.5)
    assert found.in_sigma == pytest.approx(np.sqrt(50))
    assert Comparison.of("fit", "m", error, recorded, "N", None).in_sigma is None


@pytest.mark.parametrize(("used", "told"), [(51, False), (34, True)])
def test_how_many_rows_a_prediction_rests_on_is_told_where_they_are_few(used, told):
    rows = SimpleNamespace(velocity=np.resize([0.2, -0.2], 100), used=np.arange(100) < used)
    record = type("Made", (), {"coordinate": "linear", "__len__": lambda self: 1170})()
    texts = axis._warnings(SimpleNamespace(saved=saved([0.3]), rows=rows, record=record))
    assert any("34 of 100 rows are compared (1170 in the file" in text for text in texts) is told


@pytest.mark.parametrize("count", [1e-6, 4e-6])
def test_the_noise_of_a_position_is_no_less_than_that_of_a_count(count):
    """An encoder that moves by one count a row in steps: a count is uniform over sqrt(12)."""
    position = count * np.floor(np.arange(1000) / 7)
    assert axis._position_noise(position) == pytest.approx(count / np.sqrt(12))
    noisy = position + 30 * count * np.random.default_rng(0).standard_normal(1000)
    assert axis._position_noise(noisy) == pytest.approx(30 * count, rel=0.1)
    assert axis._position_noise(np.zeros(10)) is None


@pytest.mark.parametrize("inside", [True, False])
def test_the_force_that_the_model_predicts_better_is_taken(monkeypatch, inside):
    """With and without the disturbance: of the rows that count, at the better model's values."""
    force, added, weight = np.asarray([5.0, 1.0, 1.0]), np.full(3, 2.0), np.asarray([0.0, 1, 1])
    truth = (force if inside else force + added) + np.asarray([-40.0, 0.1, 0.1])
    record = SimpleNamespace(motor_force=force, disturbance_force=added)

    def prepared(saved, record, force, held, inside):
        problem = SimpleNamespace(friction=force, weight=weight)
        return SimpleNamespace(problem=problem, inside=inside)

    def error(problem, values):
        assert "viscous.c" in values
        return truth - problem.friction

    monkeypatch.setattr(axis, "_prepared", prepared)
    monkeypatch.setattr(axis, "_force_error", error)
    assert axis._setting(saved([0.3]), record, None).inside is inside
    record.disturbance_force = np.zeros(3)
    assert axis._setting(saved([0.3]), record, None).inside is None


# ---- how far parameters went -----------------------------------------------------------------


def test_the_error_of_an_axis_shift_is_that_of_both_fits(monkeypatch):
    """A is exp z. The record does not determine B."""
    z, spread = np.asarray([9.0, 1.5, np.log(2.0), 3.0]), np.diag([0.09, 0.0025, 1.0])
    problem = SimpleNamespace(
        model=SimpleNamespace(names=lambda: ("c", "f0", "A", "B")),
        coordinates=SimpleNamespace(
            from_free=lambda z: np.where(np.arange(4) == 2, np.exp(z), z),
            slopes=lambda z: np.where(np.arange(4) == 2, np.exp(z), 1.0),
        ),
    )  # fmt: skip
    made = saved([UM])
    table = made.content["after"]["parameters"]
    table["f0"]["std"], table["B"] = 0.4, {"value": 1.0}
    monkeypatch.setattr(axis, "_known", lambda setting, refit: np.asarray([True, True, False]))
    refit = SimpleNamespace(z=z, index=np.asarray([1, 2, 3]), spread=spread)
    setting = SimpleNamespace(saved=made, problem=problem)
    first, second, third = axis._shifts(setting, "after", refit)
    assert (first.name, first.model, first.here) == ("f0", 1.0, 1.5)
    assert first.error == pytest.approx(0.5) and first.in_sigma == pytest.approx(1.0)
    assert second.error == pytest.approx(np.hypot(0.1, 2.0 * 0.05)) and second.here == 2.0
    assert math.isnan(third.error)


@pytest.mark.parametrize("at", [0.0, 0.4])
def test_the_chance_of_an_axis_is_that_of_chi_square(monkeypatch, at):
    """The model knows only F_v and M = exp z. F_0 is at a bound; no record determines F_c."""
    rng = np.random.default_rng(8)
    jacobian, mass = rng.standard_normal((80, 4)) * [1, 1, 9, 0], np.exp(at)
    model = np.asarray([at, 2.0, 0.0, 7.0])
    problem = SimpleNamespace(
        model=SimpleNamespace(names=lambda: ("M", "F_v", "F_c", "F_0")), noise_scale=2.0,
        weight=np.arange(80) < 70,
        coordinates=SimpleNamespace(slopes=lambda z: np.asarray([np.exp(z[0]), 1.0, 1.0, 0.0])),
    )  # fmt: skip
    before, here = np.diag([0.04, 0.3, 50.0, 0.0]), np.diag([0.01, 0.2, 60.0, 1.0])
    made = saved([UM])
    made.content["after"] |= {"free": ["M", "F_v", "F_c", "F_0"], "covariance": before.tolist()}
    made.content["after"]["parameters"] = {
        n: {"value": float(v)}
        for n, v in zip(("M", "F_v", "F_c", "F_0"), (mass, 2.0, 0.0, 7.0), strict=True)
    }
    known = np.asarray([True, True, False, True])
    monkeypatch.setattr(axis, "_known", lambda setting, refit: known)
    monkeypatch.setattr(axis, "_free", lambda problem, values: model)
    setting = SimpleNamespace(saved=made, problem=problem)
    for level in (0.3, 1e-3, 1e-8):
        way = np.sqrt(stats.chi2.isf(level, 2))
        # along F_v alone: its variance does not depend on M
        shift = way * np.sqrt(0.3 + 0.2)
        refit = SimpleNamespace(
            z=model + np.asarray([0.0, shift, 0.1, 30.0]), index=np.arange(4),
            residual=np.zeros(80), jacobian=jacobian, spread=here,
        )  # fmt: skip
        monkeypatch.setattr(axis, "_force_error", lambda problem, values: np.zeros(80))
        chance = axis._chance(setting, "after", refit)
        assert chance == pytest.approx(level, rel=1e-6)
    still = SimpleNamespace(**{**vars(refit), "z": model})
    error = np.where(problem.weight, 1.0, 99.0)
    errors = np.diag([0.04 / mass**2 + 0.01, 0.5, 110.0])
    curvature = jacobian[:, :3].T @ jacobian[:, :3]
    draws = rng.standard_normal((40_000, 3)) * np.sqrt(np.diag(errors))
    gains = np.einsum("ni,ij,nj->n", draws, curvature, draws)
    for level in (0.5, 0.1, 0.01):
        size = 2.0 * np.sqrt(np.quantile(gains, 1 - level) / 70)
        monkeypatch.setattr(axis, "_force_error", lambda *_, size=size: size * error)
        assert axis._chance(setting, "after", still) == pytest.approx(level, rel=0.35)


def test_the_chance_of_a_gain_along_equal_directions_is_exact():
    found = chance_of_gain(17.0, np.eye(5), 2 * np.eye(5))
    assert found == pytest.approx(stats.chi2.sf(17.0 / 2, 5))


def test_the_larger_errors_of_a_shift_count():
    errors = [np.diag([1.0, 9.0]), np.diag([4.0, 1.0])]
    found = chance_of_shifts(np.asarray([2.0, 3.0]), errors)
    assert found == pytest.approx(stats.chi2.sf(min(4.0 + 1.0, 1.0 + 9.0), 2))
    assert chance_of_shifts(np.zeros(0), [np.zeros((0, 0))]) == 1.0


def test_the_error_of_a_slider_shift_counts_correlated_noise_and_its_own_fit(monkeypatch):
    """Two parameters and the time of a step, held by a residual of variance 1; A is exp z."""
    rng, rows = np.random.default_rng(3), 12
    columns = rng.standard_normal((rows, 3))
    jacobian = np.concatenate([columns, [[0.0, 0.0, 1.0]]])
    root = rng.standard_normal((rows, rows)) / 9
    problem = SimpleNamespace(
        model=SimpleNamespace(names=lambda: ("f0", "A")),
        time=np.arange(rows), clock=None, weight=None, noise_scale=2.0,
        coordinates=SimpleNamespace(from_free=lambda z: np.asarray([z[0], np.exp(z[1])])),
    )  # fmt: skip
    z = np.asarray([0.5, 0.0, 0.3])
    refit = SimpleNamespace(
        z=z, values={"f0": 0.5, "A": 1.0}, error=np.ones(rows), jacobian=jacobian
    )
    monkeypatch.setattr(slider, "sandwich", lambda clock, J, noise: J.T @ root @ root.T @ J)
    made = saved([UM])
    for name in ("gain.g", "viscous.c"):
        made.content["after"]["free"].remove(name)
    setting = SimpleNamespace(saved=made, problem=problem)
    of_refit = slider._spread(setting, "after", refit, None)
    first, second = slider._shifts(setting, "after", refit, of_refit)
    data = np.zeros((rows + 1, rows + 1))
    data[:rows, :rows], data[rows, rows] = root @ root.T, 1.0
    P = np.linalg.pinv(jacobian)
    spread = np.sqrt(np.diag(P @ data @ P.T))
    assert first.error == pytest.approx(np.hypot(0.1, spread[0]), rel=1e-6)
    assert second.error == pytest.approx(np.hypot(0.1, np.sinh(spread[1])), rel=1e-6)
    assert (first.model, first.here, second.here) == (1.0, 0.5, 1.0)
    made.content["after"]["parameters"]["A"]["determined"] = False
    first, second = slider._shifts(setting, "after", refit, of_refit)
    assert first.error > 0 and math.isnan(second.error) and math.isnan(second.in_sigma)


# ---- noise, and errors of the parameters -----------------------------------------------------


def slow(rng, rows, memory, share):
    """Noise of variance 1: a `share` correlated over `memory` rows (AR(1)), the rest white."""
    keep, found = np.exp(-1 / memory), np.zeros(rows)
    found[0] = rng.standard_normal()
    for k, kick in enumerate(np.sqrt(1 - keep**2) * rng.standard_normal(rows - 1), 1):
        found[k] = keep * found[k - 1] + kick
    return np.sqrt(share) * found + np.sqrt(1 - share) * rng.standard_normal(rows)


def rows_of_steps(rows=1200):
    """A record of three velocity steps: what `noise_of_record` asks of its problem."""
    time, step = np.arange(rows) * 0.1, np.arange(rows) // (rows // 3)
    path = np.cumsum(np.asarray([1.0, 10.0, 1.0])[step]) * 0.1 * UM
    clock = np.stack([time, path, np.arange(rows, dtype=float)], axis=1)
    friction = np.random.default_rng(0).standard_normal(rows)
    return SimpleNamespace(time=time, clock=clock, friction=friction, noise_scale=0.5), step


def test_the_noise_of_a_record_counts_what_is_correlated():
    """AR(1) over eight rows with white noise: its rms over sigma is within what noise explains."""
    problem, step = rows_of_steps()
    level = np.ones((len(step), 1))
    found = [
        noise_of_record(
            problem, step, slow(np.random.default_rng(k), len(step), 8.0, 0.6), level
        ).told
        for k in range(6)
    ]
    sigmas = np.asarray([one.sigma for one in found])
    assert np.mean(sigmas) == pytest.approx(0.5, rel=0.08)  # in units of noise_scale
    # closed form of the relative error of the rms: r_k = .6 exp(-k/8) for k > 0
    q = np.exp(-2 / 8)
    error = np.sqrt(0.5 * (1 + 2 * 0.36 * q / (1 - q)) / len(step))
    largest = np.asarray([one.largest for one in found])
    assert np.median(largest) == pytest.approx(1 + 3.143 * np.sqrt(2) * error, rel=0.04)
    assert all(0.4 < one.share < 0.8 for one in found)


@pytest.mark.parametrize("seed", range(5, 9))
def test_structure_along_the_path_is_no_noise(seed):
    """A hump after every step, as a missing state leaves it: sigma stays near that of the noise."""
    problem, step = rows_of_steps()
    since = np.concatenate([np.arange(400) * v for v in (0.1, 1.0, 0.1)]) * UM
    hump = np.where(step > 0, 8 * since / (8 * UM) * np.exp(1 - since / (8 * UM)), 0.0)
    noise = np.random.default_rng(seed).standard_normal(len(step))
    found = noise_of_record(problem, step, hump + noise, np.ones((len(step), 1))).told
    assert np.sqrt(np.mean((hump + noise) ** 2)) > 3
    assert found.sigma * found.largest < 0.5 * 1.5


def test_the_noise_of_a_short_record():
    """Thirty rows are too few for the smooth columns."""
    problem, step = rows_of_steps(30)
    found = [
        noise_of_record(
            problem, step, np.random.default_rng(k).standard_normal(30), np.ones((30, 1))
        ).told
        for k in range(5)
    ]
    assert np.mean([one.sigma for one in found]) == pytest.approx(0.5, rel=0.2)
    assert all(1.2 < one.largest < 2.5 for one in found)


def test_slow_noise_of_a_short_record_is_noise():
    """AR(1) over six of 240 rows: sigma is that of the noise, not of its white half; and the
    covariance of the refit has the same noise."""
    problem, step = rows_of_steps(240)
    level = np.ones((len(step), 1))
    for k in range(8):
        made = slow(np.random.default_rng(k), len(step), 6.0, 0.5)
        found = noise_of_record(problem, step, made, level)
        assert found.told.sigma * found.told.largest > 0.5 * np.std(made)
        assert found.told.sigma == pytest.approx(0.5 * np.std(made), rel=0.05)
        assert found.noise.sigma * 0.5 == pytest.approx(found.told.sigma)
        assert 1 - found.noise.white == pytest.approx(found.told.share)


@pytest.mark.parametrize("share", [0.25, 2.0])
def test_the_structure_columns_hold_a_second_state(share: float):
    """du/dx = (ln V - u)/D, solved by SciPy's Runge-Kutta from step to step, is one of the columns;
    D is a share of the mean path of a step. Projected out, it is no noise."""
    problem, step = rows_of_steps()
    path = problem.clock[:, 1]
    D, bounds = share * np.ptp(path) / 3, [0.0, 40 * UM, 440 * UM, path[-1]]
    state, u = np.zeros(len(step)), 0.0
    for k, aim in enumerate([0.0, np.log(10.0), 0.0]):
        own = solve_ivp(
            lambda x, u, aim=aim: (aim - u) / D, bounds[k : k + 2], [u], rtol=1e-9, atol=1e-12,
            dense_output=True,
        )  # fmt: skip
        state[step == k], u = own.sol(path[step == k])[0], own.y[0, -1]
    columns = structure_columns(problem.clock, step)
    beside = state - columns @ np.linalg.lstsq(columns, state, rcond=None)[0]
    assert np.std(beside) < 5e-3 * np.std(state)
    noise = np.random.default_rng(3).standard_normal(len(step))
    made = 2 * state / np.std(state) + noise
    found = noise_of_record(problem, step, made - made.mean(), np.ones((len(step), 1)))
    assert found.told.sigma == pytest.approx(0.5, rel=0.06) and found.slow is None
    assert found.noise.sigma * 0.5 > 2 * found.told.sigma  # its errors count the misfit


def test_noise_at_the_limit_is_said():
    """Noise over a fifth of the record: its part in rows or time is at the limit, a tenth."""
    problem, step = rows_of_steps(600)
    made = slow(np.random.default_rng(0), len(step), 120.0, 0.7)
    found = noise_of_record(problem, step, made, np.ones((len(step), 1)))
    assert (
        found.slow.over in ("time", "rows")
        and found.slow.memory > {"time": 5, "rows": 50}[found.slow.over]
    )
    assert [one.code for one in slider._limits(found)] == ["noise_at_its_limit"]
    short = noise_of_record(
        problem, step, slow(np.random.default_rng(0), 600, 6.0, 0.7), np.ones((600, 1))
    )
    assert slider._limits(short) == ()


def test_a_part_that_is_correlated_too_far_along_the_path_is_misfit():
    """Nearly all of the residual is correlated over half a step of the path, and none of it seen
    by the smooth columns: sigma is that of the white rest."""
    problem, step = rows_of_steps()
    path = problem.clock[:, 1]
    rng = np.random.default_rng(7)
    wander = np.zeros(len(step))
    for k in range(1, len(step)):
        keep = np.exp(-(path[k] - path[k - 1]) / (60 * UM))
        wander[k] = keep * wander[k - 1] + np.sqrt(1 - keep**2) * rng.standard_normal()
    residual = 5 * wander + 0.1 * rng.standard_normal(len(step))
    found = noise_of_record(problem, step, residual, np.ones((len(step), 1))).told
    assert found.sigma < 0.2 * 0.5 * np.std(residual) and found.largest < 1.15


def test_the_chance_of_a_refit_is_that_of_draws():
    """Two fits of one law, with errors of two covariances: the fall of the sum of squares where
    both fit f0, and only the refit A and B, drawn by NumPy; B is exp z."""
    rng, rows = np.random.default_rng(11), 60
    jacobian = rng.standard_normal((rows, 3))
    jacobian[:, 0] = 1.0
    values = np.asarray([0.5, 1.0, np.exp(0.4)])
    slopes = np.asarray([1.0, 1.0, values[2]])
    problem = SimpleNamespace(
        model=SimpleNamespace(names=lambda: ("f0", "A", "B")), noise_scale=2.0,
        coordinates=SimpleNamespace(slopes=lambda z: slopes),
    )  # fmt: skip
    root, other = rng.standard_normal((2, 3, 3)) * 0.3
    made = saved([UM])
    table = made.content["after"]
    table["free"] = ["f0", "A", "B"]
    table["covariance"] = (slopes[:, None] * (root @ root.T) * slopes).tolist()
    setting, spread = SimpleNamespace(saved=made, problem=problem), other @ other.T
    apart = rng.standard_normal((20_000, 3)) @ np.linalg.cholesky(root @ root.T + spread).T
    moved = apart[:, 1:] @ jacobian[:, 1:].T
    gains = np.sum((moved - moved.mean(axis=1, keepdims=True)) ** 2, axis=1)
    refit = SimpleNamespace(z=np.zeros(3), error=np.zeros(rows), jacobian=jacobian)
    at = np.zeros(3)  # no shift: the gain alone is tested
    for level in (0.5, 0.1, 0.01):
        error = 2.0 * np.sqrt(np.quantile(gains, 1 - level) / rows) * np.ones(rows)
        found = SimpleNamespace(z=at, error=error)
        chance = slider._chance(setting, "after", ("f0",), found, refit, spread)
        assert chance == pytest.approx(level, rel=0.35)
    assert slider._chance(setting, "after", ("f0", "A", "B"), found, refit, spread) == 1.0


@pytest.mark.parametrize(("loose", "at"), [((), 0.0), ((), 0.4), ((), -0.4), (("B",), 0.0)])
def test_the_chance_of_shifts_is_that_of_chi_square(loose, at):
    """The model hardly knows B, which would explain the fall of the sum of squares, but no shift of
    A. B is exp z, so that its errors differ between model (`at`) and refit (0). d is at a bound."""
    jacobian = np.random.default_rng(2).standard_normal((60, 4)) * [1, 1, 1, 0]
    problem = SimpleNamespace(
        model=SimpleNamespace(names=lambda: ("f0", "A", "B", "d")), noise_scale=1.0,
        coordinates=SimpleNamespace(slopes=lambda z: np.asarray([1.0, 1.0, np.exp(z[2]), 0.0])),
    )  # fmt: skip
    before = np.zeros((4, 4))
    before[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.01, 0.2], [0.0, 0.2, 13.0]]
    made = saved([UM])
    table = made.content["after"]
    table["free"], table["covariance"] = ["f0", "A", "B", "d"], before.tolist()
    for name in loose:
        table["parameters"][name] = {"value": 1.0, "std": 3.6, "determined": False}
    setting, spread = SimpleNamespace(saved=made, problem=problem), 0.01 * np.eye(4)

    def least(a):
        """d^T C^-1 d where it is smaller, C in closed form."""
        if loose:
            return a**2 / (0.01 + 0.01)
        values = []
        for slope in (np.exp(at), 1.0):
            aa, ab, bb = 0.01 + 0.01, 0.2 / slope, 13.0 / slope**2 + 0.01
            values.append((bb * a**2 + 2 * ab * a * at + aa * at**2) / (aa * bb - ab**2))
        return min(values)

    for level in (0.1, 1e-3, 1e-9):
        limit = stats.chi2.isf(level, 1 if loose else 2)
        a = brentq(lambda a, limit=limit: least(a) - limit, 0.03, 5.0)
        moved = jacobian[:, 1:3] @ np.asarray([a, -at])
        basis = jacobian[:, 0] / np.linalg.norm(jacobian[:, 0])
        found = SimpleNamespace(
            z=np.asarray([0.0, 0.0, at, 36.0]), error=moved - basis * (basis @ moved)
        )
        refit = SimpleNamespace(
            z=np.asarray([0.3, a, 0.0, 40.0]), error=np.zeros(60), jacobian=jacobian
        )
        chance = slider._chance(setting, "after", ("f0",), found, refit, spread)
        assert chance == pytest.approx(level, rel=1e-5)
