"""Two fits of an axis: inverse dynamics (filtered least squares) and closed-loop output error.

Inverse dynamics compares forces, motion given: quick, and biased where the motion is noisy.
Output error simulates axis and controller from the reference alone and compares positions: what a
measured position would tell about a friction law that is wrong, it tells here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from ..fitting.uncertainty import normal_inverse
from ..records.axis_record import AxisRecord
from .closed_loop import Controller, closed_loop, substeps
from .problem import AxisProblem
from .rig import AxisRig

_TOLERANCE = 1e-9
_TRIALS = 60
_COMPARED = 10


@dataclass(frozen=True, eq=False)
class AxisFit:
    """Parameters of an axis and how well they explain a record."""

    method: str
    """ "inverse dynamics" or "closed-loop output error"."""
    values: dict[str, float]
    """SI, by name."""
    std: dict[str, float]
    """Under white residuals."""
    relative_error: float
    """|residual|/|recorded|, of the force or of the position."""
    rms: float
    """Of the residual [N, N m or %; m or rad]."""
    rig: AxisRig
    converged: bool


def inverse_dynamics(problem: AxisProblem, z: np.ndarray, free: np.ndarray) -> AxisFit:
    """Ordinary least squares of the prepared force over the rows of the problem's weight.

    The error is relative to the recorded force of these rows, as is usual. `free` are the indices
    of the parameters that are fitted, from `z`.
    """
    solved, jacobian, ok = _solve(lambda y: _force_error(problem, y), z, free)
    used = np.asarray(problem.weight) > 0
    residual = np.asarray(_force_error(problem, jnp.asarray(solved))[0])[used]
    recorded = np.asarray(problem.friction)[used]
    return _fit("inverse dynamics", problem, solved, free, jacobian, residual, recorded, ok)


def output_error(
    problem: AxisProblem, z: np.ndarray, free: np.ndarray, record: AxisRecord
) -> AxisFit | None:
    """Least squares of the simulated position; None where the controller is not known.

    Every tenth sample is compared. The controller is the one of `closed_loop`; lags and delays
    of the force are not simulated.
    """
    drive, reference = record.drive, record.reference_position
    if drive is None or reference is None or record.position is None:
        return None
    if drive.K_p is None or drive.K_d is None or drive.position_gain is None:
        return None
    interval = float(np.median(np.diff(record.time)))
    controller = Controller(
        jnp.asarray(drive.position_gain), jnp.asarray(drive.K_d), jnp.asarray(interval)
    )
    number = substeps(problem.rig(jnp.asarray(z)), interval)
    measured = jnp.asarray(record.position)
    setting = _Setting(controller, jnp.asarray(reference), measured, number)
    solved, jacobian, ok = _solve(lambda y: _position_error(problem, setting, y), z, free)
    residual = np.asarray(_position_error(problem, setting, jnp.asarray(solved))[0])
    recorded = np.asarray(measured)[::_COMPARED]
    return _fit("closed-loop output error", problem, solved, free, jacobian, residual, recorded, ok)


class _Setting(NamedTuple):
    controller: Controller
    reference: Float[Array, " N"]
    measured: Float[Array, " N"]
    substeps: int


def _solve(both: Callable, z: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Levenberg-Marquardt (MINPACK) over some of the parameters."""
    z = np.array(z)
    seen: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(y):
        key = y.tobytes()
        if key not in seen:
            z[free] = y
            seen.clear()
            residual, jacobian = both(jnp.asarray(z))
            seen[key] = np.asarray(residual), np.asarray(jacobian)[:, free]
        return seen[key]

    scale = float(np.sqrt(np.mean(at(z[free])[0] ** 2))) or 1.0
    found = least_squares(
        lambda y: at(y)[0] / scale,
        z[free],
        jac=lambda y: at(y)[1] / scale,  # pyright: ignore[reportArgumentType]
        method="lm",
        x_scale="jac",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        max_nfev=_TRIALS,
    )
    z[free] = found.x
    return z, at(found.x)[1], bool(found.success)


def _fit(method, problem, z, free, jacobian, residual, recorded, ok: bool) -> AxisFit:
    names = problem.model.names()
    natural = np.asarray(problem.from_free(jnp.asarray(z)))
    slopes = np.diagonal(np.asarray(jax.jacfwd(problem.from_free)(jnp.asarray(z))))
    rms = float(np.sqrt(np.mean(residual**2)))
    std = rms * np.sqrt(np.diag(normal_inverse(jacobian)))
    return AxisFit(
        method=method,
        values={names[i]: float(natural[i]) for i in free},
        std={names[i]: float(abs(slopes[i]) * s) for i, s in zip(free, std, strict=True)},
        relative_error=float(np.linalg.norm(residual) / np.linalg.norm(recorded)),
        rms=rms,
        rig=problem.rig(jnp.asarray(z)),
        converged=ok,
    )


@eqx.filter_jit
def _force_error(problem: AxisProblem, z):
    """Residual of the used rows (0 on the others) and its Jacobian."""

    def error(z):
        return (problem.predict(z) - problem.friction) * problem.weight

    return error(z), jax.jacfwd(error)(z)


@eqx.filter_jit
def _position_error(problem: AxisProblem, setting: _Setting, z):
    """Simulated minus measured position at every tenth sample, and its Jacobian."""

    def error(z):
        run = closed_loop(
            problem.rig(z),
            setting.controller,
            setting.reference,
            setting.measured[:3],
            substeps=setting.substeps,
        )
        return (run.position - setting.measured)[::_COMPARED]

    return error(z), jax.jacfwd(error)(z)
