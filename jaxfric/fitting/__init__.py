"""Fitting rate-and-state friction to velocity-step records."""

from .fit import fit as fit
from .many import fit_many as fit_many
from .minimise import Minimum as Minimum
from .minimise import minimise as minimise
from .noise import NoiseEstimate as NoiseEstimate
from .noise import NoisePart as NoisePart
from .problem import Model as Model
from .result import Estimate as Estimate
from .result import Fit as Fit
