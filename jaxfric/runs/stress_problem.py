"""The least-squares problem of one step of the normal stress while the load point moves steadily.

A slider without mass on a spring slides steadily at V under a normal stress sigma_1. After this
sliding the normal stress changes to sigma_2, piecewise linearly. With n = sigma/sigma_1 and
friction f = tau/sigma the equations of motion are:

    n f = f_1 + K (V t - x),    f = f0 + A ln(dx/dt/V) + theta (+ s x),
    dtheta/dt = g(theta, dx/dt) - alpha n'/n,

with g of the slip or the ageing law. K [1/m] is the stiffness under sigma_1; the balance of n f
implies the stiffness K sigma_1/sigma at other normal stresses. V is the reference velocity, so that
theta starts at 0.

Source: Linker & Dieterich 1992, J. Geophys. Res. 97, 4923-4940, whose state Theta is called theta
here.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..effects.friction import NormalStressState
from ..fitting.padding import bucket, filled
from ..fitting.problem import Model
from ..fitting.thresholds import FAILED_MISFIT
from ..motion import PiecewiseVelocity
from ..rig.normal_stress import NormalStress
from ..simulation import RESULTS, simulate
from ..traced import traced

NAMES = ("f0", "A", "B", "L", "K", "alpha", "slip_trend", "late", "longer")
"""Parameters in the order of the unbounded vector; `slip_trend` [1/m] is the trend s. The change of
stress begins `late` [s] after its first corner, and takes exp(`longer`) times as long."""
LOGARITHMS = ("A", "L", "K")
CORNERS = 32
"""Largest number of corners of the stress; fewer are padded, so that one shape is compiled."""


class StressRows(NamedTuple):
    """Rows around a change of the normal stress, time from 0 [s]; rows of weight 0 are not used.

    The stress is constant before the first corner [s] and after the last. `ratios` are the stresses
    at the corners (at most `CORNERS`), divided by the initial stress. `unsure` is the covariance of
    the delay `late` and of the change `longer` of ln duration.
    """

    time: np.ndarray
    friction: np.ndarray
    weight: np.ndarray
    corners: np.ndarray
    ratios: np.ndarray
    unsure: np.ndarray


class StressStep(eqx.Module):
    """The padded rows around a step of the normal stress, on the device; SI, time from 0."""

    rows: StressRows
    clock: Float[Array, "n 3"]
    velocity: Float[Array, ""]
    noise: Float[Array, ""]
    """Noise level, the unit of residuals."""
    sizes: Float[Array, " p"]
    """Units of the unbounded parameters; 1 for logarithms."""
    law: str = eqx.field(static=True)

    def natural(self, z: Float[Array, " p"]) -> dict[str, Array]:
        """Return the parameters (SI) by name from the unbounded vector."""
        pairs = zip(NAMES, z * self.sizes, strict=True)
        return {name: jnp.exp(v) if name in LOGARITHMS else v for name, v in pairs}

    def predict(self, z: Float[Array, " p"]) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Return friction at all rows, and whether the simulation succeeded."""
        p = self.natural(z)
        model = Model(self.law, 1, False, True)
        values = [p[name] for name in ("f0", "A", "B", "L", "slip_trend")]
        rig = model.rig(jnp.stack(values), self.velocity, p["K"])
        rig = NormalStressState(p["alpha"]).embed(rig)
        rig = eqx.tree_at(
            lambda r: r.normal_stress,
            rig,
            self._stress(p["late"], p["longer"]),
            is_leaf=lambda x: x is None,
        )
        motion = PiecewiseVelocity(jnp.zeros(1), self.velocity[None])
        out = simulate(rig, motion, jnp.asarray(self.rows.time), rtol=1e-5, runaway=1e6)
        return out.recorded, out.result == RESULTS.successful

    def residual(self, z: Float[Array, " p"]) -> Float[Array, " n"]:
        """Return (predicted - recorded)/noise, 0 without weight; `FAILED_MISFIT` on failure."""
        seen, succeeded = self.predict(z)
        off = (seen - self.rows.friction) / self.noise
        return jnp.where(succeeded & jnp.isfinite(off), off, FAILED_MISFIT) * self.rows.weight

    def _stress(self, late: Float[Array, ""], longer: Float[Array, ""]) -> NormalStress:
        time, corners, ratios = self.rows.time, self.rows.corners, self.rows.ratios
        times = corners[0] + late + (corners - corners[0]) * jnp.exp(longer)
        widths, rises = jnp.diff(times), jnp.diff(ratios)
        slopes = jnp.where(widths > 0, rises / jnp.where(widths > 0, widths, 1.0), 0.0)
        slopes = jnp.concatenate([jnp.zeros(1), slopes, jnp.zeros(1)])
        levels = jnp.concatenate([ratios[:1], ratios])
        zero = jnp.zeros_like(slopes)
        span = jnp.stack([time[0], time[-1]])
        return NormalStress(
            jnp.concatenate([time[:1], times]), jnp.stack([zero, zero, slopes, levels]), span
        )


@traced
def residual_and_slopes(
    problem: StressStep, z: Float[Array, " p"]
) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
    """Return the residual and its Jacobian from one solve with all tangents."""

    def both(z: Array) -> tuple[Array, Array]:
        off = problem.residual(z)
        return off, off

    slopes, off = jax.jacfwd(both, has_aux=True)(z)
    return off, slopes


@traced
def predicted(problem: StressStep, z: Float[Array, " p"]) -> Float[Array, " n"]:
    """Return friction at all rows."""
    return problem.predict(z)[0]


def make_stress_step(
    rows: StressRows, *, velocity: float, noise: float, sizes: np.ndarray, law: str
) -> StressStep:
    """Return the problem of these rows, padded so that JAX compiles few array lengths."""
    n = len(rows.time)
    size = bucket(n)
    clock = np.stack([rows.time, velocity * rows.time, np.arange(n, dtype=float)], axis=1)
    padded = StressRows(
        filled(rows.time, size),
        filled(rows.friction, size),
        filled(rows.weight, size, 0.0),
        filled(rows.corners, CORNERS),
        filled(rows.ratios, CORNERS),
        rows.unsure,
    )
    numbers = (padded, filled(clock, size), np.array(velocity), np.array(noise), sizes)
    return StressStep(*jax.device_put(numbers), law)
