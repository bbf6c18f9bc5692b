"""A whole run of a press: what happens in it, its velocity steps, and the fits of all."""

from .events import KINDS as KINDS
from .events import Event as Event
from .events import find_events as find_events
