"""The tables of a run's steps, of fits that were never run: what is marked, and what is blank."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from test_derived import VALUES, covariance_of, fit_of

from jaxfric.cli.call import Call
from jaxfric.cli.plan_line import run_line
from jaxfric.findings import WarningCode, warned
from jaxfric.fitting.misfit import misfit_warning, scatter
from jaxfric.fitting.noise import Glitches
from jaxfric.report.report import Report, print_brief, text_of
from jaxfric.report.run import latex_text, page, report
from jaxfric.report.tables import TextTable
from jaxfric.runs import Event
from jaxfric.runs.findings import Findings
from jaxfric.runs.fits import RunFit, StepFit
from jaxfric.runs.table import (
    HEAD,
    MISFIT,
    ask_on,
    claimed,
    csv_text,
    headline,
    rows,
    text_cells,
    xlook_rows,
)
from jaxfric.runs.warned import missed_warning, warnings_of


def blur_warning(rows, times):
    return warned(WarningCode.FLATTENED, rows=rows, times=times)


def left(times=1.0, *, off=0.0, at=24.0, glitches=(), **model):
    """A fit that leaves so many times the scatter of its record, and of five rows around a time
    [s] misses so many times its noise; the step is at 20 s."""
    fit = fit_of(VALUES, covariance_of(VALUES, 0.02))
    about = np.argsort(np.abs(fit.record.relative_time - at))[:5]
    predicted = fit.predicted.copy()
    predicted[about] -= off * fit.noise.sigma
    fit = replace(
        fit,
        rms=times * scatter(fit),
        predicted=predicted,
        noise=replace(fit.noise, glitches=Glitches(tuple(glitches))),
        model=fit.model._replace(**model),
    )
    return replace(fit, warnings=("a drift", *misfit_warning(fit)))


def run_of(*fits):
    """A run whose steps have these fits, or none."""
    event = Event("step", 20.0, 1e-6, 1e-5, 0.0, 50.0)
    steps = [StepFit(k, event, 0.0, fit, "" if fit else "few") for k, fit in enumerate(fits, 1)]
    record = next(fit for fit in fits if fit is not None).record
    return RunFit(record, (event,) * len(steps), tuple(steps))


@pytest.mark.parametrize(
    ("off", "words"),
    [
        ((4.4, -4.4), "2 of 2 velocity steps fitted"),
        ((4.4, -4.6), "2 of 2 velocity steps fitted; 1 fit does not describe the step (*)"),
        ((5.5, 34.0, None), "2 of 3 velocity steps fitted; 2 fits do not describe the step (*)"),
    ],
)
def test_the_headline_counts_the_stars_of_the_table(off, words):
    run = run_of(*(None if x is None else left(off=x) for x in off))
    ask = "jaxfric run a --slip-trend"
    html = page(report(run, ask=ask), run, Findings(), {}, command="jaxfric run a")
    assert headline(run) == words and f"<h1>{words}</h1>" in html and words in repr(run)
    assert (ask in html) == ("*" in words)


@pytest.mark.parametrize("times", [1.0, 7.2])
def test_the_headline_says_nothing_of_noise(times):
    """A fit that leaves many times the scatter, of noise that is correlated, has no star: no word
    may say that it describes the record down to the noise, beside a warning that it does not."""
    run = run_of(left(times), left(times, off=5.5))
    words = headline(run)
    starred = sum(text_cells(step)[-1].endswith("*") for step in run.steps)
    assert words == "2 of 2 velocity steps fitted; 1 fit does not describe the step (*)"
    assert starred == 1 and "noise" not in words
    assert "about 1 for white noise" in MISFIT and "correlated noise" in MISFIT


@pytest.mark.parametrize(
    ("converged", "loose", "known"),
    [
        (True, (), {"A", "B", "L", "A_minus_B", "critical_stiffness", "rms", "covariance"}),
        (True, ("L",), {"A", "B", "A_minus_B", "rms", "covariance"}),
        (False, (), set()),
    ],
)
def test_in_json_a_number_stands_only_for_what_is_known(converged, loose, known):
    """A fit of a hold kept L = 3e190 m, which its record does not determine."""
    fit = replace(left(), converged=converged)
    changed = {n: replace(fit.parameters[n], value=3e190, determined=False) for n in loose}
    fit = replace(fit, parameters={**fit.parameters, **changed})
    content = claimed(fit)
    numbers = {n: content["parameters"][n]["value"] for n in "ABL"}
    numbers |= {"A_minus_B": content["A_minus_B"]["value"]}
    numbers |= {n: content[n] for n in ("critical_stiffness", "rms", "covariance")}
    assert {name for name, value in numbers.items() if value is not None} == known
    assert "3e+190" not in json.dumps(content)
    assert content["parameters"]["K"]["value"] is not None  # it was given


def test_a_step_that_is_missed_is_marked_in_every_table():
    run = run_of(left(1.23), left(5.5, off=-11.0), None)
    assert HEAD[-1] == "misfit"
    assert [text_cells(step)[-1] for step in run.steps] == ["1.2 ", "5.5*", ""]
    assert text_cells(run.steps[2])[4] == "few"
    table = list(csv.DictReader(csv_text(rows(run)).splitlines()))
    assert [row["misfit"] for row in table] == ["1.23", "5.5", ""]
    assert ["misses its record" in row["warnings"] for row in table] == [False, True, False]
    assert ["5.5 times the scatter" in row["warnings"] for row in table] == [False, True, False]
    lines = latex_text(run).splitlines()
    assert [r"$^{\dagger}$ &" in line for line in lines[5:8]] == [False, True, False]
    assert "4.5 times the noise" in lines[-3]
    assert "dagger" not in latex_text(run_of(left(1.23)))


@pytest.mark.parametrize(
    ("off", "at", "words"),
    [
        (
            11.0,
            24.0,
            "by 0.0011, 11 times the noise, 3.7 s after the",
        ),
        (-6.0, 10.0, "by 0.0006, 6 times the noise, 9.8 s before the"),
    ],
)
def test_what_is_missed_is_told_with_where_it_is(off, at, words):
    (text,) = missed_warning(left(off=off, at=at))
    assert words in text and "slip_trend=True" in text
    assert "slip_trend" not in missed_warning(left(off=off, at=at, slip_trend=True))[0]
    passed = range(30) if at < 20 else range(25, 60)
    assert missed_warning(left(off=off, at=at, glitches=passed)) == ()
    assert missed_warning(replace(left(off=off, at=at), converged=False)) == ()


def test_columns_stand_apart_with_two_states():
    """Two Bs and two Ls, in a cell each, are wider than a column of one."""
    values = VALUES | {"B2": 0.00108, "L2": 5e-5}
    fit = fit_of(values, covariance_of(values, 0.05), states=2)
    run = run_of(fit, None)
    told = text_of("", report(run))
    assert all(cell.strip() in told for cell in text_cells(run.steps[0])[4:])
    assert [len(text_cells(step)) for step in run.steps] == [len(HEAD)] * 2


def test_steps_that_are_missed_are_told_once_and_what_asks_on():
    """Each with by how much, in the order of the steps; a fit with a trend is asked otherwise."""
    run = run_of(left(off=11.0), left(), left(off=-6.0))
    (line,) = [text for text in warnings_of(run) if "miss" in text.partition(":")[2]]
    assert line.startswith(
        "step 1, 3 (values of step 1): the fit misses its record by 0.0011, 11 times the noise"
    )
    assert line.endswith("mistake a drift for evolution (slip_trend=True)")
    assert ask_on(run).startswith("fit again with a slip trend or a second state (states=2)")
    assert "(states=2): step 1, 3 (*) may mistake either for evolution" in ask_on(run)
    trend = left(off=11.0, slip_trend=True)
    assert ask_on(run_of(left(), trend)) == "find out which effect the model of step 2 (*) lacks"
    assert ask_on(run_of(left(), None)) == ""


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"stiffness": "1.6e-3/um", "out": Path("o"), "json": True},
         'jaxfric run "a b.csv" --stiffness 1.6e-3/um --slip-trend'),
        ({"fit_stiffness": True, "column": ["time=t", "slip=d (um)"]},
         'jaxfric run "a b.csv" --fit-stiffness --column time=t --column "slip=d (um)"'
         " --slip-trend"),
        ({"stiffness": "0.16 MPa/um", "states": "2", "downsample_to": 99, "slip_trend": True},
         'jaxfric loop "a b.csv" --run --stiffness "0.16 MPa/um"'),
        ({"stiffness": "1/um", "events": Path("e.toml"), "slip_trend": True},
         'jaxfric loop "a b.csv" --stiffness 1/um --events e.toml'),
        ({"stiffness": "ramps", "slip_trend": True}, ""),
        ({"fit_stiffness": True, "slip_trend": True}, ""),
    ],
)  # fmt: skip
def test_the_command_that_asks_on_can_be_pasted(given, line):
    assert run_line(Call("run", "", {"file": Path("a b.csv")} | given)) == line
    assert run_line(Call("", "", {})) == ""


def test_a_warning_of_several_steps_is_told_once():
    """Each by its code, with all of its steps; a step without a fit says why."""
    run = run_of(left(1.0), left(2.24), left(10.0, off=7.0), None)
    drift, misfit, missed, failed = warnings_of(run)
    assert missed.startswith("step 3: the fit misses its record") and failed == "step 4: few"
    assert drift == "step 1, 2, 3: a drift"
    assert misfit.startswith("step 2, 3 (values of step 2): the fit leaves 2.2 times the scatter")
    assert misfit.endswith("jaxfric loop asks which")
    assert "slip_trend=True" in misfit and "fit_stiffness=True" in misfit
    assert "slip_trend" not in misfit_warning(left(3.0, slip_trend=True))[0]
    assert misfit_warning(left(1.0)) == ()


def test_what_means_cost_is_told_once_of_all_steps():
    fits = [replace(left(1.0), warnings=w) for w in ((blur_warning(2, 0.6),), (), ("other",))]
    fits[1] = replace(fits[1], warnings=("other", blur_warning(3, 1.1)))
    blurred, other = warnings_of(run_of(*fits))
    assert (
        blurred.startswith("step 1, 2 (values of step 1): means over 2 rows")
        and "by 0.6 times" in blurred
    )
    assert other == "step 2, 3: other"


@pytest.mark.parametrize("unknown", [(), ("A",), ("B", "L"), ("L",), ("f0",)])
def test_what_is_not_determined_is_blank_in_both_tables(unknown):
    """In xlook's too, in columns that do not depend on which steps determine what."""
    known = fit_of(VALUES, covariance_of(VALUES, 0.02), undetermined=unknown)
    ours, theirs = (
        list(csv.DictReader(csv_text(table(run_of(known, left()))).splitlines()))
        for table in (rows, xlook_rows)
    )
    names = "step,mu_o,a,std a,b1,std b1,Dc1,std Dc1,a-b,std a-b,lin_term,wc"
    assert ",".join(theirs[0]) == names
    pairs = {"f0": "mu_o", "A": "a", "B": "b1", "L [um]": "Dc1", "A-B": "a-b"}
    for name, other in pairs.items():
        blank = name.split()[0] in unknown  # A-B may be known where A and B are not
        assert (ours[0][name] == "") == (theirs[0][other] == "") == blank, name
        assert (theirs[0].get(f"std {other}", "f0") == "") == (blank and name != "f0")
        assert theirs[1][other] == ours[1][name] != ""


@pytest.mark.parametrize("count", [1, 10])
def test_the_first_notes_stand_below_a_table_that_is_cut_for_them(count):
    table = TextTable("Steps", ("step", "A"), [(str(k), "0.008") for k in range(40)])
    notes = [f"trend {k}" for k in range(count)]
    out = io.StringIO()
    told = Report(["one", "two", "three"], [table], (), [*notes, "a detail"], first_notes=count)
    print_brief(told, Console(file=out, width=80), room=18)
    lines = out.getvalue().splitlines()
    assert len(lines) <= 18 and lines[-1] == notes[min(count, 7) - 1]
    assert "a detail" not in lines and any("0.008" in line for line in lines)
