"""Rate-and-state friction on a servo axis: its state, the closed loop, gains, and its name.

Against SciPy's integration of the equations written again here, the golden numbers of the theory,
NumPy's roots of the characteristic equation, and records made from a prescribed motion.
"""

import dataclasses
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import run
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from jaxfric import InputError, study
from jaxfric.axis import AXIS_CATALOGUE, close_axis_loop
from jaxfric.cli.folder import Folder
from jaxfric.effects.axis import DirectionAsymmetry, Presliding, RateAndState
from jaxfric.gains import find_gains
from jaxfric.gains.axis import axis_gains, state_gains
from jaxfric.motion import MeasuredMotion
from jaxfric.plain import plain
from jaxfric.records import Drive, axis_from_arrays
from jaxfric.rig.axis import AxisRig
from jaxfric.rig.axis_state import AxisRateState
from jaxfric.rig.friction import Conditions
from jaxfric.saved import law_from_fit
from jaxfric.simulation.axis_closed_loop import Controller, simulate_closed_loop, substeps
from jaxfric.stability.claims import Curve
from jaxfric.stability.linear import linear_friction

H = 1e-3
M, FV, FC, F0 = 60.0, 150.0, 20.0, -2.0
A, B, L, VC = 4.0, 7.0, 5e-4, 1e-3


def rig_of(A=A, B=B, L=L, v_c=VC, *, M=M, Fv=FV, width=1e-4, presliding=None):
    rig = AxisRig(M, Fv, FC, F0, width=width)
    if presliding is not None:
        rig = Presliding(**presliding).embed(rig)
    return RateAndState(A=A, B=B, L=L, v_c=v_c).embed(rig)


# ---- the state -------------------------------------------------------------------------------


@jax.jit
def along(L, t, v):
    return AxisRateState(A, B, L, VC).along(MeasuredMotion(t, 0 * t, v, 0 * t, 0 * t))


def along_of(t, v):
    """theta along a motion, of a slip length."""
    return lambda L: along(L, jnp.asarray(t), jnp.asarray(v))


def test_the_state_along_a_motion_with_reversals():
    speed = lambda t: 0.02 * np.sin(2 * np.pi * 1.1 * t) + 0.01 * np.sin(2 * np.pi * 3.3 * t)  # noqa: E731
    t = np.arange(1501) * H
    found = solve_ivp(
        lambda t, y: abs(speed(t)) / L * (-B * np.log1p(abs(speed(t)) / VC) - y), (0, 1.5), [0.0],
        t_eval=t, rtol=1e-9, atol=1e-10, max_step=1e-3,
    ).y[0]  # fmt: skip
    motion = along_of(t, speed(t))
    assert np.max(np.abs(motion(L) - found)) < 2e-3 * B
    assert np.max(np.abs(motion(1.1 * L) - found)) > 0.1
    # coarser rows: of second order
    assert np.max(np.abs(along_of(t[::4], speed(t[::4]))(L) - found[::4])) < 3e-2 * B


def test_a_state_that_begins_in_motion_is_steady_and_one_at_rest_stays():
    t = np.arange(50) * H
    np.testing.assert_allclose(along_of(t, 0.01 + 0 * t)(L), -B * np.log1p(10.0), rtol=1e-12)
    theta = along_of(t, 0.01 * (t < 0.02))(L)
    assert float(theta[-1]) == float(theta[25]) < 0


@pytest.mark.parametrize("x", [1e-300, 1e-160, 1e-9, 1e-4, 0.099, 0.101, 2.0, 30.0])
def test_derivatives_of_the_state_over_any_path(x):
    """One leg from v = a to b over a path x L, at any size of the path: rest ends in the smallest.

    theta = ss_b + (ss_a - ss_b) m(x), where m and its derivatives are integrals: quadrature.
    """
    v = np.asarray([2e-3, 1e-2])
    path = x * L
    t = jnp.asarray([0.0, 2 * path / v.sum()])
    theta = lambda L: along(L, t, jnp.asarray(v))[1]  # noqa: E731
    s, w = np.polynomial.legendre.leggauss(60)
    s, w = (s + 1) / 2, w / 2
    m, first, second = (np.sum(w * (-s) ** k * np.exp(-s * x)) for k in range(3))
    ss = -B * np.log1p(v / VC)
    fall = ss[0] - ss[1]
    assert float(theta(L)) == pytest.approx(ss[1] + fall * m, rel=1e-12)
    by_L = -x / L * first
    assert float(jax.grad(theta)(L)) == pytest.approx(fall * by_L, rel=1e-9, abs=0)
    terms = np.asarray([2 * x / L**2 * first, (x / L) ** 2 * second]) * fall
    for found in (jax.grad(jax.grad(theta)), jax.jacfwd(jax.jacfwd(theta))):
        assert abs(float(found(L)) - terms.sum()) < 1e-9 * np.max(np.abs(terms))


# ---- the closed loop -------------------------------------------------------------------------


def sampled(reference, controller, width, L=L):
    """The closed loop by SciPy, sample after sample."""
    kp, K = float(controller.position_gain), float(controller.K_d)

    def rates(t, y, force):
        _, v, theta = y
        u = np.log1p(abs(v) / VC)
        resisted = FV * v + F0 + np.tanh(v / width) * (FC + A * u + theta)
        return [v, (force - resisted) / M, abs(v) / L * (-B * u - theta)]

    y, last, before_last = np.array([reference[0], 0.0, 0.0]), reference[0], reference[0]
    rows = []
    for r in reference:
        rows.append(y.copy())
        force = K * (kp * (r - y[0]) - (y[0] - before_last) / (2 * H))
        before_last, last = last, y[0]
        y = solve_ivp(rates, (0, H), y, "DOP853", args=(force,), rtol=1e-9, atol=1e-13).y[:, -1]
    return np.array(rows)


def test_the_closed_loop_is_that_of_an_adaptive_solver():
    t = np.arange(400) * H
    reference = 2e-3 * (1 - np.cos(2 * np.pi * 4 * t))
    controller = Controller(*(jnp.asarray(x) for x in (120.0, 5000.0, H)))
    truth = sampled(reference, controller, 5e-4)
    rig = rig_of(width=5e-4)
    first = jnp.full(3, reference[0])
    path = (t, reference, np.gradient(reference, H), 0 * t, 0 * t)
    number = substeps(rig, H, MeasuredMotion(*(jnp.asarray(x) for x in path)))
    assert number is not None
    made = simulate_closed_loop(rig, controller, jnp.asarray(reference), first, substeps=number)
    error = np.max(np.abs(made.position - truth[:, 0]))
    other = np.max(np.abs(sampled(reference, controller, 5e-4, 2 * L)[:, 0] - truth[:, 0]))
    assert error < 1e-3 * other
    assert np.max(np.abs(made.velocity - truth[:, 1])) < 1e-5
    # a slip length far below what a step resolves: the steady curve, and no blow-up
    quick = simulate_closed_loop(
        rig_of(L=1e-8, width=5e-4), controller, jnp.asarray(reference), first
    )
    slow = simulate_closed_loop(
        rig_of(A=A - B, B=0.0, width=5e-4), controller, jnp.asarray(reference), first
    )
    assert np.max(np.abs(quick.position - slow.position)) < 0.05 * np.max(
        np.abs(made.position - slow.position)
    )


# ---- gains -----------------------------------------------------------------------------------


def test_the_golden_critical_stiffness():
    """(25) at m = 2, k_v = .5, A = 1, B = 3, L = 1 mm, V0 = 2 mm/s."""
    rig = rig_of(1.0, 3.0, 1e-3, 1e-12, M=2.0, Fv=0.5, width=1e-15)
    found = state_gains(rig, 0.0, 2e-3, 2e-3 * (1 + 1e-10))
    assert found is not None and found.stiff is not None
    # 1 + V/v_c for V/v_c
    assert found.stiff.critical_stiffness == pytest.approx(2014.976023976024, rel=1e-8)
    assert found.stiff.frequency == pytest.approx(2.826307129101859, rel=1e-8)
    assert found.least_damping == pytest.approx(1000 - 0.5, rel=1e-8)


def closed_form(V):
    """Steady slope and k_cr of (25) for one state and a cut-off."""
    damping, memory = FV + A / (V + VC), B / (V + VC)
    X, Y = damping * V, memory * V
    return damping - memory, np.where(Y > X, (Y - X) / L * (M * V**2 / (X * L) + 1), 0.0)


def test_both_optima_at_the_worst_velocity():
    drive = Drive(gain=35.0, position_gain=160.0, velocity_gain=243.0)
    found = state_gains(rig_of(), 0.1, 1e-3, 0.1, drive=drive)
    assert found is not None and found.stiff is not None
    V = np.geomspace(1e-3, 0.1, 20001)
    slope, stiffness = closed_form(V)
    assert found.least_damping == pytest.approx(-slope.min(), rel=1e-4)
    assert abs(found.worst_velocity) == pytest.approx(V[np.argmin(slope)], rel=0.02)
    assert found.velocity_gain == pytest.approx(-slope.min() / 35.0, rel=1e-4)
    assert found.stiff.critical_stiffness == pytest.approx(stiffness.max(), rel=1e-4)
    assert abs(found.stiff.worst_velocity) == pytest.approx(V[np.argmax(stiffness)], rel=0.02)
    assert found.stiff.position_gain == pytest.approx(stiffness.max() / (35 * 243), rel=1e-4)
    # the steady curve alone gives the same damping, (16)-(17)
    curve = lambda v: FV * v + np.sign(v) * (FC + (A - B) * np.log1p(np.abs(v) / VC))  # noqa: E731
    assert axis_gains(curve, 1e-3, 0.1).least_damping == pytest.approx(
        found.least_damping, rel=1e-3
    )
    assert "Nothing can be said" in found.sentence()  # what it rests on was not told
    exact = dataclasses.replace(found, curve=Curve(found.slope, 0.0, 1e-3, 0.1))
    assert "or stiffness k_p above" in exact.sentence()


def test_an_axis_whose_record_does_not_fix_its_mass_has_gains():
    """A fitted mass may underflow to 0: K_cr is then that of a quasi-static slider, (B - A)/L."""
    light = eqx.tree_at(lambda r: r.mass, rig_of(), jnp.zeros(()))
    found = state_gains(light, 0.0, 1e-3, 0.1)
    assert found is not None and found.stiff is not None
    V = np.geomspace(1e-3, 0.1, 20001)
    X, Y = (FV + A / (V + VC)) * V, B / (V + VC) * V
    assert found.stiff.critical_stiffness == pytest.approx(((Y - X) / L).max(), rel=1e-4)


@pytest.mark.long
def test_gains_of_other_rigs():
    """A bristle has no memory about steady motion; the worse direction is found; no k_p suffices
    without a direct effect."""
    bent = {"a": 15.0, "sigma_1": 900.0, "x_c": 2e-5}
    plain = Presliding(**bent).embed(AxisRig(M, FV, FC, F0, width=1e-4))
    assert state_gains(plain, 0.0, 1e-3, 0.1) is None
    assert state_gains(AxisRig(M, FV, FC, F0, width=1e-4), 0.0, 1e-3, 0.1) is None
    one, two = (state_gains(rig_of(presliding=p), 0.0, 1e-3, 0.1) for p in (None, bent))
    assert one is not None and two is not None and one.stiff is not None and two.stiff is not None
    assert two.stiff.critical_stiffness == pytest.approx(one.stiff.critical_stiffness, rel=1e-8)
    assert two.least_damping == pytest.approx(one.least_damping, rel=1e-8)
    assert one.both_directions and one.worst_velocity > 0 and one.stiff.worst_velocity > 0
    askew = DirectionAsymmetry(d=50.0).embed(rig_of())
    found = state_gains(askew, 0.0, 1e-3, 0.1)
    assert found is not None and found.stiff is not None
    assert found.worst_velocity < 0 and found.stiff.worst_velocity < 0 and not found.both_directions
    assert found.stiff.critical_stiffness > 1.1 * one.stiff.critical_stiffness
    none = state_gains(rig_of(A=0.0, Fv=-1.0), 0.0, 1e-3, 0.1)
    assert none is not None and none.stiff is not None
    none = dataclasses.replace(none, curve=Curve(none.slope, 0.0, 1e-3, 0.1))
    assert (
        none.stiff is not None
        and none.stiff.critical_stiffness == np.inf
        and "stiffness k_p above" not in none.sentence()
    )


# ---- the law of a loop.json ------------------------------------------------------------------

BASE = {"M": M, "F_v": FV, "F_c": FC, "F_0": F0}
FOUND = {
    "rate_and_state": {"A": A, "B": B, "L": L, "v_c": VC},
    "stribeck": {"fs": 3.0, "vs": 4e-3, "n": 1.0},
    "log_viscous": {"c": 2.0, "v_c": 2e-3},
    "cubic": {"c": 4e4},
    "presliding": {"a": 5.0, "sigma_1": 900.0, "x_c": 2e-5},
    "direction_asymmetry": {"d": 40.0},
    "position_periodic": {"c": 0.3, "s": 0.4, "wavelength": 5e-3},
    "gravity": {"a": 3.0, "b": 4.0},
    "position_dependence": {"k": 20.0, "m": 50.0},
    "time_drift": {"r": 0.1, "s": 0.1},
    "servo_lag": {"tau": 1e-3},
    "sensor_lag": {"tau": 1e-3},
    "sensor_delay": {"d": 1e-3},
}


def axis_loop(*effects, part=0.01, axis=None, **changes):
    """The entries of the loop.json of an axis that a law is made of; A and B correlated."""
    values = BASE | {f"{e}.{name}": v for e in effects for name, v in FOUND[e].items()}
    size = part * np.abs(list(values.values()))
    correlation = np.eye(len(values))
    if effects[:1] == ("rate_and_state",):
        correlation[4, 5] = correlation[5, 4] = 0.9
    content = {
        "schema": "jaxfric.loop/2",
        "friction_unit": "N",
        "law": "coulomb_viscous",
        "verdict": "effects",
        "steps": [[0.0, 2e-3], [1.0, -0.05]],
        "effects": list(effects),
        "after": {
            "parameters": {k: {"value": v, "determined": True} for k, v in values.items()},
            "free": list(values),
            "covariance": (correlation * np.outer(size, size)).tolist(),
        },
        "axis": {"coordinate": "linear", "sign_width": 1e-4, **(axis or {})},
        "warnings": [],
    }
    return {**content, **changes}


def axis_source(folder, *effects, samples=0, force=None, **changes):
    path = folder / "loop.json"
    path.write_text(json.dumps(axis_loop("rate_and_state", *effects, **changes)))
    return law_from_fit(path, normal_force=force, samples=samples)


def by_hand(V, effects, sign=1.0):
    """Steady friction against motion and its slope, of motion forwards (1) or backwards (-1)."""
    viscous = FV + sign * (40.0 if "direction_asymmetry" in effects else 0.0)
    friction = FC + sign * F0 + viscous * V + (A - B) * np.log1p(V / VC)
    slope = viscous + (A - B) / (V + VC)
    if "stribeck" in effects:
        part = 3.0 * np.exp(-V / 4e-3)
        friction, slope = friction + part, slope - part / 4e-3
    if "log_viscous" in effects:
        friction, slope = friction + 2 * np.log1p(V / 2e-3), slope + 2 / (V + 2e-3)
    if "cubic" in effects:
        friction, slope = friction + 4e4 * V**3, slope + 12e4 * V**2
    return friction, slope


def steady_face(law, V):
    """Steady friction, instantaneous and steady slope of a law."""
    at = Conditions(jnp.zeros(()), jnp.zeros(()))
    V = jnp.asarray(V)
    linear = linear_friction(law, V)
    steady = jax.grad(lambda V: law.force(V, law.steady_state(V), at))(V)
    return float(law.force(V, law.steady_state(V), at)), float(linear.slope), float(steady)


@pytest.mark.parametrize(
    "effects", [(), ("stribeck", "cubic"), ("log_viscous", "presliding"), ("direction_asymmetry",)]
)
def test_the_law_of_a_loop_is_the_friction_of_its_axis(tmp_path, effects):
    """Against the equations by hand, and the rig of the axis itself; the worse direction."""
    found = axis_source(tmp_path, *effects)
    sign = -1.0 if "direction_asymmetry" in effects else 1.0
    rig = AxisRig(M, FV, FC, F0, width=1e-4)
    for id in ("rate_and_state", *effects):
        rig = AXIS_CATALOGUE[id](**FOUND[id]).embed(rig)
    for V in (1e-3, 4e-3, 0.05):
        force, instant, steady = steady_face(found.law, V)
        friction, slope = by_hand(V, effects, sign)
        assert force == pytest.approx(friction, rel=1e-12)
        assert steady == pytest.approx(slope, rel=1e-9)
        assert instant == pytest.approx(slope + B / (V + VC), rel=1e-9)
        v, zero = jnp.asarray(sign * V), jnp.zeros(())
        own = sign * float(rig.friction(zero, v, zero, rig.steady(v)))
        # the axis' own sign is smoothed over 0.1 mm/s
        assert force == pytest.approx(own, rel=1e-6)
    assert found.mass == M and found.seen == (2e-3, 0.05)
    assert [line.split(":")[0] for line in found.warnings] == list(effects[:1] if sign < 0 else ())


def test_gains_of_the_law_of_a_loop(tmp_path):
    """k_p = 1.2 k_cr of (25) with the axis' own mass; v_c and L as the record resolves them."""
    kv = 20.0
    V = np.geomspace(2e-3, 0.02, 20001)  # gains hold between the velocities that are asked for

    def needed(L, VC):
        X, Y = (kv + FV + A / (V + VC)) * V, B / (V + VC) * V
        return np.where(Y > X, (Y - X) / L * (M * V**2 / (X * L) + 1), 0.0).max()

    def found(**changes):
        gains = find_gains(
            axis_source(tmp_path, **changes), velocity=V[::2000], mass=None,
            margin={"modulus": 0, "stiffness": 1.2},
            lower=(None, kv), upper=(None, kv * (1 + 1e-9)),
        )  # fmt: skip
        return gains.kp / 1.2

    assert found() == pytest.approx(needed(L, VC), rel=1e-6)
    rough = found(axis={"sign_width": 2e-3, "least_slip_length": 1e-3})
    assert rough == pytest.approx(needed(1e-3, 2e-3), rel=1e-6)


def test_samples_of_the_law_of_a_loop(tmp_path):
    """Mean and covariance; A, L and v_c positive; of each sample its own direction."""
    found = axis_source(tmp_path, "direction_asymmetry", samples=3000, part=0.4)
    state = found.samples.rig.states[0]
    a, b, length = (np.asarray(x)[1:] for x in (state.A, state.B, state.L))
    assert float(state.A[0]) == A and np.all(a > 0) and np.all(length > 0)
    assert np.corrcoef(np.log(a), b)[0, 1] == pytest.approx(0.9, abs=0.03)
    assert np.std(b) == pytest.approx(0.4 * B, rel=0.05)
    assert np.std(np.log(length)) == pytest.approx(0.4, rel=0.05)
    d = np.asarray(found.samples.rig.terms[0].d)
    np.testing.assert_array_equal(np.asarray(found.samples.direction), np.where(d > 0, -1.0, 1.0))


def test_what_is_left_out_of_the_law_of_a_loop(tmp_path):
    left = ("position_periodic", "position_dependence", "gravity", "time_drift", "servo_lag")
    late = ("sensor_lag", "sensor_delay")
    open_ = {"claim": "open", "sentence": "Nothing is said of stability: it stuck."}
    found = axis_source(
        tmp_path, *left, *late, verdict="outside_catalogue", warnings=["A is odd"],
        axis={"gains": open_},
    )  # fmt: skip
    warned, verdict, claim, *lines = found.warnings
    assert warned == "the loop warned: A is odd" and "does not describe the record" in verdict
    assert claim.endswith(open_["sentence"])
    assert [line.split()[0] for line in lines] == [*left, *late]
    assert f"add {2 * np.pi * 0.5 / 5e-3:.3g} N/m to k_p" in lines[0]
    assert "add 30 N/m to k_p" in lines[1]  # 20 - 50
    assert "add 5 N/m to k_p" in lines[2]
    plain = steady_face(axis_source(tmp_path).law, 5e-3)
    assert steady_face(found.law, 5e-3) == pytest.approx(plain, rel=1e-12)


def test_the_law_of_a_joint_is_in_radians(tmp_path):
    """The same numbers as of a line; a spring beside k_p has the unit N m/rad."""
    joint = {"axis": {"coordinate": "rotary"}, "friction_unit": "N m"}
    found = axis_source(tmp_path, "position_dependence", **joint)
    assert (found.coordinate, axis_source(tmp_path).coordinate) == ("rotary", "linear")
    assert "add 30 N m/rad to k_p" in found.warnings[0]
    line = steady_face(axis_source(tmp_path).law, 5e-3)
    assert steady_face(found.law, 5e-3) == pytest.approx(line, rel=1e-12)


def without(name):
    after = axis_loop("rate_and_state")["after"]
    del after["parameters"][name]
    return {**after, "free": [], "covariance": []}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"friction_unit": "%"}, "an axis whose forces are in %, and gains"),
        ({"force": 5.0}, "normal_force is not wanted"),
        ({"after": without("F_c")}, "parameter F_c is missing"),
        ({"after": without("rate_and_state.L")}, "parameter rate_and_state.L is missing"),
        ({"after": None}, "'after.' is no table"),
        ({"effects": ["rate_and_stat"]}, "did you mean 'rate_and_state"),
        ({"axis": {"sign_width": "x"}}, "'width' is 'x'"),
        ({"part": float("nan"), "samples": 2}, "undetermined"),
    ],
)
def test_files_that_give_no_law_of_a_loop(tmp_path, changes, words):
    with pytest.raises(InputError, match=words) as told:
        axis_source(tmp_path, **changes)
    assert "\n" not in str(told.value)


def test_axes_without_a_memory_are_told_so(tmp_path):
    path = tmp_path / "loop.json"
    for effects in ((), ("stribeck",), ("presliding",)):
        path.write_text(json.dumps(axis_loop(*effects)))
        with pytest.raises(InputError, match=r"found no rate_and_state.*no stiffness is critical"):
            law_from_fit(path)
    weak = axis_loop("rate_and_state")
    weak["after"]["parameters"]["rate_and_state.A"]["value"] = 0.0
    path.write_text(json.dumps(weak))
    with pytest.raises(InputError, match="direct effect is 0 N"):
        law_from_fit(path)


def test_the_verbs_take_the_loop_of_an_axis(tmp_path, monkeypatch):
    """Critical stiffness, motions above and below it, and a study, with the axis' own mass."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Folder, "draw", lambda *_: [])
    Path("loop.json").write_text(json.dumps(axis_loop("rate_and_state")))
    critical = float(closed_form(2e-3)[1])
    law = ("--from", "loop.json", "--velocity", "2 mm/s")
    stiffness = f"{1.5 * critical} N/m"
    code, out, err = run("stability", *law, "--kp", stiffness, "--out", "s", "--details")
    assert code == 0 and err == "" and "STABLE" in out and "60 kg" in out
    known = json.loads(Path("s/stability.json").read_text())
    assert known["rice_ruina_criterion"]["critical_stiffness"] == pytest.approx(critical, rel=1e-9)
    assert known["mass"] == M
    for part, end in ((1.5, "end: steady sliding"), (0.7, "end: oscillation")):
        k_p = f"{part * critical} N/m"
        code, out, err = run("simulate", *law, "--kp", k_p, "--out", f"m{part}")
        assert code == 0 and end in out, (out, err)
    text = 'compute = ["margins"]\noutputs = ["k_cr"]\n[rig]\nfrom = "loop.json"\nV0 = "2 mm/s"\n'
    Path("study.toml").write_text(text + '[axes]\nk_p = { values = ["1 kN/m", "9 kN/m"] }\n')
    pytest.importorskip("zarr")
    code, out, err = run("study", "study.toml")
    assert code == 0, err
    np.testing.assert_allclose(study.load("study.zarr").k_cr, critical, rtol=1e-9)


@pytest.mark.long
def test_gains_are_checked_by_simulation_of_the_axis(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("loop.json").write_text(json.dumps(axis_loop("rate_and_state")))
    options = (
        "--margin",
        "stiffness=1.5",
        "--margin",
        "modulus=0",
        "--samples",
        "3",
        "--velocity",
        "2 mm/s",
    )
    code, _, err = run("gains", "--from", "loop.json", *options, "--out", "g")
    assert code == 0, err
    content = json.loads(Path("g/gains.json").read_text())
    assert content["scenarios"]["masses"] == [M, M]
    assert content["margins"]["stiffness"]["value"] >= 1.5 * (1 - 1e-9)
    assert content["simulation"]["unresolved"] == 0


def growth(V, k_p, k_v):
    """Real part of the rightmost root of m s^2 + (k_v + f_v) s + k_p - s G(s) = 0."""
    r, damping, memory = V / L, k_v + FV + A / (V + VC), B / (V + VC)
    cubic = np.polyadd(np.polymul([M, damping, k_p], [1, r]), [-memory * r, 0])
    return np.roots(cubic).real.max()


def swings(V, k_p, k_v, seconds, interval):
    """Amplitude of the velocity about V in the second and the last third, for a batch of gains."""
    t = np.arange(round(seconds / interval)) * interval
    reference = jnp.asarray(V * t)
    friction = FV * V + FC + F0 + (A - B) * np.log1p(V / VC)

    def run(k_p, k_v):
        controller = Controller(k_p / k_v, k_v, jnp.asarray(interval))
        back = (friction + k_v * V) / k_p
        first = reference[:3] * (1 + 1e-3) - back
        state = [jnp.asarray(-B * np.log1p(V / VC))]
        return simulate_closed_loop(rig_of(), controller, reference, first, states=state).velocity

    v = np.asarray(jax.vmap(run)(jnp.asarray(k_p), jnp.asarray(k_v)))
    thirds = np.abs(v - V).reshape(len(k_p), 3, -1).max(axis=2)
    return thirds[:, 1], thirds[:, 2]


def test_a_simulated_axis_decays_above_and_grows_below_the_critical_gains():
    found = state_gains(rig_of(), 0.0, 1e-3, 0.1)
    assert found is not None and found.stiff is not None
    parts = np.array([0.9, 1.1])
    V = abs(found.stiff.worst_velocity)
    # of the controller only the stiffness; it samples every 0.2 ms
    k_p, k_v = parts * found.stiff.critical_stiffness, np.full(2, 1e-6)
    begin, end = swings(V, k_p, k_v, 27.0, 2e-4)
    # a force that is held for a period acts half a period late
    expected = np.exp(9.0 * np.array([growth(V, k, -0.5 * 2e-4 * k) for k in k_p]))
    assert end[0] > 1.5 * begin[0] and end[1] < 0.7 * begin[1]
    np.testing.assert_allclose(end / begin, expected, rtol=0.1)
    V = abs(found.worst_velocity)
    k_p, k_v = np.full(2, 30.0), parts * found.least_damping
    begin, end = swings(V, k_p, k_v, 90.0, 1e-3)
    assert end[0] > 1.5 * begin[0] and end[1] < 0.7 * begin[1]


# ---- the loop --------------------------------------------------------------------------------


def record(seed, strokes=20, A=A, B=B, L=L, v_c=VC, noise=0.5, encoder=5e-8):
    """An axis along a prescribed motion: strokes of three speeds each, friction by SciPy."""
    rng = np.random.default_rng(seed)
    parts = [np.zeros(200)]
    for k in range(strokes):
        for _ in range(3):
            speed = np.exp(rng.uniform(np.log(1.5e-3), np.log(60e-3)))
            parts.append(np.full(int(rng.uniform(150, 350)), (-1) ** k * speed))
    v = gaussian_filter1d(np.concatenate([*parts, np.zeros(200)]), 8.0)
    t = np.arange(len(v)) * H
    speed = CubicSpline(t, v)
    theta = solve_ivp(
        lambda t, y: abs(speed(t)) / L * (-B * np.log1p(abs(speed(t)) / v_c) - y), (0, t[-1]),
        [0.0], "LSODA", t_eval=t, rtol=1e-8, atol=1e-9, max_step=5e-3,
    ).y[0]  # fmt: skip
    sliding = FC + A * np.log1p(np.abs(v) / v_c) + theta
    force = M * speed(t, 1) + FV * v + F0 + np.sign(v) * sliding
    force += noise * rng.standard_normal(len(t))
    position = speed.antiderivative()(t) + encoder * rng.standard_normal(len(t))
    return axis_from_arrays(t, force, position=position)


def check_named(loop):
    assert loop.verdict in ("effects", "ambiguous") and loop.effects == ("rate_and_state",)
    assert loop.test_error(loop.after) < 1.1 < 0.2 * loop.test_error(loop.before)
    found, names = loop.after.parameters, list(loop.after.free)
    pick = [names.index(f"rate_and_state.{n}") for n in "AB"]
    (a, ab), (_, b) = loop.after.covariance[np.ix_(pick, pick)]
    weakening = found["rate_and_state.A"].value - found["rate_and_state.B"].value
    assert abs(weakening - (A - B)) < 3 * np.sqrt(a + b - 2 * ab) < 0.5
    for name, true in (("A", A), ("B", B), ("L", L), ("v_c", VC)):
        assert found[f"rate_and_state.{name}"].value == pytest.approx(true, rel=0.1), name


@pytest.mark.long
def test_the_loop_names_rate_and_state_and_finds_its_weakening():
    offered = {"stribeck", "rate_and_state"}
    without = sorted(set(AXIS_CATALOGUE) - offered)
    loop = close_axis_loop(record(0, 12), zero_order_hold=False, exclude=without, max_effects=1)
    check_named(loop)
    assert loop.details is not None
    text = json.loads(json.dumps(plain(loop.details.to_json())))["axis"]["gains"]
    V = np.geomspace(1e-3, 0.06, 4001)
    _, stiffness = closed_form(V)
    assert text["stiff"]["critical_stiffness"] == pytest.approx(stiffness.max(), rel=0.1)
    assert text["stiff"]["position_gain"] is None
    shown = [row[0] for row in loop.details.tables()[1].rows]
    assert "critical k_p without k_v" in shown


@pytest.mark.long
def test_no_gains_of_a_memory_whose_length_is_not_determined():
    """Friction forgets within a row, so the record shows A - B at most: (B - A)/L is unknown."""
    others = sorted(set(AXIS_CATALOGUE) - {"rate_and_state"})
    axis, how = record(0, 8, L=2e-6), {"include": "rate_and_state", "exclude": others}
    loop = close_axis_loop(axis, zero_order_hold=False, max_effects=0, **how)
    assert not loop.after.parameters["rate_and_state.L"].determined
    assert loop.details.gains.claim.kind == "open"


@pytest.mark.long
def test_among_all_effects():
    check_named(close_axis_loop(record(1), zero_order_hold=False))
