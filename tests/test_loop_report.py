"""What a user sees of a closed loop: tables, figures, the page and the verb.

The loops are made up: hand-written numbers, no fit.
"""

import dataclasses
import functools
import io
import itertools
import json
import re
import shlex
from collections.abc import Sequence
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command import assert_refused, record_text, run, written
from cyclopts import CycloptsError
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text
from rich.console import Console

from jaxfric.cli import options
from jaxfric.cli.app import app
from jaxfric.cli.call import in_new_words
from jaxfric.effects import AXIS_CATALOGUE, CATALOGUE
from jaxfric.fitting import Estimate, Fit, NoiseEstimate, NoisePart
from jaxfric.fitting.axis_preparation import Preparation
from jaxfric.fitting.problem import Model
from jaxfric.fitting.table import noise_text, summary
from jaxfric.gains.axis_result import AxisGains
from jaxfric.loop.axis.result import AxisDetails
from jaxfric.loop.family import CurveFamily, Decisive, OtherShape
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
from jaxfric.loop.words import AXIS, SLIDER
from jaxfric.plot.loop import DRAWERS, FIGURES, draw_loop, panel_title, residual_figure
from jaxfric.plot.stability import tidy
from jaxfric.records import VelocitySteps, from_arrays
from jaxfric.records.record import Provenance
from jaxfric.report.loop_html import page
from jaxfric.report.loop_next import next_steps, takes_gains
from jaxfric.report.loop_plan import CHANGES, PlannedRun, deciding_run
from jaxfric.report.loop_text import (
    answer,
    apart,
    by_velocity,
    candidates,
    errors,
    headline,
    print_loop,
    splitting,
    traded,
)
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
        words=SLIDER,
        blocks=blocks,
        verdict=verdict,
        sentence=SENTENCES[verdict],
        reasons=("held-out error is 1.31 times the noise",) if verdict[0] == "o" else (),
        effects=effects,
        alias_groups=_groups(effects),
        separations={id: CATALOGUE[id].separated_by for id in effects},
        candidates=_candidates(effects, scores),
        screened=tuple(
            ScreenedEffect(id, 900.0 / (1 + k) ** 2 - 12.0 if effects else 4.0 - 1.2 * k)
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
    gain = 1480.0 if effects else 3.0
    found = [((), 0.0, base, True, True), ((first,), gain, best, True, True)]
    found += [(("run_in",), 0.4 * gain, 0.5 * (base + best), True, True)]
    found += [(("thermal",), 8.0, 0.97 * base, False, True), (("gain",), -6.8, base, True, True)]
    found += [(("stribeck",), np.nan, np.nan, True, False)]
    found += [((first, "velocity_dependent_L"), gain + 2.1, 1.01 * best, True, True)]
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
        "relaxation_length": ("m", 150e-6 * np.geomspace(0.02, 1, 8), 0.02, 0.8, 0.0),
        "wavelength": ("m", 1 / np.linspace(2 / total, 60 / total, 16), 0.0, np.nan, 0.0),
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
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-1:]}"
        self.open.pop()

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
    print_loop(loop, console)
    return console.file.getvalue()


def html_of(loop: Loop) -> str:
    figures = dict.fromkeys(FIGURES, b"<svg/>")
    return page(loop, figures, version="1.2.3", command="jaxfric loop '<b>&.csv'")


def page_of(loop: Loop) -> Page:
    html = html_of(loop)
    assert "http" not in html and "@import" not in html and "url(" not in html
    return Page(html)


@pytest.mark.parametrize(("words", "other"), [(SLIDER, AXIS), (AXIS, SLIDER)])
def test_each_rig_has_its_own_words(words, other) -> None:
    """What is said of one rig is not said of the other: what its record is split by, its base, its
    parameters, its effects and what marks their beginning."""
    slider = words is SLIDER
    loop = dataclasses.replace(make_loop("effects"), words=words, effects=("stribeck",))
    text, html = " ".join(printed(loop).split()), page_of(loop).text
    for shown in (text, html):
        assert f"split by {words.part}: no {words.part.split()[1]} is both" in shown
        assert words.errors in shown and other.errors not in shown
        assert other.part not in shown and other.marks not in shown
        assert ("direct effect" in shown) == slider  # the law of a slider has an A
    assert f"anything that repeats after {words.marks} is" in html
    assert words.catalogue["stribeck"].equation in html
    assert other.catalogue["stribeck"].equation not in html
    assert ("what does the slip law lack?" in html) == slider
    assert ("0 s: 1 µm/s" in html) == slider and ("0 s: 0.001 mm/s" in html) != slider
    titles = [a.get_title(loc="left") for a in figure_of(loop, "residual").axes]
    assert titles[0].endswith(f"dashed lines: {words.marks}")


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
    html = page_of(loop).text
    opening = html[: html.index("error on rows that no fit saw")]
    for id in loop.effects:
        about = CATALOGUE[id]
        assert about.meaning in opening and about.equation in opening
    assert "What to do next" in opening
    certain = verdict in ("no_missing_effect", "effects", "ambiguous")
    assert ("jaxfric gains --from loop.json" in opening) == certain
    assert ("jaxfric predict loop.json" in opening) == certain
    open_ = "known to tell time_drift from slip_trend: a dwell. Not in this run: a zero-load"
    assert (open_ in opening) == (verdict == "ambiguous")
    lines = [step.command for step in next_steps(loop) if step.command]
    for line in lines:
        words = shlex.split(line)
        assert words[0] == "jaxfric" and parsed(words[1:])
    assert not parsed(["gains", "--of", "loop.json"])  # a planted fault


THREE = PlannedRun((2.0, 20.0, 2.0), 100.0, "um/s")
FIVE = PlannedRun((2.0, 20.0, 2.0, 20.0, 2.0), 100.0, "um/s")
RISE = PlannedRun((2.0, 20.0), 100.0, "um/s", second_length=50.0)


@pytest.mark.parametrize(
    ("run", "wanted", "options", "words"),
    [
        (RISE, "the first velocity repeated at the end", '"2, 20, 2, 20, 2 um/s" --slip-per',
         "with the first repeated at the end, then 20, 2 µm/s"),
        (THREE, "the first velocity repeated at the end", '"2, 20, 2, 20, 2 um/s"', "20, 2 µm/s"),
        (FIVE, "the first velocity repeated at the end", '"2, 20, 2, 20, 2 um/s"', "such a run"),
        (RISE, "up and down steps, longer than 3 L2",
         '"2, 20, 2, 20, 2 um/s" --slip-per-step "200 um"', "20, 2 µm/s and steps of 4 L2"),
        (THREE, "up and down steps, longer than 3 L2",
         '"2, 20, 2, 20, 2 um/s" --slip-per-step "100 um"', "with 20, 2 µm/s appended"),
        (FIVE, "up and down steps", '"2, 20, 2, 20, 2 um/s"', "are such a run"),
        (RISE, "a dwell, a zero-load baseline", '"2, 20, 0.6667, 2, 20 um/s"', "dwell at 0.6667"),
        (THREE, "elastic loading, a slip channel",
         '"2, 20, 2 um/s" --slip-per-step "100 um" --slip-channel "0.1 um"', "channel of slip"),
        (RISE, "three velocities over two decades", '"2, 20, 200, 2, 20 um/s"', "over two decades"),
        (RISE, "a known load", '"2, 20 um/s" --slip-per-step "100 um"', "change to that run"),
        # several wishes are one run, each wish once
        (RISE, "a dwell, up and down steps, longer than 3 L2, a slow dwell, three velocities over"
         " two decades", '"2, 20, 200, 2, 20, 2, 0.6667 um/s" --slip-per-step "200 um"', "two d"),
    ],
)  # fmt: skip
def test_the_run_that_would_decide_is_the_one_planned(run, wanted, options, words) -> None:
    planned = deciding_run(run, wanted)
    assert planned.options().startswith(options) and words in planned.words()
    assert parsed(["protocol", *shlex.split(planned.options())])


def of_rock(
    groups: Sequence[tuple[str, ...]], verdict: str, together: bool = False, speeds=(2.0, 20.0)
) -> Loop:
    """A loop of few steps whose effects, the first of each group, are not told from the others;
    `together`: what is missing follows time and slip alike."""
    loop, ids = make_loop(verdict), tuple(group[0] for group in groups)
    after = dataclasses.replace(loop.after, effects=ids)
    V = 1e-6 * np.asarray(speeds)
    fit = dataclasses.replace(loop.base_fit, steps=VelocitySteps(25.0 * np.arange(len(V)), V))
    one = np.ones(1)
    seen = ("time", "slip") if together else ("state",)
    location = tuple(LocationProfile(v, "s", one, one, one, 0.9, 1e-9, 0.9) for v in seen)
    separations = {id: CATALOGUE[id].separated_by for id in ids}
    return dataclasses.replace(
        loop, effects=ids, after=after, base_fit=fit, alias_groups=tuple(groups),
        separations=separations, location=location,
    )  # fmt: skip


SECOND, DRIFT = ("second_state", "thermal", "run_in"), ("time_drift", "run_in", "gain")
BACK = "It begins with this record's velocities: of what is missing, what comes back is friction"


@pytest.mark.parametrize(
    ("loop", "speeds", "words", "not_words"),
    [
        (of_rock([SECOND, DRIFT], "outside_catalogue"), "2, 20, 2, 20, 2, 0.6667", [
            "with the first repeated at the end, then 20, 2 µm/s and a slow dwell at 0.6667 µm/s",
            "second_state from thermal or run_in: up and down steps; time_drift from run_in or gain"
            ": a dwell.", "Not in this run: longer than 3 L2 (second_state); a zero-load base",
            BACK,
        ], ["time from slip"]),
        (of_rock([SECOND], "outside_catalogue", True), "2, 20, 2, 20, 2, 0.6667",
         ["Its other velocity tells time from slip."], ["zero-load"]),
        (of_rock([("time_drift", "slip_trend")], "ambiguous", True), "2, 20, 0.6667, 2, 20",
         ["tells time from slip"], [BACK]),
        (of_rock([("stribeck", "viscous"), ("slip_trend", "gain"), ("viscous", "gain")],
         "outside_catalogue"), "2, 20, 200, 2, 20, 0.6667", ["Not in this run: four velocities ar"
         "ound Vs (stribeck); different velocities at equal slip (slip_trend).", BACK], []),
    ],
)  # fmt: skip
def test_one_run_has_all_that_is_asked_for(loop, speeds, words, not_words) -> None:
    """It is said first, then the command that asks for it; the rest stands beside."""
    first, ask, *rest = next_steps(loop)
    assert first.text.startswith("Make this run: ") and not first.command
    assert all(text in first.text for text in words), first.text
    assert not any(text in first.text for text in not_words), first.text
    assert ask.command.startswith(f'jaxfric protocol "{speeds} um/s" ')
    assert [s.lead() for s in (first, ask)] == ["next"] * 2 and {s.lead() for s in rest} == {"also"}
    asked = [s.command for s in (ask, *rest) if "--tell" in s.command]
    assert len(asked) == len(loop.alias_groups) and len({a.split("--tell")[0] for a in asked}) == 1
    again = [s.text for s in rest if "record the run again" in s.text]
    assert not again and not any("below" in s.text for s in (first, ask, *rest))
    html = page_of(loop).text
    assert html.index(first.text) < html.index(ask.command) < html.index(f"Also: {rest[0].text}")


@pytest.mark.parametrize(
    ("length", "words", "not_words"),
    [
        (0.0, "Not in this run: longer than 3 L2 (second_state).", "steps of 4 L2"),
        (3000.0, "up and down steps, longer than 3 L2.", "steps of 4 L2"),
        (4000.0, "and steps of 4 L2, 1.6e+04 µm each.", "Not in this run"),
        (60000.0, "Not in this run: longer than 3 L2 (second_state).", "steps of 4 L2"),
    ],
)
def test_steps_are_said_to_be_long_enough_where_they_are(length, words, not_words) -> None:
    """By the L2 of the second state that was taken; 0: of none."""
    loop = of_rock([SECOND], "outside_catalogue")
    known = dict(loop.after.parameters)
    known.pop("second_state.L2", None)
    if length:
        known["second_state.L2"] = Estimate(1e-6 * length, 0.0, 0.0, 0.0, "m")
    first = next_steps(dataclasses.replace(
        loop, after=dataclasses.replace(loop.after, parameters=known)
    ))[0].text  # fmt: skip
    assert words in first and not_words not in first, first


def test_the_two_that_would_explain_most_are_asked_for_first() -> None:
    loop = of_rock([("run_in", "thermal", "second_state")], "outside_catalogue")
    better = max(c.delta_bic for c in loop.candidates) + 1e3
    both = [
        dataclasses.replace(
            loop.candidates[0], effects=(id,), delta_bic=better + k, refused="x not fixed",
            converged=True, physical=True, parameters={},
        )
        for k, id in enumerate(("thermal", "second_state"))
    ]  # fmt: skip
    told = dataclasses.replace(loop, candidates=(*loop.candidates, *both))
    _, ask, *rest = next_steps(told)
    assert ask.command.endswith("--tell second_state,thermal") and not ask.also
    assert any("--tell run_in," in step.command and step.also for step in rest)
    one = dataclasses.replace(loop, candidates=(*loop.candidates, both[0]))
    assert next_steps(one)[1].command.split("--tell ")[1].startswith("run_in,")


def test_a_run_that_no_plan_changes_is_said_as_it_was() -> None:
    loop = of_rock([("gain", "stiffness")], "outside_catalogue")
    first, ask, look, own = next_steps(loop)
    assert first.text.endswith("A run that would decide: a known load.")
    assert "the record's own velocities, for you to change" in ask.text and look.also and own.also
    assert "record the run again: what comes back" in look.text and "location.png" in look.text


def test_every_planned_change_is_in_the_catalogue() -> None:
    said = {part for e in CATALOGUE.values() for part in e.separated_by.split(", ")}
    assert set(CHANGES) <= said


def test_a_plan_asks_for_the_effect_and_its_likeliest_rival() -> None:
    """The best refit in its place, else the most alike; none that no plan can be asked for."""
    loop = make_loop("ambiguous")
    ((id, *_),) = loop.alias_groups
    sizes = ((id, 50.0), ("gain", 45.0), ("run_in", 48.0))
    fits = [CandidateScore((e,), gain, 1, 1, {}, True, True, e == id) for e, gain in sizes]
    groups = ((id, "normal_stress", "slip_trend", "gain", "run_in"),)
    loop = dataclasses.replace(loop, alias_groups=groups, candidates=fits)
    lines = [s.command for s in next_steps(loop) if "--tell" in s.command]
    assert len(lines) == 1 and lines[0].endswith(f"--from loop.json --tell {id},run_in")
    (text,) = [s.text for s in next_steps(loop) if "--tell" in s.command]
    assert "(then the same with gain or slip_trend for run_in; no plan can be asked of" in text
    assert text.endswith("no plan can be asked of normal_stress):")
    two = dataclasses.replace(loop, alias_groups=((id, "run_in"),))
    (text,) = [s.text for s in next_steps(two) if "--tell" in s.command]
    assert "then the same" not in text and "no plan can" not in text
    assert lines[0].startswith('jaxfric protocol "1, 10, 1, 3, 10, ')
    none = dataclasses.replace(loop, alias_groups=((id, "normal_stress"),))
    assert not any("protocol" in s.command for s in next_steps(none))


NEXT, AGAIN = "--from loop.json", "--from loop.json --tell base,second_state"


@pytest.mark.parametrize(
    ("verdict", "effects", "words", "end"),
    [
        ("effects", ("second_state",), "shows second_state again", AGAIN),
        ("effects", ("gain", "run_in"), "the same with run_in for gain):", "--tell base,gain"),
        ("effects", ("gain", "normal_stress"), "", ""),
        ("effects", ("mine",), "", ""),
        ("no_missing_effect", (), "How large an effect must be to be named", NEXT),
        ("ambiguous", ("time_drift",), "", ""),
        ("too_weak", (), "", ""),
        ("outside_catalogue", (), "", ""),
    ],
)  # fmt: skip
def test_a_clear_verdict_says_what_the_next_run_would_show(verdict, effects, words, end) -> None:
    loop = make_loop(verdict)
    after = dataclasses.replace(loop.after, effects=effects)
    loop = dataclasses.replace(loop, effects=effects, after=after)
    found = [s for s in next_steps(loop) if "the next run" in s.text]
    assert [words in s.text and s.command.endswith(end) for s in found] == ([True] if words else [])
    assert all(parsed(shlex.split(s.command)[1:]) for s in found)
    axis = next_steps(dataclasses.replace(loop, words=AXIS, effects=(), after=loop.before))
    assert not any("the next run" in s.text for s in axis)


@pytest.mark.parametrize(
    ("group", "second", "words"),
    [
        (("time_drift", "slip_trend"), (1490.0, "second_state.L2 not fixed"), None),
        (("time_drift", "slip_trend"), (1500.0, "second_state.L2 not fixed"),
         "This loop does not take one (BIC 20 lower, but second_state.L2 not fixed)."),
        (("time_drift", "slip_trend"), (1500.0, "predicts the select block worse"),
         "This loop does not take one (BIC 20 lower, but predicts the select block worse)."),
        (("time_drift", "slip_trend"), (1500.0, ""), None),
        (("time_drift", "thermal", "second_state"), (0.0, ""),
         "This loop cannot tell one from thermal or time_drift."),
        (("time_drift", "thermal", "second_state"), (1500.0, "second_state.L2 not fixed"),
         "(BIC 20 lower, but second_state.L2 not fixed) and cannot tell one from thermal or time_"),
    ],
)  # fmt: skip
def test_a_loop_says_why_a_comparison_of_laws_may_say_otherwise(group, second, words) -> None:
    """Where it refused a second state that BIC asks for, or cannot tell one from other effects."""
    gain, why = second
    fits = [
        CandidateScore(("time_drift",), 1480.0, 1, 1, {}, True, True, True),
        CandidateScore(("time_drift", "second_state"), gain, 1, 1, {}, True, True, False, why),
    ]
    loop = dataclasses.replace(make_loop("ambiguous"), alias_groups=(group,), candidates=fits)
    told = [s.text for s in next_steps(loop) if "jaxfric compare may" in s.text]
    assert [words in text for text in told] == ([] if words is None else [True])
    # what would decide is in the run that is said first, else in this line
    run = next_steps(loop)[0].text
    assert ("second_state: up and" in run) == (bool(told) and "worse" not in told[0])
    assert not any("What would decide" in text for text in told)
    known = dataclasses.replace(loop, separations={"time_drift": "a known load"}, location=())
    said = [s.text for s in next_steps(known) if "jaxfric compare may" in s.text]
    assert [("What would decide" in text) == ("worse" not in text) for text in said] == [
        True
    ] * len(told)
    assert not any("jaxfric compare" in s.text for s in next_steps(make_loop("effects")))


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
    assert not takes_gains(dataclasses.replace(loop, words=AXIS))
    after = dataclasses.replace(loop.after, effects=("rate_and_state",))
    axis = dataclasses.replace(make_loop("effects", unit="N"), words=AXIS, after=after)
    assert takes_gains(axis)
    text = next(s for s in next_steps(axis) if "gains" in s.command).command
    assert "--normal-force" not in text and '--velocity "0.001..0.01 mm/s"' in text
    feedforwards = [s for s in next_steps(axis) if "feedforward loop.json" in s.command]
    assert len(feedforwards) == 1 and parsed(shlex.split(feedforwards[0].command)[1:])
    assert not any("feedforward" in s.command for s in next_steps(loop))
    own = dataclasses.replace(loop.after, effects=("mine",))
    assert not takes_gains(dataclasses.replace(loop, after=own))


def test_the_page_has_one_pair_of_errors() -> None:
    """That of the rows held out: sentence, card and figure say it; blocks are folded away."""
    loop = make_loop("effects")
    html = html_of(loop)
    told = re.sub(r"<details>.*?</details>", "", html, flags=re.DOTALL)
    assert re.findall(r"[\d.]+ σ → [\d.]+ σ", told) == [
        " → ".join(f"{loop.heldout(s) / loop.sigma:.2f} σ" for s in (loop.before, loop.after))
    ]
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
    assert "th, .w { white-space: normal; }" in narrow and "move it sideways" in narrow
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
    assert panel.height > 0.5 * 3.3 * figure.dpi
    assert " × 10⁻³," in figure.get_suptitle()


def test_the_gain_of_a_loop_is_that_of_its_model_in_any_order() -> None:
    loop = make_loop("effects")
    [own] = [c for c in loop.ranked() if loop.role(c) == "model"]
    assert loop.gain() == own.delta_bic > 0
    both = dataclasses.replace(loop.after, effects=("b", "a"))
    two = dataclasses.replace(own, effects=("a", "b"), delta_bic=31.0)
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
    assert "The time since a step carries 71 %" in page_of(make_loop("effects")).text
    assert sum(widths) == pytest.approx(100.0) and names[-1] == "not explained"
    assert widths[0] == max(widths) and names[0] == "the time since a step"


def test_where_nothing_is_placed_the_location_figure_is_no_higher_than_its_words() -> None:
    figure = figure_of(dataclasses.replace(make_loop("effects"), location=()), "location")
    figure.canvas.draw()
    words, page = figure._suptitle.get_window_extent(), figure.bbox
    assert page.y0 <= words.y0 and words.y1 <= page.y1 and words.height > 0.4 * page.height


def figure_of(loop: Loop, name: str) -> Figure:
    """The figure that would be saved."""
    drawn: list[Figure] = []
    with pytest.MonkeyPatch.context() as patch:
        for module in ("loop", "location"):
            place = f"jaxfric.plot.{module}.save"
            patch.setattr(place, lambda figure, *_: drawn.append(figure) or [])
        DRAWERS[name](loop, Path())
    return drawn[0]


@pytest.mark.parametrize(
    ("parts", "large"),
    [
        ((), "white"),
        ((NoisePart(0.4, "rows", 3.0), NoisePart(0.3, "time", 9.0)), "correlated"),
        ((NoisePart(-0.4, "rows", 1.0),), "alternating"),
    ],
)
def test_a_card_has_one_word_in_large_letters(parts, large):
    """The rest of the noise's words is small; of every card."""
    loop = make_loop("effects")
    noise = dataclasses.replace(loop.after.noise, parts=parts)
    loop = dataclasses.replace(loop, after=dataclasses.replace(loop.after, noise=noise))
    made = page(loop, {}, version="1.2.3", command="jaxfric loop")
    cards = re.findall(r'<ul class="cards">(.*?)</ul>', made)[0]
    shown = re.findall(r"<b>(.*?)</b><span>(.*?)</span>", cards)
    assert len(shown) == 3
    assert shown[2][0] == large and shown[2][1].startswith("noise of the record")
    assert (noise_text(noise) in shown[2][1]) == (large != "white")


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict(verdict: str) -> None:
    loop = make_loop(verdict, path=HOSTILE, unit="N" if verdict == "too_weak" else "1")
    text, html = " ".join(printed(loop).split()), page_of(loop)
    assert html.images == len(FIGURES) and html.seen.count("h1") == 1
    assert html.seen.count("b") == 4 + len(loop.effects)  # cards, the verdict, effects' meanings
    assert html.text.count(HOSTILE) >= 3
    for words in (loop.sentence, *loop.reasons):
        assert words in text and words in html.text
    assert text.startswith(f"{verdict}: ")
    for shown in (text, html.text):
        for words in ("train", "select", "report", "95 % interval", "did not converge", "ΔBIC"):
            assert words in shown
        for id in loop.effects:
            assert id in shown
        assert "nan" not in shown.lower().split()
        assert not re.search(r"\de-0[3-9]", shown)
    for words in (loop.warnings[0], loop.record.provenance.sha256, "jaxfric 1.2.3"):
        assert words in html.text
    content = json.loads(json.dumps(loop.to_json(), allow_nan=False))
    assert not set(KEYS.split()) - set(content)
    assert set(content["tests"]["ljung_box"]) == {"before", "after"}
    assert {"train_rms", "select_rms", "report_rms", "in_sigma", "parameters"} <= set(
        content["before"]
    )


def test_one_sigma_for_the_sentence_the_table_the_figure_and_the_file(tmp_path: Path) -> None:
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
    held = [loop.heldout(s) / (1.25 * loop.sigma) for s in (loop.before, loop.after)]
    told = Told(held[0], held[1], 1.1, 1.0).change()
    assert told == "held-out error {:.2f} -> {:.2f} sigma".format(*held)
    row = errors(noisy).rows[-1][-2:]
    assert told == "held-out error {:.2f} -> {:.2f} sigma".format(*map(float, row))
    assert (
        "0.3 × 10⁻³ where the model is fitted, 0.375 × 10⁻³ in rows held out" in errors(noisy).note
    )
    assert "held out" not in errors(loop).note
    steps = [float(row[-1]) for row in by_velocity(noisy).rows]
    old = [float(row[-1]) for row in by_velocity(loop).rows]
    assert np.divide(old[-2:], steps[-2:]) == pytest.approx(1.25, rel=0.002)
    assert steps[1] == old[1] and content["noise"]["sigma_held_out"] == 1.25 * loop.sigma
    residual_figure(noisy).savefig(tmp_path / "residual.svg")
    drawing = (tmp_path / "residual.svg").read_text()
    for number in held:
        assert f"held-out error {number:.2f} σ" in drawing
    assert "in rows held out" in drawing and "0.375 × 10⁻³ -->" in drawing


def test_no_line_of_a_title_ends_in_a_number() -> None:
    told = ": what is left in units of 2.48 × 10⁻³, in others of 1.29 × 10⁻³"
    texts = [panel_title("r" * more + told) for more in range(20, 104)]
    assert all("2.48 × 10⁻³" in text and "1.29 × 10⁻³" in text for text in texts)
    torques = [
        panel_title(f"{'r' * more}: σ = 2.3 N m, others 3.86 mN m") for more in range(60, 104)
    ]
    assert all("2.3 N m" in text and "3.86 mN m" in text for text in torques)
    assert "\n" not in texts[0] and "\n" in texts[-1]


def test_the_title_of_a_model_with_many_effects_fits_its_panel() -> None:
    """Drawn in the panels' letters on a figure as wide as theirs; every word is there."""
    names = " + ".join(["position_dependence", "direction_asymmetry", "log_viscous"] * 3)
    text = panel_title(f"After: with {names}   (held-out error 11.47 σ)")
    assert text.split() == f"After: with {names} (held-out error 11.47 σ)".split()
    for more in range(40):  # the error stays in one piece wherever the line ends
        assert "(held-out error 1.05 σ)" in panel_title(
            "a" * (60 + more) + "   (held-out error 1.05 σ)"
        )
    figure = Figure(figsize=(10.0, 4.0))
    axis = figure.add_axes((0.08, 0.1, 0.9, 0.7))
    tidy(axis, text)
    found = [t for t in figure.findobj(Text) if t.get_text() == text]
    assert [t.get_window_extent().x1 <= figure.bbox.x1 for t in found] == [True]


@pytest.mark.parametrize(
    ("before", "std", "r", "words"),
    [
        ((21.0, 0.2), 2.0, -0.99, "F_c is 1.5 ± 2 N (± 1 in this model alone), though it was known"
         " before: it trades with log_viscous.c (correlation −0.99); known is F_c + 4.95 log_visc"
         "ous.c = 21.30 ± 0.14 N"),
        ((21.0, 0.2), 2.0, -0.69, "no parameter of an effect alone takes its place"),
        ((21.0, 0.2), 1.4, -0.99, None),
        ((0.3, 0.2), 2.0, -0.99, None),
    ],
)  # fmt: skip
def test_what_takes_the_place_of_a_known_parameter_is_told(before, std, r, words) -> None:
    """Coulomb friction that a logarithm of speed takes over; errors of the model alone."""
    loop = make_loop("effects", unit="N")
    parameters = {"F_c": _estimate(1.5, std, "N"), "log_viscous.c": _estimate(4.0, 0.2, "N")}
    after = dataclasses.replace(loop.after, parameters=parameters, free=tuple(parameters))
    first = dataclasses.replace(loop.before, parameters={"F_c": _estimate(*before, "N")})
    details: Any = SimpleNamespace(covariance=np.array([[1.0, 0.2 * r], [0.2 * r, 0.04]]))
    loop = dataclasses.replace(loop, before=first, after=after, details=details)
    told = traded(loop)
    assert [words in line for line in told if words] == ([] if words is None else [True])
    assert bool(told) == (words is not None)


def test_a_small_part_of_the_noise_is_told_wherever_noise_is(tmp_path: Path) -> None:
    loop = make_loop("effects")
    words = "white but for 4 % of its variance correlated over 0.8 s"
    noise = NoiseEstimate(loop.sigma, (NoisePart(0.04, "time", 0.8),))
    loop = dataclasses.replace(loop, after=dataclasses.replace(loop.after, noise=noise))
    assert words in " ".join(printed(loop).split()) and words in page_of(loop).text
    DRAWERS["noise"](loop, tmp_path)
    assert f"noise of the record: {words}" in (tmp_path / "noise.svg").read_text()
    base: Any = loop.base_fit
    fit = dataclasses.replace(base, noise=noise)
    (line,) = [line for line in summary(fit) if words in line]
    assert "larger than the rms" not in line
    large = dataclasses.replace(noise, sigma=2 * fit.rms)
    assert any("larger than the rms" in li for li in summary(dataclasses.replace(fit, noise=large)))


def test_numbers_are_those_of_the_loop() -> None:
    loop = make_loop("effects")
    text = printed(loop)
    for name in NAMES:
        before, after = (s.rms[name] / loop.sigma for s in (loop.before, loop.after))
        assert re.search(rf"^{name}: .*{before:.3f} +{after:.3f}$", text, re.M)
    assert re.search(r"^L +.*18\.30 +17\.20 ± 0\.40 +16\.42 to 17\.99 +−2\.7 +µm *$", text, re.M)
    assert re.search(r"^second_state.L2 .* 61\.0 ± 4\.0 +53\.2 to 68\.8 +µm *$", text, re.M)
    assert re.search(r"^second_state +\+1480\.0 .* the model *$", text, re.M)
    assert "servo_lag or sensor_lag (0.998)" in text
    assert "split by velocity step" in text


def test_the_table_of_models_says_what_each_was() -> None:
    """Only the last is the model; those taken before it were on the way."""
    loop = make_loop("effects")
    (first,) = loop.effects
    wider = (first, "velocity_dependent_L")
    scores = [
        dataclasses.replace(c, accepted=c.accepted or c.effects == wider) for c in loop.candidates
    ]
    after = dataclasses.replace(loop.after, effects=wider)
    loop = dataclasses.replace(loop, candidates=tuple(scores), after=after, effects=wider)
    table = candidates(loop, most=20)
    said = {row[0]: row[-1] for row in table.rows}
    assert said[" + ".join(wider)] == "the model"
    assert (said[first], said["base"]) == ("on the way", "the start")
    assert said["run_in"] == "not taken: BIC 890 worse than the model"
    assert (said["thermal"], said["stribeck"]) == ("impossible parameters", "did not converge")
    assert [table.rows[k][-1] for k in table.marked] == ["the model"]


@pytest.mark.parametrize(
    ("gain", "why", "said"),
    [
        (1481.9, "", "not taken: as good, BIC within 2 of the model"),
        (1478.1, "", "not taken: as good, BIC within 2 of the model"),
        (1477.0, "", "not taken: BIC 3 worse than the model"),
        (1486.0, "", "not taken"),
        (1486.0, "x.L2 not fixed", "not taken: x.L2 not fixed"),
    ],
)
def test_every_model_that_is_not_taken_has_its_reason(gain, why, said) -> None:
    """Also that with a better BIC and a better select error, of which a tie is no evidence."""
    loop = make_loop("effects")
    fits = [
        CandidateScore(("second_state",), 1480.0, 1, 1, {}, True, True, True),
        CandidateScore(("run_in", "time_drift"), gain, 1, 0.8, {}, True, True, False, why),
    ]
    table = candidates(dataclasses.replace(loop, candidates=tuple(fits)), most=20)
    assert {row[0]: row[-1] for row in table.rows}["run_in + time_drift"] == said
    assert "how well the select rows are predicted" in table.note


def test_the_error_that_counts_as_noise_stands_beside_the_errors() -> None:
    loop = make_loop("outside_catalogue")
    known = dataclasses.replace(loop, most_held_out=1.402)
    words, card = "held-out rows count as noise up to 1.40 σ", "by chance up to 1.40"
    for shown, there in ((loop, False), (known, True)):
        assert (words in errors(shown).note) == there
        assert (card in page_of(shown).text) == there
    assert json.loads(json.dumps(known.to_json()["noise"]["most_held_out"])) == 1.402


def test_aliases_say_what_would_separate_them() -> None:
    loop = make_loop("ambiguous")
    for shown in (" ".join(printed(loop).split()), page_of(loop).text):
        assert "time_drift: this record cannot tell it from slip_trend; what would: " in shown
        assert CATALOGUE["time_drift"].separated_by in shown
        assert "1.900e−6 ± 0.030e−6" in shown


def test_a_record_of_one_step_says_that_less_can_be_told() -> None:
    loop = make_loop("outside_catalogue", many=False)
    for shown in (" ".join(printed(loop, 80).split()), page_of(loop).text):
        assert "too few velocity steps" in shown and "4 pairs that it cannot separate" in shown
        assert "train, select, report" in shown


@pytest.mark.parametrize(
    ("steps", "words", "not_words"),
    [
        (1, "split by displacement", "velocity step:"),
        (2, "the step before it is cut: its start is fitted, its end selects", "no step is both"),
        (3, "no step is both fitted and held out", "cut"),
        (12, "no step is both fitted and held out", "cut"),
    ],
)
def test_what_is_said_of_a_split_is_so(steps, words, not_words) -> None:
    """A step with rows in train and in another block is both fitted and held out."""
    V = VELOCITIES[: steps + 1]
    times = VelocitySteps(np.concatenate([[0.0], np.cumsum(150e-6 / V[:-1])]), V)
    end = times.times[-1] + 150e-6 / V[-1]
    blocks = split(_times(times, end, 100 * len(V)), times)
    both = set(blocks.step[blocks.train]) & set(blocks.step[blocks.select | blocks.report])
    assert bool(both) == (steps < 3)
    text = splitting(dataclasses.replace(make_loop("effects"), blocks=blocks))
    assert words in text and not_words not in text


@pytest.mark.parametrize(
    ("verdict", "more"),
    [("effects", {}), ("outside_catalogue", {"many": False, "unit": "N", "path": HOSTILE})],
)
def test_figures(verdict: str, more: dict[str, Any], tmp_path: Path) -> None:
    names = draw_loop(make_loop(verdict, **more), tmp_path)
    assert names == [f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")]
    for name in FIGURES:
        pixels = imread(tmp_path / f"{name}.png")[..., :3]
        assert min(pixels.shape[:2]) > 300 and np.mean(np.any(pixels < 0.9, axis=2)) > 0.01, name
        assert (tmp_path / f"{name}.svg").read_text().lstrip().startswith("<?xml")


# ---- the verb --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("least", "converged", "floor"), [(0.97, True, True), (0.4, True, False), (0.4, False, True)]
)
def test_one_sigma_is_no_floor_where_a_model_was_below_it(least, converged, floor):
    loop = make_loop("outside_catalogue")
    better = dataclasses.replace(
        loop.candidates[-1], train_rms=least * loop.sigma, converged=converged
    )
    note = errors(dataclasses.replace(loop, candidates=(*loop.candidates, better))).note
    assert ("no model brings the error below 1 σ" in note) == floor
    assert ("the error of the fitted rows to 0.4 σ" in note) != floor


@pytest.fixture
def closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A folder with run.csv in which the verb gets a made-up loop; what it asked for."""
    asked: dict[str, Any] = {}

    def close_loop(record, *, progress, **options) -> Loop:
        progress("screening 17 effects")
        asked.update(options, read=len(record))
        return make_loop("no_missing_effect")

    def draw(name: str, loop: Loop, folder: Path) -> list[str]:
        (folder / f"{name}.png").write_bytes(b"")
        (folder / f"{name}.svg").write_bytes(b"<svg/>")
        return [f"{name}.png", f"{name}.svg"]

    monkeypatch.setattr("jaxfric.loop.close_loop", close_loop)
    for name in FIGURES:
        monkeypatch.setitem(DRAWERS, name, functools.partial(draw, name))
    monkeypatch.chdir(tmp_path)
    written(Path("run.csv"), record_text())
    return asked


def test_the_verb(closed: dict[str, Any]) -> None:
    options = ("--with", "slip_trend, gain", "--with", "gain", "--without", "thermal", "--most", 2)
    code, out, err = run("loop", "run.csv", "--stiffness", "5e-3/um", *options)
    assert code == 0, err
    assert closed == {
        "stiffness": "5e-3/um",
        "law": "slip",
        "steps": None,
        "events": None,
        "rows": None,
        "with_": ("slip_trend", "gain"),
        "without": ("thermal",),
        "most": 2,
        "read": 91,
    }
    assert out.startswith("no_missing_effect: ") and "most2/loop.html (open it" in out
    assert "jaxfric: screening 17 effects\n" in err and "jaxfric: warning: K is 1.6" in err
    kinds = [f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")]
    folder = Path("run-loop-with-slip_trend+gain-without-thermal-most2")
    assert sorted(p.name for p in folder.iterdir() if p.name[0] != ".") == sorted(
        ["loop.html", "loop.json", *kinds]
    )
    assert (
        "--with 'slip_trend, gain' --with gain --without thermal --most 2"
        in Page((folder / "loop.html").read_text(encoding="utf-8")).text
    )


@pytest.mark.parametrize(
    ("old", "new", "remark"),
    [
        ("loop a.csv --rig axis --held", "axis a.csv --held", "axis' is now 'jaxfric axis'"),
        ("loop --rig=axis a.csv", "axis a.csv", "axis' is now 'jaxfric axis'"),
        ("loop runs --out o --rig steady", "steady runs --out o", "steady' is now 'jaxfric ste"),
        ("loop a.csv --rig slider --rows 9", "loop a.csv --rows 9", "slider' is now 'jaxf"),
        ("loop a.csv --rows 9", "loop a.csv --rows 9", ""),
        ("record a.csv --rig axis", "record a.csv --rig axis", ""),
        ("fit loop --rig axis", "fit loop --rig axis", ""),
    ],
)
def test_the_old_spelling_of_a_rig(old: str, new: str, remark: str) -> None:
    words, said = in_new_words(old.split())
    assert words == new.split() and remark in said and bool(said) == bool(remark)


@pytest.mark.parametrize("rig", [("--rig", "press"), ("--rig",), ("--rig=",)])
def test_a_rig_that_there_is_not_is_refused(rig: tuple[str, ...]) -> None:
    assert_refused(run("loop", "run.csv", *rig), "--rig", "'jaxfric axis' and 'jaxfric steady'")


def test_an_axis_in_both_spellings(closed: dict[str, Any], monkeypatch) -> None:
    """The same is asked, written to the same folder and told; the old one tells the new."""
    made = dataclasses.replace(make_loop("no_missing_effect"), words=AXIS)

    def close_axis_loop(record, *, progress, **options) -> Loop:
        closed.update(options, read=len(record))
        return made

    monkeypatch.setattr("jaxfric.axis.close_axis_loop", close_axis_loop)
    turns = (f"{k / 10},{100 * np.sin(k / 9)},{k % 7}\n" for k in range(90))
    written(Path("a.csv"), "time [s],position [mm],motor_force [N]\n" + "".join(turns))
    options = ("--held", "--with", "cubic", "--most", 2, "--cutoff", "4 Hz")
    asked, outcomes, texts = [], [], []
    for verb_of_it in (("axis", "a.csv"), ("loop", "a.csv", "--rig", "axis")):
        outcomes.append(run(*verb_of_it, *options))
        asked.append(dict(closed))
        folder = Path("a-loop-with-cubic-most2-held-cutoff4Hz")
        texts.append((folder / "loop.json").read_text())
        html = Page((folder / "loop.html").read_text(encoding="utf-8")).text
        assert "jaxfric axis a.csv --held --with cubic --most 2 --cutoff '4 Hz'" in html
    new, old = outcomes
    assert (new.code, old.code) == (0, 0), outcomes
    assert asked[0] == asked[1] and texts[0] == texts[1] and new.out == old.out
    assert asked[0]["with_"] == ("cubic",) and asked[0]["held"] is True and asked[0]["most"] == 2
    assert asked[0]["preparation"].cutoff == 4.0 and asked[0]["read"] == 90
    remark = "jaxfric: note: 'jaxfric loop --rig axis' is now 'jaxfric axis'\n"
    assert old.err.count(remark) == 1 and remark not in new.err
    assert "written by the same command" in old.err  # as the new one is noted


def test_few_rows_through_the_verb(closed: dict[str, Any]) -> None:
    code, _, err = run("loop", "run.csv", "--stiffness", "5e-3/um", "--rows", 1000)
    assert code == 0, err
    assert closed["rows"] == 1000 and closed["read"] == 91
    page = Page(Path("run-loop-rows1000/loop.html").read_text(encoding="utf-8"))
    assert "--rows 1000" in page.text


def test_the_verb_in_a_script(closed: dict[str, Any]) -> None:
    code, out, err = run("loop", "run.csv", "--stiffness", "5e-3/um", "--json", "--out", "here")
    assert code == 0 and json.loads(out)["schema"] == "jaxfric.loop/1"
    assert out == Path("here/loop.json").read_text()
    assert err.startswith("jaxfric: warning: ") and err.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), ("--stiffness is missing", "1.6e-3/um")),
        (("--stiffness", "5e-3/um", "--most", "0"), ("--most is 0",)),
        (("--stiffness", "5e-3/um", "--with", "gain,,viscous"), ("--with", "empty id")),
    ],
)
def test_what_the_verb_refuses(closed, options: tuple[str, ...], words: tuple[str, ...]) -> None:
    assert_refused(run("loop", "run.csv", *options), *words)
    assert not closed and not Path("run-loop").exists()


def test_an_output_that_cannot_be_written_is_known_before_the_work(closed) -> None:
    written(Path("taken"), "")
    code, out, err = run("loop", "run.csv", "--stiffness", "5e-3/um", "--out", "taken")
    assert code == 2 and out == "" and "taken is a file" in err.splitlines()[-1]
    assert not closed


def test_help_lists_the_catalogue() -> None:
    assert options.EFFECTS.split(", ") == list(CATALOGUE)
    shown = run("loop", "--help")
    assert shown.code == 0 and all(id in shown.out for id in CATALOGUE)
    assert all(len(line) <= 80 for line in shown.out.splitlines())


def test_a_velocity_without_rows_that_count_has_not_failed():
    """Only one that was to be predicted and has no finite error has."""
    loop = make_loop("effects")
    per_step = (np.nan, np.nan, *loop.before.per_step[2:])
    blocks = loop.blocks._replace(
        **{name: loop.blocks.of(name) & (loop.blocks.step != 0) for name in NAMES}
    )
    score = dataclasses.replace(loop.before, per_step=per_step)
    rows = by_velocity(dataclasses.replace(loop, before=score, after=score, blocks=blocks)).rows
    assert rows[0][2:] == ("no row counts", "–", "–")
    assert rows[1][3:] == ("failed", "failed")


def test_of_many_velocities_those_with_the_largest_errors_are_shown():
    """In the order of time; one that failed is shown, one that does not count is not."""
    loop = make_loop("effects")
    whole = by_velocity(loop)
    count, steps = len(whole.rows), loop.blocks.step
    assert by_velocity(loop, most=count) == whole
    last = np.array([3.0, 1.0, np.nan, 2.0, np.nan, *np.ones(len(loop.after.per_step) - 5)])
    blocks = loop.blocks._replace(**{n: loop.blocks.of(n) & (steps != 4) for n in NAMES})
    score = dataclasses.replace(loop.after, per_step=tuple(last))
    few = by_velocity(dataclasses.replace(loop, after=score, blocks=blocks), most=3)
    assert [row[0] for row in few.rows] == [whole.rows[k][0] for k in (0, 2, 3)]
    assert few.note.startswith(f"the 3 of {count} with the largest errors")


@pytest.mark.parametrize(
    ("delta_bic", "converged", "words"),
    [
        (None, True, "cannot tell it from slip_trend; what would: "),
        (1475.0, True, "cannot tell it from slip_trend; what would: "),
        (20.0, False, "cannot tell it from slip_trend; what would: "),
        (
            20.0,
            True,
            "tells it from every other effect; a refit tells it from slip_trend (BIC 1",
        ),
    ],
)
def test_a_refit_tells_effects_that_look_alike(delta_bic, converged, words):
    """To first order time_drift and slip_trend are the same; the model has 1480 of BIC."""
    loop = make_loop("ambiguous")
    more = CandidateScore(("slip_trend",), delta_bic or 0.0, 1, 1, {}, True, converged, False)
    tried = loop.candidates + ((more,) if delta_bic else ())
    lines = apart(dataclasses.replace(loop, candidates=tried))
    assert lines[0].startswith(f"time_drift: this record {words}")
    assert ("slip_trend or time_drift" in lines[-1]) == (not words.startswith("tells"))


@pytest.mark.parametrize(
    ("unit", "shown"), [("microns", "1 µm/s"), ("0.05 um", "1 µm/s"), ("mm", "0.001 mm/s")]
)
def test_velocities_bear_a_symbol_of_length(unit: str, shown: str) -> None:
    loop = make_loop("effects")
    units = {**loop.record.units, "load_point_displacement": unit}
    record = dataclasses.replace(loop.record, units=units)
    assert by_velocity(dataclasses.replace(loop, record=record)).rows[0][1] == shown


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
    record: Any = SimpleNamespace(force_unit="N", drive=drive, coordinate="linear")
    details = AxisDetails((), Preparation(50.0, 1), 1e-3, record, AxisGains(1.0, -2.0, 2.0, None))
    table = details._gains("m")
    assert len(table.head) == columns and {len(row) for row in table.rows} == {columns}
    told = details.to_json()["axis"]["drive"]  # for a feedforward of the file
    assert told == (drive and {"k_p": None, "k_v": 2.0})


@pytest.mark.parametrize(
    ("verdict", "friction"),
    [
        ("no_missing_effect", "Coulomb and viscous friction describe all that the rows show"),
        ("effects", "Coulomb and viscous friction, and "),
        ("ambiguous", "Coulomb and viscous friction do not describe it: an effect is missing, but"),
        ("too_weak", "Coulomb and viscous friction do not describe it: what is left is too little"),
    ],
)
def test_the_answer_on_an_axis_comes_first(verdict: str, friction: str) -> None:
    details: Any = SimpleNamespace(
        short=lambda: "stick-slip: nothing can be said", tables=list, doubted=lambda: False
    )
    plain = make_loop(verdict)
    loop = dataclasses.replace(plain, details=details, words=plain.words._replace(base=AXIS.base))
    text = " ".join(printed(loop).split())
    first, second, third = lines = answer(loop)
    assert text.startswith(" ".join([*lines, "How it was found", f"{verdict}: "]))
    assert first.startswith(f"friction: {friction}") and second == details.short()
    sigma = loop.sigma_of(loop.blocks.select | loop.blocks.report)
    before, after = (f"{loop.heldout(s) / sigma:.3g}" for s in (loop.before, loop.after))
    more = f" before, {after} times after" if loop.effects else ""
    assert third == (
        f"error in rows that no fit saw: {before} times the noise{more} (1: only noise is left)"
    )
    assert all(line in page_of(loop).text for line in (first, second, third))
    assert answer(plain) == []


@pytest.mark.parametrize("verdict", ["no_missing_effect", "effects", "too_weak"])
def test_a_model_that_is_no_friction_is_no_answer(verdict: str) -> None:
    """What it leaves may be as white as noise, and nearly all of the force."""
    details: Any = SimpleNamespace(short=lambda: "stick-slip: ?", tables=list, doubted=lambda: True)
    plain = make_loop(verdict)
    loop = dataclasses.replace(plain, details=details, words=plain.words._replace(base=AXIS.base))
    said = answer(loop)[0]
    assert ("these rows do not tell it, though what Coulomb" in said) == (verdict != "too_weak")
    assert ("do not describe it" in said) == (verdict == "too_weak")
    assert all(id in said for id in loop.effects)


@pytest.mark.parametrize(
    ("speeds", "doubted"), [((), False), ((0.1, 3.0), False), ((0.1, np.inf), True)]
)
def test_a_reason_against_all_speeds_is_a_doubt(speeds: tuple[float, ...], doubted: bool) -> None:
    record: Any = SimpleNamespace(force_unit="N", drive=None, coordinate="linear")
    curve = Curve(1.0, 0.1, 0.5, 2.0, unseen=tuple(Unseen("why", speed) for speed in speeds))
    for own, said in ((curve, doubted), (None, False)):
        gains = AxisGains(1.0, -2.0, 2.0, None, curve=own)
        assert AxisDetails((), Preparation(50.0, 1), 1e-3, record, gains).doubted() is said


def test_what_helps_is_named_where_it_is_not_all():
    found = make_loop("effects")
    loop = dataclasses.replace(found, verdict="outside_catalogue")
    names = " and ".join(loop.effects)
    assert loop.heldout(loop.after) < loop.heldout(loop.before)
    assert headline(loop) == (
        f"Beyond {names} something is missing that the catalogue does not explain"
    )
    open_ = [
        dataclasses.replace(c, refused="c not fixed", delta_bic=1e4, effects=("c",))
        for c in loop.candidates[:1]
    ]
    closer = dataclasses.replace(loop, candidates=(*loop.candidates, *open_))
    assert headline(closer) == f"Beyond {names} something is missing that this record does not fix"
    worse = dataclasses.replace(loop, before=loop.after, after=loop.before)
    assert headline(worse) == "Something is missing that the catalogue does not explain"


def test_a_curve_whose_shape_is_not_told_is_said_to_be_so():
    """In the headline, in what can be told apart, on the page and in the file for programs."""
    loop = make_loop("ambiguous")
    id = loop.effects[0]
    family = CurveFamily(
        (id,), 3, 5, (OtherShape("a cubic in ln V", -10.2), OtherShape("a line in ln V", 80.0)),
        (Decisive(1e-4, 110.0), Decisive(1e-7, 33.0)),
    )  # fmt: skip
    told = dataclasses.replace(loop, families=(family,))
    assert headline(told) == "Missing: a curve of velocity whose shape is not told"
    line = next(text for text in apart(told) if "steady curve" in text)
    assert line.startswith(f"{id}: ") and not any("steady curve" in text for text in apart(loop))
    for words in ("3 velocities, 5 parameters", "a cubic in ln V: BIC 10.2 lower", "100 µm/s"):
        assert words in line
    assert "a line in ln V" not in line and "tells it from every other" not in line
    assert escape(line) in page(told, {}, version="0", command="jaxfric loop")
    assert told.to_json()["families"][0]["fitting"] == ["a cubic in ln V"]
