"""Common parameters of the steps of a run, and their dependence on velocity, path and stress.

Every velocity step has estimates y = (A, B_1, .., ln L_1, ..) with a covariance C that includes the
noise of its rows. If the steps share one y, the most likely y and the statistic Q are:

    y = S sum_i C_i^-1 y_i,   S = (sum_i C_i^-1)^-1,
    Q = sum_i (y_i - y)^T C_i^-1 (y_i - y),

Q is the likelihood-ratio statistic of shared against separate parameters, to second order about
each step's fit. For n steps with p parameters, Q is distributed as chi-square with p (n - 1)
degrees of freedom (Cochran 1954, Biometrics 10, 101-129). If p is below 0.01, the errors of y are
multiplied by the square root of Q over its degrees of freedom (Birge, as in `weighted`). If p is
below 0.001, Q rejects a common y, and y is a mean of different steps. f0 and a trend with slip are
separate for each step.

A weighted line through the n steps (`weighted`) tests whether a quantity depends on velocity
(`mean_velocity` of a step), displacement or normal stress. The error of the line's slope follows
from the errors of the fits, or is larger if the steps scatter more about the line. Few steps
determine their scatter poorly, so p-values are from Student's t with n - 2 degrees of freedom. The
p-values are multiplied by the number of tests (Bonferroni). For 5 steps, t = 7 gives p = .006, or
.05 after correction for 9 tests. Parameters of steps may differ by far more than their errors
although no line is significant.

Friction that changes with slip biases A, B and L, by opposite amounts in steps up and down. Two
tests show such a trend in all steps together; the smaller p is doubled (Bonferroni):

- The shifts of A-B with a trend in every step (`fitting.drift.trend_chance`).
- A trend s that the steps share like the other parameters, y = (A, B_1, .., ln L_1, .., s). Then
  (s/error)^2 is chi-square with one degree of freedom. The test counts only if Q does not reject
  this y at p = 0.01: steps that differ otherwise imitate a trend.

If the trend is significant, the common parameters and the lines of A-B use estimates with a trend.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..errors import option
from ..fitting import Fit
from ..fitting.drift import chance, trend_chance
from ..units import measured, p_text
from .events import mean_velocity
from .fits import StepFit
from .table import misses
from .weighted import weighted_line, weighted_mean

_FEWEST = 4
"""Least number of steps for a line."""
_DIFFER = 0.01
"""Below this p the errors of common parameters are enlarged, and a trend with slip is significant.
"""
_REJECTED = 0.001
"""Below this p common parameters are rejected. The noise of a run is estimated too: of 120
simulated runs of seven steps with common parameters and slow noise, 9 had p < .01 and 1 had p <
.001."""
_SHOWN = 0.05
"""Below this corrected p a dependence is significant."""
_PER_MM = 1e3
"""A slip trend per mm in SI: its error is then of the size of the error of A."""
_DECADES = 0.2
"""Least range of velocities for a line, in decades."""


Trend = Literal["none", "each", "common"]
"""Slip trend of the steps: none, a separate trend in each step, or a common trend."""


@dataclass(frozen=True, eq=False)
class Shared:
    """Common parameters of all steps: natural `values` and standard `errors` by name (SI), and the
    p-value of the test that the steps share these parameters. If p is below 0.01, `errors` are
    enlarged to the scatter of the steps. `slip_trend`
    is a `Trend`; a common trend is one of the parameters."""

    values: dict[str, float]
    errors: dict[str, float]
    chi_square: float
    freedom: int
    p: float
    steps: tuple[int, ...]
    slip_trend: Trend = "none"

    @property
    def rejected(self) -> bool:
        """Whether the steps do not share their parameters."""
        return self.p < _REJECTED


@dataclass(frozen=True)
class Dependence:
    """A line of `quantity` over `along` through the steps: its `slope` per `unit`, standard error,
    degrees of `freedom`, and the p-value after Bonferroni correction for all `questions`. With
    `slip_trend` the line is through estimates of fits with a slip trend."""

    quantity: str
    along: str
    unit: str
    slope: float
    error: float
    p: float
    freedom: int
    questions: int
    slip_trend: bool = False

    def told(self) -> str:
        """Return the slope with its error, and the p-values of the test."""
        alone = chance(self.slope, self.error, self.freedom)
        return (
            f"{self.line()} (t = {abs(self.slope) / self.error:.2g},"
            f" {self.freedom} d.o.f., {p_text(alone)}; {p_text(self.p)} after Bonferroni correction"
            f" for {self.questions} tests)"
        )

    def line(self) -> str:
        """Return the conclusion and the slope with its error."""
        size = f"{'+' if self.slope > 0 else ''}{measured(self.slope, self.error)}"
        return (
            f"{self.quantity} against {self.along}: {'' if self.shown else 'not '}significant,"
            f" slope {size} per {self.unit}"
        )

    @property
    def shown(self) -> bool:
        """Whether the dependence is significant."""
        return self.p < _SHOWN


def is_known(step: StepFit) -> bool:
    """Whether the fit of a velocity step determines A, all B and all L."""
    fit = step.fit
    return (
        fit is not None
        and fit.converged
        and all(fit.parameters[n].determined for n in names_of(fit))
        and bool(np.isfinite(vector_of(fit)[1]).all())
    )


def names_of(fit: Fit) -> list[str]:
    """Return the names of A, all B and all L of a fit, in the order of its free parameters."""
    return [n for n in fit.free if n[0] in "ABL" and (n == "A" or n[1:].isdigit() or len(n) == 1)]


def vector_of(fit: Fit, trend: Trend = "none") -> tuple[np.ndarray, np.ndarray]:
    """Return A, B_i, ln L_i and a common slip trend [F/mm] of a fit, and their covariance."""
    names, trended = names_of(fit), None if trend == "none" else fit.trended
    at = np.array([fit.free.index(n) for n in names])
    values = np.array([fit.parameters[n].value for n in names])
    lengths = np.array([n[0] == "L" for n in names])
    scale = np.where(lengths, values, 1.0)
    vector = np.where(lengths, np.log(np.where(lengths, values, 1.0)), values)
    if trended is None:
        return vector, fit.covariance[np.ix_(at, at)] / np.outer(scale, scale)
    at += 1
    if trend == "common":
        at, scale, vector = np.append(at, 0), np.append(scale, _PER_MM), np.append(vector, 0.0)
    spread = trended.covariance[np.ix_(at, at)] / np.outer(scale, scale)
    return vector + trended.change[at] / scale, spread


def share(steps: Sequence[StepFit], trend: Trend | None = None) -> Shared | None:
    """Return the common parameters with a slip trend; None: with a trend if one is significant.

    The result is None if fewer than two steps determine their parameters.
    """
    from scipy.special import chdtrc

    if trend is None:
        common = share(steps, "common") if has_trend(steps) else None
        trend = "none" if common is None else "each" if common.rejected else "common"
    known = [step for step in steps if is_known(step)]
    fits = [step.fit for step in known if step.fit is not None]
    if len(fits) < 2 or (trend != "none" and any(fit.trended is None for fit in fits)):
        return None
    names = names_of(fits[0]) + ["slip_trend"] * (trend == "common")
    vectors = [vector_of(fit, trend) for fit in fits]
    mean, covariance, chi_square = weighted_mean(*zip(*vectors, strict=True))
    freedom = len(names) * (len(fits) - 1)
    lengths = np.array([n[0] == "L" for n in names])
    values = np.where(lengths, np.exp(np.where(lengths, mean, 0.0)), mean)
    p = float(chdtrc(freedom, chi_square))
    birge = chi_square / freedom if p < _DIFFER else 1.0
    errors = np.sqrt(birge * np.diag(covariance)) * np.where(lengths, values, 1.0)
    units = np.array([_PER_MM if n == "slip_trend" else 1.0 for n in names])
    return Shared(
        dict(zip(names, (units * values).tolist(), strict=True)),
        dict(zip(names, (units * errors).tolist(), strict=True)),
        chi_square,
        freedom,
        p,
        tuple(step.number for step in known),
        "each" if fits[0].model.slip_trend else trend,
    )


_QUANTITIES = ("A", "A-B", "ln L")
"""Quantities tested for a dependence."""


def dependences(steps: Sequence[StepFit], *, trend: bool | None = None) -> list[Dependence]:
    """Test the dependence of A, A-B and L on velocity, displacement and normal stress.

    The test of a dependence needs at least four steps, and a variable that changes. A-B is that of
    fits with a slip `trend`; None: if this trend is significant.
    """
    trend = has_trend(steps) if trend is None else trend
    found = []
    for quantity in _QUANTITIES:
        known = _known(steps, quantity)
        if len(known) < _FEWEST:
            continue
        y, error = np.array([_estimate(step, quantity) for step in known]).T
        fits, with_trend = [step.fit for step in known if step.fit], trend and quantity == "A-B"
        if with_trend:
            y, error = np.array([rate_of(fit, trend=True) for fit in fits]).T
        fitted, freedom = with_trend or fits[0].model.slip_trend, len(known) - 2
        for along, unit, x in _sides(known):
            line = weighted_line(x, y, error)
            p = chance(line.slope, line.error, freedom)
            about = (line.slope, line.error, p, freedom, 1, fitted)
            found.append(Dependence(quantity, along, unit, *about))
    count = len(found)
    return [replace(d, p=min(1.0, count * d.p), questions=count) for d in found]


def _sides(known: Sequence[StepFit]) -> list[tuple[str, str, np.ndarray]]:
    """Return the variables that change among steps: name, unit of a slope, values of the steps."""
    speeds = np.log10([mean_velocity(s.event) for s in known])
    places = np.array([1e3 * s.position for s in known])
    stresses = np.array([s.event.normal_stress for s in known], float) / 1e7  # nan if unknown
    sides = (
        ("velocity", "decade of velocity", speeds, _DECADES),
        ("displacement", "mm of load-point displacement", places, 1e-9),
        ("normal stress", "10 MPa of normal stress", stresses, 0.02 * np.abs(stresses).max()),
    )
    return [(along, unit, x) for along, unit, x, least in sides if np.ptp(x) > least]


def _known(steps: Sequence[StepFit], quantity: str) -> list[StepFit]:
    """Return the steps that determine a quantity with a fit that describes them."""
    return [step for step in steps if not misses(step) and _estimate(step, quantity) is not None]


def _estimate(step: StepFit, quantity: str) -> tuple[float, float] | None:
    """Return A, A-B or the logarithm of the (first) L of a step with its standard error; None if
    the fit does not determine it."""
    fit = step.fit
    if fit is None or not fit.converged:
        return None
    if quantity == "A-B":
        own = fit.A_minus_B
    else:
        own = fit.parameters[next(n for n in names_of(fit) if n[0] == quantity[-1])]
    value, std = own.value, own.std
    if not (own.determined and np.isfinite([value, std]).all()):
        return None
    return (float(np.log(value)), std / value) if quantity == "ln L" else (value, std)


def has_trend(steps: Sequence[StepFit]) -> bool:
    """Whether friction has a significant trend with slip in the steps: then the common parameters
    and A-B are tested, and A-B is drawn, with this trend."""
    return _trend_chance(steps) < _DIFFER


def _trend_chance(steps: Sequence[StepFit]) -> float:
    """p-value of the hypothesis that the steps lack no slip trend, by the smaller of two tests."""
    from scipy.special import chdtrc

    p = trend_chance([step.fit for step in _known(steps, "A-B") if step.fit is not None])
    common = share(steps, "common")
    if common is not None and common.p >= _DIFFER:
        ratio = common.values["slip_trend"] / common.errors["slip_trend"]
        p = min(p, float(chdtrc(1, ratio**2)))
    return min(1.0, 2 * p)


def rate_of(fit: Fit, *, trend: bool) -> tuple[float, float]:
    """Return A-B with its standard error, of the fit with a slip trend if there is one."""
    own = fit.A_minus_B
    return (fit.with_trend if trend else None) or (own.value, own.std)


def told(steps: Sequence[StepFit]) -> list[str]:
    """Return lines on common parameters of the steps, on A-B against velocity, and on the other
    dependences that are significant."""
    trend, shared = has_trend(steps), share(steps)
    if shared is None:
        return []
    other = share(steps, "none" if trend else "each")
    lines = [_told_shared(shared)]
    if shared.rejected and not trend and other is not None:
        lines[0] += (
            f"; nor do they with a slip trend in every step ({p_text(other.p)})"
            if other.rejected
            else f"; with a slip trend in every step, which is not significant, they may"
            f" ({p_text(other.p)})"
        )
    answers = dependences(steps, trend=trend)
    of_velocity = [d for d in answers if (d.quantity, d.along) == ("A-B", "velocity")]
    lines += [d.told() for d in of_velocity] or [
        f"A-B against velocity: not tested, which needs {_FEWEST} steps without a star at different"
        " mean velocities that determine A-B"
    ]
    if trend:
        pairs = zip(answers, dependences(steps, trend=False), strict=True)
        others = [o.line() for d, o in pairs if d.shown != o.shown]
        if other is not None and other.rejected != shared.rejected:
            others.insert(0, f"the steps {_VERDICTS[other.rejected]} ({p_text(other.p)})")
        lines.append(
            "friction has a significant trend with slip in these steps"
            f" ({p_text(_trend_chance(steps))}): the parameters of the steps together and the"
            f" lines of A-B use fits with this trend ({option('slip-trend')})"
            + "".join(f"; without it {text}" for text in others)
        )
    return lines + [d.told() for d in answers if d.shown and d not in of_velocity]


_VERDICTS = {True: "do not share their parameters", False: "may have the same parameters"}
"""Verdict on common parameters, by whether they are rejected."""

_SHOWN_IN = {"L": (1e6, " um"), "slip_trend": (1 / _PER_MM, " per mm")}
"""Factor from SI, and unit, in which a common parameter is shown."""


def _told_shared(shared: Shared) -> str:
    """Return the likelihood-ratio test of common parameters, and the parameters."""
    parts = []
    for name, value in shared.values.items():
        scale, unit = _SHOWN_IN.get(name.rstrip("0123456789"), (1.0, ""))
        parts.append(f"{name} {measured(scale * value, scale * shared.errors[name])}{unit}")
    values, verdict = ", ".join(parts), _VERDICTS[shared.rejected]
    if shared.rejected:
        return (
            f"the steps {verdict} (likelihood-ratio test: {p_text(shared.p)},"
            f" chi-square {shared.chi_square:.4g} with {shared.freedom} d.o.f.); weighted mean,"
            f" errors enlarged to the scatter: {values}"
        )
    wider = "; errors enlarged to the scatter" if shared.p < _DIFFER else ""
    return (
        f"the {len(shared.steps)} steps {verdict} (likelihood-ratio test:"
        f" {p_text(shared.p)}{wider}): {values}"
    )
