"""The parameters of a fit in the units of its record."""

import numpy as np

from ..fitting.derived import SAMPLES
from ..fitting.drift import Drift, told_drift
from ..fitting.misfit import misfit_warning
from ..fitting.noise import NoiseEstimate
from ..fitting.problem import quantity_of
from ..fitting.result import DIFFERENCE, Estimate, Fit, display_unit
from ..stability.claims import SURE
from ..units import format_si, read_as, with_unit
from .estimates import ROCK_NAMES, STATE, Row, cells, friction_line, length_of
from .report import Report
from .tables import TextTable
from .words import say


def shown_name(name: str) -> str:
    """The name of a parameter with its name in rock mechanics: "A (a)", "L (D_c)", "A-B (a-b)"."""
    if name == DIFFERENCE:
        return "A-B (a-b)"
    own = STATE.fullmatch(name)
    return name if own is None else f"{name} ({ROCK_NAMES[own[1]]}{own[2]})"


def report(fit: Fit) -> Report:
    """The table of parameters and the sentences that `jaxfric fit` prints."""
    head = ("", "", "value", "std", "95 % interval", "unit")
    states = "" if fit.model.states == 1 else f", {fit.model.states} states"
    table = TextTable(f"{fit.law} law{states}", head, [tuple(row) for row in rows(fit)])
    return Report(headline(fit), [table], notes=summary(fit), warnings=fit.warnings)


def rows(fit: Fit) -> list[Row]:
    """Make one row each for A-B, for every free parameter, and for every given parameter."""
    first = _row(DIFFERENCE, "below 0: weakening", fit.A_minus_B, fit)
    return [first, *(_row(n, quantity_of(n).text, e, fit) for n, e in fit.parameters.items())]


def _row(name: str, meaning: str, estimate: Estimate, fit: Fit) -> Row:
    unit, size = unit_for(name, fit)
    return Row(shown_name(name), meaning, *cells(estimate, size), unit)


def unit_for(name: str, fit: Fit) -> tuple[str, float]:
    """The printed unit of a parameter, "" for a pure number, and its size in SI."""
    unit, size = display_unit(name, fit)
    return "" if unit == "1" else read_as(unit), size


def headline(fit: Fit) -> list[str]:
    """State a - b, a, b, D_c, their meaning for stability, and the size of the residual."""
    if not fit.converged:
        return ["the fit did not converge: its numbers mean nothing"]
    drift = told_drift(fit)
    found = friction_line(fit.A_minus_B, fit.parameters, length_of(fit.record))
    return [
        f"{fit.law} law: {found}",
        _stability(fit, drift)[0],
        *(_drifts(fit, drift) or [_noise_line(fit)]),
    ]


def summary(fit: Fit) -> list[str]:
    """Lines on a fit besides the table of its parameters."""
    left_out = len(fit.noise.glitches.rows)
    rms = with_unit(f"{fit.rms:.4g}", fit.record.friction_unit)
    lines = [
        f"{len(fit.record)} rows{f', {left_out} passed over' if left_out else ''}, {fit.result}"
        + (f" in {fit.iterations} iterations" if fit.converged else ""),
        f"rms of the residual {rms}, sum of squares {fit.sum_of_squares:.5g}",
    ]
    if fit.converged:  # otherwise the residual is the failure of the fit, not noise
        lines.append(_noise_line(fit))
    drift = told_drift(fit)
    return [*lines, *_drifts(fit, drift), *_stability(fit, drift)]


def _noise_line(fit: Fit) -> str:
    sigma = with_unit(f"{fit.noise.sigma:.3g}", fit.record.friction_unit)
    return f"noise {sigma}, {noise_text(fit.noise)}"


def noise_text(noise: NoiseEstimate) -> str:
    """Describe the noise by all its parts, and the removed hum."""
    lines = " and ".join(one.text() for one in noise.hum)
    return noise.text() + (f"; {lines} is taken out" if lines else "")


def noise_lines(noise: NoiseEstimate, of: str = "the record") -> list[str]:
    """Describe the noise: standard deviation, quantisation step, and longest correlation."""
    lines = [f"noise of {of}: {noise_text(noise)}"]
    if noise.written:
        lines.append(f"its white part is mostly the recorder's steps of {noise.steps:.2g}")
    if noise.longest:
        lines.append(f"what lasts longer than {noise.bound()} is not taken for noise")
    return lines


def _drifts(fit: Fit, drift: Drift | None) -> list[str]:
    """By how much A-B may be off besides its error, where friction drifts as the fit does not."""
    if drift is None:
        return []
    why = "friction drifts before the step"
    if fit.model.slip_trend:
        why += " by another trend than the fitted one"
    shift = with_unit(f"{drift.shift:.2g}", fit.record.friction_unit)
    return [f"besides its error A-B may be off by up to {shift}: {why} (see below)"]


def _stability(fit: Fit, drift: Drift | None) -> list[str]:
    """Sentences on stability by the fit, or on why there are none."""
    claim = fit.stability()
    if claim.kind == "critical":
        return _critical(fit)
    if claim.kind != "free":
        return [f"nothing is said of stability: {'; '.join(claim.reasons)}"]
    own = fit.A_minus_B
    if drift is not None and own.value - SURE * own.std < drift.shift:
        return ["nothing is said of stability: A-B may be off by more than it is above 0"]
    moving = np.abs(fit.steps.velocities[fit.steps.velocities != 0])
    unit = f"{length_of(fit.record)}/s"
    low, high = (read_as(format_si(V, "m/s", unit, 3)) for V in (moving.min(), moving.max()))
    doubt = "; only if the model holds (see the warnings)" if drift or misfit_warning(fit) else ""
    return [say("fit.strengthening", low=low, high=high, doubt=doubt)]


def _inertia(fit: Fit) -> str:
    """The mass of a critical stiffness, and its speed."""
    if fit.critical_speed is None:
        return "massless"
    mass, unit = fit.parameters["m"].value, f"{length_of(fit.record)}/s"
    kilograms = "kg" if fit.record.friction_unit == "N" else "s^2/m"
    return (
        f"mass {mass:.4g} {kilograms} at {read_as(format_si(fit.critical_speed, 'm/s', unit, 3))}"
    )


def _critical(fit: Fit) -> list[str]:
    """The critical stiffness and the stiffness in units of it, with their 95 % intervals."""
    found, (unit, size) = fit.critical(), unit_for("K", fit)
    own, ratio = found.stiffness, found.ratio
    value, _, ends = cells(own, size)
    upper = f"to {ratio.upper:.2f}" if np.isfinite(ratio.upper) else "or more"
    return [
        f"stiffness is {ratio.value:.2f} times critical (95 %: {ratio.lower:.2f} {upper};"
        f" {_inertia(fit)}, undamped)",
        f"critical stiffness {value} {unit} (95 %: {ends}; of {SAMPLES} samples of the covariance)",
    ]
