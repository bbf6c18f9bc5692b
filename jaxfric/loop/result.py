"""The result of the loop: verdict, fits before and after, and all tried models."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ..described import Described, Drawable, Gridded, Tabular, said
from ..findings import Finding
from ..fitting import Estimate, Fit, NoiseEstimate
from ..fitting.derived import Interval, amplitudes, rate_dependence
from ..fitting.noise.thresholds import TOLD
from ..records import Record, VelocitySteps
from ..runs.joined import Joined
from ..stability.claims import one_sign
from .axis.result import AxisDetails
from .family import CurveFamily
from .learn import error_factor
from .refit import Candidate
from .refusal import Fault, Refusal
from .split import Blocks
from .thresholds import ACCEPT

VERDICTS = ("no_missing_effect", "effects", "ambiguous", "outside_catalogue", "too_weak")


@dataclass(frozen=True, eq=False)
class Score:
    """One model of the record: the base (before) or the base with effects (after)."""

    effects: tuple[str, ...]
    rms: Mapping[str, float]
    """rms by block ("train", "select": validation, "report": test), in the unit of friction."""
    per_step: tuple[float, ...]
    """rms in every velocity of the record, in the unit of friction."""
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
    """p-values of the residual tests on the train block, with Holm's correction."""
    along: Interval | None = None
    """The 95 % interval of A - B along other slip lengths, as `along_length` computes it."""

    @property
    def A_minus_B(self) -> Estimate | None:
        """A minus the sum of all B, with the error of A - B; None if the law has no A.

        A - B leaves out effects that depend on velocity alone (viscous, a Stribeck curve).
        """
        if not amplitudes(self):
            return None
        return rate_dependence(self, along=self.along)

    @property
    def sign_is_known(self) -> bool:
        """Whether the 95 % interval of A - B leaves out 0; True if the law has no A."""
        rate = self.A_minus_B
        return rate is None or one_sign((rate.lower, rate.upper))


@dataclass(frozen=True)
class CandidateScore:
    """One fitted model. A model with `delta_bic` below 0 is better than the base."""

    effects: tuple[str, ...]
    delta_bic: float
    train_rms: float
    validation_rms: float
    """rms on the validation block; the test block is scored only for the final model."""
    parameters: Mapping[str, float]
    physical: bool
    converged: bool
    accepted: bool
    rejection: Refusal | None = None
    """Why it was refused; None if it was accepted, or if another model was better."""


_OPEN = (Fault.NOT_FIXED, Fault.TAKES)


class Unfixed(NamedTuple):
    """A model likelier than the accepted model, but refused as its parameters are undetermined.

    The missing effect may be in the catalogue even if the record does not determine which effect is
    missing.
    """

    effects: tuple[str, ...]
    lower: float
    """BIC of the accepted model minus that of the refused one."""
    rejection: Refusal
    """Parameters are undetermined, or taken over from the base; other parameters may be
    determined."""


def unfixed(
    models: Iterable[tuple[Candidate | CandidateScore, float]], taken: float
) -> list[Unfixed]:
    """The likeliest models that were refused as undetermined, or for taking over parameters of the
    base. The BIC of each refused model is below that of the accepted model by more than `ACCEPT`.

    `models` are the tried models with their reductions of BIC; `taken` is the reduction by the
    accepted model. The result has at most three models that are about as good, best first. A model
    that contains another model of the result is omitted, since its additional effects are
    undetermined.
    """
    found: dict[frozenset[str], Unfixed] = {}
    for model, gain in sorted(models, key=lambda pair: pair[1]):
        why = model.rejection
        if why is not None and why.code in _OPEN and gain - taken > ACCEPT:
            found[frozenset(model.effects)] = Unfixed(tuple(model.effects), gain - taken, why)
    least = [one for key, one in found.items() if not any(other < key for other in found)]
    order = sorted(least, key=lambda one: -one.lower)
    return [one for one in order if order[0].lower - one.lower < ACCEPT][:TOLD]


@dataclass(frozen=True)
class ScreenedEffect:
    """An effect at its best shape, compared with the base to first order."""

    id: str
    delta_bic: float
    """BIC with the effect less that of the base: below 0 is better."""


@dataclass(frozen=True, eq=False)
class LocationProfile:
    """Missing friction as a function of one variable: amplitudes of bumps in the friction law.

    The bumps pass through the dynamics before the comparison with the residual. So the profile
    shows where friction differs from the model, not where the record differs from the model.
    """

    variable: str
    """"slip", "log_velocity", "state", "time", "time_since_step", "slip_since_step" (over the
    length of its decay) or "periodic_in_slip" (over its wavelength); each alone."""
    unit: str
    centres: np.ndarray
    amplitudes: np.ndarray
    errors: np.ndarray
    """Standard errors of the part that the base does not absorb, in the unit of friction."""
    explained: float
    """Share of the structure in the residual that bumps in this variable alone explain; nan if
    there is no significant structure."""
    p_value: float
    further: float = float("nan")
    """Share that bumps in this variable explain beyond better variables. These shares add up; no
    variable explains the rest. nan as above."""


@dataclass(frozen=True, eq=False)
class BaseModel:
    """The base model of a run or an axis, for reports."""

    law: str
    """The name of the friction law: "coulomb_viscous" of an axis."""
    steps: VelocitySteps
    """The phases of a run, or the motion segments of an axis."""
    constants: Mapping[str, float]
    """Parameters of the base fit of a run (SI); the width of the smoothed sign of an axis."""

    def values(self) -> dict[str, float]:
        """The `constants`, by name."""
        return dict(self.constants)


@dataclass(frozen=True, eq=False)
class RunDetails:
    """The stretches of a run: times and normal stress of each."""

    joined: Joined
    claims: tuple[Finding, ...] = ()
    """Empty: a run has no claims besides the effects."""

    def to_json(self) -> dict:
        """The stretches of a run, as an entry of `loop.json`."""
        return {"stretches": self.joined.stretches}


LoopBase = Fit | BaseModel
"""The base model in the result of a loop."""
LoopDetails = AxisDetails | RunDetails
"""Results for one kind of rig only."""


def shift_of(before: Estimate, after: Estimate) -> float | None:
    """The shift of a parameter between two models, in standard errors of the second one; None if a
    model does not determine the parameter, or if the parameter has no error."""
    if not (before.determined and after.determined and after.std > 0):
        return None
    return (after.value - before.value) / after.std


@dataclass(frozen=True, eq=False, repr=False)
class Loop(Described, Drawable, Gridded, Tabular):
    """The result of the loop over one record."""

    record: Record
    """The record; for an axis, its decimated rows."""
    base_fit: LoopBase
    """Fit of the base to the whole record; for an axis, its base model."""
    kind: Literal["slider", "axis"]
    blocks: Blocks
    verdict: str
    """One of `VERDICTS`."""
    sentence: str
    """The verdict as text."""
    reasons: tuple[str, ...]
    """Reasons against a stronger verdict, a line each."""
    effects: tuple[str, ...]
    """Ids of the effects added, in the order added."""
    alias_groups: tuple[tuple[str, ...], ...]
    """For every effect added: its id, and those of effects that the record does not distinguish."""
    separations: Mapping[str, tuple[str, ...]]
    """Experiments that would distinguish an effect from its aliases, by id: each a `RunChange` or a
    text."""
    candidates: tuple[CandidateScore, ...]
    screened: tuple[ScreenedEffect, ...]
    """Effects screened in the first round, best first."""
    before: Score
    after: Score
    sigma: float
    """Standard deviation of the noise of the train rows, without smooth columns [unit of
    friction]."""
    location: tuple[LocationProfile, ...]
    """Structure of the base's residual over each variable; the one that explains most first."""
    alias_ids: tuple[str, ...]
    alias_cosines: np.ndarray
    """|cosine| between the sensitivities of two effects, orthogonal to those of the fitted
    model."""
    warnings: tuple[str, ...]
    seconds: float
    findings: tuple[Finding, ...]
    """Claims and cautions, each with the rows that support it."""
    velocity: np.ndarray
    """Velocity of the load point or of the axis at every row [m/s or rad/s]."""
    details: LoopDetails | None = None
    """Results for this kind of rig only."""
    families: tuple[CurveFamily, ...] = ()
    """Families of steady curves if the record does not determine the shape of the missing curve:
    the named effect is one member."""
    sigma_held_out: float = float("nan")
    """As `sigma`, for the held-out rows; nan if it was not estimated separately."""
    held_out_threshold: float = float("nan")
    """Largest test error, in units of its noise, that noise alone explains; nan if unknown."""
    normal_stress: float | None = None
    """Normal stress at which K of a coefficient holds [Pa]; None if unknown, or for a run, whose
    stretches have one each."""

    @property
    def words(self):
        """Terms for reports and figures of this kind of rig, as a `report.rig_words.LoopWords`."""
        return said("rig_words.of", self)

    @property
    def length_unit(self) -> str:
        """The SI unit of lengths: "m", or "rad" of a rotary axis."""
        rotary = self.record.units.get("load_point_displacement") == "rad"
        return "rad" if rotary else "m"

    def shifts(self) -> dict[str, float]:
        """Shift of every base parameter by the added effects (`shift_of`), where there is one."""
        every = self.before.parameters.items()
        moved = {name: shift_of(before, self.after.parameters[name]) for name, before in every}
        return {name: shift for name, shift in moved.items() if shift is not None}

    @property
    def supported(self) -> Score:
        """The model to use, in general `after`. The model to use is `before` if the verdict is
        "outside_catalogue" and the added effects predict the test block worse than the base model.
        """
        worse = self.test_error(self.after) > self.test_error(self.before)
        return self.before if self.verdict == "outside_catalogue" and worse else self.after

    def test_error(self, score: Score) -> float:
        """rms error of the test block in units of its noise. Neither a fit nor the choice of a
        model used the rows of the test block.
        """
        return score.rms["report"] / self.sigma_of(self.blocks.report)

    def misfit(self, score: Score) -> float:
        """Factor on the errors of a model by its test error (`learn.error_factor`)."""
        return error_factor(self.test_error(score), self.held_out_threshold)

    def row_sigma(self) -> np.ndarray:
        """The noise of every row: `sigma_held_out` for held-out rows, else `sigma`."""
        held = self.blocks.select | self.blocks.report
        known = np.isfinite(self.sigma_held_out)
        return np.where(held & known, self.sigma_held_out, self.sigma)

    def sigma_of(self, rows: np.ndarray) -> float:
        """rms of the noise in some rows (a mask), as the unit of the error in these rows."""
        return float(np.sqrt(np.mean(self.row_sigma()[rows] ** 2))) if rows.any() else self.sigma

    def ranked(self) -> list[CandidateScore]:
        """The fitted models, each once, best Delta BIC first; failed ones last."""

        def rank(candidate: CandidateScore) -> tuple[bool, float]:
            known = bool(np.isfinite(candidate.delta_bic))
            return not known, candidate.delta_bic if known else 0.0

        once: dict[frozenset[str], CandidateScore] = {}
        for candidate in sorted(self.candidates, key=rank):
            once.setdefault(frozenset(candidate.effects), candidate)
        return list(once.values())

    def gain(self) -> float | None:
        """Fall of BIC from base to accepted model; None if the accepted model is no candidate."""
        model = frozenset(self.after.effects)
        own = (0.0 - c.delta_bic for c in self.ranked() if frozenset(c.effects) == model)
        return next(own, None)

    def unfixed(self) -> list[Unfixed]:
        """Models that are likelier than the accepted model, but whose parameters the record does
        not determine; likeliest first.
        """
        known = (c for c in self.ranked() if c.converged and c.physical)
        models = ((c, 0.0 - c.delta_bic) for c in known)
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
        """The content of `loop.json`, schema `schemas.LOOP`; SI, null for unknown values."""
        return said("loop_json.content", self)
