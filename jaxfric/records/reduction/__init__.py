"""Reduction: from what a press recorded to columns in units, by the laboratory's own script.

`operations` has the arithmetic, `bench` the numbered columns that a script works on and the log of
what it did, `xlook_script` the command language of xlook, and `reduce` opens a file and reduces it.
"""

from .bench import Bench as Bench
from .bench import Done as Done
from .reduce import reduced as reduced
from .xlook_script import run_xlook as run_xlook
