"""Parallel work on threads (JAX releases Python's lock while it computes), and batch sizes."""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
_MOST = 8
_OF_A_GPU = 128
_own = threading.local()
"""On a thread of `side_by_side`: `end`, an event that is set when its work is cancelled."""


class Abandoned(BaseException):
    """Raised by `go_on` if parallel work failed or was interrupted."""


def cores() -> int:
    """Number of threads to use: `NPROC` (as for XLA) or the number of cores, at most 8.

    The limit of 8 threads exists because each thread needs its own memory.
    """
    return min(int(os.environ.get("NPROC", "0")) or os.cpu_count() or 1, _MOST)


def at_once(number: int) -> int:
    """Batch size: `number` on a processor, 128 times `number` on a GPU.

    A batch of `number` fits in a processor's cache. On a GPU a small batch takes as long as a large
    one.
    """
    return number if on_processor() else _OF_A_GPU * number


def on_processor() -> bool:
    """Whether JAX computes on the CPU, by `jax.default_device` or else its default backend."""
    import jax

    device = jax.config.jax_default_device  # ty: ignore[missing-attribute]
    platform = jax.default_backend() if device is None else getattr(device, "platform", device)
    return platform == "cpu"


def side_by_side(one: Callable[..., T], *inputs: Iterable) -> list[T]:
    """`list(map(one, *inputs))` on `cores()` threads, with the caller's floating-point precision.

    Calls of `side_by_side` from within a worker thread run on this thread, one after the other.
    After an error or Ctrl-C `side_by_side` ends when all running calls have ended or reached
    `go_on`.
    """
    asked = list(zip(*inputs, strict=True))
    if min(cores(), len(asked)) < 2 or hasattr(_own, "end"):
        return [one(*each) for each in asked]
    import jax  # slow to import, so not imported at the start of the command

    end, long = threading.Event(), bool(jax.config.jax_enable_x64)  # ty: ignore[missing-attribute]

    def work(each: tuple) -> T:
        _own.end = end
        go_on()
        with jax.enable_x64(long):
            return one(*each)

    with ThreadPoolExecutor(min(cores(), len(asked))) as pool:
        try:
            return list(pool.map(work, asked))
        except BaseException:
            end.set()
            raise


def one_by_one(one: Callable[..., T], *inputs: Iterable) -> list[T]:
    """`list(map(one, *inputs))` on the caller's thread."""
    return [one(*each) for each in zip(*inputs, strict=True)]


def go_on() -> None:
    """Raise `Abandoned` on a thread of `side_by_side` whose work is cancelled."""
    end = getattr(_own, "end", None)
    if end is not None and end.is_set():
        raise Abandoned
