"""Derivatives of `simulate`: first and second order, both modes, under jit and vmap.

First ones are compared with differences of a simulation at a tight tolerance, second ones with
differences of first ones. One rig has many effects away from their null, one has them at it.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric import (
    Inertial,
    InitialState,
    PiecewiseVelocity,
    QuasiStatic,
    RateState,
    Rig,
    simulate,
)
from jaxfric.effects import effect_of, made

MOTION = PiecewiseVelocity(np.array([0.0, 10.0, 25.0]), np.array([1e-6, 1e-5, 2e-6]))
TIMES = jnp.linspace(0.0, 40.0, 60)
BASE = {"K": 2e3, "A": 0.01, "B": 0.014, "L": 1.2e-5}

# Effects by their parameters: a value, and the size by which one that is 0 is moved.
AWAY = {
    "viscous": {"c": 30.0},
    "stribeck": {"fs": 4e-3, "Vs": 3e-6, "d": 1.3},
    "thermal": {"a_T": 1e-3, "tau_T": 4.0},
    "aging": {"q": 0.2},
    "velocity_dependent_L": {"n": 0.1},
    "slip_trend": {"s": 20.0},
}
SIZES = {"c": 30.0, "s": 20.0, "q": 0.2, "n": 0.1, "r": 1e-5}
AT_NULL = {
    "viscous": {"c": 0.0},
    "slip_trend": {"s": 0.0},
    "aging": {"q": 0.0},
    "velocity_dependent_L": {"n": 0.0},
    "time_drift": {"r": 0.0},
}


def slider(p, mass=None, damping=None):
    law = RateState(0.6, p["A"], p["B"][None], p["L"][None], 1e-6)
    machine = QuasiStatic(p["K"], damping) if mass is None else Inertial(mass, p["K"], damping)
    return Rig(machine, law)


def with_effects(effects, p):
    rig = slider(p)
    for id, own in effects.items():
        rig = made(effect_of(id), {name: p[name] for name in own}).embed(rig)
    return rig


def parameters(effects=()):
    values = dict(BASE)
    for own in dict(effects).values():
        values |= own
    return values


# How the rig is made of its parameters, their values, whether the stiff method is used.
RIGS = {
    "plain": (slider, parameters(), False),
    "stiff": (slider, parameters(), True),
    "dashpot": (functools.partial(slider, damping=50.0), parameters(), False),
    "mass": (functools.partial(slider, mass=1e4, damping=0.0), parameters(), True),
    "effects": (functools.partial(with_effects, AWAY), parameters(AWAY), False),
    "nulls": (functools.partial(with_effects, AT_NULL), parameters(AT_NULL), False),
}
# Minutes of compiling for what the others show are too much for every run.
LONG = {"stiff", "dashpot", "mass", "effects"}
rigs = pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in LONG else n for n in RIGS]
)


class Loss:
    """Weighted sum of squared friction by x: the factor exp(x) of a parameter, or, of one that is
    0, x times its size."""

    def __init__(self, name):
        self.build, values, self.stiff = RIGS[name]
        self.names = list(values)
        self.values = np.array(list(values.values()))
        self.sizes = np.array([SIZES.get(n, 0.0) for n in self.names])

    def __call__(self, x, rtol=1e-6):
        p = jnp.where(self.values == 0, self.sizes * x, self.values * jnp.exp(x))
        rig = self.build(dict(zip(self.names, p, strict=True)))
        found = simulate(rig, MOTION, TIMES, rtol=rtol, stiff=self.stiff)
        return jnp.sum(jnp.cos(TIMES) * (found.force / 0.01) ** 2)

    @property
    def start(self):
        return np.zeros(len(self.names))


ROWS = 4


@functools.cache
def orders(name):
    """The value, gradient and Hessian of a rig's loss by forward mode, of rows of x and an rtol.

    Compiled once for all that is asked: `ROWS` at a time.
    """
    loss = Loss(name)

    def first(x, rtol):
        value, push = jax.linearize(lambda x: loss(x, rtol), x)
        gradient = jax.vmap(push)(jnp.eye(len(x)))
        return gradient, (value, gradient)

    def both(x, rtol):
        hessian, (value, gradient) = jax.jacfwd(first, has_aux=True)(x, rtol)
        return value, gradient, hessian

    compiled = jax.jit(jax.vmap(both, in_axes=(0, None)))

    def all_orders(rows, rtol=1e-6):
        number = len(rows)
        rows = np.concatenate([rows, np.repeat(rows[-1:], -number % ROWS, axis=0)])
        parts = [compiled(part, rtol) for part in rows.reshape(-1, ROWS, rows.shape[1])]
        return [np.concatenate(order)[:number] for order in zip(*parts, strict=True)]

    return loss, all_orders


def differences(function, n, step=1e-3):
    """Derivatives at 0 along the axes by differences of fourth order, in the first axis."""
    rows = np.concatenate([side * step * np.eye(n) for side in (2, 1, -1, -2)])
    ends = np.split(function(rows), 4)
    return (8 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12 * step)


@rigs
def test_gradients_are_those_of_differences(name):
    loss, all_orders = orders(name)
    found = all_orders(loss.start[None])[1][0]
    known = differences(lambda rows: all_orders(rows, 1e-10)[0], len(found))
    assert found == pytest.approx(known, rel=0, abs=1e-6 * np.abs(found).max())


@rigs
def test_second_derivatives_are_those_of_differences(name):
    loss, all_orders = orders(name)
    found = all_orders(loss.start[None])[2][0]
    known = differences(lambda rows: all_orders(rows)[1], len(found))
    size = np.sqrt(np.abs(np.outer(np.diag(known), np.diag(known))))
    assert (np.abs(found - known) / (size + 1e-3 * np.abs(known).max())).max() < 1e-3
    assert found == pytest.approx(found.T, rel=1e-9, abs=1e-9 * np.abs(found).max())


@pytest.mark.parametrize(
    "name", ["plain", *(pytest.param(n, marks=pytest.mark.long) for n in RIGS if n != "plain")]
)
def test_both_modes_and_batches_agree(name):
    """Reverse mode, and forward over reverse, of one point; forward mode of a batch.

    At a tight tolerance, too: there rounding decides of many steps, and reverse mode does each
    segment of them again.
    """
    loss, all_orders = orders(name)
    gradient = jax.grad(loss)

    def twice(x, rtol):
        slope, push = jax.linearize(lambda x: gradient(x, rtol), x)
        return slope, jax.vmap(push)(jnp.eye(len(x)))

    rows = 0.1 * np.random.default_rng(0).uniform(-1, 1, (2, len(loss.start)))
    reverse = jax.jit(twice)
    for rtol in (1e-6, 1e-10):
        _, slopes, hessians = all_orders(rows, rtol)
        for row, slope, hessian in zip(rows, slopes, hessians, strict=True):
            found, second = reverse(row, rtol)
            assert found == pytest.approx(slope, rel=0, abs=1e-8 * np.abs(slope).max())
            assert second == pytest.approx(hessian, rel=0, abs=1e-8 * np.abs(hessian).max())


@pytest.mark.parametrize("stiff", [False, True])
def test_the_derivative_by_a_sample_time_is_the_rate_there(stiff):
    """dF/dt = K (V_load - V) of a slider without mass, also at the last time; 0 by the start."""
    rig = slider({name: jnp.asarray(value) for name, value in BASE.items()})
    ts = jnp.array([0.0, 5.0, 12.0, 13.0, 30.0])
    start = InitialState(elongation=5e-6)

    def found(ts):
        return simulate(rig, MOTION, ts, start=start, stiff=stiff, max_steps=512)

    by_time = jax.jit(jax.jacfwd(lambda ts: found(ts).force))(ts)
    load = np.array([1e-6, 1e-6, 1e-5, 1e-5, 2e-6])
    rate = BASE["K"] * (load - np.asarray(found(ts).velocity))
    rate[0] = 0.0
    assert np.asarray(by_time) == pytest.approx(np.diag(rate), rel=2e-4, abs=2e-8)


def test_one_that_runs_away_does_not_spoil_the_gradient_of_others():
    """Member 1 is far below the critical stiffness; the sum is over those that ended well."""
    loss = Loss("plain")

    def total(x):
        p = loss.values * jnp.exp(x)
        rig = slider(dict(zip(loss.names, p, strict=True)))
        found = simulate(rig, MOTION, TIMES, stiff=False)
        return jnp.where(found.end >= TIMES[-1], jnp.sum(found.force**2), 0.0)

    x = np.array([[0.0, 0, 0, 0], [-5.0, 0, 0.5, 0], [0.3, 0, 0, 0]])
    each = jax.jit(jax.grad(lambda x: jnp.sum(jax.vmap(total)(x))))(x)
    assert np.all(np.isfinite(each))
    assert each[1] == pytest.approx(np.zeros(4))
    assert each[0] == pytest.approx(np.asarray(jax.grad(total)(x[0])), rel=1e-9)


def test_a_member_of_a_batch_takes_its_own_steps():
    """Equal to one by one, whatever its neighbours do: other steps, an end long before theirs."""
    K = jnp.array([2e3, 1e2, 8e3, 5e3])
    base = {name: jnp.asarray(value) for name, value in BASE.items()}

    def run(K):
        return simulate(slider({**base, "K": K}), MOTION, TIMES, stiff=False)

    batch = jax.jit(jax.vmap(run))(K)
    for i, k in enumerate(K):
        one = run(k)
        assert batch.force[i] == pytest.approx(np.asarray(one.force), abs=1e-12)
        assert int(batch.num_steps[i]) == int(one.num_steps)
    assert len(set(map(int, batch.num_steps))) > 2
