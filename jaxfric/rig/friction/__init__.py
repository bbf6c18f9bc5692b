"""Friction laws: one part of the rig."""

from .delay import AbstractDelayLaw as AbstractDelayLaw
from .delay import HessSoom as HessSoom
from .law import AbstractInvertibleLaw as AbstractInvertibleLaw
from .law import AbstractLaw as AbstractLaw
from .law import Conditions as Conditions
from .memoryless import AbstractStribeck as AbstractStribeck
from .memoryless import GaussianStribeck as GaussianStribeck
from .memoryless import GeneralStribeck as GeneralStribeck
from .memoryless import critical_velocity as critical_velocity
from .memoryless import worst_slope as worst_slope
from .presliding import Dahl as Dahl
from .rate_state import AbstractDirectEffect as AbstractDirectEffect
from .rate_state import AbstractEvolution as AbstractEvolution
from .rate_state import AbstractRateState as AbstractRateState
from .rate_state import AgeingEvolution as AgeingEvolution
from .rate_state import LogarithmicEffect as LogarithmicEffect
from .rate_state import RateState as RateState
from .rate_state import RegularisedEffect as RegularisedEffect
from .rate_state import SlipEvolution as SlipEvolution
from .tabulated import TabulatedFriction as TabulatedFriction
