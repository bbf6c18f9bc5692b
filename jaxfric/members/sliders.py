"""Make laws, rigs and linearised sliders of a study from parameters by name.

Parameters are arrays with the values of one member or, under `vmap`, of many members. Fixed
parameters are stored in `Sliders`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array

from ..laws.registry import evolution_of
from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction import AbstractLaw
from ..stability.linear import LinearSlider, linearise
from .parameters import rate_state
from .spec import Spec

Parameters = Mapping[str, Array]


def streamed(law: str | AbstractLaw) -> bool:
    """Whether `members.ends` can determine the end state of a massless slider under this law."""
    return isinstance(law, str) and evolution_of(law) is not None


@dataclass(frozen=True, eq=False)
class Sliders:
    """The sliders of a study.

    law : name of a rate-and-state law, with parameters from the study; or a law.
    fixed : parameters that do not vary, SI.
    """

    law: str | AbstractLaw
    states: int
    fixed: Mapping[str, float]

    def parameters(self, varied: Parameters) -> dict[str, Array]:
        """Return all parameters of members, varied and fixed."""
        like = next(iter(varied.values()))
        fixed = {name: jnp.full_like(like, value) for name, value in self.fixed.items()}
        return {**fixed, **varied}

    def law_of(self, p: Parameters) -> AbstractLaw:
        """Return the law of a member, with the regularised direct effect."""
        if not isinstance(self.law, str):
            return self.law
        return rate_state(self.law, p, self.states)

    def rig(self, p: Parameters, *, mass: bool) -> Rig:
        """Return the rig of a member; with `mass` the rig includes the member's mass, if given."""
        if mass and "m" in p:
            return Rig(Inertial(p["m"], p["k_p"], p["k_v"]), self.law_of(p))
        return Rig(QuasiStatic(p["k_p"], p["k_v"]), self.law_of(p))

    def linear(self, p: Parameters, *, mass: bool) -> LinearSlider:
        """Return the rig of a member, linearised about steady sliding at V0."""
        return linearise(self.rig(p, mass=mass), p["V0"])


def sliders_of(spec: Spec) -> Sliders:
    """Return the sliders of a study."""
    assert spec.law is not None
    return Sliders(spec.law, spec.states, spec.fixed)
