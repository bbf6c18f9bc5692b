"""Estimates how long the rest of a search takes [s]; every message says it.

A search consists almost wholly of linearisations of the record, which all take the same time. That
time is estimated by the median of the latest ones, so that a compilation does not count but a busy
machine does. How many of them a joint fit takes is learnt from the fits before it.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from contextlib import contextmanager

_PER_FIT = 14
"""Linearisations of a joint fit, roughly; screening all effects takes about as many."""
_LATEST = 15
_SILENT = 10.0
"""Within a stage what is left is told again after so many seconds."""


class Stopwatch:
    """Times that the same work took, one after another [s]."""

    def __init__(self, seconds: Sequence[float] = ()):
        self.seconds = list(seconds)
        self.listen: Callable[[int, float], None] = lambda number, seconds: None

    @contextmanager
    def __call__(self):
        begun = time.perf_counter()
        yield
        self.seconds.append(time.perf_counter() - begun)
        self.listen(len(self.seconds), self.typical)

    @property
    def typical(self) -> float:
        """Median of the latest times [s]."""
        return statistics.median(self.seconds[-_LATEST:]) if self.seconds else float("inf")


def now_and_then(
    progress: Callable[[str], None], text: str, *, seconds: float = 10.0
) -> Callable[[int, float], None]:
    """Tells of work that is slow, not more often than every so many seconds."""
    last = time.monotonic()

    def listen(number: int, each: float) -> None:
        nonlocal last
        if time.monotonic() - last >= seconds:
            last = time.monotonic()
            if number == 1:
                progress(f"{text}: the first linearisation took {each:.2g} s, with compiling")
            else:
                progress(f"{text}: {number} linearisations so far, {each:.2g} s each")

    return listen


class Pace:
    """Reports what is done and about how long the rest takes; within a stage that falls, too.

    A search has at most `rounds`, each of a screening and of `refits` fits; the fewest there can
    be is one of two. Refits are done so many `at_once`: linearisations of all of them count
    between the beginnings of two.
    """

    def __init__(
        self,
        progress: Callable[[str], None],
        stopwatch: Stopwatch,
        rounds: int,
        refits: int,
        *,
        at_once: int = 1,
        silent: float = _SILENT,
    ):
        self.progress, self.stopwatch = progress, stopwatch
        self.rounds, self.silent, self.at_once = rounds, silent, at_once
        self.refits = -(-refits // at_once)
        self.text, self.least, self.most = "", 0, 0
        self.begun = len(stopwatch.seconds)
        self.counts = [_PER_FIT * at_once]
        self.last = time.monotonic()
        self.fits = False
        stopwatch.listen = self._again

    def screening(self, text: str, number: int) -> None:
        """Begin round `number`, from 0: at least it, two refits and the last steps are left."""
        whole = 1 + self.refits
        self._begin(text, 2 + -(-2 // self.at_once), (self.rounds - number) * whole + 3, fits=False)

    def refitting(self, text: str, number: int, place: int, of: int) -> None:
        """Begin refit `place` of `of`, from 0, in round `number`."""
        left = -(-(of - place) // self.at_once)
        later = (self.rounds - number - 1) * (1 + self.refits)
        self._begin(f"{text} ({place + 1} of {of})", left + 1, left + later + 3, fits=True)

    def end(self) -> None:
        """End the stages whose number is known: no more is reported of them."""
        self.stopwatch.listen = lambda number, seconds: None

    def _begin(self, text: str, least: int, most: int, *, fits: bool) -> None:
        if self.fits and self._done():
            self.counts.append(self._done())
        self.text, self.least, self.most, self.fits = text, least, most, fits
        self.begun = len(self.stopwatch.seconds)
        self._tell()

    def _again(self, number: int, seconds: float) -> None:
        if self.text and time.monotonic() - self.last >= self.silent:
            self._tell()

    def _done(self) -> int:
        return len(self.stopwatch.seconds) - self.begun

    def _tell(self) -> None:
        """Durations in fits; of the stage under way there is always one linearisation left."""
        self.last, done = time.monotonic(), self._done()
        each = statistics.mean(self.counts)
        share = done / max(each, done + 1)
        fit = each * self.stopwatch.typical / self.at_once
        left = span((self.least - share) * fit, (self.most - share) * fit)
        self.progress(f"{self.text}; {left} left")


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
