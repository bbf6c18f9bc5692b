"""The result of a prediction: how far a saved model is from a record, and why."""

import math
from dataclasses import dataclass

import numpy as np

from ..described import Described, Drawable, Gridded, Tabular
from ..plain import plain
from ..records.record import Provenance
from ..schemas import PREDICTION

_AS_GOOD = 1.1
"""Ratio of rms to that of a refit up to which a prediction is as good as a fit."""
_AT_NOISE = 1.3
"""Ratio of rms to the scatter of neighbouring rows up to which a refit is at the noise."""
_SHIFTED = 3.0


@dataclass(frozen=True)
class Comparison:
    """One model against the record, in one way of comparing."""

    model: str
    """ "fit"; of a loop "before" or "after"."""
    method: str
    rms: float
    """Root mean square of predicted minus recorded, in `unit`."""
    unit: str
    relative_error: float
    """|predicted - recorded|/|recorded|; of a slider recorded less its mean."""
    in_sigma: float | None
    """rms over the scatter of neighbouring rows of this record; None where that is not known."""


@dataclass(frozen=True)
class Shift:
    """A parameter of the model, and what a fit of the same model to this record gives."""

    name: str
    model: float
    here: float
    error: float
    """Standard error of the difference; nan where it is not known."""

    @property
    def in_sigma(self) -> float:
        """The difference in standard errors."""
        return (self.here - self.model) / self.error if self.error > 0 else math.nan


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Described, Drawable, Gridded, Tabular):
    """A saved model on another record. SI; forces in `force_unit`."""

    source: str
    """The file of the model."""
    origin: Provenance
    """Origin of the record."""
    kind: str
    """ "slider" or "axis"."""
    force_unit: str
    comparisons: tuple[Comparison, ...]
    """Comparisons with the record; the sentence speaks of the first."""
    refitted: dict[str, tuple[float, float]]
    """Quantities fitted to this record: value of the model, value here."""
    sigma: float
    """Scatter of neighbouring rows of the residual."""
    refit_rms: float
    """Root mean square of the residual after a fit of the same model to this record."""
    shifts: tuple[Shift, ...]
    time: np.ndarray
    recorded: np.ndarray
    predicted: np.ndarray
    """Prediction at the rows compared (n); nan where a row does not count."""
    position: tuple[np.ndarray, np.ndarray, str] | None
    """Time, simulated minus recorded position, unit; of a closed loop."""
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def rms(self) -> float:
        """Root mean square of the residual that the sentence speaks of."""
        return self.comparisons[0].rms

    @property
    def verdict(self) -> str:
        """ "noise", "parameters" or "model": what a residual beyond the noise is due to."""
        if self.rms > _AS_GOOD * self.refit_rms:
            return "parameters"
        return "noise" if self.refit_rms <= _AT_NOISE * self.sigma else "model"

    def shares(self) -> dict[str, float]:
        """Shares of the mean square residual: what a refit would take away, what it would leave
        beyond the scatter of neighbouring rows, and that scatter. They add up to 1."""
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
        begin = f"The model leaves {self.rms:.3g}{unit}, {ratio:.2g} times the noise of this record"
        moved = [
            s.name
            for s in self.shifts
            if abs(s.in_sigma) > _SHIFTED and s.name not in self.refitted
        ]
        if self.verdict == "noise":
            return f"{begin}: the noise allows it, and nothing else is seen."
        asks = "jaxfric axis" if self.kind == "axis" else "jaxfric loop"
        lacks = (
            "the model lacks an effect here, or the noise is correlated over many rows"
            f" ({asks} asks which)"
        )
        if self.verdict == "model":
            return (
                f"{begin}. A fit of the same model to this record would leave no less"
                f" ({self.refit_rms:.3g}{unit}): {lacks}."
            )
        beyond = self.refit_rms > _AT_NOISE * self.sigma
        left = f"; that too is more than the noise: {lacks}" if beyond else ", which is the noise"
        if moved:
            changed = f"its parameters have changed ({', '.join(moved)} differ)"
        else:
            changed = (
                "other parameters fit it better together, though none differs by more than"
                f" {_SHIFTED:g} of its errors"
            )
        return (
            f"{begin}. A fit of the same model to this record would leave"
            f" {self.refit_rms:.3g}{unit}{left}: {changed}."
        )

    def to_json(self) -> dict:
        """The content of `prediction.json`, schema `schemas.PREDICTION`; SI."""
        table = {
            "schema": PREDICTION,
            "model": self.source,
            "record": {
                "path": self.origin.path,
                "sha256": self.origin.sha256,
                "rows": int(np.isfinite(self.predicted).sum()),
            },
            "kind": self.kind,
            "force_unit": self.force_unit,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "comparisons": self.comparisons,
            "refitted": {
                name: {"model": model, "here": here}
                for name, (model, here) in self.refitted.items()
            },
            "noise": {"sigma": self.sigma},
            "refit_rms": self.refit_rms,
            "shares": self.shares(),
            "parameters": {
                s.name: {
                    "model": s.model,
                    "here": s.here,
                    "error": s.error,
                    "in_sigma": s.in_sigma,
                }
                for s in self.shifts
            },
            "notes": self.notes,
            "warnings": self.warnings,
        }
        return plain(table)
