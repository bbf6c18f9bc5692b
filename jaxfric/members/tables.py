"""Reading the tables of a study.toml: every key known, every value of its kind."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..errors import InputError, did_you_mean

Table = Mapping[str, object]
"""A table of a study.toml, whose values are checked where they are read."""


def names_of(content: Table, key: str, where: str) -> tuple[str, ...] | None:
    """A list of names, each once; None where there is none."""
    if key not in content:
        return None
    found = content[key]
    if not isinstance(found, list) or not all(isinstance(x, str) for x in found) or not found:
        raise InputError(f"{where}: {key} is a list of names, as in {key} = ['margins']")
    return tuple(dict.fromkeys(found))


def whole(content: Table, key: str, where: str, least: int = 1) -> int | None:
    """A whole number from `least`; None where there is none."""
    if key not in content:
        return None
    found = content[key]
    if isinstance(found, bool) or not isinstance(found, int) or found < least:
        raise InputError(f"{where}: {key} is {found!r}; it is a whole number from {least}")
    return found


def table_of(content: Table, name: str, where: str) -> dict[str, object]:
    """A table, empty where there is none."""
    found = content.get(name, {})
    if not isinstance(found, dict):
        raise InputError(f"{where}: {name} is a table, [{name}]")
    return found


def refuse_unknown(table: Table, known: Sequence[str], where: str) -> None:
    """Raise `InputError` for a key that is not `known`; the nearest is named."""
    for key in table:
        if key not in known:
            raise InputError(f"{where}: no key '{key}'{did_you_mean(key, known)}")


def file_of(name: object, path: Path, where: str, files: dict[str, str]) -> Path:
    """A file named in the study, taken from the folder of the study.toml."""
    if not isinstance(name, str):
        raise InputError(f"{where}: {name!r} is no name of a file")
    found = path.parent / name
    try:
        files[name] = hashlib.sha256(found.read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise InputError(f"{where}: {found}: {error.strerror}") from None
    return found
