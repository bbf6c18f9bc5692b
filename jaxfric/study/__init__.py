"""Evaluate any pure function over a grid, in chunks, so that a killed study can be continued.

    grid      varied parameters: axes and samples, cut into blocks
    function  the evaluated function and its outputs
    local     a block on the devices of this process
    cluster   blocks on the workers of a Dask scheduler
    place     a folder, or an object store behind a URL
    layout    a new store: variables, units, meanings
    marks     checksums of a store
    store     Zarr, written block by block, each exactly once
    source    fingerprints of the code and versions that made the results
    run       the entry point

The package `jaxfric.study` contains no physics; `jaxfric.members` has the functions of `jaxfric
study`.
"""

from .function import Output as Output
from .function import Stopped as Stopped
from .function import Task as Task
from .grid import Axis as Axis
from .grid import Grid as Grid
from .grid import Normal as Normal
from .grid import Samples as Samples
from .grid import Uniform as Uniform
from .grid import linspace as linspace
from .grid import logspace as logspace
from .grid import values as values
from .progress import Progress as Progress
from .run import load as load
from .run import run as run
