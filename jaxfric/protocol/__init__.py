"""What a planned sequence of velocity steps will be able to tell, before it is run."""

from .design import Change as Change
from .design import Design as Design
from .design import Smallest as Smallest
from .plan import Planned as Planned
from .plan import plan as plan
