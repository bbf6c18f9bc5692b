"""`close_axis_loop(record)`: what does Coulomb and viscous friction lack on this axis?

Inverse dynamics: the motor force that a measured motion takes, against the recorded one. Search,
evidence, tests and verdict are those of `jaxfric.loop`.
"""

import dataclasses
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from ...effects import ids_of
from ...effects.axis import AXIS_CATALOGUE, IN_TIME, AbstractAxisEffect, axis_effect_of
from ...errors import InputError
from ...fitting.axis_preparation import Preparation
from ...fitting.axis_problem import AxisProblem, make_problem
from ...fitting.start import noise_from_differences
from ...fitting.superset import Superset
from ...records.axis_record import AxisRecord
from ...records.given import as_axis_record
from ...rig.axis import BaseLaw
from ..assemble import declared, loop_of, refuse_both, score_of, where_it_sits
from ..curves import curve_family
from ..engine import Candidate, Engine
from ..estimates import estimates
from ..location import locate
from ..result import Loop, Score
from ..rivals import all_rivals
from ..search import MOST, search
from ..split import Blocks
from ..verdict import conclude, noise_floor, questions
from .curves import axis_curves
from .details import details_of
from .reading import read_rows
from .result import AxisBase, AxisRows
from .rows import scales_of
from .seen import doubts
from .shapes import axis_shapes, friction_bumps

# What a controller makes of encoder noise lasts about as long as a row; what lasts longer is
# structure.
_NOISE_ROWS = 1.0
_LEAST_UNIT = 1e-3


def close_axis_loop(
    record: AxisRecord | str | Path,
    *,
    with_: str | Sequence[str] = (),
    without: str | Sequence[str] = (),
    own: Sequence[type[AbstractAxisEffect]] = (),
    most: int = MOST,
    preparation: Preparation | None = None,
    width: float | None = None,
    held: bool | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Loop:
    """Fit mass, Coulomb and viscous friction and an offset, then find what they lack.

    Parameters
    ----------
    with_, without, own, most, progress : as of `jaxfric.close_loop`, of the effects of an axis
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
    InputError : an unknown effect; no reversal, too few motion segments; as of `prepare`.

    Not tried: two axes, backlash, a payload that changes.
    """
    begun = time.monotonic()
    record, with_, without = as_axis_record(record), ids_of(with_), ids_of(without)
    effects = _effects(with_, without, own)
    if not 0 <= most <= MOST:
        raise InputError(f"most is {most}; choose 0 to {MOST}")
    progress("preparing the record")
    held = record.drive is not None if held is None else held
    reading = read_rows(record, preparation=preparation, width=width, held=held)
    prepared, rows, blocks = reading.prepared, reading.rows, reading.blocks
    for note in reading.notes:
        progress(note)
    noise_scale = unit_of_residuals(prepared.force[: prepared.rows][rows.used])
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = rows.used
    problem = make_problem(
        prepared,
        weight,
        Superset(BaseLaw(), effects),  # pyright: ignore[reportArgumentType]
        width=rows.width,
        noise_scale=noise_scale,
    )
    engine = _engine(problem, blocks, rows)
    scales = scales_of(rows, prepared, blocks)
    z = declared(engine, _start(problem, blocks.train), scales, tuple(with_))
    engine = _engine(problem, blocks, rows, tuple(with_))
    found = search(engine, [z], scales, most=most, progress=progress)
    rows = dataclasses.replace(rows, used=rows.used & engine.passed_on())
    progress("where the structure sits")
    floor = noise_floor(engine, found.final)
    bumps = friction_bumps(engine, rows, unit=length_of(record))
    left = locate(engine, found.base, floor.found, bumps)
    location = left.location
    tests = questions(engine, found.base, rows.path, left, floor.found.noise)
    before = after = _score(engine, found.base, record, rows, tests)
    if found.final is not found.base:
        left = locate(engine, found.final, floor.found, bumps)
        tests = questions(engine, found.final, rows.path, left, floor.found.noise)
        after = _score(engine, found.final, record, rows, tests, all_rivals(found))
    where = where_it_sits(location)
    curve = axis_curves(engine, found.final, rows, length_of(record))
    curve = curve_family(engine, found.final, curve)
    told = conclude(engine, found, floor, tests, edge=None, located=where, curve=curve)
    return loop_of(
        engine,
        found,
        told,
        before,
        after,
        location,
        record=rows.as_record(record),
        base_fit=AxisBase(rows.steps(), rows.width, prepared.preparation),
        sigma=floor.sigma,
        warnings=(*reading.warnings, *rows.warnings(), *doubts(engine, found.final, rows)),
        details=details_of(record, reading, after.parameters, problem, engine, found, progress),
        seconds=time.monotonic() - begun,
    )


def _engine(
    problem: AxisProblem, blocks: Blocks, rows: AxisRows, with_: tuple[str, ...] | None = None
) -> Engine:
    """With a base that has `with_`, to search from; without, to start such a base."""
    return Engine(
        problem,  # pyright: ignore[reportArgumentType]
        blocks,
        np.zeros(0, int),
        with_ or (),
        shapes=axis_shapes,
        one_of=() if with_ is None else (IN_TIME,),
        path=rows.path,
        longest=np.asarray([_NOISE_ROWS * float(problem.time[1] - problem.time[0])]),
        either_sign=True,
        by_step=False,
    )


def _effects(with_, without, own) -> tuple[type[AbstractAxisEffect], ...]:
    known = {**AXIS_CATALOGUE, **{e.id: e for e in own}}
    for id in (*with_, *without):
        if id not in known:
            axis_effect_of(id)
    refuse_both(with_, without)
    return tuple(e for id, e in known.items() if id not in without)


def _start(problem: AxisProblem, train: np.ndarray) -> np.ndarray:
    """Parameters of the base by least squares, effects at their null."""
    motion = problem.motion
    at = np.flatnonzero(train)
    columns = [
        motion.acceleration,
        motion.velocity,
        jnp.tanh(motion.velocity / problem.width),
        jnp.ones_like(motion.velocity),
    ]
    matrix = np.stack([np.asarray(problem.sampler(c))[at] for c in columns], axis=1)
    found, *_ = np.linalg.lstsq(matrix, np.asarray(problem.friction)[at], rcond=None)
    found[0] = max(found[0], 1e-6 * float(problem.sizes.force / problem.sizes.acceleration))
    values = jnp.asarray([*found, *problem.model.nulls()])
    return np.asarray(problem.to_free(values))


def _score(
    engine: Engine,
    candidate: Candidate,
    record: AxisRecord,
    rows: AxisRows,
    tests: dict[str, float],
    rivals: Sequence[Candidate] = (),
) -> Score:
    found, free, covariance = estimates(engine, candidate, record.force_unit, rivals)
    if record.coordinate == "rotary":
        found = {n: dataclasses.replace(e, unit=rotary_unit(e.unit)) for n, e in found.items()}
    size = float(engine.problem.noise_scale) * candidate.residual[: len(rows.time)]
    return score_of(
        engine,
        candidate,
        (found, free, covariance),
        np.where(rows.used, size, np.nan),
        tests,
        step=rows.segment,
        count=int(rows.segment.max()) + 1,
    )


def unit_of_residuals(force: np.ndarray) -> float:
    """In which residuals are counted: about the noise, but not so little that a bad fit of a
    commanded force, which has none, counts as a simulation that failed."""
    return max(noise_from_differences(force), _LEAST_UNIT * float(np.ptp(force)))


def length_of(record: AxisRecord) -> str:
    """The SI unit of its motion: "m" or "rad"."""
    return "rad" if record.coordinate == "rotary" else "m"


def rotary_unit(unit: str) -> str:
    """The unit of a rotary axis for that of a linear one: rad for m, kg m^2 for kg."""
    if unit == "kg":
        return "kg m^2"
    force = next((f for f in ("N m", "%") if unit.startswith(f)), "")
    return force + unit[len(force) :].replace("m", "rad")
