"""`jaxfric run`: from a file to the table of its steps; what it refuses, what may be changed."""

import csv
import json
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from command import assert_refused, run

import jaxfric as jf
from fits.runs.generate import generate
from jaxfric.fitting.derived import difference
from jaxfric.fitting.stiffness import MachineStiffness
from jaxfric.report.report import text_of
from jaxfric.report.run import latex_text, page, report
from jaxfric.runs import Event, find_events
from jaxfric.runs.cycles import StickSlip
from jaxfric.runs.decisions import decisions_text, read_decisions
from jaxfric.runs.findings import Findings
from jaxfric.runs.fits import HowFitted, RunFit, StepFit, fit_run
from jaxfric.runs.ramps import Ramp
from jaxfric.runs.stick_slip import MIDDLE, Rises, find_rises
from jaxfric.runs.stress_steps import FittedStress
from jaxfric.runs.table import (
    csv_text,
    rows,
    text_cells,
    xlook_rows,
)

TABLES = ("events.toml", "run.json", "table.csv", "table.tex", "table_xlook.csv")


def written(made, path):
    """A generated run as a CSV in the units of a laboratory."""
    columns = (made.time, 1e6 * made.position, made.friction, made.sigma / 1e6)
    head = "time [s],load_point_displacement [um],friction [1],normal_stress [MPa]"
    np.savetxt(path, np.transpose(columns), "%.7g", ",", header=head, comments="")
    return path


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A run of a few events, its truth, what the command said, its folder, and how it is fitted."""
    folder = tmp_path_factory.mktemp("run")
    made = generate(21, law="slip", events=4, kinds={"step": 0.7, "hold": 0.3})
    file = written(made, folder / "mine.csv")
    K = f"{made.press.K * 1e-6:.6g}/um"
    how = ("--stiffness", K, "--downsample-to", "512")
    outcome = run("run", file, *how, "--out", folder / "out")
    return made, outcome, folder / "out", how


def test_every_step_of_the_run_is_in_the_table(done):
    made, outcome, out, _ = done
    assert outcome.code == 0, outcome.err
    assert all((out / name).is_file() for name in TABLES)
    assert (out / "events.png").is_file() and (out / "rates.png").is_file()
    table = list(csv.DictReader((out / "table.csv").open()))
    true = [h for h in made.happenings if h.kind == "step"]
    assert len(table) == len(true) >= 2
    for row, step in zip(table, true, strict=True):
        assert float(row["time [s]"]) == pytest.approx(step.time - made.time[0], abs=1.0)
        assert float(row["velocity after [um/s]"]) == pytest.approx(1e6 * step.after, rel=0.02)
        for name, value in (("A", made.press.A), ("A-B", made.press.A - made.press.B)):
            error = float(row[f"std {name}"])
            assert abs(float(row[name]) - value) < 4 * error
        assert (out / f"step_{int(row['step']):02d}.png").is_file()


def test_what_is_printed_is_what_is_written(done):
    _, outcome, out, _ = done
    table = list(csv.DictReader((out / "table.csv").open()))
    lines = [x for x in outcome.out.splitlines() if " -> " in x]
    assert len(lines) == len(table)
    assert "A-B against velocity: " in outcome.out and len(outcome.out.splitlines()) <= 20
    content = json.loads((out / "run.json").read_text())
    assert content["schema"] == "jaxfric.run/1"
    for step, row in zip(content["steps"], table, strict=True):
        value = step["fit"]["parameters"]["A"]["value"]
        assert value == pytest.approx(float(row["A"]), rel=1e-6)
        own = [float(row[f"{name}A-B with slip trend"]) for name in ("", "std ")]
        assert own == pytest.approx(step["fit"]["A_minus_B_with_trend"], rel=1e-3)


@pytest.fixture
def steps_alone(monkeypatch):
    """What a run does for its steps: no holds are fitted and no figures of fits are drawn."""
    monkeypatch.setattr("jaxfric.runs.holds.fit_holds", lambda *_, **__: ())
    monkeypatch.setattr(sys.modules["jaxfric.cli.run"], "_draw", lambda *_: None)


def test_events_can_be_changed_and_given_back(done, tmp_path, steps_alone):
    """Without the first step, and with the others as they were: the same fits of these."""
    _, _, out, how = done
    text = (out / "events.toml").read_text()
    first = text.index("\nfit = true") + 1
    file = tmp_path / "events.toml"
    file.write_text(text[:first] + "fit = false" + text[first + len("fit = true") :])
    again = run("run", out.parent / "mine.csv", *how, "--events", file, "--out", tmp_path / "o")
    assert again.code == 0, again.err
    before = list(csv.DictReader((out / "table.csv").open()))
    after = list(csv.DictReader((tmp_path / "o" / "table.csv").open()))
    assert len(after) == len(before) - 1
    for a, b in zip(after, before[1:], strict=True):
        assert float(a["A"]) == pytest.approx(float(b["A"]), rel=1e-3)


def test_events_that_contradict_the_record_are_told_once(done, tmp_path, steps_alone):
    _, _, out, how = done
    events = list(read_decisions(out / "events.toml", np.inf))
    where, step = next((k, event) for k, event in enumerate(events) if event.fitted)
    events[where] = replace(step, before=10 * step.before, after=10 * step.after)
    file = tmp_path / "events.toml"
    file.write_text(decisions_text(tuple(events), "mine"))
    call = ("run", out.parent / "mine.csv", *how, "--events", file)
    code, _, err = run(*call, "--out", tmp_path / "q")
    assert code == 0 and err.count("jaxfric: warning: step 1: from 0 s on the steps say") == 1


def test_a_run_of_ramps_alone_tells_their_stiffness(tmp_path, monkeypatch):
    """Unloaded and loaded again once: the spring is all that is seen, K = 5e-3/um."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(0, 200, 0.05)
    x = np.interp(t, [0, 80, 90, 200], np.cumsum([0, 400, -50, 550]) * 1e-6)
    f = np.full(len(t), 0.6)
    for i in range(1, len(t)):
        f[i] = min(f[i - 1] + 5e3 * (x[i] - x[i - 1]), 0.6)
    f += 3e-4 * np.random.default_rng(0).standard_normal(len(t))
    head = "time [s],load_point_displacement [um],friction [1]"
    rows = np.stack([t, 1e6 * x, f], axis=1)
    np.savetxt("ramps.csv", rows, delimiter=",", header=head, comments="", fmt="%.6g")
    code, out, err = run("run", "ramps.csv", "--stiffness", "5e-3/um", "--out", "o")
    assert code == 0, err
    assert "no velocity step is fitted" in out
    known = json.loads((tmp_path / "o" / "run.json").read_text())
    assert known["steps"] == [] and len(known["ramps"]) == 2
    assert known["stiffness_from_ramps"]["value"] == pytest.approx(5e3, rel=0.02)


def written_two_ramps(path):
    """A run of force over two steps, an unloading and a reload that starts at a lower speed."""
    rng = np.random.default_rng(5)
    t = np.arange(0, 700, 0.2)
    corners = [0, 150, 300, 450, 480, 500, 530, 700]
    way = np.cumsum([0, 1500, 450, 1500, -60, 0, 90, 510]) * 1e-6
    x, v = np.interp(t, corners, way), np.gradient(np.interp(t, corners, way), t)
    f, log = np.full(len(t), 0.6), np.log(1e5)
    for i in range(1, len(t)):  # sliding friction falls from one speed to the next, at once
        log = np.log(max(v[i], 1e-6) / 1e-5) if v[i] > 0 else log
        f[i] = min(f[i - 1] + 4e3 * (x[i] - x[i - 1]), 0.6 - 0.003 * log)
    columns = (t, 1e6 * x, f + 2e-4 * rng.standard_normal(len(t)))
    head = "time [s],load_point_displacement [um],friction [1]"
    np.savetxt(path, np.transpose(columns), "%.7g", ",", header=head, comments="")


def test_the_stiffness_that_is_taken_from_ramps_is_that_of_the_report(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written_two_ramps("two.csv")
    values = []
    for k, how in enumerate((("--stiffness", "ramps"), ("--stiffness", "4e-3/um"))):
        code, _, err = run("run", "two.csv", *how, "--out", f"o{k}")
        assert code == 1, err  # its two steps are noise: no fit converges
        known = json.loads((tmp_path / f"o{k}" / "run.json").read_text())
        values.append(known["stiffness_from_ramps"]["value"])
        if k == 0:
            fits = [step["fit"] for step in known["steps"] if step["fit"]]
            assert fits
            for fit in fits:
                assert fit["parameters"]["K"]["value"] == pytest.approx(values[0], rel=1e-9)
            events = tmp_path / "o0" / "events.toml"
    assert values[0] == values[1] == pytest.approx(4e3, rel=0.03)
    # with events of a file, too: here without the unloading and the reload
    text = events.read_text().replace('"unload"', '"hold"').replace('"reload"', '"hold"')
    Path("mine.toml").write_text(text)
    asked = ("--stiffness", "ramps", "--events", "mine.toml", "--out", "o3")
    code, out, err = run("run", "two.csv", *asked)
    assert code == 2 and not out and "never moves back" in err


def test_the_numbers_are_told_before_the_first_figure_is_drawn(tmp_path, monkeypatch):
    """A run of many steps draws for minutes: who stops it then has the result, and its files."""
    monkeypatch.chdir(tmp_path)
    written(generate(23, law="slip", events=1, kinds={"step": 1.0}), tmp_path / "mine.csv")

    seen = {}

    def stopped(*_):
        seen.update(out=sys.stdout.getvalue(), files={p.name for p in Path("o").iterdir()})
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxfric.plot.run.events_figure", stopped)
    with pytest.raises(SystemExit, match="130"):
        run("run", "mine.csv", "--fit-stiffness", "--downsample-to", "256", "--out", "o")
    assert "1 step" in seen["out"] and "A-B" in seen["out"]
    assert {"run.json", "table.csv", "events.toml"} <= seen["files"]


# ---- tables -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two_fits():
    """A run of one step that was fitted and one that was not."""
    made = generate(22, law="slip", events=2, kinds={"step": 1.0})
    record = jf.from_arrays(
        made.time, made.friction, load_point_displacement=made.position, normal_stress=made.sigma
    )
    found = find_events(record, stiffness=MachineStiffness(made.press.K)).events
    good = next(event for event in found if event.fitted)
    bad = replace(good, start=good.time - 1e-3, stop=good.time + 1e-3)
    return fit_run(record, [bad, good], HowFitted(MachineStiffness(made.press.K))), made.press


def test_a_step_that_cannot_be_fitted_keeps_its_row_and_its_reason(two_fits):
    result, _ = two_fits
    bad, good = rows(result)
    assert bad["step"] == 1 and "rows" in str(bad["result"]) and "A" not in bad
    assert good["result"] == "converged" and good["A"] is not None
    told = text_of("", report(result))
    assert "holds" in text_cells(result.steps[0])[4] and "no fit" in latex_text(result)
    assert "normal stress" in told and "holds" in told


def test_every_step_gets_its_fit_with_the_noise_of_all(two_fits, monkeypatch):
    """In order, past a step without a fit; `test_fit_many` tests the noise itself."""
    result, press = two_fits
    bad, good = (step.event for step in result.steps)
    fit = result.steps[1].fit
    monkeypatch.setattr(HowFitted, "fit", lambda *_: fit)
    counted = lambda fits: [replace(one, iterations=k) for k, one in enumerate(fits, 5)]  # noqa: E731
    monkeypatch.setattr("jaxfric.runs.fits.with_shared_noise", counted)
    how = HowFitted(MachineStiffness(press.K))
    few = replace(bad, start=bad.time, stop=bad.time)
    steps = fit_run(result.record, [good, few, good], how).steps
    assert [step.fit and step.fit.iterations for step in steps] == [5, None, 6]


def test_the_difference_has_the_error_of_its_covariance(two_fits):
    """var(A - B) = var A + var B - 2 cov(A, B)."""
    fit = two_fits[0].steps[1].fit
    i, j = fit.free.index("A"), fit.free.index("B")
    C = fit.covariance
    value, error = difference(fit)
    assert value == pytest.approx(fit.parameters["A"].value - fit.parameters["B"].value)
    assert error == pytest.approx(np.sqrt(C[i, i] + C[j, j] - 2 * C[i, j]))


def test_units_and_xlooks_names(two_fits):
    result, press = two_fits
    row, theirs = rows(result)[1], xlook_rows(result)[1]
    assert row["L [um]"] == pytest.approx(1e6 * press.L, rel=0.4)
    assert row["K [1/um]"] == pytest.approx(1e-6 * press.K)
    names = [
        "step",
        "mu_o",
        "a",
        "std a",
        "b1",
        "std b1",
        "Dc1",
        "std Dc1",
        "a-b",
        "std a-b",
        "lin_term",
        "wc",
    ]
    assert list(theirs) == names
    assert theirs["a"] == row["A"] and theirs["Dc1"] == row["L [um]"]
    assert theirs["lin_term"] == 0.0 and xlook_rows(result)[0] == {"step": 1}


def test_csv_holds_all_columns_and_quotes_texts():
    text = csv_text([{"a": 1, "why": 'x, "y"'}, {"a": None, "b": 2.5}])
    assert list(csv.DictReader(text.splitlines())) == [
        {"a": "1", "why": 'x, "y"', "b": ""},
        {"a": "", "why": "", "b": "2.5"},
    ]


def test_latex_balances(two_fits):
    text = latex_text(two_fits[0])
    assert text.count("$") % 2 == 0 and text.count("{") == text.count("}")
    assert text.count(r"\\") == 4  # two of the head, two steps


# ---- what is refused --------------------------------------------------------------------------


@pytest.fixture
def steady(tmp_path, monkeypatch):
    """A run that never changes its velocity."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(0, 200, 0.5)
    rng = np.random.default_rng(5)
    columns = (
        t,
        3 * t + 0.05 * rng.standard_normal(len(t)),
        0.6 + 2e-4 * rng.standard_normal(len(t)),
    )
    head = "time [s],load_point_displacement [um],friction [1]"
    np.savetxt("steady.csv", np.transpose(columns), "%.6f", ",", header=head, comments="")
    return tmp_path / "steady.csv"


def test_a_run_without_a_step(steady):
    """What was found is kept, to be changed by hand."""
    code, out, err = run("run", steady, "--stiffness", "1e-3/um")
    assert code == 2 and out == ""
    assert "no velocity step to fit" in err and "events.toml" in err and "Traceback" not in err
    assert (steady.parent / "steady-run" / "events.toml").is_file()
    assert "not drawn" not in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--stiffness", "3 s"], ["--stiffness", "'s' is not a unit"]),
        (["--stiffness", "1e-3/um", "--events", "none.toml"], ["none.toml", "no such file"]),
        (["--stiffness", "1e-3/um", "--law", "slippery"], ["slippery"]),
        (["--stiffness", "1e-3/um", "--downsample-to", "10"], ["--downsample-to is 10"]),
    ],
)
def test_options_that_are_refused_before_anything_is_written(steady, options, words):
    code, out, err = run("run", steady, *options)
    assert code == 2 and out == ""
    last = err.splitlines()[-1]
    assert last.startswith("jaxfric: error: ") and all(word in last for word in words), err
    assert not (steady.parent / "steady-run").exists()


def test_a_clock_that_goes_back_is_refused(steady):
    lines = steady.read_text().splitlines()
    lines[100] = lines[50]
    steady.write_text("\n".join(lines))
    outcome = run("run", steady, "--stiffness", "1e-3/um", "--json")
    assert_refused(outcome, "steady.csv", "time")


def test_names_of_results(two_fits):
    result, _ = two_fits
    assert isinstance(result, RunFit) and all(isinstance(s, StepFit) for s in result.steps)


# ---- the page ---------------------------------------------------------------------------------


class Page(HTMLParser):
    """Text by tag, pictures and attributes of a page; fails where tags are not closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.texts, self.pictures, self.links = [], {}, 0, []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.links += [value for name, value in attrs if name in ("href", "src")]
        self.pictures += tag == "img"
        if tag not in ("meta", "img", "!doctype"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.setdefault(self.open[-1] if self.open else "", []).append(data)


def shown(result, **more):
    others = more.pop("others", Findings())
    told = report(result, others)._replace(warnings=["K is <odd>"])
    return page(told, result, others, {"step_02.png": b"x"}, command="jaxfric run")


def test_the_page_tells_every_step_and_reaches_nowhere(two_fits):
    result = two_fits[0]
    text = shown(result)
    found = Page(text)
    assert found.texts["h1"] == ["1 of 2 velocity steps fitted"]
    cells = found.texts["td"]
    assert text_cells(result.steps[1])[4] in cells and text_cells(result.steps[0])[4] in cells
    assert found.texts["li"][-1] == "warning: K is <odd>" and "&lt;odd&gt;" in text
    assert found.pictures == 1 and all(link.startswith("data:image/png") for link in found.links)
    assert "Step 2, at" in "".join(found.texts["summary"])
    assert not {"Holds", "Steps of the normal stress"} & {
        *found.texts["h2"],
        *found.texts["summary"],
    }


def test_the_page_shows_what_else_was_found(two_fits):
    ramp = Ramp("unload", 5.0, 9.0, 1e7, True, 2e10, 1e8)
    stress = FittedStress(100.0, 1.0, 3e-6, 1e7, 1.15e7, why="a velocity step is superposed")
    found = Page(shown(two_fits[0], others=Findings((stress,), (ramp,))))
    told = " ".join(found.texts["div"])
    assert "0.02000(10) MPa/um" in told and "no alpha: a velocity step is superposed" in told
    assert "Steps of the normal stress" in found.texts["summary"]


def test_the_page_shows_stick_slip_and_a_run_without_steps(two_fits):
    few = Rises(2.0, 9.0, 1e-5, None, *[np.zeros((0, 1))] * 4, why="fewer than 4 teeth")
    others = Findings(stick_slip=StickSlip((few,), {}, None, {}))
    teeth = Event("stick_slip", 2.0, 1e-5, 1e-5, 2.0, 9.0)
    beside = Event("stick_slip", 9.0, 1e-5, 1e-6, 9.0, 12.0)
    found = Page(shown(replace(two_fits[0], steps=(), events=(teeth, beside)), others=others))
    assert found.texts["h1"][0].startswith("no velocity step is fitted")
    assert found.texts["caption"] == ["Events", "Stretches of stick-slip"]
    words = "stick-slip at 10 um/s from 2 s: not used, fewer than 4 teeth"
    assert words in "\n".join(found.texts["div"])


def never_slips(p, feet, *_):
    """A slider that no A, B and L lets slip, as `rise_model.rises` tells it."""
    n, parts = len(feet), len(MIDDLE) + 1
    return np.ones((n, parts)), np.zeros(n, bool), np.ones((n, parts, len(p))), np.ones((n, parts))


def at_one_velocity(path, t, friction):
    """A file of friction at 10 um/s."""
    columns = np.column_stack([t, 10 * t, friction])
    header = "time [s],displacement [um],friction [1]"
    np.savetxt(path, columns, "%.6f", ",", header=header, comments="")


def test_a_run_of_stick_slip_alone_has_its_tables(tmp_path, monkeypatch):
    monkeypatch.setattr("jaxfric.runs.rise_fit.rises", never_slips)
    t = np.arange(0.05, 120.0, 0.1)
    friction = 0.6 + 0.03 * (t / 10 % 1 - 0.5) + 1e-4 * np.sin(7 * t)
    record = tmp_path / "saw.csv"
    at_one_velocity(record, t, friction)
    done = run("run", record, "--out", tmp_path / "out")  # which asks for no stiffness
    assert done.code == 1, done.err  # no law's fit converged; drop and period are measured
    assert done.err.splitlines()[-1].startswith("jaxfric: error: no fit of this run converged")
    assert "no velocity step is fitted" in done.out and "teeth, drop 0.029" in done.out
    assert "nothing is claimed, the fit did not converge" in done.out
    made = {file.name for file in (tmp_path / "out").iterdir()}
    assert {"stick_slip.csv", "stick_slip_laws.csv", "stick_slip.png", "run.html"} <= made
    assert not {"table.csv", "table.tex", "rates.png"} & made
    # and from the events that it wrote the same teeth are read
    back = read_decisions(tmp_path / "out" / "events.toml", float(t[-1] - t[0]))
    (teeth,) = find_rises(jf.read(record), back)
    assert f"{teeth.count} teeth, drop 0.029" in done.out


def test_a_record_of_teeth_is_sent_to_run(tmp_path):
    t = np.arange(0.05, 120.0, 0.1)
    record = tmp_path / "saw.csv"
    at_one_velocity(record, t, 0.6 + 0.03 * (t / 10 % 1 - 0.5))
    words = "it stick-slips from 0 s to 110 s; analyse its stress drops with 'jaxfric run'"
    assert_refused(run("fit", record, "--fit-stiffness", "--quiet"), "no velocity step", words)
    shown = run("inspect", record, "--out", tmp_path / "seen")
    assert shown.code == 0 and words in shown.err
    at_one_velocity(record, t, np.full(len(t), 0.6))  # nothing of the kind where it is steady
    assert_refused(run("fit", record, "--fit-stiffness", "--quiet"), "Give the steps")


def test_a_run_of_steps_asks_for_its_stiffness(tmp_path):
    out = tmp_path / "out"
    steps = Path(__file__).parents[1] / "data" / "velocity_steps.csv"
    outcome = run("run", steps, "--out", out, "--quiet")
    assert_refused(outcome, "--stiffness is missing", "--fit-stiffness")
    assert not out.exists() or not any(out.iterdir())
