"""Blocks on the workers of a Dask scheduler, a bounded number of them under way.

Workers compute and send back; this process alone writes, so every block is written once whatever
becomes of a worker. A block whose worker died is computed by another. A scheduler that goes away
ends the run, not the store: the same command goes on.
"""

import asyncio
import contextlib
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .function import Computed, Stopped, Task
from .place import Tell
from .source import belongs_to_package, fingerprint, other_versions, versions

if TYPE_CHECKING:
    from distributed import Client, Future

Elsewhere = Callable[[bytes, int, dict[str, str]], Computed]
# Blocks under way for each thread of the cluster: one computed, one waiting.
_AHEAD = 2
# How often a block may be lost with its worker before it is taken for the cause.
_LOSSES = 20
# Seconds for a scheduler to answer, and without workers or any chunk before that is told.
_PATIENCE = 15.0


@contextlib.contextmanager
def connected(address: str) -> "Generator[Client]":
    """A client of the scheduler at `address`; what Dask logs of a lost one is not shown.

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
                client.close(timeout=2)  # without waiting for a scheduler that is gone


@contextlib.contextmanager
def local_processes(number: int) -> "Generator[Client]":
    """A client of as many processes of this machine, which share what they compile."""
    import jax
    from distributed import LocalCluster

    on = os.environ.get("JAX_PLATFORMS", "cpu")  # they would share one GPU
    environment = {"JAX_NUM_CPU_DEVICES": "1", "JAX_PLATFORMS": on}
    folder = jax.config.jax_compilation_cache_dir  # ty: ignore[missing-attribute]
    if folder:
        environment["JAX_COMPILATION_CACHE_DIR"] = str(folder)
        environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
        environment["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
    pages: dict[str, Any] = {"dashboard_address": None, "worker_dashboard_address": None}
    with _silent(), _without_main():
        made = LocalCluster(n_workers=number, threads_per_worker=1, env=environment, **pages)
        with made, connected(made.scheduler_address) as client:
            yield client


@contextlib.contextmanager
def _without_main() -> Generator[None]:
    """Keep processes that begin meanwhile from running the script that this one runs."""
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
    """Blocks as they are finished, in any order; `tell` hears where there is no worker.

    Raises
    ------
    Stopped : the scheduler is lost, or one block loses every worker that it is given to.
    """
    yield from _Pool(client, task, address, tell).blocks(list(todo))


def compute_block(task: Task, number: int, expected: dict[str, str]) -> Computed:
    """Compute one block on a worker, with as many threads as Dask counts for it.

    Raises
    ------
    OtherCode : the function, jaxfric or a package below is not that of the client, `expected`.
    """
    from distributed import get_worker

    worker = get_worker()
    _limit_threads(worker.state.nthreads)
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
    """`compute_block` as a function that Dask sends by its code, not by its name.

    What sends a name fails in the scheduler, or ends the worker, where jaxfric or the package of
    one's function is missing. So only a worker looks for them, where it says what is missing.
    """
    namespace: dict[str, str | Elsewhere] = {"__name__": "__main__"}
    exec(_CODE, namespace)
    found = namespace["compute_elsewhere"]
    assert not isinstance(found, str)
    return found


_CODE = """
def compute_elsewhere(packed, number, expected):
    import pickle
    from jaxfric.study.cluster import compute_block
    return compute_block(pickle.loads(packed), number, expected)
"""
_compared: set[str] = set()
"""Tasks whose code this worker found to be that of the client."""


def code_of(task: Task) -> dict[str, str]:
    """Versions of the code that computes the numbers of a task in this process."""
    if belongs_to_package(task.function):
        return versions()
    return versions() | {"your function": fingerprint(task.function)}


class OtherCode(Stopped):
    """Raised where a worker would compute something else."""


def _limit_threads(number: int) -> None:
    """Limit XLA, which takes all cores for itself unless told before its first use."""
    from jax._src import xla_bridge

    if not xla_bridge.backends_are_initialized():
        os.environ.setdefault("NPROC", str(number))


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
            f"--scheduler {address}: no Dask scheduler answers there ({reason}); start one with"
            " 'dask scheduler', or leave the option out to use this machine"
        ) from None


@contextlib.contextmanager
def _silent() -> Generator[None]:
    """Quiet the loggers of Dask, which have levels of their own."""
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
    """The blocks that are under way."""

    def __init__(self, client: "Client", task: Task | None, address: str, tell: Tell):
        import cloudpickle

        self.client, self.address, self.tell = client, address, tell
        self.token = task.token if task is not None else ""
        self.expected, self.packed = {}, b""
        if task is not None:
            self.expected, self.packed = code_of(task), cloudpickle.dumps(task)
        self.compute = _travelling()
        self.alone: float | None = None
        self.last = time.monotonic()
        self.patience = _PATIENCE
        self.futures: dict[Future, int] = {}
        self.losses: dict[int, int] = {}

    def blocks(self, todo: list[int]) -> Generator[tuple[int, Computed], None, None]:
        """Finished blocks; each of `todo` once."""
        todo.reverse()
        while todo or self.futures:
            self._fill(todo)
            for future in self._finished():
                number = self.futures.pop(future)
                block = self._result(future)
                if block is None:
                    self._lost(number)
                    todo.append(number)
                else:
                    yield number, block

    def _fill(self, todo: list[int]) -> None:
        room = max(_AHEAD * self._threads(), _AHEAD) - len(self.futures)
        for _ in range(min(room, len(todo))):
            number = todo.pop()
            key = f"block-{self.token}-{number}-{self.losses.get(number, 0)}"
            future = self._ask(
                lambda key=key, number=number: self.client.submit(
                    self.compute,
                    self.packed,
                    number,
                    self.expected,
                    key=key,
                    pure=False,
                    retries=0,
                )
            )
            self.futures[future] = number

    def _threads(self) -> int:
        """Threads of the workers that are there; 0 where there are none."""
        info = self._ask(lambda: self.client.scheduler_info(n_workers=-1))
        return sum(worker["nthreads"] for worker in info["workers"].values())

    def _finished(self) -> "list[Future]":
        """Futures that are done, waiting for one; a lost scheduler is noticed meanwhile.

        Dask's `as_completed` waits without an end: nobody would be told that there is no worker.
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
                self._mind_workers()
            except (OSError, RuntimeError, CancelledError, asyncio.CancelledError):
                raise self._gone() from None

    def _mind_workers(self) -> None:
        """Tell, once, that there has been no worker for a while."""
        now = time.monotonic()
        if self._threads():
            self.alone = None
            if now - self.last > self.patience:
                self.patience *= 2
                self.tell(self._waiting())
            return
        if self.alone is None:
            self.alone = now
        if now - self.alone > _PATIENCE:
            self.alone = math.inf
            self.tell(
                f"the scheduler at {self.address} has no workers; start some with:"
                f" dask worker {self.address} --nthreads 1"
            )

    def _waiting(self) -> str:
        """Reasons why no chunk came for a while, in words."""
        own = {future.key for future in self.futures}
        under_way = [key for keys in self._ask(self.client.processing).values() for key in keys]
        others = sum(key not in own for key in under_way)
        text = f"waiting for a chunk: {self._threads()} threads at {self.address}"
        text += f" have {len(under_way) - others} of this study"
        if others:
            return f"{text} and {others} tasks of others"
        return f"{text}; the first one of every worker compiles"

    def _result(self, future: "Future") -> Computed | None:
        """Result of a future that is done; None where it was lost with a worker.

        Its status may change between any two lines: it is taken for done only by its result.
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
                f"a worker at {self.address} has no package '{_package(error)}'; install there"
                " what is installed here"
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
        """A block that went with its worker: to be tried again, unless it is to blame."""
        self.losses[number] = self.losses.get(number, 0) + 1
        if self.losses[number] > _LOSSES:
            raise Stopped(
                f"chunk {number} lost its worker {_LOSSES} times; give the workers more memory, or"
                " take a smaller chunk"
            )

    def _gone(self) -> Stopped:
        return Stopped(f"the scheduler at {self.address} is lost")


def _package(error: ImportError) -> str:
    return (error.name or str(error)).partition(".")[0]
