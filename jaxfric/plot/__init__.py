"""Figures, from result objects only.

`draw_...` writes the figure of a result to files, as the command does. The method `.plot()` of a
result returns the figure itself. The names below are loaded when they are first used.
"""

from typing import TYPE_CHECKING

from ..lazy import loader

if TYPE_CHECKING:
    from .fit import draw_fit as draw_fit
    from .gains import draw_gains as draw_gains
    from .loop import draw_loop as draw_loop
    from .posterior import draw_posterior as draw_posterior
    from .prediction import draw_prediction as draw_prediction
    from .record import draw_record as draw_record
    from .run import draw_rates as draw_rates
    from .steady import draw_steady as draw_steady
    from .study import draw_study as draw_study

_HOMES = {
    "draw_fit": "fit",
    "draw_gains": "gains",
    "draw_loop": "loop",
    "draw_posterior": "posterior",
    "draw_prediction": "prediction",
    "draw_record": "record",
    "draw_rates": "run",
    "draw_steady": "steady",
    "draw_study": "study",
}
__all__ = sorted(_HOMES)
__getattr__, __dir__ = loader(__name__, _HOMES)
