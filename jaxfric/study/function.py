"""The function that a study evaluates: a pure function of one member, or of many members."""

import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from jax import Array
    from jax.typing import ArrayLike

from ..errors import InputError
from .grid import SAMPLE, Axis, Grid, Tiling

OUTCOME = "outcome"
"""Output of every study: whether a member was computed."""
ERRORS = "errors"
"""Folder of a store with the errors of failed members, one file for each block with errors."""
OUTCOMES = {
    "computed": "All numbers of this member were computed.",
    "not_a_number": "A number of this member is not one; its other codes may say why.",
    "error": "The function failed for this member; the next run tries it again.",
}


DTYPES = ("float64", "float32")
Function = Callable[[dict[str, Any]], Mapping[str, Any]]
"""Function of a study: outputs by name from parameters by name, see `Task.kind`."""
Cost = Callable[[dict[str, "Array"]], "Array"]
"""Cost of members in any unit, from arrays of parameters. Members of similar cost share a batch, so
that a slow member does not delay fast ones."""
Kind = Literal["member", "batch", "host"]
"""Kind of a function: see `Task`."""


class Stopped(InputError):
    """The run ended before the study was complete.

    The store of a stopped study is valid, and the same command continues the study.
    """


@dataclass(frozen=True)
class Output:
    """Unit, meaning and dimensions of one output; `codes` gives the meanings of 0, 1, 2, ..."""

    name: str
    unit: str = "1"
    long_name: str = ""
    dims: tuple[Axis, ...] = ()
    """Dimensions beyond those of the grid."""
    codes: Mapping[str, str] | None = None

    @property
    def dtype(self) -> str:
        """Data type of an output in the store; numbers have the type that the study sets."""
        return "int8" if self.codes is not None else "float"


class Computed(NamedTuple):
    """The outputs of one block, shaped as the block's part of the grid."""

    values: dict[str, np.ndarray]
    errors: dict[int, str]
    """Errors of failed members, by their index in the flattened block."""


@dataclass(frozen=True, eq=False)
class Task:
    """A function, its grid cut into blocks, and settings of the computation.

    kind "member": a JAX function of one member's parameters, mapped by `vmap`;
    "batch": a JAX function of arrays of parameters;
    "host": any Python function of one member's floats.
    Every function returns a dict of outputs.
    """

    function: Function
    grid: Grid
    blocks: Tiling
    outputs: tuple[Output, ...]
    kind: Kind = "member"
    cost: Cost | None = None
    batch: int = 512
    """Number of members that share a loop on a device."""
    dtype: str = "float64"
    """Type of the stored numbers: "float64" or "float32"."""
    precision: str = "float64"
    """Type of the numbers in the computation: "float64" or "float32"."""
    separate: bool = True
    """Each device runs its own loops, by `shard_map`. Solves by lineax cannot be traced there;
    False shares the loops between devices, so that all wait for the slowest member."""
    token: str = field(default_factory=lambda: uuid.uuid4().hex)
    """Key of the compiled function in a process; it is sent with the task."""


def refuse_dtypes(dtype: str, precision: str) -> None:
    """Raise `InputError` for an unknown data type of numbers."""
    for name, given in (("dtype", dtype), ("precision", precision)):
        if given not in DTYPES:
            raise InputError(f"{name} is '{given}'; it is float64 or float32")


def refuse_clashes(grid: Grid, outputs: Sequence[Output]) -> None:
    """Raise `InputError` if two variables or dimensions of a store have the same name."""
    names = [*grid.names, *(output.name for output in outputs)]
    dims = {dim.name: dim for output in outputs for dim in output.dims}
    for name in (*names, *dims):
        if name in (OUTCOME, ERRORS, "done", "block", SAMPLE):
            raise InputError(f"'{name}' is a name that every store has; choose another")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"'{twice[0]}' is both a parameter and an output; rename one")
    clash = [name for name in dims if name in names]
    if clash:
        raise InputError(f"'{clash[0]}' is a dimension of an output and something else; rename one")
    for dim in (dim for output in outputs for dim in output.dims):
        if not np.array_equal(dim.values, dims[dim.name].values):
            raise InputError(f"dimension '{dim.name}' is of two lengths or values; rename one")


def member_shape(name: str, x: "ArrayLike", number: int) -> tuple[int, ...]:
    """Return the shape of one member's output, from this output of `number` members.

    Raises
    ------
    InputError : the output is complex, or its first axis is not that of the members.
    """
    refuse_complex(name, x)
    shape = np.shape(x)
    if shape[:1] != (number,):
        raise InputError(
            f"output '{name}' has shape {shape} for {number} members; a function of kind 'batch'"
            " returns arrays whose first axis is that of the members"
        )
    return shape[1:]


def refuse_complex(name: str, x: "ArrayLike") -> None:
    """Raise `InputError` for a complex output."""
    if np.iscomplexobj(x):
        raise InputError(f"output '{name}' is complex; return its real and imaginary parts as two")


def check_outputs(
    found: Mapping[str, "ArrayLike"], outputs: tuple[Output, ...], number: int
) -> None:
    """Raise `InputError` if an output of `number` members is missing or has another shape."""
    for output in outputs:
        if output.name not in found:
            raise InputError(
                f"the function gives no output '{output.name}'; it gives: {', '.join(found)}"
            )
        expected = tuple(len(dim.values) for dim in output.dims)
        shape = member_shape(output.name, found[output.name], number)
        if shape != expected:
            raise InputError(
                f"output '{output.name}' has shape {shape} for one member, not {expected}; give"
                " its dimensions with Output(dims=...)"
            )
