"""The entry point: from a law and the situations of a machine to its gains."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from ..coordinate import agreed, unit_of
from ..errors import InputError
from ..laws import LawSource
from ..laws.file import Result, law_source
from ..laws.registry import Law
from ..rig.friction import AbstractLaw
from ..silent import silent
from ..stability.linear import controller_delay, integral_gain
from ..stability.margin_table import MARGINS, meaningless
from ..units import parse_values
from .frontier import Region, alone_of, largest_alone
from .hunting import Hunting, hunting
from .margins import several_margins, slacks
from .requirement import DEFAULT, Requirement, refuse_controller
from .rest import friction_at_rest
from .result import SHORTEST_DELAY, Certificate, Gains, LocalOptimum, WorstCase
from .scenarios import Scenarios
from .solve import Infeasible, NoGains, Optima, Optimum, Pair, make_region, solve
from .verify import CheckReport, choose, verify

_CONFIDENCE_ROUNDS = 6
_MOST_RAISED = 30.0

# Number of masses from a range that is given as text.
_MASSES = 5


def find_gains(
    law: LawSource | Law | Result,
    *,
    normal_force: float | str | None = None,
    velocity: ArrayLike | str,
    mass: ArrayLike | str | None,
    margin: Mapping[str, float] | Requirement | str = DEFAULT,
    confidence: float = 1.0,
    scale: Pair = (None, None),
    lower: Pair = (None, None),
    upper: Pair = (None, None),
    sample_time: float | None = None,
    delay: float | None = None,
    integral_gain: float = 0.0,
    accuracy: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Gains:
    """Smallest gains (k_p, k_v) whose margins hold in every scenario.

        minimise sqrt((k_p/s_p)^2 + (k_v/s_v)^2)

    over all combinations of velocity, mass and sample of the law, and over velocities between
    neighbouring ones where the requirement is just met. Both local optima are reported where there
    are two: "stiff", held by stiffness above the critical one, and "damped", held by damping.

    Parameters
    ----------
    law : one law; or one with samples: of a Fit, a Posterior or a Loop, whose law and 64 samples
        `law_from_fit` takes, or as that function gave it.
    normal_force : [N] or "500 N", of a Fit, a Posterior or a Loop of a friction coefficient.
    velocity : [m/s], one or several, or text, "1..10 mm/s"; a range is best given log-spaced.
    mass : [kg], one or several, or text, "1..3 kg"; None without mass, or with that of the axis
        that the law is of. Of a rotation, "1..5 rad/s" and "0.1 kg m^2"; k_p and k_v are then in
        N m/rad and N m s/rad.
    margin : what is required, by name (`MARGINS` has them, with units), or text, "modulus=0.5";
        modulus=0.5 is required beside what is named, unless modulus is: modulus=0 asks for none.
    confidence : share of the samples of the law in which the requirement must hold; the
        samples that ask for the largest gains are left out, at most so many.
    scale : (s_p [N/m], s_v [N s/m]); None: the stiffness that stabilises without damping and the
        damping that stabilises at every stiffness, largest over the scenarios.
    lower, upper : limits of (k_p, k_v); k_p always has the lower limit 1e-9 times its natural
        unit, which stands for "any positive stiffness".
    sample_time : h [s] of the controller; it then answers late by 1.5 h (half a sample of the
        zero-order hold and one of computing), in all margins, in the search and in its certificate,
        but not in the simulations of `check_gains`. None: a controller without delay.
    delay : instead, the whole delay of the controller [s], where it is known.
    integral_gain : k_i [N/(m s)] of a controller force = k_p e + k_v de/dt + k_i int e dt; it is
        then in all margins, of which `stiffness` has no meaning. 0: no integral action.
    accuracy : how near its target the slider must stop at rest [m]: k_p is then at least
        F_s/accuracy, F_s the static friction. None: any.
    progress : told what is being done.

    Raises
    ------
    InputError : a bad argument; of the kind `NoGains` where no gains within the limits meet the
        requirement.
    """
    machine = Machine(velocity, mass, sample_time, delay, integral_gain)
    measure = Measure(scale, lower, upper, accuracy)
    source = law_source(law, normal_force)
    found = seek_gains(source, machine, margin, measure, confidence=confidence, progress=progress)
    if isinstance(found, Infeasible):
        raise NoGains(found.text)
    return found


class Machine(NamedTuple):
    """The situations of a machine that gains are for; see `find_gains`."""

    velocity: ArrayLike | str
    mass: ArrayLike | str | None
    sample_time: float | None = None
    delay: float | None = None
    integral_gain: float | None = None


class Measure(NamedTuple):
    """Units of the norm of (k_p, k_v), and between which limits they lie; see `find_gains`."""

    scale: Pair = (None, None)
    lower: Pair = (None, None)
    upper: Pair = (None, None)
    accuracy: float | None = None


def seek_gains(
    law: LawSource | Law,
    machine: Machine,
    margin: Mapping[str, float] | Requirement | str,
    measure: Measure = Measure(),  # noqa: B008
    *,
    confidence: float = 1.0,
    progress: Callable[[str], None] | None = None,
) -> Gains | Infeasible:
    """The gains of `find_gains`, or, where no gains within the limits meet the requirement, why.

    Raises
    ------
    InputError : a bad argument.
    """
    source = law_source(law, None)
    velocity = machine.velocity
    mass = source.mass if machine.mass is None else machine.mass
    told = {
        "velocity": (velocity if isinstance(velocity, str) else None, "m/s"),
        "mass": (mass if isinstance(mass, str) else None, "kg"),
    }
    coordinate = agreed(told, source.coordinate)
    if isinstance(velocity, str):
        velocity = np.asarray(parse_values(velocity, unit_of("m/s", coordinate), "velocity"))
    if isinstance(mass, str):
        mass = np.asarray(parse_values(mass, unit_of("kg", coordinate), "mass", count=_MASSES))
    if isinstance(margin, str):
        margin = Requirement.parse(margin.split(","))
    requirement = margin if isinstance(margin, Requirement) else Requirement.with_default(margin)
    if not 0 < confidence <= 1:
        raise InputError(f"confidence is {confidence:g}; it must be above 0 and at most 1")
    _check_pairs(*measure[:3])
    delay = controller_delay(machine.sample_time, machine.delay)
    k_i = integral_gain(machine.integral_gain)
    told_late = "a sample time" if machine.delay is None else "a delay of the controller"
    refuse_controller(requirement, source.law, mass, delay, k_i, told_late)
    scenarios = Scenarios.product(source.samples, velocity, mass, delay, k_i)
    resting = friction_at_rest(scenarios) if source.level_known else None
    measure = _accurate(measure, resting, k_i)
    region = make_region(scenarios, *measure[:3], coordinate)
    tell = progress or silent
    tell(f"searching over {len(scenarios)} scenarios")
    samples = np.unique(scenarios.sample)
    dropped = int(np.floor((1 - confidence) * samples.size + 1e-9))
    kept = samples
    solution = solve(requirement, scenarios, region)
    for _ in range(_CONFIDENCE_ROUNDS if dropped else 0):
        if isinstance(solution, Infeasible):
            break
        order = _difficulty(requirement, scenarios, region, solution.optima[0])
        chosen = np.sort(samples[np.argsort(order)[: samples.size - dropped]])
        if np.array_equal(chosen, kept):
            break
        kept = chosen
        tell(f"again without the {dropped} samples that ask for most")
        few = scenarios.take(np.flatnonzero(np.isin(scenarios.sample, kept)))
        solution = solve(requirement, few, region)
    if isinstance(solution, Infeasible):
        return solution
    found = _result(source, requirement, solution, confidence, kept.size)
    known = {"rest_friction": resting, "accuracy": measure.accuracy}
    return replace(found, sample_time=machine.sample_time, **known)


def _accurate(measure: Measure, resting: float | None, k_i: float | None) -> Measure:
    """The measure with k_p >= F_s/accuracy among its limits, where an accuracy is asked for."""
    accuracy = measure.accuracy
    if accuracy is None:
        return measure
    if not accuracy > 0:
        raise InputError(f"accuracy is {accuracy:g}; it must be positive")
    if k_i is not None:
        raise InputError(
            "accuracy bounds the dead band of a controller without integral action; leave one out"
        )
    if resting is None:
        raise InputError(
            "accuracy needs the static friction, and this law does not tell it; give the level of"
            " friction (f0 of slip and ageing), or a lower limit of k_p"
        )
    low = max(measure.lower[0] or 0.0, resting / accuracy)
    if measure.upper[0] is not None and not low < measure.upper[0]:
        raise InputError(
            f"accuracy {accuracy:g} asks for k_p >= {low:.4g} (static friction {resting:.4g}), and"
            f" the upper limit of k_p is {measure.upper[0]:g}; allow more of one of them"
        )
    return measure._replace(lower=(low, measure.lower[1]))


def _check_pairs(scale: Pair, lower: Pair, upper: Pair) -> None:
    for what, pair in (("scale", scale), ("upper limit", upper), ("lower limit", lower)):
        for name, value in zip(("k_p", "k_v"), pair, strict=True):
            if value is not None and not (value > 0 or (value == 0 and pair is lower)):
                must = "must not be negative" if pair is lower else "must be positive"
                raise InputError(f"{what} of {name} is {value:g}; it {must}")


def _difficulty(
    requirement: Requirement, scenarios: Scenarios, region: Region, optimum: Optimum
) -> np.ndarray:
    """For each sample of the law, minus its least slack at the optimum: larger is harder."""
    slack = slacks(requirement, scenarios, region.unit, optimum.gains)[0]
    samples = np.unique(scenarios.sample)
    return np.asarray([-np.min(slack[scenarios.sample == s]) for s in samples])


def _result(
    source: LawSource, requirement: Requirement, solution: Optima, confidence: float, kept: int
) -> Gains:
    region, scenarios = solution.region, solution.scenarios
    best = solution.optima[0]
    kp, kv = (float(x) for x in best.gains)
    worst = _worst(scenarios, best.gains)
    parts = [_local(requirement, solution, one, minimum=True) for one in solution.optima]
    parts += [_local(requirement, solution, one, minimum=False) for one in solution.alone]
    certificate = Certificate(
        best.residual, solution.grid_points, solution.smaller_found, solution.rounds
    )
    return _bounded(
        Gains(
            kp,
            kv,
            best.norm,
            tuple(parts),
            worst,
            scenarios,
            requirement,
            region,
            confidence,
            kept,
            certificate,
            source.text,
            warnings=(
                *source.warnings,
                *source.unseen(scenarios.velocity),
                *_warnings(parts[0], region, worst, scenarios.delay),
            ),
            delay=None if scenarios.delay is None else float(scenarios.delay[0]),
            alone=alone_of(solution.meets, scenarios, region),
        )
    )


def _bounded(found: Gains) -> Gains:
    """A copy that says up to which gains a late controller may go where none are needed."""
    if not found.none_needed or found.delay is None:
        return found
    largest = largest_alone(found.requirement, found.scenarios, found.region)
    return replace(found, largest=largest)


def _worst(scenarios: Scenarios, gains: np.ndarray) -> dict[str, WorstCase]:
    """Every margin in the scenario where it is least."""
    worst = {}
    late, integral = scenarios.delay is not None, scenarios.integral is not None
    names = [name for name in MARGINS if not meaningless(name, late=late, integral=integral)]
    for name, values in several_margins(names, scenarios, gains).items():
        at = int(np.argmin(values))
        worst[name] = WorstCase(float(values[at]), MARGINS[name].unit, scenarios.describe(at))
    return worst


def _local(
    requirement: Requirement, solution: Optima, one: Optimum, *, minimum: bool
) -> LocalOptimum:
    unit = solution.region.unit
    u, v = one.gains / unit
    return LocalOptimum(
        "damped" if v > u else "stiff",
        float(one.gains[0]),
        float(one.gains[1]),
        one.norm,
        float(np.min(slacks(requirement, solution.scenarios, unit, one.gains))),
        one.residual,
        tuple(solution.scenarios.describe(index) for index in one.active),
        one.at_limit,
        minimum,
    )


def _warnings(
    best: LocalOptimum, region: Region, worst: dict[str, WorstCase], delay: np.ndarray | None
) -> list[str]:
    texts = []
    if delay is None and worst["delay"].value < SHORTEST_DELAY:
        texts.append(
            f"these gains survive a delay of {1e6 * worst['delay'].value:.2g} us in the controller:"
            f" less than any has ({1e6 * SHORTEST_DELAY:.0f} us is that of one that samples at 30"
            " kHz). Say how often yours samples, and find gains with that delay in the loop:"
            " --sample-time '1 ms' (in Python sample_time=1e-3), or --delay where it is known"
        )
    if region.any_stiffness(best.kp):
        which = "any positive" if delay is None else "any small"
        texts.append(
            f"k_p is at its lower limit: {which} stiffness meets the requirement; give a"
            " lower limit (--min-kp) if the position must be held"
        )
    return texts


def check_gains(
    gains: Gains,
    *,
    basin: float | None = None,
    number: int = 4,
    progress: Callable[[str], None] | None = None,
) -> Gains:
    """A copy of these gains, checked by nonlinear simulation in the `number` hardest scenarios.

    With `basin` both gains are raised by one factor, in steps of 2 %, until velocity may jump by
    that factor either way in all of them; the margins are then those of the raised gains. Gains
    with integral action are simulated at rest only (`hunting`); a warning says it.

    Raises
    ------
    InputError : `basin` is below 1; no gains up to 30 times as large have such a basin.
    """
    if basin is not None and not basin >= 1:
        raise InputError(f"basin is {basin:g}; it is a factor, 1 or more")
    if not isinstance(gains.scenarios.law(0), AbstractLaw):
        return replace(
            gains, warnings=(*gains.warnings, "gains under a delay law are not simulated")
        )
    if gains.integral is not None:
        found = _hunting(gains, gains.integral, progress or silent)
        text = "gains with integral action are not simulated: only their margins are known"
        if found is not None:
            text = "gains with integral action are simulated at rest only, not in motion"
        return replace(gains, hunting=found, warnings=(*gains.warnings, text))
    if gains.any_stiffness:
        text = "not simulated: k_p stands for any positive stiffness; give a lower limit of k_p"
        return replace(gains, warnings=(*gains.warnings, text))
    tell = progress or silent
    values = np.asarray([gains.kp, gains.kv])
    slack = _least_slack(gains, values)
    few = gains.scenarios.take(choose(gains.scenarios, slack, number=number))
    tell(f"simulating {len(few)} scenarios")
    largest = 10.0 if basin is None else max(10.0, 2 * basin)
    report = verify(few, values, largest=largest)
    if basin is None or (report.basin or 0) >= basin:
        warnings = (*gains.warnings, *unresolved_warnings(report))
        return replace(gains, simulation=report, warnings=warnings)
    tell(f"raising the gains until the basin is {basin:g}")
    factor = _raise(few, values, basin, largest)
    report = verify(few, factor * values, largest=largest)
    raised = factor * values
    worst = _worst(gains.scenarios, raised)
    text = f"the gains were raised by a factor {factor:.4g} for a basin of {basin:g}"
    missed = float(np.min(_least_slack(gains, raised)))
    warnings = [*gains.warnings, text, *unresolved_warnings(report)]
    if missed < -1e-6:
        warnings.append(f"the raised gains miss a required margin by {-missed:.2g} of it")
    return replace(
        gains,
        kp=float(raised[0]),
        kv=float(raised[1]),
        norm=float(gains.region.norm(raised)),
        margins=worst,
        simulation=report,
        warnings=tuple(warnings),
    )


def _hunting(gains: Gains, k_i: float, tell: Callable[[str], None]) -> Hunting | None:
    """Whether the slider hunts at rest: of the first sample of the law and the largest mass."""
    law, masses = gains.scenarios.law(0), gains.scenarios.mass
    if gains.rest_friction is None or masses is None or not isinstance(law, AbstractLaw):
        return None
    tell("simulating the slider at rest")
    fastest = float(np.max(gains.scenarios.velocity))
    own = gains.kp, gains.kv, k_i
    return hunting(law, float(np.max(masses)), own, gains.rest_friction, fastest)


def unresolved_warnings(report: CheckReport) -> tuple[str, ...]:
    """A line where the simulations say next to nothing: more than half of them end unresolved."""
    if 2 * report.unresolved <= report.checked:
        return ()
    return (
        f"{report.unresolved} of {report.checked} simulated starts end unresolved: the simulation"
        " stopped before it could be seen whether they settle. They speak neither for these gains"
        " nor against them; look at one of them with 'jaxfric simulate'",
    )


def _least_slack(gains: Gains, values: np.ndarray) -> np.ndarray:
    return slacks(gains.requirement, gains.scenarios, gains.region.unit, values)[0]


def _raise(few: Scenarios, values: np.ndarray, basin: float, largest: float) -> float:
    """Smallest factor, to 2 %, at which the basin is large enough."""

    def size(factor: float) -> float:
        return verify(few, factor * values, starts=False, largest=largest).basin or 0.0

    low, high = 1.0, 1.25
    while size(high) < basin:
        low, high = high, high * 1.25
        if high > _MOST_RAISED:
            raise InputError(
                f"basin={basin:g} is not reached by gains {_MOST_RAISED:g} times those of the"
                " margins; ask for less, or for a larger margin"
            )
    while high / low > 1.02:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if size(middle) >= basin else (middle, high)
    return float(high)
