"""The entry point `run(function, grid, out)`."""

import contextlib
import math
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..findings import WarningCode, warned
from ..silent import silent
from .function import (
    OUTCOME,
    OUTCOMES,
    Computed,
    Cost,
    Function,
    Kind,
    Output,
    Stopped,
    Task,
    refuse_clashes,
    refuse_dtypes,
)
from .grid import Grid, Tiling
from .layout import Label, outputs_of
from .place import Tell, place_of
from .progress import Clock, Progress
from .source import belongs_to_package, own_code
from .store import Store, attributes, changed_versions, error_texts, open_store, require_packages
from .store import verify as verify_store

if TYPE_CHECKING:
    import xarray

CHUNK = 65536
_OUTCOMES = list(OUTCOMES)
# A new study stops if all of its first members fail.
_FIRST = 8
# Studies of more than this need a confirmation before they start.
_MEMBERS, _BYTES = 100_000_000, 1e11


Source = Callable[[Task, Sequence[int]], Generator[tuple[int, Computed], None, None]]
"""Computes the requested blocks in any order, and yields each with its number."""


def run(
    function: Function,
    grid: Grid,
    out: str | Path,
    *,
    outputs: Sequence[Output] | None = None,
    kind: Kind = "member",
    cost: Cost | None = None,
    chunk: int = CHUNK,
    batch: int = 512,
    dtype: str = "float64",
    precision: str | None = None,
    separate: bool = True,
    scheduler: str | None = None,
    processes: int = 1,
    ask: Callable[[str], None] | None = None,
    description: Mapping[str, object] | None = None,
    other_versions: bool = False,
    toml: str = "",
    warnings: Sequence[str] = (),
    progress: Callable[[Progress], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> "xarray.Dataset":
    """Evaluate a pure function over a grid into a Zarr store; return it as an xarray Dataset.

    The same call continues an unfinished store. The call verifies existing blocks by checksums, and
    does not compute valid blocks again.

    Parameters
    ----------
    function, kind, cost, batch, dtype, precision, separate : the function and settings of its
        computation, see `Task`. By default `precision` equals `dtype`.
    outputs : units, meanings and further dimensions; by default inferred from the function. Kind
        "host" requires them.
    chunk : number of members in a block, which is computed, held in memory and written at once.
    scheduler, processes : address of a Dask scheduler whose workers compute; or number of processes
        on this machine for kind "host" (other kinds use all cores anyway).
    ask : called with the size of a very large study before the study starts; may raise an error to
        stop the study.
    other_versions : continue a store that was begun with other versions of packages.
    description, toml, warnings : description of the study in the store, see `Label`; by default its
        grid, outputs and function. The code of the function, and of yours that it uses, is always
        compared.
    progress, tell : callbacks for progress and for other messages.

    Raises
    ------
    InputError : a bad argument; `out` is not a store, or belongs to another study.
    Stopped : the disk is full or the scheduler is lost; the same call continues.
    """
    precision = precision or dtype
    refuse_dtypes(dtype, precision)
    if outputs is None:
        if kind == "host":
            raise InputError("a function of kind 'host' needs its outputs listed")
        from .local import infer_outputs

        outputs = infer_outputs(function, grid, kind, precision)
    refuse_clashes(grid, outputs)
    how = (kind, cost, batch, dtype, precision, separate)
    task = Task(function, grid, Tiling.of(grid.shape, chunk), tuple(outputs), *how)
    label = Label(_described(task, description), toml, tuple(warnings))
    place, workers, tell = place_of(out), scheduler or processes, tell or silent
    opened = open_store(place, task, label, any_versions=other_versions, tell=tell)
    if ask is not None and not place.exists() and (size := _large(task)):
        ask(size)
    if isinstance(workers, int) and (task.kind != "host" or len(task.blocks) < 2):
        workers = 1
    if isinstance(workers, int) and workers > 1:
        tell(f"starting {workers} processes")
    with _source(workers, tell) as source, opened as store:
        _go_on(store, source, progress, tell)
    return load(out, verify=False)


def _large(task: Task) -> str:
    """Return the size of a study that the user must confirm, in words; '' for another."""
    each = 0.0
    for output in outputs_of(task):
        numbers = math.prod(len(dim.values) for dim in output.dims)
        each += numbers * np.dtype(task.dtype if output.dtype == "float" else output.dtype).itemsize
    members, size = task.grid.size, each * task.grid.size
    if members <= _MEMBERS and size <= _BYTES:
        return ""
    return f"{members:.3g} members in {len(task.blocks)} chunks: up to {size / 1e12:.3g} TB"


@contextlib.contextmanager
def _source(workers: str | int, tell: Tell) -> Generator[Source]:
    """Yield what computes blocks: this process, processes of this machine, or the workers of a
    scheduler; connect to these before anything is written."""
    if isinstance(workers, int) and workers < 2:
        yield _local
        return
    from .cluster import connected, distributed, local_processes

    here = isinstance(workers, int)
    with local_processes(workers) if here else connected(workers) as client:
        where = "this machine" if here else workers
        yield lambda task, todo: distributed(client, task, todo, where, tell)


def load(path: str | Path, *, verify: bool = True) -> "xarray.Dataset":
    """Open a store as a lazy xarray Dataset. Members without a result are nan or -1.

    `path` is a folder or a URL. The attribute "errors" lists the errors of failed members, each
    error with its count. With `verify` the function first compares every file with its checksum.
    Without `verify` a deleted chunk looks as if it was not computed, and a damaged chunk raises an
    error when it is read.

    Raises
    ------
    InputError : no store, or a damaged one.
    """
    require_packages()
    place = place_of(path)
    attributes(place)
    if verify:
        verify_store(place)
    import xarray

    with place.faults():
        found = xarray.open_zarr(place.zarr(), chunks=None, mask_and_scale=False, consolidated=True)
    return found.assign_attrs(errors=error_texts(place))


def _described(task: Task, description: Mapping[str, object] | None) -> dict[str, object]:
    """Return what identifies a study: its description, the user's code, and its layout."""
    function = task.function
    if description is None:
        samples = task.grid.samples
        description = {
            "function": getattr(function, "__qualname__", type(function).__qualname__),
            "axes": {a.name: [float(x) for x in a.values] for a in task.grid.axes},
            "samples": None if samples is None else repr(samples),
            "dtype": task.dtype,
            "precision": task.precision,
        }
    outputs = [output.name for output in task.outputs]
    layout = {"block": list(task.blocks.block), "outputs": outputs}
    return {**description, **own_code(function), "layout": layout}


def _go_on(
    store: Store, source: Source, progress: Callable[[Progress], None] | None, tell: Tell
) -> None:
    """Compute and write the missing blocks."""
    task = store.task
    sound = store.sound()
    begun = bool(sound.any())
    if begun:
        tell(f"{int(sound.sum())} of {len(sound)} chunks are written and sound")
        changed = changed_versions(store.place)
        if changed:
            tell(warned(WarningCode.VERSIONS, versions=changed))
    retried = [number for number in store.with_errors() if sound[number]]
    if retried:
        tell(f"{len(retried)} of them have members that failed, and are computed again")
        sound[retried] = False
    todo = [int(i) for i in np.flatnonzero(~sound)]
    if not todo:
        return
    clock = Clock(len(sound), int(sound.sum()), progress)
    try:
        with contextlib.closing(source(task, todo)) as found:
            _write_all(store, found if begun else _refuse_failures(found, task), clock)
    except Failed:
        store.place.discard()
        raise
    except Stopped as stopped:
        raise Stopped(f"{stopped}; {clock.text()}") from None
    except OSError as error:
        if not error.strerror:
            raise
        raise Stopped(
            f"cannot write {store.place.shown}: {error.strerror}; {clock.text()}"
        ) from None


class Failed(InputError):
    """Raised if the first computed members all fail; no store is then kept."""


def _refuse_failures(
    found: Iterable[tuple[int, Computed]], task: Task
) -> Iterator[tuple[int, Computed]]:
    """Yield the blocks, or raise `Failed` if all of the first members failed.

    The first members are those of the first blocks of the grid. Of several processes another block
    may come first; its failures are those of a region of the grid.
    """
    failed, error, text = 0, _OUTCOMES.index("error"), ""
    first = set(range(min(math.ceil(_FIRST / task.blocks.largest), len(task.blocks))))
    blocks = iter(found)
    for number, block in blocks:
        here = block.values[OUTCOME]
        if not np.all(here == error):
            yield number, block
            break
        if number in first:
            first.remove(number)
            failed += here.size
            text = text or _first_error(task, number, block.errors)
        if not first:
            advice = "Correct the function, or let it return nan where a member has no number"
            if belongs_to_package(task.function):
                advice = "Correct the study: its fixed and its varied parameters"
            raise Failed(
                f"the first {failed} members all failed, with {text}; nothing is kept. {advice}"
            )
        yield number, block
    yield from blocks


def _first_error(task: Task, number: int, errors: Mapping[int, str]) -> str:
    """Return the first error of a block and its member [SI]: "InputError: ... at V0 = 1e-06"."""
    place = min(errors)
    members = task.grid.members(task.blocks.where(number))
    where = ", ".join(f"{name} = {column[place]:.6g}" for name, column in members.items())
    return f"{errors[place]} at {where}"


def _local(task: Task, todo: Sequence[int]) -> Generator[tuple[int, Computed], None, None]:
    from .local import compute

    for number in todo:
        yield number, compute(task, number)


def _write_all(store: Store, found: Iterable[tuple[int, Computed]], clock: Clock) -> None:
    """Write blocks as they arrive, one behind the computation."""

    def write(number: int, block: Computed) -> None:
        store.write(number, block)
        clock.count(block.values[OUTCOME].size)

    pending: Future | None = None
    with ThreadPoolExecutor(1) as writer:
        for number, block in found:
            if pending is not None:
                pending.result()
            pending = writer.submit(write, number, block)
        if pending is not None:
            pending.result()
