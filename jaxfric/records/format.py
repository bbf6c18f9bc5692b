"""The interface of a format of records."""

from collections.abc import Callable
from typing import NamedTuple

from .table import Table


class Format(NamedTuple):
    """A file format: `knows` recognises files of the format, `parse` reads a file as a `Table`.

    `knows` and `parse` take the contents and the path of a file. The path gives the suffix, and
    names the file in messages. `parse` raises `InputError` for damaged contents. `suffixes` such as
    ".csv" select the files in a folder of runs. `raw` returns the columns exactly as written, for a
    reduction script. `raw` is None if `parse` already returns columns as written.
    """

    name: str
    knows: Callable[[bytes, str], bool]
    parse: Callable[[bytes, str], Table]
    suffixes: tuple[str, ...] = ()
    raw: Callable[[bytes, str], Table] | None = None
