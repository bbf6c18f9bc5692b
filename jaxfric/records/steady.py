"""Runs at steady speeds become one curve of friction against velocity."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from .axis_record import AxisRecord
from .read_axis import read_axis
from .record import MIN_ROWS, Provenance

MIN_RUNS = 4
"""A curve needs this many runs."""

_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".asc", ".mat")
_BATCH = 5
"""Rows that are averaged before a start-up is looked for."""
_BLOCKS = 10
"""Parts of a run whose mean speeds are compared."""
_CHANGE = 0.1
"""The mean speed of a part differs from that of the run by less than this fraction."""
_BACKWARD = 0.25
"""A run that goes backward in more than this fraction of its rows has no direction."""
_UNEVEN = 0.25
"""A spread of the speed above this fraction of its mean is told."""


@dataclass(frozen=True, eq=False)
class SteadyCurve:
    """One row for each run at a steady speed, sorted by speed; arrays are read-only, in SI.

    - `speed`: mean, signed [m/s or rad/s]; `speed_std`: spread of its samples.
    - `force`: mean; `std`: spread of its samples, in `force_unit` ("N", "N m" or "%").
    - `samples`: rows used; `effective`: independent samples that they are worth
      (`effective_samples` of the force); `error` = std / sqrt(effective), of `force`.
    - `names`: the runs, by their path below the folder.
    - `coordinate` and `units` as for `AxisRecord`; `provenance.notes`: what was left out, and why.
    """

    speed: np.ndarray
    force: np.ndarray
    std: np.ndarray
    samples: np.ndarray
    effective: np.ndarray
    error: np.ndarray
    speed_std: np.ndarray
    names: tuple[str, ...]
    coordinate: str = "linear"
    force_unit: str = "N"
    units: Mapping[str, str] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=Provenance)

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.names)


@dataclass(frozen=True)
class _Run:
    """Means over the steady part of a run; or why there is none."""

    name: str
    speed: float = 0.0
    speed_std: float = 0.0
    force: float = 0.0
    std: float = 0.0
    samples: int = 0
    effective: float = 1.0
    refused: str = ""
    note: str = ""


def effective_samples(values: ArrayLike) -> float:
    """How many independent samples n correlated ones are worth, n / (2 tau), in 1..n.

    tau = 1/2 + sum of the autocorrelation over the lags 1..W is the integrated autocorrelation
    time, W the first lag with W >= 5 tau(W) (automatic windowing: A. Sokal, Monte Carlo Methods in
    Statistical Mechanics, 1996, sec. 3). The autocovariances lack the variance of the mean that
    was taken off, which is put back (U. Wolff, Comput. Phys. Commun. 156 (2004) 143, sec. 3.3).
    A fast ripple may close the window before slow changes are seen; so the means of 5 rows are
    judged as well, n = var(x) / var(mean), and the smaller count is taken.

    A constant is worth 1 sample. Not tried: runs shorter than about 50 tau, whose tau comes out
    too small.
    """
    x = np.asarray(values, np.float64)
    n = float(len(x))
    found = n / max(2 * _correlation_time(x), 1.0)
    if n >= 20 * _BATCH and x.var() > 0:
        means = x[: len(x) // _BATCH * _BATCH].reshape(-1, _BATCH).mean(axis=1)
        of_mean = means.var() * max(2 * _correlation_time(means), 1.0) / len(means)
        found = min(found, x.var() / of_mean) if of_mean > 0 else found
    return float(np.clip(found, 1.0, n))


def _correlation_time(x: np.ndarray) -> float:
    """Integrated autocorrelation time in samples; half their number for a constant."""
    n = len(x)
    if n < 3 or np.ptp(x) == 0:
        return n / 2
    x = x - x.mean()
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(x, size)) ** 2
    covariance = np.fft.irfft(spectrum, size)[:n] / np.arange(n, 0, -1)
    tau = 0.5 + np.concatenate([[0.0], np.cumsum(covariance[1:])]) / covariance[0]
    closed = np.arange(n) >= 5 * np.maximum(tau, 0.5)
    window = int(np.argmax(closed)) if closed.any() else n - 1
    of_mean = max(2 * tau[window] * covariance[0] / n, 0.0)
    restored = covariance[: window + 1] + of_mean
    return float(0.5 + restored[1:].sum() / restored[0])


def read_steady(
    folder: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    drive_gain: str | None = None,
    rated_torque: str | None = None,
    flip: bool = False,
    drop_bad: bool = False,
) -> SteadyCurve:
    """Read a folder of runs at steady speeds, at any depth, as one curve.

    A run is steady where the mean speeds of its ten parts differ from its mean by less than a
    tenth (and the noise of such means). Rows of a start-up or a stop, whose speed is not yet or
    no longer that of the middle of the run, are left out. Runs that are not steady, stand still,
    or whose direction is not determined are left out with a note. The speed is that of the
    velocity, else that of the position.

    **Arguments:** as for `read_axis`.

    Raises `InputError` for a folder that is none, files that cannot be read, runs in different
    units, and fewer than 4 steady runs.
    """
    folder = Path(folder)
    runs: list[_Run] = []
    records: dict[str, AxisRecord] = {}
    for path in _files(folder):
        name = path.relative_to(folder).as_posix()
        records[name] = read_axis(
            path,
            columns=columns,
            drive_gain=drive_gain,
            rated_torque=rated_torque,
            flip=flip,
            drop_bad=drop_bad,
        )
        runs.append(_steady_run(name, records[name]))
    used = sorted((run for run in runs if not run.refused), key=lambda run: (run.speed, run.name))
    _check_runs(folder, runs, used, records)
    first = records[used[0].name]
    return SteadyCurve(
        speed=_frozen([run.speed for run in used]),
        force=_frozen([run.force for run in used]),
        std=_frozen([run.std for run in used]),
        samples=_frozen([run.samples for run in used], np.int64),
        effective=_frozen([run.effective for run in used]),
        error=_frozen([run.std / np.sqrt(run.effective) for run in used]),
        speed_std=_frozen([run.speed_std for run in used]),
        names=tuple(run.name for run in used),
        coordinate=first.coordinate,
        force_unit=first.force_unit,
        units=first.units,
        provenance=_provenance(folder, runs, used, records),
    )


def _files(folder: Path) -> list[Path]:
    """Files of runs below a folder, in the order of their paths."""
    if folder.is_file():
        raise InputError(
            f"{folder} is one file; a steady curve needs a folder of at least {MIN_RUNS} runs,"
            " each at a steady speed of its own"
        )
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder")
    found = sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in _SUFFIXES
        and path.is_file()
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    )
    if len(found) < MIN_RUNS:
        raise InputError(
            f"{folder} holds {len(found)} files of runs ({', '.join(_SUFFIXES)}); a steady curve"
            f" needs at least {MIN_RUNS}, each at a steady speed of its own"
        )
    return found


def _steady_run(name: str, record: AxisRecord) -> _Run:
    """Means of a run, or why it is none."""
    speed, from_position = record.velocity, False
    if record.position is not None and (speed is None or not np.any(speed)):
        speed, from_position = np.gradient(record.position, record.time), True
    if speed is None or not np.any(speed):
        return _Run(name, refused="the axis stands still")
    start, stop = steady_rows(speed)
    if stop - start < MIN_ROWS:
        return _Run(name, refused=_range(speed, record) + ", no steady part of 20 rows")
    part = speed[start:stop]
    mean, spread = float(part.mean()), float(part.std(ddof=1))
    if not _is_steady(part):
        return _Run(name, refused=_range(speed, record))
    if abs(mean) <= 3 * spread / np.sqrt(effective_samples(part)):
        shown = _shown(mean, record)
        return _Run(name, refused=f"the direction of its mean speed, {shown}, is not determined")
    if np.mean(np.sign(part) == -np.sign(mean)) > _BACKWARD:
        return _Run(name, refused=_range(speed, record) + ", it turns back again and again")
    force = record.motor_force[start:stop]
    if from_position and record.position is not None:
        time = record.relative_time[start:stop]
        mean = float(np.polyfit(time, record.position[start:stop], 1)[0])
    notes = []
    if stop - start < len(speed):
        notes.append(
            f"{start} rows of start-up and {len(speed) - stop} of stop are left out of {len(speed)}"
        )
    if spread > _UNEVEN * abs(mean):
        notes.append(
            f"moves unevenly: its speed spreads by {100 * spread / abs(mean):.0f} % of its mean,"
            f" {_shown(mean, record)}"
        )
    return _Run(
        name,
        speed=mean,
        speed_std=spread,
        force=float(force.mean()),
        std=float(force.std(ddof=1)),
        samples=len(force),
        effective=effective_samples(force),
        note="; ".join(notes),
    )


def steady_rows(speed: np.ndarray) -> tuple[int, int]:
    """First row of the steady part of a run, and the row after its last.

    Means of 5 rows are compared with the median of those in the middle half: a start-up ends
    with the first three in a row that are within six times their scatter (at least 5 % of the
    median, at least one step of the recorder).
    """
    count = len(speed) // _BATCH
    means = speed[: count * _BATCH].reshape(count, _BATCH).mean(axis=1)
    middle = means[count // 4 : count - count // 4]
    level = float(np.median(middle))
    scatter = 1.4826 * float(np.median(np.abs(middle - level)))
    steps = np.diff(np.unique(speed))
    quantum = float(steps.min()) if len(steps) else 0.0
    inside = np.abs(means - level) <= max(6 * scatter, 0.05 * abs(level), quantum)
    head, tail = _leading(inside), _leading(inside[::-1])
    stop = len(speed) if tail == 0 else (count - tail) * _BATCH
    return head * _BATCH, max(stop, 0)


def _leading(inside: np.ndarray) -> int:
    """Number of batches before the first three in a row that are inside."""
    if inside[0]:
        return 0
    settled = inside[2:] & inside[1:-1] & inside[:-2]
    return int(np.argmax(settled)) if settled.any() else len(inside)


def _is_steady(speed: np.ndarray) -> bool:
    """Whether the parts of a run have one mean speed.

    The noise of a part's mean is judged by differences of neighbours, which a slow change of
    speed leaves alone.
    """
    parts = np.array_split(speed, _BLOCKS)
    means = np.array([part.mean() for part in parts])
    mean = float(speed.mean())
    noise = float(np.std(np.diff(speed))) / np.sqrt(2 * len(parts[-1]))
    return bool(np.abs(means - mean).max() <= max(_CHANGE * abs(mean), 4 * noise))


def _check_runs(
    folder: Path, runs: list[_Run], used: list[_Run], records: Mapping[str, AxisRecord]
) -> None:
    """Enough runs, all in the same units."""
    if len(used) < MIN_RUNS:
        left = [f"{run.name}: {run.refused}" for run in runs if run.refused]
        shown = "; ".join(left[:3]) + ("; ..." if len(left) > 3 else "")
        raise InputError(
            f"{folder} holds {len(used)} runs at a steady speed; a steady curve needs at least"
            f" {MIN_RUNS}, at different speeds" + (f" ({shown})" if left else "")
        )
    first = records[used[0].name]
    for run in used[1:]:
        record = records[run.name]
        if (record.coordinate, record.force_unit) != (first.coordinate, first.force_unit):
            raise InputError(
                f"{folder}: {used[0].name} is {first.coordinate} with a force in"
                f" {first.force_unit}, {run.name} is {record.coordinate} with {record.force_unit};"
                " all runs of a curve must be of one axis"
            )


def _provenance(
    folder: Path, runs: list[_Run], used: list[_Run], records: Mapping[str, AxisRecord]
) -> Provenance:
    """Where the runs come from, and what was left out of them."""
    folders = sorted({Path(run.name).parent.as_posix() for run in used})
    notes = [f"{len(used)} steady runs of {len(runs)} files, from {', '.join(folders)}"]
    if len(folders) > 1:
        notes.append("runs of several folders are taken as one axis under one load")
    notes += [f"{run.name} is left out: {run.refused}" for run in runs if run.refused]
    notes += [f"{run.name}: {run.note}" for run in used if run.note]
    common = [note for note in records[used[0].name].provenance.notes if "recorded" not in note]
    dropped: dict[str, int] = {}
    for run in used:
        for reason, count in records[run.name].provenance.dropped.items():
            dropped[reason] = dropped.get(reason, 0) + count
    digests = "".join(records[name].provenance.sha256 for name in sorted(run.name for run in used))
    return Provenance(
        str(folder),
        hashlib.sha256(digests.encode()).hexdigest(),
        sum(records[run.name].provenance.rows_read for run in used),
        dropped,
        (*notes, *common),
    )


def _range(speed: np.ndarray, record: AxisRecord) -> str:
    low, high = _shown(float(speed.min()), record), _shown(float(speed.max()), record)
    return f"its speed is not steady, from {low} to {high}"


def _shown(speed: float, record: AxisRecord) -> str:
    if record.coordinate == "rotary":
        return f"{speed * 30 / np.pi:.4g} rpm"
    return f"{speed * 1e3:.4g} mm/s"


def _frozen(values: ArrayLike, kind: type = np.float64) -> np.ndarray:
    array = np.array(values, kind)
    array.setflags(write=False)
    return array
