"""Names that a package gives and loads when they are first used.

A package writes `__getattr__, __dir__ = loader(__name__, HOMES, ...)`: importing it loads nothing,
and what is asked for is imported once and kept.
"""

import importlib
import sys
from collections.abc import Callable, Iterable, Mapping


def loader(
    package: str, homes: Mapping[str, str] = {}, modules: Iterable[str] = ()
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package.

    `homes` has, for each name, the module of the package that defines it ("rig.friction");
    `modules` are modules and folders of the package that are given themselves. A name that is both
    would mean two things: it is refused.
    """
    own = tuple(modules)
    if both := sorted(set(own) & set(homes)):
        raise ValueError(f"{package}: {', '.join(both)} would be a module and a name of one")

    def get(name: str) -> object:
        if name in own:
            return importlib.import_module(f".{name}", package)  # which keeps it, too
        if name not in homes:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value = getattr(importlib.import_module(f".{homes[name]}", package), name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        kept = [name for name in vars(sys.modules[package]) if name.startswith("__")]
        return sorted({*kept, *own, *homes})

    return get, names
