"""The interface of a format of records."""

from collections.abc import Callable
from typing import NamedTuple

from .table import Table


class Format(NamedTuple):
    """A format: how its files are known, and how one becomes a `Table`.

    `knows` and `parse` are given the contents of a file and its path, for messages and endings.
    `parse` raises `InputError` for contents that are damaged. `suffixes` are endings, ".csv", by
    which files of a folder of runs are found. `raw` gives the columns just as they were written,
    for a reduction; None: as `parse` does.
    """

    name: str
    knows: Callable[[bytes, str], bool]
    parse: Callable[[bytes, str], Table]
    suffixes: tuple[str, ...] = ()
    raw: Callable[[bytes, str], Table] | None = None
