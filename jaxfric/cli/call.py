"""The user's request: the verb, the command line, the options that are not the default."""

import contextlib
import contextvars
import dataclasses
import inspect
import shlex
from collections.abc import Callable, Generator, Sequence
from typing import NamedTuple

LOOPS = ("loop", "axis")
"""Verbs whose results are those of a loop, and are kept under that name."""


class Call(NamedTuple):
    """One run of the command."""

    verb: str
    command: str
    """The whole command line, quoted for a shell."""
    given: dict[str, object]
    """Options that differ from their default, in the order of the verb's signature."""


_CURRENT: contextvars.ContextVar[Call] = contextvars.ContextVar("call")


def current_call() -> Call:
    """The call that is being run; an empty one outside of the command."""
    return _CURRENT.get(Call("", "", {}))


@contextlib.contextmanager
def calling(
    verb: Callable[..., object], bound: inspect.BoundArguments, words: Sequence[str]
) -> Generator[None]:
    """Within the block, `current_call` is this one."""
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
    """Options that differ from their default, those of a group by their own names."""
    given: dict[str, object] = {}
    for name, parameter in inspect.signature(verb).parameters.items():
        default, value = parameter.default, bound.arguments.get(name, parameter.default)
        if dataclasses.is_dataclass(default):
            names = [field.name for field in dataclasses.fields(default)]
            pairs = [(one, getattr(value, one), getattr(default, one)) for one in names]
            given |= {one: own for one, own, usual in pairs if own != usual}
        elif value != default:
            given[name] = value
    return given
