"""The one exception that a user's input can raise.

Failures of a computation are values (a `result` on every result object). Invalid input raises
`InputError`: one line with the fault, its place and the remedy. The command prints that line and
exits with code 2.

Messages name options of the command (`--drop-bad`, `--steps '0 s: 2 um/s'`). Outside of the command
they are translated to Python arguments (`drop_bad=True`, `steps="0 s: 2 um/s"`).
"""

import contextlib
import difflib
import re
from collections.abc import Generator, Iterable

# Options of the command with another name in Python; all others have the same name.
_ARGUMENTS = {
    "include": "with_",
    "exclude": "without",
    "max-effects": "most",
    "zero-order-hold": "held",
    "refit": "free",
    "fade-speed": "fade",
    "flip-sign": "flip",
    "downsample-to": "rows",
    "min-kp": "lower",
    "kp": "k_p",
    "cutoff": "the cutoff of preparation",
    "from": "the start of record.window()",
    "to": "the stop of record.window()",
}
_OF_OTHERS = ("nthreads",)
"""Options of other programs, which are not translated."""
_FLAGS = ("drop-bad", "fit-stiffness", "slip-trend", "zero-order-hold", "other-versions")
_NUMBERS = ("normal-force",)
"""Arguments that are SI numbers in Python; the option is a text with a unit."""
_COLUMN = re.compile(r"--column (?:'([\w ]+)=([^']*)'|(\w+)=(\w+))")
_OPTION = re.compile(
    r"--(?P<name>[a-z][a-z-]*[a-z])"
    r"(?: '(?P<quoted>[^']*)'| (?P<bare>\d(?:\S*[\w%])?)| (?P<word>force|motion|axis)\b)?"
)
_of_the_command = [False]
_LIKE = 0.55
"""Least similarity (at most 1) of a suggested name."""


@contextlib.contextmanager
def words_of_the_command() -> Generator[None]:
    """Inside this context errors name options of the command, outside Python arguments."""
    before, _of_the_command[0] = _of_the_command[0], True
    try:
        yield
    finally:
        _of_the_command[0] = before


class InputError(ValueError):
    """Invalid input: the fault, its place and the remedy, on one line."""

    def __init__(self, message: str):
        text = " ".join(str(message).split())
        super().__init__(text if _of_the_command[0] else in_python(text))


def did_you_mean(name: str, known: Iterable[str], *, listed: bool = True) -> str:
    """End of a message about an unknown `name`: the most similar known name, if there is one, and
    (unless `listed` is False) all known names.

    >>> did_you_mean("frictoin", ["time", "friction"])
    "; did you mean 'friction'? There are: time, friction"
    """
    names = list(known)
    by_key = {folded(one): one for one in names}
    close = difflib.get_close_matches(folded(name), by_key, n=1, cutoff=_LIKE)
    hint = f"; did you mean '{by_key[close[0]]}'?" if close else ""
    if not listed:
        return hint
    return hint + (" There are: " if hint else "; there are: ") + ", ".join(names)


def folded(name: str) -> str:
    """A name without case, blanks and signs, for comparison: Load-Point_Disp is loadpointdisp."""
    return re.sub(r"[\W_]+", "", name.lower()).replace("µ", "μ")


def in_python(text: str) -> str:
    """Translate the command's options in a message to Python arguments."""
    text = _COLUMN.sub(_column, text).replace('"} columns={"', '", "')
    text = text.replace("--column", "columns").replace("--rig axis", "jaxfric.read_axis")
    return _OPTION.sub(_argument, text)


def _column(found: re.Match) -> str:
    role, name = (found[1], found[2]) if found[1] else (found[3], found[4])
    return f'columns={{"{role}": "{name}"}}'


def _argument(found: re.Match) -> str:
    name: str = found["name"]
    said = _ARGUMENTS.get(name, name.replace("-", "_"))
    if name in _FLAGS:
        rest = found[0][len(name) + 2 :]
        return f"{said}=True{rest}"
    if name in _OF_OTHERS:
        return found[0]
    value: str | None = found["quoted"] or found["bare"] or found["word"]
    if value is None:
        return said
    if name in _NUMBERS:
        value = value.split()[0]
    if not said.isidentifier():
        return f"{said} ({value})"
    return f"{said}={value}" if re.fullmatch(r"[\d.]+", value) else f'{said}="{value}"'
