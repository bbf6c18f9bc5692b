"""Results on disk as a Zarr store for xarray; each block is written exactly once.

Every block of the grid is one Zarr chunk, a file, of every variable. After all files of a block,
the checksum of these files is written atomically to the variable `done`. A block with a missing or
wrong checksum was interrupted or damaged, and is computed again. So a study may be killed at any
moment. Coordinates and descriptions have checksums too, and readers verify a checksum inside every
chunk. Each store belongs to one study. The attributes of the store describe the study, and the
store refuses other studies.
"""

import contextlib
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, option
from ..schemas import STUDY
from ..silent import silent
from .function import ERRORS, Computed, Task
from .layout import Label, make_store, outputs_of, sampled
from .marks import DONE, FIXED, Marks, damaged_files, fixed_checksums
from .place import Place, Tell
from .source import other_versions, versions

_ROOT = "zarr.json"
_MISSING = 'a study needs zarr, xarray and dask; install them: pip install "jaxfric[study]"'


def require_packages() -> None:
    """Raise `InputError` if the optional packages of studies are not installed."""
    try:
        import xarray  # noqa: F401
        import zarr  # noqa: F401
    except ImportError:
        raise InputError(_MISSING) from None


class Store:
    """An open store of one study, made by `open_store`."""

    def __init__(self, place: Place, task: Task):
        import zarr

        self.place, self.task = place, task
        self.marks = Marks.of(place, attributes(place))
        group: Any = zarr.open_group(place.zarr(), mode="r+")
        self._outputs = [output.name for output in outputs_of(task)]
        # a chunk of nan alone must also have a file
        with zarr.config.set({"array.write_empty_chunks": True}):
            self._arrays: dict[str, Any] = {
                name: group[name] for name in (*sampled(task), *self._outputs)
            }

    def write(self, number: int, block: Computed) -> None:
        """Write all variables of a block, then its errors, and last the mark of the whole block."""
        where = self.task.blocks.where(number)
        with self.place.faults():
            for name in self._outputs:
                self._arrays[name][where] = block.values[name]
            if self.marks.carries_columns(number):
                assert self.task.grid.samples is not None
                drawn = self.task.grid.samples.draw(where[0].start, where[0].stop)
                for name in sampled(self.task):
                    self._arrays[name][where[0]] = drawn[name]
        file = f"{ERRORS}/{number}"
        if block.errors:
            self.place.write(file, json.dumps(block.errors, indent=1).encode())
        elif self.task.kind == "host":
            self.place.remove(file)
        self.marks.set(number)

    def sound(self) -> np.ndarray:
        """Return a mask of blocks with a valid checksum; remove the marks of damaged blocks."""
        states = self.marks.states()
        for number, state in enumerate(states):
            if state == "damaged":
                self.marks.clear(number)
        return np.asarray([state == "sound" for state in states], bool)

    def with_errors(self) -> list[int]:
        """Return the blocks that contain failed members."""
        return [int(n) for n in self.place.names(ERRORS) if n.isdecimal()]


@contextlib.contextmanager
def open_store(
    place: Place,
    task: Task,
    label: Label,
    *,
    any_versions: bool = False,
    tell: Tell = silent,
) -> Generator[Store]:
    """Yield the store of a study, locked against other runs; if needed, make a new store.

    Raises
    ------
    InputError : the folder is not a store, belongs to another study, was begun with other versions
        (unless `any_versions`), or is locked by another run.
    """
    require_packages()

    def make(folder: str) -> None:
        make_store(folder, task, label)

    if place.exists():
        refuse_other(place, label.description)
        changed = changed_versions(place)
        if changed and not place.names(f"{DONE}/c"):
            with place.lock(tell):  # the store has no block yet: start again
                place.discard()
        elif changed and not any_versions:
            raise InputError(
                f"{place.shown} was begun with other versions: {', '.join(changed)}; the study"
                f" would mix results of both: give another with {option('out')}, or continue"
                f" nevertheless with {option('other-versions')}"
            )
    if not place.exists():
        place.install(make)
    with place.lock(tell):
        place.sweep()
        _mend(place, make, tell)
        yield Store(place, task)


def _mend(place: Place, make: Callable[[str], None], tell: Tell) -> None:
    """Write damaged files again that are written only once; the study determines them."""
    with tempfile.TemporaryDirectory() as work:
        make(f"{work}/store")
        root = Path(work) / "store"
        names = {f.relative_to(root).as_posix(): f for f in root.rglob("*") if f.is_file()}
        files = {name: file.read_bytes() for name, file in names.items() if name != FIXED}
    files[_ROOT] = place.read(_ROOT) or b""  # keep when and by which version it was begun
    files[FIXED] = fixed_checksums(list(files.items()))
    damaged = [name for name, content in files.items() if place.read(name) != content]
    for name in damaged:
        place.write(name, files[name])
    if damaged:
        tell(f"mended: {', '.join(damaged)}")


def attributes(place: Place) -> dict[str, Any]:
    """Return the attributes of a store.

    Raises
    ------
    InputError : no such place, or the place holds no store of a study.
    """
    try:
        content = place.read(_ROOT)
    except OSError as error:
        raise InputError(f"{place.shown}: {error.strerror}") from None
    if content is None and not place.exists():
        raise InputError(
            f"{place.shown}: no such store; make one with: jaxfric study study.toml"
            f" {option('out', place.shown)}"
        )
    try:
        found = json.loads(content or b"")["attributes"]
        schema = found["schema"]
    except (ValueError, KeyError, TypeError):
        schema, found = "", {}
    if str(schema).rpartition("/")[0] == STUDY.rpartition("/")[0] and schema != STUDY:
        raise InputError(
            f"{place.shown} was made by another version of jaxfric ({schema}, here {STUDY}); run"
            " the study again into another"
        )
    if schema != STUDY:
        raise InputError(f"{place.shown} is not the store of a study; name that of one")
    return found


def refuse_other(place: Place, description: Mapping[str, object]) -> None:
    """Raise `InputError` with the differences if a store belongs to another study."""
    kept = json.loads(attributes(place)["study"])
    differing = sorted(_differences(kept, json.loads(json.dumps(description)), ""))
    if differing:
        differing = [key for key in differing if not key.startswith("layout.")] or differing
        shown = ", ".join(differing[:6]) + (" and others" if len(differing) > 6 else "")
        raise InputError(
            f"{place.shown} belongs to another study, which differs in {shown}; give another with"
            f" {option('out')}, or delete it"
        )


def _differences(a: object, b: object, name: str) -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in {*a, *b}:
            below = f"{name}.{key}" if name else key
            if key not in a or key not in b:
                yield below
            else:
                yield from _differences(a[key], b[key], below)
    elif a != b:
        yield name


def changed_versions(place: Place) -> list[str]:
    """Return the versions that have changed since the store was begun."""
    return other_versions(attributes(place).get("versions", {}), versions())


def verify(place: Place) -> None:
    """Raise `InputError` if a file of a store is missing or damaged."""
    again = "run the same command again, which computes the damaged parts"
    damaged = damaged_files(place)
    if damaged:
        raise InputError(f"{place.shown} is damaged: {', '.join(damaged[:4])}; {again}")
    marks = Marks.of(place, attributes(place))
    bad = [number for number, state in enumerate(marks.states()) if state == "damaged"]
    if bad:
        shown = ", ".join(map(str, bad[:6])) + (", ..." if len(bad) > 6 else "")
        raise InputError(
            f"{place.shown} is damaged: {len(bad)} of {len(marks.blocks)} chunks ({shown}) are not"
            f" as they were written; {again}"
        )


def error_texts(place: Place) -> dict[str, int]:
    """Return the errors of failed members with their counts, the most frequent first."""
    found: Counter[str] = Counter()
    for number in place.names(ERRORS):
        found.update(json.loads(place.read(f"{ERRORS}/{number}") or b"{}").values())
    return dict(found.most_common())
