"""NAME=VALUE texts: parameters of a law, starting values, margins, columns of a record."""

from collections.abc import Sequence

from .errors import InputError


def read_pairs(
    given: str | Sequence[str], what: str, example: str, *, form: str = "NAME=VALUE"
) -> dict[str, str]:
    """Read texts by name, in order, from "A=1 N, L=1 mm" or from several texts such as "A=1 N".

    Error messages use `what` (the kind of the texts), an `example` and the `form` of a pair.

    Raises
    ------
    InputError : a piece without name or value; a name given twice.
    """
    pieces = filter(str.strip, given.split(",")) if isinstance(given, str) else given
    found: dict[str, str] = {}
    for piece in map(str.strip, pieces):
        name, _, value = (part.strip() for part in piece.partition("="))
        if not (name and value):
            raise InputError(f"{what} '{piece}' is not {form}, as in {example}")
        if name in found:
            raise InputError(f"{what}: {name} is given twice")
        found[name] = value
    return found
