"""Write the layout of a new store: variables, units, meanings and attributes, but no results."""

import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..schemas import STUDY
from .function import OUTCOME, OUTCOMES, Output, Task
from .grid import SAMPLE
from .marks import DONE, FIXED, fixed_checksums
from .source import versions

if TYPE_CHECKING:
    import zarr
    from zarr.core.common import JSON


class Label(NamedTuple):
    """Attributes of a store that describe its study."""

    description: Mapping[str, object]
    """Plain values that identify the study; a store with other values is refused."""
    toml: str = ""
    """The text of study.toml for the store's attributes."""
    warnings: tuple[str, ...] = ()
    """Warnings about the results, one line each, for the attribute "warnings" of a new store.
    Without warnings there is no such attribute."""


def make_store(folder: str, task: Task, label: Label) -> None:
    """Write a store that contains no results into a new folder."""
    import zarr

    attributes = _attributes(task, label)
    attributes |= {"warnings": list(label.warnings)} if label.warnings else {}
    group = zarr.create_group(folder, attributes=attributes)
    _variables(group, task)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # zarr warns that some readers lack this; xarray has it
        zarr.consolidate_metadata(folder)
    root = Path(folder)
    files = sorted(file for file in root.rglob("*") if file.is_file())
    named = ((file.relative_to(root).as_posix(), file.read_bytes()) for file in files)
    (root / FIXED).write_bytes(fixed_checksums(named))


def sampled(task: Task) -> list[str]:
    """Return the names of the sampled parameters."""
    samples = task.grid.samples
    return [] if samples is None else [name for name, _, _ in samples.described()]


def outputs_of(task: Task) -> tuple[Output, ...]:
    """Return all variables of a block."""
    return (*task.outputs, Output(OUTCOME, codes=OUTCOMES, long_name="outcome"))


def _attributes(task: Task, label: Label) -> "dict[str, JSON]":
    columns, dims = sampled(task), len(task.grid.shape)
    found: dict[str, JSON] = {
        "schema": STUDY,
        "study": json.dumps(label.description),
        "toml": label.toml,
        "versions": versions(),
        "members": task.grid.size,
        "layout": {
            "shape": list(task.blocks.shape),
            "block": list(task.blocks.block),
            "outputs": {o.name: dims + len(o.dims) for o in outputs_of(task)},
            "columns": columns,
        },
    }
    return found | ({"coordinates": " ".join(columns)} if columns else {})


def _variables(group: "zarr.Group", task: Task) -> None:
    grid, blocks = task.grid, task.blocks
    dims = {d: (n, b) for d, n, b in zip(grid.dims, grid.shape, blocks.block, strict=True)}
    axes = {axis.name: axis for axis in grid.axes}
    for output in outputs_of(task):
        for dim in output.dims:
            axes.setdefault(dim.name, dim)
        dtype = task.dtype if output.dtype == "float" else output.dtype
        more = {dim.name: (len(dim.values), len(dim.values)) for dim in output.dims}
        _add(group, output.name, dtype, dims | more, _described(output))
    for axis in axes.values():
        length, about = len(axis.values), _labels(axis.name, axis.unit, axis.long_name)
        about |= {"spacing": "log"} if axis.log else {}
        array = _add(group, axis.name, "float64", {axis.name: (length, length)}, about)
        array[:] = axis.values
    for label in [] if grid.samples is None else grid.samples.described():
        _add(group, label[0], "float64", {SAMPLE: dims[SAMPLE]}, _labels(*label))
    about: dict[str, JSON] = {"long_name": "checksum of each finished block; 0: not finished"}
    _add(group, DONE, "uint64", {"block": (len(blocks), 1)}, about, plain=True)


def _labels(name: str, unit: str, text: str) -> "dict[str, JSON]":
    return {"units": unit, "long_name": text or name}


def _described(output: Output) -> "dict[str, JSON]":
    found = _labels(output.name, output.unit, output.long_name)
    if output.codes is None:
        return found
    return {
        "long_name": found["long_name"],
        "flag_values": list(range(len(output.codes))),
        "flag_meanings": " ".join(output.codes),
        "flag_texts": list(output.codes.values()),
    }


def _add(
    group: "zarr.Group",
    name: str,
    dtype: str,
    dims: dict[str, tuple[int, int]],
    attributes: "dict[str, JSON]",
    *,
    plain: bool = False,
) -> "zarr.Array":
    """Add an array filled with nan or -1; `plain`: with zeros, and uncompressed. `dims` has the
    lengths of the array and of its chunks, by dimension."""
    from zarr.codecs import BloscCodec, Crc32cCodec

    number = np.dtype(dtype).kind == "f"
    packed = [BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"), Crc32cCodec()]
    return group.create_array(
        name,
        shape=tuple(length for length, _ in dims.values()),
        chunks=tuple(chunk for _, chunk in dims.values()),
        dtype=dtype,
        fill_value=0 if plain else (float("nan") if number else -1),
        compressors=None if plain else packed,
        dimension_names=list(dims),
        attributes=attributes,
    )
