"""Figures and pages, drawn after the numbers are written: a figure that fails loses only itself."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

from ..errors import InputError
from ..report.output import output_folder


class Drawing:
    """Draws into a folder that holds the numbers already.

    What cannot be drawn is one warning; the rest is drawn, and the exit code is 1.
    """

    def __init__(self, destination: Path):
        self.destination = destination
        self.names: list[str] = []
        """Files that were written."""
        self.code: int | None = None
        """The exit code of the verb: 1 where something is missing."""

    def __call__(self, what: str, draw: Callable[[Path], list[str]]) -> None:
        """Have `draw` write `what` to the folder that it is given; it returns the names."""
        try:
            with output_folder(self.destination) as folder:
                self.names += draw(folder)
        except KeyboardInterrupt:
            print(
                f"jaxfric: interrupted at {what}; the numbers are in {self.destination}/",
                file=sys.stderr,
            )
            raise SystemExit(130) from None
        except Exception as error:
            if os.environ.get("JAXFRIC_DEBUG"):
                raise
            self.code = 1
            print(f"jaxfric: warning: {self._told(what, error)}", file=sys.stderr)

    def _told(self, what: str, error: Exception) -> str:
        reason = " ".join(str(error).split())
        if isinstance(error, InputError):
            return f"{what} was not drawn: {reason}"
        return (
            f"{what} was not drawn ({type(error).__name__}: {reason}); all else is in"
            f" {self.destination}/. Please report it; JAXFRIC_DEBUG=1 shows where"
        )
