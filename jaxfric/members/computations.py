"""The table of the computations of a study, with one entry for each computation.

To add a computation, write a function that makes its `StudyPart`, and add an entry to this table.
"""

from .margins import make_margins
from .motions import make_motions
from .one_by_one import make_fit, make_gains, make_loop
from .spec import Computation

COMPUTATIONS: dict[str, Computation] = {
    "margins": Computation(make_margins),
    "simulate": Computation(make_motions),
    "gains": Computation(make_gains, needs=("V0",), alone=True),
    "fit": Computation(make_fit, alone=True),
    "loop": Computation(make_loop, alone=True),
}
