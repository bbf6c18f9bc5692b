"""Results on disk: a Zarr store that xarray opens, written block by block, each exactly once.

Every block of the grid is one Zarr chunk of every variable, a file. When all files of a block are
there, a checksum of their bytes is written to the variable `done`, last and at once. What has no
checksum, or another one than its bytes, was cut off or damaged: it is computed again. So a study
may be killed at any moment. A store belongs to one study: its description is in the attributes,
and a run of another is refused.
"""

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from .function import OUTCOME, OUTCOMES, Output, Task
from .grid import SAMPLE, Grid
from .source import other_versions, revision, versions

SCHEMA = "jaxfric.study/1"
DONE = "done"
_LOCK = ".lock"
_MISSING = 'a study needs zarr, xarray and dask; install them: pip install "jaxfric[study]"'


def require_packages() -> None:
    """Raise `InputError` where the optional packages of studies are not installed."""
    try:
        import xarray  # noqa: F401
        import zarr  # noqa: F401
    except ImportError:
        raise InputError(_MISSING) from None


class Store:
    """An open store of one study. Make one with `open_store`."""

    def __init__(self, path: Path, task: Task):
        import zarr

        self.path, self.task = path, task
        self._group = zarr.open_group(str(path), mode="r+")
        self._columns = _sampled(task.grid)
        self._outputs = [*(output.name for output in task.outputs), OUTCOME]
        # a chunk of nothing but nan is a chunk too: its file must be there
        with zarr.config.set({"array.write_empty_chunks": True}):
            self._arrays: dict[str, Any] = {
                name: self._group[name] for name in (*self._columns, *self._outputs)
            }

    def write(self, number: int, found: Mapping[str, np.ndarray]) -> None:
        """All variables of a block, and then that it is done."""
        where = self.task.blocks.where(number)
        for name in self._outputs:
            self._arrays[name][where] = found[name]
        if self._columns and self._carries_columns(number):
            assert self.task.grid.samples is not None
            drawn = self.task.grid.samples.draw(where[0].start, where[0].stop)
            for name in self._columns:
                self._arrays[name][where[0]] = drawn[name]
        self._mark(number, self._checksum(number))

    def sound(self) -> np.ndarray:
        """Which blocks are written and bear their checksum; marks of others are taken away."""
        found = np.zeros(len(self.task.blocks), bool)
        for number in range(len(found)):
            mark = self._marked(number)
            if mark and mark == self._checksum(number):
                found[number] = True
            elif mark is not None:
                self._mark_path(number).unlink(missing_ok=True)
        return found

    def sweep(self) -> None:
        """Take away what a killed run was in the middle of writing."""
        for partial in self.path.rglob("*.partial"):
            partial.unlink(missing_ok=True)

    def _carries_columns(self, number: int) -> bool:
        return not any(self.task.blocks.index(number)[1:])

    def _files(self, number: int) -> list[Path]:
        index = self.task.blocks.index(number)
        names = list(self._outputs)
        files = [self._chunk(name, index, self._arrays[name].ndim) for name in names]
        if self._columns and self._carries_columns(number):
            files += [self._chunk(name, index[:1], 1) for name in self._columns]
        return files

    def _chunk(self, name: str, index: Sequence[int], ndim: int) -> Path:
        place = (*index, *([0] * (ndim - len(index))))
        return self.path.joinpath(name, "c", *(str(i) for i in place))

    def _checksum(self, number: int) -> bytes | None:
        """Eight bytes, never zero, of all files of a block; None where one is missing."""
        digest = hashlib.blake2b(digest_size=8)
        for file in self._files(number):
            try:
                content = file.read_bytes()
            except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
                return None
            digest.update(len(content).to_bytes(8, "little") + content)
        found = digest.digest()
        return found if any(found) else b"\1" + found[1:]

    def _mark_path(self, number: int) -> Path:
        return self.path / DONE / "c" / str(number)

    def _marked(self, number: int) -> bytes | None:
        try:
            return self._mark_path(number).read_bytes()
        except FileNotFoundError:
            return None

    def _mark(self, number: int, checksum: bytes | None) -> None:
        """The chunk of `done` that holds one number: its bytes as Zarr writes them."""
        if checksum is None:
            raise OSError(5, "a file that was just written is gone", str(self.path))
        path = self._mark_path(number)
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f"{number}.partial")
        partial.write_bytes(checksum)
        os.replace(partial, path)


def _sampled(grid: Grid) -> list[str]:
    return [] if grid.samples is None else [name for name, _, _ in grid.samples.described()]


@contextlib.contextmanager
def open_store(
    path: Path,
    task: Task,
    description: Mapping[str, Any],
    toml: str = "",
    *,
    any_versions: bool = False,
) -> Iterator[Store]:
    """The store of a study, made where there is none; no other run can write it meanwhile.

    `description` is what makes the study: a table of plain values, compared key by key.

    Raises
    ------
    InputError : the folder is no store, or that of another study, was begun with other versions
        (unless `any_versions`), or is being written.
    """
    require_packages()
    if not path.exists():
        _create(path, task, description, toml)
    else:
        refuse_other(path, description)
        if not any_versions:
            refuse_other_versions(path)
    with _locked(path):
        store = Store(path, task)
        store.sweep()
        yield store


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """One writer at a time; the lock goes with the process, however that ends."""
    try:
        import fcntl
    except ImportError:  # no such locks here
        yield
        return
    with open(path / _LOCK, "a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"{path} is being written by another run; wait for it, or give another with --out"
            ) from None
        yield


def attributes(path: Path) -> dict[str, Any]:
    """The attributes of a store.

    Raises
    ------
    InputError : no such folder, or not a store of a study.
    """
    try:
        content = json.loads((path / "zarr.json").read_text(encoding="utf-8"))
        found = content["attributes"]
        known = found["schema"] == SCHEMA
    except FileNotFoundError:
        if not path.exists():
            raise InputError(
                f"{path}: no such store; make one with: jaxfric study study.toml --out {path}"
            ) from None
        known, found = False, {}
    except (OSError, ValueError, KeyError, TypeError):
        known, found = False, {}
    if not known:
        raise InputError(
            f"{path} is not the store of a study ({'a file' if path.is_file() else 'its zarr.json'}"
            f"{'' if path.is_file() else ' is missing or says otherwise'}); name that of a study"
        )
    return found


def refuse_other(path: Path, description: Mapping[str, Any]) -> None:
    """Raise `InputError` where the store at `path` belongs to another study, with what differs."""
    kept = json.loads(attributes(path)["study"])
    differing = sorted(_differences(kept, json.loads(json.dumps(description)), ""))
    if differing:
        differing = [key for key in differing if not key.startswith("layout.")] or differing
        shown = ", ".join(differing[:6]) + (" and others" if len(differing) > 6 else "")
        raise InputError(
            f"{path} belongs to another study, which differs in {shown}; give another with --out,"
            " or delete it"
        )


def _differences(a: Any, b: Any, name: str) -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in {*a, *b}:
            below = f"{name}.{key}" if name else key
            if key not in a or key not in b:
                yield below
            else:
                yield from _differences(a[key], b[key], below)
    elif a != b:
        yield name


def refuse_other_versions(path: Path) -> None:
    """Raise `InputError` where other code or other packages began the store at `path`."""
    changed = changed_versions(path)
    if changed:
        raise InputError(
            f"{path} was begun with other versions: {', '.join(changed)}; one study would hold the"
            " numbers of both: give another with --out, or go on all the same with"
            " --other-versions (in Python other_versions=True)"
        )


def changed_versions(path: Path) -> list[str]:
    """What is not as it was when the store was begun."""
    return other_versions(attributes(path).get("versions", {}), versions())


def _create(path: Path, task: Task, description: Mapping[str, Any], toml: str) -> None:
    """Everything but the blocks: made beside the destination and moved there whole."""
    import zarr

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot write {path}: {reason}; give another with --out") from None
    try:
        group = zarr.create_group(
            str(work / "store"), attributes=_attributes(task, description, toml)
        )
        _variables(group, task)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that not every reader knows them: xarray does
            zarr.consolidate_metadata(str(work / "store"))
        os.replace(work / "store", path)
    except OSError as error:
        if not error.strerror:
            raise
        raise InputError(
            f"cannot write {path}: {error.strerror}; give another with --out"
        ) from None
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _attributes(task: Task, description: Mapping[str, Any], toml: str) -> dict[str, Any]:
    sampled = _sampled(task.grid)
    found = {
        "schema": SCHEMA,
        "study": json.dumps(description),
        "toml": toml,
        "versions": versions(),
        "revision": revision(),
        "members": task.grid.size,
        "block": list(task.blocks.block),
    }
    return found | ({"coordinates": " ".join(sampled)} if sampled else {})


def _variables(group: Any, task: Task) -> None:
    grid, blocks = task.grid, task.blocks
    dims = list(grid.dims)
    for axis in grid.axes:
        _coordinate(group, axis.name, axis.values, axis.unit, axis.long_name, log=axis.log)
    if grid.samples is not None:
        for name, unit, text in grid.samples.described():
            attributes = {"units": unit, "long_name": text or name}
            _array(group, name, grid.shape[:1], blocks.block[:1], "float64", [SAMPLE], attributes)
    done = set()
    for output in (*task.outputs, Output(OUTCOME, codes=OUTCOMES, long_name="outcome")):
        more = [len(dim.values) for dim in output.dims]
        for dim in output.dims:
            if dim.name not in done:
                _coordinate(group, dim.name, dim.values, dim.unit, dim.long_name)
            done.add(dim.name)
        names = [*dims, *(dim.name for dim in output.dims)]
        shape, chunks = (*grid.shape, *more), (*blocks.block, *more)
        dtype = task.dtype if output.dtype == "float" else output.dtype
        _array(group, output.name, shape, chunks, dtype, names, _described(output))
    attributes = {"long_name": "checksum of each finished block; 0: not finished"}
    count = len(blocks)
    _array(group, DONE, (count,), (1,), "uint64", ["block"], attributes, plain=True)


def _described(output: Output) -> dict[str, Any]:
    found: dict[str, Any] = {"long_name": output.long_name or output.name}
    if output.codes is None:
        return found | {"units": output.unit}
    return found | {
        "flag_values": list(range(len(output.codes))),
        "flag_meanings": " ".join(output.codes),
        "flag_texts": list(output.codes.values()),
    }


def _coordinate(group, name, values, unit, text, *, log: bool = False) -> None:
    attributes = {"units": unit, "long_name": text or name}
    if log:
        attributes["spacing"] = "log"
    shape = (len(values),)
    array = _array(group, name, shape, shape, "float64", [name], attributes)
    array[:] = values


def _array(group, name, shape, chunks, dtype, dims, attributes, *, plain: bool = False) -> Any:
    from zarr.codecs import BloscCodec

    number = np.dtype(dtype).kind == "f"
    fill = 0 if plain else (float("nan") if number else -1)
    return group.create_array(
        name,
        shape=tuple(shape),
        chunks=tuple(chunks),
        dtype=dtype,
        fill_value=fill,
        compressors=None if plain else BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"),
        dimension_names=list(dims),
        attributes=attributes,
    )
