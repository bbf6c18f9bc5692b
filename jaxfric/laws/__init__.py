"""Friction laws by name and from parameters: whatever says which law it is, every verb asks here.

registry      name -> class, parameters, how it is built
source        a law with samples; that of parameters given one by one
fitted        the law of parameters that a record gave, with samples that their errors allow

The parameters of results and of their files are read by `jaxfric.saved`.
"""

from .fitted import FittedLaw as FittedLaw
from .fitted import law_of as law_of
from .registry import REGISTRY as REGISTRY
from .registry import name_of as name_of
from .source import LawSource as LawSource
from .source import law_from_parameters as law_from_parameters
