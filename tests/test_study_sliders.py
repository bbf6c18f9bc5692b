"""What `jaxfric study` computes, against the functions it stands for and against SciPy."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import critical_rate_state
from scipy.integrate import solve_ivp

pytest.importorskip("zarr")
pytest.importorskip("xarray")

import jaxfric as jf
from jaxfric import study
from jaxfric.gains.ends import ENDS, EndState
from jaxfric.gains.settle import end_and_share
from jaxfric.members import ends as streaming
from jaxfric.members import motions, run_study
from jaxfric.members.make import make
from jaxfric.members.one_by_one import GAINS_CODES, FitOfRecord, LeastGains, Recorder
from jaxfric.members.sliders import Sliders
from jaxfric.stability.margin_table import MARGINS
from jaxfric.stability.margins import is_stable, margins, poles

RIG = """
[rig]
law = "{law}"
A = "4.5 N"
B = "6 N"
L = "5 um"
"""


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def members(number: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Parameters of massless sliders over wide ranges."""
    rng = np.random.default_rng(seed)
    low = np.asarray([3.0, 4.0, 3e-6, 3e5, 1e2, 1e-6])
    high = np.asarray([6.0, 10.0, 4e-5, 5e6, 1e5, 1e-4])
    p = np.exp(rng.uniform(np.log(low), np.log(high), (number, 6)))
    return dict(zip(("A", "B", "L", "k_p", "k_v", "V0"), p.T, strict=True))


def followed(law: str, p: dict[str, np.ndarray], ratio: float, **given):
    """Motions in time of a study, after a step of the command by `ratio`."""
    fixed = {"ratio": ratio, "V_ref": 1e-6}
    function = motions.Motions(Sliders(law, 1, fixed), ("force", "velocity", "trace"), **given)
    return jax.device_get(jax.jit(function)({name: jnp.asarray(x) for name, x in p.items()}))


def scipy_response(law, A, B, L, k_p, k_v, V0, ratio, times):
    """Friction by SciPy, in the elongation and the state: another equation, another solver."""
    V_ref = 1e-6

    def velocity(e, theta):
        """By bisection: f0 + A ln(V/V_ref) + theta + k_v V = k_p e + k_v V0."""
        low, high = -60.0, 60.0
        for _ in range(70):
            u = 0.5 * (low + high)
            over = A * u + theta + k_v * V_ref * np.exp(u) > k_p * e + k_v * V0
            low, high = (low, u) if over else (u, high)
        return V_ref * np.exp(0.5 * (low + high))

    def rate(_, y):
        V = velocity(*y)
        if law == "ageing":
            slope = B * V_ref / L * (np.exp(-y[1] / B) - V / V_ref)
        else:
            slope = -(V / L) * (y[1] + B * np.log(V / V_ref))
        return [V0 - V, slope]

    u = np.log(V0 / ratio / V_ref)
    start = [(A - B) * u / k_p, -B * u]
    done = solve_ivp(
        rate, (0, times[-1]), start, "LSODA", times, rtol=1e-9, atol=[1e-14, 1e-10], max_step=1e9
    )
    V = np.asarray([velocity(*y) for y in done.y.T])
    return A * np.log(V / V_ref) + done.y[1], V


@pytest.mark.parametrize("law", ["slip", "ageing"])
@pytest.mark.parametrize("ratio", [10.0, 0.2])
def test_response_is_that_of_scipy(law, ratio):
    p = members(4, seed=3)
    p["k_p"] = 2 * p["k_p"]
    found = followed(law, p, ratio, samples=40)
    assert np.all(found["trace"] == 0)
    for i, (A, B, L, k_p, k_v, V0) in enumerate(zip(*p.values(), strict=True)):
        times = 20 * L / V0 * np.arange(1, 41) / 40
        force, V = scipy_response(law, A, B, L, k_p, k_v, V0, ratio, times)
        force = force + 50 * A
        scale = np.ptp(force)
        np.testing.assert_allclose(found["force"][i], force, atol=1e-5 * scale, rtol=0)
        np.testing.assert_allclose(found["velocity"][i], V, rtol=1e-4)


def test_a_runaway_and_too_few_steps_are_told():
    p = members(8)
    p |= {"k_p": 1e-2 * p["k_p"], "k_v": 0 * p["k_v"]}
    duration = 40 * np.max(p["L"] / p["V0"])
    found = followed("slip", p, 10.0, samples=1, duration=duration)
    escaped = found["trace"] == 1
    assert np.any(escaped)
    assert np.all(found["velocity"][escaped, 0] > 1e3 * p["V0"][escaped])
    few = followed("slip", p, 10.0, samples=1, duration=duration, max_steps=8)
    assert np.all(few["trace"] == 2) and np.all(np.isnan(few["velocity"]))


def test_margins_of_a_study_are_those_of_the_package(tmp_path):
    axes = """
    [axes]
    k_p = { logspace = ["100 kN/m", "2 MN/m"], points = 5 }
    k_v = { linspace = ["0 N*s/m", "200 kN*s/m"], points = 3 }
    V0 = { values = ["1 um/s", "10 um/s"] }
    """
    text = 'compute = ["margins"]' + RIG.format(law="slip") + 'm = "2 kg"\n' + axes
    found = run_study(written(tmp_path / "s.toml", text), tmp_path / "a")

    def one(k_p, k_v, V0):
        law = jf.RateState(225.0, 4.5, [6.0], [5e-6], 1e-6)
        slider = jf.linearise(jf.Rig(jf.Inertial(2.0, k_p, k_v), law), V0)
        critical = critical_rate_state(4.5, 6.0, 5e-6, V0, k_v, 2.0)
        return margins(slider), is_stable(slider), critical

    grid = np.meshgrid(found.k_p, found.k_v, found.V0, indexing="ij")
    expected, stable, (w_cr, k_cr) = jax.jit(jax.vmap(one))(*(x.ravel() for x in grid))
    for name, value in (expected | {"w_cr": w_cr, "k_cr": k_cr}).items():
        here = found[name].broadcast_like(found.stability).transpose(*found.stability.dims)
        np.testing.assert_allclose(here.values.ravel(), value, rtol=1e-9, err_msg=name)
    assert found.stability.shape == (5, 3, 2)
    np.testing.assert_array_equal(found.stability.values.ravel() == 0, stable)
    assert all(found[name].attrs["units"] == one.unit for name, one in MARGINS.items())
    assert found.k_p.attrs["units"] == "N/m" and float(found.V0[0]) == 1e-6


TWO_STATES = """
compute = ["margins"]
outputs = ["stability", "modulus", "phase", "delay"]
dtype = "{dtype}"
[rig]
law = "slip"
[samples]
number = 512
[axes]
A = {{ sobol = ["0.5 N", "50 N"], log = true }}
B = {{ sobol = ["0.5 N", "50 N"], log = true }}
L = {{ sobol = ["1 um", "100 um"], log = true }}
B2 = {{ sobol = ["0.5 N", "50 N"], log = true }}
L2 = {{ sobol = ["1 um", "100 um"], log = true }}
m = {{ sobol = ["0.1 kg", "100 kg"], log = true }}
k_p = {{ sobol = ["1 kN/m", "10 MN/m"], log = true }}
k_v = {{ sobol = ["1 N*s/m", "1 MN*s/m"], log = true }}
V0 = {{ sobol = ["0.1 um/s", "1 mm/s"], log = true }}
"""


def test_numbers_kept_in_single_precision_are_those_of_double(tmp_path):
    """Over random sliders of two states, whose polynomials spread over fifty decades."""
    found = [
        run_study(written(tmp_path / "s.toml", TWO_STATES.format(dtype=d)), tmp_path / d)
        for d in ("float32", "float64")
    ]
    single, double = found
    assert single.phase.dtype == np.float32 and double.phase.dtype == np.float64
    assert (double.outcome == 0).all() and np.isfinite(double.phase).mean() > 0.5
    for name in ("stability", "outcome", "modulus", "phase", "delay"):
        np.testing.assert_allclose(single[name], double[name], rtol=2e-7, err_msg=name)


@pytest.mark.parametrize("name", ["phase", "delay", "modulus", "gain"])
def test_margins_in_single_precision_are_refused(name):
    """In any function of one's own they would be wrong, and nothing would say so."""
    with jax.enable_x64(False):
        law = jf.RateState(225.0, 4.5, [6.0, 4.0], [3e-6, 4e-5], 1e-6)
        rig = jf.Rig(jf.Inertial(2.0, 3e5, 1e5), law)
        slider = jax.eval_shape(lambda V0: jf.linearise(rig, V0), 1e-6)
        with pytest.raises(jf.InputError, match="64-bit numbers"):
            jax.eval_shape(lambda slider: jf.stability_margin(name, slider), slider)


@pytest.fixture(scope="module")
def ends(tmp_path_factory):
    """A study of ends, and what `end_and_share` says of the same members."""
    folder = tmp_path_factory.mktemp("ends")
    axes = """
    [simulate]
    ratio = 5
    [axes]
    k_p = { logspace = ["60 kN/m", "1 MN/m"], points = 6 }
    k_v = { values = ["1 kN*s/m", "100 kN*s/m"] }
    V0 = { values = ["1 um/s", "10 um/s"] }
    """
    text = 'compute = ["simulate"]' + RIG.format(law="slip") + axes
    found = run_study(written(folder / "s.toml", text), folder / "a")
    law = jf.RateState(225.0, 4.5, [6.0], [5e-6], 1e-6)

    def one(k_p, k_v, V0):
        rig = jf.Rig(jf.QuasiStatic(k_p, k_v), law)
        s = poles(jf.linearise(rig, V0))
        horizon = 30 * jnp.maximum(2 * jnp.pi / jnp.min(jnp.abs(s)), 9.0 / (k_p * V0))
        start = jf.step_start(rig, V0, 5.0)
        return end_and_share(rig, V0, start, horizon=horizon, decay=-jnp.max(s.real))[0]

    grid = np.meshgrid(found.k_p, found.k_v, found.V0, indexing="ij")
    columns = [jnp.asarray(x.ravel()) for x in grid]
    expected = jax.jit(jax.vmap(one))(*columns)
    return found, jax.tree.map(lambda x: np.asarray(x).reshape(found.end.shape), expected)


def test_ends_of_a_study_are_those_of_the_package(ends):
    found, expected = ends
    names = found.end.attrs["flag_meanings"].split()
    for code, name in enumerate(names):
        there = np.asarray(expected.code == getattr(ENDS, name.replace("failed", "unresolved")))
        np.testing.assert_array_equal(found.end == code, there, err_msg=name)
    cycle = found.end.values == 1
    assert cycle.sum() > 5 and (found.end.values == 0).sum() > 5
    for name in ("velocity_amplitude", "slip_amplitude", "period", "least_velocity"):
        ratio = found[name].values[cycle] / getattr(expected, name)[cycle]
        np.testing.assert_allclose(ratio, 1.0, atol=0.02, err_msg=name)
    steady = found.end.values == 0
    assert np.all(found.velocity_amplitude.values[steady] == 0)
    assert np.all(found.slip_amplitude.values[steady] == 0)
    assert np.all((found.least_velocity.values == found.V0.values)[steady])
    assert np.all(np.isinf(found.period.values[~cycle]))
    for ends_of in (found, expected):
        spread = np.asarray(ends_of.period_spread)[cycle] / np.asarray(ends_of.period)[cycle]
        assert np.all((spread >= 0) & (spread < 0.02))  # of one state: all cycles are alike
        assert np.all(np.isinf(np.asarray(ends_of.period_spread)[~cycle]))


def test_a_small_step_of_an_unstable_slider_is_not_steady():
    """What grows is too small to be seen: the study does not know its end."""
    p = members(16)
    p["k_p"] = 0.9 * (p["B"] - p["A"] - p["k_v"] * p["V0"]) / p["L"]
    p = {name: jnp.asarray(x[p["k_p"] > 0]) for name, x in p.items()}
    assert len(p["A"]) > 5

    @jax.vmap
    def code(p):
        law = jf.RateState(50 * p["A"], p["A"], p["B"][None], p["L"][None], 1e-6)
        rig = jf.Rig(jf.QuasiStatic(p["k_p"], p["k_v"]), law)
        start = jf.step_start(rig, p["V0"], 1 + 1e-9)
        period = 2 * jnp.pi * p["L"] / p["V0"]
        return streaming.end_of(rig, p["V0"], start, horizon=period, decay=-1 / period).code

    assert not np.any(np.asarray(jax.jit(code)(p)) == streaming.STEADY)


def test_ends_agree_with_the_linear_theory(ends):
    """With one state and no mass (25) divides them; this step is small enough for the basin."""
    found, _ = ends
    k_cr = (6 - 4.5 - found.k_v * found.V0) / 5e-6
    np.testing.assert_array_equal(found.end == 0, found.k_p > k_cr)


def test_motions_in_time_are_kept(tmp_path):
    text = 'compute = ["simulate"]\noutputs = ["force", "trace", "duration"]' + RIG.format(
        law="ageing"
    )
    text += """
    [simulate]
    samples = 10
    duration = "20 s"
    max_steps = 128
    [axes]
    k_p = { values = ["2 MN/m", "4 MN/m", "50 kN/m"] }
    V0 = { values = ["10 um/s"] }
    """.replace("[simulate]", 'k_v = "1 kN*s/m"\n[simulate]')
    found = run_study(written(tmp_path / "s.toml", text), tmp_path / "a")
    assert found.force.dims == ("k_p", "V0", "part") and float(found.duration[0, 0]) == 20.0
    times = 20.0 * found.part.values
    # the last one stick-slips: what was not followed has no numbers, and is not called computed
    assert found.trace.values[:, 0].tolist() == [0, 0, 2] and np.all(np.isnan(found.force[2]))
    assert found.outcome.values[:, 0].tolist() == [0, 0, 1]
    for i, k_p in enumerate(found.k_p.values[:2]):
        force, _ = scipy_response("ageing", 4.5, 6.0, 5e-6, k_p, 1e3, 1e-5, 10.0, times)
        # f0 is 50 A at V_ref, here V0
        at_V0 = 225.0 + force + (6.0 - 4.5) * np.log(10.0)
        np.testing.assert_allclose(found.force[i, 0], at_V0, atol=2e-5)


WITH_MASS = """
compute = ["simulate"]
[rig]
law = "slip"
A = "1 N"
B = "3 N"
L = "1 mm"
m = "2 kg"
k_v = "0.5 N*s/m"
V0 = "2 mm/s"
[simulate]
inertia = true
ratio = 1.1
[axes]
k_p = { values = ["1 kN/m", "4 kN/m"] }
"""


def test_a_slider_with_mass_tells_by_how_much_its_cycles_differ(tmp_path, monkeypatch):
    """What is made of how its motion ends; the motion itself is not simulated here."""
    k_p = jnp.asarray([1e3, 4e3])

    def told(rig, *_, **__):
        soft = rig.machine.stiffness < 2e3
        code = ENDS.where(soft, ENDS.limit_cycle, ENDS.unresolved)
        return EndState(code, *jnp.asarray([0.1, 1e-4, 1e-5, 2.25, 0.75, 0.0])), 1.0

    monkeypatch.setattr(motions, "end_and_share", told)
    _, made = make(written(tmp_path / "s.toml", WITH_MASS))
    assert {o.name: o.unit for o in made.outputs}["period_spread"] == "s"
    found = jax.jit(made.function)({"k_p": k_p})
    np.testing.assert_array_equal(found["period"], [2.25, np.nan])
    np.testing.assert_array_equal(found["period_spread"], [0.75, np.nan])


def test_ends_with_mass(tmp_path, monkeypatch):
    """The paper's sample, at half and twice its critical stiffness and about: the cycles take more
    steps than are kept at first, and are followed again two at a time."""
    together = make(written(tmp_path / "s.toml", WITH_MASS))[1].function
    function = together.parts["simulate"][1]
    k_p, order = np.array([4e3, 1e3, 4.2e3, 900.0, 1.1e3]), np.array([4, 1, 2, 0, 3])
    monkeypatch.setattr(motions, "_FEW_STEPS", 512)
    monkeypatch.setattr(motions, "_AGAIN", 2)
    few = jax.jit(dataclasses.replace(function, max_steps=512).__call__)({"k_p": k_p})
    assert few["end"].tolist() == [0, 3, 0, 3, 3]
    every = jax.jit(dataclasses.replace(function, max_steps=8192).__call__)
    found, other = (jax.device_get(every({"k_p": x})) for x in (k_p, k_p[order]))
    assert found["end"].tolist() == [0, 1, 0, 1, 1]
    assert np.all(found["period_spread"][[1, 3, 4]] < 0.02 * found["period"][[1, 3, 4]])
    assert np.all(np.diff(found["period"][[4, 1, 3]]) > 0)  # a soft spring takes longer
    assert np.isinf(found["period_spread"][0])
    assert found["velocity_amplitude"][[0, 2]].tolist() == [0, 0]
    assert found["slip_amplitude"][[0, 2]].tolist() == [0, 0]
    assert found["least_velocity"][[0, 2]].tolist() == [2e-3, 2e-3]
    for name, values in found.items():
        np.testing.assert_allclose(other[name], values[order], rtol=1e-6)


@pytest.mark.long
def test_gains_and_fits_one_by_one(tmp_path):
    """The smallest gains of (25), and parameters found again within their errors."""
    text = """
    compute = ["gains"]
    [rig]
    law = "slip"
    A = "1 N"
    L = "1 mm"
    m = "2 kg"
    V0 = "2 mm/s"
    [axes]
    B = { values = ["0.5 N", "3 N"] }
    [gains]
    margin = { stiffness = 1.5, modulus = 0 }
    max_k_v = "1e-3 N*s/m"
    """
    found = run_study(written(tmp_path / "g.toml", text), tmp_path / "g")
    assert found.gains.values.tolist() == [0, 0]
    _, k_cr = critical_rate_state(1.0, 3.0, 1e-3, 2e-3, found.least_k_v[1], 2.0)
    np.testing.assert_allclose(found.least_k_p[1], 1.5 * k_cr, rtol=1e-6)
    text = """
    compute = ["fit"]
    [rig]
    law = "slip"
    A = "5 N"
    L = "20 um"
    V0 = "10 um/s"
    k_p = "2 MN/m"
    [axes]
    B = { values = ["6 N", "8 N"] }
    [fit]
    noise = "0.05 N"
    """
    found = run_study(written(tmp_path / "f.toml", text), tmp_path / "f")
    assert found.fit.values.tolist() == [0, 0]
    assert np.all(np.abs(found.fitted_B - found.B) < 4 * found.std_B)
    assert np.all(np.abs(found.fitted_A - 5) < 4 * found.std_A)
    assert np.all(np.abs(found.rms / 0.05 - 1) < 0.2)


def test_wrong_parameters_are_no_answer(tmp_path):
    """A member whose L or k_p is negative is an error: not one without gains or a record."""
    law = {"A": 1.0, "B": 3.0, "V0": 2e-3}
    gains = LeastGains(
        "slip", 1, law, {"modulus": 0.0, "stiffness": 1.5}, (1e3, 500.0), (None,) * 2
    )
    outputs = [study.Output(n) for n in ("least_k_p", "least_k_v", "norm")]
    outputs.append(study.Output("gains", codes=GAINS_CODES))
    grid = study.Grid((study.values("L", [1e-3, -1e-3, 0.1], unit="m"),))
    found = study.run(gains, grid, tmp_path / "a", outputs=outputs, kind="host")
    # k_p = 1.5 (B - A - k_v V)/L, where the limit of k_v leaves half of B - A
    assert found.gains.values.tolist() == [1, -1, 0]
    assert float(found.least_k_p[2]) == pytest.approx(15.0, rel=1e-6)
    assert found.outcome.values.tolist() == [0, 2, 0]
    (text,) = found.attrs["errors"]
    assert text.startswith("InputError: ") and "(L) is -0.001; it must be above 0" in text
    fit = FitOfRecord(Recorder("slip", 1, law, 10.0, 400, 0.0, None, 0, 1), ("A", "B", "L"))
    for wrong, what in (({"L": -1e-3, "k_p": 1e4}, "L"), ({"L": 1e-3, "k_p": -1e4}, "k_p")):
        with pytest.raises(jf.InputError, match=rf"\b{what}\b.* is -"):
            fit(wrong)


LOOP = """
compute = ["loop"]
[rig]
law = "slip"
A = "5 N"
B = "8 N"
L = "3 um"
L2 = "40 um"
V0 = "10 um/s"
k_p = "10 MN/m"
[axes]
B2 = { values = ["0 N", "4 N", "1000 N"] }
[loop]
noise = "0.15 N"
rows = 1400
distance = "200 um"
"""


@pytest.mark.long
def test_loops_name_the_second_state_where_there_is_one(tmp_path):
    """The base has one state; the last member weakens by a thousand newtons and runs away: no
    record."""
    found = run_study(written(tmp_path / "l.toml", LOOP), tmp_path / "l")
    assert names(found.verdict) == ["no_missing_effect", "effects", "no_record"]
    assert names(found.first_effect) == ["none", "second_state", "none"]
    assert found.effects.values.tolist() == [0, 1, 0]
    before, after = found.held_out_before.values, found.held_out_after.values
    assert before[0] == after[0] < 1.06 and before[1] > 5 and after[1] < 1.06
    assert np.isnan(before[2]) and found.outcome.values.tolist() == [0, 0, 1]


def names(codes):
    texts = codes.attrs["flag_meanings"].split()
    return [texts[int(code)] for code in codes.values]


def test_what_a_loop_of_a_study_is_asked(tmp_path, monkeypatch):
    """The record of six steps that it gets, and what becomes of its answer."""
    asked = []

    def close_loop(record, **options):
        asked.append((record, options))
        return SimpleNamespace(
            verdict="effects",
            effects=("gain",),
            before=2.0,
            after=1.0,
            test_error=lambda x: x / 0.5,
        )

    monkeypatch.setattr("jaxfric.loop.close_loop", close_loop)
    text = (
        LOOP.replace('"0 N", "4 N", "1000 N"', '"4 N"') + 'max_effects = 2\nexclude = ["thermal"]\n'
    )
    found = run_study(written(tmp_path / "l.toml", text), tmp_path / "l")
    assert names(found.verdict) == ["effects"] and names(found.first_effect) == ["gain"]
    assert [float(found[f"held_out_{when}"][0]) for when in ("before", "after")] == [4.0, 2.0]
    ((record, options),) = asked
    assert options["stiffness"] == 1e7 and options["max_effects"] == 2 and options["law"] == "slip"
    assert (options["include"], options["exclude"]) == ((), ("thermal",))
    old = text.replace("max_effects", "most").replace("exclude", "without")
    found = run_study(written(tmp_path / "old.toml", old), tmp_path / "old")
    assert asked.pop()[1]["exclude"] == ("thermal",)
    assert "the key 'most' is now 'max_effects'" in str(found.attrs["warnings"])
    assert options["steps"].count("m/s") == 7 and record.friction_unit == "N"
    # steady at the same velocity before the first step and, but for exp(-5) of 9 N, at the end
    np.testing.assert_allclose(record.load_point_displacement[-1], 7 * 200e-6, rtol=0.01)
    assert abs(record.friction[-20:].mean() - record.friction[:200].mean()) < 0.3
    assert abs(record.friction[380:400].mean() - record.friction[:200].mean()) > 5
