"""The slider and the axis whose residuals are drawn, and how they answer to an effect."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxfric import PiecewiseVelocity, QuasiStatic, RateState, Rig, simulate
from jaxfric.effects import AbstractEffect, AbstractHeavyEffect, made, parameters
from jaxfric.motion import MeasuredMotion
from jaxfric.rig.axis import AxisRig
from jaxfric.rig.normal_stress import NormalStress, stress_of_levels

VELOCITIES, SLIP, ROWS = (1.0, 10.0, 1.0, 3.0, 10.0, 1.0), 150.0, 250
"""Velocities [um/s], slip of each [um], rows of each."""
_SHAPES = {
    "second_state": {"L2": 60e-6},
    "stribeck": {"Vs": 3e-6, "d": 1.0},
    "run_in": {"dc": 2e-4},
    "thermal": {"tau_T": 30.0},
    "position_periodic": {"wavelength": 8e-5},
}
_AXIS_SHAPES = {
    "stribeck": {"vs": 0.02},
    "log_viscous": {"v_c": 0.03},
    "position_periodic": {"wavelength": 0.01},
    "presliding": {"x_c": 2e-3},
    "rate_and_state": {"L": 1e-3, "v_c": 5e-3},
}


class SliderSteps:
    """A slip law of one state, A .010, B .014, L 20 um, on a spring five times critical."""

    label = "load-point displacement [µm]; above: its velocity [µm/s]"

    def __init__(self) -> None:
        speeds = 1e-6 * np.asarray(VELOCITIES)
        spans = 1e-6 * SLIP / speeds
        starts = np.concatenate([[0.0], np.cumsum(spans)[:-1]])
        self.motion = PiecewiseVelocity(starts, speeds)
        rows = (np.arange(ROWS) + 0.5) / ROWS
        self.ts = jnp.asarray(
            np.concatenate([t + rows * d for t, d in zip(starts, spans, strict=True)])
        )
        self.along = SLIP * (np.arange(len(VELOCITIES) * ROWS) + 0.5) / ROWS
        self.marks = [(SLIP * i, f"{v:g}") for i, v in enumerate(VELOCITIES)]
        self.values = jnp.asarray([0.6, 0.010, 0.014, 20e-6])

    def rig(self, values: jax.Array, stress: NormalStress | None = None) -> Rig:
        """The rig of f0, A, B, L."""
        f0, A, B, L = values
        law = RateState(f0=f0, A=A, B=[B], L=[L], V0=1e-6)
        return Rig(QuasiStatic(1e3), law, normal_stress=stress)

    def base(self) -> np.ndarray:
        """How the record changes with f0, A, B and L, a column each."""

        def record(values: jax.Array) -> jax.Array:
            return simulate(self.rig(values), self.motion, self.ts).recorded

        return np.asarray(jax.jacfwd(record)(self.values))

    def change(self, effect: type[AbstractEffect]) -> np.ndarray:
        """How the record changes with the first amplitude of an effect, at its null."""
        name = next(iter(parameters(effect)))
        shape = _SHAPES.get(effect.id, {})
        stress = self._stress() if effect.channel == "normal_stress" else None

        def record(amplitude: jax.Array) -> jax.Array:
            one = made(effect, {name: amplitude, **shape})
            embed = one.embed_first_order if isinstance(one, AbstractHeavyEffect) else one.embed
            rig = embed(self.rig(self.values, stress))
            return simulate(rig, self.motion, self.ts).recorded

        _, change = jax.jvp(record, (jnp.asarray(0.0),), (jnp.asarray(1.0),))
        return np.asarray(change)

    def _stress(self) -> NormalStress:
        """A normal stress that is 10 % higher during the third and the fourth velocity."""
        begins = np.asarray(self.motion.times)[[2, 4]]
        return stress_of_levels(begins, begins + 1.0, np.asarray([1.0, 1.1, 1.0]))


class AxisStrokes:
    """A mass that goes to and fro at four speeds, against Coulomb and viscous friction; or a joint
    that turns by two radians."""

    speeds = (0.01, 0.04, 0.1, 0.2)
    travel = 0.1

    def __init__(self, *, turns: bool = False) -> None:
        step = 2e-3
        size, shown, unit = (20.0, 1.0, "rad") if turns else (1.0, 1e3, "mm")
        self.label = f"distance travelled [{unit}]; above: the speed of the stroke [{unit}/s]"
        strokes, marks, gone = [], [], 0.0
        for speed in self.speeds:
            for way in (1, -1):
                marks.append((shown * gone, f"{way * speed * size * shown:g}"))
                strokes.append(way * size * self._stroke(speed, step))
                gone += float(np.sum(np.abs(strokes[-1]))) * step
        velocity = np.concatenate(strokes)
        time = step * np.arange(len(velocity))
        position = np.cumsum(velocity) * step
        path = np.cumsum(np.abs(velocity)) * step
        acceleration = np.gradient(velocity, step)
        columns = (time, position, velocity, acceleration, path)
        self.motion = MeasuredMotion(*(jnp.asarray(column) for column in columns))
        self.rig = AxisRig(95.0, 200.0, 20.0, -3.0, width=5e-4, reach=2e-5)
        self.moves = np.abs(velocity) > 2e-3 * size
        self.along = shown * path[self.moves]
        self.marks = marks

    def _stroke(self, speed: float, step: float) -> np.ndarray:
        """Velocities of a stroke: up to the speed and down again in 0.2 s each."""
        rise = np.sin(np.linspace(0, np.pi / 2, int(0.2 / step))) ** 2
        even = np.ones(int((self.travel / speed) / step))
        return speed * np.concatenate([rise, even, rise[::-1]])

    def base(self) -> np.ndarray:
        """How the motor force changes with M, F_v, F_c and F_0, a column each."""
        m = self.motion
        columns = [m.acceleration, m.velocity, self.rig.sign(m.velocity), jnp.ones_like(m.time)]
        return np.stack([np.asarray(column) for column in columns], axis=1)[self.moves]

    def change(self, effect: type[AbstractEffect]) -> np.ndarray:
        """How the recorded motor force changes with the first amplitude of an effect.

        A lag or a delay tau of force against motion shifts the force by tau dF/dt.
        """
        name = next(iter(parameters(effect)))
        shape = _AXIS_SHAPES.get(effect.id, {})

        def record(amplitude: jax.Array) -> jax.Array:
            rig = made(effect, {name: amplitude, **shape}).embed(self.rig)
            force = rig.force(self.motion)
            late = rig.lag + rig.delay - rig.late
            return force + late * jnp.gradient(force, self.motion.time)

        _, change = jax.jvp(record, (jnp.asarray(0.0),), (jnp.asarray(1.0),))
        return np.asarray(change)[self.moves]
