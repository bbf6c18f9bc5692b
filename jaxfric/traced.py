"""Functions that are traced once and kept on disk: the next process need not trace them again.

Before JAX can load what it compiled in another process it must trace the function anew, in Python;
for a model with every effect that takes far longer than to load it. `traced` is `eqx.filter_jit`
that keeps what was traced as StableHLO (`jax.export`) beside what was compiled, where
`cache_compiled` has turned that on; otherwise it is `eqx.filter_jit`.

What is kept is found again by everything it depends on: shapes and types of the arrays, all other
arguments, the text of this package, versions and settings of what traces it. Code that is neither
of this package nor of the libraries it is built on, such as an effect of your own, is never kept;
a file that cannot be read is made anew. The folder may be deleted at any time.
"""

import functools
import hashlib
import os
import pickle
import tempfile
import threading
import types
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

_OURS = __name__.split(".", maxsplit=1)[0]
_LIBRARIES = ("jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy")
_KNOWN = {_OURS, *_LIBRARIES, "builtins", "jaxtyping"}
_SETTINGS = ("jax_enable_x64", "jax_default_matmul_precision", "jax_numpy_dtype_promotion")

_CHECKED = [jax.export.DisabledSafetyCheck.custom_call(f"lapack_{kind}ormqr_ffi") for kind in "sd"]
"""Calls that may change with the version of jaxlib, which is in every name."""

_folder: list[Path] = []
"""The folder in which functions are kept; empty: none are."""

_tables: list[Mapping[str, object]] = []
"""Tables by whose names functions choose what they trace."""


def depends_on(table: Mapping[str, object]) -> None:
    """Say that functions trace what `table` has by names among their arguments."""
    _tables.append(table)


def keep_traced(folder: Path) -> None:
    """Keep functions in `folder` from now on, and take from there what is kept."""
    _folder[:] = [folder]


class _Kept(NamedTuple):
    """A function of arrays, and what becomes of its results."""

    call: Callable[..., tuple[Array, ...]]
    wrap: Callable[[tuple[Array, ...]], PyTree]


class _Compiled:
    """What is known of a function for some shapes; `ready` once it has been compiled."""

    def __init__(self):
        self.lock = threading.Lock()
        self.ready = False
        self.kept: _Kept | None = None


class Traced(Generic[P, R]):
    """A function as by `eqx.filter_jit`, kept on disk where that is on; see the module."""

    def __init__(self, function: Callable[P, R]):
        self.function: Callable[..., R] = function
        self.nested: Callable[..., R] = eqx.filter_jit(function)
        self._known: dict[tuple, _Compiled] = {}
        functools.update_wrapper(self, function)

    @functools.cached_property
    def jitted(self) -> Callable[..., R]:
        """What runs where nothing is kept."""
        return eqx.filter_jit(self.function, compiler_options=_quickly())  # ty: ignore[no-matching-overload]

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """The function of `args`. With arguments by name, or traced ones, as `eqx.filter_jit`."""
        leaves, tree = jax.tree.flatten(args)
        if kwargs or any(isinstance(x, Tracer) for x in leaves):
            return self.nested(*args, **kwargs)
        if not _folder:
            return self.jitted(*args)
        arrays, key = _like(leaves, tree)
        known = self._known.setdefault(key, _Compiled())
        if known.ready:
            return self._run(known.kept, args, arrays)
        with known.lock:  # a thread waits for what another traces and compiles
            if not known.ready:
                known.kept = self._found(args, key)
            out = self._run(known.kept, args, arrays)
            known.ready = True
        return out

    def _run(self, kept: _Kept | None, args: tuple, arrays: list[Array]) -> R:
        return self.jitted(*args) if kept is None else kept.wrap(kept.call(*arrays))

    def _found(self, args: tuple, key: tuple) -> _Kept | None:
        """The function for arguments like `args`, from its file or traced; None: not to be kept."""
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
        except Exception:  # whatever cannot be pickled is not kept
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
        except Exception:  # not all that can be compiled can be exported
            return None
        _write(file, blob)
        return _kept(seen[0], exported)


def traced(function: Callable[P, R]) -> Traced[P, R]:
    """A decorator: `Traced(function)`, for a function of the top level of a module."""
    return Traced(function)


def _like(leaves: list, tree: Hashable) -> tuple[list[Array], tuple]:
    """The arrays among the leaves of arguments, and all else that what is compiled depends on."""
    arrays = [x for x in leaves if eqx.is_array(x)]
    rest = tuple(None if eqx.is_array(x) else x for x in leaves)
    shapes = tuple((x.shape, x.dtype, getattr(x, "weak_type", False)) for x in arrays)
    return arrays, (_folder[0], tree, rest, shapes, _settings())


@functools.cache
def _quickly() -> dict[str, bool] | None:
    """Options of the compiler: without XLA's fusion emitters, which gain nothing in scans over rows
    and steps, it takes half as long. None where it has no such option."""
    options = {"xla_cpu_use_fusion_emitters": False}
    try:
        jax.jit(_itself, compiler_options=options).lower(0.0).compile()
    except Exception:  # an option that is not known is an error of the compiler's own kind
        return None
    return options


def _itself(x: Array) -> Array:
    return x


class _Place:
    """The place of an array in a result."""


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
    except Exception:  # not there, cut short, or of another version: made anew
        return None


def _write(file: Path, blob: bytes) -> None:
    """Write at once or not at all; a folder that cannot be written keeps nothing."""
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
    """The platform of what JAX computes on."""
    return "cpu" if on_processor() else jax.export.default_export_platform()


@functools.cache
def _versions() -> tuple[str, ...]:
    """Versions of the libraries, and a digest of every file of this package."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(file.read_bytes())
    return (*(version(name) for name in _LIBRARIES), digest.hexdigest())


def _of_known_code(x: object) -> bool:
    """Whether all types and functions in `x` are of modules whose text the name covers.

    One made within a function may close over anything: it is not known.
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
