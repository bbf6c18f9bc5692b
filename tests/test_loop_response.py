"""The linearised slider, fits of an encompassing model: against Jacobians, SciPy, dense algebra.

The plants are those of `fits.blind.plants`, in SciPy; nothing of jaxfric is in them.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close_to_largest
from scipy import stats

import jaxfric as jf
from fits.blind import plants
from jaxfric.effects import effect_of
from jaxfric.fitting.encompassing import EncompassingModel
from jaxfric.fitting.problem import Channel, Model, ProblemSizes, make_problem
from jaxfric.loop.case import Case as LoopCase
from jaxfric.loop.engine import Engine
from jaxfric.loop.nonlinear import friction_sensitivities, linear_response, term_forces
from jaxfric.loop.refit import bic, estimates, predictive, refit
from jaxfric.loop.sampling import seen_between
from jaxfric.loop.split import split

UM, SIGMA, SLIP_NOISE, TIME_ERROR = 1e-6, 3e-4, 0.02e-6, 5e-3
A, B, L, F0 = 0.008, 0.011, 8 * UM, 0.62
VELOCITIES = tuple(UM * v for v in (1, 10, 3, 30, 10, 3, 10))
PROTOCOL = plants.Protocol(VELOCITIES, tuple(120 * UM / v for v in VELOCITIES))
SHAPES = {
    "slip_trend": {},
    "viscous": {},
    "second_state": {"L2": 35 * UM},
    "thermal": {"tau_T": 12.0},
    "position_periodic": {"wavelength": 60 * UM},
}
AMPLITUDES = {
    "slip_trend": "s",
    "viscous": "c",
    "second_state": "B2",
    "thermal": "a_T",
    "position_periodic": "b",
}
EFFECTS = (*(effect_of(id) for id in SHAPES), effect_of("stiffness"), effect_of("gain"))
SOFT, STIFF = 2.0, 6.0
"""K L/A; K/K_cr is 5.3 and 16."""


def sampled(count: int) -> np.ndarray:
    """Finer after each step, which falls between two samples."""
    parts = []
    for begin, span in zip(PROTOCOL.starts, PROTOCOL.durations, strict=True):
        share = (np.arange(count) + (0.5 if begin else 0.0)) / count
        parts.append(begin + span * np.expm1(2.5 * share) / np.expm1(2.5))
    return np.concatenate(parts)


TIMES = sampled(104)  # 728 rows, and 40 of padding


class Case(NamedTuple):
    plant: plants.Base
    engine: Engine
    z: np.ndarray
    """At the plant, the shapes of `SHAPES`, and amplitudes of zero."""

    def index(self, id: str, field: str) -> int:
        return self.engine.names.index(f"{id}.{field}")


def plant_of(ratio: float) -> plants.Base:
    return plants.Base(F0, A, B, L, ratio * A / L)


def engine_of(plant: plants.Base, friction, slip, effects=EFFECTS) -> Engine:
    steps = jf.VelocitySteps(
        PROTOCOL.starts, np.asarray(VELOCITIES), np.full(len(VELOCITIES), TIME_ERROR)
    )
    problem = make_problem(
        TIMES,
        friction,
        steps,
        ProblemSizes(VELOCITIES[0], plant.K, SIGMA, A),
        EncompassingModel(Model(), effects),
        shifted=np.arange(1, len(VELOCITIES)),
    )
    blocks, pad = split(TIMES, steps), (0, len(problem.time) - len(TIMES))
    channel = Channel(
        jnp.asarray(np.pad(slip, pad, mode="edge")),
        jnp.asarray(SLIP_NOISE),
        jnp.asarray(np.pad(blocks.train.astype(float), pad)),
        "slip",
    )
    problem = dataclasses.replace(problem, channels=(channel,))
    rows = np.arange(len(TIMES))
    return Engine.of(LoopCase(problem, blocks, friction_sensitivities, np.arange(2), rows))


def case_of(ratio: float) -> Case:
    plant = plant_of(ratio)
    path = plants.simulate(plant, PROTOCOL, {}, TIMES)
    engine = engine_of(plant, path.record, path.slip - PROTOCOL.displacement(TIMES))
    return Case(plant, engine, start(engine))


def size_of(engine: Engine, name: str) -> float:
    return float(engine.problem.coordinates.scales[engine.names.index(name)])


def start(engine: Engine, values=(F0, A, B, L)) -> np.ndarray:
    natural = dict(zip(engine.names, [*values, *engine.model.nulls()], strict=True))
    natural |= {f"{id}.{k}": v for id, shape in SHAPES.items() for k, v in shape.items()}
    return engine.problem.coordinates.to_free(np.asarray([natural[n] for n in engine.names]))


@pytest.fixture(scope="module")
def soft() -> Case:
    return case_of(SOFT)


@pytest.fixture(scope="module")
def stiff() -> Case:
    return case_of(STIFF)


def response_of(case: Case, time=None):
    problem = case.engine.problem
    if time is not None:
        pad = np.pad(time, (0, len(problem.time) - len(time)), mode="edge")
        problem = eqx.tree_at(lambda p: p.time, problem, jnp.asarray(pad))
    return linear_response(problem, jnp.asarray(case.z))


def seen(case: Case, response) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Change of friction and slip by each effect, per unit of its amplitude."""
    rig, forces = case.engine.problem.rig(jnp.asarray(case.z)), []
    for id, shape in SHAPES.items():
        values = {k: jnp.asarray(v) for k, v in shape.items()} | {AMPLITUDES[id]: jnp.asarray(1.0)}
        term = effect_of(id)(**values).embed(rig).friction.terms[-1]
        forces += term_forces(response, [jax.tree.map(lambda x: x[None], term)])
    friction, slip = response(jnp.concatenate(forces, axis=1))
    pairs = zip(np.asarray(friction).T, np.asarray(slip).T, strict=True)
    return dict(zip(SHAPES, pairs, strict=True))


def by_scipy(plant: plants.Base, id: str, time) -> tuple[np.ndarray, np.ndarray]:
    """The same by central differences of the plant."""
    sizes = {"slip_trend": 0.1, "viscous": 0.1, "thermal": 1e-6}
    shape = {("lambda" if k == "wavelength" else k): v for k, v in SHAPES[id].items()}
    rest = {"a": 0.0} if id == "position_periodic" else {}
    size = sizes.get(id, 1e-5)

    def moved(amplitude):
        effects = {id: {AMPLITUDES[id]: amplitude, **shape, **rest}}
        return plants.simulate(plant, PROTOCOL, effects, time, rtol=1e-10)

    up, down = moved(size), moved(-size)
    return (up.record - down.record) / (2 * size), (up.slip - down.slip) / (2 * size)


def error(found, truth) -> float:
    """Largest difference over the largest truth; padding follows what is compared."""
    return float(np.max(np.abs(found[: len(truth)] - truth)) / np.max(np.abs(truth)))


def per_unit(case: Case, id: str) -> float:
    """Friction in units of the noise by the unbounded amplitude, over that by the natural one."""
    return size_of(case.engine, f"{id}.{AMPLITUDES[id]}") / SIGMA


@pytest.mark.parametrize("name", ["soft", pytest.param("stiff", marks=pytest.mark.long)])
def test_response_gives_the_exact_sensitivities(name, request):
    """Against derivatives of the equation of motion itself, friction and the slip channel.

    The ripple has an amplitude of 1e-5: one of 0 has no part in the motion, and is not resolved by
    the steps of the solver while all slides steadily (`simulation.tangents`).

    The midpoint rule errs by the square of the rows' distance, 0.3 to 3 um here, over the lengths
    in which the sensitivities move: A/K (4 um and 1.3 um), L, and the wavelength over 2 pi.
    Measured: 9e-5 to 3.4e-3 (soft), 4e-5 to 3.8e-3 (stiff).
    """
    case: Case = request.getfixturevalue(name)
    z = case.z.copy()
    ripple = size_of(case.engine, "position_periodic.b")
    z[case.index("position_periodic", "b")] = 1e-5 / float(ripple)
    case = case._replace(z=z)
    rows, found = case.engine.evaluate(case.z), seen(case, response_of(case))
    n, train = len(TIMES), case.engine.blocks.train
    for id, (friction, slip) in found.items():
        k, unit = case.index(id, AMPLITUDES[id]), per_unit(case, id)
        assert error(friction * unit, rows.jacobian[:n, k]) < 5e-3, id
        slip = slip[:n] * unit * SIGMA / SLIP_NOISE
        slip = (slip - slip[train].mean()) * train
        assert error(slip, rows.extra_jacobian[:n, k]) < 5e-3, id


def test_response_of_a_law_with_heat(soft):
    """A force that is there from the start changes the heat of steady sliding, which it begins in.

    In the first rows: there the midpoint rule has not yet erred by more.
    """
    z, wave = soft.z.copy(), soft.index("position_periodic", "b")
    z[soft.index("thermal", "a_T")] = 0.002 / size_of(soft.engine, "thermal.a_T")
    case, early = soft._replace(z=z), slice(5)
    unit = per_unit(case, "position_periodic")
    truth = case.engine.evaluate(z).jacobian[early, wave] / unit

    def wrong(response):
        return error(seen(case, response)["position_periodic"][0], truth)

    good = response_of(case)
    assert wrong(good) < 5e-6
    assert wrong(eqx.tree_at(lambda r: r.begin, good, 0.0 * good.begin)) > 1e-4


def test_response_converges_to_scipy(soft):
    """Friction and slip; with rows twice as far apart the error is four times as large."""
    fine, coarse = seen(soft, response_of(soft)), seen(soft, response_of(soft, TIMES[::2]))
    for id in SHAPES:
        for k, truth in enumerate(by_scipy(soft.plant, id, TIMES)):
            before, after = error(coarse[id][k], truth[::2]), error(fine[id][k], truth)
            assert after < 3e-3 and 2.8 < before / after < 5.5, (id, k, before, after)


def test_a_wrong_response_is_caught(soft):
    """A hundredth more in one coefficient, or a read-out one row late."""
    truth = by_scipy(soft.plant, "second_state", TIMES)[0]
    good = response_of(soft)
    late = eqx.tree_at(lambda r: r.rows, good, jnp.maximum(good.rows - 1, 0))
    driven = eqx.tree_at(lambda r: r.driven, good, 1.01 * good.driven)
    reset = eqx.tree_at(lambda r: r.by_start, good, 0.0 * good.by_start)
    assert error(seen(soft, good)["second_state"][0], truth) < 3e-3
    for wrong in (late, driven):
        assert error(seen(soft, wrong)["second_state"][0], truth) > 6e-3
    wave = by_scipy(soft.plant, "position_periodic", TIMES)[0]  # b pushes from the start
    assert error(seen(soft, reset)["position_periodic"][0], wave) > 6e-3


@pytest.mark.long
def test_late_steps_are_steps_moved_in_time(soft):
    """Derivative of friction by every step time, against SciPy with the step moved.

    Rows next to the step, which is before one of them and after the other, are not compared.
    """
    rows, m = soft.engine.evaluate(soft.z), len(soft.engine.names)
    size = 1e-3 * TIME_ERROR
    for k in range(1, len(VELOCITIES)):
        moved = [
            plants.simulate(soft.plant, _later(k, side * size), {}, TIMES, rtol=1e-11).record
            for side in (1, -1)
        ]
        truth = (moved[0] - moved[1]) / (2 * size) * TIME_ERROR / SIGMA
        assert_close_to_largest(
            rows.jacobian[: len(TIMES), m + k - 1], truth, 2e-3, what=f"step {k}"
        )
    assert_close_to_largest(rows.extra_jacobian[-6:, m:], np.eye(6), 1e-12, what="hold")


def _later(k: int, delay: float) -> plants.Protocol:
    spans = list(PROTOCOL.durations)
    spans[k - 1] += delay
    spans[k] -= delay
    return plants.Protocol(VELOCITIES, tuple(spans))


def test_jacobian_in_parts_is_a_difference_quotient(soft):
    """More columns than are evaluated at once, away from the null; order and padding included."""
    z = soft.z.copy()
    for id in SHAPES:
        z[soft.engine.model.amplitudes(id)] += 0.02

    index = np.arange(len(z))[::-1]
    assert len(index) > 16
    rows, step = soft.engine.evaluate(z, index), 1e-3  # well above what acceptance of steps moves
    for column, k in enumerate(index):
        ends = []
        for side in (1, -1):
            moved = z.copy()
            moved[k] += side * step
            ends.append(soft.engine.evaluate(moved, index[:1]))
        friction = (ends[0].residual - ends[1].residual) / (2 * step)
        extra = (ends[0].extra - ends[1].extra) / (2 * step)
        if k < len(soft.engine.names):
            # solver steps differ between both ends: 1e-5 of friction over the step
            name = soft.engine.names[k]
            assert_close_to_largest(rows.jacobian[:, column], friction, 1e-2, what=name)
            assert_close_to_largest(rows.extra_jacobian[:, column], extra, 1e-2, what=name)
    assert np.all(rows.residual[len(TIMES) :] == 0)


def noisy(case: Case, seed: int = 1) -> Engine:
    """An engine of the same plant's record with noise of a known kind, AR(1) of 0.6."""
    rng = np.random.default_rng(seed)
    path = plants.simulate(case.plant, PROTOCOL, {}, TIMES)
    e = np.empty(len(TIMES))
    e[0] = rng.standard_normal()
    for i in range(1, len(e)):
        e[i] = 0.6 * e[i - 1] + 0.8 * rng.standard_normal()
    slip = path.slip - PROTOCOL.displacement(TIMES) + SLIP_NOISE * rng.standard_normal(len(TIMES))
    return engine_of(case.plant, path.record + SIGMA * e, slip)


def test_a_delay_at_its_null_is_simulated_without_states():
    """Only there; an encompassing model without anything cheaper stays as it is."""
    plant, rest = plant_of(SOFT), np.zeros(len(TIMES))
    effects = (effect_of("viscous"), effect_of("frictional_delay"), effect_of("inertia"))
    engine = engine_of(plant, rest + F0, rest, effects)
    z = np.zeros(len(engine.names) + len(VELOCITIES) - 1)

    def rig(z):
        return engine.evaluator.simulated(z, engine.problem).rig(jnp.asarray(z))

    def late(z):
        return not rig(z).machine.first_order

    def states(z):
        return len(rig(z).friction.steady_state(jnp.asarray(UM)))

    alpha = engine.names.index("frictional_delay.alpha")
    viscous = engine.names.index("viscous.c")
    assert [states(z), states(np.eye(len(z))[viscous]), states(np.eye(len(z))[alpha])] == [1, 1, 4]
    m = engine.names.index("inertia.m")
    assert [late(z), late(np.eye(len(z))[alpha]), late(np.eye(len(z))[m])] == [False, False, True]
    plain = engine_of(plant, rest + F0, rest)
    assert plain.evaluator.simulated(start(plain), plain.problem) is plain.problem


@pytest.mark.parametrize(
    ("id", "name", "short"),
    [
        ("sensor_lag", "tau", True),
        ("sensor_delay", "d", True),
        ("sensor_lag", "tau", False),
        ("sensor_delay", "d", False),
    ],
)
def test_a_sensor_and_rows_far_apart(id, name, short):
    """Rows as far apart as friction takes to bend, twice A/(K V): a lag of a tenth or all of that.

    What the plant's sensor does to friction there is found to 10 %; with friction straight
    between the rows half of it and more is wrong.
    """
    plant = plant_of(STIFF)
    bends = A / (plant.K * VELOCITIES[3])
    time = np.arange(0.0, PROTOCOL.starts[-1] + PROTOCOL.durations[-1], 2 * bends)
    since = (time - PROTOCOL.starts[3]) / bends
    time = time[(since > -10) & (since < 100)]
    time = np.concatenate([[0.0], time])
    value = (0.2 if short else 2.0) * bends
    truth = plants.simulate(plant, PROTOCOL, {id: {name: value}}, time).record
    size = truth - plants.simulate(plant, PROTOCOL, {}, time).record
    problem = make_problem(
        time,
        truth,
        jf.VelocitySteps(PROTOCOL.starts, np.asarray(VELOCITIES)),
        ProblemSizes(VELOCITIES[0], plant.K, SIGMA, A),
        EncompassingModel(Model(), (effect_of(id),)),
    )
    problem = dataclasses.replace(problem, rtol=1e-7)
    z = problem.coordinates.to_free(jnp.asarray([F0, A, B, L, value]))

    def wrong(problem):
        error = np.asarray(problem.predict(z)[0])[: len(time)] - truth
        return np.sqrt(np.mean(error**2) / np.mean(size**2))

    fine = seen_between(problem, A / plant.K, L)
    assert wrong(fine) < 0.1
    assert wrong(fine) < 0.3 * wrong(problem)


@pytest.mark.parametrize(("rows", "coarse"), [(400, 128), (9000, 1024)])
def test_a_long_record_has_no_more_coarse_rows_than_a_shorter_one(rows, coarse):
    """Three more times before each, where the load point has gone on most since the row before."""
    steps = jf.VelocitySteps(np.array([0.0, 40.0, 70.0]), np.array([1e-6, 1e-5, 1e-6]))
    time = np.linspace(0.0, 100.0, rows)
    sizes = ProblemSizes(1e-6, 1e4, 1e-3, 0.01)
    problem = make_problem(time, np.full(rows, 0.6), steps, sizes, Model())
    times, places = map(np.asarray, seen_between(problem, 1e-6, 1e-5).seen)
    every = np.asarray(problem.time)
    np.testing.assert_array_equal(times[places], every)
    assert len(times) == len(every) + 3 * coarse
    more = np.setdiff1d(np.unique(times), every)
    assert np.all(more > 40 - 100 / rows)
    soon = [np.sum((x > 40) & (x < 42)) for x in (more, time)]
    assert soon[0] == pytest.approx(3 * soon[1], abs=3)  # all of them


def test_refit_recovers_the_plant_of_a_clean_record(soft):
    """From 20 % beside it. What is left is the solver's error, 1e-5 of friction's change."""
    far = start(soft.engine, (F0, 1.2 * A, 0.85 * B, 1.2 * L))
    found = refit(soft.engine, (), far)
    values = soft.engine.values(found.z)
    assert not found.failed and found.physical and found.effects == ()
    for name, truth in {"A": A, "B": B, "L": L, "f0": F0}.items():
        assert values[name] == pytest.approx(truth, rel=2e-3)
    assert all(rms < 0.02 * SIGMA for rms in found.rms.values())
    untouched = np.setdiff1d(np.arange(len(far)), soft.engine.free(()))
    np.testing.assert_array_equal(found.z[untouched], far[untouched])


def dense_covariance(engine: Engine, noise) -> np.ndarray:
    """Of all rows of the record: white noise, and an exponential that forgets over its clock."""
    time = np.asarray(engine.problem.time)[: engine.rows]
    clock = np.stack([time, PROTOCOL.displacement(time), np.arange(len(time))], axis=1)
    (part,) = noise.parts
    forgotten, share = np.abs(clock[:, None] - clock) @ part.rates[:3], float(part.share)
    return float(noise.sigma) ** 2 * ((1 - share) * np.eye(len(time)) + share * np.exp(-forgotten))


def test_errors_of_parameters_are_those_of_least_squares(soft):
    """std and covariance against (J^T C^-1 J + J_e^T J_e)^-1 with a dense C; and the truth."""
    engine = noisy(soft)
    found = refit(engine, (), start(engine))
    values, names, covariance = estimates(engine, found, "1")
    assert names == engine.model.base.names()
    index = engine.free(())
    rows, train = engine.evaluate(found.z, index), engine.weight > 0
    found_noise = engine.noise_of(
        rows.residual * engine.weight, rows.jacobian * engine.weight[:, None]
    )
    noise = found_noise.noise
    J, E = rows.jacobian[train], rows.extra_jacobian
    on = train[: engine.rows]
    C = dense_covariance(engine, noise)[np.ix_(on, on)]
    inverse = np.linalg.inv(J.T @ np.linalg.solve(C, J) + E.T @ E)
    # f0 and B may have either sign and are counted in force scales; A and L by their logarithm
    slopes = np.asarray([A, values["A"].value, A, values["L"].value])
    spread = np.outer(slopes, slopes) * inverse[:4, :4]
    np.testing.assert_allclose(covariance, spread, rtol=1e-5)
    for k, (name, truth) in enumerate(zip(names, (F0, A, B, L), strict=True)):
        estimate = values[name]
        assert estimate.std == pytest.approx(np.sqrt(spread[k, k]), rel=1e-6)
        assert estimate.determined and abs(estimate.value - truth) < 4 * estimate.std
        half = stats.norm.isf(0.025) * estimate.std
        ends = estimate.value + half * np.asarray([-1.0, 1.0])
        if name in "AL":  # multiplicative
            ends = estimate.value * np.exp((ends - estimate.value) / estimate.value)
        np.testing.assert_allclose((estimate.lower, estimate.upper), ends, rtol=1e-9)


def dense_bic(engine: Engine, rows, noise, parameters: int) -> tuple[float, float]:
    """Of the train rows and the prediction of the select rows; and the latter alone."""
    blocks, residual = engine.blocks, rows.residual[: engine.rows]
    C = dense_covariance(engine, noise)

    def deviance(on):
        part = C[np.ix_(on, on)]
        return residual[on] @ np.linalg.solve(part, residual[on]) + np.linalg.slogdet(part)[1]

    train, both = np.flatnonzero(blocks.train), np.flatnonzero(blocks.train | blocks.select)
    ones = np.ones(len(train))
    worth = ones @ np.linalg.solve(C[np.ix_(train, train)], ones) * float(noise.sigma) ** 2
    bic = np.sum(rows.extra**2) + deviance(both) + parameters * np.log(worth)
    return float(bic), float(deviance(both) - deviance(train))


def test_bic_is_a_dense_likelihood_and_a_prediction(soft):
    """-2 ln L of train and extra rows, -2 ln p of the select rows given them, p ln n_eff.

    Up to a constant, and to the eight columns of padding with which the noise is estimated: they
    count as parameters, 8 of 520 rows.
    """
    engine, found = noisy(soft, 2), []
    for values, parameters in (((F0, A, B, L), 4), ((F0, 1.04 * A, B, 0.97 * L), 7)):
        z = start(engine, values)
        rows = engine.evaluate(z, engine.free(()))
        score, noise = bic(engine, rows, parameters)
        # of what a part forgets over the longest memory
        for part in noise.parts:
            assert part.rates @ engine.noise.longest >= 1 - 1e-9
        dense, predicted = dense_bic(engine, rows, noise, parameters)
        assert predictive(engine, rows.residual, noise) == pytest.approx(predicted, rel=1e-6)
        found.append((score, dense))
    (score, dense), (other_score, other_dense) = found
    assert other_dense - dense > 50
    assert other_score - score == pytest.approx(other_dense - dense, rel=0.02)
