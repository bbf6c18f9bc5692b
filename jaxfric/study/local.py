"""Evaluate one block of a study (some of its parameter points) on the devices of this process.

Every block is padded to one fixed size, so that a study compiles once. If costs are known, the
members of a block are sorted by cost and dealt to the devices in turn. Each device computes `batch`
members at a time; a GPU computes more members at a time. Every device runs its loops separately
(`shard_map`). In a loop shared by `vmap` over all members, all members would wait for the slowest
member.
"""

import contextlib
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from ..threads import at_once
from .function import (
    OUTCOME,
    OUTCOMES,
    Computed,
    Function,
    Output,
    Task,
    check_outputs,
    member_shape,
    refuse_complex,
)
from .grid import Axis, Grid

_FEW = 64
_OUTCOMES = list(OUTCOMES)
Arrays = dict[str, jax.Array]
OfArrays = Callable[[Arrays], Arrays]
_compiled: dict[str, Callable[[dict[str, np.ndarray]], Arrays]] = {}


def compute(task: Task, number: int) -> Computed:
    """Return the outputs and sampled parameters of a block, in the block's shape."""
    where = task.blocks.where(number)
    members = task.grid.members(where)
    if task.kind == "host":
        found, errors = _one_by_one(task, members)
    else:
        count, errors = len(next(iter(members.values()))), {}
        found = {name: np.asarray(x)[:count] for name, x in dispatch(task, members).items()}
    lengths = tuple(part.stop - part.start for part in where)
    return Computed({n: x.reshape(*lengths, *x.shape[1:]) for n, x in found.items()}, errors)


def dispatch(task: Task, members: dict[str, np.ndarray]) -> Arrays:
    """Start to compute some members; the returned arrays have the length of a whole block."""
    with jax.enable_x64(task.precision == "float64"), _on(task):
        if task.token not in _compiled:
            _compiled.clear()
            _compiled[task.token] = _compile(task)
        filled = {name: _filled(task, column) for name, column in members.items()}
        return _compiled[task.token](filled)


def _devices(task: Task) -> list:
    """Return JAX's default devices, or the CPU if few members share a loop: a GPU needs many, which
    would wait for the slowest."""
    if task.batch < _FEW:
        with contextlib.suppress(RuntimeError):  # JAX was configured without the CPU
            return jax.devices("cpu")
    return jax.devices()


def _on(task: Task) -> contextlib.AbstractContextManager[object]:
    """Make the task's devices JAX's default within the block, if they are not."""
    first = _devices(task)[0]
    own = first.platform == jax.default_backend()
    return contextlib.nullcontext() if own else jax.default_device(first)


def _filled(task: Task, column: np.ndarray) -> np.ndarray:
    column = column.astype(task.precision)
    more = _whole(task) - len(column)
    return np.concatenate([column, np.full(more, column[-1])]) if more else column


def _whole(task: Task) -> int:
    """Return the size of a padded block: a whole number of batches for every device."""
    parts = len(_devices(task)) * _batch(task)
    return -(-task.blocks.largest // parts) * parts


def _batch(task: Task) -> int:
    with _on(task):
        number = at_once(task.batch)
        if number > task.batch:  # on a GPU a loop over few members takes as long as over many
            number = max(number, at_once(Task.batch))
    return max(min(number, -(-task.blocks.largest // len(_devices(task)))), 1)


def _compile(task: Task) -> Callable[[dict[str, np.ndarray]], Arrays]:
    devices, size = _devices(task), _batch(task)
    mesh = Mesh(np.asarray(devices), ("device",))
    split = PartitionSpec("device")
    rows, shared = _batched(task), len(devices) > 1 and not task.separate
    # devices that share a loop have each its part of every batch
    lanes = NamedSharding(mesh, PartitionSpec(None, "device"))
    together = size * len(devices) if shared else size

    def mapped(members: Arrays) -> Arrays:
        parts = {name: x.reshape(-1, together) for name, x in members.items()}
        if shared:
            parts = jax.lax.with_sharding_constraint(parts, dict.fromkeys(parts, lanes))
        found = jax.lax.map(rows, parts)
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), found)

    if len(devices) > 1 and task.separate:
        mapped = jax.shard_map(mapped, mesh=mesh, in_specs=split, out_specs=split, check_vma=False)

    def block(members: Arrays) -> Arrays:
        order = _order(task, members, len(devices) if task.separate else 1, size)
        if order is None:
            return mapped(members)
        found = mapped({name: x[order] for name, x in members.items()})
        back = jnp.argsort(order)
        return jax.tree.map(lambda x: x[back], found)

    return jax.jit(block, in_shardings=NamedSharding(mesh, PartitionSpec()))


def _order(task: Task, members: Arrays, devices: int, size: int) -> jax.Array | None:
    """Return the order of members by cost, with batches dealt to the devices in turn."""
    if task.cost is None:
        return None
    cost = task.cost(members)
    order = jnp.argsort(jnp.where(jnp.isfinite(cost), cost, jnp.inf))
    return order.reshape(-1, devices, size).swapaxes(0, 1).reshape(-1)


def _batched(task: Task) -> OfArrays:
    """Return the function of a batch, with outputs in the types of the store, and the outcome."""
    function = task.function if task.kind == "batch" else jax.vmap(task.function)

    def rows(members: Arrays) -> Arrays:
        found = function(members)
        check_outputs(found, task.outputs, len(next(iter(members.values()))))
        kept = {o.name: jnp.asarray(found[o.name], _dtype(task, o)) for o in task.outputs}
        return kept | {OUTCOME: _outcome(task.outputs, kept)}

    return rows


def _dtype(task: Task, output: Output) -> str:
    return task.dtype if output.dtype == "float" else output.dtype


def _outcome(outputs: tuple[Output, ...], found: Arrays) -> jax.Array:
    numbers = [found[o.name] for o in outputs if o.dtype == "float"]
    some = next(iter(found.values()))
    bad = jnp.zeros(some.shape[:1], bool)
    for x in numbers:
        bad = bad | jnp.any(jnp.isnan(x).reshape(x.shape[0], -1), axis=1)
    return bad.astype(jnp.int8)


def _one_by_one(
    task: Task, members: dict[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], dict[int, str]]:
    """Evaluate a Python function member by member; an exception gives the code "error"."""
    number = len(next(iter(members.values())))
    shapes = {o.name: tuple(len(dim.values) for dim in o.dims) for o in task.outputs}
    found = {
        o.name: np.full(
            (number, *shapes[o.name]), np.nan if o.dtype == "float" else -1, _dtype(task, o)
        )
        for o in task.outputs
    }
    outcome = np.full(number, _OUTCOMES.index("error"), np.int8)
    errors: dict[int, str] = {}
    with jax.enable_x64(task.precision == "float64"):
        for i in range(number):
            try:
                given = task.function({name: float(x[i]) for name, x in members.items()})
                for o in task.outputs:
                    refuse_complex(o.name, given[o.name])
                row = {o.name: np.asarray(given[o.name], _dtype(task, o)) for o in task.outputs}
            except (KeyboardInterrupt, MemoryError):
                raise
            except Exception as error:  # a failed member must not stop a study
                errors[i] = error_text(error)
                continue
            for name, value in row.items():
                found[name][i] = value
            bad = [np.isnan(row[o.name]).any() for o in task.outputs if o.dtype == "float"]
            outcome[i] = any(bad)
    return found | {OUTCOME: outcome}, errors


def error_text(error: Exception) -> str:
    """Return the error as one line."""
    words = " ".join(str(error).split())
    return f"{type(error).__name__}: {words}"[:300].rstrip(" :")


def infer_outputs(function: Function, grid: Grid, kind: str, precision: str) -> tuple[Output, ...]:
    """Infer the names and dimensions of the outputs of a JAX function."""
    one = {name: jax.ShapeDtypeStruct((1,), precision) for name in grid.names}
    with jax.enable_x64(precision == "float64"):
        found = jax.eval_shape(function if kind == "batch" else jax.vmap(function), one)
    return outputs_of_shapes({name: member_shape(name, x, 1) for name, x in found.items()})


def outputs_of_shapes(shapes: Mapping[str, Sequence[int]]) -> tuple[Output, ...]:
    """Return outputs from the array shapes of one member; each array axis is a dimension."""
    return tuple(
        Output(
            name,
            dims=tuple(Axis(f"{name}_{i}", np.arange(n, dtype=float)) for i, n in enumerate(shape)),
        )
        for name, shape in shapes.items()
    )
