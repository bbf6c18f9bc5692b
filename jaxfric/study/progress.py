"""Progress of a run, and an estimate of the remaining time."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """Progress of a run."""

    blocks: int
    """Number of blocks of the study."""
    written: int
    members: int
    """Number of members that this run computed."""
    rate: float
    """Members per second since the first block, which compiles; nan before the second block."""
    left: float
    """Remaining seconds at that rate."""


@dataclass
class Clock:
    """Counts written blocks, `total` in the study, and reports progress."""

    total: int
    written: int
    progress: Callable[[Progress], None] | None
    members: int = 0
    compiled: tuple[float, int, int] | None = None
    """Time, blocks and members of the first block, which compiles."""

    def count(self, members: int) -> None:
        """Count another block."""
        self.written += 1
        self.members += members
        if self.progress is not None:
            now = time.monotonic()
            if self.compiled is None:
                self.compiled = now, self.written, self.members
            since, written, members = self.compiled
            todo = self.total - self.written
            fresh = self.written - written
            left = (now - since) / fresh * todo if fresh else (0.0 if todo == 0 else math.nan)
            rate = (self.members - members) / (now - since) if fresh else math.nan
            self.progress(Progress(self.total, self.written, self.members, rate, left))

    def text(self) -> str:
        """Return a sentence on the number of written chunks, and on how to continue the study."""
        return f"{self.written} of {self.total} chunks are written; continue with the same command"
