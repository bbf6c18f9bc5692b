"""A cache of compiled functions for later processes."""

import os
from pathlib import Path

from .errors import InputError


def cache_compiled(folder: str | Path | None = None) -> Path:
    """Cache compiled functions in a folder, for this process and later ones; return the folder.

    A first fit or loop spends most of its time on tracing and compiling. `cache_compiled` turns on
    JAX's persistent cache for all later compilations, and also caches traced functions in `folder`.
    The command `jaxfric` calls `cache_compiled`; importing jaxfric does not. The default `folder`
    is the environment variable JAX_COMPILATION_CACHE_DIR, or else jaxfric's folder in the user's
    cache folder. You may delete the cache folder at any time.

    Raises
    ------
    InputError : the folder cannot be created or written.
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
