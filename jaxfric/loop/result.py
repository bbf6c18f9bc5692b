"""Result of closing the loop: verdict, the fits before and after, and all that was tried."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..described import Described, Drawable, Gridded, Tabular, said
from ..findings import Finding
from ..fitting import Estimate, Fit, NoiseEstimate
from ..fitting.derived import amplitudes, rate_dependence
from ..records import Record, VelocitySteps
from ..runs.joined import Joined
from .axis.result import AxisBase, AxisDetails, PreparedRecord
from .family import CurveFamily
from .refusal import Refusal
from .split import Blocks
from .unfixed import Unfixed, unfixed

SCHEMA = "jaxfric.loop/1"
VERDICTS = ("no_missing_effect", "effects", "ambiguous", "outside_catalogue", "too_weak")


@dataclass(frozen=True, eq=False)
class Score:
    """One model of the record: the base (before) or the base with effects (after)."""

    effects: tuple[str, ...]
    rms: Mapping[str, float]
    """Root mean square by block ("train", "select", "report"), in the unit of friction."""
    per_step: tuple[float, ...]
    """rms of every velocity of the record, in the unit of friction."""
    residual: np.ndarray
    """Predicted minus recorded at the rows of the record."""
    parameters: Mapping[str, Estimate]
    """Estimates by name in SI; those of effects as "second_state.B2"."""
    free: tuple[str, ...]
    """Names of the free parameters, in the order of `covariance`."""
    covariance: np.ndarray
    """Covariance of the free parameters (SI)."""
    noise: NoiseEstimate
    """Noise of this model's own residual."""
    tests: Mapping[str, float]
    """p-values of the residual tests on the train block, corrected together."""

    @property
    def A_minus_B(self) -> Estimate | None:
        """A less all B (a - b), a second state's too, with its error; None where there is no A.

        Effects that depend on velocity alone (viscous, a Stribeck curve) come on top of it.
        """
        return rate_dependence(self) if amplitudes(self) else None


@dataclass(frozen=True)
class CandidateScore:
    """One model that was fitted. A positive `delta_bic` is better than the base."""

    effects: tuple[str, ...]
    delta_bic: float
    train_rms: float
    heldout_rms: float
    """rms on the select block; the report block is scored only for the final model."""
    parameters: Mapping[str, float]
    physical: bool
    converged: bool
    accepted: bool
    refused: Refusal | None = None
    """Why it was not taken; None where another was better, or it was taken."""


@dataclass(frozen=True)
class ScreenedEffect:
    """An effect that was screened, to first order, against the base: its best shape."""

    id: str
    delta_bic: float


@dataclass(frozen=True, eq=False)
class LocationProfile:
    """Missing friction as a function of one variable: amplitudes of bumps that act in the law.

    The bumps pass through the dynamics before they are compared with the residual, so this is
    where friction differs, not where the record does.
    """

    variable: str
    """"slip", "log_velocity", "state", "time", "time_since_step", "relaxation_length" (over which
    friction forgets a step) or "wavelength" (each alone)."""
    unit: str
    centres: np.ndarray
    amplitudes: np.ndarray
    errors: np.ndarray
    """Standard errors of the part that the base does not take up, in the unit of friction."""
    explained: float
    """Share of the structure of the base's residual that bumps in this variable alone take away;
    nan where there is no more of it than chance."""
    p_value: float
    further: float = float("nan")
    """Share that bumps in this variable take away beyond the variables before it, the one that
    takes most away first: these add up, and what they leave is not explained. nan as above."""


@dataclass(frozen=True, eq=False)
class RunBase:
    """The base model of a run as reports see it: its phases are those of the run."""

    fit: Fit
    steps: VelocitySteps

    @property
    def law(self) -> str:
        """The name of the law."""
        return self.fit.law

    def values(self) -> dict[str, float]:
        """Parameter values by name (SI), from the base fit of all windows."""
        return self.fit.values()


@dataclass(frozen=True, eq=False)
class RunDetails:
    """The stretches of a run: from when to when, under which stress, at which level."""

    joined: Joined
    after: Score
    claims: tuple[Finding, ...] = ()
    """None beside the effects."""

    def tables(self) -> list:
        """A row for every stretch, as a table of a report."""
        return said("loop_text.stretches", self)

    def to_json(self) -> dict:
        """The stretches, as an entry of `loop.json`."""
        return said("loop_json.run", self)


LoopRecord = Record | PreparedRecord
"""What a loop shows of a record."""
LoopBase = Fit | RunBase | AxisBase
"""What a loop shows of a base model."""
LoopDetails = AxisDetails | RunDetails
"""Results of one kind of rig only."""


@dataclass(frozen=True, eq=False, repr=False)
class Loop(Described, Drawable, Gridded, Tabular):
    """The loop closed over one record."""

    record: LoopRecord
    base_fit: LoopBase
    """Fit of the base to the whole record; of an axis, what its base model is."""
    kind: Literal["slider", "axis"]
    blocks: Blocks
    verdict: str
    """One of `VERDICTS`."""
    sentence: str
    """The verdict in words."""
    reasons: tuple[str, ...]
    """Reasons against more, a line each."""
    effects: tuple[str, ...]
    """Ids of the effects added, in the order added."""
    alias_groups: tuple[tuple[str, ...], ...]
    """For every effect added: its id, and those of effects that the record cannot tell from it."""
    separations: Mapping[str, str]
    """Sentences on what would tell an effect from its aliases, by id."""
    candidates: tuple[CandidateScore, ...]
    screened: tuple[ScreenedEffect, ...]
    """Effects screened in the first round, best first."""
    before: Score
    after: Score
    sigma: float
    """Standard deviation of the noise of the train rows with everything smooth taken out [unit of
    friction]."""
    location: tuple[LocationProfile, ...]
    """Structure of the base's residual over each variable, most telling variable first."""
    alias_ids: tuple[str, ...]
    alias_cosines: np.ndarray
    """|cosine| between the sensitivities of two effects, those of the fitted model projected
    out."""
    warnings: tuple[str, ...]
    seconds: float
    findings: tuple[Finding, ...]
    """What is claimed and what speaks against more, each with the rows that it rests on."""
    velocity: np.ndarray
    """Velocity of the load point or of the axis at every row [m/s or rad/s]."""
    details: LoopDetails | None = None
    """Results of this kind of rig only."""
    families: tuple[CurveFamily, ...] = ()
    """Families of curves where the record does not tell the shape of the curve that is missing: the
    effect that is named is one of its family."""
    sigma_held_out: float = float("nan")
    """Noise as `sigma`, but of the held-out rows; nan where it is not known apart."""
    most_held_out: float = float("nan")
    """The error of the report block, in its noise, up to which it counts as noise; nan if not
    known."""

    @property
    def words(self):
        """Words for reports and figures of this kind of rig, a `report.rig_words.LoopWords`."""
        return said("rig_words.of", self)

    @property
    def length_unit(self) -> str:
        """The SI unit of lengths: "m", or "rad" of a rotary axis."""
        rotary = self.record.units.get("load_point_displacement") == "rad"
        return "rad" if rotary else "m"

    def shifts(self) -> dict[str, float]:
        """Shift of every parameter of the base, in standard deviations of the fit after."""
        moved = {}
        for name, before in self.before.parameters.items():
            after = self.after.parameters[name]
            if after.std > 0:
                moved[name] = (after.value - before.value) / after.std
        return moved

    def test_error(self, score: Score) -> float:
        """rms of the report block, in its noise: the rows that neither a fit nor a choice of a
        model saw."""
        return score.rms["report"] / self.sigma_of(self.blocks.report)

    def row_sigma(self) -> np.ndarray:
        """The noise of every row: `sigma_held_out` of rows that are held out, else `sigma`."""
        held = self.blocks.select | self.blocks.report
        known = np.isfinite(self.sigma_held_out)
        return np.where(held & known, self.sigma_held_out, self.sigma)

    def sigma_of(self, rows: np.ndarray) -> float:
        """rms of the noise of some rows (a mask), the unit in which their error is told."""
        return float(np.sqrt(np.mean(self.row_sigma()[rows] ** 2))) if rows.any() else self.sigma

    def ranked(self) -> list[CandidateScore]:
        """The models that were fitted, each once, best Delta BIC first; failed ones last."""

        def rank(candidate: CandidateScore) -> tuple[bool, float]:
            known = bool(np.isfinite(candidate.delta_bic))
            return not known, -candidate.delta_bic if known else 0.0

        once: dict[frozenset[str], CandidateScore] = {}
        for candidate in sorted(self.candidates, key=rank):
            once.setdefault(frozenset(candidate.effects), candidate)
        return list(once.values())

    def gain(self) -> float | None:
        """Delta BIC of the model that was taken; None where it is none of the candidates."""
        model = frozenset(self.after.effects)
        own = (c.delta_bic for c in self.ranked() if frozenset(c.effects) == model)
        return next(own, None)

    def unfixed(self) -> list[Unfixed]:
        """Models that explain more than the one taken, but whose parameters the record leaves
        open, the likeliest first."""
        known = (c for c in self.ranked() if c.converged and c.physical)
        models = ((c, c.delta_bic) for c in known)
        return unfixed(models, self.gain() or 0.0)

    def role(self, candidate: CandidateScore) -> str:
        """The role of a fitted model in the search: "model", "base", "passed" (on the way to the
        model), "tried", "impossible" or "failed"."""
        effects = frozenset(candidate.effects)
        if effects == frozenset(self.after.effects):
            return "model"
        if effects == frozenset(self.before.effects):
            return "base"
        if any(c.accepted and frozenset(c.effects) == effects for c in self.candidates):
            return "passed"
        if not candidate.converged:
            return "failed"
        return "tried" if candidate.physical else "impossible"

    def to_json(self) -> dict:
        """The content of `loop.json`, schema "jaxfric.loop/1"; SI, null for what is not known."""
        return said("loop_json.content", self)
