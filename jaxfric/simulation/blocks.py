"""Vectorisation over rows in blocks whose intermediate results fit in the processor's cache."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..threads import at_once
from .thresholds import BLOCK

T = TypeVar("T", bound=PyTree)


def in_blocks(one: Callable[..., T], *rows: PyTree) -> T:
    """Compute `jax.vmap(one)(*rows)`, with `BLOCK` rows at a time.

    For a whole record at once, every operation with many derivatives would read from main memory.
    """
    n, each = jax.tree.leaves(rows)[0].shape[0], at_once(BLOCK)
    if n <= each:
        return jax.vmap(one)(*rows)
    blocks = -(-n // each)

    def folded(x: jax.Array) -> jax.Array:
        more = [(0, blocks * each - n), *[(0, 0)] * (x.ndim - 1)]
        return jnp.pad(x, more, mode="edge").reshape(blocks, each, *x.shape[1:])

    found = jax.lax.map(lambda rows: jax.vmap(one)(*rows), jax.tree.map(folded, rows))
    return jax.tree.map(lambda x: x.reshape(blocks * each, *x.shape[2:])[:n], found)
