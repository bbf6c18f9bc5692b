"""`close_axis_loop(record)`: what does Coulomb and viscous friction lack on this axis?

Inverse dynamics: the motor force that a measured motion takes, against the recorded one. Search,
evidence, tests and verdict are those of `jaxfric.loop`.
"""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Self

import jax.numpy as jnp
import numpy as np

from ...effects import AXIS_CATALOGUE, AbstractEffect, RecordScales, effect_of, ids_of
from ...effects.axis import ANGLE, IN_TIME
from ...findings import Finding, Severity
from ...fitting import Estimate
from ...fitting.axis_preparation import Preparation
from ...fitting.axis_problem import AxisProblem, make_problem
from ...fitting.encompassing import EncompassingModel
from ...records.axis_record import AxisRecord
from ...records.axis_units import inertia_unit
from ...records.differences import noise_from_differences
from ...records.given import as_axis_record
from ...rig.axis import AxisRig, BaseLaw
from ...silent import silent
from ..curves import CurveRig
from ..driver import AbstractBench, Offered, ScoredRows, offered, run
from ..engine import Candidate, Choice, Engine, NoiseBounds
from ..findings import WITHHELD, LoopCode, words_of
from ..location import Bumps
from ..result import Loop, Score
from ..search import MOST, Search
from ..words import AXIS, LoopWords
from .curves import axis_curves
from .details import details_of
from .driven import OF_SPEED, UNKNOWN, Driven, at_one_speed, driven
from .findings import axis_claims
from .nonlinear import axis_sensitivities, friction_bumps
from .reading import Reading, read_rows
from .result import AxisBase, AxisDetails, AxisRows, PreparedRecord, Spring
from .rows import scales_of
from .seen import doubts, follows, held_command, spring_of

# What a controller makes of encoder noise lasts about as long as a row; what lasts longer is
# structure.
_NOISE_ROWS = 1.0
_LEAST_UNIT = 1e-3
_LEAST_MASS = 1e-6
"""Lower limit of the mass to start from, in units of force over the largest acceleration."""


def close_axis_loop(
    record: AxisRecord | str | Path,
    *,
    with_: str | Sequence[str] = (),
    without: str | Sequence[str] = (),
    own: Sequence[type[AbstractEffect]] = (),
    most: int = MOST,
    preparation: Preparation | None = None,
    width: float | None = None,
    held: bool | None = None,
    progress: Callable[[str], None] = silent,
) -> Loop:
    """Fit mass, Coulomb and viscous friction and an offset, then find what they lack.

    Parameters
    ----------
    with_, without, own, most, progress : as in `jaxfric.close_loop`, of the effects of an axis
        (`AXIS_CATALOGUE`).
    preparation : filter of the record; by default the one that `reading` chooses.
    width : of the smoothed sign of the velocity [m/s]; by default twice the noise of the velocity
        or a thousandth of the largest speed, whichever is larger.

    held : the force is a command that a sampled controller holds until the next row, so that it
        acts half a row later; by default true where the drive of the record is known.

    Rows slower than two widths, those where the axis turns, and their neighbours do not count: at
    rest friction is whatever the force is. Whole motion segments are held back.

    Raises
    ------
    InputError : an unknown effect, or one of a rotary axis with a linear one; no reversal, too few
        motion segments; as in `prepare`.

    Not tried: two axes, backlash, a payload that changes.
    """
    begun = time.monotonic()
    record, with_, without = as_axis_record(record), ids_of(with_), ids_of(without)
    asked = offered(AXIS_CATALOGUE, own, with_, without, most, _axis_effect)
    asked = _seen_by(record, asked)
    progress("preparing the record")
    held = record.drive is not None if held is None else held
    reading = read_rows(record, preparation=preparation, width=width, held=held)
    for note in reading.notes:
        progress(note)
    prepared, rows = reading.prepared, reading.rows
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = rows.used
    effects = tuple(e for e in asked.effects if e.id not in asked.without)
    problem = make_problem(
        prepared,
        weight,
        EncompassingModel(BaseLaw(), effects),
        width=rows.width,
        noise_scale=unit_of_residuals(prepared.force[: prepared.rows][rows.used]),
    )
    bench = AxisBench(record, reading, problem, rows, held)
    return run(bench, asked, begun=begun, progress=progress)


def _seen_by(record: AxisRecord, asked: Offered) -> Offered:
    """The offer without the effects of a rotary axis where the record is of a linear one."""
    return asked.seen_by(
        (ANGLE,) if record.coordinate == "rotary" else (),
        lambda effect: (
            f"{record.provenance.path}: effect {effect.id} is of a rotary axis, whose position is"
            " in rad or deg; leave it out of --with"
        ),
    )


def _axis_effect(id: str) -> type[AbstractEffect]:
    return effect_of(id, AxisRig)


@dataclasses.dataclass(frozen=True, eq=False)
class AxisBench(AbstractBench):
    """An axis' record, its prepared rows and the problem of inverse dynamics."""

    record: AxisRecord
    reading: Reading
    problem: AxisProblem
    counted: AxisRows
    """Rows of the reading, but for those that are glitches."""
    held: bool
    """Whether the force is a command held until the next row."""

    def engine(self, with_: tuple[str, ...] | None) -> Engine[AxisProblem]:
        """Effects that move force and motion in time are one group, but where a base starts."""
        longest = np.asarray([_NOISE_ROWS * float(self.problem.time[1] - self.problem.time[0])])
        return Engine(
            self.problem,
            self.reading.blocks,
            np.zeros(0, int),
            Choice(with_ or (), self._unseen(with_), () if with_ is None else (IN_TIME,)),
            shapes=axis_sensitivities,
            path=self.path(),
            bounds=NoiseBounds(longest, either_sign=True, by_step=False),
        )

    @cached_property
    def spring(self) -> Spring | None:
        """The spring that the force is of an axis that never slid, as by `spring_of`."""
        return spring_of(self.problem, self.reading.rows)

    @cached_property
    def stopped(self) -> Finding | None:
        """Why there is no verdict: the axis never slid, or its force is feedback; else None."""
        used = self.reading.rows.used
        if self.spring is not None:
            unit = f"{self.record.force_unit}/{length_of(self.record)}"
            values = {**self.spring._asdict(), "unit": unit}
            return Finding(LoopCode.SPRING, Severity.WITHHELD, values, used)
        late = follows(self.problem, self.reading.rows, self.record.coordinate == "rotary")
        if late is None:
            return None
        return Finding(LoopCode.FEEDBACK, Severity.WITHHELD, {"late": late}, used)

    @cached_property
    def reason(self) -> str:
        """The same in words; '' where there is a verdict."""
        return "" if self.stopped is None else words_of(self.stopped).removesuffix(WITHHELD)

    @cached_property
    def others(self) -> tuple[Finding, ...]:
        """That other joints move in the record, where they do."""
        if not self.record.others:
            return ()
        values, used = {"columns": self.record.others}, self.reading.rows.used
        return (Finding(LoopCode.OTHERS, Severity.CAUTION, values, used),)

    @cached_property
    def driven(self) -> tuple[Driven, ...]:
        """The speeds of each direction, and friction there."""
        rows = self.reading.rows
        force = np.asarray(self.reading.prepared.force)[: len(rows.time)]
        return driven(rows.used, rows.velocity, rows.segment, force)

    def _unseen(self, with_: tuple[str, ...] | None) -> tuple[str, ...]:
        """Effects that the record cannot show, but for those asked for."""
        single = at_one_speed(self.driven)
        return tuple(id for id in OF_SPEED if id not in (with_ or ())) if single else ()

    def start(self, engine: Engine[AxisProblem]) -> np.ndarray:
        """Parameters of the base by least squares."""
        problem, motion = self.problem, self.problem.motion
        at = np.flatnonzero(self.reading.blocks.train)
        columns = [
            motion.acceleration,
            motion.velocity,
            jnp.tanh(motion.velocity / problem.width),
            jnp.ones_like(motion.velocity),
        ]
        matrix = np.stack([np.asarray(problem.sampler(c))[at] for c in columns], axis=1)
        found, *_ = np.linalg.lstsq(matrix, np.asarray(problem.friction)[at], rcond=None)
        largest = max(float(np.max(np.abs(matrix[:, 0]))), 1e-300)
        found[0] = max(found[0], _LEAST_MASS * float(problem.sizes.force) / largest)
        return problem.coordinates.to_free(np.asarray([*found, *problem.model.nulls()]))

    def starts(self, engine: Engine[AxisProblem], z: np.ndarray) -> list[np.ndarray]:
        """`z` alone: the base is linear and has one minimum."""
        return [z]

    def scales(self) -> RecordScales:
        """Sizes of the record, see `scales_of`."""
        return scales_of(self.reading.rows, self.reading.prepared, self.reading.blocks)

    def path(self) -> np.ndarray:
        """Distance travelled, there and back, at every row [m]."""
        return self.reading.rows.path

    def passing_over(self, engine: Engine[AxisProblem]) -> Self:
        """A copy of this bench without the rows that are glitches."""
        rows = self.reading.rows
        counted = dataclasses.replace(rows, used=rows.used & engine.passed_on())
        return dataclasses.replace(self, counted=counted)

    def bumps(self, engine: Engine[AxisProblem], candidate: Candidate) -> list[Bumps]:
        """Bumps of friction over position, velocity, time and the distance since a reversal."""
        return friction_bumps(engine, self.counted, unit=length_of(self.record))

    def curves(self, engine: Engine[AxisProblem], final: Candidate) -> CurveRig:
        """Steady curves of the fit, see `axis_curves`."""
        return axis_curves(engine, final, self.counted, length_of(self.record))

    def rows(self, engine: Engine[AxisProblem]) -> ScoredRows:
        """The rows that errors are reported of, by motion segment."""
        segment = self.counted.segment
        rows = self.counted
        return ScoredRows(rows.used, segment, int(segment.max()) + 1, rows.velocity)

    def named(self, parameters: Mapping[str, Estimate]) -> dict[str, Estimate]:
        """The parameters, in the units of the axis."""
        force, length = self.record.force_unit, length_of(self.record)
        units = {name: own_unit(one.unit, force, length) for name, one in parameters.items()}
        open_ = UNKNOWN if at_one_speed(self.driven) else ()
        open_ = tuple(parameters) if self.spring is not None else open_
        return {
            n: dataclasses.replace(e, unit=units[n], determined=e.determined and n not in open_)
            for n, e in parameters.items()
        }

    def friction_unit(self) -> str:
        """Unit of the motor force."""
        return self.record.force_unit

    def edge(self) -> None:
        """None: an axis moves as measured, so that no stiffness is near its critical value."""

    def withheld(self, engine: Engine[AxisProblem], found: Search) -> Finding | None:
        """That the axis never slid, or that the force is feedback, where it is."""
        return self.stopped

    def warnings(self, engine: Engine[AxisProblem], found: Search) -> tuple[str, ...]:
        """Warnings of the record, of its rows, and of what was seen at low speed."""
        final = found.final
        seen = doubts(engine, found, self.counted, self.reason)
        if not self.held:
            interval = float(np.median(np.diff(self.record.time)))
            seen += held_command(engine.values(final.z), final.effects, interval)
        seen += tuple(words_of(one) for one in self.others)
        return (*self.reading.warnings, *self.counted.warnings(length_of(self.record)), *seen)

    def words(self) -> LoopWords:
        """Words of reports about an axis."""
        return AXIS

    def shown(self) -> tuple[PreparedRecord, AxisBase]:
        """The rows, and the base model, as reports show them."""
        rows, prepared = self.counted, self.reading.prepared
        base = AxisBase(rows.steps(), rows.width, prepared.preparation)
        return rows.as_record(self.record, prepared.force), base

    def details(
        self,
        engine: Engine[AxisProblem],
        found: Search,
        after: Score,
        missed: float,
        progress: Callable[[str], None],
    ) -> AxisDetails:
        """Fits over all rows, gains, and friction and stability as far as rows support them."""
        details = details_of(
            self.record,
            self.reading,
            after.parameters,
            self.problem,
            engine,
            found,
            self.driven,
            self.reason,
            self.spring,
            missed,
            progress,
        )
        claims = axis_claims(self.counted, self.driven, details)
        return dataclasses.replace(details, claims=(*claims, *self.others))


def unit_of_residuals(force: np.ndarray) -> float:
    """Unit in which residuals are counted: about the noise, but not so little that a bad fit of a
    commanded force, which has none, counts as a simulation that failed."""
    return max(noise_from_differences(force), _LEAST_UNIT * float(np.ptp(force)))


def length_of(record: AxisRecord) -> str:
    """The SI unit of its motion: "m" or "rad"."""
    return "rad" if record.coordinate == "rotary" else "m"


def own_unit(unit: str, force: str, length: str) -> str:
    """The unit of a parameter, `unit` on a linear axis, where forces are in `force` and lengths in
    `length`: rad for m; kg m^2, or % s^2/rad, for kg."""
    if unit == "kg":
        return inertia_unit(force, length)
    begins = force if unit.startswith(force) else ""
    return begins + unit[len(begins) :].replace("m", length)
