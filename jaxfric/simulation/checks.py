"""Checks of a simulation's input: parameters within bounds, ascending times.

An invalid concrete value raises an error that names the value, before any computation. Under `jit`
and `vmap` values are unknown. If the input is invalid, the simulation does not start, and its
`result` is `RESULTS.impossible`.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, PyTree

from ..errors import InputError
from ..motion import AbstractMotion, PiecewiseVelocity
from ..quantity import all_inside, is_known, refuse_batch, refuse_outside
from ..rig import Rig
from .start import InitialState


def refuse_impossible(
    where: str, rig: Rig, ts: Array, start: InitialState, *, motion: AbstractMotion | None = None
) -> None:
    """Raise `InputError` in the name of the function `where` for invalid concrete values.

    A batch of rigs, a parameter of the rig out of bounds, or a start that is not finite, is
    invalid. Sample times
    `ts` are invalid if they are not of one dimension, empty, not finite, descending, or before the
    motion begins.
    """
    if jnp.ndim(ts) != 1 or jnp.size(ts) == 0:
        raise InputError(f"{where}: ts has shape {jnp.shape(ts)}; give one row of times, not empty")
    refuse_outside(rig, where)
    refuse_batch(rig, where)
    given = {f"start.{name}": value for name, value in vars(start).items()} | {"ts": ts}
    for name, value in given.items():
        if value is not None and is_known(value) and not np.all(np.isfinite(np.asarray(value))):
            raise InputError(f"{where}: {name} holds a value that is not finite")
    if not is_known(ts):
        return
    times = np.asarray(ts)
    if np.any(np.diff(times) < 0):
        k = int(np.argmax(np.diff(times) < 0))
        raise InputError(
            f"{where}: ts must ascend; ts[{k + 1}] = {times[k + 1]:g} s comes after"
            f" {times[k]:g} s. Sort the times"
        )
    if isinstance(motion, PiecewiseVelocity) and is_known(motion.times):
        begin = float(np.asarray(motion.times)[0])
        if times[0] < begin:
            raise InputError(
                f"{where}: ts begins at {times[0]:g} s, before the motion, which begins at"
                f" {begin:g} s"
            )


def refuse_no_steady_state(initial: dict[str, Array], V: Array) -> None:
    """Raise `InputError` if the law has no steady sliding at `V` [m/s] to start from."""
    known = all(is_known(value) for value in initial.values())
    if known and not all(np.all(np.isfinite(np.asarray(value))) for value in initial.values()):
        at = f" at {float(V):g} m/s" if is_known(V) else ""
        raise InputError(
            f"simulate: the friction law has no steady sliding{at} to start from; let the motion"
            " begin with a velocity that is not 0, and give the velocity, elongation and state of"
            " another start with `start=InitialState(...)`"
        )


def is_possible(
    rig: Rig,
    ts: Array,
    start: InitialState,
    initial: PyTree[Array],
    *,
    motion: AbstractMotion | None = None,
) -> Bool[Array, ""]:
    """Whether the input of a simulation is valid; the input values may be traced by JAX."""
    fine = [all_inside(rig), jnp.all(jnp.isfinite(ts)), jnp.all(jnp.diff(ts) >= 0)]
    fine += [jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves((start, initial))]
    if isinstance(motion, PiecewiseVelocity):
        fine.append(ts[0] >= motion.times[0])
    return jnp.stack(fine).all()
