"""Laws from hand-made loop.json files, against closed forms written with NumPy alone."""

import json
from pathlib import Path
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import assert_refused, run
from scipy.optimize import brentq

from jaxfric.cli.options import LawOptions
from jaxfric.effects.friction import SecondState, Viscous
from jaxfric.errors import InputError
from jaxfric.gains import find_gains
from jaxfric.rig.friction import Conditions, RateState
from jaxfric.rig.friction.extended import ExtendedLaw
from jaxfric.saved import law_from_fit
from jaxfric.saved.entry import law_entry
from jaxfric.stability.linear import linear_friction
from jaxfric.stability.theorem import critical_stiffness

UM, NORMAL = 1e-6, 500.0
BASE = {"f0": 0.6, "A": 0.009, "B": 0.014, "L": 10 * UM}
V0, V = 1 * UM, 7 * UM
FREQUENCIES = np.geomspace(1e-3, 1e3, 61) * V / BASE["L"]
EFFECTS = {
    "second_state": {"B2": 0.003, "L2": 40 * UM},
    "ageing": {"q": 0.6},
    "velocity_dependent_L": {"n": 0.3},
    "evolution_cutoff": {"c": 2e4},
    "viscous": {"c": 150.0},
    "stribeck": {"fs": 0.004, "Vs": 5 * UM, "d": 1.5},
    "thermal": {"a_T": 0.02, "tau_T": 4.0},
    "frictional_delay": {"alpha": 0.01},
}
LEFT_OUT = {
    "slip_trend": {"s": -3.0},
    "run_in": {"d": -0.002, "dc": 2e-4},
    "position_periodic": {"a": 3e-4, "b": 4e-4, "wavelength": 1e-4},
    "normal_stress": {"alpha": 0.1},
    "stiffness": {"kappa": 0.1},
    "damping": {"k_v": 10.0},
    "inertia": {"m": 0.1},
    "servo_lag": {"tau": 0.1},
    "sensor_lag": {"tau": 0.1},
    "sensor_delay": {"d": 0.1},
    "time_drift": {"r": 1e-5},
    "gain": {"g": 0.02},
}


def loop_content(*effects, **changes):
    """The entries of a loop.json that a law is made of; 1 % standard errors, A and B correlated."""
    known = EFFECTS | LEFT_OUT
    values = BASE | {f"{e}.{name}": v for e in effects for name, v in known[e].items()}
    size = 0.01 * np.abs(list(values.values()))
    correlation = np.eye(len(values))
    correlation[1, 2] = correlation[2, 1] = 0.8
    content = {
        "schema": "jaxfric.loop/2",
        "friction_unit": "1",
        "law": "slip",
        "reference_velocity": V0,
        "verdict": "effects",
        "sentence": "that is missing.",
        "effects": list(effects),
        "after": {
            "parameters": {k: {"value": v, "determined": True} for k, v in values.items()},
            "free": list(values),
            "covariance": (correlation * np.outer(size, size)).tolist(),
        },
    }
    return {**content, **changes}


def written(folder: Path, content) -> Path:
    path = folder / "loop.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def source(folder, *effects, samples=0, **changes):
    path = written(folder, loop_content(*effects, **changes))
    return law_from_fit(path, normal_force=NORMAL, samples=samples)


def transfer(s, effects, *, A=BASE["A"], B=BASE["B"], L=BASE["L"]):
    """F(s) of df = F dV about steady sliding at V, as a coefficient, by hand for every effect."""
    F = A / V + 0 * s
    if "velocity_dependent_L" in effects:
        L = L * (V / V0) ** EFFECTS["velocity_dependent_L"]["n"]
    if "evolution_cutoff" in effects:
        B = B / (1 + EFFECTS["evolution_cutoff"]["c"] * V)  # -V dtheta_ss/dV
    delay = EFFECTS["frictional_delay"]["alpha"] if "frictional_delay" in effects else 0.0
    F = F - B / L * np.exp(-delay * s) / (s + V / L)
    if "second_state" in effects:
        p = EFFECTS["second_state"]
        F = F - p["B2"] / p["L2"] / (s + V / p["L2"])
    if "viscous" in effects:
        F = F + EFFECTS["viscous"]["c"]
    if "stribeck" in effects:
        fs, Vs, d = EFFECTS["stribeck"].values()
        F = F - fs * d / V * (V / Vs) ** d * np.exp(-((V / Vs) ** d))
    if "thermal" in effects:  # alone with the base
        a, tau = EFFECTS["thermal"].values()
        level, heat = BASE["f0"] + (A - B) * np.log(V / V0), a / (BASE["f0"] * V0)
        level = level / (1 + heat * V)  # f = level - T, T = heat V f
        F = (F - heat * level / (tau * s + 1)) / (1 + heat * V / (tau * s + 1))
    return F


def misfit(law, effects) -> float:
    """Largest difference from `transfer` over the frequencies, in units of B/V."""
    s = 1j * FREQUENCIES
    return float(np.max(np.abs(face(law)[0] - transfer(s, effects))) * V / BASE["B"])


@eqx.filter_jit
def _face(law):
    friction, at = linear_friction(law, jnp.asarray(V)), Conditions(jnp.zeros(()), jnp.zeros(()))
    rate = law.rate(jnp.asarray(V), law.steady_state(jnp.asarray(V)), at)
    return jax.vmap(friction.transfer)(jnp.asarray(1j * FREQUENCIES)), jnp.max(jnp.abs(rate))


def face(law):
    """F over the frequencies and the largest rate in the steady state, of a coefficient."""
    return tuple(np.asarray(x) / NORMAL for x in _face(law))


@pytest.mark.parametrize("effects", [(), *((e,) for e in EFFECTS)])
def test_each_effect_linearised(tmp_path, effects):
    law = source(tmp_path, *effects).law
    F, rate = face(law)
    assert rate < 1e-12 * BASE["B"] * V / BASE["L"]
    if effects == ("frictional_delay",):  # a filter stands for it, that of a delay of 0.007 L/V
        low = FREQUENCIES * BASE["L"] < 4 * V
        s = 1j * FREQUENCIES[low]
        shift = np.max(np.abs(transfer(s, ()) - transfer(s, effects)))
        assert np.max(np.abs(F[low] - transfer(s, effects))) < 0.01 * shift
    else:
        assert misfit(law, effects) < 1e-10


def test_comparison_catches_a_wrong_law(tmp_path):
    """Every effect but ageing, which is none to first order, is seen where it is missing."""
    F = face(source(tmp_path).law)[0]
    for effect in EFFECTS:
        missed = np.max(np.abs(F - transfer(1j * FREQUENCIES, (effect,)))) * V / BASE["B"]
        assert (missed > 1e-4) == (effect != "ageing")


def test_several_effects_on_an_ageing_base(tmp_path):
    some = ("second_state", "viscous", "velocity_dependent_L")
    assert misfit(source(tmp_path, *some, law="ageing").law, some) < 1e-10


def test_critical_stiffness_of_two_states(tmp_path):
    """sum B_i/(1 + a L_i^2) = A is quadratic in a = w^2; k = sum B_i a L_i/(1 + a L_i^2).

    The record of data/undeclared.csv: its law, which a second state was left out of.
    """
    A, B, L = 0.009, np.array([0.012, 0.008]), np.array([3, 40]) * UM
    p = L**2
    roots = np.roots([A * p[0] * p[1], A * p.sum() - B[0] * p[1] - B[1] * p[0], A - B.sum()])
    a = roots[roots > 0]
    assert a.size == 1
    expected = NORMAL * float(np.sum(B * a * L / (1 + a * p)))
    content = loop_content("second_state")
    parameters = content["after"]["parameters"]
    for name, value in zip(("B", "second_state.B2", "L", "second_state.L2"), (*B, *L), strict=True):
        parameters[name]["value"] = value
    law = law_from_fit(written(tmp_path, content), normal_force=NORMAL, samples=0).law
    assert isinstance(law, RateState) and law.B.shape == (2,)
    assert float(critical_stiffness(law)) == pytest.approx(expected, rel=1e-2)
    assert expected == pytest.approx(619.7 * 1e3, rel=1e-3)


def test_gains_of_an_extended_law(tmp_path):
    """k_p = 1.2 k_cr from (19)-(20) with the transfer function by hand."""
    effects = ("stribeck",)
    found = source(tmp_path, *effects)
    kv, mass = 1e4, 2.0

    def excess(w):
        return NORMAL * transfer(1j * w, effects).real + kv

    grid = np.geomspace(1e-3, 1e2, 2001) * V / BASE["L"]
    sign = np.sign([excess(w) for w in grid])
    (at,) = np.nonzero(np.diff(sign))[0]
    w = np.asarray(brentq(excess, grid[at], grid[at + 1]))
    critical = mass * w**2 + w * NORMAL * transfer(1j * w, effects).imag
    gains = find_gains(
        found,
        velocity=V,
        mass=mass,
        margin={"modulus": 0, "stiffness": 1.2},
        lower=(None, kv),
        upper=(None, kv * (1 + 1e-9)),
    )
    assert gains.kp == pytest.approx(1.2 * critical, rel=1e-6)


def test_samples(tmp_path):
    """Mean and covariance; lengths positive; an effect outside the law may be undetermined."""
    content = loop_content("second_state", "viscous", "gain")
    after = content["after"]
    after["parameters"]["gain.g"]["determined"] = False
    for row in after["covariance"]:
        row[-1] = None
    after["covariance"][-1] = [None] * len(after["free"])
    path = written(tmp_path, content)
    found = law_from_fit(path, normal_force=NORMAL, samples=3000)
    assert isinstance(found.samples, ExtendedLaw)
    base = found.samples.base
    second, viscous = found.samples.terms
    assert isinstance(second, SecondState) and isinstance(viscous, Viscous)
    A, B = np.asarray(base.A)[1:], np.asarray(base.B)[1:, 0]
    assert np.corrcoef(A, B)[0, 1] == pytest.approx(0.8, abs=0.03)
    L2 = np.asarray(second.L2)
    assert L2[0] == 40 * UM and np.std(L2[1:]) / L2[0] == pytest.approx(0.01, rel=0.06)
    c = np.asarray(viscous.c)
    assert c[0] == 150 * NORMAL and np.mean(c[1:]) == pytest.approx(c[0], rel=1e-3)


@pytest.mark.parametrize("effect", LEFT_OUT)
def test_effects_that_are_no_part_of_the_law(tmp_path, effect):
    found = source(tmp_path, effect)
    assert isinstance(found.law, RateState) and misfit(found.law, ()) < 1e-10
    (line,) = found.warnings
    assert line.startswith(f"{effect} is left out of the law")
    softest = {
        "slip_trend": "add 1.5e+03 N/m",
        "run_in": "add 5e+03 N/m",
        "position_periodic": f"add {2 * np.pi * 5 * NORMAL:.3g} N/m",
    }
    assert softest.get(effect, "left out") in line


def test_a_trend_that_stiffens_is_safe(tmp_path):
    content = loop_content("slip_trend")
    content["after"]["parameters"]["slip_trend.s"]["value"] = 3.0
    (line,) = law_from_fit(written(tmp_path, content), normal_force=NORMAL, samples=0).warnings
    assert "safe" in line and "add" not in line


def test_an_effect_that_was_declared_is_in_the_law(tmp_path):
    """`--include viscous`: its parameters are there, though the loop has not added it."""
    assert misfit(source(tmp_path, "viscous", effects=[]).law, ("viscous",)) < 1e-10


@pytest.mark.parametrize("verdict", ["no_missing_effect", "effects", "ambiguous"])
def test_verdicts_that_can_be_relied_on(tmp_path, verdict):
    found = source(tmp_path, "viscous", verdict=verdict)
    assert found.warnings == () and verdict in found.text and "viscous" in found.text


@pytest.mark.parametrize("verdict", ["outside_catalogue", "too_weak"])
def test_other_verdicts_are_told(tmp_path, verdict):
    (line,) = source(tmp_path, "viscous", verdict=verdict).warnings
    assert f"the loop's verdict is {verdict} (that is missing):" in line


def test_what_a_loop_warned_of_goes_on(tmp_path):
    own = ["a finer solver moves the prediction by 3 sigma"]
    first, second = source(tmp_path, "gain", warnings=own).warnings
    assert first == f"the loop warned: {own[0]}" and second.startswith("gain is left out")


def damaged(**changes):
    content = loop_content("viscous")
    return {**content, "after": {**content["after"], **changes}}


def with_value(name, value):
    content = loop_content("viscous")
    content["after"]["parameters"][name] = {"value": value}
    return content


@pytest.mark.parametrize(
    ("content", "force", "words"),
    [
        (loop_content("viscous", schema="jaxfric.loop/3"), NORMAL, "'jaxfric.loop/3'; a file of"),
        (loop_content("viscous", schema="x"), NORMAL, r"'jaxfric.fit/2' \(jaxfric fit\) or 'jaxf"),
        ([], NORMAL, "it names no schema"),
        (json.dumps(loop_content(), indent=1)[:200], NORMAL, r"damaged \(line"),
        (loop_content("viscous"), None, "normal_force=500"),
        (loop_content("viscous", friction_unit="N"), NORMAL, "not wanted"),
        (loop_content("viscous", law="linear"), NORMAL, "'linear' is not known; register"),
        (loop_content("viscous", effects="viscous"), NORMAL, "has another form"),
        (loop_content("viscous", effects=["viscos"]), NORMAL, "did you mean 'viscous'"),
        (loop_content("viscous", effects=["curvature"]), NORMAL, "jaxfric.effects.register"),
        (loop_content(effects=["viscous"]), NORMAL, "viscous.c is missing"),
        (loop_content("viscous", warnings="odd"), NORMAL, "warnings are no list of lines"),
        (loop_content("viscous", after=None), NORMAL, "'after.' is no table"),
        (loop_content("viscous", reference_velocity=None), NORMAL, "parameter V0 has no value"),
        (damaged(parameters={}), NORMAL, "damaged"),
        (damaged(free=["f0", "Q"]), NORMAL, r"shape \(5, 5\) for 2 free"),
        (damaged(covariance=[[float("nan")] * 5] * 5), NORMAL, "undetermined"),
        (with_value("A", -0.01), NORMAL, "direct effect .* is -0.01"),
        (with_value("L", None), NORMAL, "parameter L has no value"),
    ],
)
def test_bad_files(tmp_path, content, force, words):
    path = written(tmp_path, content)
    with pytest.raises(InputError, match=words) as told:
        law_from_fit(path, normal_force=force, samples=3)
    assert str(told.value).startswith(str(path)) and "\n" not in str(told.value)


def test_a_loop_at_hand_gives_the_law_of_its_file(tmp_path):
    content = loop_content("viscous", record={"path": "run.csv"})
    here = law_from_fit(SimpleNamespace(to_json=lambda: content), normal_force=NORMAL, samples=3)
    file = law_from_fit(written(tmp_path, content), normal_force=NORMAL, samples=3)
    for a, b in zip(jax.tree.leaves(here.samples), jax.tree.leaves(file.samples), strict=True):
        np.testing.assert_array_equal(a, b)
    assert here.text.endswith("of run.csv") and here.warnings == file.warnings
    with pytest.raises(InputError, match="it names no schema"):
        law_from_fit(SimpleNamespace(to_json=lambda: {"kp": 1.0}))


def test_a_file_is_read_by_the_entry_of_its_law_alone(tmp_path):
    """Without what the entry was made of the law, its samples and its words are the same."""
    content = loop_content("second_state", "viscous", "gain", "slip_trend", warnings=["odd"])
    one = law_from_fit(written(tmp_path, content), normal_force=NORMAL, samples=3)
    alone = {"schema": content["schema"], "friction_law": law_entry(content)}
    other = law_from_fit(written(tmp_path, alone), normal_force=NORMAL, samples=3)
    for a, b in zip(jax.tree.leaves(one.samples), jax.tree.leaves(other.samples), strict=True):
        np.testing.assert_array_equal(a, b)
    assert (one.text, one.warnings, one.velocity) == (other.text, other.warnings, other.velocity)
    assert len(one.warnings) == 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"states": 0}, "the number of states is '0'"),
        ({"effects": ["viscos"]}, "did you mean 'viscous'"),
        ({"effects": "viscous"}, "'effects' is"),
        ({"effects": ["viscous", "gain"]}, "parameter gain.g is missing"),
        ({"coordinate": "round"}, "'coordinate' is 'round'"),
        ({"velocity": [1e-6]}, "'velocity' is"),
        ({"width": -1.0}, "'width' is -1.0"),
        ({"parameters": {}}, "not among the parameters"),
        ({"covariance": [[1.0]]}, "shape"),
        ({"warnings": None}, "'warnings' is None"),
    ],
)
def test_a_damaged_entry_is_refused(tmp_path, change, words):
    content = loop_content("viscous")
    path = written(tmp_path, content | {"friction_law": law_entry(content) | change})
    with pytest.raises(InputError, match=words) as told:
        law_from_fit(path, normal_force=NORMAL)
    assert str(told.value).startswith(str(path)) and "\n" not in str(told.value)
    path = written(tmp_path, content | {"friction_law": [1]})
    with pytest.raises(InputError, match=r"'friction_law\.' is no table; make it again with"):
        law_from_fit(path, normal_force=NORMAL)


def test_missing_entries(tmp_path):
    for key in ("law", "friction_unit", "verdict", "effects", "after"):
        content = loop_content("viscous")
        del content[key]
        with pytest.raises(InputError, match=f"'{key}' is missing; make it again with"):
            law_from_fit(written(tmp_path, content), normal_force=NORMAL)


def test_what_the_verbs_read(tmp_path, capsys):
    content = loop_content("second_state", "gain", verdict="too_weak")
    found = LawOptions(written(tmp_path, content), normal_force="500 N").source(samples=2)
    assert found.text.startswith("slip law with second_state, from the loop (too_weak): ")
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("jaxfric: warning: the loop's verdict is too_weak")
    assert second.startswith("jaxfric: warning: gain is left out of the law")


def test_verbs_refuse_other_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, loop_content("second_state", schema="jaxfric.gains/1"))
    machine = ("--from", path, "--normal-force", "500 N", "--mass", "2", "--velocity", "5 um/s")
    for verb in ("gains", "stability"):
        refused = run(verb, *machine, "--out", "out")
        assert_refused(refused, "'jaxfric.gains/1'", "jaxfric.fit/2", "jaxfric.loop/2")
    assert not Path("out").exists()


@pytest.mark.long
def test_the_whole_commands(tmp_path, monkeypatch):
    """Margins, simulations and figures of a law that is no RateState."""
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, loop_content("thermal", "viscous"))
    machine = ("--from", path, "--normal-force", "500 N", "--mass", "2", "--velocity", "5 um/s")
    options = (
        "--margin",
        "stiffness=1.2",
        "--margin",
        "modulus=0",
        "--samples",
        "2",
        "--max-kv",
        "1e4 N*s/m",
    )
    code, out, err = run("gains", *machine, *options, "--out", "gains")
    assert code == 0 and "slip law with thermal, viscous, from the loop (effects)" in out, err
    assert "simulated from 5 starts: 5 end steady" in out
    code, out, err = run("stability", *machine, "--out", "stability")
    assert code == 0 and "thermal, viscous" in out, err
    code, out, err = run("simulate", *machine, "--kp", "3 MN/m", "--out", "simulation")
    assert code == 0 and "end: steady sliding" in out, err
