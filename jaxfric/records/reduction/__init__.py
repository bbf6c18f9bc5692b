"""Reduction: from what a press recorded to columns in units, by the laboratory's own script.

`operations` has the arithmetic, `bench` the numbered columns that a script works on and the log of
what it did; `xlook_script` is the command language of xlook, `toml_script` another one for those
who have no such script, and `reduce` opens a file and reduces it.
"""

from .bench import Bench as Bench
from .bench import Done as Done
from .reduce import reduced as reduced
from .toml_script import run_toml as run_toml
from .xlook_script import run_xlook as run_xlook
