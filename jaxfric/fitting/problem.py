"""The least-squares problem of a velocity-step record: parameters <-> rig <-> residual.

Parameters form one vector of unbounded variables: positive quantities by their logarithm, signed
ones in units of a force typical of the record. Records are padded with rows of zero weight to a few
sizes, so that JAX need not compile again for another record.

Times of velocity steps are uncertain if detected in a noisy displacement. With a stiff spring an
error of a hundredth of a second in a step time causes a misfit. If errors of step times matter,
step times are parameters too, in units of their standard error. One more residual constrains each
fitted step time.
"""

import dataclasses
import functools
from typing import Any, NamedTuple, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..laws.registry import fixed_states, law_quantity, rate_state
from ..motion import PiecewiseVelocity
from ..quantity import Quantity, numbered_names, quantities
from ..records import VelocitySteps
from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction import LogarithmicEffect, RegularisedEffect
from ..rig.normal_stress import NormalStress
from ..rig.timing import LateSteps
from ..simulation import RESULTS, simulate
from ..simulation.simulate import STIFF
from ..traced import traced
from .abstract_problem import (
    AbstractProblem,
    ParametricModel,
    Sizes,
)
from .noise import Noise, whiten
from .padding import bucket, filled
from .thresholds import FAILED_MISFIT, TIME_SHARE

_MACHINE_QUANTITIES = quantities(Inertial)
_LEVEL = Quantity("level", "F", "friction of a later stretch of a run less that of the first")


def quantity_of(name: str) -> Quantity:
    """The `Quantity` behind a parameter name such as "A", "L2", "K" or "slip_trend"."""
    if name in ("K", "m"):
        return _MACHINE_QUANTITIES["stiffness" if name == "K" else "mass"]
    if name.startswith("level"):
        return _LEVEL
    return law_quantity(name)


class RigModel(ParametricModel, Protocol):
    """The model fitted to a slider's record: parameters, and the rig with these parameters."""

    def rig(
        self, values: Float[Array, " p"], V0: Float[Array, ""], stiffness: Float[Array, ""]
    ) -> Rig:
        """The rig with natural (SI) parameter values."""
        ...


class Model(NamedTuple):
    """The choices of a fit: law, number of states, and which optional parameters are free."""

    law: str = "slip"
    states: int = 1
    fit_stiffness: bool = False
    slip_trend: bool = False
    regularised: bool = False
    levels: int = 0
    """Number of stretches after the first, each with its own offset of friction: `level2`, ..."""

    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in the order of the parameter vector."""
        names = ["f0", "A", *numbered_names(fixed_states(self.law) or self.states)]
        names += ["K"] * self.fit_stiffness + ["slip_trend"] * self.slip_trend
        return (*names, *(f"level{k + 2}" for k in range(self.levels)))

    def quantity(self, name: str) -> Quantity:
        """Symbol, unit and bounds of a parameter, as from `quantity_of`."""
        return quantity_of(name)

    def rig(
        self, values: Float[Array, " p"], V0: Float[Array, ""], stiffness: Float[Array, ""]
    ) -> Rig:
        """The rig with natural (SI) values of the parameters, in the order of `names`."""
        p = {**dict(zip(self.names(), values, strict=True)), "V0": V0}
        direct = RegularisedEffect() if self.regularised else LogarithmicEffect()
        states = fixed_states(self.law) or self.states
        law = rate_state(self.law, p, states, direct=direct)
        return Rig(QuasiStatic(p.get("K", stiffness)), law)


class Channel(eqx.Module):
    """A second recorded quantity: "slip" of the slider or measured position of the "load_point",
    minus the commanded position [m].

    Errors of step times accumulate in a position, but cancel in the difference between this
    position and the recorded command. The noise of a channel is white. The zero of a channel is
    unknown, so only deviations from the channel's mean count, with weights `anchor`.
    """

    values: Float[Array, " n"]
    noise: Float[Array, ""]
    anchor: Float[Array, " n"]
    kind: str = eqx.field(static=True)


class Problem(AbstractProblem):
    """A padded record with its motion and a `Model`. All arrays are in SI; time starts at 0."""

    time: Float[Array, " n"]
    friction: Float[Array, " n"]
    weight: Float[Array, " n"]
    clock: Float[Array, "n 3"]
    """Clocks over which noise may be correlated: time [s], load-point path [m], samples."""
    motion: PiecewiseVelocity
    shifted: Int[Array, " k"]
    shift_scale: Float[Array, " k"]
    hold: Float[Array, " k"]
    V0: Float[Array, ""]
    stiffness: Float[Array, ""]
    noise_scale: Float[Array, ""]
    force_scale: Float[Array, ""]
    slip_scale: Float[Array, ""]
    damping: Float[Array, ""] | None
    noise: Noise | None
    channels: tuple[Channel, ...]
    normal_stress: NormalStress | None
    model: RigModel = eqx.field(static=True)  # ty: ignore[incompatible-mutable-override]
    rtol: float = eqx.field(static=True, default=1e-5)
    max_steps: int = eqx.field(static=True, default=4096)
    stiff: bool = eqx.field(static=True, default=True)
    """Whether the stiff solver is faster, because the spring relaxes many times over the record."""
    seen: tuple[Float[Array, " m"], Int[Array, " n"]] | None = None
    """Ascending times at which the sensor samples friction, and the indices of the rows among them;
    None: at the rows only. The sensor interpolates friction linearly between them."""
    mass: Float[Array, ""] | None = None
    """Given mass [F s^2/m]; None: negligible."""
    stretch: Int[Array, " n"] | None = None
    """Index of the stretch of every row, if the model has levels."""

    @property
    def sizes(self) -> Sizes:
        """Typical sizes of the record."""
        duration = self.time[-1] - self.time[0]
        speed, lag = self.motion.largest_speed(), TIME_SHARE * duration
        return Sizes(self.force_scale, speed, self.slip_scale, duration, lag)

    def step_times(self, z: Float[Array, " q"]) -> Float[Array, " m"]:
        """Times of the velocity steps [s] at the parameters `z`."""
        return self.motion.times + self._delays(z)

    def late_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] of every velocity step whose time is fitted. The second result is the
        displacement [m] by which the load point lags if a shift variable is 1.
        """
        here = self.on_host()
        V, shifted = here.motion.velocities, here.shifted
        trails = (V[shifted] - V[shifted - 1]) * here.shift_scale
        return np.asarray(here.motion.times[shifted]), np.asarray(trails)

    def begun(self, z: np.ndarray) -> np.ndarray:
        """The start `z` itself."""
        return z

    def _delays(self, z: Float[Array, " q"]) -> Float[Array, " m"]:
        shift = self.shift_scale * z[len(self.model.names()) :]
        return jnp.zeros_like(self.motion.times).at[self.shifted].add(shift)

    def rig(self, z: Float[Array, " q"]) -> Rig:
        """The rig with the parameters `z`."""
        rig = self.model.rig(self.coordinates.from_free(z), self.V0, self.stiffness)
        if self.mass is not None:
            heavy = Inertial(self.mass, rig.machine.stiffness, rig.machine.damping)
            rig = dataclasses.replace(rig, machine=heavy)
        if self.normal_stress is not None:
            rig = eqx.tree_at(
                lambda r: r.normal_stress, rig, self.normal_stress, is_leaf=lambda x: x is None
            )
        if len(self.shifted):
            rig = eqx.tree_at(lambda r: r.drive, rig, LateSteps(rig.drive, self._delays(z)))
        if self.damping is None:
            return rig
        before = rig.machine.damping
        total = self.damping if before is None else before + self.damping
        return eqx.tree_at(lambda r: r.machine.damping, rig, total, is_leaf=lambda x: x is None)

    def damped(self, strength: float) -> "Problem":
        """A copy of this problem with an additional dashpot that stops a runaway.

        At the largest commanded speed the force of the dashpot is `strength` times the force scale.
        The force of the dashpot is small in steady motion, but dominant at 1/strength times the
        largest commanded speed.
        """
        here = self.on_host()
        dashpot = jax.device_put(strength * here.force_scale / here.motion.largest_speed())
        return eqx.tree_at(lambda p: p.damping, self, dashpot, is_leaf=lambda x: x is None)

    def heavier(self, factor: int) -> "Problem":
        """A copy of this problem whose simulations may take `factor` times as many solver steps."""
        return dataclasses.replace(self, max_steps=factor * self.max_steps)

    def possible(self, z: Float[Array, " q"] | np.ndarray) -> bool:
        """Whether the total friction is physically possible; always true for a slider."""
        return True

    def whitened(self, noise: Noise) -> "Problem":
        """A copy whose residuals are whitened by `noise`."""
        return dataclasses.replace(self, noise=noise, hold=_ones(self.hold))

    def plain(self) -> "Problem":
        """A copy with residuals in units of `noise_scale`, not whitened."""
        return dataclasses.replace(self, noise=None, hold=_ones(self.hold))

    def holding(self, hold: np.ndarray) -> "Problem":
        """A copy with other weights `hold` on the shifts of step times."""
        return dataclasses.replace(self, hold=jax.device_put(hold))

    def predict(
        self, z: Float[Array, " q"]
    ) -> tuple[Float[Array, " n"], tuple[Float[Array, " n"], ...], Bool[Array, ""]]:
        """Predicted friction and channels at the sample times, and success of the simulation."""
        rig = self.rig(z)
        times, rows = (self.time, slice(None)) if self.seen is None else self.seen
        out = simulate(
            rig,
            self.motion,
            times,
            rtol=self.rtol,
            max_steps=self.max_steps,
            stiff=self.stiff,
            runaway=1e4 if self.damping is None else 1e9,
        )
        seen = tuple(self._channel(channel.kind, rig, out.slip[rows]) for channel in self.channels)
        recorded = out.recorded[rows]
        if self.stretch is not None:
            recorded = recorded + self._levels(z)[self.stretch]
        return recorded, seen, out.result == RESULTS.successful

    def _levels(self, z: Float[Array, " q"]) -> Float[Array, " s"]:
        """The friction offset of every stretch; 0 for the first."""
        names = self.model.names()
        pairs = zip(names, self.coordinates.natural(z[: len(names)]), strict=True)
        own = [value for name, value in pairs if name.startswith("level")]
        return jnp.stack([jnp.zeros_like(self.force_scale), *own])

    def _channel(self, kind: str, rig: Rig, slip: Float[Array, " n"]) -> Float[Array, " n"]:
        drive = rig.drive.drive if isinstance(rig.drive, LateSteps) else rig.drive
        lag = jax.vmap(lambda t: drive.lag(self.motion, t))(self.time)
        if kind != "slip":
            return -lag
        late = jax.vmap(lambda t: rig.drive.lag(self.motion, t))(self.time) - lag
        return slip - (jax.vmap(self.motion.displacement)(self.time) - late)

    def residual(self, z: Float[Array, " q"]) -> Float[Array, " r"]:
        """(predicted - recorded)/noise_scale of friction, then of every channel with its own noise,
        then `hold` times the shifts of the step times.

        The residual is 0 on padding, and `FAILED_MISFIT` for a failed simulation.
        """
        predicted, seen, ok = self.predict(z)
        residual = (predicted - self.friction) / self.noise_scale
        if self.noise is not None:
            residual = whiten(self.clock, self.weight, residual[:, None], self.noise)[:, 0]
        rows = [residual]
        for channel, found in zip(self.channels, seen, strict=True):
            change = (found - channel.values) / channel.noise
            mean = jnp.sum(channel.anchor * change) / jnp.sum(channel.anchor)
            rows.append(change - mean)
        rows = [jnp.where(ok & jnp.isfinite(row), row, FAILED_MISFIT) * self.weight for row in rows]
        return jnp.concatenate([*rows, self.hold * z[len(self.model.names()) :]])


@functools.cache
def _motion() -> Any:
    """Tree structure of `PiecewiseVelocity`. Its constructor would send arrays to the device."""
    return jax.tree.structure(PiecewiseVelocity(np.zeros(1), np.ones(1)))


def _ones(like: Array) -> Array:
    return jax.device_put(np.ones(like.shape, like.dtype))


@traced
def rig_at(problem: Problem, z: Float[Array | np.ndarray, " q"]) -> Rig:
    """The rig of a problem with the parameters `z`."""
    return problem.rig(jnp.asarray(z))


@traced
def step_times_at(problem: Problem, z: Float[Array | np.ndarray, " q"]) -> Float[Array, " m"]:
    """Times of the velocity steps [s] of a problem at the parameters `z`."""
    return problem.step_times(jnp.asarray(z))


class ProblemSizes(NamedTuple):
    """Scales of a problem; F is the unit of friction. The noise [F] is the unit of residuals, the
    force [F] the unit of unbounded signed parameters. The mass [F s^2/m] is None if negligible.
    Other scales are a reference velocity [m/s] and a stiffness [F/m].
    """

    V0: float
    stiffness: float
    noise: float
    force: float
    mass: float | None = None


def clock_of(time: np.ndarray, steps: VelocitySteps) -> np.ndarray:
    """Coordinates of correlated noise (n, 3): time [s], load-point path [m], row number."""
    path = np.cumsum(np.abs(np.diff(steps.displacement(time), prepend=0.0)))
    return np.stack([time, path, np.arange(len(time))], axis=1)


def make_problem(
    time: np.ndarray,
    friction: np.ndarray,
    steps: VelocitySteps,
    sizes: ProblemSizes,
    model: RigModel,
    *,
    shifted: np.ndarray | None = None,
    on_host: bool = False,
) -> Problem:
    """Pad a record (time from 0 [s], friction) to a bucket size and attach the scales.

    `shifted` holds the indices of the velocity steps whose times are parameters; `steps` must then
    have `time_errors`. If `on_host` is True, all arrays stay in NumPy, for problems that are sent
    to the device in batches.
    """
    n, clock = len(time), clock_of(time, steps)
    path = clock[:, 1]
    shifted = np.zeros(0, int) if shifted is None else np.asarray(shifted, int)
    if len(shifted):  # padded with index 0: the first velocity has no time error
        shifted = filled(shifted, bucket(len(shifted), 4), 0)
    errors = np.zeros(len(steps)) if steps.time_errors is None else steps.time_errors
    size, velocities = bucket(n), bucket(len(steps), 4)
    arrays: dict[str, Any] = {
        "time": filled(time, size),
        "friction": filled(friction, size),
        "weight": filled(np.ones(n), size, 0.0),
        "clock": filled(clock, size),
        "shifted": shifted,
        "shift_scale": errors[shifted].astype(float),
        "hold": np.ones(len(shifted)),
        "V0": np.array(sizes.V0, float),
        "stiffness": np.array(sizes.stiffness, float),
        "noise_scale": np.array(sizes.noise, float),
        "force_scale": np.array(sizes.force, float),
        "slip_scale": np.array(path[-1] - path[0], float),
        "mass": None if sizes.mass is None else np.array(sizes.mass, float),
    }
    never = filled(steps.times, velocities, np.inf), filled(steps.velocities, velocities)
    problem = Problem(
        **arrays,
        motion=jax.tree.unflatten(_motion(), never),
        damping=None,
        noise=None,
        channels=(),
        normal_stress=None,
        model=model,
        max_steps=most_steps(len(steps)),
        stiff=sizes.mass is not None
        # A is about a third of a change of friction
        or bool(sizes.stiffness * (path[-1] - path[0]) > STIFF / 3 * sizes.force),
    )
    # one call, because the overhead of a call is most of its cost
    return problem if on_host else jax.device_put(problem)


def most_steps(velocities: int) -> int:
    """Largest number of solver steps for a simulation with this number of velocities.

    A tenfold velocity step under the slip law takes 100 solver steps at 8 times the critical
    stiffness, 180 at 3 times, 300 at 2 times. A simulation may take 256 solver steps per velocity,
    but at least 4096 in total. The limit is a power of two, because JAX compiles anew for each
    limit.
    """
    return max(4096, 1 << (256 * velocities - 1).bit_length())
