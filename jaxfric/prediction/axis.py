"""Predict another record with a saved model of an axis: inverse dynamics, and the closed loop.

    inverse dynamics:  F(q, q', q'', t) of the model against the recorded motor force
    closed loop:       q of model and controller, from the reference alone, against the encoder

No parameter is fitted to the record. A disturbance acts together with the motor force. The recorded
force may already contain the disturbance. The force is predicted with and without the disturbance,
and the better prediction is used.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..effects import effects_of_file
from ..errors import InputError
from ..findings import Warned, WarningCode, warned
from ..fitting.axis_fit import force_descent
from ..fitting.axis_preparation import prepare, usual
from ..fitting.axis_problem import AxisProblem, make_problem
from ..fitting.encompassing import EncompassingModel
from ..fitting.noise import sandwich
from ..fitting.uncertainty import determined, spread_of
from ..loop.axis.loop import unit_of_residuals
from ..loop.axis.result import AxisRows
from ..loop.axis.rows import one_way, rows_of
from ..records.axis_record import AxisRecord
from ..records.differences import noise_from_differences
from ..rig.axis import AxisRig, BaseLaw
from ..simulation.axis_closed_loop import ClosedLoop, Controller, simulate_closed_loop, substeps
from .axis_noise import noise_of_axis
from .chance import chance_of_gain, chance_of_shifts
from .model import SavedModel
from .noise import RecordNoise
from .result import Comparison, NoteCode, Prediction, Shift

ROWS = "inverse dynamics"
POSITION = "closed loop: position"
FORCE = "closed loop: motor force"
_BEYOND = 1.2
_UNSEEN = 0.05
_FEW = 0.5
"""If a smaller share of the rows is compared, a warning gives their number."""


@dataclasses.dataclass(frozen=True, eq=False)
class _AxisSetting:
    """The record, prepared for the model, and the problem of its prediction."""

    saved: SavedModel
    record: AxisRecord
    problem: AxisProblem
    rows: AxisRows
    inside: bool | None
    """Whether the recorded force contains the disturbance; None without a disturbance."""


class _Refit(NamedTuple):
    """The model of an axis refitted to the record, and the noise of its residual."""

    z: np.ndarray
    index: np.ndarray
    """Indices of the fitted parameters in z."""
    residual: np.ndarray
    """Predicted minus recorded force of every row [F]; 0 for rows that are not compared."""
    jacobian: np.ndarray
    """By the fitted parameters, in noise units."""
    spread: np.ndarray
    """Covariance of the fitted parameters under the noise."""
    noise: RecordNoise


def predict_axis(
    saved: SavedModel,
    record: AxisRecord,
    *,
    held: bool | None,
    progress: Callable[[str], None],
) -> Prediction:
    """Compare the model of an axis with a record, as `jaxfric.predict` describes."""
    _refuse_other(saved, record)
    progress("preparing the record")
    setting = _setting(saved, record, held)
    problem, used = setting.problem, setting.rows.used
    unit, length = record.force_unit, record.length_unit
    best = list(saved.tables())[-1]
    progress("fitting this record for comparison")
    refit = _refit(setting, best)
    noise = refit.noise
    found: list[Comparison] = []
    position = None
    recorded = np.asarray(problem.friction)[: len(used)]
    for name in reversed(saved.tables()):  # the better model first
        progress(f"inverse dynamics: {name}")
        error = _force_error(problem, saved.values(name))[: len(used)][used]
        found.append(Comparison.of(name, ROWS, error, recorded[used], unit, noise.sigma))
        progress(f"closed loop: {name}")
        run = _closed_loop(setting, name)
        if run is not None and record.position is not None:
            q, f = np.asarray(run.position) - record.position, np.asarray(run.force)
            level = _position_noise(record.position)
            found.append(Comparison.of(name, POSITION, q, record.position, length, level))
            f = f - record.motor_force
            found.append(Comparison.of(name, FORCE, f, record.motor_force, unit, None))
            position = position or (record.relative_time, q, length)
    found.sort(key=lambda c: c.method != ROWS)
    residual = _force_error(problem, saved.values(best))[: len(used)]
    explained = found[0].rms <= noise.largest * noise.sigma
    return Prediction(
        source=str(saved.path),
        origin=record.provenance,
        kind="axis",
        force_unit=unit,
        comparisons=tuple(found),
        refitted={},
        sigma=noise.sigma,
        refit_rms=float(np.sqrt(np.mean(refit.residual[: len(used)][used] ** 2))),
        shifts=_shifts(setting, best, refit),
        time=setting.rows.time,
        recorded=recorded,
        predicted=np.where(used, recorded + residual, np.nan),
        position=position,
        notes=(*_notes(setting), warned(NoteCode.NOISE, **noise._asdict())),
        warnings=_warnings(setting),
        largest=noise.largest,
        chance=1.0 if explained else _chance(setting, best, refit),
    )


def _refuse_other(saved: SavedModel, record: AxisRecord) -> None:
    """Raise `InputError` for a model of another kind of axis, or in other units."""
    about = saved.content.get("axis") or {}
    kind = about.get("coordinate", "linear")
    if kind != record.coordinate:
        raise InputError(
            f"{saved.path} is of a {kind} axis, {record.provenance.path} of a {record.coordinate}"
            " one: a model predicts records of its own kind"
        )
    unit = saved.content["friction_unit"]
    if unit != record.force_unit:
        raise InputError(
            f"{saved.path} has its force in {unit}, {record.provenance.path} in"
            f" {record.force_unit}: give the record in the unit of the model (a rated torque turns"
            " per cent into torque)"
        )


def _setting(saved: SavedModel, record: AxisRecord, held: bool | None) -> _AxisSetting:
    """Return the record with the alternative of the force that the model predicts better."""
    added = record.disturbance_force
    force = record.motor_force
    if added is None or not np.any(added):
        return _prepared(saved, record, force, held, None)
    options = [
        _prepared(saved, record, f, held, inside)
        for f, inside in ((force, True), (force + added, False))
    ]
    best = list(saved.tables())[-1]

    def misfit(option: _AxisSetting) -> float:
        error = _force_error(option.problem, saved.values(best))
        return float(np.sum((error * np.asarray(option.problem.weight)) ** 2))

    return min(options, key=misfit)


def _prepared(
    saved: SavedModel,
    record: AxisRecord,
    force: np.ndarray,
    held: bool | None,
    inside: bool | None,
) -> _AxisSetting:
    about = saved.content.get("axis") or {}
    interval = float(np.median(np.diff(record.time)))
    cutoff = about.get("cutoff")
    chosen = usual(interval)
    if cutoff is not None and cutoff * 2 * interval < 1:
        chosen = usual(interval, cutoff)
    if held is None:
        held = bool(about.get("held", record.drive is not None))
    prepared = prepare(
        record.relative_time,
        record.position,
        record.velocity,
        force,
        preparation=chosen,
        held=held,
    )
    rows = rows_of(prepared, None, unit=record.length_unit)
    if rows.used.sum() < 20:
        raise InputError(
            f"{record.provenance.path}: only {int(rows.used.sum())} rows move faster than the noise"
            " of the velocity; nothing can be compared"
        )
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = rows.used
    effects = effects_of_file(saved.effects(), AxisRig)
    problem = make_problem(
        prepared,
        weight,
        EncompassingModel(BaseLaw(), effects),
        width=float(about.get("sign_width", rows.width)),
        noise_scale=unit_of_residuals(prepared.force[: prepared.rows][rows.used]),
    )
    return _AxisSetting(saved, record, problem, rows, inside)


def _free(problem: AxisProblem, values: dict[str, float]) -> Float[Array, " p"]:
    """Return the unbounded variables of a model's values; other effects are at their null."""
    names = problem.model.names()
    nulls = dict(zip(names[len(BaseLaw().names()) :], problem.model.nulls(), strict=True))
    return problem.coordinates.to_free(jnp.asarray([{**nulls, **values}[name] for name in names]))


@eqx.filter_jit
def _predict(problem: AxisProblem, z: Float[Array, " p"]) -> Float[Array, " n"]:
    return problem.predict(z)


def _force_error(problem: AxisProblem, values: dict[str, float]) -> np.ndarray:
    return np.asarray(_predict(problem, _free(problem, values)) - problem.friction)


def _closed_loop(setting: _AxisSetting, name: str) -> ClosedLoop | None:
    """Simulate position and force of model and controller. None if the controller is not known, or
    if the mass is near 0."""
    record, problem = setting.record, setting.problem
    drive, reference = record.drive, record.reference_position
    if drive is None or reference is None or record.position is None:
        return None
    if drive.K_d is None or drive.position_gain is None:
        return None
    values = setting.saved.values(name)
    for fit in (setting.saved.content.get("axis") or {}).get("fits", []):
        if (fit["model"], fit["method"]) == (name, "closed-loop output error"):
            values |= fit["values"]
    rig = problem.rig(_free(problem, values))
    interval = float(np.median(np.diff(record.time)))
    controller = Controller(
        jnp.asarray(drive.position_gain), jnp.asarray(drive.K_d), jnp.asarray(interval)
    )
    number = substeps(rig, interval, problem.motion)
    if number is None:
        return None
    added = record.disturbance_force
    return simulate_closed_loop(
        rig,
        controller,
        jnp.asarray(reference),
        jnp.asarray(record.position[:3]),
        substeps=number,
        disturbance=jnp.zeros(len(record)) if added is None else jnp.asarray(added),
    )


def _position_noise(position: np.ndarray) -> float | None:
    """Return the scatter of neighbouring samples of the encoder; None if below one count."""
    jumps = np.abs(np.diff(position))
    count = float(np.min(jumps[jumps > 0], initial=np.inf))
    noise = noise_from_differences(position)
    return max(noise, count / np.sqrt(12)) if np.isfinite(count) else None


def _refit(setting: _AxisSetting, name: str) -> _Refit:
    """Refit all parameters of the model to this record, with errors under the record's noise."""
    saved, problem = setting.saved, setting.problem
    free = saved.tables()[name]["free"]
    index = np.asarray([i for i, n in enumerate(problem.model.names()) if n in free])
    found = force_descent(problem, np.asarray(_free(problem, saved.values(name))), index)
    unit = float(problem.noise_scale)
    jacobian = found.jacobian / unit
    noise, largest = noise_of_axis(problem, setting.rows, found.residual / unit, jacobian)
    spread = spread_of(jacobian, np.asarray(sandwich(problem.clock, jacobian, noise)))
    told = RecordNoise(unit * float(noise.sigma), largest, float(1 - noise.white))
    return _Refit(found.y, index, found.residual, jacobian, spread, told)


def _known(setting: _AxisSetting, refit: _Refit) -> np.ndarray:
    """Whether both records determine each parameter of the refit."""
    problem = setting.problem
    names, every = problem.model.names(), np.zeros(len(refit.z))
    every[refit.index] = np.sqrt(np.maximum(np.diag(refit.spread), 0.0))
    used = np.asarray(problem.friction)[np.asarray(problem.weight) > 0]
    here = determined(problem.on_host(), refit.z, every, float(np.ptp(used)))
    unknown = setting.saved.undetermined()
    return np.asarray([here[i] and names[i] not in unknown for i in refit.index])


def _shifts(setting: _AxisSetting, name: str, refit: _Refit) -> tuple[Shift, ...]:
    """Return shifts of the parameters. The error is nan if one of the records does not determine
    the parameter."""
    problem, model = setting.problem, setting.saved.values(name)
    table, names = setting.saved.tables()[name]["parameters"], problem.model.names()
    here, slopes = problem.coordinates.from_free(refit.z), problem.coordinates.slopes(refit.z)
    out = []
    for k, (i, known) in enumerate(zip(refit.index, _known(setting, refit), strict=True)):
        own = abs(float(slopes[i])) * math.sqrt(max(refit.spread[k, k], 0.0))
        error = math.hypot(table[names[i]].get("std") or 0.0, own) if known else math.nan
        out.append(Shift(names[i], model[names[i]], float(here[i]), error))
    return tuple(out)


def _chance(setting: _AxisSetting, name: str, refit: _Refit) -> float:
    """Return the smaller chance of two tests, if no parameter has changed: that a refit lowers the
    error as much, and that it shifts the parameters as far (`prediction.chance`).

    The second test counts parameters that both records determine. A parameter at its bound is left
    out: to first order it moves nothing.
    """
    problem, table = setting.problem, setting.saved.tables()[name]
    values, names = setting.saved.values(name), problem.model.names()
    z = np.asarray(_free(problem, values))
    ends = [np.asarray(problem.coordinates.slopes(one))[refit.index] for one in (z, refit.z)]
    inside = np.all(np.asarray(ends) > 0, axis=0)
    own = np.flatnonzero(inside)
    places = [table["free"].index(names[i]) for i in refit.index[own]]
    before = np.nan_to_num(np.asarray(table["covariance"], float)[np.ix_(places, places)])
    here = refit.spread[np.ix_(own, own)]
    errors = [before / np.outer(slopes[own], slopes[own]) + here for slopes in ends]
    columns = refit.jacobian[:, own]
    error = _force_error(problem, values) * np.asarray(problem.weight)
    gain = float(np.sum(error**2 - refit.residual**2)) / float(problem.noise_scale) ** 2
    known = np.flatnonzero(_known(setting, refit)[own])
    apart = (refit.z - z)[refit.index][own][known]
    return min(
        chance_of_gain(gain, columns.T @ columns, errors[0]),
        chance_of_shifts(apart, [C[np.ix_(known, known)] for C in errors]),
    )


def _notes(setting: _AxisSetting) -> tuple[Warned, ...]:
    codes = [NoteCode.NOTHING]
    if setting.inside is not None:
        codes.append(NoteCode.INSIDE if setting.inside else NoteCode.BESIDE)
    return tuple(map(warned, codes))


def _warnings(setting: _AxisSetting) -> tuple[str, ...]:
    """Return the warnings of the model, and of extrapolation beyond its own record."""
    saved, rows = setting.saved, setting.rows
    told = list(saved.warnings())
    _, fastest = saved.speeds()
    centres = [
        abs(c)
        for profile in saved.content.get("location_map", [])
        if profile["variable"] == "velocity"
        for c in profile["centres"]
        if c is not None
    ]
    fastest = max([fastest, *centres])
    speed = np.abs(rows.velocity[rows.used])
    if np.mean(rows.used) < _FEW:
        of = {"compared": int(np.sum(rows.used)), "rows": len(rows.used)}
        told.append(warned(WarningCode.FEW_ROWS, **of, recorded=len(setting.record)))
    beyond = float(np.mean(speed > _BEYOND * fastest))
    if beyond > _UNSEEN:
        unit = f"{setting.record.length_unit}/s"
        told.append(warned(WarningCode.FASTER, share=beyond, fastest=fastest, unit=unit))
    if one_way(rows.velocity[rows.used]):
        told.append(warned(WarningCode.ONE_WAY))
    return tuple(told)
