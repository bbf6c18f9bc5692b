"""The friction law that a record gave, from its parameters: of a fit, a posterior, a loop.

Effects in the room of friction are in the law: second_state, ageing, velocity_dependent_L,
evolution_cutoff, viscous, stribeck, thermal, frictional_delay and what the catalogue has of
others. Some of them are not, because they depend on where the slider is, so that no steady
sliding exists with them:

    slip_trend          s x
    run_in              d (1 - exp(-x/dc))
    position_periodic   a sin(2 pi x/lambda) + b cos(2 pi x/lambda)

and gravity and position_dependence of an axis. About a place x each is a spring of stiffness f_x
beside k_p, which moves every threshold of k_p by -f_x and changes nothing else. The softest that
it can be is told with the law. And normal_stress acts only while the normal force changes,
time_drift with the time of the record.

Effects in other rooms belong to the apparatus that made the record, not to friction: stiffness and
damping of its machine, the lag of its drive, lag, delay, drift and gain of its force sensor. The
law's parameters are those fitted together with them, so it is already free of them.

Of an axis the law is friction of one direction about a steady velocity, with its states: the
`AxisLaw` by which the axis' own gains are computed. Friction without rate_and_state has no memory
about steady motion, where a bristle stays bent: no stiffness is critical then, and it is refused.
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
from ..errors import InputError
from ..quantity import Quantity, numbered_names, quantities
from ..rig import QuasiStatic, Rig
from ..rig.axis import LAW, AxisRig, BaseLaw
from ..rig.axis_law import AxisLaw, axis_law
from ..rig.friction import AbstractLaw
from ..rig.friction.extended import ExtendedLaw
from .registry import law_quantity, rate_state
from .source import LawSource, taken

Effects = Sequence[type[AbstractEffect]]
Parameters = dict[str, Array]

_BASE = BaseLaw().names()
_WHILE = {
    "normal_stress": "it acts only while the normal force changes",
    "time_drift": "it is of the time of the record",
}
"""Effects in friction that steady motion does not have, and why."""
_ROOMS = {"machine": "machine", "drive": "drive", "sensor": "force sensor"}
_DIRECT = f"{RateAndState.id}.A"
# Width of the law's smoothed sign over that of the record, so that it is sharp wherever the
# record has rows that count, and can still be simulated through rest.
_NARROWER = 0.05
# Where the width is not known [m/s].
_NO_WIDTH = 1e-6


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """The parameters of a friction law and their errors, and what to know of them.

    SI, forces in `friction_unit`. Beside those of the law there may be others that were fitted
    together with them.
    """

    where: str
    """Where it is from, for messages: a file, or a result at hand."""
    name: str
    """A rate-and-state law of the registry, or "coulomb_viscous" of an axis."""
    states: int
    """States of the law without effects; 0 of an axis."""
    friction_unit: str
    """Unit of its forces: "1" of a friction coefficient, "N", "N m", "%"."""
    coordinate: Coordinate
    origin: str
    """What it was made by, in words: "1 state(s), fitted"."""
    effects: Effects
    parameters: Mapping[str, float]
    """Values by name: f0, A, B, L, B2, ..., V0 of a slider, M, F_v, F_c, F_0 of an axis, and
    effect.parameter."""
    free: Sequence[str]
    """Parameters that have an error, in the order of `covariance`."""
    covariance: np.ndarray
    """Of the parameters `free` names (p, p)."""
    loose: Sequence[str]
    """Parameters that the record leaves undetermined."""
    velocity: tuple[float, float] | None
    """Slowest and fastest of the record [m/s]."""
    width: float
    """Width of the smoothed sign of an axis' record [m/s]; 0: not known."""
    reach: float
    """Distance between two rows where the axis is slowest [m]."""
    warnings: Sequence[str]
    """Warnings to read before the law is relied on, a line each."""
    draws: Mapping[str, np.ndarray] | None = None
    """Draws (n,) of parameters, instead of the covariance."""

    @property
    def is_axis(self) -> bool:
        """Whether it is of a servo axis."""
        return self.name == LAW

    def quantities(self) -> dict[str, Quantity]:
        """Symbol, unit and bounds of its parameters by name: those of the base and its effects."""
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
    """The law of such parameters in newtons or newton metres, and samples that their errors allow.

    A slip law with no effect but a second state is a `RateState` of two states; with any other
    effect of friction it is an `ExtendedLaw`. The direct effect is the regularised one, so that
    the law can be carried through rest. Of an axis

        f = F_v v + F_c + terms(v) + A ln(1 + v/v_c) + theta,
        theta' = (v/L)(-B ln(1 + v/v_c) - theta),   v > 0

    and where friction differs by direction (direction_asymmetry) it is that of the direction with
    less viscous friction, of each sample its own.

    Free parameters are drawn from their covariance, those with a lower bound (A, L) by their
    logarithm; or they are draws of `fitted.draws`, whole ones, so that parameters stay correlated
    as they are, and each only once. What is left out of the law is told in `warnings`, after
    those of `fitted`.

    Parameters
    ----------
    normal_force : [N], by which a friction coefficient is multiplied; must be given for a fit
        of a coefficient and not for one of a force.
    samples : number drawn besides the estimate. seed : of the draws.

    Raises
    ------
    InputError : a normal force missing or not wanted; a parameter out of bounds; parameters that
        the record left undetermined, fewer draws than samples; an axis without rate_and_state, or
        with forces in per cent of an unknown torque.

    Not tried: the lags and the sampling of an axis' drive, which ask for more.
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
        fitted.parameters.get("M"),
        fitted.coordinate,
    )


def force_of_unit(unit: str, normal_force: float | None, where: str) -> float:
    """Factor by which forces of a file in `unit` ("1" or "N") are multiplied to be in newtons.

    Raises
    ------
    InputError : a normal force [N] is missing or not wanted.
    """
    if unit == "1" and normal_force is None:
        raise InputError(
            f"{where}: this is a fit of a friction coefficient; give the normal force that turns it"
            " into newtons, as in --normal-force '500 N'"
        )
    if unit != "1" and normal_force is not None:
        raise InputError(f"{where}: this is a fit of a force, so --normal-force is not wanted")
    return 1.0 if normal_force is None else normal_force


def in_law(effect: type[AbstractEffect]) -> bool:
    """Whether an effect belongs to friction in steady motion."""
    place = issubclass(effect, AbstractPlaceEffect)
    return effect.room == "friction" and not place and effect.id not in _WHILE


def left_out(fitted: FittedLaw, scale: float = 1.0) -> tuple[str, ...]:
    """A line for every effect that is not in the law, and why; of one that acts as a spring beside
    k_p its stiffness [N/m], forces being in `scale` newtons, and what to do."""
    lines = []
    moves, motion, later = "slider", "sliding", "; the law was fitted together with it"
    if fitted.is_axis:
        moves, motion = "axis", "motion"
        later = ", and the law was fitted together with it; a lag that stays asks for larger gains"
    for effect in fitted.effects:
        id, told = effect.id, f"{effect.id} is left out of the law: "
        own = {name: fitted.parameters[f"{id}.{name}"] for name in parameters(effect)}
        if issubclass(effect, AbstractPlaceEffect):
            spring = scale * float(made(effect, own).softest_spring())
            told += f"it depends on where the {moves} is, so no steady {motion} exists with it. "
            told += _spring_words(spring, unit_of("N/m", fitted.coordinate))
            lines += [told] if spring else []
        elif effect.room != "friction":
            room = effect.room if fitted.is_axis else _ROOMS.get(effect.room)
            lines.append(f"{told}it belongs to the {room} of the record{later}")
        elif effect.id in _WHILE:
            lines.append(told + _WHILE[id])
        elif effect is DirectionAsymmetry:
            way = "backwards" if own["d"] > 0 else "forwards"
            lines.append(
                f"{id}: the law is that of motion {way}, where viscous friction is less; a sample"
                " takes its own worse direction"
            )
    return tuple(lines)


def _spring_words(stiffness: float, unit: str) -> str:
    """What to do without an effect that acts as a spring [`unit`]."""
    if stiffness >= 0:
        return "It acts as a spring that stiffens k_p, so leaving it out is safe"
    return (
        f"It acts as a spring of {stiffness:.3g} {unit} beside k_p: add {-stiffness:.3g} {unit} to"
        " k_p"
    )


def _slider(
    fitted: FittedLaw, inside: Effects, scale: float
) -> Callable[[Parameters], AbstractLaw]:
    """A function from parameters by name to the law of a slider, whose forces are multiplied by
    `scale`."""
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
    """A function from parameters by name to the law of an axis."""
    mass, width = fitted.parameters["M"], fitted.width or _NO_WIDTH
    asymmetry = f"{DirectionAsymmetry.id}.d"

    def build(p: Parameters) -> AxisLaw:
        rig = AxisRig(mass, *(p[n] for n in _BASE[1:]), width=width, reach=fitted.reach)
        for effect in inside:
            fields = {name: p[f"{effect.id}.{name}"] for name in parameters(effect)}
            rig = made(effect, fields).embed(rig)
        direction = jnp.where(p[asymmetry] > 0, -1.0, 1.0) if asymmetry in p else 1.0
        return axis_law(rig, 0.0, direction, width=_NARROWER * width)

    return build


def _refuse_other(fitted: FittedLaw) -> None:
    """Raise `InputError` for an axis whose forces have no SI unit, or whose friction has no
    memory."""
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
    """The parameters that are in the law, and which of them are positive; all are checked."""
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
    """Columns (samples + 1,) of the parameters `positive` names: the estimate, then the draws.

    Free parameters that are not named are left out: the others have their marginal distribution.
    """
    columns = {name: np.full(samples + 1, fitted.parameters[name]) for name in positive}
    index = [i for i, name in enumerate(fitted.free) if name in positive]
    free = [fitted.free[i] for i in index]
    drawn: Mapping[str, np.ndarray] = {}
    if fitted.draws is not None:
        number = len(next(iter(fitted.draws.values())))
        if samples > number:
            raise InputError(
                f"{fitted.where}: it has {number} draws; use --samples {number} or fewer, or draw"
                " more"
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
                " use --samples 0 for the estimate alone, or a record that fixes it"
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
    """Samples (samples, p) of parameters, those that are `positive` by their logarithms.

    Normal about their `mean` with a `covariance` (SI), which need not be regular.
    """
    jacobian = np.where(positive, 1 / np.where(positive, mean, 1.0), 1.0)
    spread = covariance * np.outer(jacobian, jacobian)
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    lowered, vectors = np.linalg.eigh(spread / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(lowered, 0.0))
    z = np.random.default_rng(seed).standard_normal((samples, len(mean))) @ root.T
    return np.where(positive, mean * np.exp(np.where(positive, z, 0.0)), mean + z)
