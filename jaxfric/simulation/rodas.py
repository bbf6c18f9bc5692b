"""Rodas5P: a step of a Rosenbrock method of order 5 for stiff equations.

With J = df/dy and W = 1/(h gamma) - J at the start of a step, stages k_i solve linear equations

    W k_i = f(t + c_i h, y + sum_j a_ij k_j) + (1/h) sum_j C_ij k_j + h d_i df/dt
    y(t + h) = y + sum_j a_8j k_j + k_8,   error estimate k_8

So a step of Rodas5P needs one Jacobian and no iteration. Rodas5P is L-stable. In steady sliding the
spring relaxes over A/K of slip, which bounds the steps of an explicit method. Only accuracy bounds
the steps of Rodas5P. The interpolant of Rodas5P is of order 4.

Some unknowns relax faster than the resolution of time, such as the friction of a slider that comes
to rest within A/(m V). If a fast unknown is nonlinear and far from its steady value, no step is
short enough. So a step that is as short as a few rounding errors of time becomes a linearly
implicit Euler step. For growing unknowns the Euler step is explicit. An Euler step changes no
unknown by more than 1 and is always accepted.

Source: Steinebach 2023 (doi:10.1007/s10543-023-00967-x), coefficients in the form of Hairer and
Wanner, Solving ODEs II, IV.7.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int, PyTree

from .ode import RealScalar, traced_once
from .thresholds import CLOSED_FORM, ROUNDINGS

Y = TypeVar("Y", bound=PyTree)
STAGES = 8
GAMMA = 0.21193756319429014


def _lower(*rows: tuple[float, ...]) -> Float[np.ndarray, "8 8"]:
    full = np.zeros((STAGES, STAGES))
    for i, row in enumerate(rows, start=1):
        full[i, : len(row)] = row
    return full


# fmt: off
_LAST = (-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256,
         0.030198172008377946)
A = _lower(
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    _LAST,
    (*_LAST, 1.0),
    (*_LAST, 1.0, 1.0),
)
C = _lower(
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125,
     -0.6610691825249471),
    (30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783,
     -19.097331116725623, -28.087943162872662),
    (37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047,
     -40.06618937091002, -54.66780262877968, -9.48861652309627),
)
# fmt: on
# With Gamma = (1/gamma - C)^-1 the method's own coefficients are A Gamma and Gamma; c and d are the
# sums of their rows. For the last three stages they are set to their exact values 1 and 0.
_SUMMED = np.linalg.inv(np.eye(STAGES) / GAMMA - C)
NODES = np.append((A @ _SUMMED).sum(axis=1)[:-3], np.ones(3))
D = np.append(_SUMMED.sum(axis=1)[:-3], np.zeros(3))
# fmt: off
DENSE = np.array([
    [25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204,
     0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493],
    [-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796,
     20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372],
    [11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643,
     -52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722],
])
# fmt: on


def quartic(s: Array | float, y0: Array, y1: Array, k: Float[Array, "rows ..."]) -> Array:
    """Evaluate (1 - s) y0 + s {y1 + (1 - s) [k_1 + s (k_2 + s k_3)]}, with s from 0 to 1 over the
    step. More rows of k give a higher degree."""
    inside = k[-1]
    for row in k[-2::-1]:
        inside = row + s * inside
    return (1 - s) * y0 + s * (y1 + (1 - s) * inside)


def through(
    shares: Sequence[float], y0: Float[Array, "s *n"], y1: Float[Array, "s *n"], *inside: Array
) -> Float[Array, "s rows *n"]:
    """Coefficients k of polynomials through both ends of a step and `inside` at `shares`."""
    weights = np.linalg.inv(np.vander(shares, increasing=True))
    beyond = [
        (y - (1 - s) * y0 - s * y1) / (s * (1 - s)) for y, s in zip(inside, shares, strict=True)
    ]
    return jnp.einsum("ij,js...->si...", jnp.asarray(weights, y0.dtype), jnp.stack(beyond))


@traced_once
def rodas_step(
    derivative: Callable[[Array, Y], Y], t0: RealScalar, t1: RealScalar, y0: Y
) -> tuple[Y, Y, Y]:
    """Return the unknowns at t1, their error, and coefficients k of the interpolant `quartic`."""
    y, back = ravel_pytree(y0)
    h, start = jnp.asarray(t1 - t0, y.dtype), jnp.asarray(t0, y.dtype)

    def rate(t: Array, y: Array) -> Array:
        return ravel_pytree(derivative(t, back(y)))[0]

    def push(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(rate, (start, y), (tangent[-1], tangent[:-1]))

    n = len(y)
    first, slopes = jax.vmap(push, out_axes=(None, -1))(jnp.eye(n + 1, dtype=y.dtype))
    by_time = h * slopes[:, n]
    matrix = jnp.eye(n, dtype=y.dtype) / (h * GAMMA) - slopes[:, :n]
    inverse = inverted(jax.lax.stop_gradient(matrix))
    least = h <= ROUNDINGS * jnp.spacing(jnp.abs(jnp.asarray(t1, y.dtype)))

    def solved(side: Array) -> Array:
        # iterative refinement: through it derivatives of the matrix reach the solution
        k = jax.lax.stop_gradient(inverse @ side)
        return k + inverse @ (side - matrix @ k)

    def stage(ks: Array, row: tuple[Array, ...]) -> tuple[Array, None]:
        i, a, c, node, d = row
        side = rate(start + node * h, y + a @ ks) + (c @ ks) / h + d * by_time
        return ks.at[i].set(solved(side)), None

    ks = jnp.zeros((STAGES, n), y.dtype).at[0].set(solved(first + D[0] * by_time))
    rows = (np.arange(STAGES), *(np.asarray(x, y.dtype) for x in (A, C, NODES, D)))
    ks, _ = jax.lax.scan(stage, ks, jax.tree.map(lambda x: jnp.asarray(x[1:]), rows))
    pulled = inverted(matrix + (1 - 1 / GAMMA) * jnp.eye(n, dtype=y.dtype) / h) @ first
    pulled = jnp.where(pulled * first >= 0, pulled, h * first)
    pulled = pulled / jnp.maximum(1.0, jnp.max(jnp.abs(pulled)))
    end = y + jnp.where(least, pulled, jnp.asarray(A[-1], y.dtype) @ ks + ks[-1])
    # a sum: XLA would call a library for a matrix product, which takes longer than the stages
    inside = sum(np.asarray(DENSE[:, i, None], y.dtype) * ks[i] for i in range(STAGES))
    error, inside = (jnp.where(least, 0.0, x) for x in (ks[-1], inside))
    return back(end), back(error), jax.vmap(back)(inside)


def inverted(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Invert a diagonally dominant matrix, such as the matrix of an implicit method.

    The method is Gauss-Jordan elimination without pivoting, vectorised over a batch; for a small
    matrix the loop is unrolled. LAPACK is avoided: a batch of LAPACK calls waits for XLA's threads,
    and two batches at once deadlock.
    """
    n = matrix.shape[0]
    if n > CLOSED_FORM:
        return jax.lax.scan(_eliminated, matrix, jnp.arange(n))[0]
    eye = np.eye(n)
    rows = [jnp.concatenate([matrix[i], jnp.asarray(eye[i], matrix.dtype)]) for i in range(n)]
    for i in range(n):
        rows[i] = rows[i] / rows[i][i]
        for j in range(n):
            if j != i:
                rows[j] = rows[j] - rows[j][i] * rows[i]
    return jnp.stack([row[n:] for row in rows])


def _eliminated(matrix: Float[Array, "n n"], i: Int[Array, ""]) -> tuple[Float[Array, "n n"], None]:
    """Exchange unknown `i` with its right-hand side; after all exchanges it is the inverse."""
    own = np.arange(matrix.shape[0]) == i
    pivot = 1 / matrix[i, i]
    row = jnp.where(own, pivot, matrix[i] * pivot)
    column = jnp.where(own, 0.0, matrix[:, i])
    others = jnp.where(own[:, None] | own, 0.0, matrix) - column[:, None] * row
    return jnp.where(own[:, None], row, others), None
