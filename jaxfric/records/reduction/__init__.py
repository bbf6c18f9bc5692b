"""Reduction: convert what a press recorded to columns with units, by the laboratory's own script.

`operations` has the arithmetic. `bench` has the numbered columns that a script works on, and the
log of the script's steps. `xlook_script` runs command files of xlook, `toml_script` scripts in
TOML. `reduce` opens a file and reduces it.
"""

from .bench import Bench as Bench
from .bench import Done as Done
from .reduce import reduced as reduced
from .toml_script import run_toml as run_toml
from .xlook_script import run_xlook as run_xlook
