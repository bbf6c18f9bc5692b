"""What JAX compiles: how its loops are, and keeping it for the next process."""

import os
from pathlib import Path

from .errors import InputError

_WHOLE = "xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold"
_BYTES = 2**27
_FIRST, _BY_ITSELF = (0, 8), (0, 12)
"""Versions of jaxlib: the first that has the flag, XLA ends a process that gives it an unknown one;
and the first that needs none."""


def cache_compiled(folder: str | Path | None = None) -> Path:
    """Keep compiled functions in a folder, for this process and later ones; the folder.

    Most of the time of a first fit or loop is tracing and compiling. This turns on JAX's own
    persistent cache for all that is compiled from now on, and keeps what was traced beside it, as
    the command does; nothing does so on import. Without a `folder` it is the one that JAX is set to
    already (JAX_COMPILATION_CACHE_DIR), else the one of the command, in the user's cache folder. It
    may be deleted at any time.

    Raises
    ------
    InputError : the folder cannot be made or written.
    """
    import jax
    from platformdirs import user_cache_dir

    from .traced import keep_traced

    given = folder or os.environ.get("JAX_COMPILATION_CACHE_DIR")
    target = Path(given) if given else Path(user_cache_dir("jaxfric")) / "compiled"
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{target} cannot hold a cache: {error.strerror}") from None
    if not os.access(target, os.W_OK):
        raise InputError(f"{target} cannot hold a cache: it is read-only")
    jax.config.update("jax_compilation_cache_dir", str(target))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    keep_traced(target / "traced")
    return target


def whole_loops() -> bool:
    """Have XLA compile a loop as one piece, in this process and those that it begins, as the
    command does; whether it will.

    By default XLA looks up what to compute next in every turn of a loop, which takes longer than a
    step of a solver or a row of a filter. Loops over up to 128 MiB of memory are made one function:
    a simulation takes 0.3 of the time, one of a batch 0.55, a loop 0.75 to 0.9. Set by `XLA_FLAGS`
    in the environment, so before anything is computed with JAX. Nothing where that has such an
    option already, for jaxlib before 0.8, and from 0.12 on, which does so by itself.
    """
    from importlib.metadata import version

    given = os.environ.get("XLA_FLAGS", "")
    known = tuple(int(part) for part in version("jaxlib").split(".")[:2])
    if known >= _BY_ITSELF:
        return True
    if _WHOLE.partition("=")[0] in given or known < _FIRST:
        return _WHOLE in given
    os.environ["XLA_FLAGS"] = f"{given} --{_WHOLE}={_BYTES}".strip()
    return True
