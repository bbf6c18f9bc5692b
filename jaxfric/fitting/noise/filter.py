"""The Kalman filter of a noise with any number of parts, which whitens many columns in one pass.

The time of the filter is linear in the number of rows. Rows may be unevenly sampled, and excluded
rows are skipped. A noise has few states, so loops over states are unrolled to scalar operations.
Products of small matrices in every row would take longer.

The quasi-separable kernels of the package tinygp solve the same equations, but with one coordinate
for all terms. The package tinygp lacks separate clocks, a part of negative variance, skipped rows,
and the restricted likelihood of many columns.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...traced import traced
from ..padding import Numbers, padded_columns
from ..thresholds import FEW, WIDE
from . import thresholds as const
from .model import Noise, distances
from .parts import AbstractPart, Matrix

_Terms = list[list[tuple[int, Array]]]
"""For every state: the states that contribute to it in the next row, with factors."""


class Moves(NamedTuple):
    """Change of the states of every noise part from one row to the next."""

    turn: tuple[Matrix, ...]
    """Transitions, entries (*g, n)."""
    gained: tuple[Matrix, ...]
    """Process-noise covariances of the states: lower triangles."""


def moves_of(parts: Sequence[AbstractPart], away: Float[Numbers, "n k"]) -> Moves:
    """Changes of the states of all noise parts over the distances `away` on the clocks."""
    turn = tuple(part.transition(away) for part in parts)
    return Moves(turn, tuple(p.gained(f) for p, f in zip(parts, turn, strict=True)))


class Carried(NamedTuple):
    """The filter's state between rows: the mean of every noise state for every column. All columns
    share the covariance of the states (lower triangle).
    """

    mean: list[Float[Array, " m"]]
    spread: list[list[Float[Array, ""]]]


def at_first_row(parts: Sequence[AbstractPart], columns: Float[Numbers, "n m"]) -> Carried:
    """The filter's state before the first row of the columns."""
    own = [jnp.asarray(part.share * v) for part in parts for v in part.variances()]
    none = jnp.zeros(())
    spread = [[own[i] if i == j else none for j in range(i + 1)] for i in range(len(own))]
    return Carried([jnp.zeros_like(columns[0]) for _ in own], spread)


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
    seen = _seen(moves.turn)

    def advance(
        carry: Carried, row: tuple[Array, Array, Moves]
    ) -> tuple[Carried, tuple[Array, Array]]:
        mean, spread = carry
        y, hidden, (turn, gained) = row
        gain, inverse, spread = _update(spread, hidden + white, seen)
        predicted = _sum(mean[i] for i in seen)
        misfit = y / jnp.sqrt(inverse) if backwards else y - predicted
        out = predicted + misfit if backwards else misfit * jnp.sqrt(inverse)
        terms = _terms(turn)
        known = [m + k * misfit for m, k in zip(mean, gain, strict=True)]
        carry = Carried(_turned(known, terms), _forecast(spread, terms, gained))
        return carry, (out, jnp.where(hidden > 0, 0.0, jnp.log(inverse)))

    rows = jnp.asarray(columns), jnp.where(used, 0.0, const.HIDDEN), moves
    return jax.lax.scan(advance, begun, rows)


def _sum(terms: Iterable[Array]) -> Array:
    first, *more = [*terms] or [jnp.zeros(())]
    return sum(more, first)


def _seen(turn: tuple[Matrix, ...]) -> list[int]:
    """Indices of the states that add to a row: the first of every part."""
    return [0, *np.cumsum([len(own) for own in turn]).tolist()][: len(turn)]


def _terms(turn: tuple[Matrix, ...]) -> _Terms:
    """Contributions to the next states; they come from states of the same part only."""
    begin = _seen(turn)
    return [
        [(first + k, x) for k, x in enumerate(row)]
        for first, own in zip(begin, turn, strict=True)
        for row in own
    ]


def _update(
    spread: list[list[Array]], white: Float[Array, ""], seen: list[int]
) -> tuple[list[Array], Array, list[list[Array]]]:
    """Gains, inverse innovation variance, and covariance of the states after the row is
    observed."""
    number = range(len(spread))
    along = [_sum(spread[max(i, j)][min(i, j)] for j in seen) for i in number]
    inverse = 1 / (_sum(along[i] for i in seen) + white)
    gain = [x * inverse for x in along]
    return (
        gain,
        inverse,
        [[spread[i][j] - gain[i] * along[j] for j in range(i + 1)] for i in number],
    )


def _turned(mean: list[Array], terms: _Terms) -> list[Array]:
    """The means of the states in the next row."""
    return [_sum(f * mean[k] for k, f in row) for row in terms]


def _forecast(
    spread: list[list[Array]], terms: _Terms, gained: tuple[Matrix, ...]
) -> list[list[Array]]:
    """Covariance of the states in the next row."""

    def entry(i: int, j: int) -> Array:
        return _sum(
            f * _sum(g * spread[max(k, m)][min(k, m)] for m, g in terms[j]) for k, f in terms[i]
        )

    found = [[entry(i, j) for j in range(i + 1)] for i in range(len(spread))]
    for first, own in zip(_seen(gained), gained, strict=True):
        for i, row in enumerate(own):
            for j, x in enumerate(row):
                found[first + i][first + j] = found[first + i][first + j] + x
    return found


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


@traced
def coloured(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    white: Float[Numbers, "n m"],
    noise: Noise,
) -> Float[Array, "n m"]:
    """Convert columns of white noise of variance 1 to columns of this noise: inverse of `whiten`.

    Rows of zero weight return 0.
    """
    used = weight > 0
    moves, begun = moves_of(noise.parts, distances(clock)), at_first_row(noise.parts, white)
    white = white * used[:, None]
    _, (found, _) = filtered(used, white, noise.white, moves, begun, backwards=True)
    scale = noise.sigma * jnp.broadcast_to(noise.scale, weight.shape)
    return found * (scale * used)[:, None]


class Whitening(NamedTuple):
    """The filter of `whiten` with precomputed gains, which depend on noise and clocks alone.

    For a fixed noise a `Whitening` takes a small part of the time that `whiten` takes.
    """

    gain: list[Float[Array, " n"]]
    turn: tuple[Matrix, ...]
    size: Float[Numbers, " n"]
    """1 over the standard deviation of a row's innovation; 0 for skipped rows."""

    def __call__(self, columns: Float[Numbers, "n m"]) -> Float[Array, "n m"]:
        """The columns in units of the noise and uncorrelated."""
        seen = _seen(self.turn)

        def advance(
            mean: list[Array], row: tuple[Array, list[Array], tuple[Matrix, ...]]
        ) -> tuple[list[Array], Array]:
            y, gain, turn = row
            misfit = y - _sum(mean[i] for i in seen)
            known = [m + k * misfit for m, k in zip(mean, gain, strict=True)]
            return _turned(known, _terms(turn)), misfit

        start = [jnp.zeros_like(columns[0]) for _ in self.gain]
        _, misfit = jax.lax.scan(advance, start, (jnp.asarray(columns), self.gain, self.turn))
        return misfit * self.size[:, None]


@traced
def whitening(clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], noise: Noise):
    """The `Whitening` of a noise whose scale is the same in all rows."""
    used, moves = weight > 0, moves_of(noise.parts, distances(clock))
    seen = _seen(moves.turn)

    def advance(
        spread: list[list[Array]], row: tuple[Array, Moves]
    ) -> tuple[list[list[Array]], tuple[list[Array], Array]]:
        hidden, (turn, gained) = row
        gain, inverse, spread = _update(spread, hidden + noise.white, seen)
        return _forecast(spread, _terms(turn), gained), (gain, inverse)

    start = at_first_row(noise.parts, jnp.zeros((1, 0))).spread
    _, (gain, inverse) = jax.lax.scan(advance, start, (jnp.where(used, 0.0, const.HIDDEN), moves))
    size = jnp.where(used, jnp.sqrt(inverse) / (noise.sigma * noise.scale), 0.0)
    return Whitening(gain, moves.turn, size)


# ---- many columns, few compilations

_innovations = traced(innovations)


def innovations_of(
    clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], column: np.ndarray, noise: Noise
) -> tuple[np.ndarray, float]:
    """`innovations` of one column (n,), padded to eight columns to share a compilation."""
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
    wide = FEW if columns.shape[1] <= FEW else WIDE
    noise, parts = _by_row(noise, len(columns)), []
    for begin in range(0, columns.shape[1], wide):
        part = columns[:, begin : begin + wide]
        white, _ = _innovations(clock, weight, padded_columns(part, size=wide), noise)
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
