"""The generator of blind records (`fits/blind`), against equations written a second time here.

The plant's own velocity u(t) is taken, and friction is rebuilt from it by the equations of the
effect: what is under test is then both the law and the balance of forces, and each check is
shown to fail when the effect is left out of the rebuilding.
"""

import dataclasses
import functools
import importlib
import json
import math
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from reference import Law, Motion, solve
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

import jaxfric

sys.path.append(str(Path(__file__).parents[1]))
plants = importlib.import_module("fits.blind.plants")
generate = importlib.import_module("fits.blind.generate")

UM = 1e-6
BASE = plants.Base(f0=0.6, A=0.01, B=0.014, L=8 * UM, K=2000.0)
SHORT = plants.Protocol((3 * UM, 20 * UM, 6 * UM), (5.0, 2.5, 8.0))
STRESS = plants.Stress((0.01, 0.004), (0.9, 2.3), (0.4, 2.0))
CASES = {
    "second_state": {"B2": 0.003, "L2": 20 * UM},
    "ageing": {"q": 0.4},
    "velocity_dependent_L": {"n": 0.2},
    "evolution_cutoff": {"Vc": 40 * UM},
    "viscous": {"c": 100.0},
    "stribeck": {"fs": 0.004, "Vs": 8 * UM, "d": 1.4},
    "slip_trend": {"s": -20.0},
    "run_in": {"d": 0.004, "dc": 30 * UM},
    "position_periodic": {"a": 2e-3, "b": -1e-3, "lambda": 25 * UM},
    "normal_stress": {"alpha": 0.3},
    "thermal": {"a_T": 1e-3, "tau_T": 1.5},
    "frictional_delay": {"alpha": 0.07},
    "stiffness": {"kappa": 0.3},
    "damping": {"k_v": 200.0},
    "inertia": {"m": 20.0},
    "servo_lag": {"tau": 0.1},
    "sensor_lag": {"tau": 0.1},
    "sensor_delay": {"d": 0.083},
    "time_drift": {"r": -1e-4},
    "gain": {"g": 0.05},
}
NULLS = {
    name: {key: 0.0 if i == 0 else CASES[name][key] for i, key in enumerate(keys)}
    for name, keys in plants.EFFECTS.items()
} | {
    "evolution_cutoff": {"Vc": math.inf},
    "position_periodic": {"a": 0.0, "b": 0.0, "lambda": 25 * UM},
}


def sampled(protocol, count):
    spans = zip(protocol.starts, protocol.durations, strict=True)
    return np.concatenate([start + span * np.arange(count) / count for start, span in spans])


def run(effects, *, count=1500, rtol=1e-10, base=BASE):
    stress = STRESS if "normal_stress" in effects else None
    return plants.simulate(base, SHORT, effects, sampled(SHORT, count), stress=stress, rtol=rtol)


def rebuild(path, effects, stressed, own=0.0):
    """Friction, record, misbalance of forces, slip and load point from u(t), by the catalogue.

    `own` is the base's share of the ageing law.
    """

    def p(effect, name, null=0.0):
        return effects.get(effect, {}).get(name, null)

    B, L, V0, edges = BASE.B, BASE.L, SHORT.velocities[0], [*SHORT.starts, np.inf]
    pieces = [(path.t >= a) & (path.t < b) for a, b in pairwise(edges)]
    splines = [CubicSpline(path.t[here], path.u[here]) for here in pieces]

    def u_at(t):
        k = int(np.searchsorted(SHORT.starts, t, side="right")) - 1
        return float(splines[k](t)) if t > 0 else 0.0

    def n_at(t):
        return np.exp(
            sum(
                a * (np.sin(w * t + q) - np.sin(q))
                for a, w, q in zip(
                    STRESS.amplitudes, STRESS.frequencies, STRESS.phases, strict=True
                )
            )
        )

    def law(u, x, theta, theta2, T):
        V = V0 * np.exp(u)
        wave = 2 * np.pi * x / p("position_periodic", "lambda", 1.0)
        return (
            BASE.f0 + BASE.A * u + theta + theta2 - p("thermal", "a_T") * T
            + p("viscous", "c") * V + p("slip_trend", "s") * x
            + p("stribeck", "fs") * np.exp(-(V / p("stribeck", "Vs", 1)) ** p("stribeck", "d", 1))
            + p("run_in", "d") * (1 - np.exp(-x / p("run_in", "dc", 1.0)))
            + p("position_periodic", "a") * np.sin(wave)
            + p("position_periodic", "b") * np.cos(wave)
        )  # fmt: skip

    def rates(t, z, k, V_c):
        x, theta, theta2, T, y, _, V_m = z
        u = float(splines[k](t))
        V, f = V0 * np.exp(u), law(u, x, theta, theta2, T)
        past = u_at(t - p("frictional_delay", "alpha")) if "frictional_delay" in effects else u
        steady = -B * (past - np.log(1 + V / p("evolution_cutoff", "Vc", np.inf)))
        slip = -(V / (L * (V / V0) ** p("velocity_dependent_L", "n"))) * (theta - steady)
        length = L * (V / V0) ** p("velocity_dependent_L", "n")
        age = (length / V0) * np.exp(theta / B)  # Dieterich's, of a contact
        ageing = B * (1 + V / p("evolution_cutoff", "Vc", np.inf) - V * age / length) / age
        q, h = own + p("ageing", "q"), 1e-6
        dtheta = (1 - q) * slip + q * ageing
        if stressed:
            log_rate = (np.log(n_at(t + h)) - np.log(n_at(t - h))) / (2 * h)
            dtheta = dtheta - p("normal_stress", "alpha") * log_rate
        tau_m, tau_y = p("servo_lag", "tau"), p("sensor_lag", "tau")
        return [
            V,
            dtheta,
            -(V / p("second_state", "L2", 1.0)) * (theta2 + p("second_state", "B2") * u),
            (f * V / (BASE.f0 * V0) - T) / p("thermal", "tau_T", 1.0),
            (f - y) / tau_y if tau_y else 0.0,
            V_m if tau_m else V_c,
            (V_c - V_m) / tau_m if tau_m else 0.0,
        ]

    theta = B * np.log(1 + V0 / p("evolution_cutoff", "Vc", np.inf))
    T = law(0.0, 0.0, theta, 0.0, 0.0) / (BASE.f0 + p("thermal", "a_T"))
    start_force = law(0.0, 0.0, theta, 0.0, T)
    z, columns = np.array([0.0, theta, 0.0, T, start_force, 0.0, V0]), []
    for k, here in enumerate(pieces):
        t0, V_c = SHORT.starts[k], SHORT.velocities[k]
        t1 = t0 + SHORT.durations[k]
        grid = np.append(path.t[here], t1)
        done = solve_ivp(
            rates, (t0, t1), z, "DOP853", grid, args=(k, V_c), rtol=1e-8, atol=1e-12, max_step=0.1
        )
        z = done.y[:, -1]
        if "servo_lag" not in effects:
            done.y[6] = V_c
        columns.append(done.y[:, :-1])
    x, theta, theta2, T, y, x_m, V_m = np.concatenate(columns, axis=1)
    f, V = law(path.u, x, theta, theta2, T), V0 * np.exp(path.u)
    dV = V * np.concatenate([s(path.t[h], 1) for s, h in zip(splines, pieces, strict=True)])
    force = start_force + BASE.K * np.exp(p("stiffness", "kappa")) * (x_m - x)
    force = force + p("damping", "k_v") * (V_m - V)
    excess = force - f * (n_at(path.t) if stressed else 1.0) - p("inertia", "m") * dV
    seen = y if "sensor_lag" in effects else f
    if delay := p("sensor_delay", "d"):
        fine = run(effects, count=6000)
        seen = np.interp(path.t - delay, fine.t, fine.friction)
    return f, (1 + p("gain", "g")) * seen + p("time_drift", "r") * path.t, excess, x, x_m


def faults(path, effects, stressed=False, own=0.0):
    """The largest misfits of friction, record, balance, slip [um] and load point [um]."""
    f, y, excess, x, x_m = rebuild(path, effects, stressed, own)
    return np.array(
        [
            np.max(np.abs(f - path.friction)),
            np.max(np.abs(y - path.record)),
            np.max(np.abs(excess)),
            np.max(np.abs(x - path.slip)) / UM,
            np.max(np.abs(x_m - path.load_point)) / UM,
        ]
    )


@pytest.mark.parametrize("effect", CASES)
def test_a_plant_obeys_the_equation_of_its_effect(effect):
    effects, stressed = {effect: CASES[effect]}, effect == "normal_stress"
    path = run(effects)
    good = faults(path, effects, stressed)
    # the spline of u and, with mass, its derivative bound the comparison; 2e-6 is 0.007 sigma
    assert np.all(good < 2e-6), good
    assert np.max(faults(path, {}, stressed)) > 100 * max(np.max(good), 1e-7)


def test_effects_that_meet_obey_both_equations():
    names = ("second_state", "viscous", "damping", "servo_lag", "sensor_lag", "gain", "thermal")
    effects = {name: CASES[name] for name in names}
    assert np.all(faults(run(effects), effects) < 2e-6)


def test_effects_on_a_base_with_the_ageing_law():
    names = ("evolution_cutoff", "velocity_dependent_L")
    effects = {name: CASES[name] for name in names} | {"ageing": {"q": -0.3}}
    path = run(effects, base=dataclasses.replace(BASE, q=1.0))
    assert np.all(faults(path, effects, own=1.0) < 2e-6)
    for name in effects:
        fewer = {k: v for k, v in effects.items() if k != name}
        assert np.max(faults(path, fewer, own=1.0)) > 1e-4


@pytest.mark.parametrize("effect", NULLS)
def test_a_null_amplitude_is_the_base(effect):
    t, stress = sampled(SHORT, 60), STRESS if effect == "normal_stress" else None
    base = plants.simulate_base(BASE, SHORT, t, stress=stress, rtol=1e-11)
    path = plants.simulate(BASE, SHORT, {effect: NULLS[effect]}, t, stress=stress, rtol=1e-11)
    np.testing.assert_allclose(path.record, base, rtol=0, atol=1e-9)


@pytest.mark.parametrize("mass", [0.0, 5.0])
def test_the_base_is_that_of_the_reference(mass):
    t = sampled(SHORT, 100)
    law = Law("slip", BASE.f0, BASE.A, (BASE.B,), (BASE.L,))
    motion = Motion(tuple(SHORT.starts), SHORT.velocities)
    base = plants.Base(BASE.f0, BASE.A, BASE.B, BASE.L, BASE.K, m=mass, k_v=10.0 if mass else 0.0)
    expected = solve(law, motion, BASE.K, t, mass=mass, damping=base.k_v, rtol=1e-10)
    path = plants.simulate(base, SHORT, {}, t)
    np.testing.assert_allclose(path.friction, expected.f, rtol=0, atol=3e-8)
    np.testing.assert_allclose(path.slip, expected.x, rtol=0, atol=2e-11)


def test_plants_refuse_what_they_cannot_do():
    t = sampled(SHORT, 10)
    with pytest.raises(ValueError, match="effect presliding"):
        plants.simulate(BASE, SHORT, {"presliding": {}}, t)
    heavy = plants.Base(0.6, 0.01, 0.014, 8 * UM, 2000.0, m=1.0)
    with pytest.raises(ValueError, match="without mass"):
        plants.simulate(heavy, SHORT, {"frictional_delay": {"alpha": 0.1}}, t)
    soft = plants.Base(0.6, 0.01, 0.014, 8 * UM, 300.0)
    with pytest.raises(plants.RunawayError):
        plants.simulate(soft, SHORT, {}, t)
    for wrong in ({"effects": ("aging",)}, {"rho": 0.0}, {"noise": "pink"}, {"channels": ("x",)}):
        with pytest.raises(ValueError):
            generate.Request(1, **wrong)


@functools.cache
def record(effects=("second_state",), rho=0.5, **more):
    return generate.make(generate.Request(77, effects, rho, **more))


def truth_of(blind):
    """Base, protocol, times, effects and stiffness of a record, from its two JSON contents."""
    base = {k: v for k, v in blind.truth["base"].items() if k != "V0"}
    velocities = tuple(blind.declared["velocities [m/s]"])
    protocol = plants.Protocol(velocities, tuple(150 * UM / v for v in velocities))
    return plants.Base(**base), protocol, blind.columns["time [s]"], blind.truth["parameters"]


@pytest.mark.parametrize(
    "effects",
    [
        ("second_state",),
        pytest.param(("sensor_lag",), marks=pytest.mark.long),
        pytest.param(("stribeck",), marks=pytest.mark.long),
        ("gain", "slip_trend"),
    ],
)
def test_rho_is_what_a_refit_leaves(effects):
    blind = record(effects)
    base, protocol, t, parameters = truth_of(blind)
    for effect in effects:
        clean = plants.simulate(base, protocol, {effect: parameters[effect]}, t).record

        def left(p, clean=clean):
            A, B, L = np.exp(p[1:])
            fit = plants.Base(p[0], A, B, L, blind.declared["stiffness [1/m]"])
            return (plants.simulate_base(fit, protocol, t) - clean) / 3e-4

        start = [0.6, *np.log([1.1 * base.A, 1.05 * base.B, 0.9 * base.L])]
        fit = least_squares(left, start, x_scale=[1e-3, 0.1, 0.1, 0.1], diff_step=1e-6)
        rho = np.sqrt(np.mean(fit.fun**2))
        assert rho == pytest.approx(0.5, rel=0.05)
        assert rho == pytest.approx(blind.truth["rho"]["each"][effect], rel=5e-3)
        if len(effects) == 1:
            biased = blind.truth["base_refit"]
            np.testing.assert_allclose(
                np.exp(fit.x[1:]), [biased[k] for k in ("A", "B", "L")], rtol=1e-3
            )


def test_a_record_is_its_clean_friction_and_noise():
    for noise, correlation in (("white", 0.0), ("ar1-0.9", 0.9)):
        blind = record((), noise=noise)
        base, protocol, t, parameters = truth_of(blind)
        assert parameters == {} and blind.truth["effects"] == []
        error = blind.columns["friction [1]"] - plants.simulate_base(base, protocol, t)
        assert np.std(error) == pytest.approx(3e-4, rel=0.25 if correlation else 0.05)
        lag = np.corrcoef(error[1:], error[:-1])[0, 1]
        assert lag == pytest.approx(correlation, abs=0.06)
        moved = blind.columns["load_point_displacement [um]"] - protocol.displacement(t) / UM
        assert np.std(moved) == pytest.approx(0.02, rel=0.1)


@pytest.mark.long
def test_a_seed_fixes_a_record():
    first = record()
    again = generate.make(generate.Request(77, ("second_state",), 0.5))
    assert again.truth == first.truth and again.declared == first.declared
    for name, column in first.columns.items():
        assert np.array_equal(column, again.columns[name])
    other = generate.Request(78, ("second_state",), 0.5)
    assert generate.draw_plant(other.entropy(0), other).base != truth_of(first)[0]


def test_protocols_and_plants_keep_to_their_ranges():
    for seed in range(60):
        sampling = ("uniform", "thinned")[seed % 2]
        rng = np.random.default_rng(seed)
        draw = generate.draw_plant(rng, generate.Request(seed, sampling=sampling))
        base, v = draw.base, np.array(draw.protocol.velocities)
        assert len(v) == 12 and len(set(v)) == 5 and v.max() / v.min() == pytest.approx(100)
        factors = np.exp(np.abs(np.diff(np.log(v))))
        assert factors.min() > 2.9 and factors.max() < 11.2
        np.testing.assert_allclose(np.multiply(v, draw.protocol.durations), 150 * UM)
        assert 2700 <= len(draw.t) <= 3300 and np.all(np.diff(draw.t) > 0) and draw.t[0] == 0
        assert base.K >= 3 * (base.B - base.A) / base.L and draw.stress is None


def test_an_unreachable_rho_is_an_error():
    with pytest.raises(generate.UnreachableError, match="largest amplitude"):
        generate._secant(lambda size: 0.1 * size, 1.0, 2.0, 0.5, 0.05)
    assert generate._secant(lambda size: 0.1 * size**2, 1.0, 9.0, 0.5, 1e-6)[0] == pytest.approx(
        math.sqrt(5)
    )


@pytest.mark.long
def test_files_are_read_and_hide_the_truth(tmp_path):
    common = ["--seed", "4", "--out", str(tmp_path), "--channels", "slip,load_point,normal_stress"]
    generate.main(["--effect", "none", *common])
    generate.main(["--effect", "time_drift", "--rho", "1", *common])
    seen = sorted((tmp_path / "records").iterdir())
    assert len(seen) == 2
    for folder in seen:
        read = jaxfric.read(folder / "record.csv")
        assert 2700 <= len(read) <= 3300 and read.friction_unit == "1"
        assert read.slip is not None and np.std(read.slip - read.load_point_displacement) > 1e-7
        assert read.normal_stress is not None and np.std(read.normal_stress) > 1e4
        declared = json.loads((folder / "declared.json").read_text())
        assert set(declared) == {"stiffness [1/m]", "noise [1]", "starts [s]", "velocities [m/s]"}
        assert {path.name for path in folder.iterdir()} == {"record.csv", "declared.json"}
        truth = json.loads((tmp_path / "truth" / folder.name / "truth.json").read_text())
        assert truth["effects"] in ([], ["time_drift"]) and truth["seed"] == 4
        assert "drift" not in folder.name + (folder / "record.csv").read_text()[:200]
    with pytest.raises(SystemExit):
        generate.main(["--effect", "aging", *common])
