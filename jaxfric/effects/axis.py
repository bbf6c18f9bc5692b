"""Effects of an axis beyond mass, Coulomb and viscous friction and an offset.

Axis effects modify an `AxisRig`. An effect at its null changes nothing.
"""

from collections.abc import Mapping
from types import MappingProxyType

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..quantity import quantity
from ..rig.axis import AbstractAxisTerm, AxisPoint, AxisRig
from ..rig.axis_state import AbstractAxisState, AxisRateState, Bristle
from ..rig.thresholds import NEAR_ZERO
from .effect import (
    AbstractEffect,
    AbstractLinearEffect,
    AbstractPlaceEffect,
    Limit,
    RecordScales,
    always,
)
from .thresholds import CUT_OFF, DAMPING_FELT, LEAST_WAVES

ANGLE = "angle"
"""Channel of a rotary axis: its position in radians."""
_CUT_OFF_LIMIT: Mapping[str, Limit] = MappingProxyType(
    {"v_c": lambda at, scales: at.v_c < CUT_OFF * scales.slowest}
)


class AbstractAxisEffect(AbstractEffect[AxisRig]):
    """One effect of an axis."""

    rigs = (AxisRig,)


class AbstractAxisTermEffect(AbstractAxisEffect, AbstractAxisTerm):
    """An effect that is itself the added force term."""

    def embed(self, rig: AxisRig) -> AxisRig:
        """Add this force to the rig's terms."""
        return _with(rig, self)


class AbstractLinearAxisEffect(AbstractLinearEffect[AxisRig], AbstractAxisEffect):
    """An effect of an axis without shape parameters."""


def _with(rig: AxisRig, term: AbstractAxisTerm) -> AxisRig:
    return eqx.tree_at(lambda r: r.terms, rig, (*rig.terms, term))


def _remembering(rig: AxisRig, state: AbstractAxisState) -> AxisRig:
    return eqx.tree_at(lambda r: r.states, rig, (*rig.states, state))


class DirectionAsymmetry(AbstractLinearAxisEffect, AbstractAxisTermEffect):
    """+ d |v|: viscous friction F_v + d forwards and F_v - d backwards.

    The offset of the base law describes Coulomb friction that differs by direction.
    """

    id = "direction_asymmetry"
    equation = "+ d |v|"
    meaning = "Friction grows faster with speed in one direction than in the other."
    confused_with = ("position_dependence",)
    separated_by = ("several speeds in both directions over the same travel",)
    d: Float[Array, ""] = quantity("d", "F s/m", "half the difference by direction", default=0.0)

    def force(self, at: AxisPoint) -> Array:
        return self.d * at.velocity * at.sign

    def physical(self) -> Bool[Array, ""]:
        return always()


class Cubic(AbstractLinearAxisEffect, AbstractAxisTermEffect):
    """Friction cubic in velocity: + c v^3."""

    id = "cubic"
    equation = "+ c v^3"
    meaning = (
        "Friction grows faster than in proportion to speed, like drag of air or a fluid, or slower."
    )
    confused_with = ("stribeck",)
    separated_by = ("four speeds", "the slowest well below the others")
    c: Float[Array, ""] = quantity("c", "F s^3/m^3", "cubic friction", default=0.0)

    def force(self, at: AxisPoint) -> Array:
        return self.c * at.velocity**3

    def physical(self) -> Bool[Array, ""]:
        return always()


class AxisStribeck(AbstractAxisTermEffect):
    """+ fs exp(-(|v|/vs)^n) sgn v; fits start from n = 1 (Bo and Pavelescu 1982) and 2."""

    id = "stribeck"
    equation = "+ fs exp(-(|v|/vs)^n) sgn v"
    meaning = (
        "Friction is higher at low speed and falls as the speed passes vs, as a lubricant "
        "lifts the surfaces apart."
    )
    confused_with = ("cubic", "presliding", "log_viscous")
    separated_by = ("steady speeds around vs, apart from reversals",)
    fs: Float[Array, ""] = quantity("fs", "F", "more friction at low speed", default=0.0)
    vs: Float[Array, ""] = quantity("vs", "m/s", "Stribeck velocity", lower=0.0, default=1.0)

    n: Float[Array, ""] = quantity("n", "1", "exponent", lower=0.3, upper=3.0, default=1.0)

    def force(self, at: AxisPoint) -> Array:
        # at speed 0 the power has no derivative
        share = jnp.maximum(jnp.abs(at.velocity) / self.vs, NEAR_ZERO)
        return self.fs * jnp.exp(-(share**self.n)) * at.sign

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        speeds = np.geomspace(0.3 * scales.slowest, 0.7 * scales.fastest, 14)
        return {"vs": (*speeds, *speeds), "n": (1.0,) * 14 + (2.0,) * 14}

    def physical(self) -> Bool[Array, ""]:
        return self.fs > 0


class LogViscous(AbstractAxisEffect, AbstractAxisTerm):
    """+ c ln(1 + |v|/v_c) sgn v: friction that grows with speed, at a decreasing rate.

    Well below the speed v_c logarithmic friction is viscous, with the force c v/v_c. Above the
    speed v_c logarithmic friction grows by c for each factor e in speed, as for a shear-thinning
    lubricant. (The asinh of the speed in Eyring 1936, doi:10.1063/1.1749836, is also first linear
    and then logarithmic.) The speed v_c is at least the width of the smoothed sign; below this
    width friction is not modelled. If all speeds of a record are far above v_c, a change of v_c
    acts like Coulomb friction. A record with only speeds far above v_c determines c but not v_c.
    """

    id = "log_viscous"
    equation = "+ c ln(1 + |v|/v_c) sgn v"
    meaning = (
        "Friction grows with speed at a decreasing rate: steep at low speed, flat at high speed."
    )
    confused_with = ("viscous", "stribeck")
    separated_by = ("two decades of speed",)
    c: Float[Array, ""] = quantity("c", "F", "growth over a factor of e in speed", default=0.0)
    v_c: Float[Array, ""] = quantity(
        "v_c", "m/s", "speed of the bend", lower=0.0, default=1.0, shape_only=True
    )
    limits = _CUT_OFF_LIMIT

    def embed(self, rig: AxisRig) -> AxisRig:
        return _with(rig, LogViscous(self.c, jnp.maximum(self.v_c, rig.width)))

    def force(self, at: AxisPoint) -> Array:
        return self.c * jnp.log1p(jnp.abs(at.velocity) / self.v_c) * at.sign

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        return {"v_c": tuple(np.geomspace(0.1 * scales.slowest, scales.fastest, 12))}

    def physical(self) -> Bool[Array, ""]:
        return self.c > 0


class AxisPositionPeriodic(AbstractAxisTermEffect, AbstractPlaceEffect[AxisRig]):
    """+ c cos(2 pi q/wavelength) + s sin(...): the pitch of a screw, the teeth of a belt, cogging.

    Wavelengths are searched from twice the travel down to the resolution of the decimated rows at
    the median speed. At least 1.5 waves must fit in the travel. A shorter piece of a wave looks
    like gravity or another smooth curve.
    """

    id = "position_periodic"
    equation = "+ c cos(2 pi q/wavelength) + s sin(2 pi q/wavelength)"
    meaning = (
        "Force ripples with position: the pitch of a screw, the teeth of a belt or a motor's "
        "cogging."
    )
    confused_with = ("position_dependence",)
    separated_by = ("more travel",)
    c: Float[Array, ""] = quantity("c", "F", "cosine amplitude", default=0.0)
    s: Float[Array, ""] = quantity("s", "F", "sine amplitude", default=0.0)
    wavelength: Float[Array, ""] = quantity("lambda", "m", "wavelength", lower=0.0, default=1.0)
    limits = MappingProxyType(
        {"wavelength": lambda at, scales: scales.total_slip < LEAST_WAVES * at.wavelength}
    )

    def force(self, at: AxisPoint) -> Array:
        phase = 2 * jnp.pi * at.position / self.wavelength
        return self.c * jnp.cos(phase) + self.s * jnp.sin(phase)

    def softest_spring(self) -> Float[Array, ""]:
        """-2 pi sqrt(c^2 + s^2)/lambda, the steepest descent of the wave."""
        return -2 * jnp.pi * jnp.hypot(self.c, self.s) / self.wavelength

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        travel = scales.total_slip
        shortest = max(scales.step_slip, travel / 500)
        # wavelengths are distinguishable if their numbers of waves in the travel differ by half
        number = 2 * int(np.ceil(2 * travel / shortest))
        waves = np.arange(2, number + 1) / (2 * 2 * travel)
        return {"wavelength": tuple(1 / waves[waves * shortest < 1])}


class Gravity(AbstractLinearAxisEffect, AbstractAxisTermEffect, AbstractPlaceEffect[AxisRig]):
    """+ a sin q + b cos q, q in radians: torque m g l of a joint's load, for any zero of the angle.

    For rotary axes only. The angle q is that of the joint; on the motor side of a gear the period
    of the torque differs.
    """

    id = "gravity"
    equation = "+ a sin q + b cos q"
    meaning = (
        "A torque goes with the sine of the angle: the weight of what a joint carries, or whatever "
        "else comes once a turn."
    )
    confused_with = ("position_dependence", "position_periodic")
    separated_by = ("more of a turn, and another load",)
    channel = ANGLE
    a: Float[Array, ""] = quantity("a", "F", "torque of the weight with the sine", default=0.0)
    b: Float[Array, ""] = quantity("b", "F", "torque of the weight with the cosine", default=0.0)

    def force(self, at: AxisPoint) -> Array:
        return self.a * jnp.sin(at.position) + self.b * jnp.cos(at.position)

    def softest_spring(self) -> Float[Array, ""]:
        """-sqrt(a^2 + b^2) per radian, where the load is at its highest point."""
        return -jnp.hypot(self.a, self.b)


class PositionDependence(
    AbstractLinearAxisEffect, AbstractAxisTermEffect, AbstractPlaceEffect[AxisRig]
):
    """+ (k + m sgn v) q: a spring or a slope, and friction that grows along the travel."""

    id = "position_dependence"
    equation = "+ (k + m sgn v) q"
    meaning = (
        "Force or friction changes along the travel: a spring, a slope, or a guide that is "
        "tighter at one end."
    )
    confused_with = ("direction_asymmetry", "time_drift")
    separated_by = ("several passes over the same travel in both directions",)
    k: Float[Array, ""] = quantity("k", "F/m", "stiffness along the travel", default=0.0)
    m: Float[Array, ""] = quantity("m", "F/m", "growth of friction along the travel", default=0.0)

    def force(self, at: AxisPoint) -> Array:
        return (self.k + self.m * at.sign) * at.position

    def softest_spring(self) -> Float[Array, ""]:
        """Least stiffness over both directions: k - |m|."""
        return self.k - jnp.abs(self.m)


class AxisTimeDrift(AbstractLinearAxisEffect, AbstractAxisTermEffect):
    """+ (r + s sgn v) t: an offset or friction that drifts, as with warming up."""

    id = "time_drift"
    equation = "+ (r + s sgn v) t"
    meaning = "Force or friction drifts with time, as with warming up."
    confused_with = ("position_dependence",)
    separated_by = ("the first motion repeated at the end",)
    r: Float[Array, ""] = quantity("r", "F/s", "drift of the offset", default=0.0)
    s: Float[Array, ""] = quantity("s", "F/s", "drift of Coulomb friction", default=0.0)

    def force(self, at: AxisPoint) -> Array:
        return (self.r + self.s * at.sign) * at.time

    def physical(self) -> Bool[Array, ""]:
        return always()


class Presliding(AbstractAxisEffect):
    """+ a (z/x_c - sgn v) + sigma_1 z', z' = v - |v| z/x_c: after a reversal Coulomb friction
    recovers over a distance. With sigma_1 = 0 the bristle follows Dahl's model, otherwise the LuGre
    model.

    The damping sigma_1 acts only while the bristle bends: at low speed, within a few lengths x_c of
    a reversal. So a force of sigma_1 times the speed of a stroke never occurs. A record may
    therefore determine the bristle but not the damping sigma_1. The length x_c must be short enough
    for friction to recover within half of the travel. A noticeable negative damping sigma_1 is
    refused, because it would feed energy into the motion.
    """

    id = "presliding"
    equation = "+ a (z/x_c - sgn v) + sigma_1 z', z' = v - |v| z/x_c"
    meaning = (
        "After a reversal friction does not jump: it recovers over a short distance, as a "
        "bristle bends."
    )
    confused_with = ("servo_lag", "stribeck")
    separated_by = ("slow reversals, smaller than the presliding distance",)
    a: Float[Array, ""] = quantity("a", "F", "part of Coulomb friction on a bristle", default=0.0)
    sigma_1: Float[Array, ""] = quantity(
        "sigma_1", "F s/m", "damping of the bristle", default=0.0, shape_only=True
    )
    x_c: Float[Array, ""] = quantity("x_c", "m", "presliding distance", lower=0.0, default=1.0)
    limits = MappingProxyType(
        {
            "x_c": lambda at, scales: 6 * at.x_c > scales.total_slip,
            "sigma_1": lambda at, scales: -at.sigma_1 * scales.slowest > DAMPING_FELT * at.a,
        }
    )

    def embed(self, rig: AxisRig) -> AxisRig:
        return _remembering(rig, Bristle(self.a, self.sigma_1, self.x_c))

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        return {"x_c": tuple(np.geomspace(1e-6, 0.05, 16) * scales.total_slip)}

    def physical(self) -> Bool[Array, ""]:
        return self.a > 0


class RateAndState(AbstractAxisEffect):
    """+ sgn(v) [A ln(1 + |v|/v_c) + theta], theta' = (|v|/L) (-B ln(1 + |v|/v_c) - theta).

    If velocity rises by a factor e, friction changes by A at once and by -B over the slip length L.
    The effect is the slip law of Ruina (1983, doi:10.1029/JB088iB12p10359), except that friction
    levels off below v_c. The effect is physical if A > 0 and B > 0. The direct effect is due to
    creep at the contacts; without a direct effect sliding is ill-posed (Rice, Lapusta & Ranjith
    2001, doi:10.1016/S0022-5096(01)00042-4). The state is the strength that contacts gain with age
    and lose by slip (Dieterich 1979, doi:10.1029/JB084iB05p02161). B < 0 describes a curved
    dependence on velocity, not a memory of the contacts.

    The slip length L is at least the distance between two rows where the axis is slowest. With a
    shorter L a record determines only A - B and B L. A fit with a shorter L drifts to values of A
    and B far above all friction. The velocity v_c is at least the width of the smoothed sign; below
    this width friction is not modelled.
    """

    id = "rate_and_state"
    equation = "+ sgn(v) [A ln(1 + |v|/v_c) + theta], theta' = (|v|/L)(-B ln(1 + |v|/v_c) - theta)"
    meaning = (
        "Friction remembers the velocity over a distance L, so that the axis may stick-slip at low "
        "speed if the controller is soft."
    )
    confused_with = ("stribeck", "presliding", "cubic", "log_viscous")
    separated_by = ("steps of velocity within a stroke, and reversals",)
    A: Float[Array, ""] = quantity("A", "F", "direct effect", default=0.0)
    B: Float[Array, ""] = quantity("B", "F", "evolution effect", default=0.0)
    L: Float[Array, ""] = quantity("L", "m", "characteristic slip length", lower=0.0, default=1.0)
    v_c: Float[Array, ""] = quantity("v_c", "m/s", "cut-off velocity", lower=0.0, default=1.0)
    limits = _CUT_OFF_LIMIT

    def embed(self, rig: AxisRig) -> AxisRig:
        L, v_c = jnp.maximum(self.L, rig.reach), jnp.maximum(self.v_c, rig.width)
        return _remembering(rig, AxisRateState(self.A, self.B, L, v_c))

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        longest = 0.1 * scales.total_slip
        lengths = np.geomspace(min(scales.slowest * scales.interval, 0.1 * longest), longest, 7)
        speeds = np.geomspace(0.1 * scales.slowest, 0.5 * scales.fastest, 5)
        return {"L": tuple(np.repeat(lengths, 5)), "v_c": tuple(np.tile(speeds, 7))}

    def physical(self) -> Bool[Array, ""]:
        return (self.A > 0) & (self.B > 0)


class AxisServoLag(AbstractLinearAxisEffect):
    """A motor force F_m that lags the recorded force F: tau F_m' = F - F_m."""

    id = "servo_lag"
    room = "drive"
    equation = "tau F_m' = F - F_m"
    meaning = "The motor's force lags behind the recorded one."
    confused_with = ("sensor_delay", "sensor_lag", "presliding")
    separated_by = ("the motor's measured current in place of its command",)
    tau: Float[Array, ""] = quantity("tau", "s", "time constant of the motor", default=0.0)

    def embed(self, rig: AxisRig) -> AxisRig:
        return eqx.tree_at(lambda r: r.lag, rig, self.tau)

    def physical(self) -> Bool[Array, ""]:
        return self.tau > 0


class AxisSensorLag(AbstractLinearAxisEffect):
    """A recorded force y that lags: tau y' = F - y."""

    id = "sensor_lag"
    room = "sensor"
    equation = "tau y' = F - y"
    meaning = "The recorded force lags behind the motor's force, as after a low-pass filter."
    confused_with = ("sensor_delay", "servo_lag")
    separated_by = ("a force step into a blocked axis",)
    tau: Float[Array, ""] = quantity("tau", "s", "time constant of the force channel", default=0.0)

    def embed(self, rig: AxisRig) -> AxisRig:
        return eqx.tree_at(lambda r: r.late, rig, self.tau)

    def physical(self) -> Bool[Array, ""]:
        return self.tau > 0


class AxisSensorDelay(AbstractLinearAxisEffect):
    """A recorded position delayed by d against the recorded force; d < 0: ahead of the force."""

    id = "sensor_delay"
    room = "sensor"
    equation = "q_recorded(t) = q(t - d)"
    meaning = "Position and force are recorded at different moments."
    confused_with = ("servo_lag", "sensor_lag", "presliding")
    separated_by = ("the motor's measured current in place of its command",)
    d: Float[Array, ""] = quantity("d", "s", "delay of the position behind the force", default=0.0)

    def embed(self, rig: AxisRig) -> AxisRig:
        return eqx.tree_at(lambda r: r.delay, rig, self.d)

    def physical(self) -> Bool[Array, ""]:
        return always()


IN_TIME = frozenset(e.id for e in (AxisServoLag, AxisSensorLag, AxisSensorDelay))
"""Effects that shift force and motion in time against each other. To first order a record shows
only the sum of such shifts. Two such effects with opposite signs smooth the encoder's error, which
lowers the residual without any physical cause. So a model has at most one such effect."""
AXIS_STEADY_CURVES = (Cubic.id, AxisStribeck.id, LogViscous.id)
"""Effects that add an odd function of velocity alone."""
