"""The listener of those who want none: a default that a signature shows by its name."""

from typing import final


@final
class NoListener:
    """Takes what is told of progress, and says nothing."""

    def __call__(self, text: str) -> None: ...

    def __repr__(self) -> str:
        return "silent"


silent = NoListener()
"""What `progress` is where nothing is given."""
