"""Words of the reports and figures of a loop, for each kind of rig."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from ..effects import AXIS_CATALOGUE, CATALOGUE, AbstractEffect
from ..fitting.problem import quantity_of
from ..loop.result import Loop
from ..quantity import Quantity, quantities
from ..rig.axis import AxisRig


class LoopWords(NamedTuple):
    """Words, units, catalogue and limits of drawings of one kind of rig."""

    base: str
    """The base model; "{law}" stands for the name of its law."""
    part: str
    """A part of the record, such as "velocity step"."""
    marks: str
    """Name of the marks where a part begins."""
    velocity: str
    """Name of the velocity of a part."""
    speed: str
    """Unit of the velocities of a record in metres."""
    catalogue: Mapping[str, type[AbstractEffect]]
    """The effects that are considered, but for the user's own."""
    quantity: Callable[[str], Quantity]
    """Symbol, unit and meaning of a parameter of the base. Raises `KeyError` where it has none of
    that name."""
    over_path: bool
    """Whether figures are drawn over the motion, where that always advances; else over time."""


SLIDER = LoopWords(
    base="{law} law",
    part="velocity step",
    marks="velocity steps",
    velocity="Commanded velocity",
    speed="um/s",
    catalogue=CATALOGUE,
    quantity=quantity_of,
    over_path=True,
)
AXIS = LoopWords(
    base="Coulomb and viscous friction",
    part="motion segment",
    marks="stops and reversals",
    velocity="Mean velocity",
    speed="mm/s",
    catalogue=AXIS_CATALOGUE,
    quantity={about.symbol: about for about in quantities(AxisRig).values()}.__getitem__,
    over_path=False,
)


def of(loop: Loop) -> LoopWords:
    """The words for the rig of a loop."""
    return {"slider": SLIDER, "axis": AXIS}[loop.kind]
