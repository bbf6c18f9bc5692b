"""What the user asked for: the verb, the command line, the options that are not the default."""

import contextlib
import contextvars
import inspect
import shlex
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple


class Call(NamedTuple):
    """One run of the command."""

    verb: str
    command: str
    """The whole command line, quoted for a shell."""
    given: dict[str, Any]
    """Options that differ from their default, in the order of the verb's signature."""


_CURRENT: contextvars.ContextVar[Call] = contextvars.ContextVar("call")


def current_call() -> Call:
    """The call that is being run; an empty one outside of the command."""
    return _CURRENT.get(Call("", "", {}))


@contextlib.contextmanager
def calling(
    verb: Callable[..., object], bound: inspect.BoundArguments, words: Sequence[str]
) -> Iterator[None]:
    """Within the block, `current_call` is this one."""
    defaults = inspect.signature(verb).parameters
    given = {
        name: bound.arguments[name]
        for name, parameter in defaults.items()
        if name in bound.arguments and bound.arguments[name] != parameter.default
    }
    name = getattr(verb, "__name__", "")
    token = _CURRENT.set(Call(name, shlex.join(["jaxfric", *words]), given))
    try:
        yield
    finally:
        _CURRENT.reset(token)
