"""Common parameters of the steps of a run, and their dependence on velocity, path and stress.

Every step has estimates y = (A, B_1, .., ln L_1, ..) with a covariance C that includes the noise
of its rows. If the steps share one y, the most likely y is

    y = S sum_i C_i^-1 y_i,   S = (sum_i C_i^-1)^-1,
    Q = sum_i (y_i - y)^T C_i^-1 (y_i - y),

Q is the likelihood-ratio statistic of shared against separate parameters, to second order about
each step's fit. For n steps with p parameters, Q is distributed as chi-square with p (n - 1)
degrees of freedom (Cochran 1954, Biometrics 10, 101-129). f0 and a trend with slip are separate for
each step.

A weighted line through the n steps (`weighted`) tests whether a quantity depends on velocity
(`mean_velocity` of a step), displacement or normal stress. The error of the line's slope follows
from the errors of the fits, or is larger if the steps scatter more about the line. Few steps
determine their scatter poorly, so p-values are from Student's t with n - 2 degrees of freedom. They
are multiplied by the number of tests (Bonferroni). For 5 steps, t = 7 gives p = .006, or .05 after
correction for 9 tests. Parameters of steps may differ by far more than their errors although no
line is significant.

Friction that changes with slip biases A-B. Every step is also fitted with a trend over slip, which
shifts its A-B by d_i; s_i is the standard error of this shift. If sum_i (d_i/s_i)^2, chi-square
with n degrees of freedom, is significant, the lines of A-B use the estimates with a trend.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import option
from ..fitting import Fit
from ..fitting.drift import chance
from ..units import measured
from .events import mean_velocity
from .fits import StepFit
from .table import difference, misses
from .weighted import weighted_line

_FEWEST = 4
"""Least number of steps for a line."""
_DIFFER = 0.01
"""Below this p common parameters are rejected."""
_SHOWN = 0.05
"""Below this corrected p a dependence is significant."""
_DECADES = 0.2
"""Least range of velocities for a line, in decades."""


@dataclass(frozen=True, eq=False)
class Shared:
    """Common parameters of all steps: natural `values` and standard `errors` by name (SI), and the
    p-value of the test that the steps share these parameters."""

    values: dict[str, float]
    errors: dict[str, float]
    chi_square: float
    freedom: int
    p: float
    steps: tuple[int, ...]


@dataclass(frozen=True)
class Dependence:
    """A line of `quantity` over `along` through the steps: its `slope` per `unit`, standard error,
    degrees of `freedom`, and the p-value after Bonferroni correction for all `questions`."""

    quantity: str
    along: str
    unit: str
    slope: float
    error: float
    p: float
    freedom: int
    questions: int

    def told(self) -> str:
        """Return the dependence as a line."""
        way = "rises" if self.slope > 0 else "falls"
        size = measured(abs(self.slope), self.error)
        return f"{self.quantity} {way} by {size} per {self.unit}: {self._odds()}"

    def answered(self) -> str:
        """Return the slope, with a statement whether it is significant."""
        size = f"{'+' if self.slope > 0 else ''}{measured(self.slope, self.error)}"
        shown = "not significant"
        if self.shown:
            shown = "significant"
        elif self._alone() < _SHOWN:
            shown = "significant only without the correction"
        return f"{shown}, slope {size} per {self.unit} ({self._odds()})"

    @property
    def shown(self) -> bool:
        """Whether the dependence is significant."""
        return self.p < _SHOWN

    def _odds(self) -> str:
        return (
            f"t = {abs(self.slope) / self.error:.2g}, {self.freedom} d.o.f., p ="
            f" {self._alone():.2g}; {self.p:.2g} after Bonferroni correction for"
            f" {self.questions} tests"
        )

    def _alone(self) -> float:
        """Return the p-value without the correction."""
        return chance(self.slope, self.error, self.freedom)


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


def vector_of(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Return A, B_i and ln L_i of a fit, and their covariance."""
    names = names_of(fit)
    at = [fit.free.index(n) for n in names]
    values = np.array([fit.parameters[n].value for n in names])
    lengths = np.array([n[0] == "L" for n in names])
    scale = np.where(lengths, values, 1.0)
    covariance = fit.covariance[np.ix_(at, at)] / np.outer(scale, scale)
    return np.where(lengths, np.log(np.where(lengths, values, 1.0)), values), covariance


def share(steps: Sequence[StepFit]) -> Shared | None:
    """Return the common parameters; None if fewer than two steps determine their parameters."""
    from scipy.special import chdtrc

    known = [step for step in steps if is_known(step)]
    if len(known) < 2:
        return None
    fits = [step.fit for step in known if step.fit is not None]
    names = names_of(fits[0])
    vectors, weights = [], []
    for fit in fits:
        vector, covariance = vector_of(fit)
        vectors.append(vector)
        weights.append(np.linalg.pinv(covariance, hermitian=True))
    covariance = np.linalg.pinv(np.sum(weights, axis=0), hermitian=True)
    mean = covariance @ sum(w @ v for w, v in zip(weights, vectors, strict=True))
    q = float(sum((v - mean) @ w @ (v - mean) for w, v in zip(weights, vectors, strict=True)))
    freedom = len(names) * (len(fits) - 1)
    lengths = np.array([n[0] == "L" for n in names])
    values = np.where(lengths, np.exp(np.where(lengths, mean, 0.0)), mean)
    errors = np.sqrt(np.diag(covariance)) * np.where(lengths, values, 1.0)
    return Shared(
        dict(zip(names, values.tolist(), strict=True)),
        dict(zip(names, errors.tolist(), strict=True)),
        q,
        freedom,
        float(chdtrc(freedom, q)),
        tuple(step.number for step in known),
    )


_QUANTITIES = {"A": "A", "A-B": "A-B", "ln L": "L"}
"""Quantities tested for a dependence, and their symbols."""


def dependences(steps: Sequence[StepFit]) -> list[Dependence]:
    """Test the dependence of A, A-B and L on velocity, displacement and normal stress.

    A test needs at least four steps, and a variable that changes.
    """
    found = []
    for quantity in _QUANTITIES:
        known = _asked(steps, quantity)
        if len(known) < _FEWEST:
            continue
        y, error = _quantity(known, quantity)
        freedom = len(known) - 2
        for along, unit, x in _sides(known):
            line = weighted_line(x, y, error)
            p = chance(line.slope, line.error, freedom)
            found.append(Dependence(quantity, along, unit, line.slope, line.error, p, freedom, 1))
    count = len(found)
    return [replace(d, p=min(1.0, count * d.p), questions=count) for d in found]


def _sides(known: Sequence[StepFit]) -> list[tuple[str, str, np.ndarray]]:
    """Return the variables that change among steps: name, unit of a slope, values of the steps."""
    speeds = [np.log10(mean_velocity(s.event)) for s in known]
    sides: list[tuple[str, str, np.ndarray, float | None]] = [
        ("velocity", "decade of velocity", np.array(speeds), _DECADES),
        (
            "displacement",
            "mm of load-point displacement",
            np.array([1e3 * s.position for s in known]),
            1e-9,
        ),
    ]
    stresses = [s.event.normal_stress for s in known]
    if all(stress is not None for stress in stresses):
        levels = np.array([stress / 1e7 for stress in stresses if stress is not None])
        sides.append(("normal stress", "10 MPa of normal stress", levels, None))
    return [
        (along, unit, x)
        for along, unit, x, least in sides
        if np.ptp(x) > (0.02 * np.abs(x).max() if least is None else least)
    ]


def _asked(steps: Sequence[StepFit], quantity: str) -> list[StepFit]:
    """Return the steps that determine a quantity with a fit that describes them."""
    return [step for step in steps if not misses(step) and _has(step, quantity)]


def _has(step: StepFit, quantity: str) -> bool:
    """Whether the fit of a step determines A, A-B or its (first) L."""
    fit = step.fit
    if fit is None or not fit.converged:
        return False
    if quantity == "A-B":
        return fit.A_minus_B.determined and bool(np.isfinite(difference(fit)).all())
    estimate = fit.parameters["A" if quantity == "A" else _first_length(fit)]
    return estimate.determined and bool(np.isfinite([estimate.value, estimate.std]).all())


def trend_chance(steps: Sequence[StepFit]) -> float:
    """Return the p-value of the shift of A-B if a trend of friction over slip is fitted too; 1 if
    the shift is unknown for a step, or if the fits already have a trend."""
    from scipy.special import chdtrc

    fits = [step.fit for step in _asked(steps, "A-B") if step.fit is not None]
    if not fits or any(fit.with_trend is None for fit in fits):
        return 1.0
    moved = []
    for fit in fits:
        (value, error), (other, wider) = difference(fit), fit.with_trend or (0.0, 0.0)
        moved.append((other - value) ** 2 / max(wider**2 - error**2, error**2))
    return float(chdtrc(len(moved), sum(moved)))


def _first_length(fit: Fit) -> str:
    return next(n for n in names_of(fit) if n[0] == "L")


def _quantity(known: Sequence[StepFit], quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """Return A, A-B or the logarithm of the (first) L of the steps, with their errors."""
    fits = [step.fit for step in known if step.fit is not None]
    if quantity == "A-B":
        trend = trend_chance(known) < _DIFFER
        both = np.array([f.with_trend if trend else difference(f) for f in fits])
        return both[:, 0], both[:, 1]
    names = ["A" if quantity == "A" else _first_length(f) for f in fits]
    found = [f.parameters[n] for f, n in zip(fits, names, strict=True)]
    y, error = np.array([(e.value, e.std) for e in found]).T
    return (y, error) if quantity == "A" else (np.log(y), error / y)


def told(steps: Sequence[StepFit]) -> list[str]:
    """Return lines on common parameters of the steps, and on dependences."""
    shared = share(steps)
    if shared is None:
        return []
    parts = []
    for name, value in shared.values.items():
        error = shared.errors[name]
        text = (
            measured(1e6 * value, 1e6 * error) + " um" if name[0] == "L" else measured(value, error)
        )
        parts.append(f"{name} {text}")
    lines = [f"shared by {len(shared.steps)} steps: {', '.join(parts)}"]
    if shared.p < _DIFFER:
        lines[0] = (
            f"the steps do not share their parameters (likelihood-ratio test: p = {shared.p:.1g},"
            f" chi-square {shared.chi_square:.4g} with {shared.freedom} d.o.f.); weighted mean:"
            f" {', '.join(parts)}"
        )
    else:
        lines[0] += f" (likelihood-ratio test: p = {shared.p:.2g}, not rejected)"
    missed = [s for s in steps if s.number in shared.steps and misses(s)]
    if missed:
        lines.append(
            f"of these, step {', '.join(str(s.number) for s in missed)}: the fit does not describe"
            " the step (*), so that differences may have other causes than friction"
        )
    answers = dependences(steps)
    lines.append(_of_velocity(steps, answers))
    if any(d.quantity == "A-B" for d in answers) and (p := trend_chance(steps)) < _DIFFER:
        lines.append(
            f"friction has a significant trend with slip in these steps (p = {p:.1g}): the lines of"
            f" A-B use fits with this trend ({option('slip-trend')})"
        )
    told_of = [d for d in answers if d.shown]
    lines += [d.told() for d in told_of if not _is_of_velocity(d)]
    if answers and not told_of:
        sides = ", ".join(dict.fromkeys(d.along for d in answers))
        asked = [name for name in _QUANTITIES if name in {d.quantity for d in answers}]
        *others, ended = [_QUANTITIES[name] for name in asked]
        named = f"{', '.join(others)} or {ended}" if others else ended
        lines.append(
            f"no significant dependence of {named} on {sides} (p > .05)"
            if shared.p >= _DIFFER
            else f"steps {', '.join(map(str, shared.steps))} differ by more than their errors, but"
            f" without a significant dependence of {named} on {sides} (p > .05 after Bonferroni"
            f" correction for {len(answers)} tests)"
        )
        for name in _QUANTITIES:
            if name not in asked:
                count = len(_asked(steps, name))
                lines[-1] += f"; {_QUANTITIES[name]} is determined in {count} steps: not tested"
    return lines


def _of_velocity(steps: Sequence[StepFit], answers: Sequence[Dependence]) -> str:
    """Return a line on the dependence of A-B on velocity, or why it is not tested."""
    numbers = [str(step.number) for step in _asked(steps, "A-B")]
    for answer in answers:
        if _is_of_velocity(answer):
            which = f"of steps {', '.join(numbers)}"
            which += " (none with a star)" if any(map(misses, steps)) else ""
            return f"A-B against velocity (geometric mean of a step), {which}: {answer.answered()}"
    known = len(numbers)
    why = "the steps have about the same mean velocity"
    if known < _FEWEST:
        why = f"A-B is determined by fits without a star in {known} steps, {_FEWEST} are needed"
    return f"A-B against velocity: not tested, {why}"


def _is_of_velocity(answer: Dependence) -> bool:
    return (answer.quantity, answer.along) == ("A-B", "velocity")
