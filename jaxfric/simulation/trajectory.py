"""The result of a simulation, and the ways in which it can end."""

import dataclasses

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..described import Described, Drawable, Gridded, Tabular


class RESULTS(diffrax.RESULTS):  # ty: ignore[subclass-of-final-class]
    """How a simulation ended: `successful`, or the reason for an early end."""

    successful = ""
    ran_away = (
        "The slider ran away: its velocity passed the runaway limit. A slider without mass "
        "does this where a real one slips fast (stiffness near or below critical). Raise the "
        "stiffness, take smaller velocity steps, or give the slider a mass."
    )
    came_to_rest = (
        "The slider came to rest, where a delay law is undefined. This happens in unstable steady "
        "motion, whose oscillation grows, and after a large disturbance. "
        "Choose a stable stiffness, more damping or a smaller disturbance, or a law that "
        "is valid at rest."
    )
    too_few_intervals = (
        "The simulated delays ended before the last sample time. `intervals` is too small "
        "for these times. Raise it to at least (ts[-1] - ts[0])/delay, or shorten `ts`."
    )
    unresolved = (
        "One step could not be resolved. The motion is too fast for the number of steps in a "
        "delay: a stiff spring, a long delay, or a velocity near zero. Raise `pieces` or `rtol`."
    )
    impossible = (
        "The input is impossible: a stiffness, mass, A, L, V0 or delay that is not above 0, "
        "sample times that descend, are not finite or begin before the motion, or a start that "
        "is not finite. Nothing was simulated. Call it outside jit and vmap for an error that "
        "names the value."
    )


class Trajectory(Described, Drawable, Gridded, Tabular, eqx.Module):
    """Motion and friction of the slider at the sample times.

    `force`, `recorded` and `state` are in the unit of friction (N, or 1 for a coefficient). All
    values are finite for every `result`. After a failure at time `end` the trajectory repeats the
    last values. With `RESULTS.impossible` all values are 0.
    """

    time: Float[Array, " n"]
    """Sample times [s]."""
    force: Float[Array, " n"]
    """Friction force on the slider."""
    recorded: Float[Array, " n"]
    """The force as the sensor records it."""
    velocity: Float[Array, " n"]
    """Velocity of the slider [m/s]."""
    slip: Float[Array, " n"]
    """Displacement of the slider since the start [m]."""
    state: Float[Array, "n states"]
    """State variables of the friction law."""
    result: RESULTS
    """`RESULTS.successful`, or why the simulation ended early."""
    end: Float[Array, ""]
    """The time that the simulation reached [s]."""
    num_steps: Int[Array, ""]
    """Solver steps taken, rejected ones included."""


def only_if(possible: Bool[Array, ""], found: Trajectory) -> Trajectory:
    """Return the trajectory, or zeros and `RESULTS.impossible` for invalid input."""
    names = ("force", "recorded", "velocity", "slip", "state", "end")
    values = {name: jnp.where(possible, getattr(found, name), 0.0) for name in names}
    result = RESULTS.where(possible, found.result, RESULTS.impossible)
    return dataclasses.replace(found, result=result, **values)


_OWN = ("successful", "ran_away", "came_to_rest", "too_few_intervals", "unresolved", "impossible")
_WORDS = {name: name.replace("_", " ") for name in _OWN}
_WORDS |= {"max_steps_reached": "exhausted max_steps"}


def result_words(result: RESULTS) -> str | np.ndarray:
    """A result in words, "successful" or "ran away"; an array for a batch.

    For every failure of the solver except too many steps the words are "the solver failed".
    """
    found = np.full(np.shape(result == RESULTS.successful), "the solver failed", dtype=object)
    for name, words in _WORDS.items():
        found[np.asarray(result == getattr(RESULTS, name))] = words
    return found if found.ndim else str(found)
