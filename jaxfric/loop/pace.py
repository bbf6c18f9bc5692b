"""What is left of a search, in seconds of this machine: told with every message.

One linearisation of the record takes the same time whatever is asked of it, and nearly all of a
search is made of them. The median so far is what one takes here: the first, with its compilation,
does not count, and a busy machine does.
"""

import statistics
import time
from collections.abc import Callable
from contextlib import contextmanager

_PER_FIT = 14
"""Linearisations of a joint fit, about; screening all effects is worth as much."""


class Stopwatch:
    """How long the same work took each time [s]."""

    def __init__(self):
        self.seconds: list[float] = []
        self.listen: Callable[[int, float], None] = lambda number, seconds: None

    @contextmanager
    def __call__(self):
        begun = time.perf_counter()
        yield
        self.seconds.append(time.perf_counter() - begun)
        self.listen(len(self.seconds), self.typical)

    @property
    def typical(self) -> float:
        """Their median."""
        return statistics.median(self.seconds) if self.seconds else float("inf")


def now_and_then(
    progress: Callable[[str], None], text: str, *, seconds: float = 10.0
) -> Callable[[int, float], None]:
    """Tells of work that is slow, not more often than every so many seconds."""
    last = time.monotonic()

    def listen(number: int, each: float) -> None:
        nonlocal last
        if time.monotonic() - last >= seconds:
            last = time.monotonic()
            progress(f"{text}: {number} linearisations so far, {each:.2g} s each")

    return listen


class Pace:
    """Tells what is done and about how long the rest takes.

    `linearisation` is the seconds of one. A search has at most `rounds`, each of a screening and
    of `refits` fits; the fewest there can be is one of two.
    """

    def __init__(
        self, progress: Callable[[str], None], linearisation: float, rounds: int, refits: int
    ):
        self.progress, self.rounds, self.refits = progress, rounds, refits
        self.fit = _PER_FIT * linearisation

    def screening(self, text: str, number: int) -> None:
        """Of round `number`, from 0: it, two refits and the last steps are left at least."""
        whole = 1 + self.refits
        self._tell(text, 4, (self.rounds - number) * whole + 3)

    def refitting(self, text: str, number: int, place: int, of: int) -> None:
        """The refit `place` of so many, from 0, in round `number`."""
        left = of - place
        later = (self.rounds - number - 1) * (1 + self.refits)
        self._tell(f"{text} ({place + 1} of {of})", left + 1, left + later + 3)

    def _tell(self, text: str, least: int, most: int) -> None:
        self.progress(f"{text}; {span(least * self.fit, most * self.fit)} left")


def span(least: float, most: float) -> str:
    """Two durations [s] in words: "10 to 40 s", "30 s to 2 min", "2 to 8 min"."""
    a, b = _rounded(least), _rounded(most)
    if a == b:
        return f"about {a[0]} {a[1]}"
    return f"{a[0]} to {b[0]} {b[1]}" if a[1] == b[1] else f"{a[0]} {a[1]} to {b[0]} {b[1]}"


def _rounded(seconds: float) -> tuple[int, str]:
    if seconds < 55:
        return max(5, 5 * round(seconds / 5)), "s"
    return (round(seconds / 60) or 1, "min") if seconds < 5400 else (round(seconds / 3600), "h")
