"""Work done on several threads: while JAX computes, Python is free for the next."""

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import NoReturn, TypeVar

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


_beside: list[threading.Thread] = []


def beside(work: Callable[[], object]) -> None:
    """Do `work` on a thread of its own while this one goes on. An error ends it silently: it is for
    work that is done again by whoever finds it undone. The process waits for its end."""

    def quietly() -> None:
        with contextlib.suppress(Exception):
            work()

    thread = threading.Thread(target=quietly)
    _beside[:] = [thread, *(one for one in _beside if one.is_alive())]
    thread.start()


def leave(code: int | str | None) -> NoReturn:
    """End the process. After an error it does not wait for what is done `beside`."""
    if isinstance(code, int) and code and any(one.is_alive() for one in _beside):
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        os._exit(code)
    sys.exit(code)
