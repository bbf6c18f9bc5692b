"""Fitting rate-and-state friction to velocity-step records."""

from .fit import fit as fit
from .problem import Model as Model
from .result import Estimate as Estimate
from .result import Fit as Fit
from .result import NoiseEstimate as NoiseEstimate
