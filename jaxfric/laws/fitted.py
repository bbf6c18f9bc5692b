"""The friction law of a fitted result: a fit, a posterior or a loop.

The law contains the friction effects: second_state, ageing, velocity_dependent_L, evolution_cutoff,
viscous, stribeck, thermal, frictional_delay and others of the catalogue. The law does not contain
effects that depend on position, since such effects allow no steady sliding:

    slip_trend          s x
    run_in              d (1 - exp(-x/dc))
    position_periodic   a sin(2 pi x/lambda) + b cos(2 pi x/lambda)

and, for an axis, gravity and position_dependence. Near a position x, an effect that depends on
position acts as a spring of stiffness f_x in parallel with k_p. The stiffness f_x of the effect
only shifts every stability threshold of k_p by -f_x. A warning of the law gives the lowest
stiffness f_x. The law omits normal_stress, because normal_stress acts only while the normal force
changes. The law omits time_drift, because time_drift depends on the time of the record.

Effects of drive, machine and sensor belong to the apparatus, not to friction. Apparatus effects are
machine stiffness, machine damping, drive lag, and the force sensor's lag, delay, drift and gain.
The fit determines apparatus effects together with the law. So the parameters of the law are already
corrected for the apparatus.

For an axis the law is an `AxisLaw`: friction and its states near a steady velocity, in one
direction. The gains of an axis are computed from an `AxisLaw` too. Without rate_and_state, axis
friction has no memory in steady motion, because a bristle stays bent. If friction of an axis has no
memory, the axis has no critical stiffness, so its law is refused.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..coordinate import Coordinate, unit_of
from ..effects import AbstractEffect, AbstractPlaceEffect, made, parameters
from ..effects.axis import DirectionAsymmetry, RateAndState
from ..errors import InputError, either, option
from ..findings import WarningCode, warned
from ..quantity import Quantity, numbered_names, quantities
from ..rig import QuasiStatic, Rig
from ..rig.axis import LAW, AxisRig, BaseLaw
from ..rig.axis_law import AxisLaw, axis_law
from ..rig.friction import AbstractLaw
from ..rig.friction.extended import ExtendedLaw
from .registry import law_quantity, rate_state
from .source import LawSource, taken
from .thresholds import NARROWER, NO_WIDTH

Effects = Sequence[type[AbstractEffect]]
Parameters = dict[str, Array]

_BASE = BaseLaw().names()
_WHILE = ("normal_stress", "time_drift")
"""Friction effects that vanish in steady motion."""
_ROOMS = {"machine": "machine", "drive": "drive", "sensor": "force sensor"}
_DIRECT = f"{RateAndState.id}.A"


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """Fitted parameters of a friction law, with errors and warnings.

    SI, forces in `friction_unit`. A `FittedLaw` may include parameters of drive, machine and sensor
    that were fitted together with the law.
    """

    where: str
    """Origin, for messages: a file, or a result in memory."""
    name: str
    """A rate-and-state law of the registry, or "coulomb_viscous" of an axis."""
    states: int
    """Number of states of the law without effects; 0 for an axis."""
    friction_unit: str
    """Unit of its forces: "1" (friction coefficient), "N", "N m" or "%"."""
    coordinate: Coordinate
    origin: str
    """How the parameters were obtained, in words: "1 state(s), fitted"."""
    effects: Effects
    parameters: Mapping[str, float]
    """Values by name: f0, A, B, L, B2, ..., V0 (slider) or M, F_v, F_c, F_0 (axis), and
    effect.parameter."""
    free: Sequence[str]
    """Parameters that have an error, in the order of `covariance`."""
    covariance: np.ndarray
    """Covariance of the `free` parameters (p, p)."""
    loose: Sequence[str]
    """Parameters that the record does not determine."""
    velocity: tuple[float, float] | None
    """Lowest and highest velocity of the record [m/s]."""
    width: float
    """Width of the smoothed sign of an axis' record [m/s]; 0: not known."""
    reach: float
    """Distance between two rows where the axis is slowest [m]."""
    warnings: Sequence[str]
    """Warnings to read before using the law, one line each."""
    draws: Mapping[str, np.ndarray] | None = None
    """Draws (n,) of parameters, instead of the covariance."""

    @property
    def is_axis(self) -> bool:
        """Whether the law was fitted to a servo axis."""
        return self.name == LAW

    def quantities(self) -> dict[str, Quantity]:
        """Symbol, unit and bounds by name, for the parameters of the base law and its effects."""
        if self.is_axis:
            base = {q.symbol: q for q in quantities(AxisRig).values() if q.symbol in _BASE}
        else:
            names = ("f0", "A", *numbered_names(self.states), "V0")
            base = {name: law_quantity(name) for name in names}
        own = {f"{e.id}.{n}": q for e in self.effects for n, q in parameters(e).items()}
        return base | own


def law_of(
    fitted: FittedLaw, *, normal_force: float | None = None, samples: int = 64, seed: int = 0
) -> LawSource:
    """Return the law in newtons or newton metres, with samples drawn from the parameter errors.

    A slip law whose only effect is a second state becomes a `RateState` with two states. With
    friction effects besides a second state the result is an `ExtendedLaw`. The direct effect is
    regularised, so the law is also defined at rest. For an axis

        f = F_v v + F_c + terms(v) + A ln(1 + v/v_c) + theta,
        theta' = (v/L)(-B ln(1 + v/v_c) - theta),   v > 0

    If friction depends on direction (direction_asymmetry), the law describes the direction with
    less viscous friction. The direction is chosen for each sample separately.

    Free parameters are drawn from a normal distribution with their covariance. Parameters with a
    lower bound (A, L) are drawn in the logarithm. If `fitted.draws` exist, each sample is one of
    these draws, chosen without replacement. So the samples keep the correlations between
    parameters. `warnings` lists the warnings of `fitted`, then the effects that the law omits.

    Parameters
    ----------
    normal_force : [N], multiplies a friction coefficient; required for a fit of a coefficient,
        refused for a fit of a force.
    samples : number of samples, not counting the estimate. seed : of the draws.

    Raises
    ------
    InputError : a normal force missing or not wanted; a parameter out of bounds; undetermined
        parameters; fewer draws than samples; an axis without rate_and_state, or with forces in
        per cent of an unknown torque.

    Lags and sampling of an axis' drive, which demand larger gains, are not considered.
    """
    if fitted.is_axis:
        _refuse_other(fitted)
    scale = force_of_unit(fitted.friction_unit, normal_force, fitted.where)
    inside = [effect for effect in fitted.effects if in_law(effect)]
    build = _axis(fitted, inside) if fitted.is_axis else _slider(fitted, inside, scale)
    columns = _columns(fitted, _positive(fitted), samples, seed)
    names = tuple(columns)

    def one(row: Array) -> AbstractLaw:
        return build(dict(zip(names, row, strict=True)))

    laws = eqx.filter_jit(eqx.filter_vmap(one))(jnp.asarray(np.stack([*columns.values()], -1)))
    found = f" with {', '.join(effect.id for effect in inside)}" if inside else ""
    kind = "friction of an axis" if fitted.is_axis else f"{fitted.name} law"
    return LawSource(
        taken(laws, 0),
        laws,
        f"{kind}{found}, {fitted.origin}: {fitted.where}",
        fitted.parameters.get("V0"),
        (*fitted.warnings, *left_out(fitted, scale)),
        fitted.velocity,
        _mass(fitted, scale),
        fitted.coordinate,
    )


def _mass(fitted: FittedLaw, scale: float) -> float | None:
    """Return the mass [kg] of a fitted axis, or that stated for the fit of a slider; None without
    mass. For a coefficient the fit has the mass over the normal force `scale` [N]."""
    own = fitted.parameters.get("m")
    return fitted.parameters.get("M") if own is None else scale * own


def force_of_unit(unit: str, normal_force: float | None, where: str) -> float:
    """Return the factor that converts forces of a file from `unit` ("1" or "N") to newtons.

    Raises
    ------
    InputError : a normal force [N] is missing or not wanted.
    """
    if unit == "1" and normal_force is None:
        raise InputError(
            f"{where}: this is a fit of a friction coefficient; give the normal force that converts"
            f" it to newtons, as in {either(option('normal-force', '500 N'), 'normal_force=500')}"
        )
    if unit != "1" and normal_force is not None:
        raise InputError(
            f"{where}: this is a fit of a force, so {option('normal-force')} is not wanted"
        )
    return 1.0 if normal_force is None else normal_force


def in_law(effect: type[AbstractEffect]) -> bool:
    """Whether the law contains an effect: the effect is of friction and acts in steady motion."""
    place = issubclass(effect, AbstractPlaceEffect)
    return effect.room == "friction" and not place and effect.id not in _WHILE


def left_out(fitted: FittedLaw, scale: float = 1.0) -> tuple[str, ...]:
    """Return one line for each effect that the law omits, with the reason. For an effect that acts
    as a spring, the line gives the spring stiffness [N/m] and advice. One unit of force in `fitted`
    equals `scale` newtons."""
    lines = []
    for effect in fitted.effects:
        own = {name: fitted.parameters[f"{effect.id}.{name}"] for name in parameters(effect)}
        if issubclass(effect, AbstractPlaceEffect):
            spring = scale * float(made(effect, own).softest_spring())
            unit = unit_of("N/m", fitted.coordinate)
            about = {"stiffness": spring, "more": -spring, "unit": unit}
            code = WarningCode.STIFFENS if spring >= 0 else WarningCode.SOFTENS
            lines += [warned(code, effect=effect.id, **about)] if spring else []
        elif effect.room != "friction":
            room = effect.room if fitted.is_axis else _ROOMS.get(effect.room)
            lines.append(warned(WarningCode.OF_RECORD, effect=effect.id, room=room))
        elif effect.id in _WHILE:
            lines.append(warned(WarningCode.VANISHES, effect=effect.id))
        elif effect is DirectionAsymmetry:
            way = "backwards" if own["d"] > 0 else "forwards"
            lines.append(warned(WarningCode.DIRECTION, effect=effect.id, direction=way))
    return tuple(lines)


def _slider(
    fitted: FittedLaw, inside: Effects, scale: float
) -> Callable[[Parameters], AbstractLaw]:
    """Return a function from parameters by name to a slider's law, forces times `scale`."""
    two = fitted.name == "slip" and [effect.id for effect in inside] == ["second_state"]
    states = fitted.states + two

    def build(p: Parameters) -> AbstractLaw:
        if two:
            p = p | {f"{letter}{states}": p[f"second_state.{letter}2"] for letter in "BL"}
        law = rate_state(fitted.name, p, states, scale=scale)
        if two or not inside:
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

    return build


def _axis(fitted: FittedLaw, inside: Effects) -> Callable[[Parameters], AxisLaw]:
    """Return a function from parameters by name to an axis' law."""
    mass, width = fitted.parameters["M"], fitted.width or NO_WIDTH
    asymmetry = f"{DirectionAsymmetry.id}.d"

    def build(p: Parameters) -> AxisLaw:
        rig = AxisRig(mass, *(p[n] for n in _BASE[1:]), width=width, reach=fitted.reach)
        for effect in inside:
            fields = {name: p[f"{effect.id}.{name}"] for name in parameters(effect)}
            rig = made(effect, fields).embed(rig)
        direction = jnp.where(p[asymmetry] > 0, -1.0, 1.0) if asymmetry in p else 1.0
        return axis_law(rig, 0.0, direction, width=NARROWER * width)

    return build


def _refuse_other(fitted: FittedLaw) -> None:
    """Raise `InputError` for an axis without SI forces, without memory or without A > 0."""
    force = unit_of("N", fitted.coordinate)
    if fitted.friction_unit != force:
        raise InputError(
            f"{fitted.where}: it is of an axis whose forces are in {fitted.friction_unit}, and"
            " gains, margins and motions are computed in newtons or newton metres only; what it"
            " asks for in its own units stands under Gains in its loop.html and loop.json"
        )
    if RateAndState not in fitted.effects:
        raise InputError(
            f"{fitted.where}: it is of an axis, and its loop found no rate_and_state, the effect by"
            " which friction in steady motion has a memory: without one no stiffness is critical."
            " What damping its curve asks for, or why nothing is said of it, stands under Gains in"
            " its loop.html and loop.json"
        )
    if not fitted.parameters[_DIRECT] > 0:
        raise InputError(
            f"{fitted.where}: parameter {_DIRECT}: the direct effect is"
            f" {fitted.parameters[_DIRECT]:g} {force}; without one above 0 sliding with a memory is"
            " ill-posed"
        )


def _positive(fitted: FittedLaw) -> dict[str, bool]:
    """Check the law's parameters; return by name whether each is positive by definition."""
    ids = ["", *(effect.id for effect in fitted.effects if in_law(effect))]
    found = {}
    for name, about in fitted.quantities().items():
        if name.rpartition(".")[0] in ids and name != "M":
            about.check(fitted.parameters[name], f"{fitted.where}: parameter {name}")
            found[name] = about.lower >= 0.0 or name == _DIRECT
    return found


def _columns(
    fitted: FittedLaw, positive: Mapping[str, bool], samples: int, seed: int
) -> dict[str, np.ndarray]:
    """Return columns (samples + 1,) for the parameters in `positive`: the estimate, then the draws.

    Other free parameters are marginalised.
    """
    columns = {name: np.full(samples + 1, fitted.parameters[name]) for name in positive}
    index = [i for i, name in enumerate(fitted.free) if name in positive]
    free = [fitted.free[i] for i in index]
    drawn: Mapping[str, np.ndarray] = {}
    if fitted.draws is not None:
        number = len(next(iter(fitted.draws.values())))
        if samples > number:
            raise InputError(
                f"{fitted.where}: it has {number} draws; use {option('samples', number)} or"
                " fewer, or draw more"
            )
        chosen = np.sort(np.random.default_rng(seed).choice(number, samples, replace=False))
        drawn = {n: draws[chosen] for n, draws in fitted.draws.items() if n in positive}
    elif samples and free:
        covariance = fitted.covariance[np.ix_(index, index)]
        loose = [name for name in free if name in fitted.loose]
        if loose or not np.all(np.isfinite(covariance)):
            names = ", ".join(loose) or "a parameter"
            raise InputError(
                f"{fitted.where}: the fit leaves {names} undetermined, so nothing can be sampled;"
                f" use {option('samples', '0')} for the estimate alone, or a record that fixes it"
            )
        mean = np.asarray([fitted.parameters[name] for name in free])
        above = np.asarray([positive[name] for name in free])
        draws = draw_samples(mean, covariance, above, samples, seed)
        drawn = dict(zip(free, draws.T, strict=True))
    for name, draws in drawn.items():
        columns[name][1:] = draws
    return columns


def draw_samples(
    mean: np.ndarray, covariance: np.ndarray, positive: np.ndarray, samples: int, seed: int
) -> np.ndarray:
    """Draw parameters (samples, p) from a normal (where `positive`, a log-normal) distribution.

    `mean` and `covariance` are in SI; the covariance may be singular.
    """
    jacobian = np.where(positive, 1 / np.where(positive, mean, 1.0), 1.0)
    spread = covariance * np.outer(jacobian, jacobian)
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    lowered, vectors = np.linalg.eigh(spread / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(lowered, 0.0))
    z = np.random.default_rng(seed).standard_normal((samples, len(mean))) @ root.T
    return np.where(positive, mean * np.exp(np.where(positive, z, 0.0)), mean + z)
