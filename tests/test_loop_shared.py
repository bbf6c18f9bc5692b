"""Derivatives by the times of many steps, several in one direction, against a closed form.

A residual is made whose derivative by each shift is written down: from its step on a transient that
is forgotten, and the distance by which the load point trails times a slope of friction along the
path.
"""

import threading

import jax.numpy as jnp
import numpy as np
import pytest

import jaxfric as jf
from jaxfric.effects import CATALOGUE
from jaxfric.fitting.encompassing import EncompassingModel
from jaxfric.fitting.problem import Model, ProblemSizes, make_problem
from jaxfric.loop import evaluate as evaluate_module
from jaxfric.loop.case import Case
from jaxfric.loop.engine import Engine
from jaxfric.loop.split import split

STEPS, ROWS = 31, 17
ERROR = 0.02
RNG = np.random.default_rng(4)
VELOCITIES = 1e-6 * np.exp(RNG.uniform(-1, 1, STEPS))
STARTS = np.arange(STEPS) * 10.0
TIMES = np.linspace(0.1, STEPS * 10.0 - 0.2, STEPS * ROWS)


@pytest.fixture(scope="module")
def engine() -> Engine:
    steps = jf.VelocitySteps(STARTS, VELOCITIES, np.full(STEPS, ERROR))
    problem = make_problem(
        TIMES,
        np.zeros(len(TIMES)),
        steps,
        ProblemSizes(VELOCITIES[0], 1e3, 1e-3, 1e-2),
        EncompassingModel(Model(), ()),
        shifted=np.arange(1, STEPS),
    )
    felt = np.delete(np.arange(STEPS - 1), 11)
    return engine_of(problem, split(TIMES, steps), felt)


def engine_of(problem, blocks, felt) -> Engine:
    return Engine.of(Case(problem, blocks, lambda *_: None, felt, np.arange(len(TIMES))))


def jacobian(engine: Engine, *, memory: float, slope: float) -> np.ndarray:
    """The derivative of friction and of the shifts' own rows, by all parameters."""
    names, shifts = len(engine.names), len(engine.problem.hold)
    n = len(engine.problem.time)
    time = np.pad(TIMES, (0, n - len(TIMES)), mode="edge")
    found = np.zeros((n + shifts, names + shifts))
    rng = np.random.default_rng(9)
    found[:n, :names] = rng.standard_normal((n, names))
    for k in range(STEPS - 1):
        since = time - STARTS[k + 1]
        trail = (VELOCITIES[k + 1] - VELOCITIES[k]) * ERROR
        own = (3 + k % 4) * trail * 1e9 * np.exp(-np.maximum(since, 0) / memory)
        kept = slope * trail * 1e9 * np.cos(time / 7)
        found[:n, names + k] = np.where(since >= 0, own + kept, 0.0)
        found[n + k, names + k] = 1.0
    return found


@pytest.fixture
def asked(engine, monkeypatch):
    """How many directions were asked for, of a residual with a given Jacobian."""
    numbers = []

    def give(found: np.ndarray) -> list[int]:
        def in_passes(self, problem, z, directions):
            del self, problem, z
            numbers.append(len(directions))
            return np.zeros(len(found)), found @ directions.T

        monkeypatch.setattr(evaluate_module.Evaluator, "_in_passes", in_passes)
        engine.evaluator._known.clear()
        engine.evaluator._apart.clear()
        return numbers

    return give


@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_shifts_share_directions(engine, asked, slope):
    """29 shifts and 4 parameters of the base in 12 directions, and each gets its own column."""
    truth = jacobian(engine, memory=3.0, slope=slope)
    numbers, index = asked(truth), engine.free(())
    assert len(index) == 33
    rows = engine.evaluate(np.zeros(truth.shape[1]), index)
    found = np.concatenate([rows.jacobian, rows.extra_jacobian])
    np.testing.assert_allclose(found, truth[:, index], atol=1e-8 * np.abs(truth).max())
    assert numbers == [12]


def test_parameters_in_any_order_get_their_own_columns(engine, asked):
    truth = jacobian(engine, memory=3.0, slope=0.5)
    asked(truth)
    index = engine.free(())[::-1]
    rows = engine.evaluate(np.zeros(truth.shape[1]), index)
    np.testing.assert_allclose(rows.jacobian, truth[: len(rows.jacobian), index], atol=1e-6)


@pytest.mark.parametrize(("memory", "forgotten"), [(5.0, True), (8.0, False), (60.0, False)])
def test_what_is_not_forgotten_is_differentiated_alone(engine, asked, memory, forgotten):
    """Of 8 s a 6000th is left 7 steps of 10 s later: too much beside a step 300 times smaller. What
    was not forgotten once is not asked again."""
    truth = jacobian(engine, memory=memory, slope=0.5)
    numbers, index = asked(truth), engine.free(())
    for z in (0.0, 1.0):
        rows = engine.evaluate(np.full(truth.shape[1], z), index)
        error = np.linalg.norm(rows.jacobian - truth[: len(rows.jacobian), index], axis=0)
        size = np.linalg.norm(truth[:, index], axis=0)
        assert np.all(error <= (0.01 if forgotten else 1e-12) * size)
    assert numbers == ([12, 12] if forgotten else [12, 33, 33])


def test_a_simulation_that_failed_is_asked_once(engine, asked):
    """All its derivatives are 0."""
    truth = jacobian(engine, memory=3.0, slope=0.5)
    numbers = asked(0 * truth)
    engine.evaluate(np.zeros(truth.shape[1]), engine.free(()))
    assert numbers == [12]


def test_few_shifts_share_nothing(engine, asked):
    """No part is saved: one that holds all parameters takes as long."""
    truth = jacobian(engine, memory=60.0, slope=0.5)
    numbers, index = asked(truth), engine.free(())[:18]
    rows = engine.evaluate(np.zeros(truth.shape[1]), index)
    np.testing.assert_array_equal(rows.jacobian, truth[: len(rows.jacobian), index])
    assert numbers == [18]


def test_late_steps_are_those_of_the_motion(engine):
    """Times, and the trailing distance of a shift of 1 error."""
    times, trails = engine.problem.late_steps()
    jumps = jnp.diff(jnp.asarray(VELOCITIES)) * ERROR
    np.testing.assert_allclose(times[: STEPS - 1], STARTS[1:])
    np.testing.assert_allclose(trails[: STEPS - 1], jumps)


@pytest.mark.parametrize("own", [False, True])
def test_a_users_effect_is_fitted_on_one_thread(own, monkeypatch):
    """What it calls may wait for the threads that another fit computes on."""
    monkeypatch.setenv("NPROC", "2")

    class Mine(CATALOGUE["viscous"]):
        id = "mine"

    effects = (CATALOGUE["viscous"], *([Mine] if own else []))
    steps = jf.VelocitySteps(STARTS, VELOCITIES)
    sizes = ProblemSizes(VELOCITIES[0], 1e3, 1e-3, 1e-2)
    model = EncompassingModel(Model(), effects)
    problem = make_problem(TIMES, np.zeros(len(TIMES)), steps, sizes, model)
    blocks = split(TIMES, steps)
    engine = engine_of(problem, blocks, np.zeros(0, int))
    both = threading.Barrier(2, timeout=0.5)

    def together(k):
        both.wait()
        return k

    if own:
        with pytest.raises(threading.BrokenBarrierError):
            engine.each(together, [1, 2])
    else:
        assert engine.each(together, [1, 2]) == [1, 2]


@pytest.mark.parametrize(("directions", "passes"), [(5, 1), (12, 1), (13, 2), (25, 3)])
def test_a_jacobian_is_taken_in_passes_of_one_width(engine, directions, passes, monkeypatch):
    """A width for the base and a few more parameters; columns are in order."""
    widths = []

    def along(problem, z, some):
        widths.append(len(some))
        return np.zeros(3), np.asarray(some).T[:3] + 1.0

    monkeypatch.setattr(evaluate_module, "_evaluate", along)
    each = lambda one, begins: [one(k) for k in begins]  # noqa: E731
    evaluator = evaluate_module.Evaluator(engine.problem, np.zeros(0, int), each)
    index = np.random.default_rng(0).permutation(40)[:directions]
    _, found = evaluator(np.zeros(40), index)
    assert widths == [12] * passes
    np.testing.assert_array_equal(found, np.eye(40)[index].T[:3] + 1.0)


def test_the_latest_linearisations_are_not_computed_again(engine, asked):
    """Nor those by some of the same parameters, in any order; they cannot be written to."""
    truth = jacobian(engine, memory=3.0, slope=0.0)
    numbers, index, z = asked(truth), engine.free(()), np.zeros(truth.shape[1])
    evaluator = engine.evaluator
    residual, known = evaluator(z, index)
    assert evaluator(z, index)[1] is known
    np.testing.assert_array_equal(evaluator(z, index[[2, 0]])[1], known[:, [2, 0]])
    assert len(numbers) == 1
    evaluator(np.nextafter(z, 1), index)  # other parameters
    missing = np.setdiff1d(np.arange(truth.shape[1]), index)[:1]
    evaluator(z, np.append(index, missing))  # one of them was not known
    assert len(numbers) == 3
    with pytest.raises(ValueError, match="read-only"):
        residual[0] = 1.0


@pytest.mark.parametrize(("room", "kept"), [(0, 2), (3.5, 3), (100, 6)])
def test_as_many_linearisations_are_kept_as_there_is_room_for(
    engine, asked, room, kept, monkeypatch
):
    truth = jacobian(engine, memory=3.0, slope=0.0)
    asked(truth)
    index = engine.free(())
    monkeypatch.setattr(evaluate_module, "KEPT", int(room * truth[:, index].nbytes))
    points = [np.full(truth.shape[1], float(k)) for k in range(6)]
    for z in points:
        engine.evaluator(z, index)
    assert list(engine.evaluator._known) == [z.tobytes() for z in points[-kept:]]
