"""The one exception that a user's input can raise.

Failures of a computation are values (a `result` on every result object). Invalid input raises
`InputError`: one line with the fault, its place and the remedy. The command prints that line and
exits with code 2.

The remedy names an option of the command (`--drop-bad`, `--steps '0 s: 2 um/s'`). In Python the
remedy names a Python argument (`drop_bad=True`, `steps="0 s: 2 um/s"`). The functions `option` and
`either` choose between option and argument.
"""

import contextlib
import difflib
import re
from collections.abc import Generator, Iterable

# Options of the command with another name in Python; all others have the same name.
_ARGUMENTS = {
    "column": "columns",
    "min-kp": "lower",
    "kp": "k_p",
    "cutoff": "the cutoff of preparation",
    "from": "the start of record.window()",
    "to": "the stop of record.window()",
}
_FLAGS = ("drop-bad", "fit-stiffness", "slip-trend", "zero-order-hold", "other-versions")
_BARE = re.compile(r"[\w.%/+=:,@-]+")
"""Values that a shell takes without quotes."""
_of_the_command = [False]
_LIKE = 0.55
"""Least similarity (at most 1) of a suggested name."""


@contextlib.contextmanager
def words_of_the_command() -> Generator[None]:
    """Within the `with` block `option` names options of the command, else Python arguments."""
    before, _of_the_command[0] = _of_the_command[0], True
    try:
        yield
    finally:
        _of_the_command[0] = before


class InputError(ValueError):
    """Invalid input: the fault, its place and the remedy, on one line."""

    def __init__(self, message: str):
        super().__init__(" ".join(str(message).split()))


def option(name: str, *values: object) -> str:
    """An option in a message, with its value if one is proposed: `--steps '0 s: 2 um/s'`.

    In Python the text is a Python argument instead. `either` serves for texts that differ in
    another way. The option `column` takes several values, each of the form ROLE=NAME.

    >>> option("drop-bad"), option("stiffness", "1.6e-3/um")
    ('drop_bad=True', 'stiffness="1.6e-3/um"')
    """
    texts = [str(value) for value in values]
    if _of_the_command[0]:
        shown = [text if _BARE.fullmatch(text) else f"'{text}'" for text in texts]
        return " ".join(f"--{name} {text}" for text in shown) or f"--{name}"
    argument = _ARGUMENTS.get(name, name.replace("-", "_"))
    if name in _FLAGS:
        return f"{argument}=True"
    if not texts:
        return argument
    if name == "column":
        pairs = (text.partition("=")[::2] for text in texts)
        return "columns={" + ", ".join(f'"{role}": "{column}"' for role, column in pairs) + "}"
    (text,) = texts
    if not argument.isidentifier():
        return f"{argument} ({text})"
    return f"{argument}={text}" if re.fullmatch(r"[\d.]+", text) else f'{argument}="{text}"'


def either(command: str, python: str) -> str:
    """Return the text for users of the command, or the text for users of Python."""
    return command if _of_the_command[0] else python


def did_you_mean(name: str, known: Iterable[str], *, listed: bool = True) -> str:
    """End of a message about an unknown `name`: the most similar known name, if there is one (of
    equals the one that begins alike, or the first), and (unless `listed` is False) all known names.

    >>> did_you_mean("frictoin", ["time", "friction"])
    "; did you mean 'friction'? There are: time, friction"
    """
    names, asked = list(known), folded(name)

    def likeness(one: str) -> tuple[float, bool]:
        key = folded(one)
        ratio = difflib.SequenceMatcher(None, key, asked).ratio()
        return ratio, key[:1] == asked[:1]

    likest = max(names, key=likeness, default="")
    hint = f"; did you mean '{likest}'?" if likest and likeness(likest)[0] >= _LIKE else ""
    if not listed:
        return hint
    return hint + (" There are: " if hint else "; there are: ") + ", ".join(names)


def folded(name: str) -> str:
    """A name without case, blanks and signs, to compare names: Load-Point_Disp is loadpointdisp."""
    return re.sub(r"[\W_]+", "", name.lower()).replace("µ", "μ")
