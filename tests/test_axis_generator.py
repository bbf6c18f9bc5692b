"""The generator of blind axis records (`fits/blind/axis_*`), against equations written again here.

Friction, loops and sensors are stated a second time. Motion is integrated by `solve_ivp` with
events, one call for each phase between two samples of the controller, the bristle as a
differential equation; the generator steps q and v only and knows the bristle in closed form.
"""

import ast
import functools
import importlib
import json
import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT))
plants = importlib.import_module("fits.blind.axis_plants")
generate = importlib.import_module("fits.blind.axis_generate")

H = 1e-3
BASE = plants.Base(M=95.0, Fv=203.0, Fc=20.0, offset=-3.0)
DRIVE = plants.Controller(kp=160.18, kv=243.45, gtau=35.15)
CASES = {
    "cubic": {"c": 900.0},
    "stribeck": {"fs": 8.0, "vs": 4e-3},
    "direction_asymmetry": {"dFc": 0.2, "dFv": 0.4},
    "position_periodic": {"a": 3.0, "lambda": 2e-3, "phase": 0.7},
    "position_dependence": {"p": 60.0, "centre": 0.125},
    "presliding": {"length": 10e-6, "sigma1": 5000.0},
    "rate_and_state": {"A": 2.0, "B": 3.5, "L": 2e-4, "v_c": 1e-3},
    "time_drift": {"r": 2.0},
    "sensor_lag": {"tau": 2.3e-3},
    "sensor_delay": {"d": 1.7e-3},
}
NULLS = {
    name: {key: 0.0 if i == 0 else CASES[name][key] for i, key in enumerate(keys)}
    for name, keys in plants.EFFECTS.items()
} | {
    "direction_asymmetry": {"dFc": 0.0, "dFv": 0.0},
    "rate_and_state": CASES["rate_and_state"] | {"A": 0.0, "B": 0.0},
}


def short():
    """0.42 s: a move of 4 mm, a pause, 1 mm back and forth, a pause."""
    parts = [(0.0, 30), (4e-3, 120), (0.0, 60), (-1e-3, 80), (1e-3, 80), (0.0, 50)]
    out, place = [], 0.1
    for distance, count in parts:
        out.append(place + 0.5 * distance * (1 - np.cos(np.pi * np.arange(count) / count)))
        place += distance
    return np.concatenate(out)


def friction(base, effects, t, q, v, z, theta=0.0):
    """Force that opposes the motor, the offset included; z: bristle, or sign of sliding."""

    def p(effect, name, null=0.0):
        return effects.get(effect, {}).get(name, null)

    back = z < 0 if "presliding" in effects else v < 0 or (v == 0 and z < 0)
    coulomb = base.Fc * (1 + p("direction_asymmetry", "dFc") * back)
    coulomb += p("position_dependence", "p") * (q - p("position_dependence", "centre"))
    coulomb += p("stribeck", "fs") * np.exp(-((v / p("stribeck", "vs", 1.0)) ** 2))
    coulomb += p("rate_and_state", "A") * np.log1p(abs(v) / p("rate_and_state", "v_c", 1.0)) + theta
    viscous = base.Fv * (1 + p("direction_asymmetry", "dFv") * (v < 0 or (v == 0 and z < 0)))
    angle = 2 * np.pi * q / p("position_periodic", "lambda", 1.0)
    ripple = p("position_periodic", "a") * np.cos(angle + p("position_periodic", "phase"))
    slip = v - abs(v) * z if "presliding" in effects else 0.0
    return (
        coulomb * z + viscous * v + p("cubic", "c") * v**3 + ripple
        + p("presliding", "sigma1") * slip + base.offset + p("time_drift", "r") * t
    )  # fmt: skip


class Halt:
    """The event v = 0 of a motion that slows down."""

    terminal = True

    def __init__(self, direction):
        self.direction = direction

    def __call__(self, t, y, *args):
        return y[1]


def rates(t, y, base, effects, force, sign):
    """Of q, v, z and theta; without a bristle `sign` is that of sliding, and z is idle."""
    length = effects.get("presliding", {}).get("length")
    a = (force - friction(base, effects, t, y[0], y[1], y[2] if length else sign, y[3])) / base.M
    bend, p = (y[1] - abs(y[1]) * y[2]) / length if length else 0.0, effects.get("rate_and_state")
    aged = -abs(y[1]) / p["L"] * (y[3] + p["B"] * np.log1p(abs(y[1]) / p["v_c"])) if p else 0.0
    return [y[1], a, bend, aged]


def reference_motion(base, effects, reference, rtol=1e-10):
    """q and v at the samples, and the force, by `solve_ivp` with events."""
    soft = "presliding" in effects
    q, v, z, theta, sign = reference[0], 0.0, 0.0, 0.0, 0
    if soft:  # at rest without motor force; 3 N of offset pull forwards, where dFc is not
        z = -base.offset / base.Fc
    rows, seen = [], []
    for k, r in enumerate(reference):
        seen.append(q)
        speed = (seen[k] + seen[max(k - 1, 0)] - seen[max(k - 1, 0)] - seen[max(k - 2, 0)]) / 2 / H
        force = DRIVE.gtau * DRIVE.kv * (DRIVE.kp * (r - seen[k]) - speed)
        rows.append((q, v, force))
        t, end = k * H, (k + 1) * H

        while t < end - 1e-15:
            if v == 0.0:
                ahead, behind = (
                    force - friction(base, effects, t, q, 0.0, z if soft else s, theta)
                    for s in (1, -1)
                )
                sign = 1 if ahead > 0 else -1 if behind < 0 else 0
                if sign == 0:  # a drift, 2e-3 N in an interval, may break it loose inside: ignored
                    break

            stop = Halt(-sign)
            options: Any = {"args": (base, effects, force, sign), "rtol": rtol, "atol": 1e-15}
            done = solve_ivp(rates, (t, end), [q, v, z, theta], "DOP853", events=stop, **options)
            t, (q, v, z, theta) = done.t[-1], done.y[:, -1]
            if done.status == 1:
                v = 0.0
    return np.array(rows).T


@pytest.mark.parametrize(
    "names",
    [
        (),
        ("stribeck", "direction_asymmetry"),
        ("position_periodic", "cubic"),
        ("position_dependence", "time_drift"),
        ("presliding",),
        ("presliding", "direction_asymmetry"),
        ("rate_and_state",),
    ],
    ids="+".join,
)
def test_motion_is_that_of_an_adaptive_solver_with_events(names):
    effects = {name: CASES[name] for name in names}
    wanted = short()
    path = plants.simulate(BASE, DRIVE, wanted, effects)
    q, v, force = reference_motion(BASE, effects, wanted)
    errors = [np.max(np.abs(x - y)) for x, y in ((path.q, q), (path.v, v), (path.force, force))]
    # with the kink of the bristle's force at z = 0, where the direction changes, RK4 loses an order
    kinked = {"presliding", "direction_asymmetry"} <= set(names)
    limits = np.array([1e-12, 1e-10, 5e-6]) * (50 if kinked else 1)  # m, m/s, N
    assert np.all(errors < limits), errors
    if effects:
        without = plants.simulate(BASE, DRIVE, wanted, {})
        assert np.max(np.abs(without.force - force)) > 0.1


@functools.cache
def drawn(seed=3):
    """An axis and its reference, and the path of its base without errors of the encoder."""
    request = generate.Request(seed)
    draw = generate.draw_plant(request.entropy(0), request)
    return draw, draw.run({})


@pytest.mark.parametrize("perfect", [True, False])
def test_a_pause_is_true_sticking(perfect):
    draw, _ = drawn()
    path = draw.run({}, perfect=perfect)
    stuck = path.stuck[:-1]
    assert np.all(path.v[:-1][stuck] == 0.0)
    assert np.max(np.abs(np.diff(path.q)[stuck])) < 1e-12
    assert np.all(np.abs(path.force[:-1][stuck] - draw.base.offset) <= draw.base.Fc)
    assert np.all(np.abs(np.diff(path.q)[~stuck]) > 0)
    last = np.flatnonzero(path.stuck[:-1] & ~path.stuck[1:]) + 1  # the sample that breaks loose
    assert len(last) > 10
    assert np.all(np.abs(path.force[last] - draw.base.offset) > draw.base.Fc)
    for one, two in pairwise(draw.moves):
        pause = (path.t > one.start + one.span + 0.15) & (path.t < two.start)
        assert np.all(path.stuck[pause])


def test_a_bristle_does_not_stick():
    draw, _ = drawn()
    path = draw.run({"presliding": CASES["presliding"]}, perfect=False)
    assert np.max(np.abs(path.bristle)) <= 1.0 + 1e-12
    assert not np.any(path.stuck[1000:])  # the encoder moves the force, and the bristle yields


@pytest.mark.parametrize("names", [("cubic", "position_periodic"), ("stribeck", "time_drift")])
def test_forces_balance_at_random_instants(names):
    draw, _ = drawn()
    effects = {name: CASES[name] for name in names}
    path, M = draw.run(effects, perfect=False), draw.base.M
    rng, worst, without = np.random.default_rng(5), 0.0, 0.0
    sliding = np.flatnonzero((path.v[:-1] * path.v[1:] > 0) & (np.abs(path.v[:-1]) > 2e-3))
    for k in rng.choice(sliding, 200, replace=False):

        def net(part, q, v, law, k=k):
            t = path.t[k] + part * H
            return path.force[k] - friction(draw.base, law, t, q, v, np.sign(v))

        (q0, q1), (v0, v1) = path.q[k : k + 2], path.v[k : k + 2]
        a0, a1 = net(0, q0, v0, effects) / M, net(1, q1, v1, effects) / M
        middle = (q0 + q1) / 2 + H * (v0 - v1) / 8, (v0 + v1) / 2 + H * (a0 - a1) / 8
        for law in (effects, {}):
            mean = (net(0, q0, v0, law) + 4 * net(0.5, *middle, law) + net(1, q1, v1, law)) / 6
            excess = abs(M * (v1 - v0) / H - mean)
            if law:
                worst = max(worst, excess)
            else:
                without = max(without, excess)
    # Simpson's rule over a ripple of 2 mm at 0.2 m/s, or over the Stribeck peak
    assert worst < (5e-4 if "position_periodic" in names else 5e-5)
    assert without > 1.0


def test_work_is_what_friction_takes():
    draw, path = drawn()
    base, moved = draw.base, np.diff(path.q)
    work = np.cumsum(path.force[:-1] * moved)
    v0, v1 = path.v[:-1], path.v[1:]
    heat = base.Fc * np.abs(moved) + base.Fv * H * (v0 * v0 + v0 * v1 + v1 * v1) / 3
    stored = 0.5 * base.M * v1**2 + base.offset * (path.q[1:] - path.q[0])
    assert work[-1] > 5.0
    np.testing.assert_allclose(work, np.cumsum(heat) + stored, atol=1e-4 * work[-1])


@pytest.mark.parametrize("effect", NULLS)
def test_a_null_strength_is_the_base(effect):
    base = plants.simulate(BASE, DRIVE, short(), {})
    path = plants.simulate(BASE, DRIVE, short(), {effect: NULLS[effect]})
    np.testing.assert_allclose(path.q, base.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(path.record, base.record, rtol=0, atol=1e-5)
    moved = plants.simulate(BASE, DRIVE, short(), {effect: CASES[effect]})
    assert np.max(np.abs(moved.record - base.record)) > 0.01


def test_a_short_bristle_is_coulomb_friction():
    base = plants.simulate(BASE, DRIVE, short(), {})
    gaps = []
    for length in (2e-6, 2e-8):
        effects = {"presliding": {"length": length, "sigma1": 0.0}}
        gaps.append(np.max(np.abs(plants.simulate(BASE, DRIVE, short(), effects).q - base.q)))
    # the time to bend a bristle, and with it the gap, falls with the root of the length
    assert gaps[0] < 1e-5 and gaps[1] < 0.15 * gaps[0]


def test_sensors_obey_their_equations():
    force = plants.simulate(BASE, DRIVE, short(), {}).force
    t, tau = H * np.arange(len(force)), CASES["sensor_lag"]["tau"]
    seen = plants.sensed(force, {"sensor_lag": {"tau": tau}})
    _, expected, _ = signal.lsim(([1.0], [tau, 1.0]), force - force[0], t)
    np.testing.assert_allclose(seen, expected + force[0], rtol=0, atol=1e-9)
    late = plants.sensed(force, {"sensor_delay": {"d": 1.5 * H}})
    np.testing.assert_allclose(late[2:], (force[1:-1] + force[:-2]) / 2, rtol=0, atol=1e-9)


def prepared(position, force):
    """Regressors, target and moving rows at 100 Hz, written again."""
    low_pass: Any = signal.butter(4, 100.0, fs=1000.0)
    v = np.gradient(signal.filtfilt(low_pass[0], low_pass[1], position), H)
    fast = np.abs(v) > 2e-4
    columns = [np.gradient(v, H), v, np.where(fast, np.sign(v), 0), np.ones_like(v), force]
    rows = [np.all(fast[max(i - 10, 0) : i + 11]) for i in range(0, len(v), 10)]
    return np.stack([signal.decimate(c, 10, zero_phase=True) for c in columns]), np.array(rows)


def left(position, force):
    columns, rows = prepared(position, force)
    fit = np.linalg.lstsq(columns[:4, rows].T, columns[4, rows], rcond=None)[0]
    return columns[4] - fit @ columns[:4], rows


@functools.cache
def record(effects=("stribeck",), rho=0.5, noise="medium"):
    return generate.make(generate.Request(77, effects, rho, noise))


def truth_of(blind):
    """The axis of a record from its JSON contents and columns."""
    gains = plants.Controller(
        *(blind.declared[k] for k in ("kp [1/s]", "kv [V s/m]", "gtau [N/V]"))
    )
    reference = blind.columns["reference_position [um]"] * 1e-6
    return plants.Base(**blind.truth["base"]), gains, reference, blind.truth["parameters"]


@pytest.mark.parametrize(
    ("effects", "rho"),
    [
        (("stribeck",), 0.5),
        (("coulomb", "sensor_lag"), 0.2),
        pytest.param(("presliding",), 1.0, marks=pytest.mark.long),
        pytest.param(("rate_and_state",), 1.0, marks=pytest.mark.long),
        (("time_drift", "position_periodic"), 1.0),
    ],
)
def test_rho_is_what_an_effect_adds_to_the_residual(effects, rho):
    blind = record(effects, rho)
    base, gains, reference, parameters = truth_of(blind)
    assert blind.truth["plant"] == ("coulomb" if "coulomb" in effects else "viscous")
    assert (base.Fv == 0) == ("coulomb" in effects)
    clean = plants.simulate(base, gains, reference, {})
    before, moving = left(clean.q, clean.force)
    assert blind.truth["effects"] == [name for name in effects if name != "coulomb"]
    for effect in blind.truth["effects"]:
        path = plants.simulate(base, gains, reference, {effect: parameters[effect]})
        after, rows = left(path.q, path.record)
        reached = np.sqrt(np.mean((after - before)[rows & moving] ** 2)) / 1.0  # N, medium noise
        assert reached == pytest.approx(rho, rel=0.021)
        assert reached == pytest.approx(blind.truth["rho"]["each"][effect], rel=1e-3)


@pytest.mark.parametrize("noise", generate.NOISES)
def test_a_record_is_the_commanded_force_and_noise(noise):
    blind = record((), noise=noise)
    _, gains, reference, parameters = truth_of(blind)
    assert parameters == {} and blind.truth["effects"] == []
    q, force = blind.columns["position [um]"] * 1e-6, blind.columns["motor_force [N]"]
    speed = np.r_[0, 0, q[2:] - q[:-2]] / (2 * H)
    error = force - gains.gtau * gains.kv * (gains.kp * (reference - q) - speed)
    level = generate.NOISES[noise]
    assert np.std(error[2:]) == pytest.approx(blind.truth["noise"]["sigma at 1 kHz [N]"], rel=0.03)
    kept = np.std(signal.decimate(error[2:], 10, zero_phase=True))
    assert kept == pytest.approx(level, rel=0.08)
    assert abs(np.corrcoef(error[3:], error[2:-1])[0, 1]) < 0.03
    steps = q / blind.truth["encoder"]["quantum [m]"]
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    residual, rows = left(q, force)
    assert np.sqrt(np.mean(residual[rows] ** 2)) < level + 1.0


def test_a_seed_fixes_a_record():
    first, again = record(), generate.make(generate.Request(77, ("stribeck",), 0.5))
    assert again.truth == first.truth and again.declared == first.declared
    for name, column in first.columns.items():
        assert np.array_equal(column, again.columns[name])
    other = generate.Request(78, ("stribeck",), 0.5)
    assert generate.draw_plant(other.entropy(0), other).base != truth_of(first)[0]


def test_references_and_axes_keep_to_their_ranges():
    for seed in range(40):
        request = generate.Request(seed)
        draw = generate.draw_plant(request.entropy(0), request)
        r, v = draw.reference, np.diff(draw.reference) / H
        assert 12.0 <= len(r) * H <= 20.0 and r.min() > -1e-9 and r.max() < 0.25 + 1e-9
        assert np.max(np.abs(v)) == pytest.approx(draw.fastest, rel=1e-3) and draw.fastest <= 0.25
        assert np.max(np.abs(np.diff(v))) / H < 1.6  # m/s2
        assert np.max(np.abs(np.diff(v, 2))) / H**2 < 160  # m/s3: no corner of the acceleration
        assert len(draw.moves) == 18 and r[-1] - r[0] == pytest.approx(
            sum(move.distance for move in draw.moves), abs=1e-12
        )
        assert min(move.speed for move in draw.moves) < 10e-3
        assert abs(draw.base.offset) < 0.5 * draw.base.Fc


def test_what_cannot_be_had_is_refused():
    with pytest.raises(ValueError, match="effect viscous"):
        plants.simulate(BASE, DRIVE, short(), {"viscous": {}})
    weak = plants.Controller(kp=-100.0, kv=243.45, gtau=35.15)
    with pytest.raises(plants.RunawayError):
        plants.simulate(BASE, weak, np.tile(short(), 3), {})
    for wrong in (
        {"effects": ("lugre",)},
        {"effects": ("cubic", "stribeck", "time_drift")},
        {"effects": ("coulomb", "viscous")},
        {"effects": ("coulomb", "direction_asymmetry")},
        {"rho": 0.0},
        {"noise": "white"},
    ):
        with pytest.raises(ValueError):
            generate.Request(1, **wrong)
    generate.Request(1, ("coulomb", "cubic", "stribeck"))
    with pytest.raises(generate.UnreachableError, match="largest"):
        generate._secant(lambda size: 0.1 * size, 1.0, 0.0, 2.0, 0.5)
    with pytest.raises(generate.UnreachableError, match="smallest"):
        generate._secant(lambda size: 0.1 * size, 1.0, 0.5, 2.0, 0.01)
    found = generate._secant(lambda size: 0.1 * size**2, 1.0, 0.0, 9.0, 0.5)[0]
    assert found == pytest.approx(math.sqrt(5), rel=0.02)


def test_files_hide_the_truth(tmp_path):
    common = ["--seed", "4", "--out", str(tmp_path)]
    generate.main(["--effect", "none", *common])
    generate.main(["--effect", "time_drift", "--rho", "1", *common])
    seen = sorted((tmp_path / "records").iterdir())
    assert len(seen) == 2
    for folder in seen:
        assert {path.name for path in folder.iterdir()} == {"record.csv", "declared.json"}
        text = (folder / "record.csv").read_text()
        header = text.splitlines()[1]
        assert header == "time [s],position [um],reference_position [um],motor_force [N]"
        table = np.loadtxt(folder / "record.csv", delimiter=",", skiprows=2)
        assert 12000 <= len(table) <= 20000 and np.allclose(np.diff(table[:, 0]), H)
        declared = json.loads((folder / "declared.json").read_text())
        assert set(declared) == {"kp [1/s]", "kv [V s/m]", "gtau [N/V]", "period [s]"}
        truth = json.loads((tmp_path / "truth" / f"{folder.name}.json").read_text())
        assert truth["effects"] in ([], ["time_drift"]) and truth["seed"] == 4
        assert "drift" not in folder.name + text[:300]
    with pytest.raises(SystemExit):
        generate.main(["--effect", "ageing", *common])


def test_the_generator_shares_no_code_with_the_package():
    allowed = set(sys.stdlib_module_names) | {"numpy", "scipy"}
    for name in ("axis_plants", "axis_generate"):
        tree = ast.parse((ROOT / "fits" / "blind" / f"{name}.py").read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                assert {alias.name.split(".")[0] for alias in node.names} <= allowed
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                assert (node.module or "").split(".")[0] in allowed
            elif isinstance(node, ast.ImportFrom):
                assert node.module == "axis_plants"
