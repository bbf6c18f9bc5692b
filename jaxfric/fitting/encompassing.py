"""The encompassing model of all candidates: a base model with every effect switched off.

One compilation of the residual and its Jacobian serves every candidate model, because a candidate
only chooses which parameters are free.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

from jaxtyping import Array, Float

from ..effects import AbstractEffect, AbstractHeavyEffect, made, null, parameters
from ..quantity import Quantity
from ..rig import Rig
from .abstract_problem import ParametricModel
from .problem import Model

R = TypeVar("R")


class EncompassingModel(NamedTuple):
    """A base model and effects. The parameter "viscous.c" is field c of effect `viscous`."""

    base: ParametricModel
    effects: tuple[type[AbstractEffect], ...]
    lighter: tuple[str, ...] = ()
    """Ids of heavy effects that are expanded to first order; valid only at their null."""

    def names(self) -> tuple[str, ...]:
        """Parameter names of the base model, then parameter names of the effects in order."""
        return (*self.base.names(), *(name for e in self.effects for name in names_of(e)))

    def quantity(self, name: str) -> Quantity:
        """The quantity of a parameter name."""
        if "." not in name:
            return self.base.quantity(name)
        effect, field = name.split(".")
        return next(parameters(e)[field] for e in self.effects if e.id == effect)

    def rig(
        self, values: Float[Array, " p"], V0: Float[Array, ""], stiffness: Float[Array, ""]
    ) -> Rig:
        """The rig of a slider with every effect embedded."""
        assert isinstance(self.base, Model)
        n = len(self.base.names())
        return self.embed(self.base.rig(values[:n], V0, stiffness), values[n:])

    def embed(self, rig: R, values: Sequence[Array] | Float[Array, " e"]) -> R:
        """A rig with every effect embedded; `values` holds the parameters of the effects alone."""
        n = 0
        for effect in self.effects:
            fields = list(parameters(effect))
            chosen = dict(zip(fields, values[n : n + len(fields)], strict=True))
            one = made(effect, chosen)
            if effect.id in self.lighter and isinstance(one, AbstractHeavyEffect):
                rig = one.embed_first_order(rig)
            else:
                rig = one.embed(rig)
            n += len(fields)
        return rig

    def nulls(self) -> list[float]:
        """Values of the effects' parameters at which the effects change nothing."""
        return [float(getattr(null(e), name)) for e in self.effects for name in parameters(e)]

    def columns(self, ids: tuple[str, ...]) -> list[int]:
        """Indices of the parameters of some effects."""
        wanted = {name for e in self.effects if e.id in ids for name in names_of(e)}
        return [i for i, name in enumerate(self.names()) if name in wanted]

    def amplitudes(self, id: str) -> list[int]:
        """Indices of the amplitudes of one effect: the parameters without a lower bound."""
        return [
            i
            for i in self.columns((id,))
            if not math.isfinite(self.quantity(self.names()[i]).lower)
        ]


def names_of(effect: type[AbstractEffect]) -> tuple[str, ...]:
    """Names of the parameters of an effect in an `EncompassingModel`."""
    return tuple(f"{effect.id}.{name}" for name in parameters(effect))
