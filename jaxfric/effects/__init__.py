"""The catalogue of effects that a model may lack, by part of the rig."""

from .axis import AbstractAxisEffect as AbstractAxisEffect
from .catalogue import AXIS_CATALOGUE as AXIS_CATALOGUE
from .catalogue import CATALOGUE as CATALOGUE
from .catalogue import STEADY_CURVES as STEADY_CURVES
from .catalogue import effect_of as effect_of
from .catalogue import effects_of_file as effects_of_file
from .catalogue import register as register
from .effect import AbstractEffect as AbstractEffect
from .effect import AbstractHeavyEffect as AbstractHeavyEffect
from .effect import AbstractLinearEffect as AbstractLinearEffect
from .effect import AbstractPlaceEffect as AbstractPlaceEffect
from .effect import RecordScales as RecordScales
from .effect import ids_of as ids_of
from .effect import made as made
from .effect import null as null
from .effect import parameters as parameters
from .effect import separators as separators
from .effect import with_evolution as with_evolution
from .effect import with_term as with_term
from .run_changes import RunChange as RunChange
