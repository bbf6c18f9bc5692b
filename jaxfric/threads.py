"""How much is done at once: on threads, as Python is free while JAX computes, and on a GPU."""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
_MOST = 8
_OF_A_GPU = 128
_own = threading.local()
"""Of a thread that `side_by_side` began: `end`, an event that is set when its work is of no use."""


class Abandoned(BaseException):
    """Work that `go_on` ended, since the work beside it failed or was interrupted."""


def cores() -> int:
    """Number of threads that are worth it: `NPROC`, as XLA has it, or that of the cores; each has
    memory of its own, so they are not many."""
    return min(int(os.environ.get("NPROC", "0")) or os.cpu_count() or 1, _MOST)


def at_once(number: int) -> int:
    """How many to compute together where the cache of a processor holds `number`: more on a GPU,
    whose loop over few takes as long as over many."""
    return number if on_processor() else _OF_A_GPU * number


def on_processor() -> bool:
    """Whether JAX computes on the processor: by `jax.default_device`, or having nothing else."""
    import jax

    device = jax.config.jax_default_device  # ty: ignore[missing-attribute]
    platform = jax.default_backend() if device is None else getattr(device, "platform", device)
    return platform == "cpu"


def side_by_side(one: Callable[..., T], *inputs: Iterable) -> list[T]:
    """`list(map(one, *inputs))` on as many threads as there are `cores`; numbers have the bits that
    they have here. What is asked on one of these threads is done there, one after the other.

    An error of one, or Ctrl-C, ends it when those that were begun have ended or come to `go_on`.
    """
    asked = list(zip(*inputs, strict=True))
    if min(cores(), len(asked)) < 2 or hasattr(_own, "end"):
        return [one(*each) for each in asked]
    import jax  # not where the command begins

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
    """The same on this thread."""
    return [one(*each) for each in zip(*inputs, strict=True)]


def go_on() -> None:
    """Raises `Abandoned` on a thread of `side_by_side` whose work is of no more use."""
    end = getattr(_own, "end", None)
    if end is not None and end.is_set():
        raise Abandoned
