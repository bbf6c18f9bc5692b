"""Telling on stderr what is being done, and that it is still being done.

On a terminal one line changes. Elsewhere (a file, a pipe, a notebook) there is no such line: a line
every ten seconds has the seconds spent so far and the last message, which says what is left where
that is known ("trial 3 of at most 80"), and how long ago that was.

The command begins to tell before its verb imports anything, and the first word comes early: on a
busy machine to import JAX alone takes many seconds. What is quick says nothing.
"""

import contextlib
import contextvars
import sys
import threading
import time
from collections.abc import Generator

FIRST = 0.6
"""The longest silence [s] before the first word, where there is no terminal."""
BEAT = 10.0
"""The longest silence [s] after it."""


class Teller:
    """A line on stderr wherever there was silence for `first` s at the beginning, for `beat` s
    later."""

    def __init__(self, *, first: float, beat: float):
        self.longest, self.beat = first, beat
        self.message = "starting"
        self.begun = self.last = self.since = time.monotonic()
        self.lock, self.ended = threading.Lock(), threading.Event()
        self.ended.set()
        self.begin()

    def begin(self) -> None:
        """Break silences, from the start and again after an `end`."""
        if self.ended.is_set():
            self.ended.clear()
            self.last = time.monotonic()
            self.thread = threading.Thread(target=self._watch, daemon=True)
            self.thread.start()

    def __call__(self, message: str) -> None:
        """Note what is being done from now on."""
        self.message, self.since = message, time.monotonic()

    def say(self, message: str) -> None:
        """Note it, and print it now: for what is said seldom."""
        with self.lock:
            self(message)
            self._print(message)

    def end(self) -> None:
        """Break no more silence; to be called twice is no mistake."""
        self.ended.set()
        self.thread.join()

    def _watch(self) -> None:
        """Break every silence until `ended` is set."""
        while not self.ended.wait(max(0.0, self.last + self.longest - time.monotonic())):
            with self.lock:
                now = time.monotonic()
                if now - self.last >= self.longest:
                    old = now - self.since
                    ago = f" (begun {old:.0f} s ago)" if old >= self.beat else ""
                    self._print(f"{now - self.begun:.0f} s: {self.message}{ago}")

    def _print(self, text: str) -> None:
        self.last, self.longest = time.monotonic(), self.beat
        with contextlib.suppress(OSError, ValueError):  # stderr was closed: work goes on
            print(f"jaxfric: {text}", file=sys.stderr, flush=True)


class Line:
    """One line of a terminal that changes."""

    def __init__(self):
        from rich.console import Console

        self.status = Console(stderr=True, highlight=False).status("starting")
        self.begin()

    def begin(self) -> None:
        """Show the line, again after an `end`."""
        self.status.start()

    def __call__(self, message: str) -> None:
        """Say what is being done from now on."""
        from rich.markup import escape

        self.status.update(escape(message))

    def say(self, message: str) -> None:
        """Say it: there is but one line."""
        self(message)

    def end(self) -> None:
        """Take the line away; to be called twice is no mistake."""
        self.status.stop()


class Silent:
    """Tells nothing, as --quiet asks."""

    def __call__(self, message: str) -> None:
        """Tell nothing of it."""

    def say(self, message: str) -> None:
        """Tell nothing of it."""

    def begin(self) -> None:
        """There is nothing to begin."""

    def end(self) -> None:
        """There is nothing to end."""


_NOW: contextvars.ContextVar[Teller | Line | Silent | None] = contextvars.ContextVar(
    "told", default=None
)


def _begin() -> Teller | Line:
    return Line() if sys.stderr.isatty() else Teller(first=FIRST, beat=BEAT)


@contextlib.contextmanager
def telling(*, silent: bool = False) -> Generator[None]:
    """Tell of all that is done in the block, at the latest until a `told` in it ends; or, where
    `silent`, of nothing."""
    teller = Silent() if silent else _begin()
    token = _NOW.set(teller)
    try:
        yield
    finally:
        _NOW.reset(token)
        teller.end()


@contextlib.contextmanager
def told() -> Generator[Teller | Line | Silent]:
    """Tell on stderr what is being done, see this file.

    What is printed after the block is not disturbed by a line of a terminal.
    """
    teller = _NOW.get() or _begin()
    teller.begin()
    try:
        yield teller
    finally:
        teller.end()


def doing(message: str) -> None:
    """Note what is being done from now on, outside a `told`."""
    teller = _NOW.get()
    if teller is not None:
        teller(message)
