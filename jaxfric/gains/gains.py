"""The entry point: from a law and the operating conditions of a machine to its gains."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import ArrayLike

from ..coordinate import agreed, unit_of
from ..errors import InputError
from ..findings import Warned, WarningCode, warned
from ..laws import LawSource
from ..laws.registry import Law
from ..plain import entries
from ..rig.friction import AbstractLaw
from ..saved.law import Result, law_source
from ..silent import silent
from ..stability.linear import controller_delay
from ..stability.linear import integral_gain as checked_integral_gain
from ..stability.margin_table import MARGINS, meaningless
from ..units import parse_values
from .frontier import GainTask, Region, alone_of, largest_alone
from .hunting import Hunting, hunting
from .margins import several_margins
from .requirement import DEFAULT, Requirement, refuse_controller
from .rest import friction_at_rest
from .result import SHORTEST_DELAY, Gains, LocalOptimum, WorstCase
from .scenarios import Scenarios, law_of
from .solve import Infeasible, NoGains, Optima, Optimum, Pair, make_region, solve
from .thresholds import MOST_RAISED, OF_A_RANGE, OF_LAWS, ROUNDS
from .verify import CheckReport, choose, verify


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
    """Find the smallest gains (k_p, k_v) whose margins hold in every scenario.

        minimise sqrt((k_p/s_p)^2 + (k_v/s_v)^2)

    Scenarios are all combinations of velocity, mass and sample of the law. The search adds further
    velocities near velocities at which the requirement is only just met. If two local optima exist,
    both are reported: "stiff" (k_p above the critical stiffness) and "damped" (k_v almost suffices
    alone).

    Parameters
    ----------
    law : one law; a law with samples, as from `law_from_fit`; or a Fit, a Posterior or a Loop,
        which gives its law and 64 samples.
    normal_force : [N] or "500 N", for a Fit, a Posterior or a Loop of a friction coefficient.
    velocity : [m/s], one or several, or text, "1..10 mm/s"; log-space a range.
    mass : [kg], one or several, or text, "1..3 kg"; None: that of the law's axis, or no mass. For
        a rotation use "1..5 rad/s" and "0.1 kg m^2"; k_p and k_v are then in N m/rad and
        N m s/rad.
    margin : required margins by name (`MARGINS` lists them with units), or text, "modulus=0.5";
        modulus=0.5 is always added unless modulus is named; modulus=0 removes the modulus margin.
    confidence : share of the samples of the law in which the requirement must hold. The remaining
        samples may be dropped. Samples that demand the largest gains are dropped first.
    scale : (s_p [N/m], s_v [N s/m]); None: the stiffness that stabilises without damping and the
        damping that stabilises at every stiffness, largest over the scenarios.
    lower, upper : limits of (k_p, k_v); k_p always has the lower limit 1e-9 times its natural
        unit, which means "any positive stiffness".
    sample_time : h [s] of the controller, which gives the delay 1.5 h: half a sample for the
        zero-order hold and one for computing. Margins, search and certificate include the
        controller delay; the simulations of `check_gains` do not. None: no delay.
    delay : instead, the total delay of the controller [s], if known.
    integral_gain : k_i [N/(m s)] of a controller force = k_p e + k_v de/dt + k_i int e dt, included
        in all margins; `stiffness` is then undefined. 0: no integral action.
    accuracy : largest distance from the target at which the slider may stop [m]: k_p is then at
        least F_s/accuracy, with F_s the static friction. None: any accuracy.
    progress : called with a text at every stage.

    Raises
    ------
    InputError : an invalid argument; its subclass `NoGains` if no gains within the limits meet the
        requirement.
    """
    source, tell = law_source(law, normal_force), progress or silent
    mass = source.mass if mass is None else mass
    told = {
        "velocity": (velocity if isinstance(velocity, str) else None, "m/s"),
        "mass": (mass if isinstance(mass, str) else None, "kg"),
    }
    coordinate = agreed(told, source.coordinate)
    if isinstance(velocity, str):
        velocity = np.asarray(parse_values(velocity, unit_of("m/s", coordinate), "velocity"))
    if isinstance(mass, str):
        mass = np.asarray(parse_values(mass, unit_of("kg", coordinate), "mass", count=OF_A_RANGE))
    if isinstance(margin, str):
        margin = Requirement.parse(margin.split(","))
    requirement = margin if isinstance(margin, Requirement) else Requirement.with_default(margin)
    if not 0 < confidence <= 1:
        raise InputError(f"confidence is {confidence:g}; it must be above 0 and at most 1")
    _check_pairs(scale, lower, upper)
    told_late = "a sample time" if delay is None else "a delay of the controller"
    delay = controller_delay(sample_time, delay)
    k_i = checked_integral_gain(integral_gain)
    refuse_controller(requirement, source.law, mass, delay, k_i, told_late)
    scenarios = Scenarios.product(source.samples, velocity, mass, delay, k_i)
    resting = friction_at_rest(scenarios) if source.level_known else None
    lower = _accurate(accuracy, lower, upper[0], resting, k_i)
    region = make_region(scenarios, scale, lower, upper, coordinate)
    solution, kept = _solved(GainTask(requirement, scenarios, region), confidence, tell)
    if isinstance(solution, Infeasible):
        raise NoGains(solution)
    task, scenarios = solution.task, solution.task.scenarios
    worst = _worst(scenarios, solution.optima[0].gains)
    optima = [_local(task, one, minimum=True) for one in solution.optima]
    optima += [_local(task, one, minimum=False) for one in solution.alone]
    gains = Gains(
        kp=optima[0].kp,
        kv=optima[0].kv,
        norm=optima[0].norm,
        optima=tuple(optima),
        margins=worst,
        scenarios=scenarios,
        requirement=requirement,
        region=region,
        confidence=confidence,
        kept_samples=kept,
        certificate=solution.certificate,
        law=source.text,
        warnings=(
            *source.warnings,
            *source.unseen(scenarios.velocity),
            *_warnings(optima[0], region, worst, delay),
        ),
        delay=delay,
        alone=alone_of(solution.meets, scenarios, region),
        sample_time=sample_time,
        rest_friction=resting,
        accuracy=accuracy,
    )
    return _bounded(gains)


def _bounded(found: Gains) -> Gains:
    """Add the largest allowed gains if none are needed and the controller has a delay."""
    if not found.none_needed or found.delay is None:
        return found
    task = GainTask(found.requirement, found.scenarios, found.region)
    return replace(found, largest=largest_alone(task))


def _solved(
    task: GainTask, confidence: float, tell: Callable[[str], None]
) -> tuple[Optima | Infeasible, int]:
    """Solve a task in a share of the samples of the law; return the solution and their number."""
    scenarios = task.scenarios
    tell(f"searching over {len(scenarios)} scenarios")
    kept = samples = np.unique(scenarios.sample)
    dropped = int(np.floor((1 - confidence) * samples.size + 1e-9))
    solution = solve(task)
    for _ in range(ROUNDS if dropped else 0):
        if isinstance(solution, Infeasible):
            break
        slack = task.slacks(solution.optima[0].gains)[0]
        least = [np.min(slack[scenarios.sample == sample]) for sample in samples]
        chosen = np.sort(samples[np.argsort(-np.asarray(least))[: samples.size - dropped]])
        if np.array_equal(chosen, kept):
            break
        kept = chosen
        tell(f"again without the {dropped} samples that demand the largest gains")
        few = scenarios.take(np.flatnonzero(np.isin(scenarios.sample, kept)))
        solution = solve(task.among(few))
    return solution, kept.size


def _accurate(
    accuracy: float | None,
    lower: Pair,
    high: float | None,
    resting: float | None,
    k_i: float | None,
) -> Pair:
    """The lower limits of the gains, including k_p >= F_s/accuracy for a required accuracy."""
    if accuracy is None:
        return lower
    if not accuracy > 0:
        raise InputError(f"accuracy is {accuracy:g}; it must be positive")
    if k_i is not None:
        raise InputError(
            "accuracy bounds the dead band of a controller without integral action; leave one out"
        )
    if resting is None:
        raise InputError(
            "accuracy needs the static friction, which this law does not contain; give the level of"
            " friction (f0 of slip and ageing), or a lower limit of k_p"
        )
    low = max(lower[0] or 0.0, resting / accuracy)
    if high is not None and not low < high:
        raise InputError(
            f"accuracy {accuracy:g} requires k_p >= {low:.4g} (static friction {resting:.4g}), but"
            f" the upper limit of k_p is {high:g}; raise one of them"
        )
    return low, lower[1]


def _check_pairs(scale: Pair, lower: Pair, upper: Pair) -> None:
    for what, pair in {"scale": scale, "upper limit": upper, "lower limit": lower}.items():
        for name, value in zip(("k_p", "k_v"), pair, strict=True):
            none = value == 0 and what == "lower limit"
            if value is not None and not (value > 0 or none):
                must = "must not be negative" if what == "lower limit" else "must be positive"
                raise InputError(f"{what} of {name} is {value:g}; it {must}")


def _worst(scenarios: Scenarios, gains: np.ndarray) -> dict[str, WorstCase]:
    """Every margin in its worst scenario."""
    worst = {}
    late, integral = scenarios.delay is not None, scenarios.integral is not None
    names = [name for name in MARGINS if not meaningless(name, late=late, integral=integral)]
    for name, values in several_margins(names, scenarios, gains).items():
        at = int(np.argmin(values))
        worst[name] = WorstCase(float(values[at]), MARGINS[name].unit, scenarios.describe(at))
    return worst


def _local(task: GainTask, one: Optimum, *, minimum: bool) -> LocalOptimum:
    u, v = one.gains / task.region.unit
    return LocalOptimum(
        "damped" if v > u else "stiff",
        float(one.gains[0]),
        float(one.gains[1]),
        one.norm,
        float(np.min(task.slacks(one.gains))),
        one.residual,
        tuple(task.scenarios.describe(index) for index in one.active),
        one.at_limit,
        minimum,
    )


def _warnings(
    best: LocalOptimum, region: Region, worst: dict[str, WorstCase], delay: float | None
) -> list[str]:
    texts = []
    if delay is None and worst["delay"].value < SHORTEST_DELAY:
        values = {"delay": worst["delay"].value, "least": SHORTEST_DELAY}
        texts.append(warned(WarningCode.SHORT_DELAY, **values))
    if region.any_stiffness(best.kp):
        which = "positive" if delay is None else "small"
        texts.append(warned(WarningCode.LOWEST_STIFFNESS, which=which))
    return texts


def check_gains(
    gains: Gains,
    *,
    basin: float | None = None,
    number: int = 4,
    progress: Callable[[str], None] | None = None,
) -> Gains:
    """Check gains by nonlinear simulation in the `number` hardest scenarios; return a copy.

    With `basin`, both gains are raised by one common factor, accurate to 2 %. The common factor is
    the least at which velocity may jump up or down by the factor `basin` in every checked scenario.
    The returned margins are then margins of the raised gains. Gains with integral action are
    simulated only at rest (`hunting`), for the least and the largest mass and up to 4 samples of
    the law, and the result has a warning.

    Raises
    ------
    InputError : `basin` is below 1; no gains up to 30 times as large have the basin.
    """
    if basin is not None and not basin >= 1:
        raise InputError(f"basin is {basin:g}; it is a factor, 1 or more")
    tell = progress or silent
    laws = gains.scenarios.laws
    if not isinstance(laws, AbstractLaw):
        return _with(gains, warned(WarningCode.DELAY_LAW))
    if gains.integral is not None:
        return replace(
            _with(gains, warned(WarningCode.INTEGRAL)), hunting=_hunting(gains, laws, tell)
        )
    if gains.any_stiffness:
        return _with(gains, warned(WarningCode.ANY_STIFFNESS))
    values = np.asarray([gains.kp, gains.kv])
    task = GainTask(gains.requirement, gains.scenarios, gains.region)
    few = gains.scenarios.take(choose(gains.scenarios, task.slacks(values)[0], number=number))
    tell(f"simulating {len(few)} scenarios")
    largest = 10.0 if basin is None else max(10.0, 2 * basin)
    report = verify(few, values, largest=largest)
    if basin is None or (report.basin or 0) >= basin:
        return replace(_with(gains, *unresolved_warnings(report)), simulation=report)
    tell(f"raising the gains until the basin is {basin:g}")
    factor = _raise(few, values, basin, largest)
    raised = factor * values
    report = verify(few, raised, largest=largest)
    texts = [warned(WarningCode.RAISED, factor=factor, basin=basin)]
    texts += unresolved_warnings(report)
    missed = float(np.min(task.slacks(raised)))
    if missed < -1e-6:
        texts.append(warned(WarningCode.MISSED_MARGIN, by=-missed))
    return replace(
        _with(gains, *texts),
        kp=float(raised[0]),
        kv=float(raised[1]),
        norm=float(gains.region.norm(raised)),
        margins=_worst(gains.scenarios, raised),
        simulation=report,
    )


def _with(gains: Gains, *texts: str) -> Gains:
    return replace(gains, warnings=(*gains.warnings, *texts))


def _hunting(gains: Gains, laws: AbstractLaw, tell: Callable[[str], None]) -> Hunting | None:
    """Whether sliders of the least and the largest mass hunt, in some samples of the law."""
    scenarios = gains.scenarios
    if gains.rest_friction is None or scenarios.mass is None or gains.integral is None:
        return None
    tell("simulating the slider at rest")
    samples = np.unique(scenarios.sample)
    samples = np.unique(samples[np.linspace(0, len(samples) - 1, OF_LAWS).astype(int)])
    ends = np.unique([np.min(scenarios.mass), np.max(scenarios.mass)])
    index, mass = (x.ravel() for x in np.meshgrid(samples, ends))
    own = gains.kp, gains.kv, gains.integral
    found = hunting(law_of(laws, index), mass, own, gains.rest_friction)
    return found._replace(masses=tuple(ends.tolist()), samples=tuple(samples.tolist()))


def unresolved_warnings(report: CheckReport) -> tuple[Warned, ...]:
    """Warn if more than half of the simulations end unresolved."""
    if 2 * report.unresolved <= report.checked:
        return ()
    return (warned(WarningCode.UNRESOLVED, **entries(report, "unresolved", "checked")),)


def _raise(few: Scenarios, values: np.ndarray, basin: float, largest: float) -> float:
    """Smallest factor, to 2 %, at which the basin is large enough."""

    def size(factor: float) -> float:
        return verify(few, factor * values, starts=False, largest=largest).basin or 0.0

    low, high = 1.0, 1.25
    while size(high) < basin:
        low, high = high, high * 1.25
        if high > MOST_RAISED:
            raise InputError(
                f"basin={basin:g} is not reached by gains {MOST_RAISED:g} times those of the"
                " margins; require a smaller basin, or a larger margin"
            )
    while high / low > 1.02:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if size(middle) >= basin else (middle, high)
    return float(high)
