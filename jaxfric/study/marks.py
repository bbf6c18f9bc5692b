"""Checksums of the files of a store, which reveal missing and damaged files.

Every finished block has a mark, the checksum of its files, in the variable `done`. Files that are
written only once, such as coordinates, have their checksums in a separate file.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from .grid import Tiling
from .place import Place

DONE = "done"
FIXED = "checksums.json"
# Requests at once: an object store answers each slowly, but many in parallel.
_AT_ONCE = 16


@dataclass(frozen=True, eq=False)
class Marks:
    """The blocks of a store and their marks."""

    place: Place
    blocks: Tiling
    outputs: dict[str, int]
    """Number of dimensions of every variable of the blocks."""
    columns: tuple[str, ...]
    """Sampled parameters, written with the first blocks along the other dimensions."""

    @staticmethod
    def of(place: Place, attributes: dict[str, Any]) -> "Marks":
        """Return the marks of a store with known attributes."""
        layout = attributes["layout"]
        blocks = Tiling(tuple(layout["shape"]), tuple(layout["block"]))
        return Marks(place, blocks, dict(layout["outputs"]), tuple(layout["columns"]))

    def carries_columns(self, number: int) -> bool:
        """Whether a block contains the sampled parameters, too."""
        return bool(self.columns) and not any(self.blocks.index(number)[1:])

    def set(self, number: int) -> None:
        """Mark a block as written by writing the chunk of `done` in Zarr's format."""
        checksum = self._checksum(number)
        if checksum is None:
            raise OSError(5, "a file that was just written is gone", self.place.shown)
        self.place.write(_mark(number), checksum)

    def states(self) -> list[str]:
        """Return the state of every block: "sound", "damaged", or "missing" (no mark)."""
        numbers = sorted(int(name) for name in self.place.names(f"{DONE}/c") if name.isdecimal())
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            marked = dict(zip(numbers, pool.map(self._state, numbers), strict=True))
        return [marked.get(number, "missing") for number in range(len(self.blocks))]

    def _state(self, number: int) -> str:
        if number >= len(self.blocks):
            return "missing"
        mark = self.place.read(_mark(number))
        return "sound" if mark and mark == self._checksum(number) else "damaged"

    def clear(self, number: int) -> None:
        """Remove a mark."""
        self.place.remove(_mark(number))

    def _files(self, number: int) -> list[str]:
        index = self.blocks.index(number)
        files = [_chunk(name, index, ndim) for name, ndim in self.outputs.items()]
        if self.carries_columns(number):
            files += [_chunk(name, index[:1], 1) for name in self.columns]
        return files

    def _checksum(self, number: int) -> bytes | None:
        """Return eight bytes, never zero, of all files of a block; None if a file is missing."""
        digest = hashlib.blake2b(digest_size=8)
        for file in self._files(number):
            content = self.place.read(file)
            if content is None:
                return None
            digest.update(len(content).to_bytes(8, "little") + content)
        found = digest.digest()
        return found if any(found) else b"\1" + found[1:]


def _mark(number: int) -> str:
    return f"{DONE}/c/{number}"


def _chunk(name: str, index: Sequence[int], ndim: int) -> str:
    place = (*index, *([0] * (ndim - len(index))))
    return "/".join((name, "c", *map(str, place)))


def fixed_checksums(files: Iterable[tuple[str, bytes]]) -> bytes:
    """Return the content of the checksum file `FIXED`, given files and their contents."""
    sums = {name: _sum(content) for name, content in files}
    return json.dumps({"files": sums}, sort_keys=True, indent=1).encode()


def damaged_files(place: Place) -> list[str]:
    """Return damaged files of those written only once; return `FIXED` if that file is damaged."""
    try:
        files = json.loads(place.read(FIXED) or b"")["files"].items()
    except (ValueError, KeyError, TypeError, AttributeError):
        return [FIXED]
    contents = ((name, known, place.read(name)) for name, known in files)
    return [name for name, known, now in contents if now is None or _sum(now) != known]


def _sum(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=16).hexdigest()
