"""One entry point: `run(function, grid, out)`."""

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..errors import InputError
from .function import OUTCOME, Output, Stopped, Task
from .grid import Blocks, Grid
from .source import belongs_to_package, fingerprint
from .store import DONE, Store, changed_versions, open_store

CHUNK = 65536
DTYPES = ("float64", "float32")


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    blocks: int
    """Blocks of the study, and how many of them are written."""
    written: int
    members: int
    """Members that this run computed."""
    rate: float
    """Members per second since the first block, which compiles; nan until there is a second."""
    left: float
    """Seconds to go at that rate."""


def run(
    function: Callable[[dict[str, Any]], Mapping[str, Any]],
    grid: Grid,
    out: str | Path,
    *,
    outputs: Sequence[Output] | None = None,
    kind: Literal["member", "batch", "host"] = "member",
    cost: Callable[[dict[str, Any]], Any] | None = None,
    chunk: int = CHUNK,
    batch: int = 512,
    dtype: str = "float64",
    precision: str | None = None,
    separate: bool = True,
    scheduler: str | None = None,
    description: Mapping[str, Any] | None = None,
    other_versions: bool = False,
    toml: str = "",
    progress: Callable[[Progress], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Any:
    """Evaluate a pure function over a grid, into a Zarr store; the store as an xarray Dataset.

    The same call goes on with a store that was begun; blocks that are there are checked by
    their checksum and not computed again.

    Parameters
    ----------
    function : of the parameters of one member, by name, as a dict of outputs. See `kind`.
    outputs : units, meanings and further dimensions; by default whatever the function gives.
    kind : "member": written with JAX, for one member; "batch": for arrays of members;
        "host": any Python, called with floats member by member (`outputs` must be given).
    cost : what members will take, of arrays of parameters, in any unit: those alike are
        computed together, so that one slow member does not hold a whole batch.
    chunk : members of a block, which is computed, held and written at once.
    batch : members that share a loop on a device.
    dtype : "float64" or "float32", of the numbers in the store.
    precision : the same of the computation; by default `dtype`.
    separate : each device runs loops of its own (`shard_map`). False for a function with implicit
        solvers (lineax), which cannot be traced there.
    scheduler : address of a Dask scheduler whose workers compute the blocks.
    description : plain values that tell this study from another; a store that has others is
        refused. By default the grid, the outputs, and the name of the function; what the function
        does, and all of one's own code that it uses, is compared in any case.
    other_versions : go on with a store that was begun with other versions of packages.
    toml : a text that is kept in the store's attributes.

    Raises
    ------
    InputError : a bad argument; `out` is no store, or of another study.
    Stopped : the disk is full or the scheduler is lost; the same call goes on.
    """
    precision = precision or dtype
    for name, given in (("dtype", dtype), ("precision", precision)):
        if given not in DTYPES:
            raise InputError(f"{name} is '{given}'; it is float64 or float32")
    if outputs is None:
        if kind == "host":
            raise InputError("a function of kind 'host' needs its outputs listed")
        from .local import infer_outputs

        outputs = infer_outputs(function, grid, kind, precision)
    _refuse_names(grid, outputs)
    blocks = Blocks.of(grid.shape, chunk)
    task = Task(
        function, grid, blocks, tuple(outputs), kind, cost, batch, dtype, precision, separate
    )
    path = Path(out)
    description = _described(task) if description is None else _with_layout(description, task)
    opened = open_store(path, task, description, toml, any_versions=other_versions)
    tell = tell or (lambda text: None)
    with _cluster(scheduler) as client, opened as store:
        source = _local if client is None else _on(client, scheduler or "", tell)
        _go_on(store, source, progress, tell)
    return load(path)


def _cluster(scheduler: str | None) -> contextlib.AbstractContextManager[Any]:
    """A client of the scheduler, or None where there is none; before anything is written."""
    if scheduler is None:
        return contextlib.nullcontext()
    from .cluster import connected

    return connected(scheduler)


def _on(client: Any, scheduler: str, tell) -> Callable[[Task, Sequence[int]], Iterator]:
    from .cluster import distributed

    return lambda task, todo: distributed(client, task, todo, scheduler, tell)


def load(path: str | Path) -> Any:
    """A store as an xarray Dataset, read as it is used. Members not yet computed are nan or -1."""
    from .store import attributes, require_packages

    require_packages()
    attributes(Path(path))
    import xarray

    return xarray.open_zarr(str(path), chunks=None, mask_and_scale=False, consolidated=True)


def _refuse_names(grid: Grid, outputs: Sequence[Output]) -> None:
    names = [*grid.names, *(output.name for output in outputs)]
    for name in (*names, *grid.dims):
        if name in (OUTCOME, DONE, "block"):
            raise InputError(f"'{name}' is a name that every store has; choose another")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"'{twice[0]}' is both a parameter and an output; rename one")


def _source(task: Task) -> dict[str, Any]:
    """What the function does; that of a function of the package is told by `versions`."""
    if belongs_to_package(task.function):
        return {}
    return {"source of the function": fingerprint(task.function)}


def _described(task: Task) -> dict[str, Any]:
    name = getattr(task.function, "__qualname__", type(task.function).__qualname__)
    axes = {a.name: [float(x) for x in a.values] for a in task.grid.axes}
    samples = task.grid.samples
    found = {"function": name, "axes": axes, "outputs": [o.name for o in task.outputs]}
    found |= _source(task)
    found |= {"block": list(task.blocks.block), "dtype": task.dtype, "precision": task.precision}
    return found | ({} if samples is None else {"samples": repr(samples)})


def _with_layout(description: Mapping[str, Any], task: Task) -> dict[str, Any]:
    """What follows from a description by defaults, which another version may have changed."""
    outputs = [output.name for output in task.outputs]
    return {
        **description,
        **_source(task),
        "layout": {"block": list(task.blocks.block), "outputs": outputs},
    }


def _go_on(store: Store, source: Callable[[Task, Sequence[int]], Iterator], progress, tell) -> None:
    """Compute and write what is missing."""
    task = store.task
    sound = store.sound()
    todo = [int(i) for i in np.flatnonzero(~sound)]
    if sound.any():
        tell(f"{int(sound.sum())} of {len(sound)} chunks are written and sound")
        changed = changed_versions(store.path)
        if changed:
            tell(f"warning: begun with other versions: {', '.join(changed)}")
    if not todo:
        return
    clock = _Clock(task, len(sound), int(sound.sum()), progress)
    try:
        with contextlib.closing(source(task, todo)) as found:  # pyright: ignore[reportArgumentType]
            _write_all(store, found, clock)
    except Stopped as stopped:
        raise Stopped(f"{stopped}; {clock.text()}") from None
    except OSError as error:
        if not error.strerror:
            raise
        raise Stopped(f"cannot write {store.path}: {error.strerror}; {clock.text()}") from None


def _local(task: Task, todo: Sequence[int]) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    from .local import compute

    for number in todo:
        yield number, compute(task, number)


def _write_all(store: Store, found: Iterable, clock: "_Clock") -> None:
    """Write blocks as they come, one behind the computation."""
    pending: Future | None = None
    with ThreadPoolExecutor(1) as writer:
        for number, values in found:
            if pending is not None:
                pending.result()
            pending = writer.submit(_write, store, number, values, clock)
        if pending is not None:
            pending.result()


def _write(store: Store, number: int, values, clock: "_Clock") -> None:
    store.write(number, values)
    clock.count(values[OUTCOME].size)


class _Clock:
    def __init__(self, task: Task, blocks: int, written: int, progress):
        self.total, self.written, self.progress = blocks, written, progress
        self.size = task.grid.size
        self.members = 0
        self.compiled: tuple[float, int, int] | None = None

    def count(self, members: int) -> None:
        self.written += 1
        self.members += members
        if self.progress is not None:
            now = time.monotonic()
            if self.compiled is None:
                self.compiled = now, self.written, self.members
            since, written, members = self.compiled
            todo = self.total - self.written
            fresh = self.written - written
            left = (now - since) / fresh * todo if fresh else (0.0 if todo == 0 else math.nan)
            rate = (self.members - members) / (now - since) if fresh else math.nan
            self.progress(Progress(self.total, self.written, self.members, rate, left))

    def text(self) -> str:
        return (
            f"{self.written} of {self.total} chunks are written, and the same command goes on"
            " from there"
        )
