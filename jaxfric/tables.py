"""Read a TOML file and its tables; refuse unknown keys and values of a wrong type."""

import contextlib
import hashlib
import math
import tomllib
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path

from .errors import InputError, did_you_mean
from .units import parse_quantity

Table = Mapping[str, object]
"""A table of a TOML file; its values are checked when they are read."""


def read_text(path: Path, errors: str = "strict") -> str:
    """Read a text in UTF-8; `errors` as for `bytes.decode`.

    Raises `InputError` for a file that does not exist, cannot be read or is no text.
    """
    try:
        return path.read_bytes().decode("utf-8", errors)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text: {error}") from None


def read_toml(path: Path) -> tuple[str, dict[str, object]]:
    """Return the text of a TOML file, and its content. Raises `InputError`, as `read_text` does."""
    text = read_text(path)
    try:
        return text, tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is no TOML: {error}") from None


@contextlib.contextmanager
def placed(where: str) -> Generator[None]:
    """Add the name of the place to every `InputError` raised in the block."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def flag(table: Table, key: str, where: str, *, usual: bool = False) -> bool:
    """Read a key that is true or false; return `usual` if the key is missing."""
    found = table.get(key, usual)
    if not isinstance(found, bool):
        raise InputError(f"{where}: {key} is {found!r}; it is true or false")
    return found


def names_of(content: Table, key: str, where: str) -> tuple[str, ...] | None:
    """Return a list of distinct names, or None if the key is missing."""
    if key not in content:
        return None
    found = content[key]
    if not isinstance(found, list) or not all(isinstance(x, str) for x in found) or not found:
        raise InputError(f"{where}: {key} is a list of names, as in {key} = ['margins']")
    return tuple(dict.fromkeys(found))


def whole(content: Table, key: str, where: str, least: int = 1) -> int | None:
    """Return an integer of at least `least`, or None if the key is missing."""
    if key not in content:
        return None
    found = content[key]
    if isinstance(found, bool) or not isinstance(found, int) or found < least:
        raise InputError(f"{where}: {key} is {found!r}; it is a whole number from {least}")
    return found


def table_of(content: Table, name: str, where: str) -> dict[str, object]:
    """Return a table; an empty one if it is missing."""
    found = content.get(name, {})
    if not isinstance(found, dict):
        raise InputError(f"{where}: {name} is a table, [{name}]")
    return found


def refuse_unknown(table: Table, known: Sequence[str], where: str) -> None:
    """Raise `InputError` for a key that is not `known`; the message names the nearest known key."""
    for key in table:
        if key not in known:
            raise InputError(f"{where}: no key '{key}'{did_you_mean(key, known)}")


def file_of(name: object, path: Path, where: str, files: dict[str, str]) -> Path:
    """Return the path of a file named in the study, relative to the folder of study.toml."""
    if not isinstance(name, str):
        raise InputError(f"{where}: {name!r} is no name of a file")
    found = path.parent / name
    try:
        files[name] = hashlib.sha256(found.read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise InputError(f"{where}: {found}: {error.strerror}") from None
    return found


def number(content: object, unit: str, where: str) -> float:
    """Read a number in SI from a text with a unit or, if `unit` is "1", from a plain number.

    Raises
    ------
    InputError : the text is no number with a unit, or has an unsuitable unit.
    """
    if isinstance(content, bool) or not isinstance(content, str | int | float):
        raise InputError(f"{where}: {content!r} is no quantity; write it as in '3 um'")
    if not isinstance(content, str):
        if unit != "1":
            raise InputError(f"{where}: {content} has no unit; write it as '{content} {unit}'")
        if not math.isfinite(content):
            raise InputError(f"{where}: {content} is not a finite number")
        return float(content)
    return parse_quantity(content, unit, where)


def positive(table: Table, key: str, unit: str, where: str) -> float | None:
    """Return a positive quantity of a table in SI, or None if the key is missing."""
    if key not in table:
        return None
    found = number(table[key], unit, f"{where} {key}")
    if not found > 0:
        raise InputError(f"{where}: {key} is {found:g} {unit}; it must be positive")
    return found
