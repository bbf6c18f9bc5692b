"""Blocks on the workers of a Dask scheduler, a bounded number of them under way.

Workers compute and send back; this process alone writes, so every block is written once whatever
happens to a worker. A block whose worker died is computed by another one. A scheduler that goes
away ends the run, not the store.
"""

import contextlib
import os
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from .function import Stopped, Task

# Blocks under way for each thread of the cluster: one computed, one waiting.
_AHEAD = 2
# How often a block may be lost with its worker before it is taken for the cause.
_LOSSES = 30
_PATIENCE = 20.0


def distributed(
    task: Task, todo: Sequence[int], address: str
) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """Blocks as they are finished, in any order.

    Raises
    ------
    InputError : Dask is not installed, or no scheduler answers at `address`.
    Stopped : the scheduler is lost, or one block loses every worker it is given to.
    """
    client = _connect(address)
    try:
        yield from _collect(client, task, list(todo), address)
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=2)


def _connect(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            'a Dask cluster needs the package distributed: pip install "jaxfric[study]"'
        ) from None
    try:
        return Client(address, timeout=_PATIENCE, set_as_default=False, direct_to_workers=False)
    except (OSError, ValueError, TimeoutError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there ({reason}); start one with"
            " 'dask scheduler', or leave the option out for this machine"
        ) from None


def _collect(client, task: Task, todo: list[int], address: str):
    from distributed import as_completed

    losses = dict.fromkeys(todo, 0)
    waiting = iter(todo)
    numbers: dict[str, int] = {}
    try:
        ready = as_completed(with_results=False, loop=client.loop)
        remote = client.scatter(task, broadcast=False, hash=False)

        def submit(number: int) -> None:
            key = f"block-{task.token}-{number}-{losses[number]}"
            future = client.submit(compute_block, remote, number, key=key, pure=False)
            numbers[future.key] = number
            ready.add(future)

        def fill() -> None:
            while len(numbers) < max(_AHEAD * _threads(client), _AHEAD):
                number = next(waiting, None)
                if number is None:
                    return
                submit(number)

        fill()
        while numbers:
            future = _next(client, ready, address)
            number = numbers.pop(future.key)
            if future.status == "finished":
                yield number, future.result(timeout=_PATIENCE)
            else:
                losses[number] += 1
                _refuse_hopeless(future, losses[number], number)
                submit(number)
            del future
            fill()
    except (OSError, TimeoutError, RuntimeError) as error:
        if isinstance(error, Stopped):
            raise
        raise Stopped(f"the scheduler at {address} is lost ({type(error).__name__})") from None
