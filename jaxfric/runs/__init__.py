"""Analyse a whole run of a press: its events, its velocity steps, and the fits of the steps."""

from .events import KINDS as KINDS
from .events import Event as Event
from .events import find_events as find_events
