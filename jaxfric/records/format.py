"""The interface of a format of records."""

from collections.abc import Callable
from typing import NamedTuple

from .table import Table


class Format(NamedTuple):
    """A file format: `knows` recognises its files, and `parse` reads one as a `Table`.

    `knows` and `parse` take the contents of a file, and its path for messages and the suffix.
    `parse` raises `InputError` for damaged contents. `suffixes` such as ".csv" select the files in
    a folder of runs. `raw` returns the columns exactly as written, for a reduction script. `raw` is
    None if `parse` already does so.
    """

    name: str
    knows: Callable[[bytes, str], bool]
    parse: Callable[[bytes, str], Table]
    suffixes: tuple[str, ...] = ()
    raw: Callable[[bytes, str], Table] | None = None
