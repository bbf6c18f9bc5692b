"""Minimum-norm PD gains whose margins hold in every scenario, checked by simulation."""

from ..laws import LawSource as LawSource
from ..laws import law_from_parameters as law_from_parameters
from ..lazy import old_names
from ..saved import law_from_fit as law_from_fit
from .gains import check_gains as check_gains
from .gains import find_gains as find_gains
from .kkt import DERIVATIVE as DERIVATIVE
from .minimum import GAINS as GAINS
from .minimum import MinimumGains as MinimumGains
from .minimum import minimum_gains as minimum_gains
from .requirement import Requirement as Requirement
from .result import Gains as Gains
from .set_points import Schedule as Schedule
from .set_points import gain_schedule as gain_schedule

__getattr__ = old_names(__name__, {"schedule": "gain_schedule"})
