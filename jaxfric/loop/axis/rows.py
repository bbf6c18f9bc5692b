"""The used rows of a prepared record, and the scales of its motion.

`rough_fit` is a least-squares fit of the base law before any search,

    F = M a + F_v v + F_c tanh(v/w) + F_0 (+ further columns)

over the used rows. The rough fit shows whether the force has the sign of the motion, and whether
the recorded force already includes a disturbance.

`split` divides motion segments into train, validation and test blocks. A motion segment is a piece
of motion in one direction between two stops or reversals. Neighbouring samples share noise and
structure, so whole segments are held out, never single samples.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ...effects import RecordScales
from ...errors import InputError, option
from ...fitting.axis_preparation import Prepared
from ...fitting.axis_problem import NEGLIGIBLE
from ...fitting.noise.thresholds import CLEAR, SAME_VELOCITY
from ..split import Blocks
from ..thresholds import (
    FEWEST_ROWS,
    FEWEST_STROKES,
    MOSTLY,
    NEAR,
    NEAR_ENOUGH,
    OUTLYING,
    SHARE,
    STUCK,
    TRIMS,
    UNEXPLAINED,
    WIDTH_IN_NOISE,
    WIDTH_SHARE,
)
from .result import AxisRows


def rows_of(
    prepared: Prepared, width: float | None, *, unit: str = "m", share: float = 1.0
) -> AxisRows:
    """The decimated rows of a record, the mask of used rows, and the motion segments.

    `unit` is the unit of the position, for messages. A default width of the smoothed sign is
    multiplied by the factor `share`.
    """
    n, motion = prepared.rows, prepared.motion
    velocity, position, path = (
        np.asarray(prepared.means(x))[:n] for x in (motion.velocity, motion.position, motion.path)
    )
    fastest = float(np.max(np.abs(velocity)))
    if width is None:
        width = max(share * WIDTH_IN_NOISE * prepared.velocity_noise, WIDTH_SHARE * fastest)
    elif not 0 < width < fastest:
        raise InputError(
            f"width {width:g} {unit}/s: the axis moves at up to {fastest:g} {unit}/s; choose less"
        )
    every = prepared.means.every
    samples = np.asarray(motion.velocity).reshape(-1, every)[:n]
    slow = np.min(np.abs(samples), axis=1) < 2 * width
    slow |= np.ptp(np.sign(samples), axis=1) > 0
    # a quick turn may fall between two rows
    slow[1:] |= np.sign(samples[1:, 0]) != np.sign(samples[:-1, -1])
    step = float(prepared.time[1] - prepared.time[0])
    return AxisRows(
        time=prepared.time[:n],
        position=position,
        velocity=velocity,
        path=path,
        used=prepared.inside[:n] & ~_widened(slow),
        stuck=_long(slow, max(2, round(STUCK / step))),
        segment=segments(slow),
        width=width,
    )


def _widened(slow: np.ndarray) -> np.ndarray:
    """The slow rows and their neighbours, which the filter of the position affects."""
    wide = slow.copy()
    wide[1:] |= slow[:-1]
    wide[:-1] |= slow[1:]
    return wide


def _long(slow: np.ndarray, rows: int) -> np.ndarray:
    """Mask of the slow rows in runs of at least `rows`."""
    long = np.zeros(len(slow), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], slow.astype(int), [0]])))
    for begin, end in edges.reshape(-1, 2):
        long[begin:end] = end - begin >= rows
    return long


def scales_of(rows: AxisRows, prepared: Prepared, blocks: Blocks) -> RecordScales:
    """Lengths, velocities and times of the train rows, to start the shapes of effects."""
    speed = np.abs(rows.velocity[blocks.train])
    moving = speed[speed > 2 * rows.width]
    interval = float(prepared.time[1] - prepared.time[0])
    # twice the distance between two rows at the median speed, within the filter's pass band
    resolved = 2.5 * float(np.median(moving)) * interval
    return RecordScales(
        slip_length=float("nan"),
        step_slip=resolved,
        total_slip=float(np.ptp(rows.position)),
        slowest=float(np.quantile(moving, 0.02)),
        fastest=float(moving.max()),
        interval=interval,
        duration=float(rows.time[-1]),
    )


class Rough(NamedTuple):
    """A fit of the base law to an axis record by least squares."""

    values: np.ndarray
    """M, F_v, F_c, F_0 (SI), then the coefficients of further columns."""
    std: np.ndarray
    """Standard deviations of `values`, if the residuals are white."""
    residual: np.ndarray
    """Recorded minus predicted, at all rows (n)."""
    matrix: np.ndarray
    """Sensitivities of the predicted force to `values`, at all rows (n, k)."""
    rms: float
    """Root mean square of the residual over the rows of the fit [F]."""
    dissipation: float
    """F_c + F_v |v| at the median speed [F]: friction there."""
    its_error: float
    """Standard error of `dissipation` [F]."""


def rough_fit(
    prepared: Prepared, used: np.ndarray, width: float, *, more: Sequence[np.ndarray] = ()
) -> Rough:
    """Least-squares fit of the base law to the rows `used` (mask); `more` are further columns."""
    motion, at_rows = prepared.motion, prepared.forces
    n = prepared.rows
    v = np.asarray(at_rows(motion.velocity))[:n]
    columns = [
        np.asarray(at_rows(motion.acceleration))[:n],
        v,
        np.asarray(at_rows(jnp.tanh(motion.velocity / width)))[:n],
        np.ones(n),
        *(column[:n] for column in more),
    ]
    whole = np.stack(columns, axis=1)
    matrix, force = whole[used], prepared.force[:n][used]
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(matrix / size)
    values = inverse @ force
    left = force - (matrix / size) @ values
    rms = float(np.sqrt(left @ left / max(len(left) - len(values), 1)))
    covariance = rms**2 * (inverse @ inverse.T) / np.outer(size, size)
    at = np.zeros(len(values))
    at[1:3] = float(np.median(np.abs(v[used]))), 1.0
    values = values / size
    error = float(np.sqrt(at @ covariance @ at))
    residual = prepared.force[:n] - whole @ values
    std = np.sqrt(np.diag(covariance))
    return Rough(values, std, residual, whole, rms, float(at @ values), error)


def refuse_reversed(rough: Rough, work: float, path: str, force_unit: str, mass_unit: str) -> None:
    """Raise `InputError` if friction would be negative: force and motion have opposite signs.

    Friction dissipates, so `work`, the mean of F v over the rows [F m/s], is positive for motion
    back and forth. Negative work and significantly negative friction mean that force or motion has
    a wrong sign. If the fitted mass is negative too, the recorded force has the wrong sign.
    """
    if work >= 0 or rough.dissipation > -CLEAR * rough.its_error:
        return
    mass, mass_error = rough.values[0], rough.std[0]
    friction = f"a friction of {rough.dissipation:.3g} {force_unit}"
    if mass < -CLEAR * mass_error:
        raise InputError(
            f"{path}: by least squares the axis has a mass of {mass:.3g} {mass_unit} and"
            f" {friction}: is the sign of the force reversed? Turn it with"
            f" {option('flip-sign', 'force')} (or that of position and velocity with"
            f" {option('flip-sign', 'motion')})"
        )
    raise InputError(
        f"{path}: by least squares the axis has {friction}, so that friction would drive it: is the"
        f" sign of the force reversed ({option('flip-sign', 'force')}), or was only its size"
        " recorded? Are force and position of the same axis and the same time?"
    )


def unexplained_rows(prepared: Prepared, used: np.ndarray, width: float) -> np.ndarray:
    """Mask of rows at which the force is far from the base law of all other rows.

    The mask holds rows whose force deviates from the base law by more than half the standard
    deviation of the force, and by more than ten times the scatter of the residual. Missing effects
    of friction cause smaller deviations from the base law.
    """
    keep, found = used.copy(), np.zeros(len(used), bool)
    for _ in range(TRIMS):
        left = rough_fit(prepared, keep, width).residual
        scatter = 1.4826 * float(np.median(np.abs(left[keep])))
        far = np.abs(left) > max(
            OUTLYING * scatter, UNEXPLAINED * float(np.std(prepared.force[: len(used)][used]))
        )
        if np.mean(far[used]) > MOSTLY:
            return np.zeros(len(used), bool)
        found, keep = far & used, used & (np.abs(left) < NEAR * scatter)
    return found


def holds_already(coefficient: float, error: float) -> bool | None:
    """Whether the recorded force F includes a disturbance d, by the coefficient c in F = ... + c d.

    Motor force and disturbance act on the axis together. The coefficient c of the disturbance d is
    therefore -1 if F is the motor force alone, and 0 if F includes d. The result is None if c is
    near neither -1 nor 0, because the motion then does not respond to d.
    """
    alone, within = abs(coefficient + 1), abs(coefficient)
    if 2 * CLEAR * error > 1 or not min(alone, within) <= NEAR_ENOUGH:
        return None
    return within < alone


def segments(slow: np.ndarray) -> np.ndarray:
    """Index of the motion segment of each row; `slow` marks rows that stop or turn.

    Rows at which the axis stops or turns belong to the preceding motion segment.
    """
    begins = ~slow & np.concatenate([[False], slow[:-1]])
    begins[: int(np.argmax(~slow)) + 1] = False  # the first motion is segment 0
    return np.cumsum(begins)


def split(segment: np.ndarray, used: np.ndarray, velocity: np.ndarray, path: str) -> Blocks:
    """Blocks of whole motion segments. The last sixth of the rows is the test block, the sixth
    before the test block is the validation block. All other rows are the train block.

    The fastest segment of each direction always belongs to the train block. The slowest segment
    with enough rows belongs to the train block too, if validation and test block remain long
    enough. `used` marks the used rows, `path` names the record in messages.

    Raises
    ------
    InputError : no reversal, or too few segments or rows.
    """
    moving = velocity[used]
    if one_way(moving) and one_way(velocity):
        raise InputError(
            f"{path}: the axis moves in one direction only; Coulomb friction cannot be told from an"
            " offset without a reversal. Record motion back and forth"
        )
    if one_way(moving):
        raise InputError(
            f"{path}: the axis moves back and forth, but in one direction never faster than twice"
            " the noise of its velocity, where friction has no sign. Low-pass the position at a"
            f" lower frequency ({option('cutoff')}), record a faster motion, or with a finer"
            " encoder"
        )
    rows = np.bincount(segment[used], minlength=int(segment.max()) + 1)
    count = int(np.sum(rows > 0))
    if count < FEWEST_STROKES:
        raise InputError(
            f"{path}: {count} motion segments between stops or reversals; {FEWEST_STROKES} are"
            " needed. Record more strokes"
        )
    # held-out segments are predicted within the range of trained velocities
    fastest, slowest = _extremes(segment[used], moving, rows)
    blocks = _blocks(segment, used, rows, fastest | slowest)
    if blocks.short():
        blocks = _blocks(segment, used, rows, fastest)
    if short := blocks.short():
        name, found = short
        raise InputError(
            f"{path}: the {name} block would have {found} rows and needs {FEWEST_ROWS}; record more"
            " or longer strokes"
        )
    return blocks


def one_way(velocity: np.ndarray) -> bool:
    """Whether nearly all of the motion is in one direction."""
    ways = float(velocity[velocity > 0].sum()), -float(velocity[velocity < 0].sum())
    return min(ways) <= NEGLIGIBLE * max(ways)


def _extremes(
    segment: np.ndarray, velocity: np.ndarray, rows: np.ndarray
) -> tuple[set[int], set[int]]:
    """For each direction, the segment that reaches the highest velocity, and the first segment near
    the lowest mean velocity among those with enough rows."""
    mean = np.bincount(segment, velocity, minlength=len(rows)) / np.maximum(rows, 1)
    fastest, slowest = set(), set()
    for sign in (1, -1):
        fastest.add(int(segment[np.argmax(sign * velocity)]))
        speed = np.where((rows >= FEWEST_ROWS) & (sign * mean > 0), sign * mean, np.inf)
        if np.isfinite(speed).any():
            slowest.add(int(np.argmax(speed <= speed.min() / SAME_VELOCITY)))
    return fastest, slowest


def _blocks(segment: np.ndarray, used: np.ndarray, rows: np.ndarray, train: set[int]) -> Blocks:
    """The blocks if the segments `train` always train."""
    rows = np.where(np.isin(np.arange(len(rows)), list(train)), 0, rows)
    after = np.cumsum(rows[::-1])[::-1] / int(used.sum())  # share of the rows from a segment on
    report = _from(after, SHARE)
    select = _from(after, after[report] + SHARE)
    held = used & ~np.isin(segment, list(train))
    return Blocks(
        used & ~(held & (segment >= select)),
        held & (segment >= select) & (segment < report),
        held & (segment >= report),
        segment,
        True,
    )


def _from(after: np.ndarray, share: float) -> int:
    """The last segment from which at least this share of the rows follows; 0 if there is none."""
    enough = np.flatnonzero(after >= share)
    return int(enough[-1]) if len(enough) else 0
