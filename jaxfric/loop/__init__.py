"""Closing the loop: find what a model lacks, name it, add it, report before and after."""

from .loop import Loop as Loop
from .loop import close_loop as close_loop
