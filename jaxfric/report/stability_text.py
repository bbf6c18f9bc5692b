"""A stability study as lines of text."""

import math
from typing import NamedTuple, SupportsFloat

import numpy as np

from ..rig.friction import AbstractStribeck, Dahl, critical_velocity, worst_slope
from ..stability.analysis import Study
from ..stability.delay_analysis import delay_numbers, delay_summary, intervals_over_velocity
from ..stability.margin_table import MARGINS
from ..stability.theorem import Theorem
from .gains_text import late_text
from .report import Report
from .stability_json import INTERVALS, intervals, solutions
from .tables import TextTable

_ROWS = 9


class _Units(NamedTuple):
    """Units of a line, or of a rotation."""

    force: str
    stiffness: str
    damping: str
    speed: str
    mass: str


def _units(study: Study) -> _Units:
    return _Units(*map(study.unit, ("N", "N/m", "N s/m", "m/s", "kg")))


def report(study: Study, law: str) -> Report:
    """Whether the gains stabilise the slider, or which gains would; the critical stiffness.

    A table by velocity and all results of linear theory follow.
    """
    return Report(_headline(study), _table(study), describe(study, law))


def _headline(study: Study) -> list[str]:
    """The gains that were asked about, the conclusion of the theorem, and the damping that needs
    no stiffness, at the hardest velocity."""
    u, at = _units(study), study.here
    several = len(study.points.velocity) > 1
    where = f"at {_number(at.velocity)} {u.speed}" + (", the hardest velocity" if several else "")
    told = []
    if study.k_p is not None and study.margins is not None:
        word = "STABLE" if bool(study.stable) else "UNSTABLE"
        modulus = float(study.margins["modulus"]) if "modulus" in study.margins else math.nan
        margin = f" (modulus margin {modulus:.3g})" if math.isfinite(modulus) else ""
        gains = f"k_p = {study.k_p:g} {u.stiffness}, k_v = {study.k_v:g} {u.damping}"
        told.append(f"{gains}: {word} {where}{margin}")
    slope = float(at.steady_slope)
    sign = "velocity weakening " if slope < 0 else "velocity strengthening " if slope > 0 else ""
    known = _stable_by_delay(study) if study.delayed else _conclusion(study)
    told.append(f"{sign}{where}: {known}")
    needed = float(at.needed_damping)
    if needed > 0:
        told.append(f"damping alone: k_v >= {needed:.4g} {u.damping}, {_without(study)}")
    return [*told, *_spread(study)][:3]


def _stable_by_delay(study: Study) -> str:
    """Which k_p are stable under a delay law: all, the first interval, or none that was found."""
    k_v, k_f = (float(x) for x in delay_numbers(study)[1:3])
    if k_v >= abs(k_f):
        return "every k_p > 0 is stable"
    found = intervals(study)
    if not found:
        return "no stable k_p was found"
    low, high = found[0][:2]
    unit = _units(study).stiffness
    more = ", and in further intervals of k_p" if len(found) > 1 else ""
    return f"stable for {low:.4g} < k_p < {high:.4g} {unit}{more}"


def describe(study: Study, law: str) -> list[str]:
    """The results of linear theory, for a reader who knows friction or control."""
    u = _units(study)
    mass = "none (quasi-static limit)" if study.mass is None else f"{study.mass:g} {u.mass}"
    lines = [law, f"mass: {mass}; damping k_v: {study.k_v:g} {u.damping}"]
    if len(study.points.velocity) > 1:
        why = "" if study.is_spring else " (the least modulus margin)"
        lines += ["", f"hardest velocity{why}: {_number(study.here.velocity)} {u.speed}; there"]
    else:
        lines += ["", f"steady sliding at {_number(study.here.velocity)} {u.speed}:"]
    lines += [f"  {line}" for line in _friction(study)]
    lines += ["", *(_delay(study) if study.delayed else _theorem(study))]
    if isinstance(study.law, AbstractStribeck):
        lines += _memoryless(study.law, _units(study))
    if isinstance(study.law, Dahl):
        lines.append(
            "Dahl's steady curve has no falling part and no memory of velocity. This friction does"
            " not cause stick-slip, and every k_p > 0 is stable where f_v + k_v > 0"
        )
    lines += _gains(study)
    return [*lines, "", "numbers such as (18) are equations of the documentation's page 'theory'"]


def _friction(study: Study) -> list[str]:
    at, u = study.here, _units(study)
    lines = [
        f"steady friction            {_number(at.force)} {u.force}",
        f"f_v, instantaneous slope   {_number(at.slope)} {u.damping}",
        f"G(0) = int g dt, memory    {_number(at.memory)} {u.damping}",
        f"steady slope f_v - G(0)    {_number(at.steady_slope)} {u.damping}",
    ]
    if float(at.friction.trend):
        trend = _number(at.friction.trend)
        lines.append(f"slope with slip f_x        {trend} {u.stiffness} (adds to k_p below)")
    if not float(at.force) > 0:
        lines[0] += "   (not positive: f0 is too small for this velocity)"
    needed = float(at.needed_damping)
    text = (
        f"k_v >= {needed:.6g} {u.damping}, {_without(study)}"
        if needed > 0
        else "none needed (k_v > 0 keeps it so)"
    )
    return [*lines, f"damping that needs no stiffness: {text}"]


def _without(study: Study) -> str:
    """What is not in the numbers of the theorem."""
    missing = ["margins"]
    missing += [] if study.late is None else ["delay"]
    missing += [] if study.k_i is None else ["integral action"]
    return f"without {' and '.join(missing)}"


def _theorem(study: Study) -> list[str]:
    found, u = study.theorem, _units(study)
    checks = theorem_lines(found)[:-1]
    at_once = "" if study.late is None else ", of a controller that answers at once"
    at_once += "" if study.k_i is None else ", without integral action"
    lines = [f"theorem of Rice and Ruina, (18)-(20){at_once}:", *(f"  {line}" for line in checks)]
    for w, k in solutions(study):
        lines.append(
            f"  w_n = {w:.8g} rad/s ({w / (2 * math.pi):.4g} Hz): k(w_n) = {k:.8g} {u.stiffness}"
        )
    return [*lines, _conclusion(study), *_spread(study)]


def _conclusion(study: Study) -> str:
    """What the theorem says of k_p."""
    k_cr = float(study.theorem.critical_stiffness)
    w_cr = float(study.theorem.critical_frequency)
    if 0 < k_cr < math.inf:
        at = f"k_cr = {k_cr:.10g} {_units(study).stiffness}, w_cr = {w_cr:.10g} rad/s"
        return f"{at}: stable for k_p above k_cr, {_without(study)}"
    late = "; the delay bounds k_p and k_v" if k_cr == 0 and study.late is not None else ""
    return _in_short(study.theorem) + late


def theorem_lines(found: Theorem) -> list[str]:
    """Lines on the theorem: its checked hypotheses, those that fail, and the conclusion."""
    checks = {
        "g integrable and piecewise continuous, G bounded for Re s >= 0": found.integrable,
        "f_v + k_v > 0": found.damped,
        "f_v + k_v < int g dt (18)": found.underdamped,
        "all solutions of (19) found": found.complete,
    }
    lines = [f"{'holds' if bool(held) else 'FAILS'}: {text}" for text, held in checks.items()]
    if float(found.critical_stiffness) == 0:  # no failure: damping alone stabilises the slider
        lines[2] = "does not hold: f_v + k_v < int g dt (18); damping alone stabilises the slider"
    return [*lines, _in_short(found)]


def _in_short(found: Theorem) -> str:
    k = float(found.critical_stiffness)
    if not bool(found.damped):
        return "no stiffness suffices: the instantaneous damping f_v + k_v is not positive"
    if k == 0:
        return "stable by damping for every positive stiffness"
    if not bool(found.integrable):
        return "no critical stiffness: the kernel does not satisfy the theorem"
    return f"critical stiffness {k:.10g} at {float(found.critical_frequency):.10g} rad/s"


def _spread(study: Study) -> list[str]:
    """The 95 % interval of k_cr, where the law has samples."""
    ends = study.critical_interval
    if ends is None or study.sampled is None:
        return []
    u = _units(study)
    upper = f"{ends[1]:.4g} {u.stiffness}" if math.isfinite(ends[1]) else "infinity"
    return [
        f"k_cr lies from {ends[0]:.4g} to {upper} with 95 % (of {len(study.sampled)} samples of the"
        " fit's covariance)"
    ]


def _memoryless(law: AbstractStribeck, u: _Units) -> list[str]:
    V, slope = float(critical_velocity(law)), float(worst_slope(law))
    if not math.isfinite(slope):
        return ["no memory: the curve falls without bound towards V = 0; no k_v suffices there"]
    need = f"k_v > {-slope:.10g} {u.damping}" if slope < 0 else "any k_v > 0"
    return [
        f"no memory, (16)-(17): hardest of all velocities V_cr = {V:.10g} {u.speed}, where"
        f" f_v = {slope:.10g} {u.damping}; {need} and k_p > 0 are stable at every velocity"
    ]


def _delay(study: Study) -> list[str]:
    numbers, u = delay_numbers(study), _units(study)
    k_v, k_f, alpha = (float(x) for x in numbers[1:])
    lines = ["delay law: no critical stiffness; stability alternates with k_p, (26)-(31)"]
    lines.append(
        f"  k_f = {k_f:.6g} {u.damping}, alpha = {alpha:.6g} s, damping k_v + f_v ="
        f" {k_v:.6g} {u.damping}"
    )
    known = delay_summary(study, number=INTERVALS)
    exists = bool(known.exists)
    if k_v >= abs(k_f):
        return [*lines, "  k_v >= |k_f|: every k_p > 0 is stable"]
    if k_f > 0:
        root = math.sqrt(k_f**2 - k_v**2)
        gap = numbers[0] * 2 * (math.pi - math.acos(k_v / k_f)) / alpha
        sign = ">" if exists else "<="
        what = "infinitely many stable intervals" if exists else "no stable k_p at all"
        lines.append(
            f"  existence: m (2 pi - 2 beta)/alpha = {gap:.6g} {sign} sqrt(k_f^2 - k_v^2) ="
            f" {root:.6g} {u.damping}: {what}"
        )
    for low, high, w_low, w_high in intervals(study):
        lines.append(
            f"  stable: {low:.10g} < k_p < {high:.10g} {u.stiffness}   (crossings at"
            f" {w_low:.6g} and {w_high:.6g} rad/s)"
        )
    lines.append(
        "  the 1994 paper's list (30) is short of these: it leaves out n = 0, the first threshold,"
        " and the whole -beta branch, at which stability is lost again"
    )
    if study.k_p is not None:
        count = int(known.unstable)
        roots = f"unstable root{'' if count == 1 else 's'}"
        lines.append(f"  at k_p = {study.k_p:g} {u.stiffness}: {count} {roots}")
    return lines


def _gains(study: Study) -> list[str]:
    if study.k_p is None or study.margins is None or study.poles is None:
        return [
            "",
            "give --kp for poles and margins; 'jaxfric gains' finds the gains that have margins",
        ]
    u = _units(study)
    word = "STABLE" if bool(study.stable) else "UNSTABLE"
    late = "" if study.k_i is None else f", k_i = {study.k_i:g} {study.unit('N/(m s)')}"
    late += "" if study.late is None else f", a controller that {late_text(study.late)}"
    lines = [
        "",
        f"k_p = {study.k_p:g} {u.stiffness}, k_v = {study.k_v:g} {u.damping}{late}: {word}",
    ]
    what = "rightmost pole" if study.delayed else "poles"
    if study.late is not None:
        what += f", with Pade's approximant of the delay: rough beyond |s| = {3 / study.late:.3g}"
    lines.append(f"{what} [1/s]:")
    for s in sorted(np.asarray(study.poles), key=lambda s: (-s.real, s.imag)):
        lines.append(f"  {_pole(s)}")
    lines.append("margins:")
    for name in (name for name in MARGINS if name in study.margins):
        value = float(study.margins[name])
        text, limited = _margin(name, value), value != math.inf
        if name == "delay" and study.late is not None and limited:
            text += " more"
        if name == "stiffness" and study.delayed and limited:
            text = "not defined: there is no critical stiffness"
        lines.append(f"  {name:<10}{text}")
    return lines


def _pole(s: complex) -> str:
    if not math.isfinite(s.real):
        return "at infinity (order lost: no mass)"
    if abs(s.imag) <= 1e-12 * abs(s):
        return f"{s.real:.8g}"
    size = abs(s)
    return (
        f"{s.real:.8g} {'+' if s.imag > 0 else '-'} {abs(s.imag):.8g}i   (|s| = {size:.4g} rad/s)"
    )


def _margin(name: str, value: float) -> str:
    about = MARGINS[name]
    if math.isinf(value) and value > 0:
        return f"inf ({about.unlimited})"
    degrees = f" ({math.degrees(value):.4g} deg)" if about.unit == "rad" else ""
    return f"{value:.6g}{about.suffix}{degrees}"


def _table(study: Study) -> list[TextTable]:
    """At some of several velocities, the ends and evenly between: what holds the slider there."""
    number, u = len(study.points.velocity), _units(study)
    if number < 2:
        return []
    rows = np.unique(np.linspace(0, number - 1, min(number, _ROWS)).round().astype(int))
    V, needed = np.asarray(study.points.velocity), np.asarray(study.points.needed_damping)
    speed, damping = f"velocity [{u.speed}]", f"k_v for all k_p [{u.damping}]"
    if study.delayed:
        low, high = (x[:, 0] for x in _first_interval(study))
        heads = (speed, damping, f"first stable k_p [{u.stiffness}]")
        cells = [
            (f"{V[i]:.4g}", f"{needed[i]:.5g}", _interval(float(low[i]), float(high[i])))
            for i in rows
        ]
        return [TextTable("By velocity", heads, cells)]
    k_cr = np.asarray(study.theorems.critical_stiffness)
    w_cr = np.asarray(study.theorems.critical_frequency)
    heads = (speed, f"k_cr [{u.stiffness}]", "w_cr [rad/s]", damping)
    cells = [(f"{V[i]:.4g}", f"{k_cr[i]:.6g}", f"{w_cr[i]:.6g}", f"{needed[i]:.6g}") for i in rows]
    notes = []
    if np.any(np.isinf(k_cr)):
        notes.append("k_cr inf: no stiffness suffices, f_v + k_v is not positive there")
    if np.any(k_cr == 0):
        notes.append("k_cr 0: every k_p > 0 is stable there")
    return [TextTable("By velocity", heads, cells, "; ".join(notes))]


def _first_interval(study: Study) -> tuple[np.ndarray, np.ndarray]:
    low, high = intervals_over_velocity(study)
    return np.asarray(low), np.asarray(high)


def _interval(low: float, high: float) -> str:
    if math.isinf(low):
        return "none"
    return f"above {low:.5g}" if math.isinf(high) else f"{low:.5g} .. {high:.5g}"


def _number(value: SupportsFloat) -> str:
    return f"{float(value):.6g}"
