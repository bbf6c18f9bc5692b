"""The Kalman filter of a noise with any number of parts, which whitens many columns in one pass.

The time of the filter is linear in the number of rows. Rows may be unevenly sampled, and excluded
rows are skipped. The states of all parts form one vector x, with the transition matrix T and the
process noise Q from a row to the next. With the covariance P of x before a row, and h that sums the
first states of the parts, the filter computes

    d = h^T P h + white,   k = T P h/d,   P <- T P T^T - d k k^T + Q.

The quasi-separable kernels of the package tinygp solve the same equations, but with one coordinate
for all terms. The package tinygp lacks separate clocks, a part of negative variance, skipped rows,
and the restricted likelihood of many columns.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...traced import traced
from ..padding import Numbers, padded_columns
from ..thresholds import FEW
from . import thresholds as const
from .model import Noise, distances
from .parts import AbstractPart, times


class Moves(eqx.Module):
    """Change of the states of a noise from one row to the next."""

    turn: Float[Array, "*g n s s"]
    """T."""
    gained: Float[Array, "*g n s s"]
    """Q."""
    first: tuple[int, ...] = eqx.field(static=True)
    """Indices of the states that add to a row: the first of every part."""


def moves_of(parts: Sequence[AbstractPart], away: Float[Numbers, "n k"]) -> Moves:
    """Changes of the states of all noise parts over the distances `away` on the clocks."""
    turn = [part.transition(away) for part in parts]
    gained = [part.gained(own) for part, own in zip(parts, turn, strict=True)]
    ends = np.cumsum([own.shape[-1] for own in turn]).tolist()
    return Moves(_together(turn, away), _together(gained, away), (0, *ends)[: len(turn)])


def _together(blocks: list[Array], away: Float[Numbers, "n k"]) -> Array:
    """Matrices with the matrices of the parts on their diagonals."""
    number = sum(own.shape[-1] for own in blocks)
    whole = jnp.zeros((*(blocks[0].shape[:-2] if blocks else (len(away),)), number, number))
    begin = 0
    for own in blocks:
        end = begin + own.shape[-1]
        whole, begin = whole.at[..., begin:end, begin:end].set(own), end
    return whole


class Carried(NamedTuple):
    """The filter's state between rows: the mean of the states for every column, and their
    covariance, which all columns share.
    """

    mean: Float[Array, "s m"]
    spread: Float[Array, "s s"]


def at_first_row(parts: Sequence[AbstractPart], columns: Float[Numbers, "n m"]) -> Carried:
    """The filter's state before the first row of the columns."""
    own = [part.share * v for part in parts for v in part.variances()]
    spread = jnp.diag(jnp.array(own)) if own else jnp.zeros((0, 0))
    return Carried(jnp.zeros((len(own), columns.shape[1])), spread)


def filtered(
    used: Bool[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    white: Float[Numbers, ""],
    moves: Moves,
    begun: Carried,
    *,
    backwards: bool = False,
) -> tuple[Carried, tuple[Float[Array, "n m"], Float[Array, " n"]]]:
    """Whitened columns (innovations) of columns of scale 1, and the log of the inverse innovation
    variance of each row, (n,). If `backwards` is True, the filter computes the columns from their
    innovations.

    Rows not `used` are skipped; `white` is the share of white noise. The filter continues from the
    state `begun` and returns its last state.
    """

    def advance(
        carry: Carried, row: tuple[Array, Array, Array, Array]
    ) -> tuple[Carried, tuple[Array, Array]]:
        mean, spread = carry
        y, hidden, turn, gained = row
        gain, inverse, spread = _update(spread, hidden + white, turn, gained, moves.first)
        predicted = _seen(mean, moves.first)
        misfit = y / jnp.sqrt(inverse) if backwards else y - predicted
        out = predicted + misfit if backwards else misfit * jnp.sqrt(inverse)
        carry = Carried(times(turn, mean) + gain[:, None] * misfit, spread)
        return carry, (out, jnp.where(hidden > 0, 0.0, jnp.log(inverse)))

    hidden = jnp.where(used, 0.0, const.HIDDEN)
    return jax.lax.scan(advance, begun, (jnp.asarray(columns), hidden, moves.turn, moves.gained))


def _seen(states: Float[Array, "s *m"], first: tuple[int, ...]) -> Float[Array, " *m"]:
    """The sum h^T x of the states that add to a row."""
    return sum((states[i] for i in first), jnp.zeros(states.shape[1:]))


def _update(
    spread: Float[Array, "s s"],
    white: Float[Array, ""],
    turn: Float[Array, "s s"],
    gained: Float[Array, "s s"],
    first: tuple[int, ...],
) -> tuple[Float[Array, " s"], Float[Array, ""], Float[Array, "s s"]]:
    """Gain k, inverse innovation variance 1/d, and covariance P before the next row."""
    along = _seen(spread, first)
    inverse = 1 / (_seen(along, first) + white)
    moved = jnp.sum(turn * along, axis=1)
    gain = moved * inverse
    kept = times(times(turn, spread), turn.T)
    return gain, inverse, kept - gain[:, None] * moved + gained


def innovations(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    noise: Noise,
) -> tuple[Float[Array, "n m"], Float[Array, ""]]:
    """Columns whitened for sigma = 1, and the log-determinant of the noise covariance."""
    scale, used = jnp.broadcast_to(noise.scale, weight.shape), weight > 0
    moves, begun = moves_of(noise.parts, distances(clock)), at_first_row(noise.parts, columns)
    _, (found, log_inverse) = filtered(used, columns / scale[:, None], noise.white, moves, begun)
    log_scale = jnp.sum(jnp.where(used, jnp.log(scale), 0.0))
    return found * used[:, None], 2 * log_scale - jnp.sum(log_inverse)


def whiten(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    noise: Noise,
) -> Float[Array, "n m"]:
    """Columns c whitened to W c: uncorrelated, in units of the noise; W^T W = inverse covariance.

    Rows of zero weight are skipped and return 0.
    """
    return innovations(clock, weight, columns, noise)[0] / noise.sigma


def coloured(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    white: Float[np.ndarray, "n m"],
    noise: Noise,
) -> Float[np.ndarray, "n m"]:
    """Convert columns of white noise of variance 1 to columns of this noise: inverse of `whiten`.

    Rows of zero weight return 0.
    """
    scale = (np.asarray(noise.sigma * noise.scale) * (np.asarray(weight) > 0))[:, None]
    return scale * (white if noise.is_white else np.asarray(_coloured(clock, weight, white, noise)))


@traced
def _coloured(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    white: Float[Numbers, "n m"],
    noise: Noise,
) -> Float[Array, "n m"]:
    used = weight > 0
    moves, begun = moves_of(noise.parts, distances(clock)), at_first_row(noise.parts, white)
    white = white * used[:, None]
    return filtered(used, white, noise.white, moves, begun, backwards=True)[1][0]


class Whitening(eqx.Module):
    """The filter of `whiten` with precomputed gains, which depend on noise and clocks alone.

    For a fixed noise a `Whitening` takes a small part of the time that `whiten` takes.
    """

    gain: Float[Array, "n s"]
    turn: Float[Array, "n s s"]
    size: Float[Numbers, " n"]
    """1 over the standard deviation of a row's innovation; 0 for skipped rows."""
    first: tuple[int, ...] = eqx.field(static=True)
    """As in `Moves`."""

    def __call__(self, columns: Float[Numbers, "n m"]) -> Float[Array, "n m"]:
        """The columns in units of the noise and uncorrelated."""

        def advance(mean: Array, row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
            y, gain, turn = row
            misfit = y - _seen(mean, self.first)
            return times(turn, mean) + gain[:, None] * misfit, misfit

        start = jnp.zeros((self.gain.shape[1], columns.shape[1]))
        _, misfit = jax.lax.scan(advance, start, (jnp.asarray(columns), self.gain, self.turn))
        return misfit * self.size[:, None]


@traced
def whitening(clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], noise: Noise):
    """The `Whitening` of a noise whose scale is the same in all rows."""
    used, moves = weight > 0, moves_of(noise.parts, distances(clock))

    def advance(spread: Array, row: tuple[Array, Array, Array]) -> tuple[Array, tuple]:
        hidden, turn, gained = row
        gain, inverse, spread = _update(spread, hidden + noise.white, turn, gained, moves.first)
        return spread, (gain, inverse)

    start = at_first_row(noise.parts, jnp.zeros((1, 0))).spread
    rows = (jnp.where(used, 0.0, const.HIDDEN), moves.turn, moves.gained)
    _, (gain, inverse) = jax.lax.scan(advance, start, rows)
    size = jnp.where(used, jnp.sqrt(inverse) / (noise.sigma * noise.scale), 0.0)
    return Whitening(gain, moves.turn, size, moves.first)


# ---- many columns, few compilations

_innovations = traced(innovations)


def innovations_of(
    clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], column: np.ndarray, noise: Noise
) -> tuple[np.ndarray, float]:
    """`innovations` of one column (n,), padded to `FEW` columns to share a compilation."""
    columns = padded_columns(column[:, None])
    white, size = _innovations(clock, weight, columns, _by_row(noise, len(columns)))
    return np.asarray(white)[:, 0], float(size)


def _by_row(noise: Noise, rows: int) -> Noise:
    """The noise with a scale of every row, so that one shape is compiled."""
    return noise._replace(scale=np.broadcast_to(np.asarray(noise.scale), (rows,)))


def whitened(
    clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], columns: np.ndarray, noise: Noise
) -> np.ndarray:
    """The columns (n, m) whitened as by `whiten`: uncorrelated and in units of the noise."""
    if noise.is_white:  # nothing to filter
        size = np.broadcast_to(noise.sigma * np.asarray(noise.scale), len(columns))
        return columns * (np.asarray(weight) > 0)[:, None] / size[:, None]
    noise, parts = _by_row(noise, len(columns)), []
    for begin in range(0, columns.shape[1], FEW):
        part = columns[:, begin : begin + FEW]
        white, _ = _innovations(clock, weight, padded_columns(part), noise)
        parts.append(np.asarray(white)[:, : part.shape[1]] / float(noise.sigma))
    return np.concatenate(parts, axis=1) if parts else np.array(columns)


def independent_rows(
    clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], noise: Noise
) -> float:
    """Effective number of independent rows: the squared ratio of sigma to the standard error of the
    mean of the rows with `weight`, limited to 2 and the number of these rows.
    """
    white = whitened(clock, weight, np.ones((len(weight), 1)), noise)
    return float(np.clip(np.sum(white**2) * float(noise.sigma) ** 2, 2.0, np.sum(weight)))


def taken_out(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first column projected orthogonal to the other columns, and the share of each row's
    variance that the projection leaves.
    """
    size = np.linalg.norm(columns, axis=0)
    basis = np.linalg.qr(columns[:, 1:][:, size[1:] > 0] / size[1:][size[1:] > 0])[0]
    left = columns[:, 0] - basis @ (basis.T @ columns[:, 0])
    return left, np.clip(1 - np.sum(basis**2, axis=1), 0.0, 1.0)
