"""Gains as text (the answer, tables of optima and margins, the evidence) and as JSON."""

import math

import numpy as np

from ..coordinate import unit_of
from ..findings import listed
from ..gains.hunting import Hunting
from ..gains.requirement import Requirement
from ..gains.result import Certificate, Gains, LocalOptimum, WorstCase, norm_text
from ..gains.scenarios import number_of_samples
from ..gains.solve import Infeasible
from ..gains.thresholds import FRAGILE, ZERO
from ..plain import entries, plain
from ..schemas import GAINS
from ..stability.margin_table import MARGINS
from ..units import between, prefixed
from .report import Report
from .stability import UNITS
from .tables import TextTable
from .words import amount, say

HELD_BY = {"stiff": "stiffness", "damped": "damping"}
"""What gains of `stiff` or `damped` optima hold the slider by."""


def report(gains: Gains) -> Report:
    """Report the gains, their margins, scenarios, all optima, and evidence of optimality."""
    lines = [gains.law, f"required: {required(gains.requirement)}{_accuracy(gains)}"]
    if gains.delay is not None:
        samples = "" if gains.sample_time is None else " (1.5 samples)"
        lines.append(f"controller: answers {prefixed(gains.delay, 's')} late{samples}")
    integral = ""
    if gains.integral is not None:
        k_i = amount(gains, gains.integral, "N/(m s)")
        integral = f" + k_i int (x_ref - x) dt, k_i = {k_i}"
    lines.append(f"controller: force = k_p (x_ref - x) + k_v (v_ref - v){integral}")
    lines += [*_largest(gains), *_at_rest(gains), certified(gains.certificate)]
    tables = [_optima(gains), _margins(gains)]
    return Report(headline(gains), tables, lines, _simulation(gains), gains.warnings)


def headline(gains: Gains) -> list[str]:
    """State warnings, gains, margins (rounded down), scenarios, and how motions end: simulated
    ones, and those that come to rest."""
    asked = {"modulus", "delay", *gains.requirement.names}
    margins = ", ".join(
        f"{name} margin {_least(worst)}"
        for name, worst in gains.margins.items()
        if name in asked and math.isfinite(worst.value)
    )
    kp, kv = _pair(gains, gains.kp, gains.kv)
    told = f"{kp if gains.any_stiffness else f'k_p = {kp}'}, k_v = {kv}"
    if gains.none_needed:
        told = f"stable at any gain, because friction damps the motion, {kp}"
    doubts = [f"NOT RECOMMENDED: {'; '.join(gains.unsafe)}"] if gains.unsafe else []
    if gains.fragile:
        doubts.append(say("gains.fragile", modulus=gains.margins["modulus"].value, least=FRAGILE))
    moving = [] if gains.hunting else _simulation(gains)[:1]
    last = "; ".join([*moving, *_at_rest(gains)])
    told += f" ({margins})" if margins else ""
    return [*doubts, told, f"scenarios: {_scenarios(gains)}", *([] if doubts else [last])]


def _pair(gains: Gains, k_p: float, k_v: float) -> tuple[str, str]:
    """k_p and k_v with their units."""
    known = gains.region.any_stiffness(k_p)
    stiffness = gains.smallest_kp if known else amount(gains, k_p, "N/m")
    return stiffness, amount(gains, k_v, "N s/m")


def _least(worst: WorstCase) -> str:
    """Three digits of a margin with its unit, rounded down."""
    value = worst.value
    if value > 0:
        unit = 10.0 ** (math.floor(math.log10(value)) - 2)
        value = math.floor(value / unit * (1 + 1e-9)) * unit
    return prefixed(value, worst.unit, 3)


def certified(known: Certificate) -> str:
    """Say how well gains meet the optimality conditions, and whether smaller gains suffice."""
    text = f"optimality conditions met to {known.kkt_residual:.1e}; "
    if known.kkt_residual > ZERO:
        text = "they meet all that is required; that they are the smallest is not shown; "
    if not known.grid_points:
        return text + "no smaller gains were tried: the limits leave none"
    return f"{text}of {known.grid_points} smaller gains tried, {known.smaller_found} meet it"


def _accuracy(gains: Gains) -> str:
    """The accuracy that is required at rest, and the stiffness that it asks for."""
    if gains.accuracy is None or gains.rest_friction is None:
        return ""
    least = amount(gains, gains.rest_friction / gains.accuracy, "N/m")
    return f", {amount(gains, gains.accuracy, 'm')} accuracy at rest (k_p >= {least})"


def _at_rest(gains: Gains) -> list[str]:
    """How near its target the slider stops, or whether integral action makes it hunt about it."""
    if (found := gains.hunting) is not None:
        masses = " and ".join(amount(gains, mass, "kg") for mass in found.masses)
        laws = f", with {len(found.samples)} samples of the law" if len(found.samples) > 1 else ""
        at = f"(simulated at {masses}{laws})"
        seen, error = f"within {found.duration:.3g} s {at}", amount(gains, found.error, "m")
        if not found.clear:
            return [say("gains.not_clear", seen=seen, error=error)]
        if found.amplitude is None:
            return [say("gains.no_hunting", seen=seen)]
        if found.period is None:
            return [say("gains.grows")]
        size = amount(gains, found.amplitude, "m")
        return [say("gains.hunts", size=size, period=found.period, at=at)]
    if gains.dead_band is None or gains.rest_friction is None:
        return []
    band, friction = amount(gains, gains.dead_band, "m"), amount(gains, gains.rest_friction, "N")
    return [say("gains.stops", band=band, friction=friction)]


def required(what: Requirement) -> str:
    """State the required margins, and mark the default margin."""
    told = [f"{name} >= {value:g}" for name, value in zip(what.names, what.values, strict=True)]
    if what.kept:  # the default comes first
        told[0] += " (the default)"
    return ", ".join(told)


def _scenarios(gains: Gains) -> str:
    scenarios, V, mass = gains.scenarios, gains.scenarios.velocity, gains.scenarios.mass
    ends = dict.fromkeys(amount(gains, v, "m/s", 3) for v in (V.min(), V.max()))
    inertia = "no mass"
    if mass is not None:
        inertia = f"mass {between(mass.min(), mass.max(), gains.unit('kg'))}"
    text = f"{len(scenarios)}, velocity {' to '.join(ends)}, {inertia}"
    count = len(set(scenarios.sample.tolist()))
    text += f", {count} samples of the law" if count > 1 else ""
    if gains.confidence < 1:
        text += f" ({gains.kept_samples} kept, confidence {gains.confidence:g})"
    return text


def _optima(gains: Gains) -> TextTable:
    """The local optima, and the need of stiffness alone and of damping alone."""
    rows = [
        (_how(gains, one), *_pair(gains, one.kp, one.kv), norm_text(one.norm))
        for one in gains.optima
    ]
    k_p, k_v = gains.region.scale
    note = f"norm: of k_p/{k_p:.5g} and k_v/{k_v:.5g} (SI)"
    if (alone := gains.alone) is not None:
        pairs = zip(alone.tried, ("N/m", "N s/m"), strict=True)
        k_p, k_v = (f"none up to {amount(gains, tried, unit, 3)}" for tried, unit in pairs)
        rows += [] if alone.meets[0] else [("stiffness alone", k_p, "0", "")]
        rows += [] if alone.meets[1] else [("damping alone", "0", k_v, "")]
        if alone.edge is not None:
            k_p, k_v = (f"{edge:.6g}" for edge in alone.edge)
            note += f"; without margins k_p = {k_p} or k_v = {k_v} alone is enough (inf: none is)"
    heads = ("held by", "k_p", "k_v", "norm")
    return TextTable("Smallest gains that meet the requirement", heads, rows, note)


def _how(gains: Gains, one: LocalOptimum) -> str:
    if one.kv == 0 and gains.region.any_stiffness(one.kp):
        return "friction itself"
    return HELD_BY[one.name] + ("" if one.minimum else " alone")


def _largest(gains: Gains) -> list[str]:
    """A line on how large the gains may be where none are needed and the controller is late."""
    if gains.largest is None:
        return []
    k_p, k_v = gains.largest
    k_p, k_v = amount(gains, k_p, "N/m", 3), amount(gains, k_v, "N s/m", 3)
    return [say("gains.larger", k_p=k_p, k_v=k_v)]


def _margins(gains: Gains) -> TextTable:
    """Every margin at these gains, and the scenario in which it is least."""
    rows = []
    for name, worst in gains.margins.items():
        where, text = worst.scenario, prefixed(worst.value, worst.unit, 5)
        if math.isinf(worst.value) and name in MARGINS:
            text = MARGINS[name].unlimited
        mass = "" if where["mass"] is None else amount(gains, where["mass"], "kg", 3)
        velocity = amount(gains, where["velocity"], "m/s", 3)
        rows.append((name, text, velocity, mass, str(where["sample"])))
    heads = ("margin", "worst", "at", "mass", "sample")
    return TextTable("Margins at these gains", heads, rows)


def _simulation(gains: Gains) -> list[str]:
    checked = gains.simulation
    if checked is None:
        return ["not checked by simulation"]
    late = "" if gains.delay is None else " without the controller's delay"
    others = {
        "in a limit cycle": checked.limit_cycle,
        "in escape": checked.escaped,
        "unresolved": checked.unresolved,
    }
    ends = [f"{checked.steady} end steady", *(f"{n} {name}" for name, n in others.items() if n)]
    lines = [f"simulated{late} from {checked.checked} starts: {', '.join(ends)}"]
    lines += [
        f"  {start.start} at {amount(gains, start.scenario['velocity'], 'm/s', 3)}: {start.end}"
        for start in checked.starts
        if start.end != "steady"
    ]
    if checked.basin is not None:
        more = "" if checked.basin_lost else " or more"
        lines.append(f"velocity may jump by a factor {checked.basin:.3g}{more}, either way{late}")
    return lines


def infeasible(found: Infeasible) -> str:
    """Say by how much the best gains miss an infeasible requirement, and what to do."""
    _, scenarios, region = found.task
    where = found.scenario

    def text(value: float, unit: str) -> str:
        return prefixed(value, unit_of(unit, region.coordinate), 3)

    mass = "" if where["mass"] is None else f", mass {text(where['mass'], 'kg')}"
    sample = f" (sample {where['sample']})" if number_of_samples(scenarios.laws) > 1 else ""
    (most_kp, most_kv), (k_p, k_v) = region.upper, found.gains
    best = " even alone: the best pair," if found.alone else ", where the best compromise,"
    out = "that scenario" if found.alone else "hard scenarios"
    reached = f"reaches {found.reached:.3g}" if found.reached >= 0 else "is unstable"
    return (
        f"no gains (k_p up to {text(most_kp, 'N/m')}, k_v up to {text(most_kv, 'N s/m')}) meet the"
        f" requirement: {found.margin}={found.required:g} is missed at velocity"
        f" {text(where['velocity'], 'm/s')}{mass}{sample}{best} k_p ="
        f" {text(k_p, 'N/m')} and k_v = {text(k_v, 'N s/m')}, {reached}; lower"
        f" the margin, widen the limits, reduce the controller's delay or leave {out} out"
    )


# ---- JSON --------------------------------------------------------------------------------------


def content(gains: Gains) -> dict:
    """The content of `gains.json`, schema `schemas.GAINS`; SI, null for infinite numbers."""
    region, scenarios, unsafe = gains.region, gains.scenarios, list(gains.unsafe)
    result = {
        "schema": GAINS,
        **entries(gains, "law", "kp", "kv", "norm", "fragile", "optima", controller_delay="delay"),
        "recommended": not unsafe,
        "not_recommended": unsafe,
        "ki": gains.integral or 0.0,
        "units": {name: gains.unit(unit) for name, unit in UNITS.items()},
        "scales": _by_gain(region.scale),
        "limits": _by_gain(np.stack([region.lower, region.upper], axis=1)),
        "required": dict(zip(gains.requirement.names, gains.requirement.values, strict=True)),
        "at_rest": {
            **entries(gains, "dead_band", "accuracy", friction="rest_friction"),
            "hunting": gains.hunting and hunting_entry(gains.hunting),
            "units": {"friction": gains.unit("N"), "dead_band": gains.unit("m")},
        },
        "single_gain": _alone(gains),
        "largest": gains.largest and _by_gain(gains.largest),
        "margins": {
            name: entries(worst, "value", "unit", worst_scenario="scenario")
            for name, worst in gains.margins.items()
        },
        "scenarios": {
            "n": len(scenarios),
            "velocities": _range(scenarios.velocity),
            "masses": None if scenarios.mass is None else _range(scenarios.mass),
            "samples": int(np.unique(scenarios.sample).size),
            **entries(gains, "confidence", "kept_samples"),
        },
        **entries(gains, "certificate", "simulation"),
        **listed(gains.warnings),
    }
    return plain(result)


def hunting_entry(found: Hunting) -> dict:
    """The JSON entry `hunting`: growth, or amplitude and period, null if no hunting is seen."""
    grows = found.amplitude is not None and not np.isfinite(found.amplitude)
    return plain({**found._asdict(), "grows": grows})


def _alone(gains: Gains) -> dict | None:
    if (known := gains.alone) is None:
        return None
    rows = zip(
        ("stiffness", "damping"),
        known.meets,
        known.tried,
        known.edge or (np.inf, np.inf),
        strict=True,
    )
    return {
        name: {"meets": meets, "tried": tried, "without_margins": edge}
        for name, meets, tried, edge in rows
    }


def _by_gain(values: np.ndarray | tuple[float, float]) -> dict:
    return dict(zip(("kp", "kv"), values, strict=True))


def _range(values: np.ndarray) -> list[float]:
    return [float(np.min(values)), float(np.max(values))]
