"""Combine runs at steady speeds to one friction-velocity curve."""

import functools
import hashlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..lazy import old_arguments
from .axis_record import AxisRecord
from .formats import suffixes
from .read_axis import read_axis
from .record import Provenance
from .steady_load import Load, load_of, without_load
from .steady_run import Run, SteadyRows, steady_run
from .window import Bound

MIN_RUNS = 4
"""Least number of runs of a curve."""

_FEWEST_SAMPLES = 10.0
"""Least number of independent samples for a known error of a run's mean: the correlation time is
underestimated in runs shorter than about 20 times it (see `effective_samples`)."""
_CONSTANT = 1e-9
"""Spread of a force by rounding alone, over the largest force."""
_MOST_LISTED = 5
"""Largest number of unreadable files that are listed."""


class StickSlipRun(NamedTuple):
    """A run at one commanded speed with stick-slip. SI."""

    run: str
    speed: float
    """Mean speed over whole cycles, signed [m/s or rad/s]."""
    at_rest: float
    """Share of the time at rest."""
    moving_speed: float
    """Mean speed between the stops, signed [m/s or rad/s]."""
    stops: int
    """Number of stops after which the motion went on."""


@dataclass(frozen=True, eq=False)
class SteadyCurve:
    """One row for each run at a steady speed, sorted by speed; arrays are read-only, in SI.

    - `speed`: mean, signed [m/s or rad/s]; `speed_std`: standard deviation of its samples.
    - `force`: mean force along the travel, minus the `load`; `std`: standard deviation of its
      samples, in `force_unit` ("N", "N m" or "%").
    - `samples`: number of used rows; `outliers`: number of excluded outliers (None: not known);
      `effective`: number of independent samples (`effective_samples` of the force).
    - `error`: standard error of `force`, sqrt(std^2 / effective + the part of `shared`); `shared`
      [R, p]: the part from p independent errors of the load, which are common to all runs.
    - `names`: paths of the runs below the folder.
    - `uneven`: runs that moved unevenly, or whose speed is recorded too coarsely to decide.
    - `stuck`: slower runs that were excluded because they stood still, turned back or were not
      steady.
    - `stick_slip`: runs with stick-slip at one commanded speed, which count as uneven and are
      averaged over whole cycles.
    - `load`: force that depends on the position, subtracted from `force` and `rows`; None if none
      is found, or without positions.
    - `rows`: for every run, the rows that its means use (empty: not kept).
    - `coordinate` and `units` as for `AxisRecord`; `provenance.notes`: excluded runs and rows, with
      the reasons.
    """

    speed: np.ndarray
    force: np.ndarray
    std: np.ndarray
    samples: np.ndarray
    effective: np.ndarray
    error: np.ndarray
    speed_std: np.ndarray
    names: tuple[str, ...]
    uneven: tuple[str, ...] = ()
    stuck: tuple[str, ...] = ()
    outliers: np.ndarray | None = None
    coordinate: str = "linear"
    force_unit: str = "N"
    units: Mapping[str, str] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=Provenance)
    rows: tuple[SteadyRows, ...] = ()
    stick_slip: tuple[StickSlipRun, ...] = ()
    load: Load | None = None
    shared: np.ndarray | None = None

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.names)

    def covariance(self) -> np.ndarray:
        """Covariance matrix (R, R) of `force`."""
        return force_covariance(self.error, self.shared)

    @property
    def wanders(self) -> bool:
        """Whether the force drifts so slowly that the errors of mean forces are not known: half of
        the runs whose force is not constant have fewer than 10 independent samples.
        """
        noisy = self.std > _CONSTANT * np.max(np.abs(self.force))
        return bool(noisy.any() and np.median(self.effective[noisy]) < _FEWEST_SAMPLES)

    def slipping(self) -> np.ndarray:
        """Mask (R,) of the runs that stick and slip."""
        return np.isin(self.names, [one.run for one in self.stick_slip])


def force_covariance(error: np.ndarray, shared: np.ndarray | None) -> np.ndarray:
    """Return the covariance (R, R) from errors (R,) that include p `shared` errors (R, p)."""
    if shared is None:
        return np.diag(error**2)
    return np.diag(error**2 - np.sum(shared**2, axis=1)) + shared @ shared.T


@old_arguments(flip="flip_sign")
def read_steady(
    folder: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    drive_gain: str | None = None,
    rated_torque: str | None = None,
    flip_sign: bool | str = False,
    drop_bad: bool = False,
    window: tuple[Bound, Bound] = (None, None),
) -> SteadyCurve:
    """Read a folder of runs at steady speeds, at any depth, as one friction-velocity curve.

    If positions are recorded, the `Load` is subtracted from the forces, with a note. The `Load` is
    a force that depends on position and is equal in both directions: the weight of a joint, a
    spring. Outliers (`outliers`) are excluded from the means, with a note. Runs with stick-slip
    (`rests`) are averaged over whole cycles. A run is steady if the mean speeds of its ten parts
    differ from its overall mean by less than 10 % (or by noise alone). Rows of a start-up or a stop
    are recognised by speed, and excluded. Runs that are not steady, stand still, or have no
    determined direction are excluded with a note. The speed is the recorded velocity, else the
    derivative of the position.

    **Arguments:** as for `read_axis`. `window` is a time interval since each run's first row
    (seconds, or "0.6 s"; None: no bound). Only rows in the window are used. A window removes a
    start-up that shows in the force but not in the speed.

    Raises `InputError` for a path that is no folder, unreadable files, runs in different units, and
    folders with fewer than 4 steady runs.
    """
    folder = Path(folder)
    one = functools.partial(
        read_axis,
        columns=columns,
        drive_gain=drive_gain,
        rated_torque=rated_torque,
        flip_sign=flip_sign,
        drop_bad=drop_bad,
    )
    records = _read_all(folder, one if window == (None, None) else lambda p: one(p).window(*window))
    runs = [steady_run(name, record) for name, record in records.items()]
    used = sorted((run for run in runs if not run.refused), key=lambda run: (run.speed, run.name))
    _check_runs(folder, runs, used, records)
    first = records[used[0].name]
    load, shared = load_of(used, first.coordinate), None
    if load is not None:
        freed = [without_load(load, run, first.coordinate) for run in used]
        used = [run for run, _ in freed]
        shared = _frozen(np.stack([by for _, by in freed]) @ load.root())
    own = np.array([run.std / np.sqrt(run.effective) for run in used])
    common = np.zeros(len(used)) if shared is None else np.sum(shared**2, axis=1)
    slowest = min(abs(run.speed) for run in used)
    return SteadyCurve(
        speed=_frozen([run.speed for run in used]),
        force=_frozen([run.force for run in used]),
        std=_frozen([run.std for run in used]),
        samples=_frozen([run.samples for run in used], np.int64),
        effective=_frozen([run.effective for run in used]),
        error=_frozen(np.sqrt(own**2 + common)),
        speed_std=_frozen([run.speed_std for run in used]),
        names=tuple(run.name for run in used),
        uneven=tuple(run.name for run in used if run.uneven),
        stuck=tuple(run.name for run in runs if run.refused and run.speed < slowest),
        outliers=_frozen([run.outliers for run in used], np.int64),
        coordinate=first.coordinate,
        force_unit=first.force_unit,
        units=first.units,
        provenance=_provenance(folder, runs, used, records),
        rows=tuple(run.rows for run in used if run.rows is not None),
        stick_slip=tuple(
            StickSlipRun(run.name, run.speed, slips.at_rest, slips.fast, slips.stops)
            for run in used
            if (slips := run.rests) is not None
        ),
        load=load,
        shared=shared,
    )


def _read_all(folder: Path, one: Callable[[Path], AxisRecord]) -> dict[str, AxisRecord]:
    """Read all files of a folder; return the records by their path below it."""
    records: dict[str, AxisRecord] = {}
    bad: list[str] = []
    files = _files(folder)
    for path in files:
        name = path.relative_to(folder).as_posix()
        try:
            records[name] = one(path)
        except InputError as error:
            bad.append(str(error).replace(str(path), name))
    if not bad:
        return records
    # one error for all; advice that they have in common is printed once
    more = f"; and {len(bad) - _MOST_LISTED} more" if len(bad) > _MOST_LISTED else ""
    heads = [text.rpartition("; ") for text in bad]
    advice = heads[0][2] if len({tail for _, _, tail in heads}) == 1 else ""
    shown = [head if advice else text for text, (head, _, _) in zip(bad, heads, strict=True)]
    listed = "; ".join(shown[:_MOST_LISTED]) + more + (advice and f"; {advice}")
    raise InputError(f"{folder}: {len(bad)} of {len(files)} files cannot be read: {listed}")


def _files(folder: Path) -> list[Path]:
    """Return the files of runs below a folder, sorted by path."""
    if folder.is_file():
        raise InputError(
            f"{folder} is one file; a steady curve needs a folder of at least {MIN_RUNS} runs,"
            " each at a steady speed of its own"
        )
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder")
    endings = suffixes()
    found = sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in endings
        and path.is_file()
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    )
    if len(found) < MIN_RUNS:
        logs = sum(path.suffix.lower() == ".json" for path in folder.rglob("*"))
        raise InputError(
            f"{folder} holds {len(found)} files of runs ({', '.join(endings)}); a steady curve"
            f" needs at least {MIN_RUNS}, each at a steady speed of its own"
            + (f" ({logs} .json: logs, not looked for in a folder)" if logs else "")
        )
    return found


def _check_runs(
    folder: Path, runs: list[Run], used: list[Run], records: Mapping[str, AxisRecord]
) -> None:
    """Refuse a folder with too few runs, or with runs in different units."""
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
    folder: Path, runs: list[Run], used: list[Run], records: Mapping[str, AxisRecord]
) -> Provenance:
    """Return the origin of the runs, with notes on excluded runs and rows."""
    folders = sorted({Path(run.name).parent.as_posix() for run in used})
    own = [folder.resolve().name if name == "." else name for name in folders]
    notes = [f"{len(used)} steady runs of {len(runs)} files, from {', '.join(own)}"]
    if len(folders) > 1:
        notes.append("runs of several folders are assumed to be of one axis under one load")
    wild = [run for run in used if run.outliers]
    if wild:
        count = sum(run.outliers for run in wild)
        total = sum(run.samples + run.outliers for run in used)
        notes.append(f"outliers: {count} of {total} rows left out")
    notes += [f"{run.name} is left out: {run.refused}" for run in runs if run.refused]
    notes += [f"{run.name}: {run.note}" for run in used if run.note]
    dropped: Counter[str] = Counter()
    where: dict[str, list[str]] = {}
    for run in used:
        origin = records[run.name].provenance
        dropped.update(origin.dropped)
        for note in origin.notes:
            where.setdefault(note, []).append(run.name)
    notes += [
        note if len(names) == len(used) else f"{note} ({', '.join(names)})"
        for note, names in where.items()
        if "recorded" not in note
    ]
    digests = "".join(records[name].provenance.sha256 for name in sorted(run.name for run in used))
    return Provenance(
        str(folder),
        hashlib.sha256(digests.encode()).hexdigest(),
        sum(records[run.name].provenance.rows_read for run in used),
        dict(dropped),
        tuple(notes),
    )


def _frozen(values: ArrayLike, kind: type = np.float64) -> np.ndarray:
    array = np.array(values, kind)
    array.setflags(write=False)
    return array
