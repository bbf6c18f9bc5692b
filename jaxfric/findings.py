"""Findings: statements of results as data, with a code, values and the supporting rows.

A claim holds only for the speeds and directions of the rows that support it. A record supports no
claim for speeds at which the record has no rows.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import chain, repeat
from typing import Any, NamedTuple

import numpy as np

from .described import said
from .plain import plain


class Severity(StrEnum):
    """Kind of a finding."""

    CLAIM = "claim"
    """The rows support it."""
    OPEN = "open"
    """The rows are consistent with it, but also with something else."""
    CAUTION = "caution"
    """Evidence against a stronger claim."""
    WITHHELD = "withheld"
    """The reason why no claim is made."""


class Clause(StrEnum):
    """Clauses of warnings, which are values of these warnings; `report.words` has their words."""

    EFFECT = "effect_lacks"
    """The model lacks an effect."""
    DRIFTS = "friction_drifts"
    STIFFNESS = "stiffness_differs"
    SPRING_FORCE = "spring_force"
    """The recorded friction is the force of the spring."""
    DRIFT = "drift"
    WRONG_STEP = "wrong_step"
    AS_EVOLUTION = "drift_as_evolution"
    """A fit may mistake a drift for evolution of the state."""


class WarningCode(StrEnum):
    """Codes of warnings. The text of a warning may change, its code stays."""

    MISFIT = "misfit"
    """A fit leaves far more than the scatter of neighbouring rows; values: times, of each fit, and
    causes (`Clause`)."""
    MISSED = "part_of_the_record_missed"
    """A fit of a run's step misses a part of its record by more than noise; values: off [friction],
    sigmas, away [s], side ("before" or "after" the velocity step), causes (`Clause`)."""
    DRIFT = "drift_before_the_step"
    """Friction drifts before a velocity step as the model does not; values: slope, error [per m],
    unit, shift (of A-B), advice (the option that fits a slip trend)."""
    DRIFT_LEFT = "drift_beside_the_trend"
    """The same beside a fitted slip trend; values: slope, error, trend [per m], unit."""
    TREND = "trend_with_slip"
    """The model lacks a trend with slip; values: with_trend (A-B with it, and its error), told and
    without (A-B with and without it as text)."""
    LONG = "slip_length_beyond_the_slip"
    """L of a fit without a slip trend is longer than all slip: its law is a drift with slip;
    values: L, slip [m], advice (the option that fits a slip trend)."""
    VANISHED = "direct_effect_vanishes"
    """A of a fit without a slip trend changes friction by less than the noise; values: A, change,
    noise, advice."""
    WANDERS = "residual_wanders"
    """The residual wanders over the whole record; values: causes (`Clause`)."""
    CONTRADICTED = "steps_contradict_the_motion"
    """The velocity that is stated for a step is not that of the recorded load point; values: time,
    stated, moved."""
    UNSTEADY = "not_steady_at_the_start"
    """Values: time [s] after the first row from which sliding is steady."""
    STRESS = "normal_stress_changes"
    """Values: least, most [Pa], when (times of the changes, in words)."""
    FLATTENED = "means_flatten_the_peaks"
    """Means over rows flatten the peaks; values: rows, times the noise."""
    GLITCHES = "outliers_excluded"
    """Rows stand out of the noise; values: rows, beyond [sigma]."""
    COARSE = "coarse_recorder_steps"
    """Friction is recorded in steps larger than its noise; values: step, noise."""
    FAILED = "did_not_converge"
    """Values: result."""
    UNDETERMINED = "parameters_undetermined"
    """Values: parameters."""
    MOVED_STEP = "step_time_moved"
    """A velocity step fits best elsewhere than the load point shows; values: step, sigmas."""
    EDGE = "edge_of_stability"
    """The stiffness is near the critical one; values: ratio."""
    UNSTABLE = "below_the_critical_stiffness"
    """Values: ratio."""
    SHORT_DELAY = "no_controller_is_as_fast"
    """Gains survive a delay that is shorter than any controller's; values: delay, least."""
    LOWEST_STIFFNESS = "stiffness_at_its_lower_limit"
    RAISED = "gains_raised"
    """Gains were raised for a basin; values: factor, basin."""
    MISSED_MARGIN = "margin_missed"
    """Gains that were raised miss a margin; values: by, as a share of it."""
    UNRESOLVED = "simulations_unresolved"
    """More than half of the simulated starts end unresolved; values: unresolved, checked."""
    UNRESOLVED_STEPS = "steps_unresolved"
    """Unresolved simulations of steps between set points; values: unresolved, steps."""
    UNEVEN = "rows_at_uneven_times"
    """Values: least, most and middle time between rows, share that differs."""
    ATTENUATED = "errors_of_the_motion_lower_the_inertia"
    """Values: share of the inertia, in_errors (from noise alone), advice (the option of a
    lower cutoff)."""
    UNEXPLAINED = "motion_does_not_answer_to_the_force"
    """Values: share of the rows that count."""
    SECOND_SEARCH = "searched_with_other_blocks"
    """A second search with other blocks held out; values: taken."""
    UNSAID = "unsaid_convergence"
    """A file does not say whether its fit converged."""
    NO_CLAIM = "no_claim"
    """Values: what (result), of (what follows is of), reasons."""
    AXIS_CLAIM = "no_claim_of_the_axis"
    """Values: sentence."""
    LAST_MODEL = "last_model_used"
    """Values: verdict, sentence."""
    BASE_MODEL = "base_model_used"
    """Values: verdict, sentence."""
    CHAINS = "chains_disagree"
    """Values: name, R-hat, most."""
    FEW_DRAWS = "few_draws"
    """Values: name, size (effective sample size), least."""
    DIVERGED = "diverged"
    """Values: number."""
    NO_MAXIMUM = "no_maximum"
    """The maximum of a posterior was not found."""
    NO_PRIOR = "no_prior"
    """Neither record nor prior determines parameters; values: parameters, first."""
    PRIOR_ENDS = "prior_ends_inside"
    """Uniform priors end inside the posterior; values: parameters."""
    LOOSE_MODEL = "model_undetermined"
    """The record of a model does not determine parameters; values: parameters."""
    OTHER_VELOCITIES = "other_velocities"
    """Values: velocities, slowest and fastest [m/s]."""
    SLOW_NOISE = "noise_at_its_limit"
    """The noise is correlated over as long as the search allows; values: memory, in words."""
    FASTER = "faster"
    """Values: share of the rows, fastest speed, unit."""
    FEW_ROWS = "few_rows"
    """Values: compared, rows, recorded (rows in the file)."""
    ONE_WAY = "one_direction"
    """A fit determines only the sum of Coulomb friction and offset."""
    DELAY_LAW = "delay_law_not_simulated"
    INTEGRAL = "integral_not_simulated"
    """Gains with integral action are simulated at rest at most."""
    ANY_STIFFNESS = "any_stiffness_not_simulated"
    SLOPES = "slopes_of_a_table"
    NO_DIRECT = "no_direct_effect_assumed"
    NO_MEMORY = "law_without_memory"
    STIFFENS = "effect_stiffens"
    """An effect that a law leaves out acts as a spring; values: effect, stiffness, unit."""
    SOFTENS = "effect_softens"
    """Values: effect, stiffness, unit, more (needed k_p)."""
    OF_RECORD = "effect_of_the_record"
    """An effect that a law leaves out; values: effect, room."""
    VANISHES = "effect_vanishes_in_steady_motion"
    DIRECTION = "law_of_one_direction"
    """Values: effect, direction."""
    UNSEEN = "law_beyond_its_record"
    """Values: slowest, fastest (of the record), least, most (asked) [m/s], times beyond."""
    OLD_FILE = "errors_of_an_older_version"
    MIDDLE = "middle_of_the_travel"
    """Friction changes along the travel, and its middle is compensated."""
    GUESS = "curve_is_a_guess"
    """Values: parameters, slowest, length."""
    FALLS = "friction_falls_with_speed"
    """Values: fastest, above (where the formula's friction would drive the axis), length."""
    LEAST_WIDTH = "v_c_at_its_least"
    """Values: width, length."""
    LOOSE_TERMS = "terms_undetermined"
    """Values: parameters."""
    GAPS = "gaps_of_the_clock"
    """Values: number, longest, time [s]."""
    TO_AND_FRO = "load_point_turns_back"
    """Values: turns."""
    DIPS = "friction_falls_and_returns"
    """Values: lowest, unit, rows (of the longest), times [s] of the first, number."""
    PRESS = "one_stiffness_at_several_stresses"
    """Values: stiffness, low, high [Pa], needed."""
    RAMPS = "stiffness_is_not_that_of_the_ramps"
    TEETH = "stiffness_is_not_that_of_stick_slip"
    """Values: share by which it differs, found (in words)."""
    MASS = "mass_in_the_margins_only"
    """Values: advice."""
    NO_MASS = "plan_without_mass"
    """Values: mass, unit."""
    LOGARITHM = "motions_near_rest_without_mass"
    """Values: least (f0/A)."""
    NO_LOCKS = "file_system_without_locks"
    """Values: store, error."""
    VERSIONS = "begun_with_other_versions"
    """Values: versions."""
    TOO_SOFT = "stiffness_contradicts_the_rows"
    """Values: stated and least stiffness, rise (of friction) and path as text, time [s]."""
    TOO_STIFF = "rises_as_on_a_softer_spring"
    """Values as of `TOO_SOFT`, and advice (the option that fits the stiffness)."""
    SHORT_STEP = "steps_too_short"
    """Values: slip, needed [m]."""


class Warned(str):
    """A warning or a reason as text, with its code and the values in the text."""

    code: StrEnum | None
    values: Mapping[str, object]
    """SI, or warnings."""

    def __new__(
        cls, text: str, code: StrEnum | None = None, values: Mapping[str, object] | None = None
    ) -> "Warned":
        """The text with a code; None if no code looks for this warning."""
        made = super().__new__(cls, text)
        made.code, made.values = code, values if isinstance(values, Mapping) else {}
        return made


def warned(code: StrEnum, **values: object) -> Warned:
    """A warning, reason or note in the words of its code (`report.words`), with values that these
    words need."""
    return Warned(said("words.coded", code, values), code, values)


def _coded(text: str) -> dict[str, Any]:
    """The code of a text (None without one) and its values."""
    return {"code": getattr(text, "code", None), "values": getattr(text, "values", {})}


def listed(texts: Iterable[str], name: str = "warnings", codes: str = "warned") -> dict[str, list]:
    """Entries of a file for warnings: the texts `name`, and `codes`, the code and the values of
    each text. The code is None for a text without a code."""
    texts = list(texts)
    return {name: texts, codes: [plain(_coded(text)) for text in texts]}


def reasoned(why: str, name: str = "why") -> dict[str, object]:
    """Entries of a file for a reason: the text `name`, and `reason`, its code and values. `reason`
    is None without a reason, and for a text of the user."""
    return {name: why, "reason": plain(_coded(why)) if isinstance(why, Warned) else None}


def read_warnings(table: Mapping) -> tuple[Warned, ...]:
    """The `warnings` of a table of a file, with the codes and values that `listed` writes. Files of
    older versions have no codes; codes of another form are ignored."""
    known, about = {str(code): code for code in WarningCode}, table.get("warned")
    sound = isinstance(about, list) and all(isinstance(one, dict) for one in about)
    told = chain(about if sound else (), repeat({}))
    return tuple(
        Warned(" ".join(line.split()), known.get(str(one.get("code"))), one.get("values"))
        for line, one in zip(table.get("warnings", []), told, strict=False)
    )


def marked(origin: str, warnings: Iterable[str]) -> tuple[Warned, ...]:
    """Warnings of another result, which begin with their `origin`."""
    return tuple(Warned(f"{origin}: {one}", **_coded(one)) for one in warnings)


def is_of(warning: str, code: WarningCode) -> bool:
    """Whether a warning has the given code."""
    return isinstance(warning, Warned) and warning.code is code


@dataclass(frozen=True, eq=False)
class Finding:
    """One statement of a result. Values are in SI."""

    code: StrEnum
    severity: Severity
    values: Mapping[str, object]
    rows: np.ndarray
    """Mask of the fitted rows, or of the runs of a steady curve, that support it (n)."""

    def to_json(self, velocity: np.ndarray, time: np.ndarray | None = None) -> dict[str, object]:
        """Return the finding as JSON: code, severity, values, and what supports the finding, with
        directions and speeds.

        The fitted rows may be means of rows of the file, or rows at other times. So the support is
        given as `time_ranges`. Without `time` it is given as `ranges` of runs. `velocity` and
        `time` (n) belong to the fitted rows or runs.
        """
        support_of = {"runs": ranges(self.rows)}
        if time is not None:
            support_of = {"times": time_ranges(self.rows, time)}
        return {
            "code": self.code.value,
            "severity": self.severity.value,
            "values": self.values,
            **support_of,
            "support": support(self.rows, velocity),
        }


class Support(NamedTuple):
    """Rows of one direction: their number and their range of speeds [m/s or rad/s]."""

    direction: str
    """"forwards", "backwards" or "at rest"."""
    rows: int
    slowest: float
    fastest: float


_PART = 20
"""Each round of `deciding_rows` removes the `_PART`-th part of the remaining rows."""
_DIRECTIONS = (("forwards", 1), ("backwards", -1), ("at rest", 0))


def support(rows: np.ndarray, velocity: np.ndarray) -> tuple[Support, ...]:
    """Range of speeds in a mask of rows, by direction; `velocity` of every row, signed (n)."""
    found = []
    for direction, sign in _DIRECTIONS:
        speed = np.abs(velocity[rows & (np.sign(velocity) == sign)])
        if len(speed):
            found.append(Support(direction, len(speed), float(speed.min()), float(speed.max())))
    return tuple(found)


def deciding_rows(
    difference: np.ndarray, jacobian: np.ndarray, used: np.ndarray, least: float
) -> np.ndarray:
    """Mask of the few rows without which two models cannot be distinguished.

    difference : d, predictions of one model minus those of the other [sigma] (n). jacobian : J, of
    the model without the claim, by its parameters [sigma] (n, p). used : mask of used rows (n).
    least : the reduction of the misfit that a claim needs.

    The model without the claim is refitted to fewer rows, which absorbs part of the difference d.
    The difference that remains between the two models is min_b sum (d - J b)^2. The rows with the
    largest squared difference are removed, one twentieth of the remaining rows at a time, until the
    sum is at most `least`.
    """
    kept = used & np.isfinite(difference)
    while kept.any():
        shift, *_ = np.linalg.lstsq(jacobian[kept], difference[kept], rcond=None)
        square = (difference - jacobian @ shift) ** 2
        if square[kept].sum() <= least:
            break
        rows = np.flatnonzero(kept)
        most = max(1, len(rows) // _PART)
        kept[rows[np.argsort(square[rows])[-most:]]] = False
    return used & ~kept


def ranges(rows: np.ndarray) -> list[list[int]]:
    """The ranges [first, last + 1] of consecutive rows in a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    return edges.reshape(-1, 2).tolist()


def time_ranges(rows: np.ndarray, time: np.ndarray) -> list[list[float]]:
    """The times [s] from start to end of consecutive rows in a mask (n); `time` (n) of the rows.

    A range reaches halfway to the neighbouring rows.
    """
    edges = np.concatenate([time[:1], 0.5 * (time[1:] + time[:-1]), time[-1:]])
    return edges[np.asarray(ranges(rows), int).reshape(-1, 2)].tolist()
