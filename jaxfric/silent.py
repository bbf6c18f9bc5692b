"""The no-op progress callback, a default that is readable in signatures."""

from typing import final


@final
class NoListener:
    """A progress callback that ignores its text."""

    def __call__(self, text: str) -> None: ...

    def __repr__(self) -> str:
        return "silent"


silent = NoListener()
"""The default of `progress`."""
