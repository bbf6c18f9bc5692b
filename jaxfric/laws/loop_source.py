"""The friction law that `jaxfric loop` of a slider ends with: the base and the effects found.

Effects in the room of friction are in the law: second_state, ageing, velocity_dependent_L,
evolution_cutoff, viscous, stribeck, thermal, frictional_delay and what the catalogue has of
others. Three of them are not, because they depend on where the slider is, so that no steady
sliding exists with them:

    slip_trend          s x
    run_in              d (1 - exp(-x/dc))
    position_periodic   a sin(2 pi x/lambda) + b cos(2 pi x/lambda)

About a place x each is a spring of stiffness f_x beside k_p, which moves every threshold of k_p
by -f_x and changes nothing else. The softest that it can be is told with the law. And
normal_stress acts only while the normal force changes.

Effects in other rooms belong to the apparatus that made the record, not to friction: stiffness and
damping of its machine, the lag of its drive, lag, delay, drift and gain of its force sensor. The
law's parameters are those fitted together with them, so it is already free of them.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..coordinate import Coordinate
from ..effects import AbstractEffect, AbstractPlaceEffect, effect_of, made, parameters
from ..effects.axis import DirectionAsymmetry
from ..effects.friction import SlipTrend
from ..errors import InputError
from ..quantity import Quantity, numbered_names
from ..rig import QuasiStatic, Rig
from ..rig.axis import AxisRig
from ..rig.friction import AbstractLaw
from ..rig.friction.extended import ExtendedLaw
from .registry import (
    count_states,
    is_rate_state,
    law_quantity,
    rate_state,
)
from .saved import (
    LOOP,
    Saved,
    content_of,
    missing_key,
    own_warnings,
    refuse_damage,
    sampled,
    table_damage,
    values_of,
)
from .source import LawSource, first_of, force_of_unit, left_out_words, seen_velocities

CERTAIN = ("no_missing_effect", "effects", "ambiguous")
"""Verdicts whose model describes the record."""

_WHILE = {
    "normal_stress": "it acts only while the normal force changes",
    "time_drift": "it is of the time of the record",
}
"""Effects in friction that steady motion does not have, and why."""
_APPARATUS = "it belongs to the {room} of the record; the law was fitted together with it"
_ROOMS = {"machine": "machine", "drive": "drive", "sensor": "force sensor"}


def law_from_loop(
    source: Saved, *, normal_force: float | None = None, samples: int = 64, seed: int = 0
) -> LawSource:
    """The law after the loop of a Loop, or of its `loop.json`, in newtons, and samples of it.

    A slip law with no effect but a second state is a `RateState` of two states; with any other
    effect of friction it is an `ExtendedLaw`. The direct effect is the regularised one. The
    samples are drawn as by `law_of_fit`, from the covariance of the extended fit. What the loop
    itself warned of, what is left out of the law, and a verdict by which it does not describe the
    record, are in `warnings`.

    Parameters
    ----------
    normal_force : [N], as in `law_of_fit`.
    samples : number drawn besides the estimate.

    Raises
    ------
    InputError : file missing, damaged or of another schema; an effect that is not in the
        catalogue, a parameter out of bounds; a normal force missing or not wanted; parameters
        that the fit left undetermined.
    """
    path, content = content_of(source, LOOP)
    if content.get("law") == "coulomb_viscous":
        raise InputError(
            f"{path}: it is of an axis; its law is read by law_from_axis_loop, and by every verb of"
            " the command"
        )
    refuse_damage(path, LOOP, _damage(content))
    scale = force_of_unit(content["friction_unit"], normal_force, path)
    after = content["after"]
    values = values_of(after)
    effects = effects_in(path, content["effects"], values)
    states = count_states(content["law"], values)
    positive = _positive(path, effects, states, values)
    columns = sampled(after, positive, samples, seed, path)
    names = tuple(columns)
    velocity = float(values["V0"] if "V0" in values else content["reference_velocity"])

    def build(row: Float[Array, " p"]) -> AbstractLaw:
        p = dict(zip(names, row, strict=True))
        p.setdefault("V0", jnp.asarray(velocity, float))
        return _law(p, content["law"], states, effects, scale)

    found = [effect.id for effect in effects if in_law(effect)]
    text = f"{content['law']} law" + (f" with {', '.join(found)}" if found else "")
    text += f", from the loop ({content['verdict']}): {path}"
    laws = eqx.filter_jit(eqx.filter_vmap(build))(jnp.asarray(np.stack([*columns.values()], -1)))
    told = effects
    if "slip_trend" in values:  # declared in the base law itself
        told, values = (*effects, SlipTrend), {**values, "slip_trend.s": values["slip_trend"]}
    without = left_out(told, values, apparatus=_APPARATUS, scale=scale)
    return LawSource(
        first_of(laws),
        laws,
        text,
        velocity,
        (*own_warnings(content), *verdict_words(content), *without),
        seen_velocities([step[-1] for step in content.get("steps", []) if isinstance(step, list)]),
    )


def _law(
    p: dict[str, Array],
    kind: str,
    states: int,
    effects: Sequence[type[AbstractEffect]],
    scale: float,
) -> AbstractLaw:
    """The law of one set of parameters, SI and the unit of the fit."""
    inside = [effect for effect in effects if in_law(effect)]
    if kind == "slip" and [effect.id for effect in inside] == ["second_state"]:
        states += 1
        p |= {f"{letter}{states}": p[f"second_state.{letter}2"] for letter in "BL"}
        inside = []
    law = rate_state(kind, p, states, scale=scale)
    if not inside:
        return law
    rig = Rig(QuasiStatic(1.0), law)
    for effect in inside:
        fields = {
            name: p[f"{effect.id}.{name}"] * (scale if about.unit.startswith("F") else 1.0)
            for name, about in parameters(effect).items()
        }
        rig = made(effect, fields).embed(rig)
    assert isinstance(rig.friction, ExtendedLaw)
    return rig.friction


def in_law(effect: type[AbstractEffect]) -> bool:
    """Whether an effect belongs to friction in steady motion."""
    place = issubclass(effect, AbstractPlaceEffect)
    return effect.room == "friction" and not place and effect.id not in _WHILE


def effects_in(
    path: Path, ids: list[str], values: Mapping[str, float], rig: type[Rig] | type[AxisRig] = Rig
) -> tuple[type[AbstractEffect], ...]:
    """The effects found, and those that the base was declared with, in order."""
    declared = [name.split(".")[0] for name in values if "." in name]
    chosen = []
    for id in dict.fromkeys([*ids, *declared]):
        try:
            effect = effect_of(id, rig)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        for field in parameters(effect):
            if f"{id}.{field}" not in values:
                refuse_damage(path, LOOP, f"parameter {id}.{field} is missing")
        chosen.append(effect)
    return tuple(chosen)


def _positive(
    path: Path, effects: Sequence[type[AbstractEffect]], states: int, values: Mapping[str, float]
) -> dict[str, bool]:
    """The parameters of the law, and which of them are positive; all are checked."""
    about = {name: law_quantity(name) for name in ("f0", "A", *numbered_names(states))}
    if "V0" in values:
        about["V0"] = law_quantity("V0")
    for effect in effects:
        if in_law(effect):
            about |= {f"{effect.id}.{n}": q for n, q in parameters(effect).items()}
    return checked(path, about, values)


def checked(
    path: Path, about: Mapping[str, Quantity], values: Mapping[str, float]
) -> dict[str, bool]:
    """Whether each parameter of a law is positive. Raises `InputError` for one out of bounds."""
    for name, quantity in about.items():
        quantity.check(values[name], f"{path}: parameter {name}")
    return {name: quantity.lower >= 0.0 for name, quantity in about.items()}


def loop_damage(content: dict) -> str | None:
    """The fault of a loop.json of any rig, in words: what is missing or wrong."""
    problem = missing_key(content, ("law", "friction_unit", "verdict", "effects", "after"))
    keys = ("parameters", "free", "covariance")
    problem = problem or missing_key(content["after"], keys, "after.")
    if problem:
        return problem
    ids = content["effects"]
    if not isinstance(ids, list) or not all(isinstance(id, str) for id in ids):
        return "the effects are no list of names"
    return None


def _damage(content: dict) -> str | None:
    """The fault of a slider's loop.json, in words."""
    problem = loop_damage(content)
    if problem:
        return problem
    if not is_rate_state(content["law"]):
        return f"law '{content['law']}' is not known"
    problem = table_damage(content["after"], ())
    if problem:
        return problem
    known = content["after"]["parameters"]
    needed = ("f0", "A", *numbered_names(count_states(content["law"], known)))
    missing = next((name for name in needed if name not in known), None)
    if missing:
        return f"parameter {missing} is missing"
    velocity = known["V0"]["value"] if "V0" in known else content.get("reference_velocity")
    if isinstance(velocity, bool) or not isinstance(velocity, int | float) or not velocity > 0:
        return "the reference velocity is no positive number"
    return None


def verdict_words(content: Mapping) -> list[str]:
    """A warning where by its verdict a loop.json's model does not describe the record."""
    if content["verdict"] in CERTAIN:
        return []
    sentence = str(content.get("sentence") or "").strip().rstrip(".")
    more = f" ({sentence})" if sentence else ""
    text = (
        f"the loop's verdict is {content['verdict']}{more}: the law of its last model is used,"
        " which does not describe the record"
    )
    errors = [
        ((content.get(when) or {}).get("in_sigma") or {}).get("report")
        for when in ("before", "after")
    ]
    before, after = (float(x) if isinstance(x, int | float) else np.nan for x in errors)
    if content.get("effects") and after > before:
        text += (
            f"; rows that were never fitted it predicts worse than the base does ({after:.2f} sigma"
            f" for {before:.2f}): run the loop again without an effect (--without)"
        )
    return [text]


def left_out(
    effects: Sequence[type[AbstractEffect]],
    values: Mapping[str, float],
    *,
    apparatus: str,
    scale: float = 1.0,
    moves: str = "slider",
    coordinate: Coordinate = "linear",
) -> list[str]:
    """Warnings of effects that are not in the law, with the reason; of those in other rooms it is
    the text `apparatus`, with the room put in."""
    lines = []
    for effect in effects:
        id = effect.id
        if issubclass(effect, AbstractPlaceEffect):
            own = {name: values[f"{id}.{name}"] for name in parameters(effect)}
            spring = scale * float(made(effect, own).softest_spring())
            lines.append(left_out_words(id, spring, moves, coordinate))
        elif not in_law(effect):
            room = effect.room if moves == "axis" else _ROOMS.get(effect.room)
            why = _WHILE[id] if effect.room == "friction" else apparatus.format(room=room)
            lines.append(f"{id} is left out of the law: {why}")
        elif effect is DirectionAsymmetry:
            way = "backwards" if values[f"{id}.d"] > 0 else "forwards"
            lines.append(
                f"{id}: the law is that of motion {way}, where viscous friction is less; a sample"
                " takes its own worse direction"
            )
    return lines
