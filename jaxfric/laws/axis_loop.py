"""The friction law of the loop.json of an axis whose friction remembers the distance.

What `jaxfric.gains` takes is friction of one direction about a steady velocity, with its states:
the `AxisLaw` by which the axis' own gains are computed, with the parameters of the loop's last
model. In the law are viscous and Coulomb friction, the offset, and the effects that are a curve of
the velocity or a state. Not in it, each with a line that says so, are

    gravity, position_periodic, position_dependence    springs beside k_p, as far as it stands still
    time_drift                                         what the record's time did
    servo_lag, sensor_lag, sensor_delay    the apparatus; the law was fitted together with it

Friction without rate_and_state has no memory about steady motion, where a bristle stays bent: no
stiffness is critical then, and the file itself says what damping it asks for.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..coordinate import Coordinate, unit_of
from ..effects import AbstractEffect, made
from ..effects.axis import DirectionAsymmetry, RateAndState
from ..errors import InputError
from ..quantity import quantities
from ..rig.axis import LAW, AxisRig, BaseLaw
from ..rig.axis_law import AxisLaw, axis_law
from .loop_source import checked, effects_in, in_law, left_out, loop_damage, verdict_words
from .saved import (
    LOOP,
    Saved,
    content_of,
    own_warnings,
    refuse_damage,
    sampled,
    table_damage,
    values_of,
)
from .source import LawSource, first_of, force_of_unit, seen_velocities

Effects = Sequence[type[AbstractEffect]]

_CURVE = BaseLaw().names()[1:]
_APPARATUS = (
    "it belongs to the {room} of the record, and the law was fitted together with it; a lag that"
    " stays asks for larger gains"
)
_DIRECT = f"{RateAndState.id}.A"
# Width of the law's smoothed sign over that of the record, so that it is sharp wherever the
# record has rows that count, and can still be simulated through rest.
_NARROWER = 0.05
# Where a file names no width [m/s].
_NO_WIDTH = 1e-6


def _coordinate(content: Mapping) -> Coordinate:
    rotary = (content.get("axis") or {}).get("coordinate", "linear") != "linear"
    return "rotary" if rotary else "linear"


def is_of_axis(content: Mapping) -> bool:
    """Whether the content of a loop.json is of a servo axis."""
    return content.get("law") == LAW


def law_from_axis_loop(
    source: Saved, *, normal_force: float | None = None, samples: int = 64, seed: int = 0
) -> LawSource:
    """The law after the loop of an axis in N or N m, and samples of its parameters.

        f = F_v v + F_c + terms(v) + A ln(1 + v/v_c) + theta,
        theta' = (v/L)(-B ln(1 + v/v_c) - theta),   v > 0

    Where friction differs by direction (direction_asymmetry) it is that of the direction with less
    viscous friction, of each sample its own. The samples are drawn as by `gains.law_from_loop`; a
    length, a velocity and A by their logarithms. Where the loop says nothing of stability its
    sentence is among the `warnings`, beside what is left out.

    Parameters
    ----------
    normal_force : not wanted: the parameters are forces.
    samples : number drawn besides the estimate.

    Raises
    ------
    InputError : file missing, damaged or of another schema; no rate_and_state in its last model;
        forces in per cent of an unknown torque; a parameter out of bounds or undetermined.

    Not tried: the lags and the sampling of the drive, which ask for more.
    """
    path, content = content_of(source, LOOP)
    refuse_damage(path, LOOP, _damage(content))
    after, about = content["after"], content.get("axis") or {}
    values = values_of(after)
    effects = effects_in(path, content["effects"], values, AxisRig)
    _refuse_other(path, content, effects)
    force_of_unit(content["friction_unit"], normal_force, path)
    coordinate = _coordinate(content)
    inside = [effect for effect in effects if in_law(effect)]
    columns = sampled(after, _positive(path, inside, values, coordinate), samples, seed, path)
    width, reach = (float(about.get(key) or 0.0) for key in ("width", "reach"))
    build = _builder(inside, tuple(columns), values["M"], width or _NO_WIDTH, reach)
    laws = eqx.filter_jit(eqx.filter_vmap(build))(jnp.asarray(np.stack([*columns.values()], -1)))
    steps = content.get("steps", [])
    return LawSource(
        first_of(laws),
        laws,
        f"friction of an axis with {', '.join(e.id for e in inside)}, from the loop"
        f" ({content['verdict']}): {path}",
        None,
        (
            *own_warnings(content),
            *verdict_words(content),
            *_claim(about),
            *left_out(effects, values, apparatus=_APPARATUS, moves="axis", coordinate=coordinate),
        ),
        seen_velocities([step[-1] for step in steps if isinstance(step, list) and step]),
        values["M"],
        coordinate,
    )


def _builder(
    effects: Sequence[type[AbstractEffect]],
    names: tuple[str, ...],
    mass: float,
    width: float,
    reach: float,
) -> Callable[[Array], AxisLaw]:
    """A function from the values of `names` (SI) to the law."""
    asymmetry = f"{DirectionAsymmetry.id}.d"

    def build(row: Array) -> AxisLaw:
        p = dict(zip(names, row, strict=True))
        rig = AxisRig(mass, *(p[name] for name in _CURVE), width=width, reach=reach)
        for effect in effects:
            fields = {name: p[f"{effect.id}.{name}"] for name in quantities(effect)}
            rig = made(effect, fields).embed(rig)
        direction = jnp.where(p[asymmetry] > 0, -1.0, 1.0) if asymmetry in p else 1.0
        return axis_law(rig, 0.0, direction, width=_NARROWER * width)

    return build


def _damage(content: dict) -> str | None:
    """The fault of an axis's loop.json, in words: what is missing or wrong."""
    problem = loop_damage(content)
    if problem:
        return problem
    about = content.get("axis")
    if about is not None and not isinstance(about, dict):
        return "'axis' is no table"
    for key in ("width", "reach"):
        size = (about or {}).get(key)
        if size is not None and not (isinstance(size, int | float) and 0 <= size < np.inf):
            return f"'axis.{key}' is {size!r}"
    return table_damage(content["after"], BaseLaw().names())


def _refuse_other(path: Path, content: Mapping, effects: Effects) -> None:
    """Raise `InputError` for an axis whose forces have no SI unit, or that needs no search."""
    unit = content["friction_unit"]
    if unit != unit_of("N", _coordinate(content)):
        raise InputError(
            f"{path}: it is of an axis whose forces are in {unit}, and gains, margins and motions"
            " are computed in newtons or newton metres only; what it asks for in its own units"
            " stands under Gains in its loop.html and loop.json"
        )
    if RateAndState not in effects:
        raise InputError(
            f"{path}: it is of an axis, and its loop found no rate_and_state, the effect by which"
            " friction in steady motion has a memory: without one no stiffness is critical. What"
            " damping its curve asks for, or why nothing is said of it, stands under Gains in its"
            " loop.html and loop.json"
        )


def _positive(
    path: Path, effects: Effects, values: Mapping[str, float], coordinate: Coordinate
) -> dict[str, bool]:
    """The parameters of the law, and which of them are positive; all are checked."""
    base = quantities(AxisRig)
    about = {q.symbol: q for q in base.values() if q.symbol in _CURVE}
    for effect in effects:
        about |= {f"{effect.id}.{name}": q for name, q in quantities(effect).items()}
    positive = checked(path, about, values)
    if not values[_DIRECT] > 0:
        raise InputError(
            f"{path}: parameter {_DIRECT}: the direct effect is {values[_DIRECT]:g}"
            f" {unit_of('N', coordinate)}; without one"
            " above 0 sliding with a memory is ill-posed"
        )
    return positive | {_DIRECT: True}


def _claim(about: Mapping) -> list[str]:
    """A warning where the loop itself says nothing of stability, else nothing."""
    gains = about.get("gains")
    if not isinstance(gains, dict) or gains.get("claim") != "open":
        return []
    sentence = " ".join(str(gains.get("sentence") or "Nothing is said of stability.").split())
    return [f"of the axis itself: {sentence}"]
