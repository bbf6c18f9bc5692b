"""The computations of `jaxfric study`: margins, end states, gains, fits, verdicts.

parameters   names, units and bounds of parameters that a study sets or varies
sliders      laws, rigs and linearised sliders from parameters by name
margins      margins and linear stability of many sliders at once
motions      simulations of many sliders at once
ends         end states of massless sliders, determined during the simulation
one_by_one   gains, fits and loops: Python, member by member
computations the computations of a study, one entry each
spec         study.toml
together     the computations of a study as one function, with the entries that it uses
make         from a study.toml to a running study
"""

from .make import make as make
from .make import run_study as run_study
