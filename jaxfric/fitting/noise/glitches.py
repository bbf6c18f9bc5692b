"""Glitches of a recorder: outliers of one to three neighbouring rows.

Every row is predicted from the rows before it and from the rows after it, with the estimated noise
(one Kalman pass each way). Take a run of one to three rows: the first row is predicted from the
rows before it, the last row from the rows after it. The run is a glitch if both prediction errors
exceed a limit with the same sign. The errors of the three rows on either side of the run must stay
below six tenths of the limit. A step of friction is no glitch, because the row before the step
deviates from the rows after it, with opposite sign. Longer events, and peaks that rise and fall
smoothly, are no glitches either.

Noise alone exceeds the limit for glitches once in a hundred records of the same length. The limit
for glitches is in units of the median prediction error of the same velocity step. The noise differs
between velocity steps, and a median, unlike a standard deviation, is robust. The limit for glitches
is from Student's t, because noise need not be normally distributed. The degrees of freedom of
Student's t follow from the median and the 93rd percentile of the prediction errors. Outliers in one
percent of the rows hardly change the median and the 93rd percentile. If the noise has heavy tails,
the limit is higher, and almost no row is excluded. Rows next to a velocity step never count as
glitches: friction is steep after a step, and a model may lack an effect.

Source: Chang, Tiao & Chen 1988 (doi:10.1080/00401706.1988.10488367) for single outliers and level
shifts by predictions. Glitches at more than a hundredth of the rows, or longer than three rows, are
not supported.
"""

from statistics import NormalDist
from typing import NamedTuple, Protocol

import numpy as np

from ...findings import Warned, WarningCode
from ...records import Provenance
from ..padding import Numbers
from . import thresholds as const
from .filter import taken_out, whitened
from .model import Noise

_UPPER = 0.5 * (1 + const.BODY)
_NORMAL = NormalDist().inv_cdf(_UPPER)
"""Median size of a normal error of unit variance."""


class Glitches(NamedTuple):
    """Outliers, excluded from the fit."""

    rows: tuple[int, ...] = ()
    """Indices of the glitches among the fitted rows, from 0. They differ from row numbers of the
    file if rows are means, or prepared rows of an axis."""
    beyond: float = 0.0
    """Limit of the prediction error [standard deviations of the noise of the velocity step]."""
    tails: int = 0
    """Rows beyond the limit that are too many to be glitches (heavy tails): none is excluded."""

    def to_json(self) -> dict:
        """The fields as JSON values, and the number of glitches; row indices count from 0."""
        return self._asdict() | {"rows": list(self.rows), "count": len(self.rows)}


NO_GLITCHES = Glitches()


def beside_steps(step: np.ndarray) -> np.ndarray:
    """Mask (n,) of rows near a change of `step`: three rows before the change, since its time may
    be wrong. After the change the mask covers a tenth of the shorter of the two velocity steps, but
    five to ten rows.
    """
    near = np.zeros(len(step), bool)
    edges = np.flatnonzero(np.diff(step)) + 1
    ends = np.concatenate([[0], edges, [len(step)]])
    for before, edge, after in zip(ends, edges, ends[2:], strict=False):
        reach = int(np.clip(const.BESIDE_PART * min(edge - before, after - edge), *const.BESIDE))
        near[max(edge - const.LONGEST_GLITCH, 0) : edge + reach] = True
    return near


def prediction_errors(
    clock: Numbers, weight: Numbers, columns: np.ndarray, noise: Noise
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of predicting every row from the rows before it, and from the rows after it, both in
    standard deviations (n,).

    Column 0 of `columns` (n, m) is the residual. The other columns are directions that a model may
    still fit; the function projects these directions out. Rows of `weight` 0 are skipped and return
    0.
    """
    found = []
    for turn in (slice(None), slice(None, None, -1)):
        scale = noise.scale[turn] if np.ndim(noise.scale) else noise.scale
        when, on = (np.asarray(x)[turn] for x in (clock, weight))
        white = whitened(when, on, columns[turn], noise._replace(scale=scale))
        left, free = taken_out(white)
        found.append((left / np.sqrt(np.maximum(free, const.RARE)))[turn])
    return found[0], found[1]


def in_sizes_of_steps(
    ahead: np.ndarray, back: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forward and backward prediction errors (n,), divided by their median in the same velocity
    step, and scaled to unit variance for normal noise. The median of a step with few rows is shrunk
    towards the median of all steps.
    """
    size, every = np.ones(len(step)), np.concatenate([ahead, back])
    whole = float(np.median(np.abs(every)))
    for own in (step == k for k in np.unique(step)):
        middle = float(np.median(np.abs(np.concatenate([ahead[own], back[own]]))))
        size[own] = np.sqrt(
            (own.sum() * middle**2 + const.SHARED * whole**2) / (own.sum() + const.SHARED)
        )
    size = np.maximum(size / _NORMAL, 1e-300)
    return ahead / size, back / size


def standing_out(
    ahead: np.ndarray, back: np.ndarray, spared: np.ndarray
) -> tuple[np.ndarray, float]:
    """Mask (n,) of the glitches from prediction errors both ways, and the limit of the errors.

    The limit is in standard deviations of a normal distribution with the same median error. Rows in
    the mask `spared` are never glitches.
    """
    n = len(ahead)
    from scipy.special import stdtrit

    size, freedom = _law(np.concatenate([ahead, back]))
    # noise alone exceeds the limit once in a hundred records of so many rows
    beyond = -float(stdtrit(freedom, 0.5 * const.RARE / (const.LONGEST_GLITCH * n)))
    limit = size * beyond if size > 0 else np.inf
    found = np.zeros(n, bool)
    for side in (1, -1):
        before, after = side * ahead, side * back
        here = np.zeros(n, bool)
        for rows in range(1, const.LONGEST_GLITCH + 1):
            stands = (before[: n - rows + 1] > limit) & (after[rows - 1 :] > limit)
            for begin in np.flatnonzero(stands):
                end = begin + rows
                around = [
                    *before[max(begin - const.LONGEST_GLITCH, 0) : begin],
                    *after[end : end + const.LONGEST_GLITCH],
                ]
                # a shorter glitch takes precedence
                new = not here[begin:end].any()
                if new and max(around, default=0.0) <= const.NEAR_GLITCH * limit:
                    here[begin:end] = True
        found |= here
    return found & ~spared, beyond * _NORMAL / float(stdtrit(freedom, _UPPER))


def _law(errors: np.ndarray) -> tuple[float, float]:
    """Scale and degrees of freedom of the Student's t that has the median and the 93rd percentile
    of the absolute errors."""
    from scipy.special import stdtrit  # scipy.stats takes half a second to import

    body, shoulder = np.quantile(np.abs(errors), [const.BODY, const.SHOULDER])
    freedom = np.geomspace(1.0, 1e3, 60)
    sizes = [stdtrit(freedom, 0.5 * (1 + level)) for level in (const.BODY, const.SHOULDER)]
    # the ratio of the two quantiles falls with the degrees of freedom
    ratio = -shoulder / max(float(body), 1e-300)
    own = float(np.exp(np.interp(ratio, -sizes[1] / sizes[0], np.log(freedom))))
    return float(body) / float(stdtrit(own, _UPPER)), own


def find_glitches(
    clock: Numbers,
    weight: Numbers,
    columns: np.ndarray,
    noise: Noise,
    step: np.ndarray,
    *,
    before: Glitches = NO_GLITCHES,
    least: float = 1.0,
) -> Glitches:
    """The glitches among n rows, including the glitches known `before`, whose weight is 0.

    `columns` as in `prediction_errors`; `step` (n,) is the velocity step of every row. Deviations
    below `least` (in the unit of the residual) do not count, so rounding errors are no glitches. If
    more than a hundredth of the rows would be glitches, no new glitch is added.
    """
    rows, known = np.flatnonzero(np.asarray(weight) > 0), list(before.rows)
    if len(rows) < const.ROWS_FOR_GLITCHES:
        return before
    ahead, back = (x[rows] for x in prediction_errors(clock, weight, columns, noise))
    if not (np.isfinite(ahead).all() and np.isfinite(back).all()):
        return before
    # an axis uses moving rows only, so a reversal is a change of step too
    sizes = in_sizes_of_steps(ahead, back, step[rows])
    found, beyond = standing_out(*sizes, beside_steps(step[rows]))
    found &= np.maximum(np.abs(ahead), np.abs(back)) * float(noise.sigma) > least
    count = int(found.sum())
    if not count:
        return before
    if count + len(known) > const.RARE * (len(rows) + len(known)):
        return before if known else Glitches((), beyond, count)
    return Glitches(tuple(sorted([*known, *rows[found].tolist()])), beyond)


class ToldRecord(Protocol):
    """The part of a record that `glitch_words` uses: times of rows, and provenance."""

    @property
    def relative_time(self) -> np.ndarray: ...
    @property
    def provenance(self) -> Provenance: ...


def glitch_words(glitches: Glitches, record: ToldRecord) -> tuple[str, ...]:
    """Warning about glitches: number of glitches, the limit, and position of the first glitches."""
    origin, time = record.provenance, record.relative_time
    far = f"{glitches.beyond:.2g} standard deviations"
    if glitches.tails:
        text = (
            f"{origin.path}: {glitches.tails} rows stand out of the noise by more than {far}: so"
            " many are what the noise is like (heavy tails), and none is passed over"
        )
        values = {"rows": 0, "tails": glitches.tails, "beyond": glitches.beyond}
        return (Warned(text, WarningCode.GLITCHES, values),)
    if not glitches.rows:
        return ()
    first, number = list(glitches.rows[: const.TOLD]), len(glitches.rows)
    if origin.lines is not None and len(origin.lines) == len(time):
        where = f"row{'s' if number > 1 else ''} {', '.join(str(origin.lines[k]) for k in first)}"
    else:
        where = f"at {', '.join(f'{time[k]:.5g} s' for k in first)}"
    where += f" and {number - len(first)} more" if number > len(first) else ""
    rows, are = ("rows stand", "are") if number > 1 else ("row stands", "is")
    text = f"{number} {rows} out of the noise by more than {far} and {are} passed over: {where}"
    values = {"rows": number, "tails": 0, "beyond": glitches.beyond}
    return (Warned(f"{origin.path}: {text}", WarningCode.GLITCHES, values),)
