"""Linear stability of steady sliding: plant and kernel, theorem, delays, margins.

Modules and names such as the following are loaded on first use:
`jaxfric.stability.linear.to_control`, `jaxfric.stability.stability_margin`.
"""

from typing import TYPE_CHECKING

from ..lazy import loader

if TYPE_CHECKING:
    from . import analysis as analysis
    from . import claims as claims
    from . import delay as delay
    from . import frequency as frequency
    from . import kernel as kernel
    from . import linear as linear
    from . import margins as margins
    from . import theorem as theorem
    from .linear import LinearSlider as LinearSlider
    from .linear import linearise as linearise
    from .linear import to_control as to_control
    from .margins import stability_margin as stability_margin

_HOMES = {
    "LinearSlider": "linear",
    "linearise": "linear",
    "to_control": "linear",
    "stability_margin": "margins",
}
_MODULES = (
    "analysis",
    "claims",
    "delay",
    "frequency",
    "kernel",
    "linear",
    "margins",
    "theorem",
)
__all__ = sorted(_HOMES)
__getattr__, __dir__ = loader(__name__, _HOMES, _MODULES, {"margin": "stability_margin"})
