"""Friction laws by name and from files: whatever says which law it is, every verb asks here.

registry      name -> class, parameters, how it is built
source        a law of a fit with samples, or of parameters given one by one
table         the law of a table of steady friction against speed
posterior     (posterior_file) the law of a posterior, with its draws as samples
loop_source   the law that a loop.json of a slider ends with
axis_loop     the law of a loop.json of a servo axis
file          the law of any such result, or of its file
saved         reading, checking and sampling such files; their warnings go wherever the law goes
"""

from .file import law_from_fit as law_from_fit
from .registry import REGISTRY as REGISTRY
from .registry import name_of as name_of
from .source import LawSource as LawSource
from .source import law_from_parameters as law_from_parameters
from .table import law_from_table as law_from_table
