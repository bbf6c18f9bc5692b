"""Sensor: from the true friction force to the recorded force."""

import abc

import equinox as eqx
from jaxtyping import Array, Float


class AbstractSensor(eqx.Module):
    """Interface of a force sensor."""

    @abc.abstractmethod
    def read(self, ts: Float[Array, " n"], force: Float[Array, " n"]) -> Float[Array, " n"]:
        """The recorded force for the true `force` at the sample times `ts` [s]."""


class IdealSensor(AbstractSensor):
    """An ideal sensor: it records the true force."""

    def read(self, ts: Float[Array, " n"], force: Float[Array, " n"]) -> Float[Array, " n"]:
        del ts
        return force
