"""Progress of the command on stderr.

A terminal shows one status line that changes. A file, a pipe or a notebook gets one line every ten
seconds. The progress line has the elapsed time, the last message ("trial 3 of at most 80"), and the
age of an old message.

Progress starts before the verb imports any module, because importing JAX takes many seconds on a
busy machine. Quick commands print no progress.
"""

import contextlib
import sys
import threading
import time
from collections.abc import Generator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.status import Status

FIRST = 0.6
"""Time [s] until the first progress line, if stderr is no terminal."""
BEAT = 10.0
"""Time [s] between the following lines."""


class ProgressLines:
    """Prints the message on stderr after `FIRST` s, then after each `BEAT` s without output.

    The methods are those of the status line of rich, which a terminal shows.
    """

    def __init__(self):
        self.silence, self.message = FIRST, ""
        self.begun = self.since = time.monotonic()
        self.ended = threading.Event()
        self.ended.set()

    def start(self) -> None:
        """Start the thread that prints progress, also again after `stop`."""
        if self.ended.is_set():
            self.ended.clear()
            self.thread = threading.Thread(target=self._watch, daemon=True)
            self.thread.start()

    def update(self, message: str) -> None:
        """Set the current message."""
        self.message, self.since = message, time.monotonic()

    def stop(self) -> None:
        """Stop printing; may be called twice."""
        if not self.ended.is_set():
            self.ended.set()
            self.thread.join()

    def _watch(self) -> None:
        """Print the message after every silence until `ended` is set."""
        while not self.ended.wait(self.silence):
            now, self.silence = time.monotonic(), BEAT
            ago = f" (begun {now - self.since:.0f} s ago)" if now - self.since >= BEAT else ""
            text = f"jaxfric: {now - self.begun:.0f} s: {self.message}{ago}"
            with contextlib.suppress(OSError, ValueError):  # a closed stderr must not stop it
                print(text, file=sys.stderr, flush=True)


_SHOWN: "list[ProgressLines | Status]" = []
"""The progress of the running command. Library functions report from several threads."""


@contextlib.contextmanager
def telling(*, silent: bool = False) -> Generator[None]:
    """Show progress within the block, beginning with "starting"; not if `silent`."""
    if silent:
        yield
        return
    if sys.stderr.isatty():
        from rich.console import Console

        _SHOWN.append(Console(stderr=True, highlight=False).status("starting"))
    else:
        _SHOWN.append(ProgressLines())
    try:
        doing("starting")
        yield
    finally:
        pause()
        _SHOWN.pop()


def doing(message: str) -> None:
    """Set the current message of the progress, and show progress again after a `pause`."""
    for shown in _SHOWN[-1:]:
        if not isinstance(shown, ProgressLines):
            from rich.markup import escape

            message = escape(message)
        shown.update(message)
        shown.start()


def pause() -> None:
    """Stop showing progress until the next message, so that no line disturbs other output."""
    for shown in _SHOWN[-1:]:
        shown.stop()
