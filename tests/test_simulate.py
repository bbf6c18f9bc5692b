"""Simulation against independent solutions, its derivatives, its failures, its batches.

The truth is `tests/reference.py` (SciPy, other variables), or `helpers.solve_with_drive` for
what that lacks. One compilation per kind of rig and tolerance is shared by all tests here.
"""

import dataclasses
import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import (
    RIGS,
    UM,
    assert_close_to_largest,
    assert_same,
    central_difference,
    make_law,
    simulate_at,
    solve_with_drive,
    trajectory_errors,
)
from reference import Law, Motion, solve

import jaxfric as jf
from jaxfric.errors import InputError
from jaxfric.simulation.blocks import in_blocks

RTOLS = (1e-4, 1e-6, 1e-8)
SLIP = Law("slip", 0.6, 0.010, (0.014,), (10 * UM,))
AGEING = dataclasses.replace(SLIP, kind="ageing")
TWO = dataclasses.replace(SLIP, B=(0.010, 0.004), L=(10 * UM, 60 * UM))
STEPS = Motion((0.0, 10.0, 20.0, 60.0), (1 * UM, 10 * UM, 2 * UM, 5 * UM))
HOLD = Motion((0.0, 10.0, 60.0), (1 * UM, 0.0, 1 * UM))
REVERSAL = Motion((0.0, 10.0, 40.0), (1 * UM, -1 * UM, 2 * UM))
STEP = Motion((0.0, 5.0), (1 * UM, 10 * UM))


@dataclasses.dataclass(frozen=True)
class Case:
    """A slider described once, for the reference and for jaxfric."""

    law: Law
    motion: Motion
    K: float = 2e3
    mass: float = 0.0
    damping: float = 0.0
    tau: float = 0.0
    end: float = 100.0

    @property
    def ts(self):
        return np.linspace(0.0, self.end, 401)

    def truth(self):
        if self.tau or (self.damping and not self.mass):
            return solve_with_drive(
                self.law, self.motion, self.K, self.ts, damping=self.damping, tau=self.tau
            )
        return solve(self.law, self.motion, self.K, self.ts, mass=self.mass, damping=self.damping)

    def rig(self):
        law = make_law(
            self.law.kind,
            self.law.B,
            self.law.L,
            regularised=self.law.regularised,
            trend=self.law.trend,
        )
        damping = self.damping or None
        machine = jf.QuasiStatic(self.K, damping)
        if self.mass:
            machine = jf.Inertial(self.mass, self.K, damping)
        return jf.Rig(machine, law, jf.FirstOrderDrive(self.tau) if self.tau else jf.IdealDrive())

    def steps(self):
        return jf.PiecewiseVelocity(self.motion.starts, self.motion.velocities)


REGULARISED = {"regularised": True}
CASES = {
    "slip": Case(SLIP, STEPS),
    "slip, stiff": Case(SLIP, STEPS, 1e4),
    "slip, near critical": Case(SLIP, STEPS, 8e2),
    "slip, trend": Case(dataclasses.replace(SLIP, trend=30.0), STEPS),
    "slip, hold": Case(SLIP, HOLD),
    "slip, two states": Case(TWO, STEPS),
    "slip, reversal": Case(dataclasses.replace(SLIP, **REGULARISED), REVERSAL, 2e4),
    "slip, dashpot": Case(SLIP, STEPS, damping=1000.0),
    "slip, slow drive and dashpot": Case(SLIP, STEPS, damping=1000.0, tau=0.4),
    "slip, mass": Case(SLIP, STEP, mass=100.0, damping=1000.0, end=13.0),
    "ageing": Case(AGEING, STEPS),
    "ageing, hold": Case(AGEING, HOLD),
    "ageing, mass": Case(AGEING, STEP, mass=100.0, damping=1000.0, end=13.0),
}


compiled = eqx.filter_jit(simulate_at)


def simulated(case, rtol):
    return compiled(jnp.asarray(rtol), case.rig(), case.steps().padded(4), jnp.asarray(case.ts))


@functools.cache
def truth_of(name):
    return CASES[name].truth()


# ---- accuracy -----------------------------------------------------------------------------


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.long] if n.startswith("ageing,") else []) for n in CASES],
)
def test_error_is_within_ten_rtol(name, rtol):
    trajectory = simulated(CASES[name], rtol)
    assert trajectory.result == jf.RESULTS.successful
    errors = trajectory_errors(trajectory, truth_of(name))
    print(name, rtol, {key: f"{error / rtol:.2g} rtol" for key, error in errors.items()})
    worst = max(errors, key=errors.__getitem__)
    assert errors[worst] <= 10 * rtol, f"{worst}: {errors[worst] / rtol:.3g} rtol"


def test_a_wrong_parameter_is_seen():
    """The comparison above fails if L is wrong by one part in a million."""
    case = CASES["slip"]
    wrong = dataclasses.replace(case, law=dataclasses.replace(SLIP, L=(10.00001 * UM,)))
    assert max(trajectory_errors(simulated(wrong, 1e-8), truth_of("slip")).values()) > 1e-7


def test_the_reference_for_drives_agrees_with_the_other():
    case = CASES["ageing"]
    mine = solve_with_drive(AGEING, STEPS, case.K, case.ts)
    np.testing.assert_allclose(mine.f, truth_of("ageing").f, atol=1e-10)
    weak = solve_with_drive(AGEING, STEPS, case.K, case.ts, damping=1e-5)
    np.testing.assert_allclose(weak.f, mine.f, atol=1e-9)


def test_reference_velocity_is_a_matter_of_naming():
    """(f0, V0) -> (f0 + (A - B) ln(V0'/V0), V0') is the same slider."""
    case = CASES["slip"]
    rig = case.rig()
    ratio = 3.7
    other = eqx.tree_at(
        lambda r: (r.friction.f0, r.friction.V0),
        rig,
        (rig.friction.f0 - 0.004 * np.log(ratio), rig.friction.V0 * ratio),
    )
    a, b = (
        compiled(jnp.asarray(1e-8), r, case.steps(), jnp.asarray(case.ts)) for r in (rig, other)
    )
    np.testing.assert_allclose(a.force, b.force, atol=1e-9)
    np.testing.assert_allclose(a.slip, b.slip, atol=1e-12)


# ---- drive --------------------------------------------------------------------------------


def test_quick_drive_is_the_ideal_one():
    case, rtol = CASES["slip, dashpot"], jnp.asarray(1e-6)
    ideal, rig = simulated(case, rtol), CASES["slip, slow drive and dashpot"].rig()
    between = np.arange(401) % 40 != 0  # at a step itself the ideal load point has jumped
    gaps = []
    for tau in (1e-3, 1e-4, 1e-12, 0.0):
        quick = eqx.tree_at(lambda r: r.drive.tau, rig, jnp.asarray(tau))
        found = compiled(rtol, quick, case.steps(), jnp.asarray(case.ts))
        gaps.append(float(np.abs(found.force - ideal.force)[between].max()))
    assert 1e-5 < gaps[0] < 1e-3 and gaps[1] == pytest.approx(gaps[0] / 10, rel=0.1)
    assert max(gaps[2:]) < 10 * 1e-6 * np.ptp(ideal.force)


def test_load_point_velocity_is_continuous_at_a_step():
    """The drive cannot jump: just before, at, and after the step its velocity is the old one."""
    motion = jf.PiecewiseVelocity([0.0, 5.0, 9.0], [1.0, 3.0, -2.0])
    drive = jf.FirstOrderDrive(0.5)

    def velocity(t):
        return float(motion.velocity(jnp.asarray(t)) - drive.lag_rate(motion, jnp.asarray(t)))

    assert velocity(5.0 - 1e-9) == pytest.approx(1.0)
    assert velocity(5.0 + 1e-9) == pytest.approx(1.0)
    assert velocity(5.0) == pytest.approx(1.0)
    at_9 = 3.0 - 2.0 * np.exp(-4.0 / 0.5)
    assert velocity(9.0) == pytest.approx(at_9)
    assert velocity(9.5) == pytest.approx(-2.0 + (at_9 + 2.0) * np.exp(-1.0))


def test_lag_is_the_integral_of_its_rate_and_the_slow_drive_catches_up():
    motion, drive = jf.PiecewiseVelocity([0.0, 5.0], [1.0, 3.0]).padded(4), jf.FirstOrderDrive(0.5)
    ts = jnp.asarray([0.0, 4.0, 5.1, 6.0, 50.0])
    lag = jax.vmap(lambda t: drive.lag(motion, t))(ts)
    np.testing.assert_allclose(lag, 0.5 * 2 * -np.expm1(-np.clip(ts - 5.0, 0, None) / 0.5))
    slope = jax.vmap(jax.grad(lambda t: drive.lag(motion, t)))(ts[2:])
    rate = jax.vmap(lambda t: drive.lag_rate(motion, t))(ts[2:])
    np.testing.assert_allclose(slope, rate, atol=1e-15)


# ---- derivatives, batches, compilation ----------------------------------------------------

TIGHT = 1e-8
TS = jnp.linspace(0.0, 20.0, 101)
all_rigs = pytest.mark.parametrize("name", RIGS)


def run(name, parameters, rtol=TIGHT):
    rig, motion = RIGS[name](parameters)
    return simulate_at(rtol, rig, motion, TS, max_steps=8192)


@functools.cache
def batched(name):
    return jax.jit(jax.vmap(lambda p: run(name, p)))


@functools.cache
def forward(name):
    return jax.jit(jax.jacfwd(lambda p, rtol: run(name, p, rtol).force))


def typical(name):
    return np.asarray(RIGS[name].typical)


@functools.cache
def differences(name):
    p = typical(name)
    scale = np.where(np.asarray(RIGS[name].names) == "f0", 0.01, p)
    return central_difference(lambda q: batched(name)(q).force, p, scale, 3e-4), scale


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n == "mass and dashpot" else pytest.mark.long) for n in RIGS],
)
def test_forward_derivative_is_a_finite_difference(name):
    truth, scale = differences(name)
    assert np.all(np.max(np.abs(truth), axis=1) > 1e-5)  # every parameter matters here
    for rtol, tolerance in ((TIGHT, 1e-5), (1e-6, 1e-4)):
        value = np.asarray(forward(name)(jnp.asarray(typical(name)), rtol)).T * scale[:, None]
        assert_close_to_largest(value, truth, tolerance, what=f"{name} at rtol {rtol}")


@pytest.mark.long
def test_reverse_derivative_is_a_finite_difference(name="quasi-static"):
    """Below rtol 1e-8 it loses digits: solver steps are recomputed and round differently."""
    weight = np.cos(np.arange(len(TS)))

    @jax.jit
    @jax.grad
    def gradient(p):
        return jnp.vdot(run(name, p).force, weight)

    truth, scale = differences(name)
    value = np.asarray(gradient(jnp.asarray(typical(name)))) * scale
    assert_close_to_largest(value, truth @ weight, 1e-5, what=name)


@pytest.mark.parametrize(
    "name", ["quasi-static", pytest.param("mass and dashpot", marks=pytest.mark.long)]
)
def test_compiled_batch_is_the_same_as_one_by_one(name):
    """A member of a compiled batch against its own simulation, not compiled as a whole."""
    n = 2 * len(typical(name))
    points = typical(name) * (1 + 0.02 * np.sin(np.arange(n))[:, None])
    member = jax.tree.map(lambda x: x[1], batched(name)(jnp.asarray(points)))
    alone = jf.simulate(*RIGS[name](jnp.asarray(points[1])), TS, rtol=TIGHT, max_steps=8192)
    assert member.result == alone.result == jf.RESULTS.successful
    assert abs(int(member.num_steps) - int(alone.num_steps)) <= 3
    # The velocity holds exp(60) of a rounding error; so do the step sizes near the tolerance.
    for x in (member, alone):
        assert np.all(np.asarray(x.velocity) > 0)
    assert_same(
        (member.force, member.slip / UM, member.state, jnp.log(member.velocity)),
        (alone.force, alone.slip / UM, alone.state, jnp.log(alone.velocity)),
        rtol=1e-9,
        atol=1e-9,
    )


# ---- endings ------------------------------------------------------------------------------

BEYOND = np.asarray([0.6, 0.010, 0.015, 10 * UM, 0.95e3, 1 * UM, 10 * UM])


def all_finite(tree):
    leaves = jax.tree.leaves(eqx.filter(tree, eqx.is_inexact_array))
    return all(bool(np.all(np.isfinite(leaf))) for leaf in leaves)


def test_a_runaway_is_a_result_and_its_neighbours_do_not_notice():
    """A quasi-static slider just below twice the critical stiffness, after a tenfold step."""
    name, n = "quasi-static", 14
    members = np.tile(typical(name), (n, 1))
    quiet = batched(name)(jnp.asarray(members))
    members[3] = BEYOND
    batch = batched(name)(jnp.asarray(members))
    ran_away = np.asarray([r == jf.RESULTS.ran_away for r in _each(batch.result, n)])
    np.testing.assert_array_equal(ran_away, np.arange(n) == 3)
    assert all_finite(batch)
    for i in (0, 2, 4, n - 1):
        pair = (jax.tree.map(lambda x, i=i: x[i], tree) for tree in (batch, quiet))
        assert_same(*pair, rtol=1e-13)
    wild = jax.tree.map(lambda x: x[3], batch)
    assert 10.0 < wild.end < TS[-1]
    after = np.asarray(wild.end < TS)
    assert np.ptp(np.asarray(wild.velocity)[after]) == 0  # the last values hold
    assert wild.velocity.max() > 1e3 * 10 * UM
    slope = forward(name)(jnp.asarray(BEYOND), TIGHT)
    assert np.all(np.isfinite(slope))


def _each(result, n):
    return [jax.tree.map(lambda x, i=i: x[i], result) for i in range(n)]


def test_a_runaway_message_says_what_to_do():
    trajectory = batched("quasi-static")(jnp.asarray(np.tile(BEYOND, (14, 1))))
    message = jf.RESULTS[_each(trajectory.result, 14)[0]]
    assert "ran away" in message and "stiffness" in message


def test_too_few_steps_are_a_result():
    case = CASES["slip"]
    ts = jnp.asarray(case.ts)
    few = eqx.filter_jit(lambda r, m: jf.simulate(r, m, ts, max_steps=20))(
        case.rig(), case.steps().padded(4)
    )
    assert few.num_steps <= 20 and few.end < 100.0
    assert few.result != jf.RESULTS.successful and few.result != jf.RESULTS.ran_away
    assert few.result == jf.RESULTS.promote(diffrax.RESULTS.max_steps_reached)
    assert all_finite(few)
    truth = truth_of("slip")
    reached = case.ts <= float(few.end)
    assert 2 < reached.sum() < 401
    assert np.abs(np.asarray(few.force) - truth.f)[reached].max() < 1e-5 * 0.01


def test_padded_motion_changes_nothing():
    case = CASES["slip, hold"]
    padded = simulated(case, 1e-6)
    assert case.steps().times.shape == (3,)
    plain = compiled(jnp.asarray(1e-6), case.rig(), case.steps(), jnp.asarray(case.ts))
    assert_same(padded, plain, rtol=1e-12)


def test_padded_times_change_nothing():
    case, rtol = CASES["slip"], jnp.asarray(1e-6)
    plain = simulated(case, rtol)
    ts = np.append(case.ts[:351], np.full(50, case.ts[350]))
    repeated = compiled(rtol, case.rig(), case.steps(), jnp.asarray(ts))
    assert repeated.result == jf.RESULTS.successful and repeated.end == ts[-1]
    np.testing.assert_array_equal(repeated.force[350:], np.full(51, repeated.force[350]))
    # The solver's last step ends earlier; all samples before it are the same numbers.
    same = 330
    np.testing.assert_allclose(repeated.force[:same], plain.force[:same], rtol=1e-13)
    np.testing.assert_allclose(repeated.force[:351], plain.force[:351], atol=1e-6 * 0.01)


def test_recorded_is_the_force_of_an_ideal_sensor():
    trajectory = simulated(CASES["slip"], 1e-6)
    assert_same(trajectory.recorded, trajectory.force, rtol=0)


@pytest.mark.parametrize("rtol", [0.0, -1e-6, 0.2, float("nan"), float("inf")])
def test_bad_rtol_is_refused(rtol):
    case = CASES["slip"]
    with pytest.raises(InputError, match=r"^simulate: rtol is .*; it must be in"):
        jf.simulate(case.rig(), case.steps(), jnp.asarray(case.ts), rtol=rtol)


@pytest.mark.parametrize("ts", [jnp.asarray(1.0), jnp.zeros((2, 3)), jnp.zeros(0)])
def test_bad_times_are_refused(ts):
    case = CASES["slip"]
    with pytest.raises(InputError, match=r"^simulate: ts has"):
        jf.simulate(case.rig(), case.steps(), ts)


def test_rigs_without_an_equation_are_refused():
    class Rope(jf.rig.machine.AbstractMachine):
        stiffness: jax.Array
        damping: None = None

    case = CASES["slip"]
    rig = jf.Rig(Rope(jnp.asarray(1.0)), case.rig().friction)
    with pytest.raises(TypeError, match="no equation of motion for a Rope"):
        jf.simulate(rig, case.steps(), jnp.asarray(case.ts))


@pytest.mark.parametrize("n", [1, 255, 256, 257, 700])
def test_rows_in_blocks_are_rows_at_once(n):
    rows = jnp.linspace(0.0, 3.0, n), {"twice": jnp.arange(2.0 * n).reshape(n, 2)}

    def one(x, pair):
        return {"a": jnp.sin(x) * pair["twice"], "b": x + pair["twice"].sum()}

    for found, expected in zip(
        jax.tree.leaves(in_blocks(one, *rows)), jax.tree.leaves(jax.vmap(one)(*rows)), strict=True
    ):
        assert found.shape == expected.shape
        np.testing.assert_allclose(found, expected, rtol=1e-15)
    push = lambda c: in_blocks(lambda x: jnp.sin(c * x), rows[0])  # noqa: E731
    slope = jax.jvp(push, (2.0,), (1.0,))[1]
    np.testing.assert_allclose(slope, rows[0] * np.cos(2 * np.asarray(rows[0])), rtol=1e-12)


SHORT = diffrax.PIDController(rtol=1e-9, atol=1e-9, dtmax=0.1)
GIVEN = {
    "quasi-static": {"adjoint": diffrax.ForwardMode()},
    "dashpot and slow drive": {"solver": diffrax.Tsit5(), "controller": SHORT},
    "mass and dashpot": {"controller": SHORT},
}


@all_rigs
def test_the_derivative_by_what_diffrax_is_given_is_a_finite_difference(name):
    def force(p):
        rig, motion = RIGS[name](p)
        return simulate_at(TIGHT, rig, motion, TS, max_steps=8192, **GIVEN[name]).force

    truth, scale = differences(name)
    value = (np.asarray(jax.jit(jax.jacfwd(force))(jnp.asarray(typical(name)))) * scale).T
    assert_close_to_largest(value, truth, 1e-4)


def test_a_given_adjoint_has_reverse_mode(name="quasi-static"):
    def last(p):
        rig, motion = RIGS[name](p)
        adjoint = diffrax.RecursiveCheckpointAdjoint()
        return simulate_at(TIGHT, rig, motion, TS, max_steps=2048, adjoint=adjoint).force[-1]

    truth, scale = differences(name)
    value = np.asarray(jax.jit(jax.grad(last))(jnp.asarray(typical(name)))) * scale
    assert_close_to_largest(value, truth[:, -1], 1e-4)


def test_the_steps_of_a_given_solver_are_recorded(name="quasi-static"):
    rig, motion = RIGS[name](typical(name))
    ends, solver = TS[jnp.array([0, -1])], diffrax.Kvaerno5()
    found = jf.simulate(rig, motion, ends, at_steps=True, solver=solver)
    assert found.time.shape == (4097,) and found.time[-1] == TS[-1]
    own = jf.simulate(rig, motion, found.time)
    np.testing.assert_allclose(found.force, own.force, atol=1e-4 * np.ptp(own.force))
