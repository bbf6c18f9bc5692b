"""The search for gains, against minimisation and brute force with NumPy and SciPy alone."""

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from gains_reference import critical, local_minima, modulus_scan, random_case

import jaxfric as jf
from jaxfric.errors import InputError
from jaxfric.gains import (
    LawSource,
    Requirement,
    find_gains,
    gain_schedule,
    law_from_fit,
    law_from_parameters,
)
from jaxfric.gains.frontier import GainTask, Region
from jaxfric.gains.gains import _warnings
from jaxfric.gains.margins import slacks
from jaxfric.gains.result import LocalOptimum, WorstCase
from jaxfric.gains.scenarios import Scenarios
from jaxfric.gains.solve import Infeasible, NoGains, make_region, solve
from jaxfric.gains.verify import JumpSizes
from jaxfric.laws.source import stack
from jaxfric.report import gains as gains_report
from jaxfric.rig.friction import GaussianStribeck
from jaxfric.saved.entry import seen_velocities

FREE = ((None, None),) * 3
GOLDEN = dict(A=1.0, B=3.0, L=1e-3, V=2e-3, m=2.0)


def rate_state(A, B, L, V):
    """At f0 = 40 A the regularised direct effect is the logarithmic one to rounding."""
    values = 40 * A, A, np.atleast_1d(B), np.atleast_1d(L), V
    arrays = (jnp.asarray(x, float) for x in values)
    return jf.RateState(*arrays, jf.SlipEvolution(), jf.RegularisedEffect())


def single(p, margins, scale=(None, None), **more):
    """All local optima for one scenario."""
    law = stack([rate_state(p["A"], p["B"], p["L"], p["V"])])
    scenarios = Scenarios.product(law, [p["V"]], [p["m"]])
    region = make_region(scenarios, scale, more.get("lower", FREE[0]), more.get("upper", FREE[0]))
    return solve(GainTask(Requirement(margins), scenarios, region))


def golden_source():
    return law_from_parameters("slip", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")


# ---- one scenario ----------------------------------------------------------------------------


def test_random_cases_against_minimisation_in_one_dimension():
    """k_cr(k_v) of (25) is convex, so the norm has one minimum, near either end by its scales."""
    rng, nearer = np.random.default_rng(11), []
    for _ in range(12):
        p, scale = random_case(rng)
        (norm, kv, kp), *rest = local_minima(p, scale)
        found = single(p, {"stiffness": 1.0}, scale)
        assert not rest and len(found.optima) == 1
        best = found.optima[0]
        assert best.norm == pytest.approx(norm, rel=1e-6)
        # a minimum is known to the square root of what its value is known to
        np.testing.assert_allclose(
            best.gains / scale, (kp / scale[0], kv / scale[1]), atol=1e-5 * norm
        )
        assert (
            best.residual < 1e-9
            and found.certificate.smaller_found == 0
            and found.certificate.grid_points > 1e4
        )
        nearer.append(kp / scale[0] > kv / scale[1])
    assert 2 < sum(nearer) < 10


def test_reference_finds_a_planted_second_minimum():
    """The reference is no better than its search: with two dips it must return two."""
    p, scale = GOLDEN, (1000.0, 500.0)
    (norm, kv, kp), *_ = local_minima(p, scale)
    assert kp == pytest.approx(critical(kv, **p))
    grid = np.linspace(0, 1000, 100001)
    brute = np.min(np.hypot(critical(grid, **p) / scale[0], grid / scale[1]))
    assert norm == pytest.approx(brute, rel=1e-8)


def test_both_ways_of_holding_are_reported():
    """One minimum here; stiffness alone and damping alone are told as what they are."""
    p = GOLDEN
    gains = find_gains(
        golden_source(), velocity=p["V"], mass=p["m"], margin={"modulus": 0, "stiffness": 1.0}
    )
    best, *others = gains.optima
    assert best.minimum and (gains.kp, gains.kv, gains.norm) == (best.kp, best.kv, best.norm)
    assert [b.minimum for b in others] == [False, False]
    stiff, damped = sorted(others, key=lambda b: b.kv)
    assert (stiff.name, damped.name) == ("stiff", "damped")
    assert stiff.kp == pytest.approx(critical(0.0, **p), rel=1e-7) and stiff.kv == 0
    assert damped.kv == pytest.approx((p["B"] - p["A"]) / p["V"], rel=1e-7)
    assert all(b.norm > best.norm for b in others)
    assert gains.margins["stiffness"].value == pytest.approx(1.0, rel=1e-9)
    assert gains.margins["stiffness"].scenario == {"velocity": 2e-3, "mass": 2.0, "sample": 0}


def test_kkt_by_finite_differences():
    """W^2 x is along the gradient of the active constraint, here of (25) by differences."""
    p, scale = dict(GOLDEN, m=500.0), (3000.0, 700.0)
    (best,) = single(p, {"stiffness": 1.3}, scale).optima
    kp, kv = best.gains
    h = 1e-5 * kv
    slope = 1.3 * (critical(kv + h, **p) - critical(kv - h, **p)) / (2 * h)
    pull = np.array([kp / scale[0] ** 2, kv / scale[1] ** 2])
    normal = np.array([1.0, -slope])
    assert kp == pytest.approx(1.3 * critical(kv, **p), rel=1e-9)
    cross = pull[0] * normal[1] - pull[1] * normal[0]
    assert abs(cross) < 1e-7 * np.linalg.norm(pull) * np.linalg.norm(normal)
    assert pull @ normal > 0 and best.residual < 1e-9


def test_limits_of_the_gains():
    p = GOLDEN
    (best,) = single(p, {"stiffness": 1.0}, upper=(None, 300.0)).optima
    assert best.gains[1] == pytest.approx(300.0) and best.at_limit
    assert best.gains[0] == pytest.approx(critical(300.0, **p), rel=1e-9)
    (best,) = single(p, {"stiffness": 1.0}, lower=(1500.0, None)).optima
    kp, kv = best.gains
    assert kp == pytest.approx(1500.0) and critical(kv, **p) == pytest.approx(1500.0, rel=1e-8)


def test_an_optimum_at_a_double_pole():
    """Without mass X s^2 + (X r - B/L + k_p) s + k_p r = 0 with X = A/V + k_v, r = V/L. Where k_p
    counts most, the least gains put both poles at -d: k_p r = d^2 X and X = (B/L) r/(r - d)^2."""
    p, d = GOLDEN, 0.5
    law, r = rate_state(p["A"], p["B"], p["L"], p["V"]), p["V"] / p["L"]
    found = find_gains(
        law, velocity=p["V"], mass=None, margin={"modulus": 0, "decay": d}, scale=(300.0, 1500.0)
    )
    X = p["B"] / p["L"] * r / (r - d) ** 2
    np.testing.assert_allclose((found.kp, found.kv), (d**2 * X / r, X - p["A"] / p["V"]), rtol=1e-9)
    assert found.certificate.kkt_residual < 1e-9 and found.certificate.smaller_found == 0


def test_infeasible_says_which_scenario_and_by_how_much():
    found = single(GOLDEN, {"stiffness": 1.0}, upper=(100.0, 10.0))
    assert isinstance(found, Infeasible)
    assert "stiffness=1 is missed at velocity 2 mm/s, mass 2 kg" in found.text
    reached = float(found.text.split("reaches ")[1].split(";")[0])
    assert reached == pytest.approx(100 / critical(10.0, **GOLDEN), rel=1e-2)


def test_infeasible_names_a_scenario_that_is_infeasible_alone():
    """m s + f_v + k_v + ... with 1.5 samples of delay T: no PD gains where T |f_v|/m > 1.

    f_v = 50 - (5/0.002) exp(-V/0.002) N s/m: T |f_v|/m is 2.85 at 0.5 mm/s and 1 kg, the largest of
    all; at 3 kg, 5 mm/s and 10 mm/s it is below 1.
    """
    text = "c0=10 N, c1=50 N*s/m, c2=5 N, c3=2 mm/s, c4=1"
    given = {"integral_gain": 5000.0, "sample_time": 1e-3}
    with pytest.raises(NoGains) as refused:
        find_gains(
            law_from_parameters("stribeck", text),
            velocity=[5e-4, 5e-3, 1e-2],
            mass="1..3 kg",
            **given,
        )
    found = refused.value.found
    assert found.alone and found.scenario == {"velocity": 5e-4, "mass": 1.0, "sample": 0}
    assert "unstable" in found.text and "reaches" not in found.text


@pytest.mark.long
def test_margins_that_contradict_each_other():
    """A delay margin of 10 s allows no gains as large as the decay rate needs."""
    found = single(GOLDEN, {"decay": 5.0, "delay": 10.0})
    assert isinstance(found, Infeasible)
    assert re.search(r"(decay|delay)=.* is missed at velocity", found.text)


def test_that_there_are_no_gains_is_an_error_of_its_kind():
    """Of the kind `NoGains` where gains were asked for; wrong input is not of that kind.

    B > A needs k_p > (B - A)/L of 2 kN/m, or k_v > (B - A)/V of 1 kN s/m.
    """
    law = jf.RateState(50.0, 1.0, [3.0], [1e-3], 2e-3)
    asked = {"velocity": 2e-3, "mass": None, "margin": {"modulus": 0.2}, "upper": (1e3, 500.0)}
    with pytest.raises(NoGains) as refused:
        find_gains(law, **asked)
    assert isinstance(refused.value.found, Infeasible)
    assert "k_p up to 1 kN/m" in str(refused.value) == refused.value.found.text
    for wrong in ({"velocity": -1.0}, {"confidence": 2.0}, {"upper": (-1.0, None)}):
        with pytest.raises(InputError) as refused:
            find_gains(law, **{**asked, **wrong})
        assert not isinstance(refused.value, NoGains)


@pytest.mark.long
def test_a_band_that_narrows_is_no_second_optimum():
    """A decay rate beyond V/L is met in a band of stiffness that narrows as damping grows: between
    the points of a grid it is lost and found again, and every end of it looks like a minimum."""
    p = dict(A=1.0, B=10.3746, L=1.0677944e-3, V=2e-3, m=116.23403)
    found = single(p, {"decay": 2.52399})
    (optimum,) = found.optima
    unit = found.task.region.unit
    v = np.geomspace(0.02, 5, 160)
    u = np.geomspace(0.3, 8, 4000)
    # the frontier by NumPy's companion matrices: least k_p for each k_v
    m, d, r, g = p["m"], p["A"] / p["V"], p["V"] / p["L"], p["B"] / p["L"]
    least = np.full(v.size, np.inf)
    for i, kv in enumerate(v * unit[1]):
        kp = u * unit[0]
        whole = np.zeros((kp.size, 3, 3))
        whole[:, 0, 0], whole[:, 0, 1] = -(m * r + kv + d) / m, -((kv + d) * r + kp - g) / m
        whole[:, 0, 2] = -kp * r / m
        whole[:, 1, 0] = whole[:, 2, 1] = 1.0
        good = np.linalg.eigvals(whole).real.max(axis=1) <= -2.52399
        least[i] = u[np.argmax(good)] if good.any() else np.inf
    held = np.isfinite(least)
    v, norm = v[held], np.hypot(least, v)[held]
    best = int(np.argmin(norm))
    assert norm[best] == pytest.approx(optimum.norm, rel=1e-3)
    assert v[best] * unit[1] == pytest.approx(optimum.gains[1], rel=0.05)
    rising = np.diff(norm)
    assert np.all(rising[: best - 2] < 0) and np.all(rising[best + 2 :] > 0)


# ---- many scenarios --------------------------------------------------------------------------


def sampled_laws(number, seed=5):
    """Parameters of the law spread by a tenth; rows (A, B, L)."""
    rng = np.random.default_rng(seed)
    return np.exp(np.log([1.0, 3.0, 1e-3]) + 0.1 * rng.standard_normal((number, 3)))


def sampled_source(number):
    laws = [rate_state(A, B, L, 2e-3) for A, B, L in sampled_laws(number)]
    return LawSource(laws[0], stack(laws), "samples", 2e-3)


VELOCITIES, MASSES = np.geomspace(5e-4, 2e-2, 8), np.linspace(1, 4, 2)


def scenario_columns(number):
    A, B, L = (x[:, None, None] for x in sampled_laws(number).T)
    V, m = VELOCITIES[:, None], MASSES
    return [x.ravel() for x in np.broadcast_arrays(A, B, L, V, m)]


@pytest.fixture(scope="module")
def robust():
    margins = {"stiffness": 1.2, "modulus": 0.5}
    return find_gains(sampled_source(8), velocity=VELOCITIES, mass=MASSES, margin=margins)


def test_robust_gains_violate_nothing(robust):
    A, B, L, V, m = scenario_columns(8)
    kp, kv = robust.kp, robust.kv
    ratio = kp / np.maximum(critical(kv, A, B, L, V, m), 1e-300)
    modulus = modulus_scan(kp, kv, A, B, L, V, m)
    assert ratio.min() > 1.2 * (1 - 1e-7) and modulus.min() > 0.5 * (1 - 1e-6)
    assert modulus.min() == pytest.approx(robust.margins["modulus"].value, rel=1e-5)
    assert ratio.min() == pytest.approx(robust.margins["stiffness"].value, rel=1e-6)
    assert robust.certificate.kkt_residual < 1e-8 and robust.certificate.smaller_found == 0
    where = robust.margins["modulus"].scenario
    at = np.argmin(modulus)
    assert (where["velocity"], where["mass"]) == (pytest.approx(V[at]), pytest.approx(m[at]))


def test_robust_gains_are_smallest_on_a_grid(robust):
    """Of 60 x 60 gains below 1.2 times the norm none that is feasible is smaller by 0.1 %."""
    columns = scenario_columns(8)
    s_p, s_v = robust.region.scale
    u, v = (1.2 * robust.norm * np.linspace(1 / 60, 1, 60) * s for s in (s_p, s_v))
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    norm = np.hypot(grid[:, 0] / s_p, grid[:, 1] / s_v)
    grid = grid[norm < (1 - 1e-3) * robust.norm]
    assert len(grid) > 1000
    hardest = np.argsort(modulus_scan(robust.kp, robust.kv, *columns, points=300))
    for i in hardest[:40]:
        parameters = [x[i] for x in columns]
        good = grid[:, 0] >= 1.2 * critical(grid[:, 1], *parameters)
        grid = grid[good]
        if len(grid):
            grid = grid[modulus_scan(*grid.T, *parameters, points=400) >= 0.5]
    assert len(grid) == 0


def test_grid_would_notice_gains_that_are_too_large(robust):
    columns = scenario_columns(8)
    smaller = modulus_scan(0.998 * robust.kp, 0.998 * robust.kv, *columns)
    assert smaller.min() < 0.5
    assert modulus_scan(1.01 * robust.kp, 1.01 * robust.kv, *columns).min() > 0.5


def test_worst_velocity_between_the_given_ones_is_found():
    """With mass k_cr rises with velocity and falls where k_v helps: worst at neither end."""
    p = dict(A=1.0, B=3.0, L=1e-3, m=50.0)
    given = np.array([1e-3, 5e-3, 0.2])
    law = rate_state(p["A"], p["B"], p["L"], 2e-3)
    found = find_gains(
        law,
        velocity=given,
        mass=p["m"],
        margin={"modulus": 0, "stiffness": 1.0},
        upper=(None, 20.0),
    )
    V = np.geomspace(given[0], given[-1], 4001)
    k_cr = critical(found.kv, V=V, **p)
    worst = V[np.argmax(k_cr)]
    assert np.min(np.abs(np.log(worst / given))) > 0.3
    assert k_cr.max() > 1.2 * critical(found.kv, V=given, **p).max()
    assert found.kp == pytest.approx(k_cr.max(), rel=2e-3)
    assert len(found.scenarios) > given.size


def test_confidence_leaves_out_the_hardest_samples(monkeypatch):
    source = sampled_source(20)
    margins = {"modulus": 0, "stiffness": 1.0}
    every = find_gains(source, velocity=2e-3, mass=2.0, margin=margins)
    most = find_gains(source, velocity=2e-3, mass=2.0, margin=margins, confidence=0.9)
    A, B, L = sampled_laws(20).T
    missed = most.kp < critical(most.kv, A, B, L, 2e-3, 2.0) * (1 - 1e-7)
    assert 0 < missed.sum() <= 2 and most.kept_samples == 18
    assert most.norm < every.norm
    assert np.all(every.kp >= critical(every.kv, A, B, L, 2e-3, 2.0) * (1 - 1e-7))
    monkeypatch.setattr("jaxfric.gains.solve.ROUNDS", 1)
    monkeypatch.setattr("jaxfric.gains.solve._first", lambda task: np.arange(1))
    with pytest.raises(InputError, match="still changed after 1 rounds"):
        find_gains(source, velocity=2e-3, mass=2.0, margin=margins)
    with pytest.raises(InputError, match="confidence is 2"):
        find_gains(source, velocity=2e-3, mass=2.0, margin=margins, confidence=2.0)


# ---- other laws ------------------------------------------------------------------------------


def test_gaussian_stribeck_needs_damping_at_its_hardest_velocity():
    law = GaussianStribeck(*(jnp.asarray(c) for c in (1.0, 0.4, 2.0, 0.05)))
    V = np.geomspace(1e-3, 1e-1, 25)
    found = find_gains(
        law, velocity=V, mass=1.0, margin={"modulus": 0, "stiffness": 1.0}, lower=(10.0, None)
    )
    needed = np.sqrt(2) * 2.0 / 0.05 * np.exp(-0.5) - 0.4  # (17)
    assert found.kv == pytest.approx(needed, rel=1e-6) and found.kp == pytest.approx(10.0)
    assert found.margins["stiffness"].value == np.inf  # damping suffices
    for name in ("decay", "modulus"):
        value = found.margins[name].value
        assert np.isfinite(value) and abs(value) < 1e-2
    assert found.certificate.kkt_residual < 1e-8


@pytest.mark.long
def test_decay_under_the_delay_law():
    source = law_from_parameters("delay", "c0=0.1 N*s/m, c1=2 N, c2=100 s^2/m^2, alpha=0.05 s")
    found = find_gains(source, velocity=0.05, mass=1.0, margin={"modulus": 0, "decay": 0.5})
    k_f = 2 * 2.0 * 100 * 0.05 / (1 + 100 * 0.05**2) ** 2 - 0.1
    # no root right of -0.5: as many turns of the characteristic function along that line as for
    # a stable one
    w = np.linspace(0, 3000, 3_000_001)
    turns = {}
    for shift in (0.499, 0.501):
        s = -shift + 1j * w
        z = s**2 + found.kv * s + found.kp - k_f * s * np.exp(-0.05 * s)
        turns[shift] = round((np.unwrap(np.angle(z))[-1]) / (np.pi / 2))
    assert turns == {0.499: 2, 0.501: -2}
    assert found.margins["stiffness"].value == 0.0  # there is no critical stiffness


# ---- fits as a source ------------------------------------------------------------------------


def fit_content(**changes):
    sd = np.array([0.02, 0.05, 0.04])
    correlation = np.array([[1, 0.5, 0], [0.5, 1, 0.3], [0, 0.3, 1]])
    values = {"f0": 0.6, "A": 0.01, "B": 0.03, "L": 1e-5, "V0": 1e-6}
    size = sd * np.array([values[name] for name in ("A", "B", "L")])
    content = {
        "schema": "jaxfric.fit/2",
        "law": "slip",
        "states": 1,
        "friction_unit": "1",
        "converged": True,
        "parameters": {
            name: {"value": value, "determined": True} for name, value in values.items()
        },
        "free": ["A", "B", "L"],
        "covariance": (correlation * np.outer(size, size)).tolist(),
    }
    return {**content, **changes}


def test_what_a_law_does_not_know_travels_with_it(tmp_path):
    """A fit whose B may be negative, and an f0 that was not given."""
    content = fit_content()
    content["parameters"]["B"]["value"] = -0.006
    source = law_from_fit(written(tmp_path, content), normal_force=500.0, samples=2)
    assert len(source.warnings) == 1
    assert "says nothing of stability (B is negative" in source.warnings[0]
    content = fit_content()
    content["parameters"]["B"]["determined"] = False
    source = law_from_fit(written(tmp_path, content), normal_force=500.0, samples=0)
    assert "not determined" in source.warnings[0]
    text = "A=1 N, B=3 N, L=1 mm, V0=2 mm/s"
    assert "50 N (50 times A) is assumed" in law_from_parameters("ageing", text).text
    assert "assumed" not in law_from_parameters("slip", text + ", f0=20 N").text


def test_what_a_fit_warned_of_goes_on_to_law_and_gains(tmp_path):
    """In the file's own words, each line once, before what the law itself has to say."""
    own = ["stick-slip regime: A, B, L are\nsuspect", "A is odd", "A is odd"]
    content = fit_content(converged=True, warnings=own)
    source = law_from_fit(written(tmp_path, content), normal_force=500.0, samples=0)
    said = ("the fit warned: stick-slip regime: A, B, L are suspect", "the fit warned: A is odd")
    assert source.warnings == said
    gains = find_gains(source, velocity=1e-6, mass=2.0, margin={"modulus": 0, "stiffness": 1.2})
    assert gains.warnings[:2] == said == tuple(gains_report.content(gains)["warnings"][:2])
    assert len(set(gains.warnings)) == len(gains.warnings)
    content["parameters"]["B"]["value"] = -0.006
    source = law_from_fit(written(tmp_path, content), normal_force=500.0, samples=0)
    assert source.warnings[:2] == said and "nothing of stability" in source.warnings[2]


@pytest.mark.parametrize(
    ("trend", "words"),
    [(-3.0, "add 1.5e+03 N/m to k_p"), (3.0, "leaving it out is safe"), (0.0, "")],
)
def test_a_slip_trend_of_a_fit_is_no_part_of_the_law(tmp_path, trend, words):
    """Law and samples are those of the same fit without it: no motion is steady with a trend."""
    plain = law_from_fit(written(tmp_path, fit_content()), normal_force=500.0, samples=3)
    content = fit_content(free=["A", "slip_trend", "B", "L"])
    content["parameters"]["slip_trend"] = {"value": trend, "determined": True}
    covariance = np.asarray(fit_content()["covariance"])
    wider = np.insert(np.insert(covariance, 1, 0.9 * covariance[0], axis=0), 1, 1.0, axis=1)
    content["covariance"] = wider.tolist()
    source = law_from_fit(written(tmp_path, content), normal_force=500.0, samples=3)
    assert float(source.law.slip_trend) == 0 and not np.any(source.samples.slip_trend)
    for name in ("f0", "A", "B", "L"):
        np.testing.assert_allclose(getattr(source.samples, name), getattr(plain.samples, name))
    assert len(source.warnings) == bool(trend)
    assert words in "".join(source.warnings)


def test_a_fit_that_does_not_say_whether_it_converged_is_told(tmp_path):
    content = fit_content()
    del content["converged"]
    (line,) = law_from_fit(written(tmp_path, content), normal_force=500.0, samples=0).warnings
    assert line == "the fit warned: its file does not say whether it converged"


def test_a_delay_margin_below_any_controller_is_told():
    best = LocalOptimum("damped", 1.0, 1.0, 1.0, 0.0, 0.0, (), False)
    region = Region(*(np.ones(2) for _ in range(4)))._replace(lower=np.zeros(2))

    def said(margin, delay=None):
        worst = {"delay": WorstCase(margin, "s", {})}
        return " ".join(_warnings(best, region, worst, delay))

    assert "0.76 us" in said(7.6e-7)
    assert "sample_time" in said(7.6e-7) and "50 us" in said(7.6e-7)
    assert said(6e-5) == "" and said(7.6e-7, 1.5e-3) == ""


def written(folder: Path, content) -> Path:
    path = folder / "fit.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_samples_have_the_mean_and_covariance_of_the_fit(tmp_path):
    content = fit_content()
    source = law_from_fit(written(tmp_path, content), normal_force=500.0, samples=4000)
    A, B, L = (
        np.asarray(x).ravel()[1:] for x in (source.samples.A, source.samples.B, source.samples.L)
    )
    assert float(source.law.A) == pytest.approx(5.0) and source.velocity == 1e-6
    assert float(source.samples.f0[0]) == pytest.approx(300.0)
    unit = np.array([500.0, 500.0, 1.0])
    truth = np.asarray(content["covariance"]) * np.outer(unit, unit)
    sd = np.sqrt(np.diag(truth))
    rows = np.stack([A, B, L])
    np.testing.assert_allclose(rows.mean(axis=1), [5.0, 15.0, 1e-5], rtol=3e-3)
    np.testing.assert_allclose(np.cov(rows) / np.outer(sd, sd), truth / np.outer(sd, sd), atol=0.06)
    assert np.all(rows > 0)
    assert source.warnings == ()
    again = law_from_fit(tmp_path / "fit.json", normal_force=500.0, samples=4000)
    np.testing.assert_array_equal(np.asarray(again.samples.A).ravel()[1:], A)


@pytest.mark.parametrize(
    ("change", "force", "words"),
    [
        ({}, None, "normal_force=500"),
        ({"friction_unit": "N"}, 500.0, "not wanted"),
        ({"schema": "jaxfric.fit/3"}, 500.0, "its schema is 'jaxfric.fit/3'"),
        ({"schema": None}, 500.0, "it names no schema"),
        ({"law": "linear"}, 500.0, "law 'linear' is not known"),
        ({"covariance": [[1.0]]}, 500.0, r"shape \(1, 1\) for 3 free parameters"),
        ({"covariance": "x"}, 500.0, "not a matrix of numbers"),
        ({"free": ["A", "B", "Q"]}, 500.0, "not among the parameters"),
        ({"free": None}, 500.0, "damaged"),
        ({"states": "two"}, 500.0, "damaged"),
        ({"states": 7}, 500.0, "'B2' is missing"),
        ({"parameters": []}, 500.0, "damaged"),
        ({"parameters": {"A": {"value": "x"}}}, 500.0, "damaged"),
        ({"covariance": [[float("nan")] * 3] * 3}, 500.0, "undetermined"),
        ({"converged": False, "result": "still moving"}, 500.0, r"not converge \(still moving\)"),
        ({"converged": None}, 500.0, "damaged: converged is None, not true or false"),
        ({"converged": "no"}, 500.0, "damaged: converged is 'no', not true or false"),
        ({"warnings": "the stiffness is odd"}, 500.0, "warnings are no list of lines"),
        ({"warnings": [3]}, 500.0, "warnings are no list of lines"),
    ],
)
def test_files_that_are_refused(tmp_path, change, force, words):
    with pytest.raises(InputError, match=words):
        law_from_fit(written(tmp_path, fit_content(**change)), normal_force=force)


def test_damaged_missing_and_undetermined(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        law_from_fit(tmp_path / "none.json")
    whole = json.dumps(fit_content(), indent=1)
    with pytest.raises(InputError, match=r"damaged \(line"):
        law_from_fit(written(tmp_path, whole[: len(whole) // 2]), normal_force=1.0)
    content = fit_content()
    content["parameters"]["L"]["determined"] = False
    path = written(tmp_path, content)
    with pytest.raises(InputError, match=r"leaves L undetermined.*samples=0"):
        law_from_fit(path, normal_force=1.0)
    assert float(law_from_fit(path, normal_force=1.0, samples=0).law.L[0]) == 1e-5


# ---- slack, schedule -------------------------------------------------------------------------


def test_slack_of_the_stiffness_margin_is_that_of_25():
    p = GOLDEN
    scenarios = Scenarios.product(
        stack([rate_state(p["A"], p["B"], p["L"], p["V"])]), [p["V"]], [p["m"]]
    )
    gains = np.array([[100.0, 0.0], [2500.0, 100.0], [50.0, 990.0]])
    unit = np.array([2000.0, 1000.0])
    found = slacks(Requirement({"stiffness": 1.5}), scenarios, unit, gains)[:, 0]
    k_cr = critical(gains[:, 1], **p)
    np.testing.assert_allclose(found, (gains[:, 0] - 1.5 * k_cr) / 2000.0, rtol=1e-9)


@pytest.mark.long
def test_a_schedule_chains_and_a_broken_one_says_where(monkeypatch):
    source = golden_source()
    chain = gain_schedule(
        source, velocity=(1e-3, 3e-3), mass=0.5, margin={"modulus": 0, "stiffness": 2.0}, ratio=3.0
    )
    V = [point.velocity for point in chain.points]
    assert chain.covered and chain.gap is None
    assert V[0] == pytest.approx(1e-3) and V[-1] == pytest.approx(3e-3)
    for slow, fast in zip(chain.points, chain.points[1:], strict=False):
        step = fast.velocity / slow.velocity
        assert fast.up >= step and slow.down >= step
    kp, kv = chain.gains([1e-3, 2.9e-3])
    assert (kp[0], kv[1]) == (chain.points[0].kp, chain.points[-1].kv)
    marginal = {"stiffness": 1.0}

    def narrow(scenarios, gains, *, largest):
        sizes = np.full(len(scenarios), 1.1)
        return JumpSizes(sizes, sizes, ["limit_cycle"], ["limit_cycle"])

    monkeypatch.setattr(sys.modules["jaxfric.gains.set_points"], "jump_sizes", narrow)
    broken = gain_schedule(
        source, velocity=(2e-3, 3e-3), mass=0.5, margin=marginal, ratio=1.6, finest=1.3
    )
    assert not broken.covered and broken.gap == (2e-3, 3e-3)
    with pytest.raises(InputError, match="not a range"):
        gain_schedule(source, velocity=(3e-3, 2e-3), mass=0.5, margin=marginal)
    with pytest.raises(InputError, match="ratio > finest > 1"):
        gain_schedule(source, velocity=(2e-3, 3e-3), mass=0.5, margin=marginal, ratio=1.1)


@pytest.mark.parametrize(
    ("ends", "covered", "number", "counts"),
    [
        (("unresolved", "unresolved"), None, 3, [{"unresolved": 2, "steps": 2}]),
        (("unresolved", "limit_cycle"), False, 9, []),
        (("escape", "unresolved"), False, 9, []),
    ],
)
def test_an_unresolved_step_is_no_break(monkeypatch, ends, covered, number, counts):
    """Set points are inserted, to a factor 1.78, only where a simulation ends outside the basin."""
    module = sys.modules["jaxfric.gains.set_points"]
    sizes = JumpSizes(np.full(1, 1.1), np.full(1, 1.1), *([end] for end in ends))
    monkeypatch.setattr(module, "jump_sizes", lambda *_, **__: sizes)
    monkeypatch.setattr(module, "find_gains", lambda *_, **__: SimpleNamespace(kp=1.0, kv=1.0))
    chain = gain_schedule(golden_source(), velocity=(1e-3, 1e-1), mass=0.5, ratio=10.0, finest=1.5)
    assert chain.covered is covered and len(chain.points) == number
    assert (chain.gap is None) is (covered is None)
    assert [warning.values for warning in chain.warnings] == counts


def test_gains_of_a_set_point_hold_half_way_to_its_neighbours(monkeypatch):
    """Also after set points are inserted on one side, and never outside the range."""
    module = sys.modules["jaxfric.gains.set_points"]
    asked = {}

    def sizes(scenarios, *_, **__):
        size = np.where(scenarios.velocity > 2e-2, 1.1, 50.0)
        return JumpSizes(size, size, ["escape"], ["escape"])

    def gains(*_, velocity, **__):
        asked[sorted(velocity)[2]] = np.asarray(velocity)  # the last time for every set point
        return SimpleNamespace(kp=1.0, kv=1.0)

    monkeypatch.setattr(module, "jump_sizes", sizes)
    monkeypatch.setattr(module, "find_gains", gains)
    chain = gain_schedule(golden_source(), velocity=(1e-3, 1e-1), mass=None, ratio=10.0)
    V = np.asarray([point.velocity for point in chain.points])
    middle = np.sqrt(V[1:] * V[:-1])
    assert len(V) > 5 and V[1] == pytest.approx(1e-2)
    low, high = np.append(V[0], middle), np.append(middle, V[-1])
    np.testing.assert_allclose([asked[v].min() for v in V], low, rtol=1e-12)
    np.testing.assert_allclose([asked[v].max() for v in V], high, rtol=1e-12)
    assert min(map(np.min, asked.values())) == V[0] and max(map(np.max, asked.values())) == V[-1]


@pytest.mark.parametrize(
    ("velocities", "told"),
    [
        ([1e-6, 2e-5], None),  # twice beyond, as far as that goes
        ([1e-6, 1e-3], (1e-6, 1e-5, 1e-6, 1e-3, 100.0)),
        ([1e-7], (1e-6, 1e-5, 1e-7, 1e-7, 10.0)),
        ([], None),
    ],
)
def test_a_law_is_told_to_be_asked_beyond_its_record(velocities, told):
    law = rate_state(1.0, 3.0, 1e-3, 2e-3)
    lines = LawSource(law, stack([law]), "fitted", 2e-3, seen=(1e-6, 1e-5)).unseen(velocities)
    assert len(lines) == (told is not None)
    assert told is None or tuple(lines[0].values.values()) == pytest.approx(told)
    assert LawSource(law, stack([law]), "stated", 2e-3).unseen([1.0]) == ()
    assert seen_velocities([0.0, 1e-5, -1e-6]) == [1e-6, 1e-5] and seen_velocities([0.0]) is None
