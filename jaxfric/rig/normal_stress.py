"""Recorded normal stress on the contact: a smooth function of time through noisy data.

Friction is a coefficient f, and the pull balances n f. n(t) is the normal stress relative to the
start. The law (`effects`) defines how a change of the normal stress n acts on the state of
friction.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from ..errors import InputError
from .thresholds import FEWEST_ROWS, KNOTS, KNOTS_OF_BLOCK


class NormalStress(eqx.Module):
    """n(t), normal stress relative to the start: a cubic on each interval of time.

    knots : starts of the intervals [s], ascending, shape (m,); padding is inf.
    coefficients : of (t - knot)^3, ^2, ^1, ^0, shape (4, m).
    span : first and last time [s]; n is constant outside. The first cubic extends back to the
        first time.

    The function n(t) is made of cubics, because a solver must stop at every corner of a piecewise
    linear function.
    """

    knots: Float[Array, " m"]
    coefficients: Float[Array, "4 m"]
    span: Float[Array, " 2"]

    def ratio(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """n at time t [s]."""
        t = jnp.clip(t, self.span[0], self.span[1])
        index = self._interval(t)
        c = self.coefficients[:, index]
        since = t - self.knots[index]
        return ((c[0] * since + c[1]) * since + c[2]) * since + c[3]

    def unit(self, time: ArrayLike, stress: ArrayLike) -> float:
        """The normal stress [Pa] at which n is 1: the mean of a recorded stress over n(time)."""
        return float(np.mean(np.asarray(stress) / jax.vmap(self.ratio)(jnp.asarray(time))))

    def _interval(self, t: Float[Array, ""]) -> Int[Array, ""]:
        """Index of the last knot at or before `t`, or 0.

        All knots in steps of `KNOTS_OF_BLOCK` are compared at once, then those that follow the one
        found. A binary search would be a loop within the solver's loop, and slower.
        """
        first, knots = 0, self.knots
        if len(knots) % KNOTS_OF_BLOCK == 0:
            first = KNOTS_OF_BLOCK * jnp.maximum(jnp.sum(t >= knots[::KNOTS_OF_BLOCK]) - 1, 0)
            knots = jax.lax.dynamic_slice_in_dim(knots, first, KNOTS_OF_BLOCK)
        return first + jnp.maximum(jnp.sum(t >= knots) - 1, 0)

    def padded(self, length: int) -> "NormalStress":
        """The same stress padded to `length` knots; padding knots lie at infinite time."""
        more = length - self.knots.shape[0]
        if more < 0:
            raise InputError(f"normal stress: {self.knots.shape[0]} knots do not fit in {length}")
        return NormalStress(
            jnp.pad(self.knots, (0, more), constant_values=jnp.inf),
            jnp.pad(self.coefficients, ((0, 0), (0, more))),
            self.span,
        )


def recorded_stress(time: ArrayLike, stress: ArrayLike, *, knots: int = KNOTS) -> NormalStress:
    """Smooth a recorded normal stress: `time` from the start of the record [s], `stress` > 0.

    Neighbouring rows are averaged down to at most `knots` points. A cubic smoothing spline (SciPy's
    `make_smoothing_spline`) fits the averaged points; generalised cross-validation chooses the
    smoothness of the spline. The spline is divided by its value at the first row.

    Raises
    ------
    InputError : arrays of different shapes or of fewer than 5 rows, times that do not ascend, a
        stress that is not positive.
    """
    t, s = np.asarray(time, float), np.asarray(stress, float)
    if t.ndim != 1 or t.shape != s.shape or len(t) < FEWEST_ROWS or np.any(np.diff(t) <= 0):
        raise InputError("normal stress: needs as many rows as ascending times, 5 at least")
    if not np.all(s > 0):
        raise InputError("normal stress: must be positive in every row; cut the record")
    from scipy.interpolate import PPoly, make_smoothing_spline  # slow to import

    begin, end = t[0], t[-1]
    rows = -(-len(t) // max(knots - 1, FEWEST_ROWS))
    starts = np.arange(0, len(t), rows)
    sizes = np.diff(np.append(starts, len(t)))
    t, s = np.add.reduceat(t, starts) / sizes, np.add.reduceat(s, starts) / sizes
    level = float(np.mean(s))
    # in units of the mean interval: in seconds the spline's equations may be ill-conditioned
    unit = (end - begin) / len(t)
    deviation = s / level - 1
    spline = make_smoothing_spline((t - begin) / unit, deviation, w=sizes / rows)
    pieces = PPoly.from_spline(spline)
    inside = np.diff(pieces.x) > 0
    c = pieces.c[:, inside].copy()
    c[-1] += 1.0
    start = 1.0 + float(spline(0.0))
    c = c / start / unit ** np.arange(3, -1, -1)[:, None]
    at = begin + unit * pieces.x[:-1][inside]
    return NormalStress(jnp.asarray(at), jnp.asarray(c), jnp.asarray([begin, end]))


def stress_of_levels(
    begins: Float[np.ndarray, " k"], ends: Float[np.ndarray, " k"], ratios: Float[np.ndarray, "k+1"]
) -> NormalStress:
    """Build n(t) that goes from `ratios[i]` to `ratios[i + 1]` between `begins[i]` and `ends[i]`
    [s]. Each change is a cubic with zero slope at both ends; otherwise n(t) is constant."""
    knots, rows = [0.0], [(0.0, 0.0, 0.0, ratios[0])]
    for begin, end, low, high in zip(begins, ends, ratios[:-1], ratios[1:], strict=True):
        rise, last = (high - low), end - begin
        knots += [begin, end]
        rows += [(-2 * rise / last**3, 3 * rise / last**2, 0.0, low), (0.0, 0.0, 0.0, high)]
    span = np.array([0.0, max(float(ends[-1]), knots[-1]) * 2 + 1])
    return NormalStress(jnp.asarray(knots), jnp.asarray(np.array(rows).T), jnp.asarray(span))


def moved_stress(time: ArrayLike, stress: ArrayLike) -> float:
    """Relative standard deviation of a recorded normal stress, without the noise of its gauge.

    The result is the square root of the covariance of two smoothed histories. One history smooths
    the even rows, the other history smooths the odd rows. The noise that remains after smoothing is
    independent in the two histories.
    """
    t, s = np.asarray(time, float), np.asarray(stress, float)
    halves = [recorded_stress(t[k::2], s[k::2], knots=KNOTS) for k in (0, 1)]
    ratios = [np.asarray(jax.vmap(half.ratio)(jnp.asarray(t))) for half in halves]
    return float(np.sqrt(max(np.cov(ratios)[0, 1], 0.0)))
