"""Margins and linear stability of many sliders: `stability.margins` under `vmap`."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..stability.margin_table import MARGINS
from ..stability.margins import is_stable, margins
from ..stability.theorem import apply_theorem
from ..study import Output
from ..tables import Table, refuse_unknown
from .sliders import Parameters, Sliders, sliders_of
from .spec import Spec, StudyPart

STABILITY = {
    "stable": "Steady sliding is asymptotically stable.",
    "unstable": "Steady sliding is unstable.",
    "no_steady_state": "The friction law has no steady state at this velocity.",
}


@dataclass(frozen=True, eq=False)
class LinearStability:
    """Margins, critical stiffness and stability of steady sliding, for sliders with mass."""

    sliders: Sliders

    def __call__(self, varied: Parameters) -> dict[str, Array]:
        """Return the outputs of an array of members."""
        return jax.vmap(self._member)(self.sliders.parameters(varied))

    def _member(self, p: Parameters) -> dict[str, Array]:
        slider = self.sliders.linear(p, mass=True)
        theorem = apply_theorem(slider)
        leaves = jax.tree.leaves(slider.friction)  # not finite where there is no linearisation
        known = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in leaves]))
        stable = jnp.where(is_stable(slider), 0, 1)
        found = margins(slider) | {
            "k_cr": theorem.critical_stiffness,
            "w_cr": theorem.critical_frequency,
        }
        found = {name: jnp.where(known, x, jnp.nan) for name, x in found.items()}
        return {**found, "stability": jnp.where(known, stable, 2).astype(jnp.int8)}


def make_margins(spec: Spec, table: Table, where: str) -> StudyPart:
    """Make the study part of `compute = ["margins"]`; its table [margins] must be empty."""
    refuse_unknown(table, (), where)
    outputs = (
        Output("stability", long_name="linear stability", codes=STABILITY),
        *(Output(name, one.unit, one.text) for name, one in MARGINS.items()),
        Output("k_cr", "N/m", "critical stiffness"),
        Output("w_cr", "rad/s", "critical frequency"),
    )
    return StudyPart(LinearStability(sliders_of(spec)), outputs)
