"""Keeping what JAX compiles for the next process."""

import os
from pathlib import Path

from .errors import InputError


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
