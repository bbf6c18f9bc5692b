"""Progress of the command on stderr.

A terminal shows one status line that changes. A file, a pipe or a notebook gets one line every ten
seconds. The progress line has the elapsed time, the last message ("trial 3 of at most 80"), and the
age of an old message.

Progress starts before the verb imports any module, because importing JAX takes many seconds on a
busy machine. Quick commands print no progress.
"""

import contextlib
import contextvars
import sys
import threading
import time
from collections.abc import Generator

FIRST = 0.6
"""Time [s] until the first progress line, if stderr is no terminal."""
BEAT = 10.0
"""Time [s] between the following lines."""


class Teller:
    """Prints the message on stderr after `first` s, then after each `BEAT` s without output."""

    def __init__(self, first: float):
        self.silence, self.message = first, "starting"
        self.begun = self.last = self.since = time.monotonic()
        self.ended = threading.Event()
        self.ended.set()
        self.begin()

    def begin(self) -> None:
        """Start the thread that prints progress; it can start again after `end`."""
        if self.ended.is_set():
            self.ended.clear()
            self.last = time.monotonic()
            self.thread = threading.Thread(target=self._watch, daemon=True)
            self.thread.start()

    def __call__(self, message: str) -> None:
        """Set the current message."""
        self.message, self.since = message, time.monotonic()

    def end(self) -> None:
        """Stop printing; may be called twice."""
        self.ended.set()
        self.thread.join()

    def _watch(self) -> None:
        """Print the message after every silence until `ended` is set."""
        while not self.ended.wait(max(0.0, self.last + self.silence - time.monotonic())):
            self.last, self.silence = time.monotonic(), BEAT
            old = self.last - self.since
            ago = f" (begun {old:.0f} s ago)" if old >= BEAT else ""
            text = f"jaxfric: {self.last - self.begun:.0f} s: {self.message}{ago}"
            with contextlib.suppress(OSError, ValueError):  # a closed stderr must not stop it
                print(text, file=sys.stderr, flush=True)


class Line:
    """A status line on a terminal."""

    def __init__(self):
        from rich.console import Console

        self.status = Console(stderr=True, highlight=False).status("starting")
        self.begin, self.end = self.status.start, self.status.stop
        self.begin()

    def __call__(self, message: str) -> None:
        """Set the current message."""
        from rich.markup import escape

        self.status.update(escape(message))


_NOW: contextvars.ContextVar[Teller | Line | None] = contextvars.ContextVar("told", default=None)


def _begin() -> Teller | Line:
    return Line() if sys.stderr.isatty() else Teller(FIRST)


@contextlib.contextmanager
def telling(*, silent: bool = False) -> Generator[None]:
    """Show progress within the block, until a `told` in the block ends; not if `silent`."""
    token = _NOW.set(Teller(threading.TIMEOUT_MAX) if silent else _begin())
    try:
        with told():
            yield
    finally:
        _NOW.reset(token)


@contextlib.contextmanager
def told() -> Generator[Teller | Line]:
    """Yield the progress callback of the command.

    Progress stops at the end of the block, so that the status line does not disturb later output.
    """
    teller = _NOW.get() or _begin()
    teller.begin()
    try:
        yield teller
    finally:
        teller.end()


def doing(message: str) -> None:
    """Set the current message of the progress, outside of a `told` block."""
    if (teller := _NOW.get()) is not None:
        teller(message)
