"""Estimates of the size and time of a study, before it begins."""

import dataclasses
import time

import numpy as np

from .function import Task
from .grid import Tiling
from .layout import outputs_of

# Studies of this size or more need a confirmation before they start.
_MEMBERS, _BYTES = 100_000_000, 1e11


def is_large(task: Task) -> bool:
    """Whether the study is so large that the user must confirm it."""
    return task.grid.size > _MEMBERS or _bytes(task) > _BYTES


def told_size(task: Task) -> str:
    """Return a line with members, chunks, uncompressed size, and time at a measured rate."""
    rate = _rate(task)
    days = task.grid.size / rate / 86400
    took = f"{days:.3g} days" if days >= 1 else f"{24 * days:.2g} h"
    size = _bytes(task)
    shown = f"{size / 1e12:.3g} TB" if size >= 1e12 else f"{size / 1e9:.3g} GB"
    return (
        f"{task.grid.size:.3g} members in {len(task.blocks)} chunks: up to {shown}, and {took} at"
        f" the {rate:.3g} members/s of this machine"
    )


def _bytes(task: Task) -> float:
    each = 0.0
    for output in outputs_of(task):
        numbers = np.prod([len(dim.values) for dim in output.dims], dtype=float)
        each += numbers * np.dtype(task.dtype if output.dtype == "float" else output.dtype).itemsize
    return each * task.grid.size


def _rate(task: Task) -> float:
    """Measure members per second of this process with a few members, after compilation."""
    from .local import compute, devices

    few = 1 if task.kind == "host" else devices(task) * task.batch
    small = dataclasses.replace(task, blocks=Tiling.of(task.grid.shape, few), token="size")
    compute(small, 0)
    begun = time.perf_counter()
    compute(small, len(small.blocks) // 2)
    return small.blocks.largest / max(time.perf_counter() - begun, 1e-9)
