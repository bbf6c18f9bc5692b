"""Plans sequences of velocity steps: which effects they can tell apart, before they are run."""

from .design import Change as Change
from .design import Design as Design
from .design import Smallest as Smallest
from .plan import Planned as Planned
from .plan import plan as plan
from .remedy import Remedy as Remedy
from .remedy import remedy as remedy
