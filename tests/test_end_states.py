"""How motions end: planted signals, the linear threshold, a limit cycle, basins.

Truth: signals with known amplitude and period, the roots of the characteristic polynomial,
SciPy simulations, and scans.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from helpers import UM, make_law
from scipy.integrate import solve_ivp

import jaxfric as jf
from jaxfric.gains.ends import ENDS, Track, classify, settles
from jaxfric.gains.scenarios import Scenarios
from jaxfric.gains.settle import Policy, end_and_share
from jaxfric.gains.verify import STARTS, jump_sizes, standard_starts, verify
from jaxfric.simulation import jump_start, rest_start, step_start
from jaxfric.stability.margins import poles

V0 = UM
A, B, L = 0.010, 0.015, 10 * UM
K_MASSLESS = (B - A) / L
PERIOD = 2 * np.pi * L / V0 / np.sqrt(B / A - 1)


def name_of(code):
    names = ("steady", "limit_cycle", "escape", "unresolved")
    return next(n for n in names if bool(code == getattr(ENDS, n)))


def each(ends, condition):
    return np.asarray(ends.code == condition)


def rig_of(kind, k, mass=None, damping=None, *, regularised=False):
    light = mass is None
    machine = jf.QuasiStatic(k, damping) if light else jf.Inertial(mass, k, damping)
    return jf.Rig(machine, make_law(kind, (B,), (L,), regularised=regularised))


def critical_stiffness(mass, damping=0.0):
    """(25)."""
    a = A + damping * V0
    return (B - a) / L * (mass * V0**2 / (a * L) + 1)


# ---- planted signals ----------------------------------------------------------------------


def signal(name):
    """Time, velocity, deviation of slip for V0 = 2, T = 100 cycles of period 0.7."""
    t = np.sort(np.random.default_rng(3).uniform(0.0, 70.0, 6001))
    t[[0, -1]] = 0.0, 70.0
    w = 2 * np.pi / 0.7
    envelope = {
        "decays": np.exp(-0.05 * t),
        "has decayed": np.exp(-0.5 * t),
        "grows": 0.001 * np.exp(0.08 * t),
        "stays": np.ones_like(t),
        "comes down to a cycle": 0.3 + 3 * np.exp(-0.1 * t),
    }
    if name in envelope:
        a = 0.9 * envelope[name]
        return t, 2.0 + a * np.cos(w * t), a * np.sin(w * t) / w
    phase = (t / 14.0) % 1.0  # sticks for 13 s, slips for 1 s by 28
    slips = phase > 13 / 14
    if name == "stick-slip":
        v = np.where(slips, 14 * np.pi * np.sin(14 * np.pi * (phase - 13 / 14)), 0.0)
        x = np.where(slips, 14 * (1 - np.cos(14 * np.pi * (phase - 13 / 14))), 0.0)
        return t, v, x + 28 * np.floor(t / 14.0) - 2.0 * t
    return t, np.zeros_like(t), -2.0 * t  # stuck


classified = jax.jit(classify)


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("decays", "steady"),
        ("has decayed", "steady"),
        ("grows", "limit_cycle"),
        ("stays", "limit_cycle"),
        ("comes down to a cycle", "limit_cycle"),
        ("stick-slip", "limit_cycle"),
        ("stuck", "unresolved"),
    ],
)
def test_planted_signals(name, code):
    t, v, x = signal(name)
    end = classified(Track(t, v, x), jnp.asarray(2.0), begin=0.0, end=70.0, decay=jnp.inf)
    assert name_of(end.code) == code
    growth = {"decays": -0.05, "grows": 0.08, "stays": 0.0}
    if name in growth:
        assert end.growth == pytest.approx(growth[name], abs=0.01)
    cycle = {"stays": (0.9, 0.9 * 0.7 / (2 * np.pi), 0.7, 1.1)}
    cycle["stick-slip"] = (7 * np.pi, 13.0, 14.0, 0.0)
    if name in cycle:
        amplitude, slip, period, least = cycle[name]
        assert end.velocity_amplitude == pytest.approx(amplitude, rel=1e-3)
        assert end.slip_amplitude == pytest.approx(slip, rel=2e-2)
        assert end.period == pytest.approx(period, rel=1e-3)
        assert end.least_velocity == pytest.approx(least, abs=2e-3)


@pytest.mark.parametrize(
    ("largest", "count", "decay", "settled"),
    [
        ((0.5e-3, 0.5e-3, 0.9e-3), 0, np.inf, True),  # close enough, though it grows
        ((1e-3, 1e-3, 1.1e-3), 4, np.inf, False),
        ((2.4, 2.0, 1.61), 4, np.inf, False),  # ln(1.61/2) = -0.217
        ((2.4, 2.0, 1.60), 4, np.inf, True),  # -0.223
        ((8.0, 2.0, 1.60), 4, np.inf, False),  # it brakes: less than half of ln(2/8)
        ((0.36, 0.3, 0.24), 3, np.inf, True),
        ((0.45, 0.39, 0.31), 3, np.inf, False),  # few cycles, and not small
        ((2.05, 2.0, 1.90), 4, 0.1, True),  # half of what 0.1/s promises in 1 s
        ((2.05, 2.0, 1.95), 4, 0.1, False),
    ],
)
def test_thresholds_of_settling(largest, count, decay, settled):
    """In numbers, as the rule is written in `classify`; studies ask the same function."""
    found, last = settles(tuple(map(jnp.asarray, largest)), jnp.asarray(count), 1.0, decay)
    assert bool(found) is settled
    assert float(last) == pytest.approx(np.log(largest[2] / largest[1]))


def test_a_known_slow_decay_counts():
    """ln(a4/a3) is -0.17: too little by itself, enough where the linear theory promises it."""
    t = np.linspace(0.0, 70.0, 6001)
    v = 2.0 + 0.5 * np.exp(-0.01 * t) * np.cos(9 * t)
    ends = [
        classified(Track(t, v, v - 2.0), jnp.asarray(2.0), begin=0.0, end=70.0, decay=d)
        for d in (jnp.inf, 0.01, 0.05)
    ]
    assert [name_of(e.code) for e in ends] == ["limit_cycle", "steady", "limit_cycle"]


def cycles_of(times, until):
    """Slip that deviates by 1 on both sides of zero, which it crosses upwards at `times`, straight.

    Time, velocity for V0 = 2, deviation of slip: of one length, the last sample repeated.
    """
    nodes = [(t + dt, side) for t in times for dt, side in ((-0.2, -1.0), (0.2, 1.0))]
    t, x = np.asarray([(0.0, -1.0), *nodes, (until, -1.0)]).T
    t, x = (np.append(a, np.full(40 - len(a), a[-1])) for a in (t, x))
    return t, 2.0 + 1.8 * x, x


@pytest.mark.parametrize(
    ("intervals", "period", "spread"),
    [
        ([2.0, 2.0, 2.0, 2.0], 2.0, 0.0),
        ([1.0, 3.0, 1.0, 3.0], 2.0, 1.0),
        ([2.0, 3.0, 1.5, 2.5], 2.25, 0.75),
        ([3.0, 1.5, 1.0, 2.5, 2.0], 2.0, 1.0),
        ([4.0], 4.0, 0.0),
    ],
)
def test_the_spread_of_unequal_cycles(intervals, period, spread):
    """Half of the range of the intervals of the last half; those before, of 6 s, do not count."""
    late = 21.0 + np.cumsum([0.0, *intervals])
    t, v, x = cycles_of([1.0, 7.0, 13.0, *late], 40.0)
    end = classified(Track(t, v, x), jnp.asarray(2.0), begin=0.0, end=40.0, decay=jnp.inf)
    assert name_of(end.code) == "limit_cycle"
    np.testing.assert_allclose([end.period, end.period_spread], [period, spread], atol=1e-12)


@pytest.mark.parametrize("late", [[], [25.0]])
def test_no_spread_below_two_crossings(late):
    t, v, x = cycles_of([1.0, 7.0, 13.0, *late], 40.0)
    end = classified(Track(t, v, x), jnp.asarray(2.0), begin=0.0, end=40.0, decay=jnp.inf)
    assert name_of(end.code) == "unresolved"
    assert np.isinf(end.period) and np.isinf(end.period_spread)


# ---- the linear threshold -----------------------------------------------------------------


def roots(k, mass, damping=0.0):
    """m s^2 + (k_v + A/V) s + k - s B/(L (s + V/L)) = 0, times (s + V/L)."""
    relax, c = V0 / L, damping + A / V0
    polynomial = [mass, c + mass * relax, k + c * relax - B / L, k * relax]
    return np.roots(polynomial)


SMALL = [(ratio, m, c) for m, c in ((1e3, 0.0), (1e5, 500.0)) for ratio in (0.97, 1.03)]
CYCLE = (0.6 * K_MASSLESS, 1e4, 0.0)


@functools.cache
def with_mass(kind):
    """Ends from small load-point jumps at the sliders `SMALL`, then from a large one at `CYCLE`."""
    sliders = [(r * critical_stiffness(m, c), m, c) for r, m, c in SMALL]
    jumps = [5e-3 * A / k for k, _, _ in sliders]

    @jax.jit
    @jax.vmap
    def ends(k, m, c, jump):
        rig = rig_of(kind, k, m, c, regularised=True)
        start = jump_start(rig, V0, jump)
        policy = Policy(rtol=1e-7, max_steps=16384)
        return end_and_share(rig, V0, start, horizon=44 * PERIOD, policy=policy)[0]

    batch = [(*s, j) for s, j in zip([*sliders, CYCLE], [*jumps, 5 * UM], strict=True)]
    return sliders, ends(*jnp.asarray(batch).T)


@pytest.mark.parametrize("kind", ["ageing", pytest.param("slip", marks=pytest.mark.long)])
def test_small_perturbations_grow_below_the_critical_stiffness(kind):
    sliders, found = with_mass(kind)
    found = jax.tree.map(lambda x: x[: len(SMALL)], found)
    linear = [max(r.real for r in roots(*x)) for x in sliders]
    assert np.all(np.sign(found.growth) == [1, -1, 1, -1])
    assert np.all(np.sign(linear) == [1, -1, 1, -1])
    # Windows hold no whole number of periods, hence 10 %.
    np.testing.assert_allclose(found.growth, linear, rtol=0.1)
    np.testing.assert_array_equal(each(found, ENDS.limit_cycle), [True, False, True, False])


# ---- the limit cycle ----------------------------------------------------------------------


@functools.cache
def scipy_cycle():
    """Amplitudes, least velocity and period of stick-slip; y = (elongation, ln V, theta)."""
    k, mass, _ = CYCLE

    def rate(t, y):
        V = V0 * np.exp(y[1])
        f = 0.6 + A * y[1] + y[2]
        return [V0 - V, (0.6 + k * y[0] - f) / (mass * V), B / L * (V0 * np.exp(-y[2] / B) - V)]

    y, T = [5 * UM, 0.0, 0.0], 60 * PERIOD
    crossing = lambda t, y: y[1]  # noqa: E731
    crossing.direction = 1
    s = solve_ivp(rate, (0, T), y, "LSODA", rtol=1e-9, atol=1e-11, events=crossing)
    late = s.t > T / 2
    V, d = V0 * np.exp(s.y[1][late]), -s.y[0][late]
    times = s.t_events[0][s.t_events[0] > T / 2]
    assert len(times) > 5
    between = np.diff(times)
    return np.ptp(V) / 2, np.ptp(d) / 2, V.min(), between.mean(), np.ptp(between) / 2


def test_limit_cycle_against_scipy():
    end = jax.tree.map(lambda x: x[-1], with_mass("ageing")[1])
    assert name_of(end.code) == "limit_cycle"
    found = (end.velocity_amplitude, end.slip_amplitude, end.least_velocity, end.period)
    # Extremes are those of the solver's steps, a little inside the true ones.
    *truths, spread = scipy_cycle()
    for value, truth, rel in zip(found, truths, (2e-2, 5e-3, 2e-2, 5e-3), strict=True):
        assert value == pytest.approx(truth, rel=rel)
    # All cycles are alike; a crossing lies between two steps of the solver.
    assert end.period_spread == pytest.approx(spread, abs=1e-3 * float(end.period))
    assert end.velocity_amplitude > 10 * V0 and end.least_velocity < 0.2 * V0
    assert abs(end.growth) < 1e-5


# ---- starts, maps, basins -----------------------------------------------------------------


def alone(kind, mass=None):
    """One law at V0."""
    law = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], make_law(kind, (B,), (L,)))
    return Scenarios.product(law, [V0], None if mass is None else [mass])


def gains_of(stiffness, damping=0.0):
    return np.array([stiffness, damping])


def test_standard_starts():
    scenarios = alone("ageing", 1e2)
    soft = verify(scenarios, gains_of(0.6 * K_MASSLESS))
    stiff = verify(scenarios, gains_of(3 * K_MASSLESS))
    assert soft.checked == stiff.checked == len(STARTS)
    assert soft.limit_cycle == 5 and stiff.steady == 5
    # One and the same cycle from everywhere.
    periods = [start.period for start in soft.starts]
    np.testing.assert_allclose(periods, periods[0], rtol=2e-2)


def test_a_light_slider_does_not_sit_on_its_unstable_motion():
    rig = rig_of("slip", 0.5 * K_MASSLESS, 1e-4)
    starts = jax.tree.map(lambda *x: jnp.stack(x), *standard_starts(rig, jnp.asarray(V0)))
    ends = jax.vmap(lambda start: end_and_share(rig, V0, start, horizon=30 * PERIOD)[0])(starts)
    assert each(ends, ENDS.limit_cycle).all()


@pytest.mark.long
def test_stick_slip_disappears_with_stiffness_and_with_damping():
    rig = rig_of("slip", 1.0, 1e2, regularised=True)
    k_p = K_MASSLESS * np.asarray([0.5, 1.5, 4.0])
    k_v = np.asarray([0.0, 2 * (B - A) / V0])

    def end(k_p, k_v):
        here = jf.Rig(jf.Inertial(1e2, k_p, k_v), rig.friction)
        return end_and_share(here, V0, rest_start(here, V0), horizon=40 * PERIOD)[0]

    ends = jax.jit(jax.vmap(jax.vmap(end, (None, 0)), (0, None)))(k_p, k_v)
    steady = each(ends, ENDS.steady)
    assert not steady[0, 0] and steady[2, 0] and steady[:, 1].all()


def settling(k_p, k_v, mass, V):
    """Name of the end after a step of the command up by 1.334, and the poles; slip law."""
    rig = jf.Rig(jf.Inertial(mass, k_p, k_v), jf.RateState(10.0, 1.0, [3.0], [1e-3], 2e-3))
    s = np.asarray(poles(jf.linearise(rig, V)))
    horizon = 30 * 2 * np.pi / np.min(np.abs(s))
    end, _ = end_and_share(
        rig, V, step_start(rig, V, 1.334), horizon=horizon, decay=-np.max(s.real)
    )
    return name_of(end.code), s


def test_a_lightly_damped_slider_settles_though_it_uses_up_its_steps():
    """300 cycles until exp(-8) take more than 4096 steps; SciPy follows the step to its end."""
    k_p, k_v, mass, V = 14286.0, 107.01, 300.0, 7.4989e-3
    end, s = settling(k_p, k_v, mass, V)

    def rate(t, y):  # spring force, ln(v/V), state of the slip law in N
        v = V * np.exp(y[1])
        u = y[1] + np.log(V / 2e-3)
        net = y[0] + k_v * (V - v) - 10.0 - u - y[2]
        return [k_p * (V - v), net / (mass * v), -v / 1e-3 * (y[2] + 3.0 * u)]

    u = np.log(V / 1.334 / 2e-3)
    start = [10.0 - 2.0 * u, -np.log(1.334), -3.0 * u]
    ts = np.linspace(0.0, 300.0, 30001)
    found = solve_ivp(rate, (0.0, 300.0), start, "DOP853", ts, rtol=1e-9, atol=1e-11)
    late = [np.ptp(found.y[1][(ts >= t) & (ts <= t + 30.0)]) for t in (0.0, 135.0, 270.0)]
    decay = -np.max(s.real)
    assert decay < 0.004 * np.max(np.abs(s.imag))
    assert np.log(late[1] / late[2]) == pytest.approx(135.0 * decay, rel=0.02) and late[2] < 1e-2
    assert end == "steady"


def test_a_decay_too_slow_to_be_seen_is_unresolved():
    end, s = settling(2.3309e6, 7.7055, 300.0, 0.1)
    assert 0 < -np.max(s.real) < 2e-5 * np.max(np.abs(s.imag))
    assert end == "unresolved"


LARGEST = 30.0
FINE = 1.06
"""Factors between which a jump is found to be lost."""


@functools.cache
def slip_basin():
    """Slip law, massless, twice the critical stiffness: linearly stable, finite basin."""
    return jump_sizes(alone("slip"), gains_of(2 * K_MASSLESS), largest=LARGEST)


def runs_away(ratio):
    law = reference.Law("slip", 0.6, A, (B,), (L,))
    motion = reference.Motion((0.0, 1.0), (V0, ratio * V0))
    ts = np.linspace(0.0, 25 * PERIOD / ratio, 50)
    try:
        V = reference.solve(law, motion, 2 * K_MASSLESS, ts, rtol=1e-9).V
    except RuntimeError:
        return True
    return bool(V.max() > 1e4 * ratio * V0)


@pytest.mark.long
def test_the_slip_law_has_a_finite_basin_above_the_critical_stiffness():
    (up,), (down,), (lost,), (down_lost,) = slip_basin()
    assert 9.5 < up < 11.0  # a tenfold step is just survived
    assert down == pytest.approx(LARGEST) and (lost, down_lost) == ("escape", "steady")
    assert not runs_away(0.99 * up) and runs_away(FINE * up)


RATIOS = np.geomspace(1.1, 30.0, 40)


@functools.cache
def scanned():
    """Ends of steps of the command by `RATIOS`; last, one slider below its critical stiffness."""

    @jax.jit
    @jax.vmap
    def scan(k, ratio):
        rig = rig_of("slip", k)
        return end_and_share(rig, V0, step_start(rig, V0, ratio), horizon=25 * PERIOD)[0]

    k = np.append(np.full(40, 2 * K_MASSLESS), 0.5 * K_MASSLESS)
    return scan(jnp.asarray(k), jnp.asarray(np.append(RATIOS, 2.0)))


@pytest.mark.long
def test_basin_against_a_scan():
    size, survived = slip_basin().up[0], each(scanned(), ENDS.steady)[:40]
    inside, outside = size >= RATIOS, FINE * size <= RATIOS
    assert survived[inside].all() and not survived[outside].any()


def test_a_batch_survives_what_does_not():
    """Massless runaways beside neighbours which are steady: no nan, no invented numbers."""
    ends = scanned()
    lost = each(ends, ENDS.escape)
    assert lost[-1] and 1 < lost.sum() < 40 and np.all(np.isinf(ends.period[lost]))
    assert not np.any(np.isnan(ends.growth))


def test_no_basin_below_and_all_of_it_far_above():
    none = jump_sizes(alone("slip"), gains_of(0.9 * K_MASSLESS), largest=LARGEST)
    every = jump_sizes(alone("slip"), gains_of(20 * K_MASSLESS), largest=20.0)
    assert none.up == none.down == 1.0 and "steady" not in none.up_lost + none.down_lost
    assert every.up == pytest.approx(20.0) == every.down
    assert every.up_lost == every.down_lost == ["steady"]
