"""Compute blocks on the workers of a Dask scheduler, with a bounded number of blocks in progress.

Workers compute and return blocks of the study. Only the main process writes, so every block is
written once even if workers die. If a worker dies, another worker computes its block. If the
scheduler is lost, the run ends, but the store stays valid. The same command then continues the
study.
"""

import asyncio
import contextlib
import logging
import os
import sys
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any

from ..errors import InputError, option
from .function import Computed, Stopped, Task
from .place import Tell
from .source import other_versions, own_code, versions

if TYPE_CHECKING:
    from distributed import Client, Future

Elsewhere = Callable[[int, bytes, dict[str, str], str], Computed]
# Blocks in progress for each thread of the cluster: one computed, one waiting.
_AHEAD = 2
# If a block loses this number of workers, the block itself counts as the cause.
_LOSSES = 20
# Seconds for a scheduler to answer, and until a lack of workers or chunks is reported.
_PATIENCE = 15.0


@contextlib.contextmanager
def connected(address: str) -> "Generator[Client]":
    """Yield a Dask client of the scheduler at `address`, without Dask's log of a lost scheduler.

    Raises
    ------
    InputError : Dask is not installed, or no scheduler answers.
    """
    client = _connect(address)
    with _silent(), client.as_current():
        try:
            yield client
        finally:
            with contextlib.suppress(Exception, CancelledError, asyncio.CancelledError):
                client.close(timeout=2)  # do not wait long for a lost scheduler


@contextlib.contextmanager
def local_processes(number: int) -> "Generator[Client]":
    """Yield a Dask client of local processes, which share the compilation cache."""
    import jax
    from distributed import LocalCluster

    on = os.environ.get("JAX_PLATFORMS", "cpu")  # the processes would share one GPU
    environment = {"JAX_NUM_CPU_DEVICES": "1", "JAX_PLATFORMS": on}
    folder = jax.config.jax_compilation_cache_dir  # ty: ignore[missing-attribute]
    if folder:
        environment["JAX_COMPILATION_CACHE_DIR"] = str(folder)
        environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
        environment["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
    more: dict[str, Any] = {"dashboard_address": None, "worker_dashboard_address": None}
    more["silence_logs"] = logging.CRITICAL  # of the processes, which write to this terminal
    with _silent(), _without_main():
        made = LocalCluster(n_workers=number, threads_per_worker=1, env=environment, **more)
        with made, connected(made.scheduler_address) as client:
            yield client


@contextlib.contextmanager
def _without_main() -> Generator[None]:
    """Keep processes started within the block from running this process's script."""
    main = sys.modules["__main__"]
    kept = {name: vars(main).pop(name) for name in ("__file__", "__spec__") if name in vars(main)}
    main.__spec__ = None
    try:
        yield
    finally:
        vars(main).update(kept)


def distributed(
    client: "Client", task: Task, todo: Sequence[int], address: str, tell: Tell
) -> Generator[tuple[int, Computed], None, None]:
    """Yield finished blocks in any order; a lack of workers is reported to `tell`.

    Raises
    ------
    Stopped : the scheduler is lost, or one block loses every worker that computes it.
    """
    yield from _Pool(client, task, address, tell).blocks(list(todo))


def compute_block(task: Task, number: int, expected: dict[str, str], flags: str) -> Computed:
    """Compute one block on a worker, with as many threads as Dask counts for it.

    `flags` are the XLA_FLAGS of the client: with other flags numbers differ by the solver's error.

    Raises
    ------
    OtherCode : the function, jaxfric or one of its dependencies differs from the client's version,
        `expected`.
    """
    from distributed import get_worker

    worker = get_worker()
    _set_up_xla(worker.state.nthreads, flags)
    if task.token not in _compared:
        changed = other_versions(expected, code_of(task))
        if changed:
            raise OtherCode(
                f"the worker at {worker.address} has other code than this machine:"
                f" {', '.join(changed)} there; install the same on both, and start the worker anew"
            )
        _compared.add(task.token)
    from .local import compute

    return compute(task, number)


def _travelling() -> Elsewhere:
    """Return `compute_block` as a function that Dask sends by its code, not by its name.

    Sent by name, it would fail in the scheduler or end the worker if jaxfric or the user's package
    is missing there. Sent by code, the worker imports them and reports what is missing.
    """

    def compute_elsewhere(
        number: int, packed: bytes, expected: dict[str, str], flags: str
    ) -> Computed:
        import pickle

        from jaxfric.study.cluster import compute_block

        return compute_block(pickle.loads(packed), number, expected, flags)

    return compute_elsewhere


_compared: set[str] = set()
"""Tasks whose code on this worker is the same as on the client."""


def code_of(task: Task) -> dict[str, str]:
    """Return the versions of all code that computes a task in this process."""
    return versions() | own_code(task.function)


class OtherCode(Stopped):
    """Raised if the code on a worker differs from the code on the client."""


def _set_up_xla(threads: int, flags: str) -> None:
    """Before the first use of XLA limit its threads, which are all cores by default, and set its
    flags, unless the worker has its own."""
    from jax._src import xla_bridge

    if not xla_bridge.backends_are_initialized():
        os.environ.setdefault("NPROC", str(threads))
        os.environ.setdefault("XLA_FLAGS", flags)


def _connect(address: str) -> "Client":
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            'a Dask cluster needs the package distributed: pip install "jaxfric[study]"'
        ) from None
    try:
        with _silent():
            return Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError, TimeoutError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(
            f"{option('scheduler', address)}: no Dask scheduler answers there ({reason}); start"
            " one with 'dask scheduler', or leave the option out to use this machine"
        ) from None


@contextlib.contextmanager
def _silent() -> Generator[None]:
    """Silence the loggers of Dask, which have their own levels."""
    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


class _Pool:
    """The blocks in progress."""

    def __init__(self, client: "Client", task: Task, address: str, tell: Tell):
        self.client, self.task, self.address, self.tell = client, task, address, tell
        self.last = time.monotonic()
        self.patience = _PATIENCE
        self.futures: dict[Future, int] = {}
        self.losses: dict[int, int] = {}

    def blocks(self, todo: list[int]) -> Generator[tuple[int, Computed], None, None]:
        """Yield each block of `todo` once, when it is finished."""
        import cloudpickle

        flags = os.environ.get("XLA_FLAGS", "")
        work = (_travelling(), cloudpickle.dumps(self.task), code_of(self.task), flags)
        todo.reverse()
        while todo or self.futures:
            self._fill(todo, *work)
            for future in self._finished():
                number = self.futures.pop(future)
                block = self._result(future)
                if block is None:
                    self._lost(number)
                    todo.append(number)
                else:
                    yield number, block

    def _fill(self, todo: list[int], compute: Elsewhere, *how: object) -> None:
        room = max(_AHEAD * self._threads(), _AHEAD) - len(self.futures)
        for _ in range(min(room, len(todo))):
            number = todo.pop()
            key = f"block-{self.task.token}-{number}-{self.losses.get(number, 0)}"
            future = self._ask(
                lambda key=key, number=number: self.client.submit(
                    compute, number, *how, key=key, pure=False, retries=0
                )
            )
            self.futures[future] = number

    def _threads(self) -> int:
        """Return the number of threads of all workers; 0 without workers."""
        info = self._ask(lambda: self.client.scheduler_info(n_workers=-1))
        return sum(worker["nthreads"] for worker in info["workers"].values())

    def _finished(self) -> "list[Future]":
        """Wait for a future and return all that are done; detect a lost scheduler meanwhile.

        Dask's `as_completed` waits forever, so that a lack of workers could not be reported.
        """
        from distributed import wait

        while True:
            if self.client.status != "running":
                raise self._gone()
            try:
                done = wait(list(self.futures), timeout=1.0, return_when="FIRST_COMPLETED").done
                self.last, self.patience = time.monotonic(), _PATIENCE
                return list(done)
            except TimeoutError:
                self._say_waiting()
            except (OSError, RuntimeError, CancelledError, asyncio.CancelledError):
                raise self._gone() from None

    def _say_waiting(self) -> None:
        """Report that no chunk has arrived for a while, ever less often."""
        if time.monotonic() - self.last > self.patience:
            self.patience *= 2
            threads = self._threads()
            advice = (
                "" if threads else f"; start some with: dask worker {self.address} --nthreads 1"
            )
            self.tell(f"waiting for a chunk: {threads} threads at {self.address}{advice}")

    def _result(self, future: "Future") -> Computed | None:
        """Return the result of a finished future; None if it was lost with a worker.

        The status may change at any time, so that only a result proves that the future is done.
        """
        from distributed import KilledWorker

        error = self._ask(lambda: future.exception(timeout=_PATIENCE))
        status = future.status
        if self.client.status != "running" or status == "cancelled":
            raise self._gone()
        if isinstance(error, KilledWorker):
            return None
        if isinstance(error, ImportError):
            raise Stopped(
                f"a worker at {self.address} has no package"
                f" '{(error.name or str(error)).partition('.')[0]}'; install there what is"
                " installed here"
            )
        if error is not None:
            raise error
        if status != "finished":
            return None
        with contextlib.suppress(KilledWorker):
            return self._ask(lambda: future.result(timeout=10 * _PATIENCE))
        return None

    def _ask(self, what: Callable[[], Any]) -> Any:
        try:
            return what()
        except (OSError, RuntimeError, CancelledError, asyncio.CancelledError):
            raise self._gone() from None

    def _lost(self, number: int) -> None:
        """Try a block again that was lost with its worker, unless it was lost too often."""
        self.losses[number] = self.losses.get(number, 0) + 1
        if self.losses[number] > _LOSSES:
            raise Stopped(
                f"chunk {number} lost its worker {_LOSSES} times; give the workers more memory, or"
                " take a smaller chunk"
            )

    def _gone(self) -> Stopped:
        return Stopped(f"the scheduler at {self.address} is lost")
