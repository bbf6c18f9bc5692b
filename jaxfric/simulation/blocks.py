"""Vectorisation over rows in blocks whose intermediate results fit in the processor's cache."""

from collections.abc import Callable
from typing import TypeVar

import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

from ..threads import at_once
from .thresholds import BLOCK

T = TypeVar("T", bound=PyTree)


def in_blocks(one: Callable[..., T], *rows: PyTree) -> T:
    """Compute `jax.vmap(one)(*rows)`, with `BLOCK` rows at a time.

    For a whole record at once, every operation with many derivatives would read from main memory.
    """
    return _mapped(lambda *block: jax.vmap(one)(*block), rows)


def renewed(one: Callable[..., T], which: Bool[Array, " n"], old: T, *rows: PyTree) -> T:
    """Replace `old` by `one(*row)` in the rows of the mask `which`. The function skips a block of
    rows if `which` is False throughout the block, in all members of a batch."""

    def new(which: Array, old: T, *rows: PyTree) -> T:
        return jax.tree.map(lambda a, b: _where(which, a, b), jax.vmap(one)(*rows), old)

    def block(which: Array, old: T, *rows: PyTree) -> T:
        some = eqxi.unvmap_any(jnp.any(which))
        return jax.lax.cond(some, new, lambda which, old, *rows: old, which, old, *rows)

    few = which.shape[0] <= at_once(BLOCK)  # computing all then costs less than the condition
    return new(which, old, *rows) if few else _mapped(block, (which, old, *rows))


def _mapped(block: Callable[..., T], rows: tuple) -> T:
    n, each = jax.tree.leaves(rows)[0].shape[0], at_once(BLOCK)
    if n <= each:
        return block(*rows)
    blocks = -(-n // each)

    def folded(x: jax.Array) -> jax.Array:
        more = [(0, blocks * each - n), *[(0, 0)] * (x.ndim - 1)]
        return jnp.pad(x, more, mode="edge").reshape(blocks, each, *x.shape[1:])

    found = jax.lax.map(lambda rows: block(*rows), jax.tree.map(folded, rows))
    return jax.tree.map(lambda x: x.reshape(blocks * each, *x.shape[2:])[:n], found)


def _where(which: Bool[Array, " n"], one: Array, other: Array) -> Array:
    return jnp.where(which.reshape(-1, *[1] * (one.ndim - 1)), one, other)
