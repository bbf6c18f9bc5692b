"""Plan sequences of velocity steps: which effects an experiment can distinguish."""

from .design import Change as Change
from .design import Design as Design
from .design import Planned as Planned
from .design import Smallest as Smallest
from .plan import plan as plan
from .remedy import Remedy as Remedy
from .remedy import remedy as remedy
