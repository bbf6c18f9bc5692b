"""An effect of one's own: one file and one line, for sliders, for axes or for both.

The module is written here and touches nothing else. Quadratic drag acts on both rigs; a spring
acts where the slider is. What they do is compared with the equations by hand.
"""

import importlib.util
import json

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric.effects import AXIS_CATALOGUE, CATALOGUE, AbstractEffect, effect_of, made, register
from jaxfric.errors import InputError
from jaxfric.fitting.abstract_problem import Sizes, typical_size
from jaxfric.fitting.encompassing import EncompassingModel
from jaxfric.loop.case import offered
from jaxfric.motion import MeasuredMotion
from jaxfric.rig import QuasiStatic, Rig
from jaxfric.rig.axis import AxisRig, BaseLaw
from jaxfric.rig.friction import Conditions, RateState
from jaxfric.saved import law_from_fit

OWN = """
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxfric.effects import AbstractLinearEffect, AbstractPlaceEffect, register, with_term
from jaxfric.quantity import quantity
from jaxfric.rig import Rig
from jaxfric.rig.axis import AbstractAxisTerm, AxisRig
from jaxfric.rig.friction.extended import AbstractStatelessTerm


class _Drag(AbstractStatelessTerm):
    moves: ClassVar[bool] = False
    states: ClassVar[int] = 0
    c: Array

    def force(self, at):
        return self.c * at.V**2


class _AxisDrag(AbstractAxisTerm):
    c: Array

    def force(self, at):
        return self.c * at.velocity**2 * at.sign


class _Spring(AbstractStatelessTerm):
    moves: ClassVar[bool] = False
    states: ClassVar[int] = 0
    k: Array

    def force(self, at):
        return self.k * at.slip


@register
class Drag(AbstractLinearEffect):
    rigs: ClassVar = (Rig, AxisRig)
    id: ClassVar[str] = "drag"
    room: ClassVar[str] = "friction"
    equation: ClassVar[str] = "+ c V |V|"
    confused_with: ClassVar[tuple[str, ...]] = ("viscous",)
    separated_by: ClassVar[str] = "a wide range of velocities"
    channel: ClassVar[str | None] = None
    c: Array = quantity("c", "F s^2/m^2", "quadratic drag", default=0.0)

    def embed(self, rig):
        if isinstance(rig, AxisRig):
            return eqx.tree_at(lambda r: r.terms, rig, (*rig.terms, _AxisDrag(self.c)))
        return with_term(rig, _Drag(self.c))

    def physical(self):
        return self.c > 0


@register
class Spring(AbstractLinearEffect, AbstractPlaceEffect):
    id: ClassVar[str] = "spring"
    room: ClassVar[str] = "friction"
    equation: ClassVar[str] = "+ k x"
    confused_with: ClassVar[tuple[str, ...]] = ()
    separated_by: ClassVar[str] = "more slip"
    channel: ClassVar[str | None] = None
    k: Array = quantity("k", "F/m", "stiffness", default=0.0)

    def embed(self, rig):
        return with_term(rig, _Spring(self.k))

    def softest_spring(self):
        return 2 * self.k

    def physical(self):
        return jnp.asarray(True)
"""
F0, A, B, L, V0 = 0.6, 0.01, 0.007, 1e-5, 1e-6
C = 3e9


@pytest.fixture
def own(tmp_path):
    """The module of an effect's author; the catalogues are as before when the test ends."""
    before = dict(CATALOGUE), dict(AXIS_CATALOGUE)
    path = tmp_path / "own_effect.py"
    path.write_text(OWN)
    found = importlib.util.spec_from_file_location("own_effect", path)
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    yield module
    for catalogue, known in zip((CATALOGUE, AXIS_CATALOGUE), before, strict=True):
        catalogue.clear()
        catalogue.update(known)


def loop_json(folder, law, values, effects, **more):
    size = 0.01 * np.abs(list(values.values()))
    path = folder / "loop.json"
    content = {
        "schema": "jaxfric.loop/2",
        "law": law,
        "verdict": "effects",
        "sentence": "that is missing.",
        "effects": effects,
        "after": {
            "parameters": {k: {"value": v, "determined": True} for k, v in values.items()},
            "free": list(values),
            "covariance": np.diag(size**2).tolist(),
        },
        "warnings": [],
        **more,
    }
    path.write_text(json.dumps(content))
    return path


def test_it_is_in_the_catalogue_of_every_rig_that_it_fits(own):
    assert effect_of("drag") is own.Drag and effect_of("drag", AxisRig) is own.Drag
    assert effect_of("spring") is own.Spring
    with pytest.raises(InputError, match="effect 'spring' of an axis does not exist"):
        effect_of("spring", AxisRig)
    for catalogue in (CATALOGUE, AXIS_CATALOGUE):
        asked = offered(catalogue, (), ("drag",), (), 8, effect_of)
        assert own.Drag in asked.effects and asked.with_ == ("drag",)
    assert register(own.Drag) is own.Drag  # the same one again is no other

    class Other(own.Spring):
        id = "drag"

    with pytest.raises(ValueError, match="there is another effect 'drag'"):
        register(Other)


def test_at_its_null_it_changes_nothing_and_else_what_its_equation_says(own):
    slider = Rig(QuasiStatic(1e3), RateState(F0, A, [B], [L], V0))
    at, state = Conditions(jnp.zeros(()), jnp.zeros(())), jnp.zeros(1)
    V = jnp.asarray(3e-6)
    plain = float(slider.friction.force(V, state, at))
    for c, drag in ((0.0, 0.0), (C, C * 9e-12)):
        rig = made(own.Drag, {"c": c}).embed(slider)
        assert float(rig.friction.force(V, state, at)) == pytest.approx(plain + drag, rel=1e-14)
    t = jnp.linspace(0.0, 1.0, 50)
    v = 0.1 * jnp.cos(6 * t)
    motion = MeasuredMotion(t, jnp.sin(6 * t) / 60, v, -0.6 * jnp.sin(6 * t), jnp.abs(t))
    axis = AxisRig(2.0, 30.0, 5.0, 0.1, width=1e-4)
    plain = np.asarray(axis.force(motion))
    for c in (0.0, 7.0):
        found = np.asarray(made(own.Drag, {"c": c}).embed(axis).force(motion))
        drag = c * np.asarray(v) * np.abs(np.asarray(v)) * np.tanh(np.abs(np.asarray(v)) / 1e-4)
        np.testing.assert_allclose(found, plain + drag, rtol=1e-14)


def test_gains_take_the_loop_of_a_slider_with_it(own, tmp_path):
    values = {"f0": F0, "A": A, "B": B, "L": L, "drag.c": C, "spring.k": -2.0}
    more = {"friction_unit": "1", "reference_velocity": V0}
    path = loop_json(tmp_path, "slip", values, ["drag", "spring"], **more)
    found = law_from_fit(path, normal_force=500.0, samples=0)
    V = jnp.asarray(5e-6)
    at = Conditions(jnp.asarray(1e-3), jnp.zeros(()))  # where the spring would pull by 1 N
    force = float(found.law.force(V, found.law.steady_state(V), at))
    assert force == pytest.approx(500 * (F0 + (A - B) * np.log(5) + C * 25e-12), rel=1e-7)
    (told,) = found.warnings
    assert told.startswith("spring is left out") and "a spring of -2e+03 N/m" in told


def test_gains_take_the_loop_of_an_axis_with_it(own, tmp_path):
    values = {"M": 3.0, "F_v": 20.0, "F_c": 6.0, "F_0": 0.0, "drag.c": 40.0}
    values |= {f"rate_and_state.{n}": x for n, x in zip("AB", (2.0, 1.0), strict=True)}
    values |= {"rate_and_state.L": 1e-3, "rate_and_state.v_c": 1e-3}
    axis = {"coordinate": "linear", "sign_width": 1e-5}
    effects = ["rate_and_state", "drag"]
    path = loop_json(tmp_path, "coulomb_viscous", values, effects, friction_unit="N", axis=axis)
    law = law_from_fit(path, samples=0).law
    V = jnp.asarray(0.02)
    force = float(law.force(V, law.steady_state(V), Conditions(jnp.zeros(()), jnp.zeros(()))))
    assert force == pytest.approx(6 + 20 * 0.02 + np.log(21) + 40 * 4e-4, rel=1e-9)


def test_a_unit_that_is_not_known_is_refused_where_it_would_scale_silently(own):
    """Before, an axis took 1 for the size of a parameter whose unit it did not know."""

    class Odd(AbstractEffect):
        id = "odd"
        room = "friction"
        equation = confused_with = separated_by = ""
        channel = None
        c: float = own.quantity("c", "kg/m", "odd", default=0.0)

        def embed(self, rig):
            return rig

        def grid(self, scales):
            return {}

        def physical(self):
            return True

    model = EncompassingModel(BaseLaw(), (Odd, own.Drag, effect_of("servo_lag", AxisRig)))
    sizes = Sizes(*(jnp.asarray(x) for x in (8.0, 2.0, 5.0, 10.0, 0.1)))
    assert float(typical_size(model.quantity("drag.c"), sizes)) == 8.0 / 2.0**2
    assert float(typical_size(model.quantity("servo_lag.tau"), sizes)) == 0.1
    with pytest.raises(ValueError, match="unit 'kg/m': factors are F, m, s"):
        typical_size(model.quantity("odd.c"), sizes)
