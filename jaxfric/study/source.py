"""Fingerprints (checksums) of the code and package versions that compute results.

A store belongs to one function, including all code that the function refers to. A store also
belongs to the versions of the packages that jaxfric uses. All workers of a cluster must have the
same function and versions. The byte code is compared, not the text. So comments, or edits of a file
after loading, do not matter.
"""

import dataclasses
import dis
import functools
import hashlib
import pickle
import sys
import types
from collections.abc import Iterable
from importlib.metadata import (
    PackageNotFoundError,
    distribution,
    packages_distributions,
    version,
)
from pathlib import Path
from typing import Any

import numpy as np

_PACKAGE = Path(__file__).resolve().parents[1]
# Folders of the package that do not compute results.
_WORDS = ("cli", "plot", "report")
_COMPUTING = ("jaxfric", "jax", "jaxlib", "diffrax", "equinox", "optimistix", "lineax")
_COMPUTING += ("numpy", "scipy")
CODE = "code of jaxfric"
"""Key of `versions` for the package's own source, which changes between releases."""


def versions() -> dict[str, str]:
    """Return versions of Python and of the packages used, and a checksum of jaxfric."""
    found = {"python": f"{sys.version_info[0]}.{sys.version_info[1]}"}
    for name in _COMPUTING:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found | {CODE: package_source()}


def other_versions(then: dict[str, str], now: dict[str, str]) -> list[str]:
    """Return a text on the versions that differ, such as "scipy 1.15 -> 1.16"."""
    return [
        f"{name} {then.get(name, 'missing')} -> {now.get(name, 'missing')}"
        for name in {**then, **now}
        if then.get(name) != now.get(name)
    ]


@functools.cache
def package_source() -> str:
    """Return a checksum of all modules of jaxfric that compute results."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        place = path.relative_to(_PACKAGE)
        if place.parts[0] not in _WORDS:
            digest.update(place.as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


def belongs_to_package(function: object) -> bool:
    """Whether a function, a class, or the class of an object, belongs to jaxfric."""
    function = getattr(function, "__wrapped__", function)
    kind = function if isinstance(function, types.FunctionType | type) else type(function)
    return (kind.__module__ or "").partition(".")[0] == __name__.partition(".")[0]


def own_code(function: object) -> dict[str, str]:
    """Return checksums of the user's code in the function of a study; `versions` covers the rest.

    A function of the package may tell by its method `own` what it uses of the user.
    """
    if belongs_to_package(function):
        return getattr(function, "own", dict)()
    return {"source of the function": fingerprint(function)}


def fingerprint(function: object) -> str:
    """Return a checksum of a function: byte code, defaults, closure, and used globals.

    The checksum follows functions, classes and modules of the user recursively, and the attributes
    of modules that functions read. Functions of installed packages enter the checksum by name. If
    `versions` lacks their package, its version and files enter too. Arrays enter by their values.
    """
    walk = _Walk()
    walk.add(function)
    return walk.digest.hexdigest()[:16]


class _Walk:
    """One pass over everything that a function refers to; each object is entered once."""

    def __init__(self):
        self.digest = hashlib.sha256()
        self.seen: dict[int, int] = {}
        self.kept: list[object] = []  # keeps objects alive, so that no address is reused

    def add(self, x: object) -> None:
        """Add any object to the checksum."""
        if x is None or isinstance(x, bool | int | float | complex | str | bytes):
            return self._say(type(x).__name__, repr(x))
        if id(x) in self.seen:
            return self._say("again", self.seen[id(x)])
        self.seen[id(x)] = len(self.seen)
        self.kept.append(x)
        self._say(type(x).__name__)
        self._add_compound(x)

    def _say(self, *words: object) -> None:
        self.digest.update("\0".join(map(str, words)).encode() + b"\1")

    def _add_compound(self, x: object) -> None:
        if isinstance(x, types.CodeType):
            self._code(x)
        elif isinstance(x, types.FunctionType):
            self._function(x)
        elif isinstance(x, types.ModuleType):
            self._module(x)
        elif isinstance(x, type):
            self._class(x)
        elif isinstance(x, list | tuple):
            self._all(x)
        elif isinstance(x, dict):
            self._all(part for item in x.items() for part in item)
        elif isinstance(x, set | frozenset):
            self._say(*sorted(map(fingerprint, x)))
        elif isinstance(x, types.MethodType):
            self._all((x.__func__, x.__self__))
        elif isinstance(x, functools.partial):
            self._all((x.func, x.args, x.keywords))
        elif hasattr(x, "__array__") and hasattr(x, "dtype"):
            array = np.asarray(x)
            self._say(array.dtype, array.shape, hashlib.sha256(array.tobytes()).hexdigest())
        elif callable(inner := getattr(x, "__wrapped__", None)):  # compiled by jax.jit, cached, ...
            self.add(inner)
        else:
            self._object(x)

    def _all(self, parts: Iterable[object]) -> None:
        for part in parts:
            self.add(part)
        self._say("end")

    def _code(self, code: types.CodeType) -> None:
        self._say(code.co_code.hex(), *code.co_names, *code.co_varnames, code.co_argcount)
        self._all(code.co_consts)

    def _function(self, function: types.FunctionType) -> None:
        self._say(function.__qualname__)
        self.add(function.__code__)
        self._all((function.__defaults__, function.__kwdefaults__))
        for cell in function.__closure__ or ():
            try:
                self.add(cell.cell_contents)
            except ValueError:  # an empty cell: a function that refers to itself
                self._say("empty")
        if self._stops_at(function.__module__):
            return
        looked_up = _names_in(function.__code__, "LOAD_GLOBAL", "LOAD_NAME")
        attributes = _names_in(function.__code__, "LOAD_ATTR", "LOAD_METHOD")
        self._read(function.__globals__, looked_up, attributes)

    def _read(self, space: dict[str, Any], names: set[str], attributes: set[str]) -> None:
        """Add the objects of these names and, from the user's modules among them, `attributes`."""
        for name in sorted(names & space.keys()):
            part = space[name]
            self._say(name)
            self.add(part)
            if isinstance(part, types.ModuleType) and not _installed(part.__name__):
                self._read(vars(part), attributes, attributes - {name})

    def _stops_at(self, module: str | None) -> bool:
        """Whether a module is not followed, as not the user's; if so, add its package's release."""
        if not module or not _installed(module):
            return False
        self._say(*_release(module.partition(".")[0]))
        return True

    def _class(self, kind: type) -> None:
        self._say(kind.__name__)  # a class that travels loses its __qualname__
        if self._stops_at(kind.__module__):
            return
        self._all(kind.__bases__)
        for name, part in sorted(vars(kind).items()):
            part = getattr(part, "__func__", getattr(part, "fget", part))
            if isinstance(part, types.FunctionType) or not name.startswith("__"):
                self._say(name)
                self.add(part)

    def _module(self, module: types.ModuleType) -> None:
        self._say(module.__name__)
        file = getattr(module, "__file__", None)
        if file is None or self._stops_at(module.__name__):
            return
        try:
            self._say(hashlib.sha256(Path(file).read_bytes()).hexdigest())
        except OSError:
            self._say("no file")
        own = vars(module)
        self._all(own[n] for n in sorted(own) if isinstance(own[n], types.ModuleType))

    def _object(self, x: object) -> None:
        self.add(type(x))
        if dataclasses.is_dataclass(x):
            self._all(getattr(x, field.name, None) for field in dataclasses.fields(x))
        elif not isinstance(x, types.BuiltinFunctionType) and getattr(x, "__dict__", None):
            self._all(part for name in sorted(vars(x)) for part in (name, vars(x)[name]))
        else:
            try:
                self._say(hashlib.sha256(pickle.dumps(x, 4)).hexdigest())
            except Exception:  # a file or a lock: only its type is added
                self._say(getattr(x, "__qualname__", ""))


def _names_in(code: types.CodeType, *instructions: str) -> set[str]:
    """Return the names that these instructions of a function, and of functions inside it, take."""
    found = {i.argval for i in dis.get_instructions(code) if i.opname in instructions}
    for part in code.co_consts:
        if isinstance(part, types.CodeType):
            found |= _names_in(part, *instructions)
    return found


@functools.cache
def _release(top: str) -> list[str]:
    """Return the version and checksums of an installed package, unless `versions` covers it."""
    if top in (*sys.builtin_module_names, *sys.stdlib_module_names, *_COMPUTING):
        return []
    found = []
    for name in sorted(set(packages_distributions().get(top, ()))):
        about = distribution(name)
        files = [f for f in about.files or () if f.parts[0].removesuffix(".py") == top]
        checksums = sorted(f"{f} {f.hash.value}" for f in files if f.suffix == ".py" and f.hash)
        found += [name, about.version, *checksums]
    return found


def _installed(module: str | None) -> bool:
    """Whether a module belongs to Python, to an installed package, or to jaxfric."""
    if not module or module == "__main__":
        return False
    top, own = module.partition(".")[0], __name__.partition(".")[0]
    if top in (own, *sys.builtin_module_names, *sys.stdlib_module_names):
        return True
    file = getattr(sys.modules.get(module), "__file__", None) or ""
    return bool({"site-packages", "dist-packages"} & set(Path(file).parts))
