"""Friction laws, looked up by name or built from parameters; all commands use this package.

registry      name -> class, parameters, builder
source        a law with samples of its uncertainty; a law from parameters given one by one
fitted        the law of a fitted result, with samples drawn from the parameter errors

`jaxfric.saved` reads the parameters of results and of their files.
"""

from .fitted import FittedLaw as FittedLaw
from .fitted import law_of as law_of
from .registry import REGISTRY as REGISTRY
from .registry import name_of as name_of
from .source import LawSource as LawSource
from .source import law_from_parameters as law_from_parameters
