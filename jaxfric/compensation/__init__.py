"""Friction feedforward of an axis or joint, as a formula, a C function and a table."""

from .fade import Fade as Fade
from .fade import FadeReason as FadeReason
from .fade import fade_speed as fade_speed
from .feedforward import feedforward as feedforward
from .identified import NothingToCompensate as NothingToCompensate
from .result import Feedforward as Feedforward
from .spot import FrictionAt as FrictionAt
