"""What a user sees of a closed loop: tables, figures, the page and the verb.

The loops are made up: hand-written numbers, no fit.
"""

import dataclasses
import io
import itertools
import json
import math
import re
import shlex
from collections.abc import Sequence
from html import escape, unescape
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import jax.numpy as jnp
import numpy as np
import pytest
from command import assert_refused, record_text, run, written
from cyclopts import CycloptsError
from matplotlib.figure import Figure
from matplotlib.image import imread
from rich.console import Console

import jaxfric
from jaxfric.cli.app import app
from jaxfric.cli.loop import end_loop
from jaxfric.effects import AXIS_CATALOGUE, CATALOGUE, RunChange, separators
from jaxfric.effects.effect import made
from jaxfric.findings import Finding, Severity
from jaxfric.fitting import Estimate, Fit, NoiseEstimate, NoisePart
from jaxfric.fitting.axis_preparation import Preparation
from jaxfric.fitting.problem import Model
from jaxfric.gains.axis_result import AxisGains
from jaxfric.loop import LoopCode
from jaxfric.loop.axis.result import AxisDetails
from jaxfric.loop.family import CurveFamily, Decisive, OtherShape
from jaxfric.loop.refusal import Fault, Refusal
from jaxfric.loop.result import (
    VERDICTS,
    CandidateScore,
    LocationProfile,
    Loop,
    Score,
    ScreenedEffect,
)
from jaxfric.loop.split import NAMES, split
from jaxfric.loop.verdict import Told
from jaxfric.plot import style
from jaxfric.plot.loop import FIGURES, residual_figure
from jaxfric.records import VelocitySteps, from_arrays
from jaxfric.records.record import Provenance
from jaxfric.report.aliases import apart
from jaxfric.report.axis_loop_text import gains_table
from jaxfric.report.fit_text import noise_text, summary
from jaxfric.report.loop_next import next_steps, takes_gains
from jaxfric.report.loop_page import page
from jaxfric.report.loop_plan import CHANGES, PlannedRun, deciding_run
from jaxfric.report.loop_report import first_lines, headline
from jaxfric.report.loop_report import report as report_of
from jaxfric.report.loop_text import candidates, errors, moved, rests_on
from jaxfric.report.report import print_details
from jaxfric.report.rig_words import AXIS, SLIDER
from jaxfric.report.verdict_text import change, words_of_refusal
from jaxfric.report.version import installed_version
from jaxfric.saved import law_from_fit
from jaxfric.stability.claims import Curve, Unseen

HOSTILE = "<b>&.csv"
KEYS = (
    "schema verdict effects alias_groups candidates before after noise tests location_map seconds"
)
SENTENCES = {
    "no_missing_effect": "The slip law explains this record to its noise; no effect is missing.",
    "effects": "The slip law lacks second_state; with it the error on rows that the fit did not"
    " see falls from 1.47 to 1.00 times the noise.",
    "ambiguous": "An effect is missing: time_drift or slip_trend, which this record cannot tell"
    " apart.",
    "outside_catalogue": "Something is missing that no effect of the catalogue explains.",
    "too_weak": "There may be a missing effect, but it is too weak in this record to be named.",
}
EFFECTS = {"effects": ("second_state",), "ambiguous": ("time_drift",)}
LOOSE = Refusal(Fault.NOT_FIXED, ("x",))
VELOCITIES = 1e-6 * np.asarray([1, 10, 1, 3, 10, 1, 10, 3, 1, 10, 3, 1, 10])


def make_loop(
    verdict: str, *, rows: int = 520, many: bool = True, unit: str = "1", path: str = "run.csv"
) -> Loop:
    """A loop that never ran: 12 steps of 150 um (or one), white noise, made-up structure."""
    random = np.random.default_rng(VERDICTS.index(verdict))
    steps = _steps(many)
    size = 500.0 if unit == "N" else 1.0
    sigma = 3e-4 * size
    end = steps.times[-1] + 150e-6 / steps.velocities[-1]
    time = _times(steps, end, rows)
    slip = steps.displacement(time)
    noise = sigma * random.normal(size=len(time))
    before = noise + _structure(verdict, steps, time, slip) * size
    after = noise if verdict in EFFECTS else before
    friction = 0.6 * size + before
    record = from_arrays(
        time, friction, load_point_velocity=steps.velocity(time), friction_unit=unit
    )
    record = _of_file(record, path)
    blocks = split(time, steps)
    parameters = _parameters(size, unit, 1.0)
    fit = Fit(
        record, steps, Model(law="slip"), parameters, ("f0", "A", "B", "L"), np.eye(4) * 1e-8,
        np.eye(4), friction, 1.0, sigma, NoiseEstimate(sigma, (NoisePart(0.3, "time", 0.8),)),
        True, "converged", 7,
        "ordinary", (),
    )  # fmt: skip
    effects = EFFECTS.get(verdict, ())
    scores = [
        _score((), before, blocks, parameters, sigma, 1e-40 if verdict in EFFECTS else 0.4),
        _score(effects, after, blocks, _extended(effects, size, unit), sigma, 0.61),
    ]
    ids = tuple(CATALOGUE)
    return Loop(
        record=record,
        base_fit=fit,
        kind="slider",
        blocks=blocks,
        verdict=verdict,
        sentence=SENTENCES[verdict],
        reasons=("held-out error is 1.31 times the noise",) if verdict[0] == "o" else (),
        effects=effects,
        alias_groups=_groups(effects),
        separations={id: separators(CATALOGUE[id]) for id in effects},
        candidates=_candidates(effects, scores),
        screened=tuple(
            ScreenedEffect(id, 12.0 - 900.0 / (1 + k) ** 2 if effects else 1.2 * k - 4.0)
            for k, id in enumerate((*effects, *(i for i in ids if i not in effects)))
        ),
        before=scores[0],
        after=scores[1],
        sigma=sigma,
        location=_location(sigma, steps, end),
        alias_ids=ids,
        alias_cosines=_cosines(ids),
        warnings=("K is 1.6 times critical: finite steps may leave the basin",),
        seconds=23.4,
        findings=(),
        velocity=np.asarray(steps.velocity(time)),
    )


def _of_file(record, path: str):
    return dataclasses.replace(record, provenance=Provenance(path, "5f" * 32, len(record)))


def _steps(many: bool) -> VelocitySteps:
    V = VELOCITIES if many else VELOCITIES[:2]
    return VelocitySteps(np.concatenate([[0.0], np.cumsum(150e-6 / V[:-1])]), V)


def _times(steps: VelocitySteps, end: float, rows: int) -> np.ndarray:
    """Rows evenly spaced in slip, so that every velocity has as many."""
    edges = np.append(steps.times, end)
    each = rows // len(steps)
    return np.unique(
        np.concatenate([np.linspace(a, b, each) for a, b in itertools.pairwise(edges)])
    )


def _structure(verdict: str, steps: VelocitySteps, time, slip) -> np.ndarray:
    if verdict in ("no_missing_effect", "too_weak"):
        return np.zeros(len(time))
    if verdict == "ambiguous":
        return 1.2e-3 * (time / time[-1] - 0.5)
    total = np.zeros(len(time))
    V = steps.velocities
    for k, at in enumerate(steps.displacement(steps.times)[1:], start=1):
        x = np.maximum(slip - at, 0) / 60e-6
        total += (slip >= at) * 4e-4 * np.log(V[k] / V[k - 1]) * (np.exp(-x) - 0.4)
    return total


def _estimate(value: float, std: float, unit: str, **more: Any) -> Estimate:
    return Estimate(value, std, value - 1.96 * std, value + 1.96 * std, unit, **more)


def _parameters(size: float, unit: str, change: float) -> dict[str, Estimate]:
    return {
        "f0": _estimate(0.6 * size, 4e-5 * size, unit),
        "A": _estimate(0.0105 * size * change, 6e-5 * size, unit),
        "B": _estimate(0.0142 * size / change, 7e-5 * size, unit),
        "L": _estimate(18.3e-6 * change, 4e-7, "m"),
        "K": Estimate(3e3 * size, 0.0, 0.0, 0.0, f"{unit}/m", free=False),
        "V0": Estimate(1e-6, 0.0, 0.0, 0.0, "m/s", free=False),
    }


def _extended(effects: tuple[str, ...], size: float, unit: str) -> dict[str, Estimate]:
    found = _parameters(size, unit, 0.94 if effects else 1.0)
    if "second_state" in effects:
        found["second_state.B2"] = _estimate(1.94e-3 * size, 8e-5 * size, unit)
        found["second_state.L2"] = _estimate(6.1e-5, 4e-6, "m")
    if "time_drift" in effects:
        found["time_drift.r"] = _estimate(1.9e-6 * size, 3e-8 * size, f"{unit}/s")
    return found


def _score(effects, residual, blocks, parameters, sigma: float, p: float) -> Score:
    def rms(mask) -> float:
        return float(np.sqrt(np.mean(residual[mask] ** 2)))

    free = tuple(name for name, e in parameters.items() if e.free)
    return Score(
        effects=effects,
        rms={name: rms(blocks.of(name)) for name in NAMES},
        per_step=tuple(rms(blocks.step == k) for k in range(blocks.step.max() + 1)),
        residual=-residual,
        parameters=parameters,
        free=free,
        covariance=np.diag([parameters[name].std ** 2 for name in free]),
        noise=NoiseEstimate(sigma, (NoisePart(0.3, "time", 0.8),)),
        tests={"ljung_box": p, "block_means": min(1.0, 2 * p), "step_locked": min(1.0, 30 * p)},
    )


def _groups(effects: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    return tuple((id, *(["slip_trend"] if id == "time_drift" else [])) for id in effects)


def _candidates(effects, scores: list[Score]) -> tuple[CandidateScore, ...]:
    base, best = (s.rms["select"] for s in scores)
    first = effects[0] if effects else "viscous"
    best_bic = -1480.0 if effects else -3.0
    found = [((), 0.0, base, True, True), ((first,), best_bic, best, True, True)]
    found += [(("run_in",), 0.4 * best_bic, 0.5 * (base + best), True, True)]
    found += [(("thermal",), -8.0, 0.97 * base, False, True), (("gain",), 6.8, base, True, True)]
    found += [(("stribeck",), np.nan, np.nan, True, False)]
    found += [((first, "velocity_dependent_L"), best_bic - 2.1, 1.01 * best, True, True)]
    return tuple(
        CandidateScore(e, d, h, h, {}, ok, done, bool(e) and e == effects)
        for e, d, h, ok, done in found
    )


def _location(sigma: float, steps: VelocitySteps, end: float) -> tuple[LocationProfile, ...]:
    random = np.random.default_rng(9)
    total = float(steps.displacement(end))
    axes = {
        "time_since_step": ("s", np.geomspace(0.3, 150, 12), 0.71, 1e-80, 0.71),
        "state": ("F", np.linspace(-0.02, 0.02, 12), 0.55, 3e-41, 0.0),
        "slip": ("m", np.linspace(0, total, 14), 0.12, 2e-3, 0.06),
        "log_velocity": ("1", np.log(np.geomspace(1, 10, 5)), 0.04, 0.3, 0.0),
        "time": ("s", np.linspace(0, end, 14), 0.02, 0.7, 0.0),
        "slip_since_step": ("m", 150e-6 * np.geomspace(0.02, 1, 8), 0.02, 0.8, 0.0),
        "periodic_in_slip": ("m", 1 / np.linspace(2 / total, 60 / total, 16), 0.0, np.nan, 0.0),
    }
    return tuple(
        LocationProfile(
            name, unit, x, 2 * sigma * share * np.exp(-np.linspace(-1, 3, len(x)) ** 2)
            + 0.15 * sigma * random.normal(size=len(x)), np.full(len(x), 0.15 * sigma),
            share, p, further,
        )
        for name, (unit, x, share, p, further) in axes.items()
    )  # fmt: skip


def _cosines(ids: tuple[str, ...]) -> np.ndarray:
    random = np.random.default_rng(5)
    values = random.uniform(0, 0.9, (len(ids), len(ids))) ** 1.5
    values = 0.5 * (values + values.T)
    named = {("time_drift", "slip_trend"): 0.995, ("servo_lag", "sensor_lag"): 0.998}
    named |= {("sensor_delay", "sensor_lag"): 0.98, ("sensor_delay", "servo_lag"): 0.966}
    for (a, b), value in named.items():
        i, j = ids.index(a), ids.index(b)
        values[i, j] = values[j, i] = value
    values[ids.index("damping")] = values[:, ids.index("damping")] = np.nan
    np.fill_diagonal(values, 1.0)
    return values


# ---- tests -----------------------------------------------------------------------------------


class Page(HTMLParser):
    """Checks that tags close in order and nothing is loaded; collects the text."""

    VOID = ("meta", "img", "br")
    LINES = ("title", "p", "h1", "h2", "li", "tr", "caption", "figcaption", "summary", "dd", "div")
    PARTS = ("td", "th", "dt", "b")

    def __init__(self, html: str):
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.seen: list[str] = []
        self.text = ""
        self.images = 0
        self.feed(html)
        self.close()
        assert self.open == [], f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        assert tag not in ("script", "link", "iframe", "object", "base"), tag
        for name, value in attrs:
            assert not name.startswith("on"), name
            if name in ("src", "href"):
                assert (value or "").startswith("data:image/svg+xml;base64,"), value
                self.images += 1
        self.seen.append(tag)
        self.text += "\n" * (tag == "pre")
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-1:]}"
        self.open.pop()
        self.text += "\n" if tag in self.LINES else "  " if tag in self.PARTS else ""

    def handle_data(self, data):
        if "style" not in self.open[-1:]:
            self.text += data


@pytest.mark.parametrize(
    ("html", "words"),
    [
        ("<p><b>x</p></b>", "closes"),
        ("<div>", "not closed"),
        ("<script>1</script>", "script"),
        ('<img src="https://example.org/a.png">', "https"),
    ],
)
def test_a_bad_page_is_noticed(html: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        Page(html)


def printed(loop: Loop, width: int = 120) -> str:
    console = Console(file=io.StringIO(), width=width, highlight=False)
    print_details(report_of(loop), console)
    return console.file.getvalue()


def html_of(loop: Loop) -> str:
    pictures = {f"{name}.svg": b"<svg/>" for name in FIGURES}
    return page(loop, pictures, command="jaxfric loop '<b>&.csv'")


def page_of(loop: Loop) -> Page:
    html = html_of(loop)
    assert "http" not in html and "@import" not in html and "url(" not in html
    return Page(html)


def to_do(loop: Loop) -> str:
    return "\n".join(f"{step.lead()}: {step.text} {step.command}" for step in next_steps(loop))


def commands(loop: Loop, words: str = "") -> list[str]:
    """Commands of what to do next that have these words."""
    return [step.command for step in next_steps(loop) if step.command and words in step.command]


def in_axis_words(loop: Loop, doubted: bool = False) -> Loop:
    """The loop with an answer, as an axis has one."""
    details = Mock(
        spec=AxisDetails,
        short=lambda: "stick-slip: nothing can be said",
        tables=list,
        doubted=lambda: doubted,
        found=str,
        doubt=str,
        gains=AxisGains(1.0, -2.0, 2.0, None),
        covariance=None,
    )
    return dataclasses.replace(loop, details=details)


@pytest.mark.parametrize(("words", "other"), [(SLIDER, AXIS), (AXIS, SLIDER)])
def test_each_rig_has_its_own_words(words, other, snapshot) -> None:
    """What is said of one rig is not said of the other: what its record is split by, its base, its
    parameters, its effects and what marks their beginning."""
    slider = words is SLIDER
    kind = "slider" if slider else "axis"
    loop = dataclasses.replace(make_loop("effects"), kind=kind, effects=("stribeck",))
    text, html = " ".join(printed(loop).split()), page_of(loop).text
    for shown in (text, html):
        assert not any(said in shown for said in (other.part, other.marks))
    weak = dataclasses.replace(make_loop("too_weak"), kind=kind)
    assert words.part in to_do(weak) and other.part not in to_do(weak)
    assert words.marks in html and words.catalogue["stribeck"].equation in html
    assert other.catalogue["stribeck"].equation not in html
    assert words.marks in figure_of(loop, "residual").axes[0].get_title(loc="left")
    snapshot(f"words_of_{kind}", {"page": html.replace(installed_version(), "1.2.3")})


@pytest.mark.parametrize("verdict", VERDICTS)
def test_what_is_read_has_one_sign_for_micrometres(verdict: str) -> None:
    """µm; commands, which are typed, have um."""
    loop = make_loop(verdict)
    html = re.sub(r"<pre.*?</pre>", "", html_of(loop), flags=re.DOTALL)
    told = [printed(loop), html, *(step.text for step in next_steps(loop))]
    assert all(re.search(r"\bum\b", text) is None for text in told)
    assert "µm" in told[0] and "µm" in told[1]


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_page_opens_with_what_it_means_and_what_to_do_next(verdict: str) -> None:
    """Words and equation of every effect before any number, and commands that the verbs take."""
    loop = make_loop(verdict)
    opening = unescape(html_of(loop).split("<figure>")[0])
    first = opening.split("What to do next")[0]
    for id in loop.effects:
        about = CATALOGUE[id]
        assert about.meaning in first and about.equation in first
    certain = verdict in ("no_missing_effect", "effects", "ambiguous")
    for verb in ("jaxfric gains --from loop.json", "jaxfric predict loop.json"):
        assert bool(commands(loop, verb)) == certain
    for line in commands(loop):
        words = shlex.split(line)
        assert words[0] == "jaxfric" and parsed(words[1:]) and line in opening
    assert not parsed(["gains", "--of", "loop.json"])  # a planted fault


THREE = PlannedRun((2.0, 20.0, 2.0), 100.0, "um/s")
FIVE = PlannedRun((2.0, 20.0, 2.0, 20.0, 2.0), 100.0, "um/s")
RISE = PlannedRun((2.0, 20.0), 100.0, "um/s", second_length=50.0)


AGAIN = (RunChange.REPEAT,)
STEPS_AGAIN = (RunChange.UP_AND_DOWN, RunChange.LONG_STEPS)


PLANS = [
    (RISE, AGAIN, '"2, 20, 2, 20, 2 um/s" --slip-per-step "100 um"'),
    (THREE, AGAIN, '"2, 20, 2, 20, 2 um/s" --slip-per-step "100 um"'),
    (FIVE, AGAIN, '"2, 20, 2, 20, 2 um/s" --slip-per-step "100 um"'),
    (RISE, STEPS_AGAIN, '"2, 20, 2, 20, 2 um/s" --slip-per-step "200 um"'),
    (THREE, STEPS_AGAIN, '"2, 20, 2, 20, 2 um/s" --slip-per-step "100 um"'),
    (FIVE, (RunChange.UP_AND_DOWN,), '"2, 20, 2, 20, 2 um/s" --slip-per-step "100 um"'),
    (RISE, (RunChange.DWELL, "a zero-load baseline"),
     '"2, 20, 0.6667, 2, 20 um/s" --slip-per-step "100 um"'),
    (THREE, ("elastic loading", RunChange.SLIP_CHANNEL),
     '"2, 20, 2 um/s" --slip-per-step "100 um" --slip-channel "0.1 um"'),
    (RISE, (RunChange.DECADES,),
     '"2, 20, 200, 2, 20 um/s" --slip-per-step "100 um"'),
    (RISE, ("a known load",), '"2, 20 um/s" --slip-per-step "100 um"'),
    # several wishes are one run, each wish once
    (RISE, (RunChange.DWELL, *STEPS_AGAIN, RunChange.SLOW_DWELL, RunChange.DECADES),
     '"2, 20, 200, 2, 20, 2, 0.6667 um/s" --slip-per-step "200 um"'),
]  # fmt: skip


@pytest.mark.parametrize(("before", "wanted", "asked"), PLANS)
def test_the_run_that_would_decide_is_the_one_planned(before, wanted, asked) -> None:
    planned = deciding_run(before, wanted)
    assert planned.options() == asked
    assert parsed(["protocol", *shlex.split(planned.options())])


def of_rock(groups: Sequence[tuple[str, ...]], verdict: str, speeds=(2.0, 20.0)) -> Loop:
    """A loop of few steps whose effects, the first of each group, are not told from the others."""
    loop, ids = make_loop(verdict), tuple(group[0] for group in groups)
    after = dataclasses.replace(loop.after, effects=ids)
    V = 1e-6 * np.asarray(speeds)
    fit = dataclasses.replace(loop.base_fit, steps=VelocitySteps(25.0 * np.arange(len(V)), V))
    one = np.ones(1)
    location = (LocationProfile("state", "s", one, one, one, 0.9, 1e-9, 0.9),)
    separations = {id: separators(CATALOGUE[id]) for id in ids}
    return dataclasses.replace(
        loop, effects=ids, after=after, base_fit=fit, alias_groups=tuple(groups),
        separations=separations, location=location,
    )  # fmt: skip


SECOND, DRIFT = ("second_state", "thermal", "run_in"), ("time_drift", "run_in", "gain")


OPEN = {
    "two groups": (of_rock([SECOND, DRIFT], "ambiguous"), "2, 20, 2, 20, 2, 0.6667"),
    "a drift": (
        of_rock([("time_drift", "slip_trend")], "ambiguous"), "2, 20, 0.6667, 2, 20"
    ),
    "three groups": (
        of_rock(
            [("stribeck", "viscous"), ("slip_trend", "gain"), ("viscous", "gain")],
            "ambiguous",
        ),
        "2, 20, 200, 2, 20, 0.6667",
    ),
}  # fmt: skip


def test_one_run_has_all_that_is_asked_for(snapshot) -> None:
    """It is said first, then the command that asks for it; the rest stands beside."""
    for loop, speeds in OPEN.values():
        first, ask, *rest = next_steps(loop)
        assert not first.command
        assert ask.command.startswith(f'jaxfric protocol "{speeds} um/s" ')
        assert not first.also and not ask.also and all(step.also for step in rest)
        asked = commands(loop, "--distinguish")
        assert len(asked) == len(loop.alias_groups)
        assert len({a.split("--distinguish")[0] for a in asked}) == 1
        html = page_of(loop).text
        assert html.index(first.text) < html.index(ask.command) < html.index(rest[0].text)
    snapshot("one_run", {name: to_do(loop) for name, (loop, _) in OPEN.items()})


@pytest.mark.parametrize("kind", ["slider", "axis"])
def test_effects_that_may_be_imitations_are_not_to_be_distinguished(kind) -> None:
    """A friction that jumps is imitated by a drift: no run distinguishes the drift from run-in."""
    loop = dataclasses.replace(of_rock([SECOND, DRIFT], "outside_catalogue"), kind=kind)
    assert [(step.code, step.also) for step in next_steps(loop)] == [
        ("look", False), ("own_effect", False)
    ]  # fmt: skip
    assert not commands(loop, "protocol") and "--distinguish" not in page_of(loop).text


def test_steps_are_said_to_be_long_enough_where_they_are(snapshot) -> None:
    """By the L2 of the second state that was taken; 0: of none."""
    loop, texts = of_rock([SECOND], "ambiguous"), {}
    for length in (0.0, 3000.0, 4000.0, 60000.0):
        known = dict(loop.after.parameters)
        known.pop("second_state.L2", None)
        if length:
            known["second_state.L2"] = Estimate(1e-6 * length, 0.0, 0.0, 0.0, "m")
        after = dataclasses.replace(loop.after, parameters=known)
        texts[f"L2 = {length} um"] = next_steps(dataclasses.replace(loop, after=after))[0].text
    snapshot("long_enough", texts)


def test_a_run_that_no_plan_changes_is_said_as_it_was(snapshot) -> None:
    loop = of_rock([("gain", "stiffness")], "ambiguous")
    assert [step.also for step in next_steps(loop)] == [False, False, True, True]
    axis = dataclasses.replace(loop, kind="axis")
    assert commands(loop, "protocol") and not commands(axis, "protocol")
    snapshot("no_plan", {"a known load": to_do(loop), "of an axis": to_do(axis)})


def test_every_planned_change_is_in_the_catalogue() -> None:
    said = {one for effect in CATALOGUE.values() for one in separators(effect)}
    assert set(CHANGES) <= said


def test_a_plan_asks_for_the_effect_and_its_likeliest_rival(snapshot) -> None:
    """The best refit in its place, else the most alike; none that no plan can be asked for."""
    loop = make_loop("ambiguous")
    ((id, *_),) = loop.alias_groups
    sizes = ((id, 50.0), ("gain", 45.0), ("run_in", 48.0))
    fits = [CandidateScore((e,), -gain, 1, 1, {}, True, True, e == id) for e, gain in sizes]
    groups = ((id, "normal_stress", "slip_trend", "gain", "run_in"),)
    loop = dataclasses.replace(loop, alias_groups=groups, candidates=fits)
    (line,) = commands(loop, "--distinguish")
    assert line.startswith('jaxfric protocol "1, 10, 1, 3, 10, ')
    assert line.endswith(f"--from loop.json --distinguish {id},run_in")
    two = dataclasses.replace(loop, alias_groups=((id, "run_in"),))
    none = dataclasses.replace(loop, alias_groups=((id, "normal_stress"),))
    assert commands(two, "--distinguish") and not commands(none, "protocol")
    snapshot("rivals", {"five": to_do(loop), "two": to_do(two), "no plan": to_do(none)})


CLEAR = [
    ("effects", ("second_state",), "--from loop.json --distinguish base,second_state"),
    ("effects", ("gain", "run_in"), "--from loop.json --distinguish base,gain"),
    ("effects", ("gain", "normal_stress"), ""),
    ("effects", ("mine",), ""),
    ("no_missing_effect", (), "--from loop.json"),
    ("too_weak", (), ""),
    ("outside_catalogue", (), ""),
]


def test_a_clear_verdict_says_what_the_next_run_would_show(snapshot) -> None:
    texts = {}
    for verdict, effects, end in CLEAR:
        loop = make_loop(verdict)
        after = dataclasses.replace(loop.after, effects=effects)
        loop = dataclasses.replace(loop, effects=effects, after=after)
        texts[f"{verdict} {effects}"] = to_do(loop)
        found = commands(loop, "protocol")
        assert [line.endswith(end) for line in found] == ([True] if end else [])
        assert all(parsed(shlex.split(line)[1:]) for line in found)
        axis = dataclasses.replace(loop, kind="axis", effects=(), after=loop.before)
        assert not commands(axis, "protocol")
    snapshot("next_runs", texts)


def said(why):
    """A refusal in words; empty where there is none."""
    return "" if why is None else words_of_refusal(why)


def parsed(words: list[str]) -> bool:
    """Whether the command takes these words; nothing is run."""
    try:
        app.parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError:
        return False
    return True


def test_gains_are_offered_where_they_are_taken() -> None:
    """As `jaxfric.laws` reads loops: of a slider, and of an axis with a memory, in newtons."""
    loop = make_loop("effects")
    assert takes_gains(loop) and not takes_gains(make_loop("outside_catalogue"))
    assert not takes_gains(dataclasses.replace(loop, kind="axis"))
    after = dataclasses.replace(loop.after, effects=("rate_and_state",))
    axis = dataclasses.replace(make_loop("effects", unit="N"), kind="axis", after=after)
    assert takes_gains(axis)
    text = next(s for s in next_steps(axis) if "gains" in s.command).command
    assert "--normal-force" not in text and '--velocity "0.001..0.01 mm/s"' in text
    # friction that no row supports is not compensated
    assert not any("feedforward" in s.command for s in next_steps(axis))
    friction = Finding(LoopCode.FRICTION, Severity.CLAIM, {}, np.ones(len(loop.record), bool))
    known = dataclasses.replace(axis, findings=(friction,))
    feedforwards = [s for s in next_steps(known) if "feedforward loop.json" in s.command]
    assert len(feedforwards) == 1 and parsed(shlex.split(feedforwards[0].command)[1:])
    assert not any("feedforward" in s.command for s in next_steps(loop))
    own = dataclasses.replace(loop.after, effects=("mine",))
    assert not takes_gains(dataclasses.replace(loop, after=own))


def test_the_page_has_one_pair_of_errors() -> None:
    """That of the report block, in the headline; blocks are folded away."""
    loop = make_loop("effects")
    html = html_of(loop)
    told = re.sub(r"<details>.*?</details>", "", html, flags=re.DOTALL)
    before, after = (f"{loop.test_error(s):.2f}" for s in (loop.before, loop.after))
    body = unescape(told[told.index("<body>") :])
    assert re.findall(r"[\d.]+ -> [\d.]+ sigma", body) == [f"{before} -> {after} sigma"]
    assert "rms before" in html and "rms before" not in told


def test_a_page_fits_a_narrow_window() -> None:
    """Every table and figure scrolls in a box of its own, and the page tells its width."""
    html = html_of(make_loop("effects"))
    assert 'name="viewport" content="width=device-width' in html
    for tag in ("table", "img"):
        assert html.count(f'<div class="scroll"><{tag}') == html.count(f"<{tag}") > 3
    assert ".scroll { overflow-x: auto" in html and "max-width: 100%" in html
    narrow = html[html.index("@media (max-width: 40rem)") : html.index("@media print")]
    # words break, and what goes on beyond the edge is said or shaded: phones show no scroll bar
    assert "th, .w { white-space: normal; }" in narrow and "content: " in narrow
    assert "<td class=w>characteristic slip length</td>" in html and "<td class=w>1/µm" not in html
    assert re.search(r"div\.scroll \{ background:[^}]*local[^}]*scroll;", html)


def test_every_effect_of_the_catalogue_has_a_meaning() -> None:
    for about in (*CATALOGUE.values(), *AXIS_CATALOGUE.values()):
        assert about.meaning.endswith("."), about.id


def test_the_figure_shows_record_and_both_models() -> None:
    loop = make_loop("effects")
    panel = figure_of(loop, "residual").axes[1]
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in panel.lines}
    friction = np.asarray(loop.record.friction)
    assert np.array_equal(lines["record"], friction)
    assert np.allclose(lines["model before"] - loop.before.residual, friction)
    assert np.allclose(lines["model after"] - loop.after.residual, friction)
    assert "model after" not in {
        line.get_label() for line in figure_of(make_loop("too_weak"), "residual").axes[1].lines
    }


def test_no_number_of_the_candidates_lies_on_a_line() -> None:
    for axis in figure_of(make_loop("effects"), "candidates").axes[:3]:
        numbers = [t for t in axis.texts if t.get_text()]
        assert numbers and all(t.get_position()[0] > 1.0 for t in numbers)
        assert all(t.get_transform() == axis.get_yaxis_transform() for t in numbers)


def test_an_effect_of_the_model_is_not_drawn_as_not_taken() -> None:
    figure = figure_of(make_loop("effects"), "candidates")
    colours = []
    for axis in figure.axes[:3:2]:
        names = [label.get_text() for label in axis.get_yticklabels()]
        colours.append({n: bar.get_facecolor() for n, bar in zip(names, axis.patches, strict=True)})
    fitted, screened = colours
    assert screened["second_state"] == fitted["second_state"] != screened["ageing"]


@pytest.mark.parametrize("number", [1, 7])
def test_words_over_the_profiles_leave_them_room(number) -> None:
    loop = make_loop("effects")
    figure = figure_of(dataclasses.replace(loop, location=loop.location[:number]), "profiles")
    figure.canvas.draw()
    above = figure._suptitle.get_window_extent()
    panel = figure.axes[0].get_window_extent()
    assert above.x1 < figure.bbox.x1 and above.y0 > panel.y1
    assert panel.height > 0.5 * 1.75 * figure.dpi
    assert " × 10⁻³," in figure.get_suptitle()


def test_the_gain_of_a_loop_is_that_of_its_model_in_any_order() -> None:
    loop = make_loop("effects")
    [own] = [c for c in loop.ranked() if loop.role(c) == "model"]
    assert loop.gain() == -own.delta_bic > 0
    both = dataclasses.replace(loop.after, effects=("b", "a"))
    two = dataclasses.replace(own, effects=("a", "b"), delta_bic=-31.0)
    pair = dataclasses.replace(loop, after=both, candidates=(*loop.candidates, two))
    assert pair.gain() == 31.0
    assert dataclasses.replace(pair, candidates=loop.candidates).gain() is None


def test_a_long_name_of_a_record_does_not_push_the_noise_out_of_the_figure() -> None:
    loop = make_loop("effects")
    long = dataclasses.replace(loop.record.provenance, path="a_" * 30 + ".csv")
    record = dataclasses.replace(loop.record, provenance=long)
    figure = figure_of(dataclasses.replace(loop, record=record), "residual")
    figure.canvas.draw()
    assert figure._suptitle.get_window_extent().x1 < figure.bbox.x1
    assert "noise" in figure.get_suptitle() and "a_a_" in figure.get_suptitle()


def test_shares_of_the_location_figure_add_up() -> None:
    axis = figure_of(make_loop("effects"), "location").axes[0]
    widths = [bar.get_width() for bar in axis.patches]
    names = [label.get_text() for label in axis.get_yticklabels()]
    assert sum(widths) == pytest.approx(100.0) and names[-1] == "not explained"
    assert widths[0] == max(widths) == pytest.approx(71.0) and names[0] == "the time since a step"


def test_where_nothing_is_placed_the_location_figure_is_no_higher_than_its_words() -> None:
    figure = figure_of(dataclasses.replace(make_loop("effects"), location=()), "location")
    figure.canvas.draw()
    words, page = figure._suptitle.get_window_extent(), figure.bbox
    assert page.y0 <= words.y0 and words.y1 <= page.y1 and words.height > 0.4 * page.height


def figure_of(loop: Loop, name: str) -> Figure:
    return FIGURES[name](loop)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict(verdict: str, snapshot) -> None:
    loop = make_loop(verdict, path=HOSTILE, unit="N" if verdict == "too_weak" else "1")
    whole, html = printed(loop, 1000), page_of(loop)
    text = " ".join(whole.split())
    assert html.images == len(FIGURES) and html.seen.count("h1") == 1
    assert html.seen.count("b") == len(loop.effects)  # their meanings
    assert html.text.count(HOSTILE) >= 3
    assert any(line.startswith(f"{verdict}: ") for line in whole.splitlines())
    for shown in (text, html.text):
        assert all(words in shown for words in (loop.sentence, *loop.reasons, *loop.effects))
        assert "nan" not in shown.lower().split()
        assert not re.search(r"\de-0[3-9]", shown)
    for words in (
        loop.warnings[0],
        loop.record.provenance.sha256,
        f"jaxfric {installed_version()}",
    ):
        assert words in html.text
    content = json.loads(json.dumps(loop.to_json(), allow_nan=False))
    assert not set(KEYS.split()) - set(content)
    assert set(content["tests"]["ljung_box"]) == {"before", "after"}
    assert {"train_rms", "select_rms", "report_rms", "in_sigma", "parameters"} <= set(
        content["before"]
    )
    opening = html.text.split(loop.sentence)[1].split(loop.warnings[0])[0]
    snapshot(f"verdict_{verdict}", {"printed": whole, "opening of the page": opening.strip()})


def test_one_sigma_for_the_sentence_the_table_the_figure_and_the_file(
    tmp_path: Path, snapshot
) -> None:
    """Rows held out are noisier by a quarter: their errors are in their own noise everywhere."""
    loop = make_loop("effects")
    noisy = dataclasses.replace(loop, sigma_held_out=1.25 * loop.sigma)
    for name, factor in (("train", 1.0), ("select", 1.25), ("report", 1.25)):
        values = [s.rms[name] / (factor * loop.sigma) for s in (loop.before, loop.after)]
        for number, shown in zip(values, errors(noisy).rows[NAMES.index(name)][-2:], strict=True):
            assert shown == f"{number:.3f}"
        content = noisy.to_json()
        both = [content[fit]["in_sigma"][name] for fit in ("before", "after")]
        assert both == pytest.approx(values)
        assert errors(loop).rows[NAMES.index(name)][-1] == f"{factor * values[1]:.3f}"
    held = [s.rms["report"] / (1.25 * loop.sigma) for s in (loop.before, loop.after)]
    told = re.findall(r"[\d.]+", change(Told(("a",), *held[:2], 1.1, 1.0, 20.0)))
    assert told == [f"{x:.2f}" for x in held]
    assert [f"{x:.3f}" for x in held] == list(errors(noisy).rows[-1][-2:])
    assert "0.375 × 10⁻³" in errors(noisy).note and "0.375" not in errors(loop).note
    steps, old = (one.to_json()["after"]["per_step_in_sigma"] for one in (noisy, loop))
    assert np.divide(old[-2:], steps[-2:]) == pytest.approx(1.25, rel=0.002)
    assert steps[1] == old[1] and content["noise"]["sigma_held_out"] == 1.25 * loop.sigma
    residual_figure(noisy).savefig(tmp_path / "residual.svg")
    drawing = (tmp_path / "residual.svg").read_text()
    assert all(f"{number:.2f} σ" in drawing for number in held) and "0.375 × 10⁻³ -->" in drawing
    shown = re.findall(r"<!-- (.*σ.*) -->", drawing)
    snapshot("noise_held_out", {"note": errors(noisy).note, "figure": "\n".join(shown)})


@pytest.mark.parametrize("number", [0, 1, 9])
def test_the_titles_of_a_loop_name_the_whole_model(number: int) -> None:
    """Whatever was added is named, in several lines if need be; the error is told."""
    loop = make_loop("effects")
    names = ("position_dependence", "direction_asymmetry", "log_viscous") * 3
    after = dataclasses.replace(loop.after, effects=names[:number])
    loop = dataclasses.replace(loop, effects=names[:number], after=after)
    figure = residual_figure(loop)
    figure.canvas.draw()
    texts = [figure._suptitle, *(axis._left_title for axis in figure.axes)]
    assert all(text.get_window_extent().x1 <= figure.bbox.x1 for text in texts)
    title = texts[-1].get_text().replace("\n", " ")
    # nothing added: one panel, not two alike
    when, score = ("After", after) if number else ("Residual", loop.before)
    assert title.startswith(f"{when}, test error {loop.test_error(score):.2f} σ: ")
    assert len(figure.axes) == (4 if number else 3)
    assert title.endswith(" + ".join(["slip law", *names[:number]]))


def test_numbers_and_titles_of_the_candidates_are_whole_and_apart() -> None:
    """Of models with long names that lower BIC by tens of thousands."""
    loop = make_loop("effects")
    names = ("position_dependence", "rate_and_state", "position_periodic", "log_viscous")
    far = dataclasses.replace(loop.candidates[0], effects=names, delta_bic=-2.6e4)
    figure = figure_of(dataclasses.replace(loop, candidates=(far, *loop.candidates)), "candidates")
    figure.canvas.draw()
    for axis in figure.axes[:3]:
        assert axis._left_title.get_window_extent().x1 <= figure.bbox.x1
        for side in (axis.xaxis, axis.yaxis):
            boxes = [text.get_window_extent() for text in side.get_ticklabels() if text.get_text()]
            assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def test_strokes_and_rows_that_do_not_count_shape_no_panel() -> None:
    """Steps with fewer than ten rows in a block have no line; a peak of a model is told."""
    loop = make_loop("effects")
    kept = (loop.blocks.step < 8) | (np.arange(len(loop.record)) >= len(loop.record) - 5)
    blocks = loop.blocks
    masks = {name: blocks.of(name) & kept for name in NAMES}
    peak = np.where(np.arange(len(kept)) == 40, 5.0, loop.before.residual)
    before = dataclasses.replace(loop.before, residual=peak)
    blocks = blocks._replace(**masks)
    record = residual_figure(dataclasses.replace(loop, blocks=blocks, before=before)).axes[1]
    dashed = [line for line in record.lines if line.get_linestyle() == "--"]
    assert len(dashed) == 8
    assert "1 row lies beyond the panel" in record.get_title(loc="left")
    assert np.ptp(record.get_ylim()) < 1.2 * np.ptp(loop.record.friction)


@pytest.mark.parametrize(
    ("kind", "length", "unit", "name"),
    [
        ("axis", "rad", "N m", "motor torque [N m]"),
        ("axis", "rad", "%", "motor torque [%]"),
        ("axis", "mm", "N", "motor force [N]"),
        ("slider", "um", "1", "friction coefficient"),
        ("slider", "um", "N", "friction force [N]"),
    ],
)
def test_a_force_has_one_name(kind: Any, length: str, unit: str, name: str) -> None:
    loop = make_loop("effects")
    units = {"load_point_displacement": length}
    record = dataclasses.replace(loop.record, units=units, friction_unit=unit)
    figure = residual_figure(dataclasses.replace(loop, record=record, kind=kind))
    assert figure.axes[1].get_ylabel() == name


def test_the_residual_after_an_effect_has_a_scale_of_its_own() -> None:
    loop = make_loop("effects")
    large = dataclasses.replace(loop.before, residual=30 * loop.after.residual)
    figure = residual_figure(dataclasses.replace(loop, before=large))
    before, after = (axis.get_ylim()[1] for axis in figure.axes[2:])
    assert before == pytest.approx(30 * after, rel=0.2) or after == 4.0 < before


def test_better_models_have_a_change_of_bic_below_0() -> None:
    loop = make_loop("effects")
    axis = figure_of(loop, "candidates").axes[0]
    assert "below 0: better" in axis.get_xlabel()
    widths = [bar.get_width() for bar in axis.patches]
    known = [c.delta_bic if np.isfinite(c.delta_bic) else 0.0 for c in loop.ranked()]
    assert widths == known
    assert widths[0] == min(widths) and -loop.gain() in widths


def test_a_small_part_of_the_noise_is_told_wherever_noise_is(tmp_path: Path, snapshot) -> None:
    loop = make_loop("effects")
    noise = NoiseEstimate(loop.sigma, (NoisePart(0.04, "time", 0.8),))
    words = noise_text(noise)
    loop = dataclasses.replace(loop, after=dataclasses.replace(loop.after, noise=noise))
    assert words in " ".join(printed(loop).split()) and words in page_of(loop).text
    style.save(FIGURES["noise"](loop), tmp_path, "noise")
    assert words in (tmp_path / "noise.svg").read_text()
    base: Any = loop.base_fit
    told = summary(dataclasses.replace(base, noise=noise))
    (own,) = [line for line in told if words in line]
    snapshot("noise", {"small part": own})


def test_numbers_are_those_of_the_loop() -> None:
    loop = make_loop("effects")
    text = printed(loop)
    for name in NAMES:
        before, after = (s.rms[name] / loop.sigma for s in (loop.before, loop.after))
        assert re.search(rf"^{name}: .*{before:.3f} +{after:.3f}$", text, re.M)
    assert re.search(r"^L +.*18\.30 +17\.20 ± 0\.40 +16\.42 to 17\.99 +−2\.7 +µm *$", text, re.M)
    assert re.search(r"^second_state.L2 .* 61\.0 ± 4\.0 +53\.2 to 68\.8 +µm *$", text, re.M)
    assert re.search(r"^second_state +−1480\.0 ", text, re.M)
    assert re.search(r"servo_lag \w+ sensor_lag \(0\.998\)", text)


def test_the_table_of_models_says_what_each_was(snapshot) -> None:
    """Only the last is the model; those taken before it were on the way. One that a rule refused
    has its reason; one as good as the model is not accepted, as a tie is no evidence."""
    loop = make_loop("effects")
    (first,) = loop.effects
    wider = (first, "velocity_dependent_L")
    scores = [
        dataclasses.replace(c, accepted=c.accepted or c.effects == wider) for c in loop.candidates
    ]
    after = dataclasses.replace(loop.after, effects=wider)
    grown = dataclasses.replace(loop, candidates=tuple(scores), after=after, effects=wider)
    table = candidates(grown)
    assert [table.rows[k][0] for k in table.marked] == [" + ".join(wider)]
    texts = {"grown": in_lines(table)}
    for gain, why in (
        *((gain, None) for gain in (1481.9, 1478.1, 1477.0, 1486.0)),
        (1486.0, LOOSE),
    ):
        fits = (
            CandidateScore((first,), -1480.0, 1, 1, {}, True, True, True),
            CandidateScore(("run_in", "time_drift"), -gain, 1, 0.8, {}, True, True, False, why),
        )
        table = candidates(dataclasses.replace(loop, candidates=fits))
        texts[f"BIC {gain} for 1480 of the model, {said(why)}"] = in_lines(table)
    snapshot("models", texts)


def in_lines(table) -> str:
    return "\n".join([*(" | ".join(row) for row in table.rows), table.note])


def test_the_error_that_counts_as_noise_stands_beside_the_errors() -> None:
    loop = make_loop("outside_catalogue")
    known = dataclasses.replace(loop, held_out_threshold=1.402)
    for shown, there in ((loop, False), (known, True)):
        assert ("1.40 σ" in errors(shown).note) == there
        assert ("noise alone gives up to 1.40" in html_of(shown)) == there
    assert json.loads(json.dumps(known.to_json()["noise"]["held_out_threshold"])) == 1.402


def test_a_record_of_one_step_says_that_less_can_be_told(snapshot) -> None:
    loop = make_loop("outside_catalogue", many=False)
    line = report_of(loop).lines[-1]
    assert "Fewer effects" in line and line in page_of(loop).text
    assert "Fewer effects" not in printed(make_loop("outside_catalogue"), 1000)
    snapshot("one_step", {"printed": printed(loop, 1000)})


@pytest.mark.parametrize(
    ("verdict", "more"),
    [("effects", {}), ("outside_catalogue", {"many": False, "unit": "N", "path": HOSTILE})],
)
def test_figures(verdict: str, more: dict[str, Any], tmp_path: Path) -> None:
    for name, figure in FIGURES.items():
        style.save(figure(make_loop(verdict, **more)), tmp_path, name)
        pixels = imread(tmp_path / f"{name}.png")[..., :3]
        assert min(pixels.shape[:2]) > 300 and np.mean(np.any(pixels < 0.9, axis=2)) > 0.01, name
        assert (tmp_path / f"{name}.svg").read_text().lstrip().startswith("<?xml")


# ---- the verb --------------------------------------------------------------------------------


@pytest.fixture
def closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A folder with run.csv in which the verb gets a made-up loop; what it asked for."""
    asked: dict[str, Any] = {}

    def close_loop(record, *, progress, **options) -> Loop:
        progress("screening 17 effects")
        asked.update(options, read=len(record))
        return make_loop("no_missing_effect")

    def write(figure: None, *paths: Path) -> None:
        for path in paths:
            path.write_bytes(b"<svg/>" if path.suffix == ".svg" else b"")

    monkeypatch.setattr("jaxfric.close_loop", close_loop)
    for name in FIGURES:
        monkeypatch.setitem(FIGURES, name, lambda loop: None)
    monkeypatch.setattr("jaxfric.plot.style.write", write)
    monkeypatch.chdir(tmp_path)
    written(Path("run.csv"), record_text())
    return asked


def test_the_verb(closed: dict[str, Any]) -> None:
    options = (
        "--include",
        "slip_trend, gain",
        "--include",
        "gain",
        "--exclude",
        "thermal",
        "--max-effects",
        2,
    )
    code, out, err = run("loop", "run.csv", "--stiffness", "5e-3/um", *options)
    assert code == 0, err
    assert closed == {
        "stiffness": "5e-3/um",
        "law": "slip",
        "steps": None,
        "events": None,
        "downsample_to": None,
        "include": ("slip_trend", "gain"),
        "exclude": ("thermal",),
        "max_effects": 2,
        "read": 91,
    }
    assert out.startswith("No effect is missing. ") and "max-effects2/loop.html" in out
    assert len(out.splitlines()) <= 20
    assert "screening" not in err and "jaxfric: warning: K is 1.6" in err
    kinds = [f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")]
    folder = Path("run-loop-include-slip_trend+gain-exclude-thermal-max-effects2")
    assert sorted(p.name for p in folder.iterdir() if p.name[0] != ".") == sorted(
        ["loop.html", "loop.json", *kinds]
    )
    assert (
        "--include 'slip_trend, gain' --include gain --exclude thermal --max-effects 2"
        in Page((folder / "loop.html").read_text(encoding="utf-8")).text
    )


def test_an_axis(closed: dict[str, Any], monkeypatch) -> None:
    """It is written to the folder of a loop."""
    made = dataclasses.replace(make_loop("no_missing_effect"), kind="axis")

    def close_axis_loop(record, *, progress, **options) -> Loop:
        closed.update(options, read=len(record))
        return made

    monkeypatch.setattr("jaxfric.close_axis_loop", close_axis_loop)
    turns = (f"{k / 10},{100 * np.sin(k / 9)},{k % 7}\n" for k in range(90))
    written(Path("a.csv"), "time [s],position [mm],motor_force [N]\n" + "".join(turns))
    options = ("--zero-order-hold", "--include", "cubic", "--max-effects", 2, "--cutoff", "4 Hz")
    code, _, err = run("axis", "a.csv", *options)
    assert code == 0, err
    folder = Path("a-loop-include-cubic-max-effects2-zero-order-hold-cutoff4Hz")
    html = Page((folder / "loop.html").read_text(encoding="utf-8")).text
    assert (
        "jaxfric axis a.csv --zero-order-hold --include cubic --max-effects 2 --cutoff '4 Hz'"
        in html
    )
    assert closed["include"] == ("cubic",) and closed["max_effects"] == 2
    assert closed["zero_order_hold"] is True
    assert closed["preparation"].cutoff == 4.0 and closed["read"] == 90


def test_few_rows_through_the_verb(closed: dict[str, Any]) -> None:
    code, _, err = run("loop", "run.csv", "--stiffness", "5e-3/um", "--downsample-to", 1000)
    assert code == 0, err
    assert closed["downsample_to"] == 1000 and closed["read"] == 91
    page = Page(Path("run-loop-downsample-to1000/loop.html").read_text(encoding="utf-8"))
    assert "--downsample-to 1000" in page.text


def test_the_verb_in_a_script(closed: dict[str, Any]) -> None:
    code, out, err = run("loop", "run.csv", "--stiffness", "5e-3/um", "--json", "--out", "here")
    assert code == 0 and json.loads(out)["schema"] == "jaxfric.loop/2"
    assert out == Path("here/loop.json").read_text()
    assert err.startswith("jaxfric: warning: ") and err.count("\n") == 1


REFUSED = [
    ((), "--stiffness"),
    (("--stiffness", "5e-3/um", "--max-effects", "0"), "--max-effects"),
    (("--stiffness", "5e-3/um", "--include", "gain,,viscous"), "--include"),
]


def test_what_the_verb_refuses(closed, snapshot) -> None:
    texts = {}
    for given, option in REFUSED:
        outcome = run("loop", "run.csv", *given)
        assert_refused(outcome, option)
        texts[" ".join(given) or "nothing"] = outcome.err
    assert not closed and not Path("run-loop").exists()
    snapshot("refused_loop", texts)


def test_an_output_that_cannot_be_written_is_known_before_the_work(closed) -> None:
    written(Path("taken"), "")
    code, out, err = run("loop", "run.csv", "--stiffness", "5e-3/um", "--out", "taken")
    assert code == 2 and out == "" and "--out" in err.splitlines()[-1]
    assert not closed


ALIKE = [(None, True, True), (1475.0, True, True), (20.0, False, True), (20.0, True, False)]


def test_a_refit_tells_effects_that_look_alike(snapshot):
    """To first order time_drift and slip_trend are the same; the model has 1480 of BIC."""
    loop, texts = make_loop("ambiguous"), {}
    for gain, converged, alike in ALIKE:
        more = CandidateScore(("slip_trend",), -(gain or 0.0), 1, 1, {}, True, converged, False)
        tried = loop.candidates + ((more,) if gain else ())
        lines = apart(dataclasses.replace(loop, candidates=tried))
        texts[f"BIC {gain}, converged: {converged}"] = "\n".join(lines)
        assert (re.search("slip_trend.*time_drift", lines[-1]) is not None) == alike
    snapshot("alike", texts)


ENDING = ("save_json", "answer", "draw_figure", "draw_page")
"""The numbers are on disk and told before figures are drawn."""


@pytest.mark.parametrize(("severity", "code"), [(Severity.WITHHELD, 1), (Severity.CAUTION, 0)])
def test_a_verdict_that_is_withheld_is_no_result_to_rely_on(severity, code, capsys) -> None:
    loop = make_loop("ambiguous")
    why = Finding(LoopCode.EDGE, severity, {"ratio": 1.02}, loop.blocks.train)
    done = []
    folder: Any = SimpleNamespace(
        **{name: lambda *_, name=name: done.append(name) for name in ENDING},
        end=lambda *_: 0,
        path=Path("out"),
        files=["loop.json"],
    )
    assert end_loop(dataclasses.replace(loop, findings=(why,)), folder) == code
    assert tuple(dict.fromkeys(done)) == ENDING


def test_an_effect_is_told_from_all_others_only_where_noise_is_left() -> None:
    """Beside structure that is left it may stand for another one in part."""
    loop = make_loop("effects")
    alone = dataclasses.replace(loop, alias_groups=(loop.effects,))
    rows = np.ones(len(loop.record), bool)
    left = Finding(LoopCode.STRUCTURE, Severity.CAUTION, {"block_means": 1e-4}, rows)
    told, not_told = (apart(dataclasses.replace(alone, findings=f))[0] for f in ((), (left,)))
    assert "every other effect" in told and "every other effect" not in not_told


@pytest.mark.parametrize(
    ("unit", "shown"), [("microns", "1 µm/s"), ("0.05 um", "1 µm/s"), ("mm", "0.001 mm/s")]
)
def test_velocities_bear_a_symbol_of_length(unit: str, shown: str) -> None:
    loop = make_loop("effects")
    units = {**loop.record.units, "load_point_displacement": unit}
    record = dataclasses.replace(loop.record, units=units)
    claim = Finding(LoopCode.EFFECT, Severity.CLAIM, {"effect": "thermal"}, loop.blocks.step == 0)
    table = rests_on(dataclasses.replace(loop, record=record, findings=(claim,)))
    assert table.rows[0][-1] == shown


@pytest.mark.parametrize("pause", [0.0, 1e5])
def test_the_line_of_a_model_ends_where_the_recorder_paused(pause: float) -> None:
    loop = make_loop("effects")
    time = loop.record.time + pause * (np.arange(len(loop.record)) > 200)
    loop = dataclasses.replace(loop, record=dataclasses.replace(loop.record, time=time))
    axis = next(a for a in residual_figure(loop).axes if a.get_title(loc="left").startswith("Rec"))
    lines = [line for line in axis.lines if str(line.get_label()).startswith("model")]
    broken = [np.flatnonzero(np.isnan(line.get_ydata())).tolist() for line in lines]
    assert broken == [[201] if pause else []] * 2


@pytest.mark.parametrize(
    ("drive", "columns"),
    [(None, 2), (SimpleNamespace(K_d=2.0, K_p=None, velocity_gain=3.0, signal="V", gain=1.0), 3)],
)
def test_a_drive_of_which_nothing_is_known_has_no_column(drive, columns) -> None:
    own = {"coordinate": "linear", "length_unit": "m"}
    record: Any = SimpleNamespace(force_unit="N", drive=drive, **own)
    details = AxisDetails((), Preparation(50.0, 1), 1e-3, record, AxisGains(1.0, -2.0, 2.0, None))
    table = gains_table(details)
    assert len(table.head) == columns and {len(row) for row in table.rows} == {columns}
    told = details.to_json()["axis"]["drive"]  # for a feedforward of the file
    assert told == (drive and {"k_p": None, "k_v": 2.0})


def test_the_answer_on_an_axis_comes_first(snapshot) -> None:
    """Of a model that is no friction, whatever the verdict, it is none."""
    texts = {}
    for verdict in ("no_missing_effect", "effects", "ambiguous", "too_weak"):
        plain = make_loop(verdict)
        loop = in_axis_words(plain)
        first, second, third = lines = first_lines(loop)
        assert " ".join(printed(loop).split()).startswith(" ".join(lines))
        assert second == loop.details.short()
        both = [f"{loop.test_error(s):.2f}" for s in (loop.before, loop.after)]
        assert re.findall(r"[\d.]*\d", third)[:-1] == both[: 1 + bool(loop.effects)]
        html = page_of(loop).text
        assert all(line in html for line in lines)
        doubted = first_lines(in_axis_words(plain, doubted=True))[0]
        assert doubted != first and all(id in doubted for id in loop.effects)
        texts[verdict], texts[f"{verdict}, doubted"] = "\n".join(lines), doubted
    snapshot("answers", texts)


@pytest.mark.parametrize(
    ("speeds", "doubted"), [((), False), ((0.1, 3.0), False), ((0.1, np.inf), True)]
)
def test_a_reason_against_all_speeds_is_a_doubt(speeds: tuple[float, ...], doubted: bool) -> None:
    own = {"coordinate": "linear", "length_unit": "m"}
    record: Any = SimpleNamespace(force_unit="N", drive=None, **own)
    curve = Curve(1.0, 0.1, 0.5, 2.0, unseen=tuple(Unseen("why", speed) for speed in speeds))
    for own, said in ((curve, doubted), (None, False)):
        gains = AxisGains(1.0, -2.0, 2.0, None, curve=own)
        assert AxisDetails((), Preparation(50.0, 1), 1e-3, record, gains).doubted() is said


def test_what_helps_is_named_where_it_is_not_all(snapshot):
    found = make_loop("effects")
    left = {"block": "select", "error": 1.5, "most": 1.1}
    more = Finding(LoopCode.BLOCK, Severity.CAUTION, left, found.blocks.select)
    loop = dataclasses.replace(found, verdict="outside_catalogue", findings=(more,))
    assert loop.test_error(loop.after) < loop.test_error(loop.before)
    open_ = [
        dataclasses.replace(c, rejection=LOOSE, delta_bic=-1e4, effects=("c",))
        for c in loop.candidates[:1]
    ]
    cases = {
        "it helps": loop,
        "another is not fixed": dataclasses.replace(loop, candidates=(*loop.candidates, *open_)),
        "it does not help": dataclasses.replace(loop, before=loop.after, after=loop.before),
    }
    texts = {name: headline(case) for name, case in cases.items()}
    assert [all(id in text for id in loop.effects) for text in texts.values()] == [
        True,
        True,
        False,
    ]
    snapshot("headlines", texts)


def test_a_curve_whose_shape_is_not_told_is_said_to_be_so(snapshot):
    """In the headline, in what can be told apart, on the page and in the file for programs."""
    loop = make_loop("ambiguous")
    id = loop.effects[0]
    family = CurveFamily(
        (id,), 3, 5, (OtherShape("a cubic in ln V", -10.2), OtherShape("a line in ln V", 80.0)),
        (Decisive(1e-4, 110.0), Decisive(1e-7, 33.0)),
    )  # fmt: skip
    told = dataclasses.replace(loop, families=(family,))
    (line,) = [text for text in apart(told) if "a cubic in ln V" in text]
    assert line.startswith(f"{id}: ") and "10.2" in line and "100 µm/s" in line
    assert "a line in ln V" not in line and line not in apart(loop)
    assert escape(line) in page(told, {}, command="jaxfric loop")
    assert told.to_json()["families"][0]["fitting"] == ["a cubic in ln V"]
    texts = {"headline": headline(told), "apart": "\n".join(apart(told)), "to do": to_do(told)}
    snapshot("family", texts)
    assert [f"errors assume the curve {id};" in text for text in first_lines(told)][2]
    assert not any("errors assume" in text for text in first_lines(loop))


def test_the_level_is_named_without_the_steady_friction_of_effects():
    """By the effects themselves: which of them change steady friction at V0, from their rigs."""
    law = jaxfric.RateState(
        f0=0.6, A=0.01, B=[0.008], L=[2e-5], V0=1e-6, evolution=jaxfric.SlipEvolution()
    )
    rig = jaxfric.Rig(jaxfric.QuasiStatic(5e3), law)
    motion = jaxfric.PiecewiseVelocity(np.array([0.0]), np.array([1e-6]))
    loop = make_loop("no_missing_effect")
    for id, shapes in {
        "stribeck": {"fs": 0.02, "Vs": 1e-6, "d": 1.0},
        "viscous": {"c": 1e3},
        "evolution_cutoff": {"c": 1e5},
        "thermal": {"a_T": 0.01, "tau_T": 1.0},
        "ageing": {"q": 0.5},
        "second_state": {"B2": 0.003, "L2": 1e-4},
        "velocity_dependent_L": {"n": 0.1},
    }.items():
        with_it = made(CATALOGUE[id], {n: jnp.asarray(v) for n, v in shapes.items()}).embed(rig)
        level = float(jaxfric.simulate(with_it, motion, jnp.asarray([0.0, 100.0])).force[-1])
        own = {f"{id}.{name}": _estimate(v, v / 9, "1") for name, v in shapes.items()}
        after = dataclasses.replace(loop.after, parameters={**loop.after.parameters, **own})
        found = dataclasses.replace(loop, after=after)
        (row,) = [row for row in moved(found).rows if row[0] == "f0"]
        assert row[1].endswith(f" without {id}") == (abs(level - 0.6) > 1e-6), (id, level)


def test_what_the_base_does_not_determine_has_no_shift():
    loop = make_loop("effects")
    unknown = dataclasses.replace(loop.before.parameters["A"], determined=False)
    parameters = {**loop.before.parameters, "A": unknown}
    found = dataclasses.replace(
        loop, before=dataclasses.replace(loop.before, parameters=parameters)
    )
    assert "A" in loop.shifts() and "A" not in found.shifts() and "B" in found.shifts()
    rows = {row[0]: (row[2], row[5]) for row in moved(found).rows}
    assert rows["A (a)"] == ("undetermined", "") and rows["B (b)"][1]


def test_a_model_that_predicts_worse_than_the_base_is_not_used() -> None:
    """Outside the catalogue, the last model may fit what was fitted and miss the test rows."""
    loop = dataclasses.replace(make_loop("effects"), verdict="outside_catalogue")
    assert loop.supported is loop.after
    worse = dataclasses.replace(loop.after, rms={name: 9.0 for name in loop.after.rms})
    loop = dataclasses.replace(loop, after=worse)
    assert loop.supported is loop.before
    assert dataclasses.replace(loop, verdict="effects").supported is worse
    told = report_of(loop).headline
    assert "base model" in told[1] and "0.01050(6)" in told[1]
    law = law_from_fit(loop, normal_force=1.0, samples=0).law
    assert float(law.A) == loop.before.parameters["A"].value


def test_an_axis_whose_verdict_is_not_sure_still_has_its_friction() -> None:
    """Those of the base if it explains most of the force and the model to use agrees with it."""
    loop = in_axis_words(make_loop("ambiguous"))
    base = {"F_c": _estimate(2.016, 0.043, "N m"), "F_v": _estimate(3.386, 0.066, "N m s/rad")}
    lost = {"F_c": _estimate(0.92, 1.11, "N m"), "F_v": _estimate(1.35, 1.32, "N m s/rad")}
    lost["M"] = dataclasses.replace(_estimate(0.1, math.nan, "kg m^2"), determined=False)
    loop = dataclasses.replace(
        loop,
        before=dataclasses.replace(loop.before, parameters=base),
        after=dataclasses.replace(loop.after, parameters=lost),
    )
    assert "Coulomb 0.9(11)" in first_lines(loop)[0]
    loop = dataclasses.replace(loop, verdict="outside_catalogue")
    assert loop.test_error(loop.after) < loop.test_error(loop.before)
    found = first_lines(loop)[0]  # the base leaves all of the force
    assert "Coulomb 0.9(11)" in found and "not known" in found and "base" not in found
    assert all(found.count(id) == 1 for id in loop.effects)
    worse = dataclasses.replace(loop.after, rms=dict.fromkeys(loop.after.rms, 9.0))
    assert "Coulomb" not in first_lines(dataclasses.replace(loop, after=worse))[0]
    close = dataclasses.replace(loop.before, residual=0.4 * loop.before.residual)
    for after in (loop.after, worse):
        found = first_lines(dataclasses.replace(loop, before=close, after=after))[0]
        assert "Coulomb 2.02(4)" in found and "viscous 3.39(7)" in found and "base" in found
        assert all(id in found for id in loop.effects) == (after is loop.after)


@pytest.mark.parametrize(
    ("alone", "note", "widened"),
    [
        (0.0014, "(± 0.0014 by this model alone; rival models allow 0)", "32 times the error"),
        (0.0444, "(not different from 0)", ""),
        (None, "(not different from 0)", ""),
    ],
)
def test_errors_of_rival_models_are_told_from_those_of_one(alone, note, widened) -> None:
    """A joint of .08 N m s/rad: 0.08(4) with rivals, as a feedforward has it 0.0801 ± 0.0014."""
    loop = in_axis_words(make_loop("effects"))
    parameters = {"F_c": _estimate(0.6, 0.01, "N m"), "F_v": _estimate(0.0801, 0.0444, "N m s/rad")}
    after = dataclasses.replace(loop.after, parameters=parameters, free=("F_c", "F_v"))
    loop = dataclasses.replace(
        loop, after=after, before=dataclasses.replace(loop.before, parameters=parameters)
    )
    axis: Any = loop.details
    axis.covariance = None if alone is None else np.diag([0.01**2, alone**2])
    answer, *_ = first_lines(loop)
    assert f"viscous 0.08(4) N m s/rad {note}" in answer
    table = report_of(loop).tables[0]
    assert ("rival models" in table.note) == bool(widened) and widened in table.note
    assert len(table.note) < 120


@pytest.mark.parametrize(("misfit", "error"), [(1.2, 0.02), (4.0, 0.08)])
def test_errors_grow_by_a_misfit_that_noise_does_not_explain(misfit, error) -> None:
    """The errors of least squares are in proportion to the scatter of the rows: 0.02 N at 1 sigma.
    Rows scatter by 4 sigma, and noise alone gives up to 1.3."""
    loop = in_axis_words(make_loop("outside_catalogue"))
    rms = {**loop.after.rms, "report": misfit * loop.sigma_of(loop.blocks.report)}
    parameters = {"F_c": _estimate(2.0, 0.02, "N"), "F_v": _estimate(3.0, 0.02, "N s/m")}
    model = dataclasses.replace(loop.after, parameters=parameters, rms=rms)
    answer = first_lines(
        dataclasses.replace(loop, after=model, before=model, held_out_threshold=1.3)
    )[0]
    assert f"Coulomb 2.00({round(100 * error)}) N, " in answer
    assert ("for its misfit" in answer) == (misfit == 4.0)


def test_an_axis_says_first_why_something_is_missing() -> None:
    """The structure, and the block of the largest error over that of noise: it may decide alone."""
    loop = in_axis_words(make_loop("effects"))
    train, caution = loop.blocks.train, Severity.CAUTION
    left = Finding(LoopCode.STRUCTURE, caution, {"block_means": 1.2e-7}, train)
    large, small = (
        Finding(LoopCode.BLOCK, caution, {"block": block, "error": error, "most": most}, train)
        for block, error, most in (("train", 4.425, 1.34), ("report", 4.5, 1.59))
    )
    missing = dataclasses.replace(loop, verdict="outside_catalogue")
    for findings, told in (
        ((left, small, large), "p = 1.2e-07; the train error is 4.425 sigma"),
        ((small,), "caution: the test error is 4.500 sigma"),
    ):
        last = first_lines(dataclasses.replace(missing, findings=findings))[-1]
        assert last.startswith("caution: ") and told in last
    assert "caution" not in "".join(first_lines(dataclasses.replace(loop, findings=(left,))))
    assert first_lines(missing)[-1].startswith("test error")


def test_the_friction_of_an_axis_is_of_the_model_that_predicts_it() -> None:
    """A joint of Coulomb .60 N m, viscous .08 N m s/rad, inertia .02 kg m^2 with Stribeck and
    weight: the base has .69(3), .014(16) and no inertia, and explains most of the force."""
    loop = in_axis_words(make_loop("effects"))
    lost = dataclasses.replace(_estimate(0.1, math.nan, "kg m^2"), determined=False)
    base = {"F_c": _estimate(0.69, 0.03, "N m"), "F_v": _estimate(0.014, 0.016, "N m s/rad")}
    best = {
        "F_c": _estimate(0.5986, 0.0096, "N m"),
        "F_v": _estimate(0.0807, 0.0036, "N m s/rad"),
        "M": _estimate(0.01934, 0.00029, "kg m^2"),
    }
    before = dataclasses.replace(
        loop.before, parameters=base | {"M": lost}, residual=0.4 * loop.before.residual
    )
    loop = dataclasses.replace(loop, verdict="outside_catalogue", before=before)

    best_model = dataclasses.replace(loop.after, parameters=best)

    def told(**after: Estimate) -> str:
        model = dataclasses.replace(loop.after, parameters=best | after)
        return first_lines(dataclasses.replace(loop, after=model))[0]

    found = told()
    assert "Coulomb 0.60(1) N m, viscous 0.081(4)" in found and "mass 0.0193(3)" in found
    assert "base" not in found and all(found.count(id) == 1 for id in loop.effects)
    # an axis whose effects leave its friction open: its base, although one of them is otherwise
    open_ = {"F_c": _estimate(0.5, 0.2, "N m"), "F_v": _estimate(0.05, 0.04, "N m s/rad")}
    found = told(**open_, M=lost)
    falls: Any = SimpleNamespace(claim=SimpleNamespace(kind="falls"))
    axis: Any = loop.details
    axis.gains, axis.short = falls, lambda by="": f"stick-slip{by}: friction falls"
    open_model = dataclasses.replace(loop.after, parameters=best | open_ | {"M": lost})
    slip = first_lines(dataclasses.replace(loop, after=open_model))[1]
    assert slip == "stick-slip, by the model with these effects: friction falls"
    assert first_lines(dataclasses.replace(loop, after=best_model))[1] == axis.short()
    # the error covers the difference to the model that predicts better, and so the truth
    assert "Coulomb 0.69(19) N m" in found and "by the base model alone" in found
    assert all(found.count(id) == 1 for id in loop.effects)
    assert "Coulomb 0.5(2)" in told(**open_)  # the inertia is known with the effects alone
    far = told(F_c=open_["F_c"], F_v=_estimate(0.25, 0.04, "N m s/rad"), M=lost)
    assert "viscous 0.25(4)" in far
