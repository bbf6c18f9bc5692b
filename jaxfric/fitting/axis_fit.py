"""Two fits of an axis: inverse dynamics (filtered least squares) and closed-loop output error.

Inverse dynamics compares the predicted motor force for the measured motion with the recorded force.
A fit by inverse dynamics is fast, but noise of the measured motion biases the parameters. The
output-error fit simulates axis and controller from the reference alone and compares positions. In
an output-error fit a wrong friction law appears as a position error.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..described import Described, Tabular
from ..effects import null
from ..records.axis_record import AxisRecord
from ..rig.axis import AxisRig
from ..simulation.axis_closed_loop import Controller, closed_loop, substeps
from .axis_problem import AxisProblem
from .encompassing import EncompassingModel
from .marquardt import Descent, levenberg_marquardt
from .thresholds import COMPARED, FEW, TOLERANCE, TRIALS
from .uncertainty import determined, normal_inverse


@dataclass(frozen=True, eq=False, repr=False)
class AxisFit(Described, Tabular):
    """Parameters of an axis, and how well these parameters explain a record."""

    method: str
    """ "inverse dynamics" or "closed-loop output error"."""
    values: dict[str, float]
    """Values of the parameters by name, SI."""
    std: dict[str, float]
    """Standard deviations by name, if the residuals are white."""
    relative_error: float
    """|residual|/|recorded|, of the force or of the position."""
    rms: float
    """Root mean square of the residual [N, N m or %; m or rad]."""
    converged: bool
    loose: tuple[str, ...] = ()
    """Parameters that the record does not determine, see `uncertainty.determined`."""


def inverse_dynamics(problem: AxisProblem, z: np.ndarray, free: np.ndarray) -> AxisFit:
    """Ordinary least squares of the prepared force over the rows of non-zero weight.

    `relative_error` is the norm of the residual divided by the norm of the recorded force in the
    fitted rows, as usual in robotics. `free` holds the indices of the fitted parameters. `z` holds
    the starting values of fitted parameters and the values of fixed ones.
    """
    found = force_descent(problem, z, free)
    used = np.asarray(problem.weight) > 0
    found = found._replace(residual=found.residual[used])
    recorded = np.asarray(problem.friction)[used]
    return _fit("inverse dynamics", problem, found, free, recorded)


def force_descent(problem: AxisProblem, z: np.ndarray, free: np.ndarray) -> Descent:
    """The descent of `inverse_dynamics`: all parameters, residual [F] of every row (0 without
    weight), and its Jacobian by the parameters `free`."""
    return _solve(lambda z, index: _force_error(problem, z, index), z, free)


def output_error(
    problem: AxisProblem, z: np.ndarray, free: np.ndarray, record: AxisRecord
) -> AxisFit | None:
    """Fit the simulated position by least squares; return None without a controller or a mass.

    The fit compares every tenth sample of the position. `closed_loop` gives the simulated
    controller. The recorded disturbance is added to the controller's force. Lags and delays of the
    motor force are not simulated. If friction becomes so steep in the fit that the simulation needs
    steps of less than half the length, the fit is repeated with these.
    """
    drive, reference = record.drive, record.reference_position
    if drive is None or reference is None or record.position is None:
        return None
    if drive.K_p is None or drive.K_d is None or drive.position_gain is None:
        return None
    problem, kept = _moving_states(problem, free)
    z, free = z[kept], np.searchsorted(kept, free)
    interval = float(np.median(np.diff(record.time)))
    controller = Controller(
        jnp.asarray(drive.position_gain), jnp.asarray(drive.K_d), jnp.asarray(interval)
    )
    measured = jnp.asarray(record.position)
    added = record.disturbance_force
    disturbance = jnp.zeros(len(record)) if added is None else jnp.asarray(added)

    def needed(z: np.ndarray) -> int | None:
        return substeps(problem.rig(jnp.asarray(z)), interval, problem.motion)

    number = needed(z)
    while number is not None:  # None: a slow record does not determine the mass, which becomes 0
        setting = _Setting(controller, jnp.asarray(reference), measured, disturbance, number)
        found = _solve(partial(_position_error, problem, setting), z, free)
        z, number = found.y, needed(found.y)
        if number is not None and number <= 2 * setting.substeps:  # still stable, see AXIS_STEP
            recorded = np.asarray(measured)[::COMPARED]
            return _fit("closed-loop output error", problem, found, free, recorded)
    return None


def _moving_states(problem: AxisProblem, free: np.ndarray) -> tuple[AxisProblem, np.ndarray]:
    """The problem without unfitted effects that have states, and the indices of kept parameters.

    At their null these effects change nothing, but the simulation would integrate their states.
    """
    model, one = problem.model, jnp.ones(())
    plain = AxisRig(one, one, one, one, width=one)
    idle = tuple(
        e.id
        for e in model.effects
        if null(e).embed(plain).states and not set(model.columns((e.id,))) & set(free.tolist())
    )
    effects = tuple(e for e in model.effects if e.id not in idle)
    kept = np.setdiff1d(np.arange(len(model.names())), model.columns(idle))
    return dataclasses.replace(problem, model=EncompassingModel(model.base, effects)), kept


class _Setting(NamedTuple):
    controller: Controller
    reference: Float[Array, " N"]
    measured: Float[Array, " N"]
    disturbance: Float[Array, " N"]
    substeps: int


def _solve(both: Callable, z: np.ndarray, free: np.ndarray) -> Descent:
    """Least squares over the parameters `free`; returns a point of all parameters. `both` returns
    the residual and `FEW` columns of the Jacobian: a fixed number is compiled only once."""
    z = np.array(z)
    beyond = (0, -len(free) % FEW)
    parts = np.pad(free, beyond, constant_values=len(z)).reshape(-1, FEW)

    def at(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z[free] = y
        found = [both(jnp.asarray(z), index) for index in parts]
        jacobian = np.concatenate([np.asarray(slopes) for _, slopes in found], axis=1)
        return np.asarray(found[0][0]), jacobian[:, : len(free)]

    found = levenberg_marquardt(at, z[free], ftol=TOLERANCE, xtol=TOLERANCE, most=TRIALS)
    z[free] = found.y
    return found._replace(y=z)


def _fit(
    method: str, problem: AxisProblem, found: Descent, free: np.ndarray, recorded: np.ndarray
) -> AxisFit:
    names, z, residual = problem.model.names(), found.y, found.residual
    of = problem.coordinates
    natural, slopes = of.from_free(z), of.slopes(z)
    rms = float(np.sqrt(np.mean(residual**2)))
    std = rms * np.sqrt(np.diag(normal_inverse(found.jacobian)))
    every = np.zeros(len(names))
    every[free] = std
    used = np.asarray(problem.friction)[np.asarray(problem.weight) > 0]
    known = determined(problem.on_host(), z, every, float(np.ptp(used)))
    return AxisFit(
        method=method,
        values={names[i]: float(natural[i]) for i in free},
        std={names[i]: float(abs(slopes[i]) * s) for i, s in zip(free, std, strict=True)},
        relative_error=float(np.linalg.norm(residual) / np.linalg.norm(recorded)),
        rms=rms,
        converged=found.converged,
        loose=tuple(names[i] for i in free if not known[i]),
    )


@eqx.filter_jit
def _force_error(problem: AxisProblem, z: Array, free: Array | np.ndarray) -> tuple[Array, Array]:
    """Residual of the used rows (0 elsewhere) and its Jacobian by the parameters `free`.

    An index out of range gives a column of zeros.
    """

    def error(y: Array) -> Array:
        z_free = z.at[free].set(y, mode="drop")
        return (problem.predict(z_free) - problem.friction) * problem.weight

    y = z.at[free].get(mode="clip")
    return error(y), jax.jacfwd(error)(y)


@eqx.filter_jit
def _position_error(
    problem: AxisProblem, setting: _Setting, z: Array, free: Array | np.ndarray
) -> tuple[Array, Array]:
    """Simulated minus measured position at every tenth sample, and its Jacobian."""

    def error(y: Array) -> Array:
        run = closed_loop(
            problem.rig(z.at[free].set(y, mode="drop")),
            setting.controller,
            setting.reference,
            setting.measured[:3],
            substeps=setting.substeps,
            disturbance=setting.disturbance,
        )
        return (run.position - setting.measured)[::COMPARED]

    y = z.at[free].get(mode="clip")
    return error(y), jax.jacfwd(error)(y)
