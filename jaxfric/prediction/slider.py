"""Predict another record with a saved model of a slider, from the motion of the load point.

    f(t) of the model, in steady sliding at the first velocity, compared with recorded friction

f0 is fitted to the record, because f0 depends on the surface and on the zero of the load cell. The
times of velocity steps are fitted to the record within their error. All other parameters are those
of the model.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..effects import effects_of_file
from ..errors import InputError, option
from ..findings import Warned, WarningCode, warned
from ..fitting.assumed import changed_stress, unsteady_start
from ..fitting.encompassing import EncompassingModel
from ..fitting.fit import forward_steps, steps_of
from ..fitting.noise import Noise, sandwich
from ..fitting.padding import bucket
from ..fitting.problem import Model, Problem
from ..fitting.result import unit_of
from ..fitting.solve import descend, known_at
from ..fitting.stages import prepare
from ..fitting.stiffness import MachineStiffness, alike
from ..fitting.thresholds import FAILED_MISFIT
from ..fitting.uncertainty import spread_of
from ..loop.sampling import seen_between
from ..loop.screen import orthonormal
from ..records import Record, VelocitySteps
from ..rig.normal_stress import recorded_stress
from .chance import chance_of_gain, chance_of_shifts
from .model import SavedModel
from .noise import RecordNoise, SliderNoise, noise_of_record
from .result import Comparison, NoteCode, Prediction, Shift

METHOD = "friction"
_BEYOND = 1.2
_TRIALS = 40


class _SliderSetting(NamedTuple):
    saved: SavedModel
    record: Record
    problem: Problem
    steps: VelocitySteps
    sign: float
    stiffness: float
    stiffness_note: tuple[Warned, ...]
    """The source of the stiffness; empty if the user gave the stiffness for this record."""


class _Found(NamedTuple):
    """A model with some of its parameters fitted."""

    z: np.ndarray
    values: dict[str, float]
    error: np.ndarray
    """Predicted minus recorded friction at the rows."""
    jacobian: np.ndarray


def predict_slider(
    saved: SavedModel,
    record: Record,
    *,
    stiffness: float | str | None,
    steps: VelocitySteps | str | None,
    free: Sequence[str],
    progress: Callable[[str], None],
) -> Prediction:
    """Compare the model of a slider with a record, as `jaxfric.predict` describes."""
    _refuse_other(saved, record)
    setting = _setting(saved, record, stiffness, steps)
    tried: dict[str, _Found] = {}
    unit, varying = record.friction_unit, record.friction - np.mean(record.friction)
    for name in reversed(saved.tables()):  # the better model first
        progress(f"prediction: {name}")
        one = _descend(setting, _start(setting, name), tuple(free))
        if not np.all(np.isfinite(one.error)):
            raise InputError(
                f"{saved.path}: the slider of this model runs away (stick-slip) on"
                f" {record.provenance.path}, at a stiffness of {setting.stiffness:.3g}"
                f" {unit_of('K', record.friction_unit)}, so that it predicts no friction. Check the"
                " stiffness of the machine that made this record"
            )
        tried[name] = one
    best, found = next(iter(tried.items()))
    progress("fitting this record for comparison")
    refit = _descend(setting, found.z, _fitted(setting, best))
    judged = _noise(setting, best, refit)
    noise, spread = judged.told, _spread(setting, best, refit, judged.noise)
    rms = float(np.sqrt(np.mean(found.error**2)))
    explained = rms <= noise.largest * noise.sigma
    chance = 1.0 if explained else _chance(setting, best, tuple(free), found, refit, spread)
    model = saved.values(best)
    return Prediction(
        source=str(saved.path),
        origin=record.provenance,
        kind="slider",
        force_unit=unit,
        comparisons=tuple(
            Comparison.of(name, METHOD, one.error, varying, unit, noise.sigma)
            for name, one in tried.items()
        ),
        refitted={name: (model[name], found.values[name]) for name in free},
        sigma=noise.sigma,
        refit_rms=float(np.sqrt(np.mean(refit.error**2))),
        shifts=_shifts(setting, best, refit, spread),
        time=record.relative_time,
        recorded=record.friction,
        predicted=record.friction + setting.sign * found.error,
        position=None,
        notes=_notes(setting, free, noise),
        warnings=(*_warnings(setting), *_of_record(setting), *_limits(judged)),
        steps=setting.steps,
        largest=noise.largest,
        chance=chance,
    )


def _refuse_other(saved: SavedModel, record: Record) -> None:
    unit = saved.content["friction_unit"]
    if unit != record.friction_unit:
        words = {"1": "a coefficient", "N": "a force [N]"}
        raise InputError(
            f"{saved.path} has its friction as {words.get(unit, unit)}, {record.provenance.path} as"
            f" {words.get(record.friction_unit, record.friction_unit)}: divide the force by the"
            " normal force, or fit a record of the same kind"
        )


def _setting(
    saved: SavedModel,
    record: Record,
    stiffness: float | str | None,
    steps: VelocitySteps | str | None,
) -> _SliderSetting:
    values = saved.values(list(saved.tables())[-1])
    found, sign = forward_steps(record, steps_of(record, steps))
    effects = effects_of_file(saved.effects())
    stress, here = None, record.mean_normal_stress
    if any(e.channel == "normal_stress" for e in effects):
        if record.normal_stress is None:
            raise InputError(
                f"{record.provenance.path} has no normal stress, which the model of {saved.path}"
                " needs; name its column"
            )
        stress = recorded_stress(record.relative_time, record.normal_stress)
        here = stress.unit(record.relative_time, record.normal_stress)
    K, stiffness_note = _stiffness(saved, values["K"], record, stiffness, here)
    law = saved.content["law"]
    if effects:
        model = EncompassingModel(Model(law=law), effects)
    else:
        states = int(saved.content.get("states", 1))
        backwards = bool(np.any(found.velocities < 0))
        trend = "slip_trend" in values
        model = Model(law=law, states=states, slip_trend=trend, regularised=backwards)
    problem = prepare(
        record,
        found,
        model,
        stiffness=K,
        V0=values["V0"],
        mass=_mass(saved, values.get("m"), record, here),
        sign=sign,
        force_scale=abs(values["A"]),
    )
    if stress is not None:
        padded = stress.padded(bucket(len(stress.knots)))
        problem = dataclasses.replace(problem, normal_stress=padded)
    if effects:
        problem = seen_between(problem, values["A"] / K, values["L"])
    return _SliderSetting(saved, record, problem, found, sign, K, stiffness_note)


def _stiffness(
    saved: SavedModel,
    of_model: float,
    record: Record,
    given: float | str | None,
    here: float | None,
) -> tuple[float, tuple[Warned, ...]]:
    """Return the stiffness [F/m] for a record, and a note on its source unless it is `given`.

    A machine has one stiffness of shear stress [Pa/m]. For a coefficient of friction it is divided
    by the normal stress, so K of the model is scaled by the ratio of both normal stresses. `here`
    is the normal stress at which K of the record holds [Pa].
    """
    if given is not None:
        return MachineStiffness.parse(given, record.friction_unit).at(here), ()
    unit, before = unit_of("K", record.friction_unit), saved.normal_stress()
    if record.friction_unit != "1" or not before or not here or alike(before, here):
        return of_model, (warned(NoteCode.STIFFNESS, stiffness=of_model, unit=unit),)
    K = of_model * before / here
    values = {"stiffness": K, "of_model": of_model, "before": before, "here": here}
    return K, (warned(NoteCode.SCALED, **values, unit=unit),)


def _mass(
    saved: SavedModel, of_model: float | None, record: Record, here: float | None
) -> float | None:
    """Return the mass for a record [F s^2/m]; for a coefficient it is over the normal force, so it
    is scaled by the ratio of both normal stresses, as the stiffness."""
    before = saved.normal_stress()
    if of_model is None or record.friction_unit != "1" or not before or not here:
        return of_model
    return of_model if alike(before, here) else of_model * before / here


def _start(setting: _SliderSetting, name: str) -> np.ndarray:
    model, values = setting.problem.model, setting.saved.values(name)
    if isinstance(model, EncompassingModel):
        nulls = zip(model.names()[len(model.base.names()) :], model.nulls(), strict=True)
        values = {**dict(nulls), **values}
    return setting.problem.coordinates.to_free(np.asarray([values[n] for n in model.names()]))


def _fitted(setting: _SliderSetting, name: str) -> tuple[str, ...]:
    """Return the parameters of the model that were fitted to its own record, without stiffness."""
    names = setting.problem.model.names()
    return tuple(n for n in setting.saved.tables()[name]["free"] if n in names)


def _descend(setting: _SliderSetting, z: np.ndarray, free: tuple[str, ...]) -> _Found:
    """Fit the parameters `free`, and step times that affect the record, by least squares."""
    problem, names = setting.problem, setting.problem.model.names()
    if unknown := [name for name in free if name not in names]:
        raise InputError(
            f"{option('refit')}: {', '.join(unknown)} is no parameter of this model; they are"
            f" {', '.join(names)}"
        )
    shifts = range(len(names), len(z))
    index = np.asarray([*(names.index(name) for name in free), *shifts], int)
    if len(index):
        z = np.asarray(descend(problem, z, index, most=_TRIALS).z)
    _, residual, jacobian, *_ = known_at(problem, z)  # derivatives also by the fixed parameters
    rows = residual[: len(setting.record)]
    error = np.where(np.abs(rows) >= FAILED_MISFIT, np.nan, rows) * float(problem.noise_scale)
    values = dict(zip(names, problem.coordinates.from_free(np.asarray(z)).tolist(), strict=True))
    return _Found(z, values, error, jacobian)


def _moved(setting: _SliderSetting, name: str, refit: _Found) -> np.ndarray:
    """Return the indices of the fitted parameters and of the step times in z."""
    names = setting.problem.model.names()
    fitted = [names.index(n) for n in _fitted(setting, name)]
    return np.asarray(fitted + list(range(len(names), len(refit.z))), int)


def _noise(setting: _SliderSetting, name: str, refit: _Found) -> SliderNoise:
    """Return the noise of this record."""
    problem = setting.problem
    columns = refit.jacobian[: problem.time.shape[0], _moved(setting, name, refit)]
    step = np.searchsorted(setting.steps.times, setting.record.relative_time, side="right") - 1
    residual = refit.error / float(problem.noise_scale)
    return noise_of_record(problem, np.maximum(step, 0), residual, columns)


def _spread(setting: _SliderSetting, name: str, refit: _Found, noise: Noise) -> np.ndarray:
    """Return the covariance (q, q) of the refit in z under the noise of this record."""
    problem, index = setting.problem, _moved(setting, name, refit)
    columns = jnp.asarray(refit.jacobian[:, index])
    n = problem.time.shape[0]
    middle = np.array(sandwich(problem.clock, columns[:n], noise))
    held = range(len(_fitted(setting, name)), len(index))
    middle[held, held] += 1.0
    return spread_of(columns, middle)


def _chance(
    setting: _SliderSetting,
    name: str,
    refitted: tuple[str, ...],
    found: _Found,
    refit: _Found,
    spread: np.ndarray,
) -> float:
    """Return the smaller chance of two tests, if no parameter has changed: that a refit lowers the
    error as much, and that it shifts the parameters as far.

    Both tests (`prediction.chance`) take the difference of two estimates of the parameters that
    only the refit moves, with the errors of both. The curvature is that of the residual beside the
    directions that both move. The second test counts parameters that the model's own record
    determines. A parameter at its bound is left out: to first order it moves nothing.
    """
    problem, table = setting.problem, setting.saved.tables()[name]
    index, fitted = _moved(setting, name, refit), _fitted(setting, name)
    ends = [np.asarray(problem.coordinates.slopes(jnp.asarray(z))) for z in (found.z, refit.z)]
    slopes = np.stack(ends)[:, index[: len(fitted)]]
    inside = np.all(slopes > 0, axis=0)
    own = [k for k, parameter in enumerate(fitted) if parameter not in refitted and inside[k]]
    if not own:
        return 1.0
    places = [table["free"].index(fitted[k]) for k in own]
    before = np.nan_to_num(np.asarray(table["covariance"], float)[np.ix_(places, places)])
    own_spread = spread[np.ix_(own, own)]
    errors = [before / np.outer(slope, slope) + own_spread for slope in slopes[:, own]]
    columns = refit.jacobian[:, index]
    both = orthonormal(np.delete(columns, own, axis=1))
    alone = columns[:, own] - both @ (both.T @ columns[:, own])
    gain = float(np.sum(found.error**2 - refit.error**2)) / float(problem.noise_scale) ** 2
    unknown = setting.saved.undetermined()
    known = [k for k, place in enumerate(own) if fitted[place] not in unknown]
    apart = (refit.z - found.z)[index[own]][known]
    return min(
        chance_of_gain(gain, alone.T @ alone, errors[0]),
        chance_of_shifts(apart, [C[np.ix_(known, known)] for C in errors]),
    )


def _shifts(
    setting: _SliderSetting, name: str, refit: _Found, spread: np.ndarray
) -> tuple[Shift, ...]:
    """Return shifts of the parameters; `spread` is the covariance of the refit. The error is nan
    where the model's own record does not determine the parameter."""
    unknown = setting.saved.undetermined()
    table, model = setting.saved.tables()[name], setting.saved.values(name)
    free, index = _fitted(setting, name), _moved(setting, name, refit)
    deviations = np.sqrt(np.maximum(np.diag(spread), 0.0))
    out, of = [], setting.problem.coordinates
    for k, parameter in enumerate(free):
        here = refit.z[index[k]]
        ends = []
        for z in (here - deviations[k], here + deviations[k]):
            moved = jnp.asarray(refit.z).at[index[k]].set(z)
            ends.append(float(of.from_free(moved)[index[k]]))
        std = table["parameters"][parameter].get("std") or 0.0
        own = math.nan if parameter in unknown else std
        error = float(np.hypot(own, 0.5 * abs(ends[1] - ends[0])))
        out.append(Shift(parameter, model[parameter], refit.values[parameter], error))
    return tuple(out)


def _notes(setting: _SliderSetting, free: Sequence[str], noise: RecordNoise) -> tuple[Warned, ...]:
    told = warned(NoteCode.FITTED, parameters=free) if free else warned(NoteCode.NOTHING)
    times = (warned(NoteCode.STEPS),) if len(setting.problem.shifted) else ()
    return (told, *setting.stiffness_note, *times, warned(NoteCode.NOISE, **noise._asdict()))


def _warnings(setting: _SliderSetting) -> tuple[str, ...]:
    """Return the warnings of the model, and of extrapolation beyond its own record."""
    saved = setting.saved
    told = list(saved.warnings())
    slowest, fastest = saved.speeds()
    speeds = np.abs(setting.steps.velocities)
    speeds = speeds[speeds > 0]
    beyond = (speeds > _BEYOND * fastest) | (speeds < slowest / _BEYOND)
    if beyond.any():
        which = np.unique(speeds[beyond].round(12))[:6].tolist()
        values = {"velocities": which, "slowest": slowest, "fastest": fastest}
        told.append(warned(WarningCode.OTHER_VELOCITIES, **values))
    return tuple(told)


def _limits(judged: SliderNoise) -> tuple[str, ...]:
    """Return a warning of noise that is as slow as the search allows."""
    if judged.slow is None:
        return ()
    return (warned(WarningCode.SLOW_NOISE, memory=judged.slow.text()),)


def _of_record(setting: _SliderSetting) -> tuple[str, ...]:
    """Return the warnings of a record that does not begin steadily, or has a changing stress."""
    record, friction = setting.record, setting.sign * setting.record.friction
    told = unsteady_start(record.relative_time, friction, setting.steps, setting.stiffness)
    return told if setting.problem.normal_stress is not None else (*told, *changed_stress(record))
