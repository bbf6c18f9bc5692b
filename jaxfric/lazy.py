"""Names of a package that are imported on first use, and names of an earlier version.

A package writes `__getattr__, __dir__ = loader(__name__, HOMES, ...)`. Importing such a package
loads no module; each name is imported once, on first use.
"""

import functools
import importlib
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar, cast

F = TypeVar("F", bound=Callable)


def loader(
    package: str,
    homes: Mapping[str, str] = {},
    modules: Iterable[str] = (),
    renamed: Mapping[str, str] = {},
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package.

    `homes` maps each name to the module of the package that defines the name ("rig.friction").
    `modules` lists modules and folders of the package that users import by name. A name in both
    `homes` and `modules` raises `ValueError`. `renamed` maps old names to new ones (`old_names`).
    """
    own, old = tuple(modules), old_names(package, renamed)
    if both := sorted(set(own) & set(homes)):
        raise ValueError(f"{package}: {', '.join(both)} would be a module and a name of one")

    def get(name: str) -> object:
        if name in own:
            return importlib.import_module(f".{name}", package)  # importing sets the attribute
        if name not in homes:
            return old(name)
        value = getattr(importlib.import_module(f".{homes[name]}", package), name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        kept = [name for name in vars(sys.modules[package]) if name.startswith("__")]
        return sorted({*kept, *own, *homes})

    return get, names


def old_names(package: str, renamed: Mapping[str, str]) -> Callable[[str], object]:
    """`__getattr__` of a package for names of an earlier version, which work for one more version.

    `renamed` maps each old name to the new name, or to the path of the new name below the package
    ("gains.find_gains"). Each use of an old name raises a `DeprecationWarning` at the caller's
    line.
    """

    def get(name: str) -> object:
        if name not in renamed:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        text = f"{package}.{name} is now {package}.{renamed[name]}"
        outside = 3 if sys._getframe(1).f_code.co_filename == __file__ else 2
        warnings.warn(text, DeprecationWarning, stacklevel=outside)
        home, _, own = renamed[name].rpartition(".")
        return getattr(importlib.import_module(f"{package}.{home}".rstrip(".")), own)

    return get


def old_arguments(**renamed: str) -> Callable[[F], F]:
    """Decorator: the decorated function also takes arguments under names of an earlier version.

    The old names work for one more version. `renamed` maps each old name to the new name. Each use
    of an old name raises a `DeprecationWarning` at the caller's line. A call with both the old and
    the new name raises `TypeError`.
    """

    def decorated(function: F) -> F:
        name = getattr(function, "__name__", "")

        @functools.wraps(function)
        def call(*args: object, **given: object) -> object:
            for old in [one for one in renamed if one in given]:
                new, value = renamed[old], given.pop(old)
                if new in given:
                    raise TypeError(f"{name}() got {new} and its old name {old}")
                text = f"the argument {old} of {name}() is now {new}"
                warnings.warn(text, DeprecationWarning, stacklevel=2)
                given[new] = value
            return function(*args, **given)

        return cast("F", call)

    return decorated
