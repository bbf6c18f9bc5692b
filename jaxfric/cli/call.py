"""The current call of the command: verb, command line, and options that differ from the default."""

import contextlib
import contextvars
import dataclasses
import inspect
import shlex
from collections.abc import Callable, Generator, Sequence
from typing import NamedTuple

from ..report.version import installed_version

LOOPS = ("loop", "axis")
"""Verbs that write a loop's results, into folders named `loop`."""

_SPELT = {"since": "--from", "until": "--to", "more": "a further file"}
"""Options with another name in Python."""


class Call(NamedTuple):
    """One run of the command."""

    verb: str
    command: str
    """The whole command line, quoted for a shell."""
    given: dict[str, object]
    """Options that differ from their default, in the order of the verb's signature."""


_CURRENT: contextvars.ContextVar[Call] = contextvars.ContextVar("call")


def current_call() -> Call:
    """Return the running call of the command; outside of the command return an empty call."""
    return _CURRENT.get(Call("", "", {}))


def made_by() -> dict[str, str]:
    """Return version and command line of the running call; empty outside of the command."""
    command = current_call().command
    return {"version": installed_version(), "command": command} if command else {}


@contextlib.contextmanager
def calling(
    verb: Callable[..., object], bound: inspect.BoundArguments, words: Sequence[str]
) -> Generator[None]:
    """Make this call the `current_call` within the block."""
    given = _given(verb, bound)
    name = getattr(verb, "__name__", "")
    name = "loop" if name in LOOPS else name
    name = "compare" if given.pop("compare", False) else name
    token = _CURRENT.set(Call(name, shlex.join(["jaxfric", *words]), given))
    try:
        yield
    finally:
        _CURRENT.reset(token)


def _given(verb: Callable[..., object], bound: inspect.BoundArguments) -> dict[str, object]:
    """Return the options that differ from their default; a group counts as single options."""
    given: dict[str, object] = {}
    for name, parameter in inspect.signature(verb).parameters.items():
        default, value = parameter.default, bound.arguments.get(name, parameter.default)
        if dataclasses.is_dataclass(value):
            pairs = [(field, getattr(value, field.name)) for field in dataclasses.fields(value)]
            given |= {field.name: own for field, own in pairs if own != field.default}
        elif value != default:
            given[name] = value
    return given


def option_of(name: str) -> str:
    """Return the option of a name in Python, as a user types it."""
    return _SPELT.get(name) or f"--{name.strip('_').replace('_', '-')}"
