"""One entry point: `run(function, grid, out)`."""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..errors import InputError
from .function import ERRORS, OUTCOME, OUTCOMES, Output, Stopped, Task, refuse_clashes
from .grid import Blocks, Grid
from .place import place_of
from .progress import Clock, Progress
from .size import is_large, told_size
from .source import belongs_to_package, fingerprint
from .store import Store, attributes, changed_versions, error_texts, open_store, require_packages
from .store import verify as verify_store

CHUNK = 65536
_OUTCOMES = list(OUTCOMES)
# A new study stops where so many members are computed and every one has failed.
_FIRST = 8
DTYPES = ("float64", "float32")


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
    processes: int = 1,
    ask: Callable[[str], None] | None = None,
    description: Mapping[str, Any] | None = None,
    other_versions: bool = False,
    toml: str = "",
    warnings: Sequence[str] = (),
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
    processes : of this machine, that compute members of kind "host"; others use all cores anyway.
    ask : told size and time of a very large study before it begins; may raise to stop it.
    description : plain values that tell this study from another; a store that has others is
        refused. By default the grid, the outputs, and the name of the function; what the function
        does, and all of one's own code that it uses, is compared in any case.
    other_versions : go on with a store that was begun with other versions of packages.
    toml : a text that is kept in the store's attributes.
    warnings : what must be known of its results, a line each; kept in the attribute "warnings" of
        a new store, which is not there where there are none.

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
    refuse_clashes(grid, outputs)
    blocks = Blocks.of(grid.shape, chunk)
    task = Task(
        function, grid, blocks, tuple(outputs), kind, cost, batch, dtype, precision, separate
    )
    place = place_of(out)
    description = _described(task) if description is None else _with_layout(description, task)
    tell = tell or (lambda text: None)
    opened = open_store(
        place, task, description, toml, warnings, any_versions=other_versions, tell=tell
    )
    if ask is not None and is_large(task) and not place.exists():
        tell(f"measuring how long {task.grid.size:.3g} members take")
        ask(told_size(task))
    several = processes if kind == "host" and len(blocks) > 1 else 1
    if scheduler is None and several > 1:
        tell(f"starting {several} processes")
    with _cluster(scheduler, several) as client, opened as store:
        where = scheduler or "this machine"
        source = _local if client is None else _on(client, where, tell)
        _go_on(store, source, progress, tell)
    return load(out, verify=False)


def _cluster(scheduler: str | None, processes: int) -> contextlib.AbstractContextManager[Any]:
    """A client of the scheduler, or None where there is none; before anything is written."""
    if scheduler is None and processes < 2:
        return contextlib.nullcontext()
    from .cluster import connected, local_processes

    return local_processes(processes) if scheduler is None else connected(scheduler)


def _on(client: Any, scheduler: str, tell) -> Callable[[Task, Sequence[int]], Iterator]:
    from .cluster import distributed

    return lambda task, todo: distributed(client, task, todo, scheduler, tell)


def load(path: str | Path, *, verify: bool = True) -> Any:
    """A store as an xarray Dataset, read as it is used. Members not yet computed are nan or -1.

    `path` is a folder or a URL. What members failed with is in the attribute "errors", each text
    with how many have it. `verify` compares every file with its checksum before: without it a
    chunk that was deleted reads as one not computed yet (one with wrong bytes is noticed
    when it is read).

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
    begun = bool(sound.any())
    if begun:
        tell(f"{int(sound.sum())} of {len(sound)} chunks are written and sound")
        changed = changed_versions(store.place)
        if changed:
            tell(f"warning: begun with other versions: {', '.join(changed)}")
    retried = [number for number in store.with_errors() if sound[number]]
    if retried:
        tell(f"{len(retried)} of them have members that failed, and are computed again")
        sound[retried] = False
    todo = [int(i) for i in np.flatnonzero(~sound)]
    if not todo:
        return
    clock = Clock(task, len(sound), int(sound.sum()), progress)
    try:
        with contextlib.closing(source(task, todo)) as found:  # pyright: ignore[reportArgumentType]
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
    """No member of the first ones could be computed; nothing is kept."""


def _refuse_failures(found: Iterable, task: Task) -> Iterator:
    """The same blocks, unless the first members are nothing but errors."""
    failed, error, text = 0, _OUTCOMES.index("error"), ""
    blocks = iter(found)
    for number, values in blocks:
        here = values[OUTCOME]
        if not np.all(here == error):
            yield number, values
            break
        failed += here.size
        text = text or _first_error(task, number, values[ERRORS])
        if failed >= min(_FIRST, task.grid.size):
            advice = "Mend the function, or let it return nan where a member has no number"
            if belongs_to_package(task.function):
                advice = "Mend the study: what it sets and what it varies"
            raise Failed(
                f"the first {failed} members all failed, with {text}; nothing is kept. {advice}"
            )
        yield number, values
    yield from blocks


def _first_error(task: Task, number: int, errors: Mapping[int, str]) -> str:
    """The first error of a block and its member: "InputError: ... at V0 = 1e-06 m/s"."""
    place = min(errors)
    units = {axis.name: axis.unit for axis in task.grid.axes}
    if task.grid.samples is not None:
        units |= {name: unit for name, unit, _ in task.grid.samples.described()}
    members = task.grid.members(task.blocks.where(number))
    where = [
        f"{name} = {column[place]:.6g} {units.get(name, '1')}".removesuffix(" 1")
        for name, column in members.items()
    ]
    return f"{errors[place]} at {', '.join(where)}"


def _local(task: Task, todo: Sequence[int]) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    from .local import compute

    for number in todo:
        yield number, compute(task, number)


def _write_all(store: Store, found: Iterable, clock: Clock) -> None:
    """Write blocks as they come, one behind the computation."""
    pending: Future | None = None
    with ThreadPoolExecutor(1) as writer:
        for number, values in found:
            if pending is not None:
                pending.result()
            pending = writer.submit(_write, store, number, values, clock)
        if pending is not None:
            pending.result()


def _write(store: Store, number: int, values, clock: Clock) -> None:
    store.write(number, values)
    clock.count(values[OUTCOME].size)
