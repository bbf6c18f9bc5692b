"""One model of the friction of steady speeds, and its fit by weighted least squares."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ...records.steady import SteadyCurve

_SPEEDS = 60
_POWERS = (1.0, 2.0)
_NEAR = 1e-4
"""Relative step of central differences."""


@dataclass(frozen=True, eq=False)
class SteadyModel:
    """One model of a steady curve, fitted."""

    effects: tuple[str, ...]
    values: dict[str, float]
    """SI (or % of the rated torque), by name."""
    std: dict[str, float]
    covariance: np.ndarray
    """Covariance of F_c, F_v, F_0, the amplitudes of `effects` in their order, and any vs."""
    predicted: np.ndarray
    """Force predicted at the runs."""
    rms: float
    """Root mean square of the runs' means about the model, each run once."""
    spread: float
    """Standard deviation of runs beyond the error of their means (tau)."""
    bic: float
    heldout: float
    """rms of every run about the model fitted without it and its neighbours in speed."""

    def force(self, speed: np.ndarray) -> np.ndarray:
        """Force at any speed."""
        values = np.asarray([self.values[name] for name in _names(self.effects)])
        return _matrix(np.asarray(speed, float), self.effects, self.shape) @ values

    @property
    def shape(self) -> "_Shape":
        """vs and n of the Stribeck term, if there is one."""
        return (self.values["vs"], self.values["n"]) if "stribeck" in self.effects else None

    def slope_error(self, speed: float) -> float:
        """Standard error of dF/dv at a speed; n of a Stribeck term is taken as known."""
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


def fit_model(curve: SteadyCurve, effects: tuple[str, ...]) -> SteadyModel:
    """The likeliest model of a curve with `effects` of `steady.STEADY_EFFECTS`."""
    speed, force, error = (np.asarray(x) for x in (curve.speed, curve.force, curve.error))
    shape = _likeliest_shape(speed, force, error, effects) if "stribeck" in effects else None
    matrix = _matrix(speed, effects, shape)
    values, spread, deviance = _weighted(matrix, force, error)
    predicted = matrix @ values
    names, count = _names(effects), len(values) + 1 + (0 if shape is None else 2)
    shown = dict(zip(names, values.tolist(), strict=True))
    if shape is not None:
        shown |= {"vs": shape[0], "n": shape[1]}
    names, covariance = curve_covariance(speed, error, spread, effects, shown)
    std = dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    return SteadyModel(
        effects=effects,
        values=shown,
        std=std,
        covariance=covariance,
        predicted=predicted,
        rms=float(np.sqrt(np.mean((force - predicted) ** 2))),
        spread=spread,
        bic=float(deviance + count * np.log(len(force))),
        heldout=_heldout(speed, force, error, effects, shape),
    )


def curve_covariance(
    speed: np.ndarray,
    error: np.ndarray,
    spread: float,
    effects: Sequence[str],
    values: Mapping[str, float],
) -> tuple[list[str], np.ndarray]:
    """Names and covariance (p, p) of the parameters of a curve with `values` (SI), by its runs.

    speed, error : of the runs [n]. spread : tau, by which runs differ beyond their errors. n of a
    Stribeck term is taken as known.
    """
    shape = (values["vs"], values["n"]) if "stribeck" in effects else None
    rows = _jacobian(speed, effects, shape, values.get("fs", 0.0))
    names = [*_names(effects), *(["vs"] if shape is not None else [])]
    return names, _covariance(rows / np.sqrt(error**2 + spread**2)[:, None])


def _covariance(rows: np.ndarray) -> np.ndarray:
    """(J' J)^-1 of columns of very different sizes."""
    size = np.sqrt(np.sum(rows**2, axis=0))
    size = np.where(size > 0, size, 1.0)
    return np.linalg.pinv((rows / size).T @ (rows / size), hermitian=True) / np.outer(size, size)


def _likeliest_shape(
    speed: np.ndarray, force: np.ndarray, error: np.ndarray, effects: Sequence[str]
) -> tuple[float, float]:
    """vs and n of the likeliest Stribeck term that adds friction at low speed."""
    place = _names(effects).index("fs")

    def deviance(log_vs: float, n: float) -> float:
        found = _weighted(_matrix(speed, effects, (float(np.exp(log_vs)), n)), force, error)
        return found[2] if found[0][place] > 0 else np.inf

    slow, fast = np.min(np.abs(speed)), np.max(np.abs(speed))
    grid = np.linspace(np.log(0.5 * slow), np.log(fast), _SPEEDS)
    best = (np.inf, float(np.exp(grid[_SPEEDS // 2])), 2.0)
    for n in _POWERS:
        scores = [deviance(u, n) for u in grid]
        k = int(np.clip(np.argmin(scores), 1, _SPEEDS - 2))
        fine = minimize_scalar(
            lambda u, n=n: min(deviance(u, n), 1e300),
            bounds=(grid[k - 1], grid[k + 1]),
            method="bounded",
        )
        u = float(fine.x)
        best = min(best, (deviance(u, n), float(np.exp(u)), n))
    return best[1], best[2]


def _weighted(
    matrix: np.ndarray, force: np.ndarray, error: np.ndarray
) -> tuple[np.ndarray, float, float]:
    """Least squares with variances error^2 + tau^2, tau by likelihood: values, tau, -2 ln L."""

    def at(log_tau: float):
        variance = error**2 + np.exp(2 * log_tau)
        root = np.sqrt(variance)
        values, *_ = np.linalg.lstsq(matrix / root[:, None], force / root, rcond=None)
        left = (force - matrix @ values) / root
        return values, float(left @ left + np.sum(np.log(variance)))

    scale = max(float(np.std(force)), 1e-300)
    low, high = np.log(1e-6 * scale), np.log(2 * scale)
    found = minimize_scalar(lambda u: at(u)[1], bounds=(low, high), method="bounded")
    log_tau = float(found.x)
    values, deviance = at(log_tau)
    return values, float(np.exp(log_tau)), deviance


def _heldout(
    speed: np.ndarray, force: np.ndarray, error: np.ndarray, effects: Sequence[str], shape: _Shape
) -> float:
    """Leave out every run with its neighbours in speed; the shape stays as fitted."""
    order = np.argsort(speed)
    left = np.zeros(len(speed))
    matrix = _matrix(speed, effects, shape)
    for place, k in enumerate(order):
        out = order[max(0, place - 1) : place + 2]
        rest = np.setdiff1d(np.arange(len(speed)), out)
        values, *_ = _weighted(matrix[rest], force[rest], error[rest])
        left[k] = force[k] - matrix[k] @ values
    return float(np.sqrt(np.mean(left**2)))
