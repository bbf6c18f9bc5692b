"""The size of the basin of steady sliding, by simulation."""

from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from ..errors import InputError
from ..rig import Rig
from ..simulation import jump_start, step_start
from .ends import ENDS
from .settle import STANDARD, Policy, end_state, traced


class Basin(eqx.Module):
    """Size of the basin of steady sliding, as a ratio of velocities r >= 1.

    `size` is the largest r found such that jumps by every tested factor up to r, in both
    directions, end in steady sliding; `lost` is the smallest tested that does not (inf: none up to
    the largest). r = 1: not even small ones. `up` and `down` are the sizes of one direction.
    """

    size: Float[Array, ""]
    lost: Float[Array, ""]
    up: Float[Array, ""]
    down: Float[Array, ""]
    reason: ENDS
    """How the motion ends after the smallest lost jump, `ENDS.steady` where none is lost."""


class BasinSearch(NamedTuple):
    """Up to which factor a basin is sought, by how many rounds of how many factors each."""

    largest: float | Array = 1e3
    points: int = 8
    rounds: int = 3


def basin(
    rig: Rig,
    velocity: ArrayLike,
    *,
    horizon: ArrayLike,
    decay: ArrayLike | None = None,
    kind: Literal["step", "jump"] = "step",
    search: BasinSearch = BasinSearch(),  # noqa: B008
    policy: Policy = STANDARD,
) -> Basin:
    """The largest perturbation of steady sliding at `velocity` [m/s] that is survived.

    kind "step": the command steps from velocity/r to velocity (up) and from velocity r to
    it (down). kind "jump": the load point jumps by +-F ln(r)/K with F the law's `force_scale`: by
    rate-and-state friction a massless slider's velocity jumps by r. Either way `size` >= 2
    means that perturbations by a factor 2 are survived.

    Bisection in ln(r), `points` at a time in one vmapped call: each round puts that many
    into the bracket and keeps the first interval whose far end is lost. ln(largest)/(points (points
    + 1)^(rounds - 1)) is the resolution in ln(r), 1 % by default. Islands of loss
    narrower than the first round's spacing can be missed.
    """
    if kind not in ("step", "jump"):
        raise InputError(f"basin: kind is {kind!r}; it must be 'step' or 'jump'")
    if not search.largest > 1 or search.points < 2 or search.rounds < 1:
        raise InputError("basin: needs largest > 1, points >= 2 and rounds >= 1")
    V = jnp.asarray(velocity, jnp.result_type(float))
    search = search._replace(largest=jnp.asarray(search.largest, V.dtype))
    return _basin(rig, V, jnp.asarray(horizon, V.dtype), traced(decay), kind, search, policy)


@eqx.filter_jit
def _basin(
    rig: Rig,
    V: Array,
    horizon: Array,
    decay: Array | None,
    kind: str,
    search: BasinSearch,
    policy: Policy,
) -> Basin:
    points, rounds = search.points, search.rounds

    def ends(log_r: Float[Array, ""]) -> ENDS:
        if kind == "step":
            start = step_start(rig, V, jnp.exp(log_r))
        else:
            scale = rig.friction.force_scale() / rig.machine.stiffness
            start = jump_start(rig, V, scale * log_r)
        return end_state(rig, V, start, horizon=horizon, decay=decay, policy=policy).code

    n = jnp.arange(1, points + 1)

    def refine(
        sign: Array, carry: tuple[Array, Array, ENDS], first: Bool[Array, ""]
    ) -> tuple[tuple[Array, Array, ENDS], None]:
        low, high, reason = carry  # high is inf where nothing is lost: no more to refine
        parts = jnp.where(first, points, points + 1)  # the far end is tested the first time only
        grid = low + (jnp.where(jnp.isinf(high), low, high) - low) * n / parts
        found = jax.vmap(ends)(sign * grid)
        lost = found != ENDS.steady
        at, some = jnp.argmax(lost), jnp.any(lost) & jnp.isfinite(high)
        safe = jnp.where(some & (at == 0), low, grid[jnp.where(some, at - 1, -1)])
        reason = ENDS.where(some, jax.tree.map(lambda x: x[at], found), reason)
        high = jnp.where(some, grid[at], jnp.where(first, jnp.inf, high))
        return (safe, high, reason), None

    def direction(sign: Array) -> tuple[Array, Array, ENDS]:
        begun = (
            jnp.zeros_like(V),
            jnp.log(search.largest),
            ENDS.where(True, ENDS.steady, ENDS.steady),
        )
        first = jnp.arange(rounds) == 0
        return jax.lax.scan(lambda carry, f: refine(sign, carry, f), begun, first)[0]

    low, high, reasons = jax.vmap(direction)(jnp.asarray([1.0, -1.0], V.dtype))
    reason = jax.tree.map(lambda x: x[jnp.argmin(high)], reasons)
    up, down = jnp.exp(low)
    return Basin(jnp.minimum(up, down), jnp.exp(jnp.min(high)), up, down, reason)
