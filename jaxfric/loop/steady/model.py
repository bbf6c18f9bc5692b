"""One model of friction at steady speeds, and its fit by generalised least squares.

The covariance of the runs is V = C + tau^2 I. C is the covariance of the mean forces of runs, tau
an additional spread of runs. In the frame of the eigenvectors of C, V is diagonal for every tau.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from ...fitting.uncertainty import normal_inverse
from ...records.steady import SteadyCurve, force_covariance
from ..thresholds import POWERS, SPEEDS_OF_CURVE

_NEAR = float(np.cbrt(np.finfo(float).eps))
"""Relative step of central differences that balances truncation and rounding errors."""


@dataclass(frozen=True, eq=False)
class SteadyModel:
    """One fitted model of a steady curve."""

    effects: tuple[str, ...]
    values: dict[str, float]
    """SI (or % of the rated torque), by name."""
    std: dict[str, float]
    covariance: np.ndarray
    """Covariance of F_c, F_v, F_0, the amplitudes of `effects` in their order, and any vs."""
    rms: float
    """rms of the fitted runs' means about the model, all runs weighted equally."""
    spread: float
    """Standard deviation of runs beyond the error of their means (tau)."""
    bic: float
    heldout: float
    """rms prediction error of every run by the model fitted without it and its neighbours in speed;
    nan if the model cannot be fitted without three runs."""

    def force(self, speed: np.ndarray) -> np.ndarray:
        """Force of the model at any speed."""
        values = np.asarray([self.values[name] for name in _names(self.effects)])
        return _matrix(np.asarray(speed, float), self.effects, self.shape) @ values

    def friction(self, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(F(v) - F(-v))/2 at speeds (m,), and its standard error for a known n."""
        v = np.abs(np.asarray(speed, float))
        force = 0.5 * (self.force(v) - self.force(-v))
        fs = self.values.get("fs", 0.0)
        ends = [_jacobian(one, self.effects, self.shape, fs) for one in (v, -v)]
        rows = 0.5 * (ends[0] - ends[1])
        return force, np.sqrt(np.maximum(np.sum((rows @ self.covariance) * rows, axis=1), 0.0))

    @property
    def shape(self) -> "_Shape":
        """Stribeck velocity vs and exponent n of the Stribeck term, if the model has this term."""
        return (self.values["vs"], self.values["n"]) if "stribeck" in self.effects else None

    def slope_error(self, speed: float) -> float:
        """Standard error of dF/dv at a speed; the exponent n of a Stribeck term counts as known."""
        near = speed * np.array([1 - _NEAR, 1 + _NEAR])
        rows = _jacobian(near, self.effects, self.shape, self.values.get("fs", 0.0))
        gradient = (rows[1] - rows[0]) / (near[1] - near[0])
        return float(np.sqrt(max(gradient @ self.covariance @ gradient, 0.0)))


def _names(effects: Sequence[str]) -> list[str]:
    own = {"direction_asymmetry": "d", "stribeck": "fs", "cubic": "c"}
    return ["F_c", "F_v", "F_0", *(own[e] for e in effects)]


_Shape = tuple[float, float] | None
"""vs and n of a Stribeck term."""


def _matrix(speed: np.ndarray, effects: Sequence[str], shape: _Shape) -> np.ndarray:
    columns = [np.sign(speed), speed, np.ones_like(speed)]
    for effect in effects:
        if effect == "direction_asymmetry":
            columns.append(np.abs(speed))
        elif effect == "cubic":
            columns.append(speed**3)
        else:
            assert shape is not None
            columns.append(np.sign(speed) * np.exp(-((np.abs(speed) / shape[0]) ** shape[1])))
    return np.stack(columns, axis=1)


def _jacobian(speed: np.ndarray, effects: Sequence[str], shape: _Shape, fs: float) -> np.ndarray:
    """dF/d(parameter): the columns of `_matrix`, and of vs by central difference."""
    matrix = _matrix(speed, effects, shape)
    if shape is None:
        return matrix
    place, (vs, n) = _names(effects).index("fs"), shape
    low, high = (_matrix(speed, effects, (vs * f, n))[:, place] for f in (1 - _NEAR, 1 + _NEAR))
    return np.column_stack([matrix, fs * (high - low) / (2 * _NEAR * vs)])


class _Frame(NamedTuple):
    """The runs in the frame of the eigenvectors of the covariance of their errors."""

    force: np.ndarray
    variance: np.ndarray
    """Eigenvalues of the covariance."""
    axes: np.ndarray
    """Eigenvectors, as rows."""

    @classmethod
    def of(cls, force: np.ndarray, covariance: np.ndarray) -> "_Frame":
        variance, vectors = np.linalg.eigh(covariance)
        return cls(vectors.T @ force, np.maximum(variance, 0.0), vectors.T)


def fit_model(
    curve: SteadyCurve, effects: tuple[str, ...], used: np.ndarray | None = None
) -> SteadyModel:
    """The likeliest model of a curve with `effects` of `steady.STEADY_EFFECTS`.

    used : mask of the fitted runs; None: all. Values and errors are from the restricted likelihood,
    which accounts for the fitted parameters. BIC is from the unrestricted likelihood.
    """
    here = np.ones(len(curve), bool) if used is None else used
    speed, force = np.asarray(curve.speed)[here], np.asarray(curve.force)[here]
    covariance = curve.covariance()[np.ix_(here, here)]
    frame = _Frame.of(force, covariance)
    shape = _likeliest_shape(speed, frame, effects) if "stribeck" in effects else None
    matrix = _matrix(speed, effects, shape)
    count = matrix.shape[1] + 1 + (0 if shape is None else 2)
    _, _, deviance = _weighted(matrix, frame)
    values, spread, _ = _weighted(matrix, frame, restricted=True)
    shown = dict(zip(_names(effects), values.tolist(), strict=True))
    if shape is not None:
        shown |= {"vs": shape[0], "n": shape[1]}
    names, errors = _parameter_covariance(speed, covariance, spread, effects, shown)
    std = dict(zip(names, np.sqrt(np.diag(errors)).tolist(), strict=True))
    return SteadyModel(
        effects=effects,
        values=shown,
        std=std,
        covariance=errors,
        rms=float(np.sqrt(np.mean((force - matrix @ values) ** 2))),
        spread=spread,
        bic=float(deviance + count * np.log(len(force))),
        heldout=_heldout(speed, force, covariance, effects, shape),
    )


def curve_covariance(
    speed: np.ndarray,
    error: np.ndarray,
    spread: float,
    effects: Sequence[str],
    values: Mapping[str, float],
    shared: np.ndarray | None = None,
) -> tuple[list[str], np.ndarray]:
    """Names and covariance (p, p) of a curve's parameters, at `values` (SI), from all its runs.

    speed, error, shared : of the runs [n], as in `SteadyCurve`. spread : tau, the spread of runs
    beyond their errors. The exponent n of a Stribeck term counts as known.
    """
    covariance = force_covariance(np.asarray(error), shared)
    return _parameter_covariance(speed, covariance, spread, effects, values)


def _parameter_covariance(
    speed: np.ndarray,
    covariance: np.ndarray,
    spread: float,
    effects: Sequence[str],
    values: Mapping[str, float],
) -> tuple[list[str], np.ndarray]:
    """Names and covariance of the parameters, from the `covariance` (n, n) of the runs' means."""
    shape = (values["vs"], values["n"]) if "stribeck" in effects else None
    frame = _Frame.of(np.zeros(len(speed)), covariance)
    rows = frame.axes @ _jacobian(speed, effects, shape, values.get("fs", 0.0))
    names = [*_names(effects), *(["vs"] if shape is not None else [])]
    return names, normal_inverse(rows / np.sqrt(frame.variance + spread**2)[:, None])


def _likeliest_shape(
    speed: np.ndarray, frame: _Frame, effects: Sequence[str]
) -> tuple[float, float]:
    """vs and n of the likeliest Stribeck term that adds friction at low speed."""
    place = _names(effects).index("fs")

    def deviance(log_vs: float, n: float) -> float:
        found = _weighted(_matrix(speed, effects, (float(np.exp(log_vs)), n)), frame)
        return found[2] if found[0][place] > 0 else np.inf

    slow, fast = np.min(np.abs(speed)), np.max(np.abs(speed))
    grid = np.linspace(np.log(0.5 * slow), np.log(fast), SPEEDS_OF_CURVE)
    best = (np.inf, float(np.exp(grid[SPEEDS_OF_CURVE // 2])), 2.0)
    for n in POWERS:
        scores = [deviance(u, n) for u in grid]
        k = int(np.clip(np.argmin(scores), 1, SPEEDS_OF_CURVE - 2))
        fine = minimize_scalar(
            lambda u, n=n: min(deviance(u, n), 1e300),
            bounds=(grid[k - 1], grid[k + 1]),
            method="bounded",
        )
        u = float(fine.x)
        best = min(best, (deviance(u, n), float(np.exp(u)), n))
    return best[1], best[2]


def _weighted(
    matrix: np.ndarray, frame: _Frame, *, restricted: bool = False
) -> tuple[np.ndarray, float, float]:
    """Least squares with the covariance C + tau^2 I, tau by likelihood: values, tau, -2 ln L.

    The restricted likelihood (REML) accounts for the fitted parameters of `matrix`.
    """
    rows = frame.axes @ matrix

    def at(log_tau: float):
        variance = frame.variance + np.exp(2 * log_tau)
        root = np.sqrt(variance)
        values, *_ = np.linalg.lstsq(rows / root[:, None], frame.force / root, rcond=None)
        left = (frame.force - rows @ values) / root
        deviance = float(left @ left + np.sum(np.log(variance)))
        if restricted:
            own = np.linalg.svd(rows / root[:, None], compute_uv=False)
            deviance += 2 * float(np.sum(np.log(np.maximum(own, 1e-300))))
        return values, deviance

    scale = max(float(np.std(frame.axes.T @ frame.force)), 1e-300)
    low, high = np.log(1e-6 * scale), np.log(2 * scale)
    found = minimize_scalar(lambda u: at(u)[1], bounds=(low, high), method="bounded")
    log_tau = float(found.x)
    values, deviance = at(log_tau)
    return values, float(np.exp(log_tau)), deviance


def _heldout(
    speed: np.ndarray,
    force: np.ndarray,
    covariance: np.ndarray,
    effects: Sequence[str],
    shape: _Shape,
) -> float:
    """rms prediction error of each run, left out with its neighbours in speed; fixed shape."""
    order = np.argsort(speed)
    left = np.zeros(len(speed))
    matrix = _matrix(speed, effects, shape)
    for place, k in enumerate(order):
        out = order[max(0, place - 1) : place + 2]
        rest = np.setdiff1d(np.arange(len(speed)), out)
        if len(rest) <= matrix.shape[1] or np.linalg.matrix_rank(matrix[rest]) < matrix.shape[1]:
            return float("nan")
        values, *_ = _weighted(matrix[rest], _Frame.of(force[rest], covariance[np.ix_(rest, rest)]))
        left[k] = force[k] - matrix[k] @ values
    return float(np.sqrt(np.mean(left**2)))
