"""The friction of steady speeds: a curve of force against speed, and what Coulomb and viscous
friction lack there.

    F(v) = F_c sgn v + F_v v + F_0                                                        (base)
         + d |v|                             direction_asymmetry
         + fs exp(-(|v|/vs)^n) sgn v, fs > 0, n = 1 or 2     stribeck
         + c v^3                             cubic

Every run counts with the error of its mean. Runs also differ by more than that (a spread beyond
the errors of the means, tau): it is estimated with each candidate, as the noise of a loop is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ..errors import InputError
from ..records.steady import SteadyCurve

STEADY_EFFECTS = ("direction_asymmetry", "stribeck", "cubic")
_FEWEST = 8
_ACCEPT = 10.0
_SPEEDS = 60
_HINT = 2.0
_POWERS = (1.0, 2.0)


@dataclass(frozen=True, eq=False)
class SteadyModel:
    """One model of a steady curve, fitted."""

    effects: tuple[str, ...]
    values: dict[str, float]
    """SI (or % of the rated torque), by name."""
    std: dict[str, float]
    predicted: np.ndarray
    """Force at the runs."""
    rms: float
    """Of the means of the runs about the model, each run once."""
    spread: float
    """Standard deviation of runs beyond the error of their means (tau)."""
    bic: float
    heldout: float
    """rms of every run about the model fitted without it and its neighbours in speed."""

    def force(self, speed: np.ndarray) -> np.ndarray:
        """Force at any speed."""
        shape = (self.values["vs"], self.values["n"]) if "stribeck" in self.effects else None
        values = np.asarray([self.values[name] for name in _names(self.effects)])
        return _matrix(np.asarray(speed, float), self.effects, shape) @ values


@dataclass(frozen=True, eq=False)
class SteadyLoop:
    """What a steady curve tells of friction."""

    curve: SteadyCurve
    base: SteadyModel
    final: SteadyModel
    candidates: tuple[SteadyModel, ...]
    verdict: str
    """As of `jaxfric.loop`: "no_missing_effect", "effects" or "too_weak"."""
    sentence: str

    def units(self) -> tuple[str, str, float]:
        """As of `shown_units`."""
        return shown_units(self.curve)


def shown_units(curve: SteadyCurve) -> tuple[str, str, float]:
    """Units of force and speed to show, and what one of the force unit is in SI."""
    speed = "rad/s" if curve.coordinate == "rotary" else "m/s"
    if curve.force_unit != "%" and np.max(np.abs(curve.force)) < 0.1:
        return f"m{curve.force_unit}", speed, 1e-3
    return curve.force_unit, speed, 1.0


def close_steady_loop(
    curve: SteadyCurve, *, with_: Sequence[str] = (), without: Sequence[str] = ()
) -> SteadyLoop:
    """Fit the curve, then add effects of `STEADY_EFFECTS` one by one.

    `with_` belong to the base, `without` are not tried. One is taken where BIC falls by more than
    10 and runs held out (each with its neighbours in speed) are predicted better.

    Raises
    ------
    InputError : an unknown effect; fewer than 8 runs, fewer than 3 of one direction.
    """
    speed = np.asarray(curve.speed)
    forward, backward = int(np.sum(speed > 0)), int(np.sum(speed < 0))
    if len(speed) < _FEWEST or min(forward, backward) < 3:
        raise InputError(
            f"the curve has {forward} speeds forwards and {backward} backwards; {_FEWEST} in all"
            " and 3 of each direction are needed"
        )
    unknown = sorted({*with_, *without} - set(STEADY_EFFECTS))
    if unknown:
        raise InputError(
            f"effect '{unknown[0]}' is none of a steady curve; there are: "
            + ", ".join(STEADY_EFFECTS)
        )
    base = _fit(curve, tuple(with_))
    current, tried = base, [base]
    while True:
        missing = [e for e in STEADY_EFFECTS if e not in (*current.effects, *without)]
        models = [_fit(curve, (*current.effects, e)) for e in missing]
        tried += models
        better = [m for m in models if _acceptable(current, m)]
        if not better:
            break
        current = min(better, key=lambda m: m.bic)
    best = max((current.bic - m.bic for m in tried if m is not current), default=0.0)
    verdict, text = _said(curve, base, current, best)
    ranked = tuple(sorted(tried, key=lambda m: m.bic))
    return SteadyLoop(curve, base, current, ranked, verdict, text)


def _acceptable(current: SteadyModel, model: SteadyModel) -> bool:
    physical = model.values.get("fs", 1.0) > 0
    return physical and current.bic - model.bic > _ACCEPT and model.heldout < current.heldout


def _said(curve, base: SteadyModel, final: SteadyModel, best: float) -> tuple[str, str]:
    unit, _, size = shown_units(curve)
    refused = [e for e in ("stribeck", "direction_asymmetry") if e not in final.effects]
    rest = f" Not supported: {', '.join(refused)}." if refused else ""
    added = [e for e in final.effects if e not in base.effects]
    before, after = base.rms / size, final.rms / size
    if added:
        return "effects", (
            f"The curve lacks {' and '.join(added)}: rms {before:.3g} -> {after:.3g} {unit}, BIC"
            f" {base.bic - final.bic:.0f} lower.{rest}"
        )
    if best > _HINT:
        return "too_weak", (
            f"Something may be missing, but no effect is supported by more than {_ACCEPT:g} of BIC"
            f" (best {best:.1f})."
        )
    return "no_missing_effect", f"Nothing is missing: rms {before:.3g} {unit}.{rest}"


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


def _fit(curve: SteadyCurve, effects: tuple[str, ...]) -> SteadyModel:
    speed, force, error = (np.asarray(x) for x in (curve.speed, curve.force, curve.error))
    shape = _likeliest_shape(speed, force, error, effects) if "stribeck" in effects else None
    matrix = _matrix(speed, effects, shape)
    values, covariance, spread, deviance = _weighted(matrix, force, error)
    predicted = matrix @ values
    names, count = _names(effects), len(values) + 1 + (0 if shape is None else 2)
    shown = dict(zip(names, values.tolist(), strict=True))
    if shape is not None:
        shown |= {"vs": shape[0], "n": shape[1]}
    std = dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    return SteadyModel(
        effects=effects,
        values=shown,
        std=std,
        predicted=predicted,
        rms=float(np.sqrt(np.mean((force - predicted) ** 2))),
        spread=spread,
        bic=float(deviance + count * np.log(len(force))),
        heldout=_heldout(speed, force, error, effects, shape),
    )


def _likeliest_shape(speed, force, error, effects) -> tuple[float, float]:
    """vs and n of the likeliest Stribeck term that adds friction at low speed."""
    place = _names(effects).index("fs")

    def deviance(log_vs: float, n: float) -> float:
        found = _weighted(_matrix(speed, effects, (float(np.exp(log_vs)), n)), force, error)
        return found[3] if found[0][place] > 0 else np.inf

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
        u = float(fine.x)  # pyright: ignore[reportAttributeAccessIssue]
        best = min(best, (deviance(u, n), float(np.exp(u)), n))
    return best[1], best[2]


def _weighted(matrix, force, error) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Least squares with variances error^2 + tau^2, tau by likelihood: values, covariance, tau,
    -2 ln L."""

    def at(log_tau: float):
        variance = error**2 + np.exp(2 * log_tau)
        root = np.sqrt(variance)
        values, *_ = np.linalg.lstsq(matrix / root[:, None], force / root, rcond=None)
        left = (force - matrix @ values) / root
        return values, variance, float(left @ left + np.sum(np.log(variance)))

    scale = max(float(np.std(force)), 1e-300)
    low, high = np.log(1e-6 * scale), np.log(2 * scale)
    found = minimize_scalar(lambda u: at(u)[2], bounds=(low, high), method="bounded")
    log_tau = float(found.x)  # pyright: ignore[reportAttributeAccessIssue]
    values, variance, deviance = at(log_tau)
    covariance = np.linalg.pinv((matrix / variance[:, None]).T @ matrix)
    return values, covariance, float(np.exp(log_tau)), deviance


def _heldout(speed, force, error, effects, shape) -> float:
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
