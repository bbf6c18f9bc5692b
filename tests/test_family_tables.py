"""When a curve of velocity is named by its family: made-up steady curves, nothing is simulated."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric.fitting.noise import noise_of
from jaxfric.loop.evaluate import Rows
from jaxfric.loop.family import (
    CurveFamily,
    CurveRig,
    Decisive,
    OtherShape,
    _sorted_out,
    curve_family,
    deciding,
    distinct,
    step_error,
)
from jaxfric.loop.nonlinear import followed
from jaxfric.rig.friction import RateState
from jaxfric.rig.friction.extended import BlendedEvolution, ExtendedLaw

UM = 1e-6
ROWS, SIGMA, SCALE = 50, 0.5, 2e-3
"""Rows of every velocity; noise in units of the noise scale, and that scale."""


@pytest.mark.parametrize(
    ("speeds", "found"),
    [
        ([1.0, 10, 1, 3, 10], [1, 3, 10]),
        ([1.0, 1.1], [1.05]),
        ([1.0, 1.12], [1, 1.12]),
        ([1.0, 1.08, 1.16], [1.04, 1.16]),  # counted from the slowest: no chain of neighbours
        ([-3.0, 0, 3], [3]),
    ],
)
def test_velocities_that_differ(speeds, found):
    assert distinct(np.asarray(speeds)) == pytest.approx(found)


def family(velocities=7, parameters=5, worse=(), decided=()):
    others = tuple(OtherShape(f"a {w} in ln V", w) for w in worse)
    return CurveFamily(("stribeck",), velocities, parameters, others, tuple(decided))


@pytest.mark.parametrize(
    ("velocities", "parameters", "worse", "untold"),
    [
        (5, 5, (), True),
        (6, 5, (), False),
        (3, 5, (50.0,), True),
        (None, 5, (), False),
        (7, 5, (10.1,), False),
        (7, 5, (9.9,), True),
        (7, 5, (-30.0, 40.0), True),
        (None, 4, (9.9,), True),
    ],
)
def test_when_the_shape_is_not_told(velocities, parameters, worse, untold):
    """As many parameters as velocities, or another shape within 10 of BIC."""
    assert family(velocities, parameters, worse).untold == untold


def made(speeds, friction, named):
    """A fit of f0, A, B and a c V that is called `named`; rows are steady, their noise is white."""
    V = np.repeat(speeds, ROWS)
    n = len(V)
    base = lambda V: np.stack([np.ones_like(V), np.log(V / UM), np.log(V / UM)], axis=1)  # noqa: E731
    level = lambda z, V: base(V) @ z[:3] + z[3] * V  # noqa: E731
    # the named curve itself, fitted
    matrix = np.concatenate([base(V)[:, :2], V[:, None]], axis=1)
    size = np.linalg.norm(matrix, axis=0)
    f0, slope, c = np.linalg.lstsq(matrix / size, friction(V), rcond=None)[0] / size
    z = np.asarray([f0, slope, 0.0, c])
    residual = (level(z, V) - friction(V)) / SCALE
    noise = noise_of(SIGMA)

    def bic(rows, count):
        return float(np.sum(rows.residual**2)) / SIGMA**2 + count * np.log(n), noise

    engine = SimpleNamespace(
        names=("f0", "A", "B", f"{named}.c"), weight=np.ones(n), bic=bic,
        blocks=SimpleNamespace(train=np.ones(n, bool), step=np.repeat(range(len(speeds)), ROWS)),
        unit=SCALE, noise=SimpleNamespace(clock=np.arange(1.0 * n)[:, None]),
        free=lambda effects: np.arange(4),
        model=SimpleNamespace(columns=lambda ids: [3] * len(ids), amplitudes=lambda id: [3]),
        evaluate=lambda z, index: Rows(
            residual, np.concatenate([base(V), V[:, None]], axis=1) / SCALE, np.zeros(0),
            np.zeros((0, 4)),
        ),
        whiten=lambda columns, noise: columns / SIGMA,
    )  # fmt: skip
    rig = CurveRig(
        (named,), (), np.asarray(speeds), True, ("f0", "A", "B"), base, 2, level,
        lambda curve: (np.concatenate([base(V), curve(V)], axis=1) / SCALE,
                       np.zeros((0, 3 + curve(V).shape[1]))),
        "m/s",
    )  # fmt: skip
    final = SimpleNamespace(
        effects=(named,), z=z, noise=noise, failed=False,
        bic=float(np.sum(residual**2)) / SIGMA**2 + 4 * np.log(n),
    )  # fmt: skip
    return engine, final, rig


@pytest.fixture(autouse=True)
def known_noise(monkeypatch):
    """The BIC of the made-up engine."""
    monkeypatch.setattr("jaxfric.loop.family.bic", lambda engine, *rest: engine.bic(*rest))


def truth(shape, seed=0):
    random = np.random.default_rng(seed)

    def friction(V):
        return 0.6 - 0.004 * np.log(V / UM) + shape(V) + SCALE * SIGMA * noise[: len(V)]

    noise = random.standard_normal(5000)
    return friction


LEVELS = UM * np.asarray([0.3, 1, 3, 10, 30, 100])


def found(shape, speeds=LEVELS):
    friction = truth(shape)
    engine, final, rig = made(speeds, friction, "viscous")
    told = curve_family(engine, final, rig)
    assert told is not None
    return told, friction, final


def test_other_shapes_are_scored_as_a_fit_of_them_would_be():
    """BIC of polynomials in ln V and of a value for every velocity, by NumPy."""
    told, friction, final = found(lambda V: 80.0 * V)
    V = np.repeat(LEVELS, ROWS)
    f, u = friction(V), np.log(V / UM)
    left = {}
    for degree, name in ((2, "a quadratic in ln V"), (3, "a cubic in ln V")):
        left[name] = (f - np.polyval(np.polyfit(u, f, degree), u), 3 + degree - 1)
    means = np.repeat(f.reshape(-1, ROWS).mean(1), ROWS)
    left["a value for every velocity"] = (f - means, 3 + len(LEVELS) - 2)
    assert {o.shape for o in told.others} == set(left)
    for other in told.others:
        rest, count = left[other.shape]
        bic = np.sum((rest / SCALE / SIGMA) ** 2) + count * np.log(len(V))
        assert other.worse == pytest.approx(bic - final.bic, abs=1e-4), other.shape
    assert (told.velocities, told.parameters) == (6, 3)


@pytest.mark.parametrize(
    ("size", "speeds", "fitting"),
    [
        (80.0, LEVELS, ()),  # 16 times the noise of a row at the fastest
        (40.0, LEVELS[1:5], ("a quadratic in ln V",)),
    ],
)
def test_which_shapes_fit_in_place_of_viscous_friction(size, speeds, fitting):
    told, _, _ = found(lambda V: size * V, speeds)
    assert set(fitting) <= set(told.fitting) and told.untold == bool(fitting)


@pytest.mark.parametrize(("size", "shapes"), [(2.9, ()), (3.1, ("a bend",))])
def test_a_shape_that_no_step_would_tell_from_the_named_one_is_no_other(size, shapes):
    """3 errors of a step's mean somewhere, or it is the same curve in other words."""
    grid, bend = np.asarray([0.5, 5.0, 50.0]), np.asarray([0.0, 0.0, -size])
    others, wanted = _sorted_out(
        grid, np.zeros(3), [(OtherShape("a bend", 1.0), bend)], np.asarray([1.0, 10.0]), 1.0
    )
    assert tuple(other.shape for other in others) == shapes
    assert [one.velocity for one in wanted] == [50.0] * len(shapes)


@pytest.mark.parametrize(
    ("levels", "error", "found"),
    [
        ([[0, 0, 0, 0, 0], [0, 1, 4, 9, 2]], 1.0, [(50.0, 9.0), (5.0, 4.0)]),
        ([[0, 0, 0, 0, 0], [0, 1, 4, 9, 2]], 2.0, [(50.0, 4.5)]),
        # the widest of all curves counts, and of every gap its widest place
        ([[0, 5, 0, 0, 0], [0, -5, 3.5, 0, 0], [7, 0, 0, 0, 0]], 1.0,
         [(2.0, 10.0), (0.5, 7.0)]),
    ],
)  # fmt: skip
def test_the_velocities_that_decide(levels, error, found):
    """Of a record at 1 and 10: one below, one between, one beyond, and 3 errors at least."""
    grid, speeds = np.asarray([0.5, 2.0, 5.0, 50.0, 90.0]), np.asarray([1.0, 10.0])
    told = deciding(grid, np.asarray(levels, float), speeds, error)
    assert told == tuple(Decisive(*pair) for pair in found)


def test_the_error_of_one_more_step():
    """Of 50 rows of white noise each: sigma/sqrt(50), in the unit of friction."""
    engine, final, _ = made(LEVELS, truth(np.zeros_like), "viscous")
    assert step_error(engine, final) == pytest.approx(SCALE * SIGMA / np.sqrt(50))


def test_what_a_state_makes_of_a_curve():
    """After a jump of the velocity the old value fades as exp(-x/L), L (V/V0)^n."""
    law = RateState(f0=0.6, A=0.01, B=[0.01], L=[8 * UM], V0=UM,
                    evolution=BlendedEvolution(n=jnp.asarray(0.5)))  # fmt: skip
    slip, V = np.linspace(0, 80 * UM, 4001), np.full(4001, 4 * UM)
    V[0] = UM
    response = SimpleNamespace(
        rig=SimpleNamespace(friction=ExtendedLaw(law)), slip=slip, velocity=jnp.asarray(V)
    )
    seen = followed(response, np.where(V == UM, 3.0, 1.0)[:, None])[:, 0]
    np.testing.assert_allclose(seen, 1 + 2 * np.exp(-slip / (16 * UM)), atol=2e-3)
