"""A force sensor with delay, lag, gain error and drift."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..quantity import quantity
from .sensor import AbstractSensor


class ImperfectSensor(AbstractSensor):
    """A sensor with a delay, then a first-order lag, then gain and drift; ideal with all zero.

        tau y' = f(t - d) - y,   recorded = (1 + g) y + r t

    The times `ts` ascend from the start of the record; before the start friction is steady.
    Friction is linear between samples, so the sampling interval must not exceed tau and d. A
    negative tau or d is unphysical; the formula is continued to first order, so that a fit can
    cross 0.
    """

    tau: Float[Array, ""] = quantity("tau", "s", "time constant of the sensor", default=0.0)
    delay: Float[Array, ""] = quantity("d", "s", "delay of the sensor", default=0.0)
    drift: Float[Array, ""] = quantity("r", "F/s", "drift of the sensor", default=0.0)
    gain: Float[Array, ""] = quantity("g", "1", "error of the sensor's gain", default=0.0)

    def read(self, ts: Float[Array, " n"], force: Float[Array, " n"]) -> Float[Array, " n"]:
        y = self._lagged(ts, self._delayed(ts, force))
        return (1 + self.gain) * y + self.drift * (ts - ts[0])

    def _delayed(self, ts: Float[Array, " n"], force: Float[Array, " n"]) -> Float[Array, " n"]:
        slope = _backward_slope(ts, force)
        early = jnp.interp(ts - self.delay, ts, force)
        within = jnp.abs(self.delay) <= jnp.diff(ts, prepend=ts[:1])
        return jnp.where(within, force - self.delay * slope, early)

    def _lagged(self, ts: Float[Array, " n"], force: Float[Array, " n"]) -> Float[Array, " n"]:
        steps = jnp.diff(ts, prepend=ts[:1])
        slope = _backward_slope(ts, force)
        safe = jnp.where(self.tau > 0, self.tau, 1.0)
        keep = jnp.where((self.tau > 0) & (steps > 0), jnp.exp(-steps / safe), 0.0)
        keep = jnp.where(steps > 0, keep, 1.0)  # padding repeats the last time
        # the lag behind a ramp is tau times its slope; the rest decays from sample to sample
        target = force - self.tau * slope
        start = jnp.concatenate([force[:1], force[:-1]]) - self.tau * slope

        def combine(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
            return a[0] * b[0], b[0] * a[1] + b[1]

        # y_n = target_n + keep_n (y_{n-1} - start_n)
        gain, offset = keep, target - keep * start
        gain, offset = gain.at[0].set(0.0), offset.at[0].set(force[0])
        return jax.lax.associative_scan(combine, (gain, offset))[1]


def _backward_slope(ts: Float[Array, " n"], force: Float[Array, " n"]) -> Float[Array, " n"]:
    steps = jnp.diff(ts, prepend=ts[:1])
    rise = jnp.diff(force, prepend=force[:1])
    return jnp.where(steps > 0, rise / jnp.where(steps > 0, steps, 1.0), 0.0)
