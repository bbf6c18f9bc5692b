"""Telling on stderr what is being done, and that it is still being done.

On a terminal one line changes. Elsewhere (a file, a pipe, a notebook) there is no such line: work
that says nothing for five seconds is then told of by a line with the seconds spent so far and the
last message, which says what is left where that is known ("trial 3 of at most 80").
"""

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator

BEAT = 5.0
"""The longest silence [s] where there is no terminal."""


class Teller:
    """Lines on stderr: one for every message if `each`, and one wherever `beat` s were silent."""

    def __init__(self, *, each: bool, beat: float):
        self.each, self.beat = each, beat
        self.message = "starting"
        self.begun = self.last = time.monotonic()
        self.lock, self.ended = threading.Lock(), threading.Event()

    def __call__(self, message: str) -> None:
        """Say what is being done from now on."""
        with self.lock:
            self.message = message
            if self.each:
                self._print(message)

    def watch(self) -> None:
        """Break every silence until `ended` is set."""
        while not self.ended.wait(max(0.0, self.last + self.beat - time.monotonic())):
            with self.lock:
                if time.monotonic() - self.last >= self.beat:
                    self._print(f"{time.monotonic() - self.begun:.0f} s: {self.message}")

    def _print(self, text: str) -> None:
        self.last = time.monotonic()
        with contextlib.suppress(OSError, ValueError):  # stderr was closed: work goes on
            print(f"jaxfric: {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def told(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Tell on stderr what is being done, see this file. With `quiet` only silences are broken."""
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.markup import escape

        with Console(stderr=True, highlight=False).status("starting") as status:
            yield lambda message: status.update(escape(message))
        return
    teller = Teller(each=not quiet, beat=BEAT)
    watch = threading.Thread(target=teller.watch, daemon=True)
    watch.start()
    try:
        yield teller
    finally:
        teller.ended.set()
        watch.join()
