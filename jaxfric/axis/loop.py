"""`close_axis_loop(record)`: what does Coulomb and viscous friction lack on this axis?

Inverse dynamics: the motor force that a measured motion takes, against the recorded one. Search,
evidence, tests and verdict are those of `jaxfric.loop`.
"""

import dataclasses
import time
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

from ..effects import RecordScales
from ..errors import InputError
from ..fitting import NoiseEstimate
from ..fitting.start import noise_from_differences
from ..loop.engine import Candidate, Column, Engine, ShapedColumns, columns_of
from ..loop.estimates import candidate_scores, estimates
from ..loop.location import Bumps, locate
from ..loop.loop import declared, refuse_both, where_it_sits
from ..loop.result import Loop, Score, ScreenedEffect
from ..loop.search import Search, search
from ..loop.shapes import shapes_of
from ..loop.split import NAMES
from ..loop.superset import Superset
from ..loop.verdict import conclude, innovations, noise_floor
from ..records.axis_record import AxisRecord
from .effects import AXIS_CATALOGUE, AbstractAxisEffect, axis_effect_of
from .fit import AxisFit, inverse_dynamics, output_error
from .gains import axis_gains, state_gains
from .prepare import Preparation, Prepared, prepare
from .problem import AxisProblem, BaseLaw, make_problem, shape_columns
from .result import AxisBase, AxisDetails, AxisRows
from .split import segments, split

_MOST = 3
_WIDTH_IN_NOISE = 2.0
_WIDTH_SHARE = 1e-3
_STUCK = 0.05
# What a controller makes of encoder noise lasts about as long as a row; what lasts longer is
# structure.
_NOISE_ROWS = 1.0
_COARSE, _WAVES = 16, 60


def close_axis_loop(
    record: AxisRecord,
    *,
    with_: Sequence[str] = (),
    without: Sequence[str] = (),
    own: Sequence[type[AbstractAxisEffect]] = (),
    most: int = _MOST,
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
    preparation : filter of the record; by default `usual`.
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
    effects = _effects(with_, without, own)
    if not 0 <= most <= _MOST:
        raise InputError(f"most is {most}; choose 0 to {_MOST}")
    progress("preparing the record")
    prepared = prepare(
        record.relative_time,
        record.position,
        record.velocity,
        record.motor_force,
        preparation=preparation,
        held=record.drive is not None if held is None else held,
    )
    rows = _rows(prepared, width)
    blocks = split(rows.segment, rows.used, rows.velocity, record.provenance.path)
    noise_scale = noise_from_differences(prepared.force[: prepared.rows][rows.used])
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = rows.used
    problem = make_problem(
        prepared,
        weight,
        Superset(BaseLaw(), effects),  # pyright: ignore[reportArgumentType]
        width=rows.width,
        noise_scale=noise_scale,
    )
    none = np.zeros(0, int)
    engine = Engine(
        problem,  # pyright: ignore[reportArgumentType]
        blocks,
        none,
        shapes=axis_shapes,
        longest=_NOISE_ROWS,
        either_sign=True,
    )
    scales = _scales(rows, prepared, blocks)
    z = declared(engine, _start(problem, blocks.train), scales, tuple(with_))
    engine = Engine(
        problem,  # pyright: ignore[reportArgumentType]
        blocks,
        none,
        tuple(with_),
        shapes=axis_shapes,
        longest=_NOISE_ROWS,
        either_sign=True,
    )
    found = search(engine, [z], scales, most=most, progress=progress)
    progress("where the structure sits")
    floor = noise_floor(engine, found.final, rows.path)
    location = locate(engine, found.base, floor.noise, _bumps(engine, rows))
    before = _score(engine, found.base, record, rows)
    after = before if found.final is found.base else _score(engine, found.final, record, rows)
    where = where_it_sits(location)
    told = conclude(engine, found, floor, dict(after.tests), edge=None, located=where)
    return Loop(
        record=rows.as_record(record),
        base_fit=AxisBase(rows.steps(), rows.width, prepared.preparation),
        blocks=blocks,
        verdict=told.verdict,
        sentence=told.sentence,
        reasons=told.reasons,
        effects=found.final.effects,
        alias_groups=told.alias_groups,
        separations=told.separations,
        candidates=candidate_scores(engine, found),
        screened=tuple(ScreenedEffect(s.id, s.delta_bic) for r in found.screened[:1] for s in r),
        before=before,
        after=after,
        sigma=floor.sigma,
        location=location,
        alias_ids=found.ids,
        alias_cosines=found.cosines,
        warnings=rows.warnings(),
        details=_details(record, prepared, rows, problem, engine, found, progress),
        seconds=time.monotonic() - begun,
    )


def _details(record, prepared, rows: AxisRows, problem, engine, found: Search, progress):
    """Both fits of the base and of the final model, over all rows."""
    # as published fits of an axis did it: other rows, and the force acts at once
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = prepared.inside[: prepared.rows] & ~rows.stuck
    usual_force = dataclasses.replace(
        problem,
        sampler=prepared.usual,
        friction=jnp.asarray(prepared.usual_force),
        weight=jnp.asarray(weight),
    )
    fits: list[tuple[str, AxisFit]] = []
    models = [("before", found.base)]
    models += [] if found.final is found.base else [("after", found.final)]
    for when, candidate in models:
        free = np.asarray(engine.free(candidate.effects), int)
        progress("inverse dynamics of all rows")
        fits.append((when, inverse_dynamics(usual_force, candidate.z, free)))
        progress("closed-loop output error")
        acting = [e.id for e in engine.model.effects if e.room == "friction"]
        simulated_free = engine.free(tuple(id for id in candidate.effects if id in acting))
        simulated = output_error(problem, candidate.z, simulated_free, record)
        fits += [] if simulated is None else [(when, simulated)]
    rig = fits[-1][1].rig
    moving = np.abs(rows.velocity[rows.used])
    middle = jnp.asarray(float(np.median(rows.position)))

    def steady(speed: np.ndarray) -> np.ndarray:
        v = jnp.asarray(speed)
        return np.asarray(rig.friction(middle, v, jnp.zeros_like(v), rig.steady(v)))

    slow = max(4 * rows.width, float(np.quantile(moving, 0.02)))
    fast = float(moving.max())
    gains = state_gains(rig, float(middle), slow, fast, drive=record.drive)
    gains = gains or axis_gains(steady, slow, fast, drive=record.drive)
    return AxisDetails(tuple(fits), prepared.preparation, rows.width, record, gains)


def _effects(with_, without, own) -> tuple[type[AbstractAxisEffect], ...]:
    known = {**AXIS_CATALOGUE, **{e.id: e for e in own}}
    for id in (*with_, *without):
        if id not in known:
            axis_effect_of(id)
    refuse_both(with_, without)
    return tuple(e for id, e in known.items() if id not in without)


def _rows(prepared: Prepared, width: float | None) -> AxisRows:
    """The decimated rows of a record, which of them count, and their motion segments."""
    n, motion = prepared.rows, prepared.motion
    velocity, position, path = (
        np.asarray(prepared.means(x))[:n] for x in (motion.velocity, motion.position, motion.path)
    )
    fastest = float(np.max(np.abs(velocity)))
    if width is None:
        width = max(_WIDTH_IN_NOISE * prepared.velocity_noise, _WIDTH_SHARE * fastest)
    elif not 0 < width < fastest:
        raise InputError(
            f"width {width:g} m/s: the axis moves at up to {fastest:g} m/s; choose less"
        )
    every = prepared.means.every
    samples = np.asarray(motion.velocity).reshape(-1, every)[:n]
    slow = np.min(np.abs(samples), axis=1) < 2 * width
    slow |= np.ptp(np.sign(samples), axis=1) > 0
    step = float(prepared.time[1] - prepared.time[0])
    return AxisRows(
        time=prepared.time[:n],
        position=position,
        velocity=velocity,
        path=path,
        used=prepared.inside[:n] & ~_widened(slow),
        stuck=_long(slow, max(2, round(_STUCK / step))),
        segment=segments(slow),
        width=width,
    )


def _widened(slow: np.ndarray) -> np.ndarray:
    """With the rows beside them, into which the filter of the position reaches."""
    wide = slow.copy()
    wide[1:] |= slow[:-1]
    wide[:-1] |= slow[1:]
    return wide


def _long(slow: np.ndarray, rows: int) -> np.ndarray:
    """Those of the slow rows that are at least so many together."""
    long = np.zeros(len(slow), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], slow.astype(int), [0]])))
    for begin, end in edges.reshape(-1, 2):
        long[begin:end] = end - begin >= rows
    return long


def _scales(rows: AxisRows, prepared: Prepared, blocks) -> RecordScales:
    speed = np.abs(rows.velocity[blocks.train])
    moving = speed[speed > 2 * rows.width]
    # twice the distance between two rows at the median speed, within the filter's pass band
    resolved = 2.5 * float(np.median(moving)) * float(prepared.time[1] - prepared.time[0])
    return RecordScales(
        slip_length=float("nan"),
        step_slip=resolved,
        total_slip=float(np.ptp(rows.position)),
        slowest=float(np.quantile(moving, 0.02)),
        fastest=float(moving.max()),
        interval=float(prepared.time[1] - prepared.time[0]),
        duration=float(rows.time[-1]),
    )


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


def axis_shapes(engine: Engine, z: np.ndarray, missing, scales: RecordScales) -> ShapedColumns:
    """Columns of the missing effects that have shapes: derivatives at every shape."""
    problem: AxisProblem = engine.problem  # pyright: ignore[reportAssignmentType]
    columns: list[Column] = []
    blocks, place = [np.zeros((len(engine.weight), 0))], 0
    for effect in missing:
        shapes = shapes_of(effect, scales)
        if not shapes:
            continue
        found = columns_of(engine, effect.id, shapes, place)
        zs = np.tile(z, (len(shapes), 1))
        for row, column in zip(zs, found, strict=True):
            for i, value in column.shape.items():
                row[i] = value
        block = np.asarray(shape_columns(problem, jnp.asarray(zs), found[0].amplitudes))
        columns += found
        blocks.append(block)
        place += block.shape[1]
    matrix = np.concatenate(blocks, axis=1)
    return ShapedColumns(tuple(columns), matrix, np.zeros((0, matrix.shape[1])))


def _bumps(engine: Engine, rows: AxisRows) -> list[Bumps]:
    """Hats over position, velocity, time and distance since the reversal."""
    since = rows.path.copy()
    for k in np.unique(rows.segment):
        here = rows.segment == k
        since[here] -= since[here][0]
    train = engine.blocks.train
    found = []
    for variable, unit, x in (
        ("position", "m", rows.position),
        ("velocity", "m/s", rows.velocity),
        ("time", "s", rows.time),
        ("since_reversal", "m", np.sqrt(since)),
    ):
        centres = np.linspace(x[train].min(), x[train].max(), _COARSE)
        hats = np.zeros((len(engine.weight), len(centres)))
        for k in range(len(centres)):
            hats[: len(x), k] = np.interp(x, centres, np.arange(len(centres)) == k)
        shown = centres**2 if variable == "since_reversal" else centres
        found.append(Bumps(variable, unit, shown, hats))
    travel = float(np.ptp(rows.position))
    waves = np.geomspace(travel / 100, travel, _WAVES)
    phase = 2 * np.pi * rows.position[:, None] / waves
    pairs = np.zeros((len(engine.weight), 2 * _WAVES))
    pairs[: len(phase), 0::2], pairs[: len(phase), 1::2] = np.cos(phase), np.sin(phase)
    return [*found, Bumps("wavelength", "m", waves, pairs)]


def _score(engine: Engine, candidate: Candidate, record: AxisRecord, rows: AxisRows) -> Score:
    found, free, covariance = estimates(engine, candidate, record.force_unit)
    if record.coordinate == "rotary":
        found = {n: dataclasses.replace(e, unit=rotary_unit(e.unit)) for n, e in found.items()}
    scale = float(engine.problem.noise_scale)
    used, noise = rows.used, candidate.noise
    residual = np.where(used, scale * candidate.residual[: len(rows.time)], np.nan)
    per_step = [
        float(np.sqrt(np.mean(residual[used & (rows.segment == k)] ** 2)))
        if np.any(used & (rows.segment == k))
        else np.nan
        for k in range(int(rows.segment.max()) + 1)
    ]
    return Score(
        effects=candidate.effects,
        rms={name: candidate.rms[name] for name in NAMES},
        per_step=tuple(per_step),
        residual=residual,
        parameters=found,
        free=free,
        covariance=covariance,
        noise=NoiseEstimate(
            scale * float(noise.sigma),
            float(noise.share),
            float(noise.correlation_time) * float(rows.time[1] - rows.time[0]),
        ),
        tests=innovations(engine, candidate, rows.path),
    )


def rotary_unit(unit: str) -> str:
    """The unit of a rotary axis for that of a linear one: rad for m, kg m^2 for kg."""
    if unit == "kg":
        return "kg m^2"
    force = next((f for f in ("N m", "%") if unit.startswith(f)), "")
    return force + unit[len(force) :].replace("m", "rad")
