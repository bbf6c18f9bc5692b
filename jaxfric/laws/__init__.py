"""Friction laws by name and from files: whatever says which law it is, every verb asks here.

registry      name -> class, parameters, how it is built
source        a law of a fit.json with samples, or of parameters given one by one
posterior     (posterior_file) the law of a posterior.nc, with its draws as samples
loop_source   the law that a loop.json of a slider ends with
axis_loop     the law of a loop.json of a servo axis
file          the law of any such file
saved         reading, checking and sampling such files; their warnings go wherever the law goes
"""

from .posterior_file import law_from_posterior as law_from_posterior
from .registry import REGISTRY as REGISTRY
from .registry import name_of as name_of
from .source import LawSource as LawSource
from .source import law_from_fit as law_from_fit
from .source import law_from_parameters as law_from_parameters
