"""A new store: its variables, their units and meanings, and everything else but the blocks."""

import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .function import OUTCOME, OUTCOMES, Output, Task
from .grid import SAMPLE
from .marks import DONE, FIXED, fixed_checksums
from .source import revision, versions

SCHEMA = "jaxfric.study/2"


def make_store(
    folder: str,
    task: Task,
    description: Mapping[str, Any],
    toml: str,
    told: Sequence[str] = (),
) -> None:
    """Write a store without blocks into a folder that is not there yet; `told` are warnings."""
    import zarr

    attributes = _attributes(task, description, toml)
    attributes |= {"warnings": list(told)} if told else {}
    group = zarr.create_group(folder, attributes=attributes)
    _variables(group, task)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that not every reader knows them: xarray does
        zarr.consolidate_metadata(folder)
    root = Path(folder)
    files = sorted(file for file in root.rglob("*") if file.is_file())
    named = ((file.relative_to(root).as_posix(), file.read_bytes()) for file in files)
    (root / FIXED).write_bytes(fixed_checksums(named))


def sampled(task: Task) -> list[str]:
    """Names of the sampled parameters."""
    samples = task.grid.samples
    return [] if samples is None else [name for name, _, _ in samples.described()]


def outputs_of(task: Task) -> tuple[Output, ...]:
    """All variables of a block."""
    return (*task.outputs, Output(OUTCOME, codes=OUTCOMES, long_name="outcome"))


def _attributes(task: Task, description: Mapping[str, Any], toml: str) -> dict[str, Any]:
    columns, dims = sampled(task), len(task.grid.shape)
    found = {
        "schema": SCHEMA,
        "study": json.dumps(description),
        "toml": toml,
        "versions": versions(),
        "revision": revision(),
        "members": task.grid.size,
        "layout": {
            "shape": list(task.blocks.shape),
            "block": list(task.blocks.block),
            "outputs": {o.name: dims + len(o.dims) for o in outputs_of(task)},
            "columns": columns,
        },
    }
    return found | ({"coordinates": " ".join(columns)} if columns else {})


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
    for output in outputs_of(task):
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
    from zarr.codecs import BloscCodec, Crc32cCodec

    number = np.dtype(dtype).kind == "f"
    fill = 0 if plain else (float("nan") if number else -1)
    packed = [BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"), Crc32cCodec()]
    return group.create_array(
        name,
        shape=tuple(shape),
        chunks=tuple(chunks),
        dtype=dtype,
        fill_value=fill,
        compressors=None if plain else packed,
        dimension_names=list(dims),
        attributes=attributes,
    )
