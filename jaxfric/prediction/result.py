"""The result of a prediction: the error of a saved model on a record, and the error's cause."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ..described import Described, Drawable, Gridded, Tabular
from ..findings import Warned, listed
from ..plain import entries, plain
from ..records.record import Provenance
from ..records.steps import VelocitySteps
from ..schemas import PREDICTION

_AS_GOOD = 1.1
"""Largest rms, over that of a refit, of a prediction that is as good as a fit."""
_SIGNIFICANT = 1e-3
"""Significance level of a change of the parameters."""
_SHIFTED = 3.0


class NoteCode(StrEnum):
    """Codes of the notes of a prediction."""

    FITTED = "parameters_fitted"
    """Values: parameters."""
    NOTHING = "nothing_fitted"
    STEPS = "step_times_fitted"
    STIFFNESS = "stiffness_of_the_model"
    """Values: stiffness, unit."""
    SCALED = "stiffness_scaled_by_normal_stress"
    """Values: stiffness, of_model, unit; before and here, the normal stresses [Pa]."""
    INSIDE = "disturbance_inside"
    BESIDE = "disturbance_beside"
    NOISE = "noise_of_the_record"
    """Values: sigma, largest, share."""


@dataclass(frozen=True)
class Comparison:
    """Comparison of one model with the record by one method."""

    model: str
    """ "fit"; for a loop "before" or "after"."""
    method: str
    rms: float
    """Root mean square of predicted minus recorded, in `unit`."""
    unit: str
    relative_error: float
    """|predicted - recorded|/|recorded|; for a slider the denominator is without the mean."""
    in_sigma: float | None
    """rms over the noise of this record (`Prediction.sigma`); None if it is not known."""

    @staticmethod
    def of(
        model: str,
        method: str,
        error: np.ndarray,
        recorded: np.ndarray,
        unit: str,
        sigma: float | None,
    ) -> "Comparison":
        """Compare by the rows' `error` (predicted - `recorded`) and their noise `sigma`."""
        rms = float(np.sqrt(np.mean(error**2)))
        relative = float(np.linalg.norm(error) / np.linalg.norm(recorded))
        return Comparison(model, method, rms, unit, relative, rms / sigma if sigma else None)


@dataclass(frozen=True)
class Shift:
    """A parameter of the model, and its value in a refit to this record."""

    name: str
    model: float
    here: float
    error: float
    """Standard error of the difference; nan if not known."""

    @property
    def in_sigma(self) -> float:
        """Value in the refit minus value in the model, in standard errors."""
        return (self.here - self.model) / self.error if self.error > 0 else math.nan


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Described, Drawable, Gridded, Tabular):
    """Prediction of another record by a saved model. SI; forces in `force_unit`."""

    source: str
    """The file of the model."""
    origin: Provenance
    """Origin of the record."""
    kind: str
    """ "slider" or "axis"."""
    force_unit: str
    comparisons: tuple[Comparison, ...]
    """Comparisons with the record; the verdict is about the first."""
    refitted: dict[str, tuple[float, float]]
    """Quantities fitted to this record: value of the model, value for this record."""
    sigma: float
    """Noise of a row: standard deviation of white and correlated noise together."""
    refit_rms: float
    """Root mean square residual of the same model refitted to this record."""
    shifts: tuple[Shift, ...]
    time: np.ndarray
    recorded: np.ndarray
    predicted: np.ndarray
    """Prediction at the rows (n); nan for rows that are not compared."""
    position: tuple[np.ndarray, np.ndarray, str] | None
    """For a closed loop: time, simulated minus recorded position, unit."""
    notes: tuple[Warned, ...]
    """Notes with their codes (`NoteCode`) and values."""
    warnings: tuple[str, ...]
    largest: float
    """Largest rms over `sigma` that noise explains, in all but about one record of a thousand."""
    chance: float
    """Chance that a refit lowers the error as much, or shifts the parameters as far, if none has
    changed: the smaller of both. It counts the errors of the model and of the refit. It is tested
    only if noise does not explain the error, and is 1 otherwise."""
    steps: VelocitySteps | None = None
    """Velocity steps of a slider's record."""

    @property
    def rms(self) -> float:
        """Root mean square residual of the first comparison."""
        return self.comparisons[0].rms

    @property
    def verdict(self) -> str:
        """Cause of the residual: "noise", changed "parameters", or the "model"."""
        if self.rms > _AS_GOOD * self.refit_rms and self.chance < _SIGNIFICANT:
            return "parameters"
        return "model" if self._beyond(self.refit_rms) else "noise"

    def _beyond(self, rms: float) -> bool:
        """Whether noise does not explain an error."""
        return rms > self.largest * self.sigma

    def shares(self) -> dict[str, float]:
        """Return shares of the mean square residual: removable by a refit ("parameters"), misfit of
        the refit beyond noise ("model"), and noise. The sum of the three shares is 1.
        """
        whole = self.rms**2
        best = min(self.refit_rms**2, whole)
        noise = min(self.sigma**2, best)
        return {
            "parameters": (whole - best) / whole,
            "model": (best - noise) / whole,
            "noise": noise / whole,
        }

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        unit = "" if self.force_unit == "1" else f" {self.force_unit}"
        ratio = self.rms / self.sigma
        agrees = "Yes" if self.verdict == "noise" else "No"
        begin = (
            f"{agrees}: the prediction error is {self.rms:.3g}{unit}, {ratio:.2g} times the noise"
            " of this record"
        )
        moved = [
            s.name
            for s in self.shifts
            if abs(s.in_sigma) > _SHIFTED and s.name not in self.refitted
        ]
        if self.verdict == "noise" and self._beyond(self.rms):
            return f"{begin}, which noise and the errors of the fitted parameters explain."
        if self.verdict == "noise":
            return f"{begin}, which is consistent with noise."
        begin += f" (noise explains up to {self.largest:.3g})"
        asks = "jaxfric axis" if self.kind == "axis" else "jaxfric loop"
        lacks = (
            "the model lacks an effect here, or the noise is correlated over many rows"
            f" (find out with {asks})"
        )
        if self.verdict == "model":
            clearly = "significantly " if self.rms > _AS_GOOD * self.refit_rms else ""
            return (
                f"{begin}. Refitted to this record, the same model is not {clearly}better"
                f" ({self.refit_rms:.3g}{unit}): {lacks}."
            )
        left = (
            f", still above the noise: {lacks}" if self._beyond(self.refit_rms) else ", the noise"
        )
        if moved:
            changed = f"its parameters have changed ({', '.join(moved)} differ)"
        else:
            changed = (
                "other parameters together fit better, but none differs by more than"
                f" {_SHIFTED:g} of its errors"
            )
        return (
            f"{begin}. Refitted to this record, the same model has an error of"
            f" {self.refit_rms:.3g}{unit}{left}: {changed}."
        )

    def to_json(self) -> dict:
        """Return the content of `prediction.json`, schema `schemas.PREDICTION`; SI."""
        table = {
            "schema": PREDICTION,
            "model": self.source,
            "record": self.origin.to_json(int(np.isfinite(self.predicted).sum())),
            **entries(self, "kind", "force_unit", "verdict", "sentence", "comparisons"),
            "refitted": {
                name: {"model": model, "here": here}
                for name, (model, here) in self.refitted.items()
            },
            "noise": {"sigma": self.sigma, "largest_ratio": self.largest},
            "refit_rms": self.refit_rms,
            "chance_of_refit": self.chance,
            "shares": self.shares(),
            "parameters": {
                s.name: entries(s, "model", "here", "error", "in_sigma") for s in self.shifts
            },
            **listed(self.notes, "notes", "noted"),
            **listed(self.warnings),
        }
        return plain(table)
