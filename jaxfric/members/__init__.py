"""The computations that `jaxfric study` asks of rigs: margins, end states, gains, fits, verdicts.

parameters   names, units and bounds of what can be set and varied
sliders      laws, rigs and linearised sliders from parameters by name
margins      margins and linear stability of many sliders at once
motions      simulations of many sliders at once
ends         how massless sliders end, told while they move
one_by_one   gains, fits and loops: Python, member by member
computations what a study can compute: one entry each
spec         study.toml
make         from a study.toml to a running study
"""

from .make import make as make
from .make import run_study as run_study
