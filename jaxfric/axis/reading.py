"""From an axis record to the rows that a loop works on: low-pass, sign, disturbance, threshold.

The cutoff of the position's low-pass is the highest at which the encoder's error, differentiated
twice and times the mass, is less than half of what the base law leaves of the force: below that it
would cost motion, above it the prediction's own noise would hide friction. Where the rows that move
faster than the noise of the velocity do not make up a record that can be split, lower cutoffs and
then a lower threshold are tried.
"""

from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..loop.split import Blocks
from ..records.axis_record import AxisRecord
from .controller_check import disagreement, stretches
from .prepare import Preparation, Prepared, acceleration_noise, prepare, usual
from .result import AxisRows
from .rough import holds_already, refuse_reversed, rough_fit, unexplained_rows
from .rows import rows_of
from .split import split

_OF_RESIDUAL = 0.5
_HALVINGS = 8
"""Cutoffs are tried down by factors of sqrt 2, to a sixteenth."""
_SLOWEST = 10.0
"""Periods of the cutoff that a record lasts at least."""
_THRESHOLDS = (1.0, 0.5, 0.25)
_JITTER, _FEW = 0.2, 0.01


class Reading(NamedTuple):
    """A record as the loop takes it."""

    prepared: Prepared
    """Its force is all that acts: that of the motor and a disturbance."""
    rows: AxisRows
    blocks: Blocks
    notes: tuple[str, ...]
    """What was chosen, and why."""
    warnings: tuple[str, ...]


def read_rows(
    record: AxisRecord, *, preparation: Preparation | None, width: float | None, held: bool
) -> Reading:
    """The rows of a record, and what was chosen on the way.

    Raises
    ------
    InputError : as of `prepare` and `split`; friction that would be negative.
    """
    force, told = _acting(record, preparation, held)
    chosen, why = (preparation, "") if preparation else _cutoff(record, force, held)
    prepared, rows, blocks, more = _split(record, force, chosen, width, held, preparation is None)
    rough = rough_fit(prepared, rows.used, rows.width)
    work = float(np.mean((prepared.force[: prepared.rows] * rows.velocity)[rows.used]))
    mass = "kg m^2" if record.coordinate == "rotary" else "kg"
    refuse_reversed(rough, work, record.provenance.path, record.force_unit, mass)
    wrong = disagreement(record, held=force is record.motor_force)
    wrong = wrong or _unexplained(record, prepared, rows)
    notes = tuple(note for note in (*told, why, *more) if note)
    warnings = tuple(text for text in (_uneven(record), wrong) if text)
    return Reading(prepared, rows, blocks, notes, warnings)


def _uneven(record: AxisRecord) -> str | None:
    """A warning of rows at uneven times: between them the motion is a straight line."""
    steps = np.diff(record.time)
    middle, least, most = (1e3 * float(x) for x in (np.median(steps), steps.min(), steps.max()))
    share = float(np.mean(np.abs(steps - np.median(steps)) > _JITTER * np.median(steps)))
    if share < _FEW:
        return None
    return (
        f"the rows are {least:.3g} to {most:.3g} ms apart ({middle:.3g} as a rule;"
        f" {100 * share:.2g} % differ from that by more than a fifth): they are"
        " interpolated, which blurs the acceleration. Record at even times"
    )


def _unexplained(record: AxisRecord, prepared: Prepared, rows: AxisRows) -> str | None:
    """A warning of rows whose force the motion does not take."""
    far = np.flatnonzero(unexplained_rows(prepared, rows.used, rows.width))
    if not len(far):
        return None
    share = 100 * len(far) / int(rows.used.sum())
    return (
        f"in {share:.2g} % of the rows that count ({stretches(far, rows.time)}) the motion does not"
        " answer to the recorded force: by more than half of it. Something else acts there; give"
        " what was added as a column (--column disturbance=NAME), or cut those rows out"
    )


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
    """All force on the axis, and whether the motor force had the disturbance in it."""
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
            " and unit, or leave it out: --column disturbance=none"
        )
    if inside:
        return record.motor_force, ["the recorded force holds the disturbance already"]
    return record.motor_force + added, ["the disturbance acts beside the recorded force"]


def _candidates(record: AxisRecord) -> list[Preparation]:
    interval = float(np.median(np.diff(record.time)))
    first, least = usual(interval), _SLOWEST / float(record.relative_time[-1])
    cutoffs = [first.cutoff / 2 ** (0.5 * k) for k in range(_HALVINGS + 1)]
    return [first._replace(cutoff=c) for c in cutoffs if c >= least or c == first.cutoff]


def _cutoff(record: AxisRecord, force: np.ndarray, held: bool) -> tuple[Preparation, str]:
    """The preparation whose predicted force is less noisy than what the base law leaves."""
    options, found = _candidates(record), []
    for one in options:
        prepared = _prepare(record, force, one, held)
        rows = rows_of(prepared, None)
        if rows.used.sum() > 20:
            rough = rough_fit(prepared, rows.used, rows.width)
            found.append((one, rough, acceleration_noise(prepared)))
    if not found:
        return options[0], ""
    mass = max(abs(float(rough.values[0])) for _, rough, _ in found)
    quiet = [one for one in found if mass * one[2] < _OF_RESIDUAL * one[1].rms]
    one, _, _ = quiet[0] if quiet else min(found, key=lambda f: f[1].rms)
    if one.cutoff == options[0].cutoff:
        return one, ""
    noise, left = mass * found[0][2], found[0][1].rms
    return one, (
        f"low-pass of the position at {one.cutoff:.3g} Hz: at {found[0][0].cutoff:.3g} Hz the"
        f" encoder's error, differentiated twice, would be {noise:.2g} {record.force_unit} in the"
        f" predicted force, where the base law leaves {left:.2g} {record.force_unit} (--cutoff"
        " sets another)"
    )


def _split(
    record: AxisRecord,
    force: np.ndarray,
    chosen: Preparation,
    width: float | None,
    held: bool,
    free: bool,
) -> tuple[Prepared, AxisRows, Blocks, list[str]]:
    """Rows and blocks; lower cutoffs (where they are `free`) and thresholds where need be."""
    path, unit = record.provenance.path, "rad" if record.coordinate == "rotary" else "m"
    lower = [c for c in _candidates(record) if c.cutoff < chosen.cutoff] if free else []
    tries = [(chosen, 1.0), *((one, 1.0) for one in lower)]
    tries += [(one, share) for share in _THRESHOLDS[1:] for one in (chosen, *lower)]
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
        told = f"low-pass of the position at {one.cutoff:.3g} Hz and a threshold of"
        return (
            prepared,
            rows,
            blocks,
            [
                f"{told} {2 * rows.width:.2g} {unit}/s: with {chosen.cutoff:.3g} Hz too few rows"
                " were faster than the noise of the velocity"
            ],
        )
    assert refused is not None
    better = _cutoff(record, force, held)[0].cutoff
    if free or not better < chosen.cutoff:
        raise refused
    raise InputError(f"{refused}. Try --cutoff '{better:.2g} Hz'")
