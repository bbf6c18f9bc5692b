"""What a record does not fix of an effect: every limit from both sides, and a made-up engine."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxfric.effects import RecordScales
from jaxfric.effects.axis import AxisPositionPeriodic, LogViscous, Presliding, RateAndState
from jaxfric.effects.effect import beyond
from jaxfric.loop.gates import Part, loose, not_fixed
from jaxfric.quantity import quantities

SIZE = RecordScales(1e-5, 1e-4, 1e-3, 1e-6, 1e-4, 0.1, 500.0)


@pytest.mark.parametrize(
    ("unit", "amplitude", "most"),
    [
        # a record of 1 mm and 500 s at 1 to 100 um/s, with a friction of 0.6 at most
        ("F", True, 0.6),
        ("F s/m", True, 0.6 / 1e-4),
        ("F s^2/m^2", True, 0.6 / 1e-8),
        ("F/m", True, 0.6 / 1e-3),
        ("F/m^2", True, 0.6 / 1e-6),
        ("F/s", True, 0.6 / 500),
        ("m", False, 2 * 1e-3),
        ("m", True, 2 * 1e-3),
        ("s", False, 2 * 500.0),
        ("s", True, 2 * 500.0),
        ("m/s", False, 30 * 1e-4),
    ],
)
def test_the_largest_value_that_a_record_can_show(unit, amplitude, most):
    for sign in (1, -1):
        inside, beyond = (
            loose([Part("p", unit, sign * most * factor, 0.1, amplitude)], 0.6, SIZE)
            for factor in (0.99, 1.01)
        )
        assert (inside, beyond) == ((), ("p",))


@pytest.mark.parametrize(
    ("size", "fixed"), [(0.99 * 1e-6 / 30, False), (1.01 * 1e-6 / 30, True), (np.inf, False)]
)
def test_the_smallest_velocity_that_a_record_can_show(size, fixed):
    found = loose([Part("v", "m/s", size, 0.1, False)], 0.6, SIZE)
    assert (found == ()) == fixed
    assert loose([Part("v", "m/s", 1e3, 0.1, True)], 0.6, SIZE) == ()  # an amplitude: no scale


@pytest.mark.parametrize(
    ("errors", "names"),
    [
        ([(0.99, True)], ""), ([(1.01, True)], "a"), ([(0.58, False)], ""), ([(0.59, False)], "a"),
        ([(1.01, True), (0.99, True)], ""),  # sine and cosine: one of them is enough
        ([(1.01, True), (1.01, True)], "ab"),
        ([(0.5, True), (0.59, False)], "b"),
        ([(1.01, True), (0.58, False)], "a"),
        ([(0.5, True), (0.58, False), (0.59, False)], "c"),
    ],
)  # fmt: skip
def test_errors_up_to_the_value(errors, names):
    parts = [Part(n, "1", 0.1, *e) for n, e in zip("abc", errors, strict=False)]
    assert loose(parts, 0.6, SIZE) == tuple(names)


def test_a_weight_that_changes_little_over_the_record_may_exceed_all_force():
    for change, found in ((0.59, ()), (0.61, ("a",))):
        assert loose([Part("a", "F", 8.0, 0.1, True, change)], 0.6, SIZE) == found


NAMES = ("f0", "wave.a", "wave.length", "wave.n", "lag.tau", "late.tau")
UNITS = ("F", "F", "m", "1", "s", "s")
VALUES = (0.6, 0.02, 1e-4, 1.5, 1.0, 2.0)
Z = np.asarray([0.6, -2.0, np.log(1e-4), 0.0, 4.0, 8.0])
POSITIVE, BOUNDED = "wave.length", "wave.n"


def engine(errors, *, shape=0.0, length=0.0, largest=0.6, failed=False, free_shape="", beyond=()):
    """Of a friction of `largest`, with errors of z by name, of the wave's height and `length`
    correlated with its shape; what one parameter does is known without it."""
    std = np.asarray([errors.get(name, 0.1) for name in NAMES])
    spread = np.diag(std**2)
    spread[1, 3] = spread[3, 1] = shape * std[1] * std[3]
    spread[2, 3] = spread[3, 2] = length * std[2] * std[3]
    jacobian = np.linalg.cholesky(np.linalg.inv(spread)).T
    about = {
        name: SimpleNamespace(
            unit=unit, lower=0.0 if name == POSITIVE else -np.inf,
            upper=3.0 if name == BOUNDED else np.inf, shape_only=name == free_shape,
        )
        for name, unit in zip(NAMES, UNITS, strict=True)
    }  # fmt: skip

    def columns(ids):
        return [i for i, name in enumerate(NAMES) if name.split(".")[0] in ids]

    return SimpleNamespace(
        names=NAMES, rows=4, weight=np.ones(6), unit=1.0, beyond=lambda effects, z, scales: beyond,
        noise=SimpleNamespace(friction=np.asarray([0.01, -largest, 0, 0.01, 99, 99])),
        free=lambda effects: np.asarray([0, *columns(effects)]),
        evaluate=lambda z, index: SimpleNamespace(
            failed=failed, jacobian=jacobian[:, index], extra_jacobian=np.zeros((0, len(index)))
        ),
        whiten=lambda columns, noise: columns,
        values=lambda z: dict(zip(NAMES, VALUES, strict=True)),
        model=SimpleNamespace(
            effects=(), columns=columns, quantity=about.__getitem__,
            amplitudes=lambda id: [
                i for i in columns((id,)) if NAMES[i] not in (POSITIVE, BOUNDED)
            ],
        ),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("effects", "made", "names"),
    [
        (("wave",), engine({}), ()),
        # an amplitude's error is counted in units of it, that of a length is of its logarithm
        (("wave",), engine({"wave.a": 1.99}), ()),
        (("wave",), engine({"wave.a": 2.01}), ("wave.a",)),
        (("wave",), engine({"wave.length": 0.58}), ()),
        (("wave",), engine({"wave.length": 0.59}), ("wave.length",)),
        (("wave",), engine({"wave.n": 50.0}), ()),  # between bounds: a matter of shape
        (("wave",), engine({"wave.length": 50.0}, free_shape="wave.length"), ()),
        # height and shape known together only: sqrt(1 - .9^2) of its error is the height's own
        (("wave",), engine({"wave.a": 4.5, "wave.n": 50.0}, shape=0.9), ()),
        (("wave",), engine({"wave.a": 4.7, "wave.n": 50.0}, shape=0.9), ("wave.a",)),
        (("wave",), engine({"wave.length": 1.3, "wave.n": 50.0}, length=0.9), ()),
        (("wave",), engine({"wave.length": 1.4, "wave.n": 50.0}, length=0.9), ("wave.length",)),
        (("wave",), engine({"wave.a": 2.01}, free_shape="wave.length"), ("wave.a",)),
        # the largest friction of the rows, of either sign, and not of the padding
        (("wave",), engine({}, largest=0.021), ()),
        (("wave",), engine({}, largest=0.019), ("wave.a",)),
        (("lag",), engine({"lag.tau": 3.99}), ()),
        (("lag",), engine({"lag.tau": 4.01}), ("lag.tau",)),
        (("wave", "lag"), engine({"wave.a": 3.0, "lag.tau": 5.0}), ("wave.a", "lag.tau")),
        (("wave",), engine({}, beyond=("wave.n",)), ("wave.n",)),
        (("wave",), engine({}, failed=True), ("wave",)),
    ],
)
def test_what_a_candidate_leaves_open(effects, made, names):
    candidate = SimpleNamespace(effects=effects, z=Z, noise=None)
    assert not_fixed(made, candidate, SIZE) == names


AXIS = RecordScales(np.nan, 1e-4, 0.2, 1e-3, 0.2, 0.01, 15.0)
BRISTLE = {"presliding.a": 25.0, "presliding.sigma_1": 1.2e4, "presliding.x_c": 1.5e-5}


@pytest.mark.parametrize(
    ("errors", "names"),
    [
        # at 0.2 m/s such a damping would be 2400 N, but there the bristle no longer bends
        ((0.1, 0.1, 0.1), ()),
        ((0.1, 9.0, 0.1), ()),  # Dahl's bristle is known where its damping is not
        ((1.01, 0.1, 0.1), ("presliding.a",)),
        ((0.1, 0.1, 0.59), ("presliding.x_c",)),
    ],
)
@pytest.mark.parametrize("together", [0.0, 0.9])
def test_a_bristle_is_fixed_whatever_its_damping(errors, names, together):
    """A damping and a length that are known together only leave the length open: x_c is stated,
    with the error of its marginal distribution."""
    spread = np.diag(np.asarray(errors) ** 2)
    spread[1, 2] = spread[2, 1] = together * errors[1] * errors[2]
    jacobian = np.linalg.cholesky(np.linalg.inv(spread)).T
    own = tuple(BRISTLE)
    about = dict(zip(own, quantities(Presliding).values(), strict=True))
    made = SimpleNamespace(
        names=own, rows=2, weight=np.ones(3), unit=1.0, beyond=lambda effects, z, scales: (),
        noise=SimpleNamespace(friction=np.asarray([100.0, -100.0, 0.0])),
        free=lambda effects: np.arange(3),
        evaluate=lambda z, index: SimpleNamespace(
            failed=False, jacobian=jacobian[:, index],
            extra_jacobian=np.zeros((0, len(index))),
        ),
        whiten=lambda columns, noise: columns,
        values=lambda z: BRISTLE,
        model=SimpleNamespace(
            effects=(), columns=lambda ids: [0, 1, 2], amplitudes=lambda id: [0, 1],
            quantity=about.__getitem__,
        ),
    )  # fmt: skip
    candidate = SimpleNamespace(effects=("presliding",), z=np.ones(3), noise=None)
    assert not_fixed(made, candidate, AXIS) == names


@pytest.mark.parametrize(
    ("effect", "names"),
    [  # the travel is 0.2 m, the slowest speed 1 mm/s
        (AxisPositionPeriodic(1.0, 0.0, 0.13), ()),
        (AxisPositionPeriodic(1.0, 0.0, 0.14), ("wavelength",)),
        (Presliding(2.0, 0.0, 0.03), ()),
        (Presliding(2.0, 0.0, 0.04), ("x_c",)),
        (Presliding(2.0, -190.0, 0.01), ()),
        (Presliding(2.0, -210.0, 0.01), ("sigma_1",)),
        (LogViscous(1.0, 1.1e-6), ()),
        (LogViscous(1.0, 0.9e-6), ("v_c",)),
        (RateAndState(1.0, 2.0, 1e-3, 0.9e-6), ("v_c",)),
    ],
)
def test_what_no_record_of_its_size_shows(effect, names):
    assert beyond(effect, AXIS) == names
