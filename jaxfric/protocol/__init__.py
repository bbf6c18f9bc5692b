"""What a planned sequence of velocity steps will be able to tell, before it is run."""

from .outlook import Change as Change
from .outlook import Outlook as Outlook
from .outlook import Smallest as Smallest
from .plan import Planned as Planned
from .plan import plan as plan
