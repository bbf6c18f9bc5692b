"""Prepares the rows of an axis record: low-pass filter, sign of force, disturbance, slowest speed.

The cutoff of the low-pass filter of the position also sets the number of rows. Encoder noise,
differentiated twice and multiplied by the mass, is noise of the predicted force. The chosen cutoff
is the highest at which the noise variance of the predicted force is less than half the noise
variance of the recorded force, and the bias of the mass less than half its error (`attenuation`).
A higher cutoff would hide friction in encoder noise, a lower cutoff would lose motion and rows. The
noise of the recorded force is the scatter of the base law's residual from row to row, minimised
over cutoffs. High cutoffs add encoder noise to the scatter of the residual, low cutoffs add
structure. A record may have too few rows faster than the velocity
noise to form train, validation and test blocks. If rows are too few, lower cutoffs are tried, then
a lower speed threshold, then shorter rows.
"""

from typing import NamedTuple

import numpy as np

from ...errors import InputError, option
from ...findings import WarningCode, warned
from ...fitting.axis_preparation import Preparation, Prepared, acceleration_noise, prepare, usual
from ...fitting.noise.thresholds import CLEAR
from ...records.axis_record import AxisRecord
from ...records.axis_units import inertia_unit
from ..split import NAMES, Blocks
from ..thresholds import (
    BIAS,
    FEW,
    FEWEST_ROWS,
    JITTER,
    LOWER_CUTOFFS,
    NEARLY_ALL,
    OF_NOISE,
    OF_RESIDUAL,
    PERIODS,
    WIDTHS,
)
from .attenuation import attenuation_of_rough
from .controller_check import disagreement, stretches
from .result import AxisRows
from .rows import holds_already, refuse_reversed, rough_fit, rows_of, split, unexplained_rows


class Reading(NamedTuple):
    """An axis record, read and prepared for the loop."""

    prepared: Prepared
    """The prepared record; its force is the total of motor and disturbance."""
    rows: AxisRows
    blocks: Blocks
    notes: tuple[str, ...]
    """Choices of the preparation and their reasons, as text."""
    warnings: tuple[str, ...]


def read_rows(
    record: AxisRecord, *, preparation: Preparation | None, width: float | None, held: bool
) -> Reading:
    """The rows of an axis record for the loop, with notes on how the rows were prepared.

    Raises
    ------
    InputError : as in `prepare` and `split`; an axis that does not move; negative friction.
    """
    force, told = _acting(record, preparation, held)
    chosen, why = (preparation, "") if preparation else _cutoff(record, force, held)
    prepared, rows, blocks, more = _split(record, force, chosen, width, held, preparation is None)
    _refuse_still(record, prepared, rows)
    rough = rough_fit(prepared, rows.used, rows.width)
    work = float(np.mean((prepared.force[: prepared.rows] * rows.velocity)[rows.used]))
    unit = record.force_unit
    mass = inertia_unit(unit, record.length_unit)
    refuse_reversed(rough, work, record.provenance.path, unit, mass)
    notes = tuple(note for note in (*told, why, *more) if note)
    wrong = disagreement(record, held=force is record.motor_force)
    wrong = wrong or _unexplained(record, prepared, rows)
    warnings = tuple(text for text in (_uneven(record), wrong) if text)
    return Reading(prepared, rows, blocks, notes, warnings)


def _refuse_still(record: AxisRecord, prepared: Prepared, rows: AxisRows) -> None:
    """Raise `InputError` if the recorded motion does not exceed its own error."""
    speed = float(np.quantile(np.abs(rows.velocity), NEARLY_ALL))
    noise = CLEAR * prepared.velocity_noise
    if speed >= noise:
        return
    unit = f"{record.length_unit}/s"
    force = float(np.max(np.abs(record.motor_force)))
    raise InputError(
        f"{record.provenance.path}: the axis does not move: {100 * NEARLY_ALL:.0f} % of the rows"
        f" are slower than {speed:.2g} {unit}, and the error of the recorded motion alone gives"
        f" {noise:.2g} {unit}. A force of {force:.3g} {record.force_unit} did not move it: use a"
        " larger one, or a finer encoder"
    )


def _uneven(record: AxisRecord) -> str | None:
    """A warning about uneven sampling, since the motion is interpolated linearly."""
    steps = np.diff(record.time)
    middle, least, most = (float(x) for x in (np.median(steps), steps.min(), steps.max()))
    share = float(np.mean(np.abs(steps - middle) > JITTER * middle))
    if share < FEW:
        return None
    return warned(WarningCode.UNEVEN, least=least, most=most, middle=middle, share=share)


def _unexplained(record: AxisRecord, prepared: Prepared, rows: AxisRows) -> str | None:
    """A warning about rows whose force the motion does not explain."""
    far = np.flatnonzero(unexplained_rows(prepared, rows.used, rows.width))
    if not len(far):
        return None
    share = len(far) / int(rows.used.sum())
    return warned(WarningCode.UNEXPLAINED, share=share, times=stretches(far, rows.time))


def _prepare(record: AxisRecord, force: np.ndarray, chosen: Preparation | None, held: bool):
    return prepare(
        record.relative_time,
        record.position,
        record.velocity,
        force,
        preparation=chosen,
        held=held,
    )


def _acting(
    record: AxisRecord, preparation: Preparation | None, held: bool
) -> tuple[np.ndarray, list[str]]:
    """The total force on the axis (n); a note whether the motor force includes the disturbance."""
    added = record.disturbance_force
    if added is None or not np.any(added):
        return record.motor_force, []
    prepared = _prepare(record, record.motor_force, preparation, held)
    rows = rows_of(prepared, None)
    column = _prepare(record, added, preparation, held).force
    rough = rough_fit(prepared, rows.used, rows.width, more=[column])
    inside = holds_already(float(rough.values[4]), float(rough.std[4]))
    if inside is None:
        raise InputError(
            f"{record.provenance.path}: the motion does not answer to the disturbance: by least"
            f" squares {-rough.values[4]:.2g} ± {rough.std[4]:.1g} of it acts, where it should be"
            " all of it (1), or none where the recorded force holds it already (0). Check its sign"
            f" and unit, or leave it out: {option('column', 'disturbance=none')}"
        )
    if inside:
        return record.motor_force, ["the recorded force holds the disturbance already"]
    return record.motor_force + added, ["the disturbance acts beside the recorded force"]


def _candidates(record: AxisRecord) -> list[Preparation]:
    interval = float(np.median(np.diff(record.time)))
    first, least = usual(interval), PERIODS / float(record.relative_time[-1])
    cutoffs = [first.cutoff / 2 ** (0.5 * k) for k in range(LOWER_CUTOFFS + 1)]
    return [usual(interval, c) for c in cutoffs if c >= least or c == first.cutoff]


def lower_cutoff(record: AxisRecord, chosen: Preparation, held: bool) -> float:
    """The cutoff to try if the errors of the motion are too large at the `chosen` one [Hz]."""
    lower = [one for one in _candidates(record) if one.cutoff < chosen.cutoff]
    force = _acting(record, chosen, held)[0]
    return _cutoff(record, force, held, lower)[0].cutoff if lower else chosen.cutoff / 2


def _cutoff(
    record: AxisRecord, force: np.ndarray, held: bool, options: list[Preparation] | None = None
) -> tuple[Preparation, str]:
    """The first of the `options` (default: `_candidates`) at which the errors of the motion are
    small, or that with the smallest; the reason."""
    options, found = options or _candidates(record), []
    for one in options:
        prepared = _prepare(record, force, one, held)
        rows = rows_of(prepared, None)
        if rows.used.sum() >= FEWEST_ROWS * len(NAMES):
            rough = rough_fit(prepared, rows.used, rows.width)
            noise = _from_row_to_row(rough.residual, rows.used) * np.sqrt(one.decimation)
            bias = attenuation_of_rough(prepared, rows.used, rough).in_errors
            found.append((one, rough, acceleration_noise(prepared), noise, bias))
    if not found:
        return options[0], ""
    mass = max(abs(float(rough.values[0])) for _, rough, *_ in found)
    white = min(noise for *_, noise, _ in found)
    allowed = [
        max(OF_NOISE * white / np.sqrt(one.decimation), OF_RESIDUAL * rough.rms)
        for one, rough, *_ in found
    ]
    quiet = [
        f for f, most in zip(found, allowed, strict=True) if mass * f[2] < most and f[4] < BIAS
    ]
    one = (quiet[0] if quiet else min(found, key=lambda f: mass * f[2]))[0]
    if one.cutoff == options[0].cutoff:
        return one, ""
    first, _, noise, _, bias = found[0]
    left = white / np.sqrt(first.decimation)
    if mass * noise < allowed[0]:
        return one, (
            f"low-pass of the position at {one.cutoff:.3g} Hz: at {first.cutoff:.3g} Hz the"
            f" encoder's error, differentiated twice, would lower the inertia by {bias:.2g} of its"
            f" errors ({option('cutoff')} sets another)"
        )
    return one, (
        f"low-pass of the position at {one.cutoff:.3g} Hz: at {first.cutoff:.3g} Hz the"
        f" encoder's error, differentiated twice, would be {mass * noise:.2g} {record.force_unit}"
        f" in the predicted force, beside a noise of {left:.2g} {record.force_unit} in the"
        f" recorded one ({option('cutoff')} sets another)"
    )


def _from_row_to_row(residual: np.ndarray, used: np.ndarray) -> float:
    """White noise from second differences of neighbouring rows (insensitive to slow changes)."""
    second = residual[2:] - 2 * residual[1:-1] + residual[:-2]
    beside = used[2:] & used[1:-1] & used[:-2]
    return (
        1.4826 * float(np.median(np.abs(second[beside]))) / np.sqrt(6) if beside.any() else np.inf
    )


def _split(
    record: AxisRecord,
    force: np.ndarray,
    chosen: Preparation,
    width: float | None,
    held: bool,
    free: bool,
) -> tuple[Prepared, AxisRows, Blocks, list[str]]:
    """Rows and blocks. If a split is impossible, lower cutoffs and shorter rows (if `free`) and
    lower thresholds are tried."""
    path, unit = record.provenance.path, record.length_unit
    lower = [c for c in _candidates(record) if c.cutoff < chosen.cutoff] if free else []
    tries = [(one, share) for share in WIDTHS for one in (chosen, *lower)]
    interval = float(np.median(np.diff(record.time)))
    if free:  # at last short rows, which lack the removed motion
        short = usual(interval).decimation
        tries += [(one._replace(decimation=short), share) for one, share in tries]
    refused: InputError | None = None
    for one, share in tries if width is None else tries[:1]:
        prepared = _prepare(record, force, one, held)
        rows = rows_of(prepared, width, unit=unit, share=share)
        try:
            blocks = split(rows.segment, rows.used, rows.velocity, path)
        except InputError as error:
            refused = refused or error
            continue
        if refused is None:
            return prepared, rows, blocks, []
        told = f"low-pass of the position at {one.cutoff:.3g} Hz, rows of"
        told += f" {1e3 * one.decimation * interval:.3g} ms and a threshold of"
        told += f" {2 * rows.width:.2g} {unit}/s: with {chosen.cutoff:.3g} Hz and rows of"
        told += f" {1e3 * chosen.decimation * interval:.3g} ms too few were faster than the noise"
        return prepared, rows, blocks, [f"{told} of the velocity"]
    assert refused is not None
    if free:
        raise refused
    better = _cutoff(record, force, held)[0].cutoff
    if not better < chosen.cutoff:
        raise InputError(
            f"{refused}. At a cutoff of {chosen.cutoff:.3g} Hz a row is"
            f" {1e3 * chosen.decimation * interval:.3g} ms long: leave {option('cutoff')} out, or"
            " raise it"
        )
    raise InputError(f"{refused}. Try {option('cutoff', f'{better:.2g} Hz')}")
