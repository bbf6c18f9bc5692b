"""The noise of a record: white, and up to two correlated parts, as a process of few states.

    r_i = s_i (e_i + a_i + b_i),   var e = sigma^2 (1 - c_1 - c_2)
    cov a_i, a_j = sigma^2 c_1 exp(-d_1),   cov b_i, b_j = sigma^2 c_2 rho(d_2)
    rho(d) = exp(-d),   or of a resonator   rho(d) = exp(-d) (cos w d + sin(w d)/w),  w^2 = beta

s is the scale of a row. d is what a part forgets between two rows: its rates times how far the
clocks of the record have moved. Clocks are time (amplifier, servo), the path of the load point
(roughness, gouge: ten times as fast at ten times the velocity) and the samples of a recorder whose
filter follows its rate; they are the columns of an array (n, k). A clock alone may be (n,).

a is an Ornstein-Uhlenbeck process. b is another one, or a damped oscillator driven by white noise,
b'' + 2 b' + (1 + beta) b, whose record is smooth: an amplifier's filter (beta <= 0: real roots) or
a servo that swings (beta > 0). One Kalman filter whitens any number of columns in one pass at
uneven sampling, rows left out included. Nothing in it needs c_1 to be positive: with c_1 < 0
neighbouring rows differ by more than chance, as where the noise of a position is differentiated;
`limit_of_negative` says how far that is a covariance. How a noise is found is in `noise_search`.

Sources: Foreman-Mackey et al. 2017 (doi:10.3847/1538-3881/aa9332) for such terms in linear time;
Kelly et al. 2014 (doi:10.1088/0004-637X/788/1/33) for filters of white noise at uneven sampling.
tinygp's quasi-separable kernels solve the same equations, but with one coordinate for all terms:
parts with clocks of their own, a negative one, rows passed over, and the restricted likelihood of
many columns would still have to be written around them.
"""

import itertools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..traced import traced

Numbers = Array | np.ndarray
_HIDDEN = 1e12  # variance of a row that is to be passed over
_CRITICAL = 1e-3
PARTS = 2
"""Number of correlated parts in `Noise`; a part that is not needed has share 0."""
EXPONENTIAL = -1.0
"""Value of beta by which the second part is an exponential; no resonator has it."""


class Noise(NamedTuple):
    """Standard deviation of a row of scale 1, and the parts that are correlated."""

    sigma: Float[Numbers, ""]
    share: Float[Numbers, " 2"]
    """Share of the variance in each correlated part; the rest is white."""
    rates: Float[Numbers, "2 k"]
    """Inverse memory of each part over every clock."""
    beta: Float[Numbers, ""]
    """w^2 of the second part's resonator (see above); `EXPONENTIAL`: it is an exponential."""
    scale: Float[Numbers, " *n"]
    """Relative size of the noise in every row, or one number for all rows."""
    log_likelihood: Float[Numbers, ""]


def noise_of(
    sigma: float,
    share: float = 0.0,
    memory: ArrayLike = 1.0,
    log_likelihood: ArrayLike = 0.0,
) -> Noise:
    """White noise and one exponential part; `memory` over every clock, infinite where it has none.

    Shapes: all of them () but `memory` (k,) or ().
    """
    rates = np.atleast_1d(1 / np.asarray(memory, float))
    return Noise(
        np.asarray(sigma, float),
        np.array([share, 0.0]),
        np.stack([rates, np.ones_like(rates)]),
        np.array(EXPONENTIAL),
        np.ones(()),
        np.asarray(log_likelihood, float),
    )


def _columns(clock: Float[Numbers, "n *k"]) -> Float[Numbers, "n k"]:
    return clock[:, None] if clock.ndim == 1 else clock


def distances(clock: Float[Numbers, "n *k"]) -> Float[Array, "n k"]:
    """How far every clock goes to the next row; 0 from the last one."""
    steps = jnp.abs(jnp.diff(_columns(clock), axis=0))
    return jnp.concatenate([steps, jnp.zeros_like(steps[:1])])


def _forgotten(
    away: Float[Numbers, "n k"], rates: Float[Numbers, "*g 2 k"]
) -> Float[Array, "*g 2 n"]:
    """Some `distances` in memories of each part, of one noise or of many."""
    return jnp.einsum("nk,...pk->...pn", away, rates)


class Moves(NamedTuple):
    """What becomes of the states of both parts from a row to the next, (*g, n) each; `g` noises."""

    keep: Array
    """Of the first part."""
    turn: tuple[Array, Array, Array, Array]
    """Transition of the second part: b and its slope, in units of what it forgets."""
    added: tuple[Array, Array, Array]
    """Covariance that the second part gains."""


def moves_of(
    away: Float[Numbers, "n k"], rates: Float[Numbers, "*g 2 k"], beta: Float[Numbers, "*g"]
) -> Moves:
    """The moves of one noise or of many over some `distances`.

    Sines, and resonators at all, are computed only where one of the noises has them: they take half
    of the time of a filter.
    """
    forgotten = _forgotten(away, rates)
    first, second = forgotten[..., 0, :], forgotten[..., 1, :]
    own = jnp.asarray(beta)[..., None]
    turn, added = jax.lax.cond(
        jnp.all(own <= EXPONENTIAL), _of_exponentials, _of_resonators, second, own, _steepness(own)
    )
    return Moves(jnp.exp(-first), turn, added)


def _steepness(beta: Float[Numbers, "*g"]) -> Float[Array, "*g"]:
    """Variance of the slope of second parts, in units of their own and of what they forget."""
    beta = jnp.asarray(beta)
    own = 1 + jnp.where(beta > 0, beta, -(_damped(beta) ** 2))
    return jnp.where(beta <= EXPONENTIAL, 1.0, own)


_Second = tuple[tuple[Array, Array, Array, Array], tuple[Array, Array, Array]]


def _damped(beta: Array) -> Array:
    """s of a resonator without a swing, s^2 = -beta; not 0."""
    return jnp.sqrt(jnp.clip(-beta, _CRITICAL**2, 1.0))


def _of_exponentials(d: Array, beta: Array, size: Array) -> _Second:
    """Transition and added covariance of second parts that are exponentials, from distances d."""
    one, none = jnp.exp(-d), jnp.zeros_like(d)
    spread = 1 - one * one
    return (one, none, none, one), (spread, none, spread)


def _of_resonators(d: Array, beta: Array, size: Array) -> _Second:
    """The same where some are resonators (see above)."""
    w, s = jnp.sqrt(jnp.maximum(beta, _CRITICAL**2)), _damped(beta)
    slow, fast = jnp.exp(-(1 - s) * d), jnp.exp(-(1 + s) * d)
    one = jnp.exp(-d)
    swings = jnp.broadcast_to(beta > 0, d.shape)
    cosine, sine = jax.lax.cond(
        jnp.any(swings),
        lambda: (jnp.cos(w * d), jnp.sin(w * d)),
        lambda: (jnp.zeros_like(d), jnp.zeros_like(d)),
    )
    c = jnp.where(swings, one * cosine, 0.5 * (slow + fast))
    q = jnp.where(swings, one * sine / w, 0.5 * (slow - fast) / s)
    alone = beta <= EXPONENTIAL
    xx, vv = (jnp.where(alone, one, x) for x in (c + q, c - q))
    xv, vx = (jnp.where(alone, 0.0, x) for x in (q, -size * q))
    added = 1 - xx**2 - size * xv**2, -xx * vx - size * xv * vv, size - vx**2 - size * vv**2
    return (xx, xv, vx, vv), added


def whiten(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    noise: Noise,
) -> Float[Array, "n m"]:
    """The columns in units of the noise and uncorrelated: W c with W^T W = inverse covariance.

    Rows of zero weight are passed over and come out as 0.
    """
    return innovations(clock, weight, columns, noise)[0] / noise.sigma


def innovations(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    noise: Noise,
) -> tuple[Float[Array, "n m"], Float[Array, ""]]:
    """Columns whitened as by `whiten` for sigma = 1, and the log-determinant of that covariance."""
    scale, used = jnp.broadcast_to(noise.scale, weight.shape), weight > 0
    moves = moves_of(distances(clock), noise.rates, noise.beta)
    begun = at_first_row(columns, noise.share, noise.beta)
    _, (found, log_inverse) = filtered(used, columns / scale[:, None], noise.share, moves, begun)
    log_scale = jnp.sum(jnp.where(used, jnp.log(scale), 0.0))
    return found * used[:, None], 2 * log_scale - jnp.sum(log_inverse)


@traced
def coloured(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    white: Float[Numbers, "n m"],
    noise: Noise,
) -> Float[Array, "n m"]:
    """Columns of this noise from columns of white noise of variance 1: the inverse of `whiten`.

    Rows of zero weight come out as 0.
    """
    used = weight > 0
    moves = moves_of(distances(clock), noise.rates, noise.beta)
    begun = at_first_row(white, noise.share, noise.beta)
    white = white * used[:, None]
    _, (found, _) = filtered(used, white, noise.share, moves, begun, backwards=True)
    scale = noise.sigma * jnp.broadcast_to(noise.scale, weight.shape)
    return found * (scale * used)[:, None]


class Carried(NamedTuple):
    """What a filter carries from row to row: a, b and the slope of b, of every column their means,
    of all columns alike their covariances (11, 12, 13, 22, 23, 33)."""

    mean: list[Float[Array, " m"]]
    spread: list[Float[Array, ""]]


def at_first_row(
    columns: Float[Numbers, "n m"], share: Float[Numbers, " 2"], beta: Float[Numbers, ""]
) -> Carried:
    """What a filter of some columns begins with."""
    first, second = jnp.asarray(share)
    zero, none = jnp.zeros_like(columns[0]), jnp.zeros_like(first)
    return Carried([zero] * 3, [first, none, none, second, none, second * _steepness(beta)])


def filtered(
    used: Bool[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    share: Float[Numbers, " 2"],
    moves: Moves,
    begun: Carried,
    *,
    backwards: bool = False,
) -> tuple[Carried, tuple[Float[Array, "n m"], Float[Array, " n"]]]:
    """Innovations of columns of scale 1, or `backwards` the columns of such innovations; and the
    logarithm of the inverse variance of each row's misfit, (n,). Rows not `used` are to be passed
    over. Goes on from what is carried, and tells what is carried on."""
    first, second = share
    white = 1 - first - second

    def advance(
        carry: Carried, row: tuple[Array, Array, Array, list[Array], list[Array]]
    ) -> tuple[Carried, tuple[Array, Array]]:
        mean, spread = carry
        y, hidden, f, turn, added = row
        gain, inverse, spread = _update(spread, white + hidden)
        predicted = mean[0] + mean[1]
        misfit = y / jnp.sqrt(inverse) if backwards else y - predicted
        a, b, v = (m + k * misfit for m, k in zip(mean, gain, strict=True))
        mean = [f * a, turn[0] * b + turn[1] * v, turn[2] * b + turn[3] * v]
        out = predicted + misfit if backwards else misfit * jnp.sqrt(inverse)
        spread = _forecast(spread, f, turn)
        spread[0] = spread[0] + first * (1 - f * f)
        spread[3:] = [x + second * q for x, q in zip(spread[3:], added, strict=True)]
        return Carried(mean, spread), (out, jnp.where(hidden > 0, 0.0, jnp.log(inverse)))

    rows = (
        jnp.asarray(columns),
        jnp.where(used, 0.0, _HIDDEN),
        moves.keep,
        list(moves.turn),
        list(moves.added),
    )
    return jax.lax.scan(advance, begun, rows)


class Whitening(NamedTuple):
    """The filter of `whiten` with its gains, which follow from the noise and the clocks alone.

    Where the noise is held, one filter whitens many columns in a small part of the time."""

    gain: Float[Numbers, "n 3"]
    keep: Float[Numbers, "n 5"]
    """What the states a, b and the slope of b become in the next row."""
    size: Float[Numbers, " n"]
    """1 over the standard deviation of the misfit of a row; 0 where it is passed over."""

    def __call__(self, columns: Float[Numbers, "n m"]) -> Float[Array, "n m"]:
        """The columns in units of the noise and uncorrelated."""

        def advance(mean: Array, row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
            y, gain, keep = row
            misfit = y - mean[0] - mean[1]
            a, b, v = (mean[i] + gain[i] * misfit for i in range(3))
            return jnp.stack([keep[0] * a, keep[1] * b + keep[2] * v, keep[3] * b + keep[4] * v]), (
                misfit
            )

        start = jnp.zeros((3, columns.shape[1]), columns.dtype)
        rows = (jnp.asarray(columns), jnp.asarray(self.gain), jnp.asarray(self.keep))
        _, misfit = jax.lax.scan(advance, start, rows)
        return misfit * self.size[:, None]


@traced
def whitening(clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], noise: Noise):
    """The `Whitening` of this noise of a scale that is the same in all rows."""
    used = weight > 0
    first, second = noise.share
    moves = moves_of(distances(clock), noise.rates, noise.beta)

    def advance(
        spread: list[Array], row: tuple[Array, Array, list[Array], list[Array]]
    ) -> tuple[list[Array], tuple[Array, Array]]:
        hidden, f, turn, added = row
        gain, inverse, spread = _update(spread, 1 - first - second + hidden)
        spread = _forecast(spread, f, turn)
        spread[0] = spread[0] + first * (1 - f * f)
        spread[3:] = [x + second * q for x, q in zip(spread[3:], added, strict=True)]
        return spread, (jnp.stack(gain), inverse)

    start = at_first_row(jnp.zeros((1, 0)), noise.share, noise.beta).spread
    rows = (jnp.where(used, 0.0, _HIDDEN), moves.keep, list(moves.turn), list(moves.added))
    _, (gain, inverse) = jax.lax.scan(advance, start, rows)
    size = jnp.where(used, jnp.sqrt(inverse) / (noise.sigma * noise.scale), 0.0)
    return Whitening(gain, jnp.stack([moves.keep, *moves.turn], axis=1), size)


def _update(
    spread: list[Array], white: Float[Numbers, ""]
) -> tuple[tuple[Array, ...], Array, list[Array]]:
    """Gains, the inverse variance of the misfit, and the covariance of the states once it is seen.

    States are a, b and the slope of b, their covariances 11, 12, 13, 22, 23, 33.
    """
    aa, ab, av, bb, bv, vv = spread
    seen = aa + ab, ab + bb, av + bv
    inverse = 1 / (seen[0] + seen[1] + white)
    gain = tuple(x * inverse for x in seen)
    pairs = ((0, 0, aa), (0, 1, ab), (0, 2, av), (1, 1, bb), (1, 2, bv), (2, 2, vv))
    return gain, inverse, [x - gain[i] * seen[j] for i, j, x in pairs]


def _forecast(spread: list[Array], f: Float[Array, ""], turn: list[Array]) -> list[Array]:
    """Covariance of the states carried on to the next row, before noise is added there."""
    aa, ab, av, bb, bv, vv = spread
    p, q, r, s = turn
    return [
        f * f * aa,
        f * (p * ab + q * av),
        f * (r * ab + s * av),
        p * p * bb + 2 * p * q * bv + q * q * vv,
        p * r * bb + (p * s + q * r) * bv + q * s * vv,
        r * r * bb + 2 * r * s * bv + s * s * vv,
    ]


def limit_of_negative(keep: np.ndarray) -> np.ndarray:
    """Largest -variance of the first part, in units of the white one, that is a covariance.

    `keep` is its correlation from a row to the next: the spectrum is least at zero frequency.
    """
    return 0.98 * (1 - keep) / (1 + keep)


def sandwich(
    clock: Float[Numbers, "n *k"], jacobian: Float[Numbers, "n p"], noise: Noise
) -> Float[Numbers, "p p"]:
    """J^T Sigma J for the noise covariance Sigma, in one pass; by NumPy where it is white."""
    if isinstance(noise.share, np.ndarray) and not noise.share.any():
        scaled = np.reshape(noise.sigma * noise.scale, (-1, 1)) * np.asarray(jacobian)
        return scaled.T @ scaled
    return _sandwich(clock, jacobian, noise)


@traced
def _sandwich(
    clock: Float[Numbers, "n *k"], jacobian: Float[Numbers, "n p"], noise: Noise
) -> Float[Array, "p p"]:
    scaled = jacobian * jnp.broadcast_to(noise.scale, jacobian.shape[:1])[:, None]
    white = (1 - noise.share[0] - noise.share[1]) * scaled.T @ scaled
    return jnp.asarray(noise.sigma**2 * (white + _correlated(scaled, _terms(clock, noise))))


def _terms(clock: Float[Numbers, "n *k"], noise: Noise) -> list[tuple[Array, Array]]:
    """The correlated parts as sums of exponentials: sizes, and what each forgets to the next row.

    Sizes and exponents are complex; the sum is real.
    """
    first, second = _forgotten(distances(clock), noise.rates) + 0j
    near = jnp.where(jnp.abs(noise.beta) < _CRITICAL**2, _CRITICAL**2, noise.beta)
    alone = noise.beta <= EXPONENTIAL
    s = jnp.where(alone, 0.5, jnp.sqrt(-near + 0j))
    slow = jnp.where(alone, 1.0, 0.5 * (1 + 1 / s)), jnp.where(alone, second, (1 - s) * second)
    fast = jnp.where(alone, 0.0, 0.5 * (1 - 1 / s)), (1 + s) * second
    a, b = noise.share
    return [(a, first), (b * slow[0], slow[1]), (b * fast[0], fast[1])]


@traced
def neighbours(clock: Float[Numbers, "n *k"], noise: Noise) -> Float[Array, " n"]:
    """Correlation of the noise of every row and of the next one; of the last row with itself."""
    return jnp.sum(jnp.stack([x * jnp.exp(-d) for x, d in _terms(clock, noise)]), axis=0).real


def _correlated(
    columns: Float[Numbers, "n p"], terms: list[tuple[Array, Array]]
) -> Float[Array, "p p"]:
    """C^T R C, R_ij the sum over `terms` (as `_terms`) of what is kept from row i to row j."""
    columns, sizes = jnp.asarray(columns), jnp.stack([size + 0j for size, _ in terms])
    keep = jnp.exp(-jnp.stack([d for _, d in terms], axis=1))
    keep = jnp.concatenate([jnp.ones_like(keep[:1]), keep[:-1]])

    def step(carry: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        c, k = row
        carry = k[:, None] * carry + c
        return carry, jnp.sum(sizes[:, None] * carry, axis=0).real

    start = jnp.zeros((len(terms), columns.shape[1]), complex)
    _, before = jax.lax.scan(step, start, (columns, keep))
    one_sided = columns.T @ before
    return one_sided + one_sided.T - jnp.sum(sizes).real * columns.T @ columns


def rms_error(clock: Float[Numbers, "n *k"], used: ArrayLike, noise: Noise) -> float:
    """Relative standard error of the rms of noise over the `used` rows (a mask or 0 and 1).

    sqrt(sum_ij (s_i s_j rho_ij)^2/2)/sum_i s_i^2, rho the correlation and s the scale of rows:
    correlated rows count for fewer, and so do those beside others with more noise.
    """
    sizes = np.asarray(used, float) * np.asarray(noise.scale) ** 2
    return math.sqrt(0.5 * float(_squares(clock, sizes, noise))) / max(float(sizes.sum()), 1e-300)


@traced
def _squares(
    clock: Float[Numbers, "n *k"], sizes: Float[Numbers, " n"], noise: Noise
) -> Float[Array, ""]:
    """Sum over all pairs of rows of the square of their correlation, times both sizes."""
    terms = _terms(clock, noise)
    pairs = [(a * b, p + q) for (a, p), (b, q) in itertools.product(terms, terms)]
    white = (1 - jnp.sum(noise.share) ** 2) * jnp.sum(sizes**2)
    return white + _correlated(sizes[:, None], pairs)[0, 0]
