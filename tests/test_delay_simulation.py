"""The delay law (6) and its simulation: against SciPy, against the roots, and how it can end."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close_to_largest
from scipy.integrate import solve_ivp

import jaxfric as jf
from jaxfric.errors import InputError
from jaxfric.quantity import quantities
from jaxfric.rig.friction import AbstractDelayLaw, HessSoom
from jaxfric.simulation.delay import simulate_delay
from jaxfric.simulation.start import InitialState

# Golden sample: m = 1, k_f = 0.5, k_v = 0.2, alpha = 0.3. At V0 = 1, c2 = 1: k_f = c1/2 - c0.
V0, ALPHA = 1.0, 0.3
NAMES = ("m", "K", "k_v", "c0", "c1", "c2", "alpha", "V0", "velocity_jump", "load_jump")
SAMPLE = dict(zip(NAMES, (1.0, 100.0, 0.2, 0.1, 1.2, 1.0, ALPHA, V0, 0.0, 0.0), strict=True))
CROSSINGS = (16.703372151, 283.888781436, 626.816131852, 1428.372359707)
GOLDEN_ROOTS = {
    1: 0.122913925 + 0.927364j,
    10: 0.051133607 + 2.975881j,
    100: -0.374663328 + 9.949331j,
    400: 0.132331407 + 20.062464j,
    1000: -0.379764792 + 31.639262j,
    2000: 0.070670294 + 44.546484j,
    3000: -0.294958289 + 54.964140j,
}


def vector(**changes):
    return np.array([{**SAMPLE, **changes}[name] for name in NAMES])


def run(p, ts, intervals, **policy):
    """Simulate by a vector of all parameters."""
    m, K, k_v, c0, c1, c2, alpha, V0, velocity_jump, load_jump = p
    rig = jf.Rig(jf.Inertial(m, K, k_v), HessSoom(c0, c1, c2, alpha))
    start = InitialState(V0 + velocity_jump, load_jump)
    return simulate_delay(rig, V0, ts, start=start, intervals=intervals, **policy)


@functools.partial(jax.jit, static_argnums=(2, 3))
def batch(points, ts, intervals, policy=()):
    return jax.vmap(lambda p: run(p, ts, intervals, **dict(policy)))(points)


# ---- an independent solution ---------------------------------------------------------------


def reference(p, ts):
    """Method of steps in plain variables (x, V), with SciPy's own continuous solution."""
    m, K, k_v, c0, c1, c2, alpha, V0, velocity_jump, load_jump = p
    count = int(np.ceil(ts[-1] / alpha))
    pieces, y = [lambda t: np.array([0.0, V0])], np.array([0.0, V0 + velocity_jump])

    def friction(n, t):
        V = pieces[n](t - alpha)[1]
        return c0 * V + c1 / (1 + c2 * V**2)

    def rate(t, y, n):
        spring = friction(0, 0.0) + K * (load_jump + V0 * t - y[0])
        return [y[1], (spring + k_v * (V0 - y[1]) - friction(n, t)) / m]

    tight = {"rtol": 1e-12, "atol": 1e-14 * V0, "max_step": alpha / 8, "dense_output": True}
    for n in range(count):
        s = solve_ivp(rate, (n * alpha, (n + 1) * alpha), y, "DOP853", args=(n,), **tight)
        pieces.append(s.sol)
        y = s.y[:, -1]
    n = np.minimum((ts // alpha).astype(int), count - 1)
    x, V = np.array([pieces[i + 1](t) for i, t in zip(n, ts, strict=True)]).T
    force = np.array([friction(i, t) for i, t in zip(n, ts, strict=True)])
    return {"slip": x, "velocity": V, "force": force}


def errors(trajectory, true, p):
    """Largest error of each quantity relative to the size of its deviation from steady sliding."""
    _, _, _, c0, c1, c2, _, V0, _, _ = p
    force = c0 * V0 + c1 / (1 + c2 * V0**2)
    steady = {"slip": V0 * np.asarray(trajectory.time), "velocity": V0, "force": force}
    return {
        name: np.max(np.abs(getattr(trajectory, name) - value))
        / np.max(np.abs(value - steady[name]))
        for name, value in true.items()
    }


CASES = {
    "small": vector(velocity_jump=1e-3),
    "large": vector(K=10.0, velocity_jump=-0.5),
    "load jump": vector(m=2.0, K=400.0, k_v=0.0, load_jump=0.02),
    "stiff spring": vector(K=1500.0, velocity_jump=0.3, load_jump=-0.01),
    "micrometres": vector(V0=1e-6, c1=1.2e-6, c2=1e12, velocity_jump=2e-7),
}
# Derivatives in alpha jump at its multiples: no sample but the first is near one.
TS = np.linspace(0.0, 3.6, 150)[:-1]
# For finite differences, in the same batch: a point, and a step to both sides in each parameter.
MIDDLE, STEP = vector(K=50.0, velocity_jump=0.2, load_jump=0.01), 1e-4
NEARBY = MIDDLE * (1 + STEP * np.concatenate([np.eye(len(NAMES)), -np.eye(len(NAMES))]))


@functools.cache
def compared():
    points = np.stack(list(CASES.values()))
    found = batch(jnp.asarray(np.concatenate([points, NEARBY])), jnp.asarray(TS), 12)
    found = jax.tree.map(np.asarray, found)
    return points, found, [reference(p, TS) for p in points]


@pytest.mark.parametrize("i", range(len(CASES)), ids=list(CASES))
def test_agrees_with_scipy(i):
    """To rtol, for small and large deviations alike; measured, 6e-10 at most."""
    points, found, true = compared()
    trajectory = jax.tree.map(lambda x: x[i], found)
    assert trajectory.result == jf.RESULTS.successful and trajectory.state.shape == (len(TS), 0)
    assert max(errors(trajectory, true[i], points[i]).values()) < 1e-8


def test_a_slightly_wrong_delay_is_caught():
    points, found, _ = compared()
    wrong = reference(points[0] * np.where(np.array(NAMES) == "alpha", 1 + 1e-5, 1.0), TS)
    trajectory = jax.tree.map(lambda x: x[0], found)
    assert errors(trajectory, wrong, points[0])["velocity"] > 1e-6


@pytest.mark.long
def test_batched_and_compiled_are_the_same_numbers():
    """And the number of delays, read from the values where it can be."""
    points, found, _ = compared()
    many = jax.tree.map(lambda x: x[1], found)
    one = run(jnp.asarray(points[1]), jnp.asarray(TS), None)
    assert one.result == many.result and one.num_steps == many.num_steps == 48
    for name in ("velocity", "force", "slip"):
        pair = getattr(one, name), getattr(many, name)
        np.testing.assert_allclose(*pair, rtol=1e-12, atol=1e-13)


# ---- derivatives ---------------------------------------------------------------------------


def observed(trajectory):
    parts = [trajectory.velocity, trajectory.slip, trajectory.force]
    return jnp.concatenate(parts, axis=-1)


@pytest.mark.long
def test_derivatives_are_finite_differences():
    """Forward and reverse mode, in every parameter, the delay among them."""
    up, down = np.split(np.asarray(observed(compared()[1])[len(CASES) :]), 2)
    truth = ((up - down) / (2 * STEP)).T

    def f(p):
        return observed(run(p, jnp.asarray(TS), 12))

    forward = np.asarray(jax.jit(jax.jacfwd(f))(jnp.asarray(MIDDLE))) * MIDDLE
    for i, name in enumerate(NAMES):
        assert_close_to_largest(forward[:, i], truth[:, i], 1e-6, what=name)

    weights = np.random.default_rng(22).normal(size=forward.shape[0])
    reverse = jax.jit(jax.grad(lambda p: weights @ f(p)))(jnp.asarray(MIDDLE))
    assert_close_to_largest(reverse * MIDDLE, weights @ forward, 1e-10)


def test_second_derivatives_are_differences():
    """Along one direction in all parameters, the delay among them, in every order of modes."""
    direction = np.random.default_rng(23).uniform(-1, 1, len(NAMES))
    weights = np.random.default_rng(24).normal(size=(20, 3))
    ts = jnp.linspace(0.0, 2.3, 20)

    def f(s):
        found = run(MIDDLE * (1 + s * direction), ts, 8)
        return jnp.sum(weights * jnp.stack([found.velocity, found.slip, found.force], axis=1))

    @jax.jit
    def orders(s):
        twice = (jax.jacfwd(jax.jacfwd(f)), jax.jacfwd(jax.grad(f)), jax.grad(jax.grad(f)))
        return f(s), jnp.stack([second(s) for second in twice])

    h = 1e-3
    down, middle, up = (float(orders(s)[0]) for s in (-h, 0.0, h))
    known = (up - 2 * middle + down) / h**2
    np.testing.assert_allclose(orders(0.0)[1], known, rtol=1e-4)


# ---- growth and decay against the roots ------------------------------------------------------


def rightmost_root(K, guess):
    """Newton's method on m s^2 + k_v s + K - k_f s exp(-alpha s) = 0."""
    s, k_f, k_v = complex(guess), 0.5, 0.2
    for _ in range(50):
        e = np.exp(-ALPHA * s)
        value = s * s + k_v * s + K - k_f * s * e
        s -= value / (2 * s + k_v - k_f * e * (1 - ALPHA * s))
    return s


def mode(t, v):
    """The pair of modes s, conj(s) of a sampled signal: v[i+1] = a v[i] + b v[i-1]."""
    a, b = np.linalg.lstsq(np.column_stack([v[1:-1], v[:-2]]), v[2:], rcond=None)[0]
    z = max(np.roots([1.0, -a, -b]), key=lambda z: z.imag)
    return np.log(z) / (t[1] - t[0])


@functools.cache
def measured_modes():
    """Rightmost mode by stiffness, from the late part of small oscillations."""
    near = [K * side for K in CROSSINGS for side in (0.97, 1.03)]
    stiffness = [*GOLDEN_ROOTS, *near]
    points = np.stack([vector(K=K, velocity_jump=1e-6) for K in stiffness])
    ts = np.append(0.0, np.linspace(9.0, 15.0, 301))
    found = batch(jnp.asarray(points), jnp.asarray(ts), 50)
    assert np.all(found.end == ts[-1])
    deviations = np.asarray(found.velocity)[:, 1:] - V0
    return {K: mode(ts[1:], v) for K, v in zip(stiffness, deviations, strict=True)}


@pytest.mark.parametrize("K", GOLDEN_ROOTS)
def test_growth_is_the_golden_root(K):
    found = measured_modes()[K]
    assert abs(found - GOLDEN_ROOTS[K]) < 1e-6  # the golden numbers have six decimals or more


@pytest.mark.parametrize("i", range(4))
def test_growth_and_decay_around_a_crossing(i):
    """Stable above the even crossings (k_n+) and below the odd ones (k_n-)."""
    for side in (0.97, 1.03):
        K = CROSSINGS[i] * side
        found = measured_modes()[K]
        root = rightmost_root(K, 0.01 + 1j * np.sqrt(K))
        assert (found.real < 0) == ((side > 1) == (i % 2 == 0))
        assert found.real == pytest.approx(root.real, rel=1e-4)
        assert found.imag == pytest.approx(root.imag, rel=1e-7)


# ---- how it ends ------------------------------------------------------------------------------


def all_finite(trajectory):
    arrays = [trajectory.force, trajectory.recorded, trajectory.velocity, trajectory.slip]
    return all(np.all(np.isfinite(a)) for a in [*arrays, trajectory.end])


LATE = np.linspace(0.0, 300.0, 3001)
# With c2 V0^2 < 1 the slope of (6) is less negative on both sides of V0: growth can saturate.
SATURATING = {"K": 14.0, "c2": 0.4, "c1": 0.6 * 1.4**2 / 0.8}
ENDINGS = {
    "cycle from within": {**SATURATING, "velocity_jump": 0.1},
    "cycle from outside": {**SATURATING, "velocity_jump": 0.9},
    "rest": {"K": 400.0, "velocity_jump": 0.3},
    "rest at once": {"velocity_jump": -1.0},
    "runaway at once": {"velocity_jump": 2e4},
    "decay": {"velocity_jump": -0.5},
    "undisturbed": {"K": 10.0},
}


@functools.cache
def endings():
    points = jnp.asarray(np.stack([vector(**changes) for changes in ENDINGS.values()]))
    found = jax.tree.map(np.asarray, batch(points, jnp.asarray(LATE), 1000))
    assert_finite(found)
    return {name: jax.tree.map(lambda x, i=i: x[i], found) for i, name in enumerate(ENDINGS)}


def assert_finite(trajectory):
    for array in jax.tree.leaves(trajectory):
        assert np.all(np.isfinite(array))


def test_growth_saturates_in_a_limit_cycle():
    """Unstable, yet V > 0 for ever: the same cycle from a smaller and from a larger start."""
    ranges = []
    for name in ("cycle from within", "cycle from outside"):
        trajectory = endings()[name]
        assert trajectory.result == jf.RESULTS.successful and trajectory.end == 300.0
        V = np.asarray(trajectory.velocity)[LATE > 280.0]
        assert V.min() > 0.1
        ranges.append([V.min(), V.max()])
    np.testing.assert_allclose(ranges[0], ranges[1], atol=2e-3)
    assert np.ptp(endings()["cycle from within"].velocity[LATE < 10]) < 0.5 * np.ptp(ranges[0])


def test_growth_beyond_the_law_stops_at_rest():
    trajectory = endings()["rest"]
    assert trajectory.result == jf.RESULTS.came_to_rest
    after, V = trajectory.end < LATE, np.asarray(trajectory.velocity)
    assert 1.0 < trajectory.end < 300.0 and np.all(V[~after] > 0)
    assert np.all(np.abs(V[after]) < 1e-12) and np.ptp(trajectory.slip[after]) == 0
    # the time is that of SciPy's zero of V
    p, t = vector(**ENDINGS["rest"]), float(trajectory.end)
    true = reference(p, np.array([t - 1e-3, t, t + 1e-3]))["velocity"]
    assert true[0] > 0 > true[2] and abs(true[1]) < 1e-6


@pytest.mark.parametrize(
    ("name", "result"),
    [("rest at once", jf.RESULTS.came_to_rest), ("runaway at once", jf.RESULTS.ran_away)],
)
def test_start_outside_the_law_ends_at_once(name, result):
    trajectory = endings()[name]
    assert trajectory.result == result and trajectory.end == 0.0
    V = V0 + ENDINGS[name]["velocity_jump"]
    np.testing.assert_allclose(trajectory.velocity, V, atol=1e-10)


def test_decay_ends_in_steady_sliding():
    for name in ("decay", "undisturbed"):
        trajectory = endings()[name]
        assert trajectory.result == jf.RESULTS.successful
        np.testing.assert_allclose(trajectory.velocity[-100:], V0, rtol=1e-9)
        np.testing.assert_allclose(trajectory.force[-100:], 0.7, rtol=1e-9)


def test_too_few_delays_and_too_few_pieces():
    points = np.stack([vector(velocity_jump=0.1), vector(K=3000.0, velocity_jump=0.3)])
    found = batch(jnp.asarray(points), jnp.asarray(TS), 2, (("pieces", 1),))
    found = jax.tree.map(np.asarray, found)
    assert_finite(found)
    endings = ((jf.RESULTS.too_few_intervals, 0.6), (jf.RESULTS.unresolved, 0.0))
    for i, (result, end) in enumerate(endings):
        trajectory = jax.tree.map(lambda x, i=i: x[i], found)
        assert trajectory.result == result
        assert float(trajectory.end) == pytest.approx(end, abs=1e-12)
        assert np.ptp(np.asarray(trajectory.velocity)[end <= TS]) == 0


# ---- the law ----------------------------------------------------------------------------------


def test_hess_soom():
    """(6), (26) by automatic differentiation, (27), and its quantities."""
    law = HessSoom(0.1, 1.2, 1.0, ALPHA)
    for V in (0.2, 1.0, 3.0):
        assert float(law.force(7.0, V)) == pytest.approx(0.1 * V + 1.2 / (1 + V**2), rel=1e-15)
        assert float(law.steady_force(V)) == float(law.force(V, V))
        f_v, late = jax.grad(law.force, (0, 1))(V, V)
        assert float(f_v) == 0.0
        assert float(law.negative_slope(V)) == pytest.approx(-float(late), rel=1e-14)
        slope = float(jax.grad(law.steady_force)(V))
        assert slope == pytest.approx(-float(law.negative_slope(V)), rel=1e-14)
    assert float(law.negative_slope(1.0)) == pytest.approx(0.5, rel=1e-15)
    assert float(law.delay) == ALPHA and float(law.force_scale()) == 1.2
    assert {name: q.symbol for name, q in quantities(HessSoom).items()}["delay"] == "alpha"


class Damped(AbstractDelayLaw):
    """Half of the friction answers at once, and not linearly: Newton's method has work to do."""

    delay: jax.Array

    def steady_force(self, V):
        return self.force(V, V)

    def force(self, V_now, V_delayed):
        return 5.0 * jnp.arctan(3.0 * V_now) + 1.2 / (1 + V_delayed**2)

    def negative_slope(self, V):
        return 2.4 * V / (1 + V**2) ** 2

    def force_scale(self):
        return jnp.asarray(1.0)


def test_law_that_also_answers_at_once():
    law = Damped(jnp.asarray(ALPHA))
    ts = np.linspace(0.0, 1.2, 41)[:-1]
    rig = jf.Rig(jf.Inertial(1.0, 30.0, None), law)
    found = eqx.filter_jit(simulate_delay)(
        rig, V0, jnp.asarray(ts), start=InitialState(1.8), intervals=4
    )
    late, y, V = lambda t: [0.0, V0], np.array([0.0, 1.8]), []
    balance = 5 * np.arctan(3.0) + 0.6
    for n in range(4):

        def rate(t, y, late=late):
            friction = 5 * np.arctan(3 * y[1]) + 1.2 / (1 + late(t - ALPHA)[1] ** 2)
            return [y[1], balance + 30.0 * (t - y[0]) - friction]

        s = solve_ivp(
            rate, (n * ALPHA, (n + 1) * ALPHA), y, "DOP853", dense_output=True, rtol=1e-12,
            atol=1e-14, max_step=0.05,
        )  # fmt: skip
        late, y = s.sol, s.y[:, -1]
        V.append(s.sol(ts[10 * n : 10 * n + 10])[1])
    assert found.result == jf.RESULTS.successful
    np.testing.assert_allclose(found.velocity, np.concatenate(V), atol=1e-8)


# ---- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ({"rtol": 0.0}, "rtol is 0.0; it must be in"),
        ({"rtol": float("nan")}, "rtol is nan"),
        ({"pieces": 0}, "pieces is 0"),
        ({"intervals": 0}, "intervals is 0"),
        ({"ts": jnp.zeros((2, 2))}, "ts has shape"),
        ({"ts": jnp.zeros(0)}, "ts has shape"),
        ({"ts": jnp.asarray([0.0, jnp.inf])}, "ts holds a value that is not finite"),
        ({"start": InitialState(state=jnp.zeros(1))}, "a delay law has no states"),
    ],
)
def test_bad_input_is_refused(policy, words):
    policy = dict(policy)
    law = HessSoom(0.1, 1.2, 1.0, ALPHA)
    ts = policy.pop("ts", jnp.asarray(TS))
    with pytest.raises(InputError, match=words) as refusal:
        simulate_delay(jf.Rig(jf.Inertial(1.0, 1.0), law), V0, ts, **policy)
    assert str(refusal.value).startswith("simulate_delay: ")


def test_intervals_must_be_stated_while_tracing():
    with pytest.raises(InputError, match="state `intervals`"):
        jax.jit(lambda p: run(p, jnp.asarray(TS), None).velocity)(jnp.asarray(vector()))


def test_other_rigs_are_refused():
    delay = HessSoom(0.1, 1.2, 1.0, ALPHA)
    states = jf.RateState(0.6, 0.01, [0.014], [1e-5], 1e-6)
    with pytest.raises(TypeError, match="mass, not a QuasiStatic"):
        simulate_delay(jf.Rig(jf.QuasiStatic(1.0), delay), V0, jnp.asarray(TS))
    with pytest.raises(TypeError, match="RateState is no delay law"):
        simulate_delay(jf.Rig(jf.Inertial(1.0, 1.0), states), V0, jnp.asarray(TS))
