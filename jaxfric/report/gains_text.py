"""Gains as lines of text."""

import math

import numpy as np

from ..coordinate import unit_of
from ..gains.hunting import Hunting
from ..gains.requirement import FRAGILE, Requirement
from ..gains.result import NOTHING, Certificate, Gains, LocalOptimum, WorstCase, norm_text
from ..gains.scenarios import number_of_samples
from ..gains.solve import Infeasible
from ..gains.thresholds import ZERO
from ..stability.margin_table import MARGINS
from ..units import between, factor, read_as, speed_text
from .report import Report
from .tables import TextTable

_HELD_BY = {"stiff": "stiffness", "damped": "damping"}
_UNITS = ("N/m", "N s/m")
"""Of stiffness and of damping, on a line."""
_LENGTHS = (("m", 0.1), ("mm", 1e-4), ("um", 0.0))
"""Units of length, and from which length on [m] each is used."""
_ANY = {"gain": 1e6, "delay": 1e4}
"""Margins above which a loop has as much as anybody asks for: a factor, and seconds."""


def describe(gains: Gains) -> list[str]:
    """Lines on the required margins, the gains found, and the evidence for the gains."""
    lines = [
        *_doubts(gains),
        gains.law,
        f"required: {required(gains.requirement)}{_accuracy(gains)}",
        f"scenarios: {_scenarios(gains)}",
    ]
    if gains.delay is not None:
        lines.append(f"controller: {late_text(gains.delay, gains.sample_time)}, in all margins")
    lines.append("")
    k_p, k_v = (gains.unit(unit) for unit in _UNITS)
    kp = gains.smallest_kp if gains.any_stiffness else f"k_p = {gains.kp:.6g} {k_p}"
    lines.append(f"{kp}, k_v = {gains.kv:.6g} {k_v}   (norm {norm_text(gains.norm)})")
    law = "of a controller with force = k_p (x_ref - x) + k_v (v_ref - v)"
    if gains.integral is not None:
        law += f" + k_i int (x_ref - x) dt, k_i = {gains.integral:.6g} {gains.unit('N/(m s)')}"
    lines.append(law)
    scale = gains.region.scale
    lines.append(f"norm in units of k_p: {scale[0]:.5g} {k_p}, of k_v: {scale[1]:.5g} {k_v}")
    lines += [f"  {_optimum(optimum, gains)}" for optimum in gains.optima]
    lines += [f"  {text}" for text in (*_neither(gains), *_largest(gains))]
    lines += _at_rest(gains)
    lines += ["", "margins at these gains, worst scenario:"]
    lines += [f"  {name:<10}{_margin(gains, name)}" for name in gains.margins]
    return [*lines, "", certified(gains.certificate), *_simulation(gains)]


def report(gains: Gains) -> Report:
    """The gains with their margins, the scenarios, the evidence, and all other lines."""
    unit = gains.unit("N s/m")
    rows = [
        (
            _HELD_BY[one.name] + ("" if one.minimum else " alone"),
            _kp(gains, one),
            _size(one.kv, unit),
            norm_text(one.norm),
        )
        for one in gains.optima
    ]
    heads = ("held by", "k_p", "k_v", "norm")
    optima = TextTable("Other gains that meet the requirement", heads, rows[1:])
    return Report(headline(gains), (), describe(gains), warnings=gains.warnings, short=optima)


def headline(gains: Gains) -> list[str]:
    """Warnings, gains with margins (rounded down), scenarios, and how the motions end."""
    margins = [
        f"{name} margin {_least(worst)}"
        for name, worst in gains.margins.items()
        if name in ("modulus", "delay", *gains.requirement.names)
        and worst.value < _ANY.get(name, math.inf)
    ]
    kp = gains.smallest_kp if gains.any_stiffness else f"k_p = {_size(gains.kp, gains.unit('N/m'))}"
    kv = f"k_v = {_size(gains.kv, gains.unit('N s/m'))}"
    if gains.any_stiffness and gains.kv == 0:
        kp, kv = "stable at any gain, because friction damps the motion", kp
    told = f"{kp}, {kv}" + (f" ({', '.join(margins)})" if margins else "")
    doubts = _doubts(gains)
    rests = _at_rest(gains) if gains.simulation is not None else []
    last = rests or _simulation(gains)
    return [*doubts, told, f"scenarios: {_scenarios(gains)}", *([] if doubts else last[:1])]


def _kp(gains: Gains, one: LocalOptimum) -> str:
    return gains.smallest_kp if _tiny(one, gains) else _size(one.kp, gains.unit("N/m"))


def _tiny(one: LocalOptimum, gains: Gains) -> bool:
    """Whether any k_p above 0 does."""
    return one.kp <= 1e-8 * gains.region.unit[0]


def _size(value: float, unit: str) -> str:
    """A gain with a prefix: "1.76 kN/m"."""
    return f"{value / 1e3:.4g} k{unit}" if value >= 1e3 else f"{value:.4g} {unit}"


def _least(worst: WorstCase) -> str:
    """Three digits of a margin with its unit, rounded down."""
    value = worst.value
    if value > 0:
        unit = 10.0 ** (math.floor(math.log10(value)) - 2)
        value = math.floor(value / unit * (1 + 1e-9)) * unit
    if worst.unit == "s":
        return _time(value)
    return f"{value:.3g} {worst.unit}".removesuffix(" 1")


def _doubts(gains: Gains) -> list[str]:
    """What speaks against these gains, before all else."""
    lines = [f"NOT RECOMMENDED: {'; '.join(gains.unsafe)}"] if gains.unsafe else []
    if gains.fragile:
        lines.append(
            f"fragile: modulus is {gains.margins['modulus'].value:.2g} (below {FRAGILE:g} a small"
            " error of the model makes the loop unstable)"
        )
    return lines


def certified(known: Certificate) -> str:
    """How well the gains meet the conditions of an optimum, and that no smaller gains do."""
    how = "exactly" if known.kkt_residual == 0 else f"to {known.kkt_residual:.1e}"
    text = f"optimality conditions met {how}; "
    if known.kkt_residual > ZERO:
        text = "they meet all that is required; that they are the smallest is not shown; "
    if not known.grid_points:
        return text + "no smaller gains were tried: the limits leave none"
    found = str(known.smaller_found) if known.smaller_found else "none"
    verb = "meet" if known.smaller_found > 1 else "meets"
    return f"{text}of {known.grid_points} smaller gains tried, {found} {verb} the requirement"


def _accuracy(gains: Gains) -> str:
    """The accuracy that is required at rest, and the stiffness that it asks for."""
    if gains.accuracy is None or gains.rest_friction is None:
        return ""
    least = f"{gains.rest_friction / gains.accuracy:.4g} {gains.unit('N/m')}"
    return f", {_length(gains, gains.accuracy)} accuracy at rest (k_p >= {least})"


def _at_rest(gains: Gains) -> list[str]:
    """How near its target the slider stops."""
    if gains.hunting is not None:
        return [_hunts(gains, gains.hunting)]
    if gains.dead_band is None:
        return []
    force = f"{gains.rest_friction:.4g} {gains.unit('N')}"
    return [
        f"at rest it stops within {_length(gains, gains.dead_band)} of the target (static friction"
        f" {force} over k_p; --accuracy bounds it)"
    ]


def _hunts(gains: Gains, found: Hunting) -> str:
    """Whether integral action makes the slider hunt about its target."""
    if found.amplitude is None:
        return f"at rest: no hunting about the target seen within {found.duration:.3g} s, simulated"
    if found.period is None:
        return "at rest: simulated from rest its motion grows; lower k_i"
    size = _length(gains, found.amplitude)
    return (
        f"at rest it hunts about the target, by ±{size} with a period of {found.period:.3g} s"
        " (simulated): integral action, and kinetic friction below static friction; lower k_i, or"
        " give the integral a dead zone as large"
    )


def _length(gains: Gains, length: float) -> str:
    units = (("rad", 0.1), ("mrad", 0.0)) if gains.coordinate == "rotary" else _LENGTHS
    size, unit = next((factor(u, units[0][0], "length"), u) for u, low in units if length >= low)
    return read_as(f"{length / size:.4g} {unit}")


def required(what: Requirement) -> str:
    """The required margins, and the reason for a margin that the user did not name."""
    told = [f"{name} >= {value:g}" for name, value in zip(what.names, what.values, strict=True)]
    if what.kept:  # the default comes first
        others = "" if len(told) == 1 else "; modulus=0 switches it off"
        told[0] += f" (the default{others})"
    return ", ".join(told)


def _speed(gains: Gains, velocity: float) -> str:
    return read_as(speed_text(velocity, rotary=gains.coordinate == "rotary"))


def _scenarios(gains: Gains) -> str:
    scenarios = gains.scenarios
    low, high = scenarios.velocity.min(), scenarios.velocity.max()
    ends = dict.fromkeys(_speed(gains, v) for v in (low, high))
    text = f"{len(scenarios)}, velocity {' to '.join(ends)}"
    if scenarios.mass is None:
        text += ", no mass"
    else:
        text += f", mass {between(scenarios.mass.min(), scenarios.mass.max(), gains.unit('kg'))}"
    count = len(set(scenarios.sample.tolist()))
    text += f", {count} samples of the law" if count > 1 else ""
    if gains.confidence < 1:
        text += f" ({gains.kept_samples} kept, confidence {gains.confidence:g})"
    return text


def _optimum(optimum: LocalOptimum, gains: Gains) -> str:
    how = f"held by {_HELD_BY[optimum.name]}"
    if optimum.minimum and optimum.kv > 0 and optimum.name == "stiff":
        how += " and damping together"
    tiny = _tiny(optimum, gains)
    if not optimum.minimum or tiny or optimum.kv == 0:
        more = "" if optimum.minimum else " (more than both together)"
        edge = _edge(gains, 0 if optimum.name == "stiff" else 1)
        how = "held by friction itself" if tiny and optimum.kv == 0 else f"{how} alone{more}"
        how += f"; {edge}" if edge else ""
    k_p, k_v = (gains.unit(unit) for unit in _UNITS)
    kp = gains.smallest_kp if tiny else f"k_p = {optimum.kp:.6g} {k_p}"
    name = optimum.name if optimum.minimum else "alone"
    norm = norm_text(optimum.norm)
    return f"{name:<7} {kp}, k_v = {optimum.kv:.6g} {k_v}, norm {norm}: {how}"


def _edge(gains: Gains, which: int) -> str:
    """What stiffness (0) or damping (1) alone would need without margins: the number that
    'jaxfric stability' gives."""
    if gains.alone is None or gains.alone.edge is None:
        return ""
    edge = gains.alone.edge[which]
    late = "" if gains.delay is None else " and delay"
    if math.isinf(edge):
        return "without margins none does either"
    if edge == 0:
        return f"without margins{late} any does"
    return f"without margins{late} {edge:.6g} {gains.unit(_UNITS[which])} is enough"


def _neither(gains: Gains) -> list[str]:
    """Lines on stiffness alone and on damping alone where these do not meet the requirement."""
    if gains.alone is None:
        return []
    lines = []
    for which, how in enumerate(("stiffness", "damping")):
        if not gains.alone.meets[which]:
            most = f"{gains.alone.tried[which]:.3g} {gains.unit(_UNITS[which])}"
            late = "" if gains.delay is None else ", with the controller's delay"
            edge = _edge(gains, which)
            lines.append(
                f"{'alone':<7} no {how} alone meets the requirement{late} (tried: up to {most})"
                f"{'; ' + edge if edge else ''}"
            )
    return lines


def _largest(gains: Gains) -> list[str]:
    """A line on how large the gains may be where none are needed and the controller is late."""
    if gains.largest is None:
        return []
    others = ("k_v = 0", "k_p near 0")
    parts = [
        f"k_{'pv'[i]} up to {most:.3g} {gains.unit(_UNITS[i])} with {other}"
        for i, (most, other) in enumerate(zip(gains.largest, others, strict=True))
        if math.isfinite(most)
    ]
    return [f"{'larger':<7} {' and '.join(parts)} meet the requirement, too"] if parts else []


def _margin(gains: Gains, name: str) -> str:
    worst = gains.margins[name]
    about = MARGINS.get(name)
    if worst.value > _ANY.get(name, math.inf):
        return f"any {name}"
    if math.isinf(worst.value) and about is not None:
        return f"inf ({about.unlimited})"
    if gains.any_stiffness and name == "decay" and 0 < worst.value < NOTHING:
        return "towards 0 1/s as k_p is"
    unit = "" if worst.unit == "1" else f" {worst.unit}"
    where = worst.scenario
    mass = "" if where["mass"] is None else f", {where['mass']:.3g} {gains.unit('kg')}"
    more = " more" if name == "delay" and gains.delay is not None else ""
    sampled = number_of_samples(gains.scenarios.laws) > 1
    sample = f", sample {where['sample']}" if sampled else ""
    return f"{worst.value:.5g}{unit}{more}  at {_speed(gains, where['velocity'])}{mass}{sample}"


def late_text(delay: float, sample_time: float | None = None) -> str:
    """The delay of the controller, and the source of this number."""
    return f"answers {_time(delay)} late{'' if sample_time is None else ' (1.5 samples)'}"


def _time(seconds: float) -> str:
    return f"{1e6 * seconds:.4g} us" if seconds < 1e-3 else f"{1e3 * seconds:.4g} ms"


def _simulation(gains: Gains) -> list[str]:
    checked = gains.simulation
    if checked is None:
        motion = "" if gains.hunting is None else " in motion"
        return [f"not checked by simulation{motion}"]
    text = f"simulated from {checked.checked} starts: {checked.steady} end steady"
    if gains.delay is not None:
        text = text.replace("simulated", "simulated without the controller's delay", 1)
    for count, name in (
        (checked.limit_cycle, "in a limit cycle"),
        (checked.escaped, "in escape"),
        (checked.unresolved, "unresolved"),
    ):
        if count:
            text += f", {count} {name}"
    lines = [text]
    lines += [
        f"  {start.start} at {_speed(gains, start.scenario['velocity'])}: {start.end}"
        for start in checked.starts
        if start.end != "steady"
    ]
    if checked.basin is not None:
        more = "" if checked.basin_lost else " or more"
        late = "" if gains.delay is None else " (without the delay)"
        text = f"velocity may jump by a factor {checked.basin:.3g}{more}, either way{late}"
        lines.append(text)
    return lines


def infeasible(found: Infeasible) -> str:
    """If no gains meet the requirement: by how much the best ones miss it, and what to do."""
    _, scenarios, region = found.task
    where, gains = found.scenario, found.gains
    k_p, k_v, speed, inertia = (unit_of(unit, region.coordinate) for unit in (*_UNITS, "m/s", "kg"))
    mass = "" if where["mass"] is None else f", mass {where['mass']:g} {inertia}"
    sample = f" (sample {where['sample']})" if number_of_samples(scenarios.laws) > 1 else ""
    limited = bool(np.any(np.isfinite(region.upper)))
    limits = f"k_p up to {region.upper[0]:g} {k_p}, k_v up to {region.upper[1]:g} {k_v}"
    which = f"within the limits ({limits})" if limited else "of any size"
    advice = ["lower the margin", *(["widen the limits"] if limited else [])]
    advice += [] if scenarios.delay is None else ["reduce the controller's delay"]
    return (
        f"no gains {which} meet the requirement: {found.margin}={found.required:g} is missed"
        f" at velocity {where['velocity']:.3g} {speed}{mass}{sample}, where the best"
        f" compromise, k_p = {gains[0]:.3g} {k_p} and k_v = {gains[1]:.3g} {k_v}, reaches"
        f" {found.reached:.3g}; {', '.join(advice)} or leave that scenario out"
    )
