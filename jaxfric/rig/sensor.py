"""Sensor: how the true friction force becomes the recorded one."""

import abc

import equinox as eqx
from jaxtyping import Array, Float


class AbstractSensor(eqx.Module):
    """Interface of a force sensor."""

    @abc.abstractmethod
    def read(self, ts: Float[Array, " n"], force: Float[Array, " n"]) -> Float[Array, " n"]:
        """The recorded force at the sample times `ts` [s], given the true one there."""


class IdealSensor(AbstractSensor):
    """An ideal sensor: it records the true force."""

    def read(self, ts: Float[Array, " n"], force: Float[Array, " n"]) -> Float[Array, " n"]:
        del ts
        return force
