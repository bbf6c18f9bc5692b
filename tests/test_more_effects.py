"""Normal stress, frictional delay and inertia against SciPy, which solves what they approximate."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxfric as jf
from fits.blind.plants import Base, Protocol, Stress
from fits.blind.plants import simulate as plant
from jaxfric.effects import CATALOGUE, AbstractHeavyEffect, effect_of
from jaxfric.rig import recorded_stress
from jaxfric.rig.normal_stress import NormalStress, moved_stress

UM = 1e-6
VELOCITIES = (1 * UM, 10 * UM, 100 * UM, 30 * UM, 100 * UM)
PROTOCOL = Protocol(VELOCITIES, tuple(150 * UM / v for v in VELOCITIES))
MOTION = jf.PiecewiseVelocity(PROTOCOL.starts, VELOCITIES)
TS = np.concatenate(
    [s + (np.arange(120) + 0.3 * (s > 0)) / 120 * d
     for s, d in zip(PROTOCOL.starts, PROTOCOL.durations, strict=True)]
)  # fmt: skip
CROSSING = 6 * UM / (100 * UM)
HUNTING = Stress((0.006, 0.004), (0.3, 0.11), (0.5, 2.0))


def base(stiffness):
    """K L/A = stiffness; at 1 velocity strengthening, else those steps would come near slip."""
    B = 0.007 if stiffness == 1.0 else 0.015
    return Base(0.6, 0.01, B, 6 * UM, stiffness * 0.01 / (6 * UM))


def made(id, **values):
    """An effect of the catalogue with some of its parameters."""
    effect: Any = effect_of(id)
    return effect(**values)


def rig(plant_base, stress=None):
    law = jf.RateState(plant_base.f0, plant_base.A, [plant_base.B], [plant_base.L], 1 * UM)
    return jf.Rig(jf.QuasiStatic(plant_base.K), law, normal_stress=stress)


@pytest.fixture(scope="module")
def smooth():
    """The history of a gauge without noise."""
    return recorded_stress(TS, 10 * np.exp(HUNTING.logarithm(TS)))


@eqx.filter_jit
def simulated(built):
    """Record and result, compiled once for all rigs of one kind."""
    found = jf.simulate(built, MOTION, jnp.asarray(TS), rtol=1e-6)
    return found.recorded, found.result


def predict(built):
    return simulated(built)[0]


@jax.jit
def ratios(history, times):
    return jax.vmap(history.ratio)(times)


def relative_error(id, stiffness, embed="embed", **values):
    """rms of the error over rms of the effect, by the independent plant."""
    b = base(stiffness)
    truth = plant(b, PROTOCOL, {id: values}, TS).record
    size = truth - plant(b, PROTOCOL, {}, TS).record
    found = np.asarray(predict(getattr(made(id, **values), embed)(rig(b))))
    return np.sqrt(np.mean((found - truth) ** 2) / np.mean(size**2))


def test_history_through_a_noisy_gauge():
    """Noise of 5e-5 is smoothed away, and the history is 1 at the start and the same padded."""
    true = np.exp(HUNTING.logarithm(TS))
    noisy = 10 * true * (1 + 5e-5 * np.random.default_rng(0).standard_normal(len(TS)))
    history = recorded_stress(TS, noisy)
    found = ratios(history, TS)
    assert found[0] == pytest.approx(1.0, abs=1e-12)
    assert np.std(np.asarray(found) / true) < 2.5e-5
    np.testing.assert_array_equal(ratios(history.padded(900), TS), found)


@pytest.mark.parametrize("seed", range(2))
def test_a_gauge_that_only_makes_noise_has_not_moved(seed):
    """What smoothing leaves of the noise of a gauge is in one half of its rows, not in both."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 500.0, 3300)
    noise = 4e-4 * rng.standard_normal(len(t))
    assert moved_stress(t, 10 * (1 + noise)) < 4e-5
    wave = 2e-4 * np.sin(t / 40)
    assert moved_stress(t, 10 * (1 + wave + noise)) == pytest.approx(np.std(wave), rel=0.2)


@pytest.mark.parametrize("length", [1, 5, 64, 100, 128, 4096])
def test_the_cubic_of_a_time_is_that_of_the_last_knot_before(length):
    """Against NumPy's search, at knots, between them and outside; some padded, as in a loop."""
    random = np.random.default_rng(length)
    knots = np.cumsum(random.uniform(0.1, 1.0, length))
    knots[length - length // 3 :] = np.inf
    last = knots[np.isfinite(knots)][-1]
    rows = np.vstack([np.zeros((3, length)), np.arange(length)])
    n = NormalStress(jnp.asarray(knots), jnp.asarray(rows), jnp.asarray([0.0, last + 1.0]))
    times = np.concatenate([knots[np.isfinite(knots)], random.uniform(-1, last + 2, 500)])
    found = np.asarray(ratios(n, times))
    inside = np.clip(times, 0.0, last + 1.0)
    wanted = np.maximum(np.searchsorted(knots, inside, side="right") - 1, 0)
    np.testing.assert_array_equal(found, wanted)


def test_constant_stress_is_one():
    history = recorded_stress(TS, np.full(len(TS), 5e6))
    np.testing.assert_allclose(ratios(history, TS), 1.0, atol=1e-12)


@pytest.mark.parametrize(
    "stress", [np.ones(3), np.full(len(TS), -1.0), np.append(np.ones(len(TS) - 1), np.nan)]
)
def test_bad_stress_is_refused(stress):
    with pytest.raises(jf.InputError, match="normal stress"):
        recorded_stress(TS, stress)


@pytest.mark.parametrize("alpha", [0.0, 0.3])
def test_normal_stress_is_that_of_the_plant(smooth, alpha):
    b = base(3.0)
    truth = plant(b, PROTOCOL, {"normal_stress": {"alpha": alpha}}, TS, stress=HUNTING).record
    found = predict(made("normal_stress", alpha=alpha).embed(rig(b, smooth)))
    np.testing.assert_allclose(found, truth, atol=2e-5)
    still = plant(b, PROTOCOL, {}, TS).record
    assert np.max(np.abs(truth - still)) > 2e-4


def test_normal_stress_needs_the_channel():
    b = base(3.0)
    np.testing.assert_array_equal(
        predict(made("normal_stress", alpha=0.3).embed(rig(b))),
        predict(made("normal_stress").embed(rig(b))),
    )


def test_heat_is_that_of_the_plant():
    """From the first row on: by the heat of f0 alone the start would be a_T^2/f0 = 1.7e-4 off."""
    b = base(3.0)
    truth = plant(b, PROTOCOL, {"thermal": {"a_T": 0.01, "tau_T": 9.0}}, TS).record
    found = np.asarray(predict(made("thermal", a_T=0.01, tau_T=9.0).embed(rig(b))))
    np.testing.assert_allclose(found, truth, atol=2e-6)
    assert np.max(np.abs(truth - plant(b, PROTOCOL, {}, TS).record)) > 5e-3


# K L/A, size of the effect, largest relative error: the ranges that the effects promise
@pytest.mark.long
@pytest.mark.parametrize(
    ("stiffness", "a", "worst"),
    [
        (1.0, 0.1, 0.01),
        (1.0, 1.0, 0.025),
        (3.0, 0.1, 0.035),
        (3.0, 0.3, 0.04),
        (3.0, 1.0, 0.035),
        (3.0, 3.0, 0.1),
        (6.0, 0.3, 0.06),
        (20.0, 0.3, 0.08),
    ],
)
def test_delay_in_its_range(stiffness, a, worst):
    assert relative_error("frictional_delay", stiffness, alpha=a * CROSSING) < worst


@pytest.mark.parametrize(
    ("stiffness", "w", "worst"),
    [
        (1.0, 0.1, 0.16),
        (1.0, 0.3, 0.04),
        (1.0, 1.0, 0.003),
        (3.0, 0.03, 0.08),
        (3.0, 0.1, 0.015),
        (3.0, 0.3, 0.002),
        (6.0, 0.1, 0.008),
        (6.0, 0.3, 0.001),  # it rings
    ],
)
def test_inertia_in_its_range(stiffness, w, worst):
    mass = base(stiffness).K * (w * CROSSING) ** 2
    assert relative_error("inertia", stiffness, m=mass) < worst


@pytest.mark.long
@pytest.mark.parametrize(
    ("stiffness", "w", "worst"), [(3.0, 0.3, 0.019), (6.0, 0.3, 0.067), (6.0, 1.0, 0.21)]
)
def test_largest_error_of_inertia_in_its_range(stiffness, w, worst):
    """Rows that lie as densely as the largest error needs, just after steps up and down."""
    b, velocities = base(stiffness), (1 * UM, 10 * UM, 1 * UM, 10 * UM)
    durations = tuple(150 * UM / v for v in velocities)
    protocol = Protocol(velocities, durations)
    rows = np.append(0.0, np.geomspace(1e-4, 0.999, 3000))
    ts = np.concatenate([s + rows * d for s, d in zip(protocol.starts, durations, strict=True)])
    mass = b.K * (w * b.L / max(velocities)) ** 2
    truth = plant(b, protocol, {"inertia": {"m": mass}}, ts).record
    size = np.max(np.abs(truth - plant(b, protocol, {}, ts).record))
    built = made("inertia", m=mass).embed(rig(b))
    motion = jf.PiecewiseVelocity(protocol.starts, velocities)
    found = np.asarray(jf.simulate(built, motion, jnp.asarray(ts), rtol=1e-8).recorded)
    assert 0.7 * worst < np.max(np.abs(found - truth)) / size < worst


@pytest.mark.parametrize("id", ["frictional_delay", "inertia"])
def test_error_is_of_second_order(id):
    """Half the parameter, half the relative error: the derivative at the null is the plant's."""
    name, size, embed = (
        ("alpha", 0.04 * CROSSING, "embed")
        if id == "frictional_delay"
        else ("m", 1667 * (0.2 * CROSSING) ** 2, "embed_first_order")
    )
    errors = [relative_error(id, 1.0, embed, **{name: part * size}) for part in (1.0, 0.5)]
    assert 0.4 < errors[1] / errors[0] < 0.62


@pytest.mark.parametrize(("stiffness", "a"), [(3.0, 0.1), (20.0, 3.0)])
def test_delay_stays_finite(stiffness, a):
    built = made("frictional_delay", alpha=a * CROSSING).embed(rig(base(stiffness)))
    assert simulated(built)[1] == jf.RESULTS.successful


@pytest.mark.long
@pytest.mark.parametrize("velocity", [0.0, -10 * UM])
def test_delay_through_a_stop(velocity):
    """In a hold and a reversal the friction of a small delay is that without one, nearly."""
    motion, ts = jf.PiecewiseVelocity((0.0, 6.0, 18.0), (10 * UM, velocity, 10 * UM)), TS[:80] / 2
    without = jf.simulate(rig(base(3.0)), motion, ts)
    delayed = made("frictional_delay", alpha=0.005).embed(rig(base(3.0)))
    found = jf.simulate(delayed, motion, ts)
    assert found.result == jf.RESULTS.successful
    change = np.max(np.abs(np.asarray(found.recorded - without.recorded)))
    assert 1e-6 < change < 2e-3


def test_first_order_is_the_same_at_the_null():
    """Value and derivatives of what takes the place of a delay at its null."""

    def recorded(embed, values):
        law = rig(base(3.0))
        law = eqx.tree_at(lambda r: r.friction.A, law, values[1])
        built = getattr(made("frictional_delay", alpha=values[0]), embed)(law)
        return jf.simulate(built, MOTION, jnp.asarray(TS), rtol=1e-6).recorded

    @functools.partial(jax.jit, static_argnums=0)
    def push(embed, along):
        return jax.jvp(functools.partial(recorded, embed), (jnp.array([0.0, 0.01]),), (along,))

    for along in np.eye(2):
        cheap, whole = push("embed_first_order", along), push("embed", along)
        for found, expected in zip(cheap, whole, strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-10)


def test_most_effects_have_nothing_cheaper():
    cheaper = [id for id, e in CATALOGUE.items() if issubclass(e, AbstractHeavyEffect)]
    assert cheaper == ["frictional_delay", "inertia"]


def test_inertia_stays_finite():
    b = base(3.0)
    found = predict(made("inertia", m=b.K * (0.3 * CROSSING) ** 2).embed(rig(b)))
    assert np.all(np.isfinite(found))


def test_encoder_is_read(tmp_path):
    path = tmp_path / "record.csv"
    rows = [f"{0.1 * i:.1f},{i},{i + 0.5},0.6" for i in range(40)]
    header = "time [s],load_point_displacement [um],load_point_encoder [um],friction [1]"
    path.write_text("\n".join([header, *rows]) + "\n")
    record = jf.read(path)
    assert record.load_point_encoder is not None
    np.testing.assert_allclose(record.load_point_encoder[:2], [0.5e-6, 1.5e-6])
    assert record.window(0.0, 2.5).load_point_encoder is not None
