"""Work done on several threads: while JAX computes, Python is free for the next."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def side_by_side(one: Callable[..., T], *inputs: Iterable) -> list[T]:
    """`list(map(one, *inputs))` on as many threads as there are cores (`NPROC`, as XLA has it,
    where that is set). An error of one ends it when those that were begun have ended."""
    cores = int(os.environ.get("NPROC", "0")) or os.cpu_count() or 1
    asked = list(zip(*inputs, strict=True))
    if min(cores, len(asked)) < 2:
        return [one(*each) for each in asked]
    with ThreadPoolExecutor(min(cores, len(asked))) as pool:
        return list(pool.map(lambda each: one(*each), asked))
