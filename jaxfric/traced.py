"""A disk cache of traced functions, so that later processes need not trace them again.

Before JAX can load a function compiled by another process, JAX must trace the function again in
Python. For a model with every effect, tracing takes far longer than loading. `traced` compiles as
`eqx.filter_jit` does; if `cache_compiled` was called, `traced` also stores the trace as StableHLO
(`jax.export`) in the cache.

The key of a cache entry is everything that the trace depends on: shapes and types of the arrays,
all other arguments, the source of this package, versions and settings of JAX and its libraries.
Functions with foreign code, such as an effect of your own, are never stored. An unreadable cache
file is replaced. You may delete the cache folder at any time.
"""

import functools
import hashlib
import os
import pickle
import tempfile
import threading
import types
from collections import UserDict
from collections.abc import Callable, Hashable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Generic, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.export
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, PyTree

from .threads import on_processor

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

_OURS = __name__.split(".", maxsplit=1)[0]
_LIBRARIES = ("jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy")
_KNOWN = {_OURS, *_LIBRARIES, "builtins", "jaxtyping"}
_SETTINGS = ("jax_enable_x64", "jax_default_matmul_precision", "jax_numpy_dtype_promotion")

_CHECKED = [jax.export.DisabledSafetyCheck.custom_call(f"lapack_{kind}ormqr_ffi") for kind in "sd"]
"""Calls that may change with the version of jaxlib, which is part of every key."""

_folder: list[Path] = []
"""The folder of the cache; empty: no cache."""

_tables: list[Mapping[str, object]] = []
"""Tables whose contents traced functions look up by name, so that they are part of every key."""

_since: list[int] = [0]
"""Number of times that compiled functions were forgotten: part of every key in memory."""


class Registry(UserDict[str, T]):
    """A table whose entries compiled functions look up by names that are arguments.

    If an entry is replaced or removed, JAX forgets every compiled function. Otherwise functions
    that were compiled with the old entry would go on with it.
    """

    def __init__(self, entries: Mapping[str, T]):
        super().__init__(entries)
        _tables.append(self)

    def __setitem__(self, key: str, item: T) -> None:
        """Add or replace an entry."""
        if self.data.get(key, item) is not item:
            _forget()
        super().__setitem__(key, item)

    def __delitem__(self, key: str) -> None:
        """Remove an entry."""
        _forget()
        super().__delitem__(key)


def _forget() -> None:
    _since[0] += 1
    jax.clear_caches()


def keep_traced(folder: Path) -> None:
    """Use `folder` as the cache of traced functions from now on."""
    _folder[:] = [folder]


class _Kept(NamedTuple):
    """A cached function of arrays, and the function that rebuilds its result."""

    call: Callable[..., tuple[Array, ...]]
    wrap: Callable[[tuple[Array, ...]], PyTree]


class _Compiled:
    """State of a function for one key of shapes; `ready` once it is compiled."""

    def __init__(self):
        self.lock = threading.Lock()
        self.ready = False
        self.kept: _Kept | None = None


class Traced(Generic[P, R]):
    """A function compiled as by `eqx.filter_jit`, with an optional disk cache; see the module."""

    def __init__(self, function: Callable[P, R]):
        self.function: Callable[..., R] = function
        self.nested: Callable[..., R] = eqx.filter_jit(function)
        self._known: dict[tuple, _Compiled] = {}
        functools.update_wrapper(self, function)

    @functools.cached_property
    def jitted(self) -> Callable[..., R]:
        """The compiled function that is used without the disk cache."""
        return eqx.filter_jit(self.function, compiler_options=_quickly())  # ty: ignore[no-matching-overload]

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the function; keyword or traced arguments bypass the cache, as `eqx.filter_jit`."""
        leaves, tree = jax.tree.flatten(args)
        if kwargs or any(isinstance(x, Tracer) for x in leaves):
            return self.nested(*args, **kwargs)
        if not _folder:
            return self.jitted(*args)
        arrays, key = _like(leaves, tree)
        known = self._known.setdefault(key, _Compiled())
        if known.ready:
            return self._run(known.kept, args, arrays)
        with known.lock:  # other threads wait while one traces and compiles
            if not known.ready:
                known.kept = self._found(args, key)
            out = self._run(known.kept, args, arrays)
            known.ready = True
        return out

    def _run(self, kept: _Kept | None, args: tuple, arrays: list[Array]) -> R:
        return self.jitted(*args) if kept is None else kept.wrap(kept.call(*arrays))

    def _found(self, args: tuple, key: tuple) -> _Kept | None:
        """The function for arguments like `args`, from its file or traced; None: not cacheable."""
        name = self._name(args, key)
        if name is None:
            return None
        file = _folder[0] / f"{self.function.__name__}-{name}"  # ty: ignore[missing-attribute]
        return _read(file) or self._trace(args, file)

    def _name(self, args: tuple, key: tuple) -> str | None:
        like = jax.tree.map(lambda x: None if eqx.is_array(x) else x, args)
        own = self.function.__module__, self.function.__qualname__  # ty: ignore[missing-attribute]
        tables = [dict(table) for table in _tables]
        if not _of_known_code((like, self.function, tables)):
            return None
        try:
            text = pickle.dumps((own, like, tables, *key[3:], _versions()), protocol=4)
        except Exception:  # what cannot be pickled is not cached
            return None
        return hashlib.sha256(text).hexdigest()[:32]

    def _trace(self, args: tuple, file: Path) -> _Kept | None:
        arrays, rest = eqx.partition(args, eqx.is_array)
        leaves, tree = jax.tree.flatten(arrays)
        seen: list[bytes] = []

        def flat(*leaves: Array) -> tuple[Array, ...]:
            out = self.function(*eqx.combine(jax.tree.unflatten(tree, leaves), rest))
            found, other = eqx.partition(out, eqx.is_array)
            like = jax.tree.map(lambda x: _Place(), found), other
            seen[:] = [pickle.dumps(like, protocol=4)]
            return tuple(jax.tree.leaves(found))

        try:
            how = {"platforms": (_platform(),), "disabled_checks": _CHECKED}
            exported = jax.export.export(jax.jit(flat), **how)(*leaves)  # ty: ignore[invalid-argument-type]
            blob = pickle.dumps((seen[0], bytes(exported.serialize())), protocol=4)
        except Exception:  # some functions can be compiled but not exported
            return None
        _write(file, blob)
        return _kept(seen[0], exported)


def traced(function: Callable[P, R]) -> Traced[P, R]:
    """Decorate a function at the top level of a module with `Traced`."""
    return Traced(function)


def _like(leaves: list, tree: Hashable) -> tuple[list[Array], tuple]:
    """Return the arrays among the leaves of arguments, and the key of the compiled function."""
    arrays = [x for x in leaves if eqx.is_array(x)]
    rest = tuple(None if eqx.is_array(x) else x for x in leaves)
    shapes = tuple((x.shape, x.dtype, getattr(x, "weak_type", False)) for x in arrays)
    return arrays, ((_folder[0], *_since), tree, rest, shapes, _settings())


@functools.cache
def _quickly() -> dict[str, bool] | None:
    """Options that halve compile time: no XLA fusion emitters, which gain nothing in scans over
    rows and steps. None if the compiler has no such option."""
    options = {"xla_cpu_use_fusion_emitters": False}
    try:
        jax.jit(_itself, compiler_options=options).lower(0.0).compile()
    except Exception:  # the compiler has its own error type for unknown options
        return None
    return options


def _itself(x: Array) -> Array:
    return x


class _Place:
    """Placeholder of an array in a result."""


def _kept(like: bytes, exported: jax.export.Exported) -> _Kept:
    found, other = pickle.loads(like)
    tree = jax.tree.structure(found)

    def wrap(arrays: tuple[Array, ...]) -> PyTree:
        return eqx.combine(jax.tree.unflatten(tree, arrays), other)

    return _Kept(jax.jit(exported.call, compiler_options=_quickly()), wrap)


def _read(file: Path) -> _Kept | None:
    try:
        like, blob = pickle.loads(file.read_bytes())
        return _kept(like, jax.export.deserialize(bytearray(blob)))
    except Exception:  # missing, truncated, or of another version: replaced
        return None


def _write(file: Path, blob: bytes) -> None:
    """Write a file atomically; ignore a folder that cannot be written."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as part:
            part.write(blob)
        os.replace(part.name, file)
    except OSError:
        return


def _settings() -> tuple:
    return (_platform(), *(getattr(jax.config, name, None) for name in _SETTINGS))


def _platform() -> str:
    """The platform on which JAX computes."""
    return "cpu" if on_processor() else jax.export.default_export_platform()


@functools.cache
def _versions() -> tuple[str, ...]:
    """Versions of the libraries, and a digest of every file of this package."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(file.read_bytes())
    return (*(version(name) for name in _LIBRARIES), digest.hexdigest())


def _of_known_code(x: object) -> bool:
    """Whether all types and functions in `x` are from modules whose source is part of the key.

    A function defined inside another may close over anything, so it does not count.
    """
    if x is None or isinstance(x, str | bytes | bool | int | float | complex | np.dtype | Path):
        return True
    if isinstance(x, type | types.FunctionType):
        own = x.__module__.split(".", maxsplit=1)[0] in _KNOWN
        return own and "<" not in x.__qualname__ and not getattr(x, "__closure__", None)
    if not _of_known_code(type(x)):
        return False
    if isinstance(x, dict):
        return all(_of_known_code(part) for pair in x.items() for part in pair)
    if isinstance(x, tuple | list | frozenset | set):
        return all(_of_known_code(part) for part in x)
    if isinstance(x, np.ndarray | np.generic):
        return True
    return (
        all(_of_known_code(part) for part in vars(x).values()) if hasattr(x, "__dict__") else False
    )
