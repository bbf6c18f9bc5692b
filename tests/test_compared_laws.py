"""Which law a record supports: records of SciPy whose law is known, and the sentences."""

import csv
import dataclasses
import io
import json
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from command import STIFFNESS, assert_refused, record_text, run, written
from reference import Law, Motion, solve

import jaxfric
from jaxfric.cli.call import Call
from jaxfric.cli.plan_line import loop_line
from jaxfric.errors import InputError
from jaxfric.findings import Warned, WarningCode
from jaxfric.fitting.misfit import misfit_warning
from jaxfric.fitting.noise import Exponential, Family
from jaxfric.loop import LawComparison, LawScore
from jaxfric.loop.compare import held_out_blocks, likeliest
from jaxfric.plot.compared import comparison_figure
from jaxfric.records import VelocitySteps
from jaxfric.report.comparison import ended, tabled
from jaxfric.report.fits_table import (
    TabledFit,
    csv_rows,
    latex_text,
    report_of_files,
    text_table,
)

pytestmark = pytest.mark.computes

jax.config.update("jax_enable_x64", True)

UM = 1e-6
STIFF = 5e3
FOUR = Motion((0.0, 20.0, 30.0, 50.0, 62.0), tuple(v * UM for v in (1, 10, 1, 10, 1)))
SMALL = Motion((0.0, 20.0, 40.0, 60.0, 80.0), tuple(v * UM for v in (1.0, 1.1, 1.0, 1.1, 1.0)))


def record_of(kind: str, motion: Motion, noise: float, *, B=(0.014,), L=(10 * UM,), seed=3):
    """A record by SciPy of 255 rows, and the steps that were commanded."""
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, motion.starts[-1] + 30.0, 255)
    law = Law(kind, 0.6, 0.010, B, L)
    friction = solve(law, motion, STIFF, time).f + random.normal(0.0, noise, len(time))
    load = motion.displacement(time)
    steps = VelocitySteps(np.array(motion.starts), np.array(motion.velocities))
    return jaxfric.from_arrays(time=time, load_point_displacement=load, friction=friction), steps


def compared(*given, **more) -> LawComparison:
    record, steps = record_of(*given, **more)
    return jaxfric.compare_laws(record, stiffness=STIFF, steps=steps)


@pytest.fixture(scope="module")
def of_slip() -> LawComparison:
    return compared("slip", FOUR, 2e-4)


def test_what_is_held_out_is_not_fitted(of_slip) -> None:
    """A wrong law leaves more where it was not fitted than a fit of everything leaves there."""
    steps = np.searchsorted(of_slip.steps.times, of_slip.record.relative_time, side="right") - 1
    held = np.isin(steps, of_slip.held_out_steps)
    ageing = next(s for s in of_slip.scores if s.name == "ageing")
    print(held.sum(), ageing.held_out, np.sqrt(np.mean(ageing.fit.residual[held] ** 2)))
    assert ageing.held_out > 1.2 * np.sqrt(np.mean(ageing.fit.residual[held] ** 2))


@pytest.mark.parametrize("kind", ["slip", "ageing"])
def test_the_law_of_the_record_is_named(kind, of_slip) -> None:
    found = of_slip if kind == "slip" else compared("ageing", FOUR, 2e-4)
    assert found.supported is not None
    assert (found.supported.fit.law, found.supported.states) == (kind, 1)
    assert (
        f"supports the {kind} law with 1 state:" in found.sentence
        and "second state" in found.sentence
    )
    # the noise is known: what the true law leaves where it was not fitted is no more than it
    assert found.held_out_steps and found.supported.held_out is not None
    assert 0.8 < found.supported.held_out / 2e-4 < 1.25
    assert 0.8 < found.sigma / 2e-4 < 1.2
    other = next(s for s in found.of_laws if s.fit.law != kind)
    assert other.held_out is not None and other.held_out > 1.5 * found.supported.held_out


def test_a_second_state_is_named() -> None:
    found = compared("slip", FOUR, 2e-4, B=(0.010, 0.008), L=(3 * UM, 40 * UM))
    assert found.supported is not None
    assert (found.supported.fit.law, found.supported.states) == ("slip", 2)
    assert "asks for the second state" in found.sentence


@pytest.fixture(scope="module")
def tied() -> LawComparison:
    """Small steps in much noise: to first order in the step the laws are the same."""
    return compared("slip", SMALL, 1e-3)


def test_a_tie_is_said_to_be_one(tied) -> None:
    assert tied.supported is None and len(tied.rivals) == 1
    assert "cannot tell: " in tied.sentence and "slip" in tied.sentence
    assert "10 decide" in tied.sentence


def test_bic_of_the_true_law_is_that_of_its_noise(of_slip) -> None:
    """White noise was added: BIC of a one-state law by the plain formula of least squares."""
    slip = next(s for s in of_slip.scores if s.name == "slip")
    ageing = next(s for s in of_slip.scores if s.name == "ageing")
    n = len(of_slip.record)

    def plain(score):
        return n * np.log(np.mean(score.fit.residual**2)) + score.parameters * np.log(n)

    assert slip.bic is not None and ageing.bic is not None
    if of_slip.independent_rows > 0.95 * n:  # the noise was found to be white, as it is
        np.testing.assert_allclose(ageing.bic - slip.bic, plain(ageing) - plain(slip), rtol=0.02)
    assert of_slip.independent_rows > 0.95 * n


def test_the_figure_says_which_law_and_what_did_not_converge(of_slip) -> None:
    first, ageing, *others = of_slip.scores
    stuck = dataclasses.replace(ageing, fit=dataclasses.replace(ageing.fit, converged=False))
    scores = (first, stuck, *others)
    figure = comparison_figure(dataclasses.replace(of_slip, scores=scores))
    assert figure.get_suptitle().endswith("The record supports the slip law with 1 state")
    assert "σ = 0.000" in figure.axes[1].get_title(loc="left")
    words = [text.get_text() for axis in figure.axes[1:] for text in axis.texts]
    ended = ["did not converge" not in text for text in words]
    assert ended == [score.fit.converged for score in scores] and ended[:2] == [True, False]
    assert figure.axes[1].get_ylabel() == "record − fit\n[σ]"


def test_the_figure_of_a_tie_names_no_law(tied) -> None:
    assert "The record cannot tell " in comparison_figure(tied).get_suptitle()


# ---- the command ---------------------------------------------------------------------------


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written(Path("run.csv"), record_text())


@pytest.mark.usefixtures("here")
def test_the_command(of_slip) -> None:
    record, steps = of_slip.record, of_slip.steps
    columns = (record.relative_time, record.moved() / UM, record.friction)
    rows = [f"{t:.9g},{x:.9g},{f:.9g}" for t, x, f in zip(*columns, strict=True)]
    head = "time [s],load_point_displacement [um],friction [1]"
    written(Path("four.csv"), "\n".join([head, *rows]) + "\n")
    pairs = zip(steps.times, steps.velocities, strict=True)
    told = ", ".join(f"{t:g} s: {V / UM:g} um/s" for t, V in pairs)
    given = ("--stiffness", "5e-3/um", "--steps", told)
    code, out, err = run("fit", "--compare", "four.csv", *given, "--out", "o", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found["schema"] == "jaxfric.comparison/1"
    models = [(law, n) for n in (1, 2) for law in ("slip", "ageing")]
    assert [(x["law"], x["states"]) for x in found["laws"]] == models
    assert found["supported"] == {"law": "slip", "states": 1} and found["rivals"] == []
    for one, same in zip(found["laws"], of_slip.scores, strict=True):
        assert one["held_out_rms"] == pytest.approx(same.held_out, rel=1e-2)
    folder = Path("o")
    assert json.loads((folder / "compare.json").read_text()) == found
    table = list(csv.DictReader(io.StringIO((folder / "compare.csv").read_text())))
    named = ["slip", "ageing", "slip, 2 states", "ageing, 2 states"]
    assert [row["model"] for row in table] == named
    assert min(float(row["BIC above least"]) for row in table if row["BIC above least"]) == 0
    assert {p.name for p in folder.glob("compare.*")} == {
        f"compare.{kind}" for kind in ("csv", "json", "png", "svg", "tex")
    }
    rows = [row.more for row in tabled(of_slip)]
    assert all(set(row) == {"BIC above least", "held-out error [σ]"} for row in rows)


@pytest.mark.usefixtures("here")
def test_what_cannot_be_compared_is_refused() -> None:
    assert_refused(
        run("fit", "--compare", "run.csv", *STIFFNESS, "--law", "slyp"), "law 'slyp'", "ageing"
    )
    one = run("fit", "--compare", "run.csv", *STIFFNESS, "--law", "slip")
    assert_refused(one, "only the slip law to compare", "two or more")
    assert_refused(run("fit", "--compare", "run.csv"), "--stiffness")
    assert_refused(
        run("fit", "--compare", "run.csv", *STIFFNESS, "--to", "15 s"), "no velocity step"
    )
    many = run("fit", "--compare", "run.csv", "run.csv", *STIFFNESS, "--states", "2")
    assert_refused(many, "a further file and --states would not be used with --compare")
    assert not Path("run-compare").exists()


# ---- sentences, of scores that are made up --------------------------------------------------


def made_up(*laws, held: bool = True, rms: float = 1.0, loose: int = 0,
            length: float = 1e-5) -> LawComparison:  # fmt: skip
    """A comparison of (law, states, BIC or None, held-out error, its deviance); fits with `loose`
    states did not converge, and second states have a `length` [m]; the record has 1 mm."""
    random = np.random.default_rng(0)
    way = np.linspace(0.0, 1e-3, 500)
    record = SimpleNamespace(friction=random.normal(size=500), moved=lambda: way)
    scores = []
    for law, states, bic, error, deviance in laws:
        model = SimpleNamespace(states=states, slip_trend=False)
        one = SimpleNamespace(
            law=law, model=model, record=record, rms=rms, result="no end", converged=states != loose
        )
        second = SimpleNamespace(value=length, determined=one.converged)
        one.parameters = {"A": SimpleNamespace(value=0.01, determined=True)}
        one.parameters |= {"L2": second} if states > 1 else {}
        scores.append(LawScore(one, 4, bic, error, deviance))  # type: ignore[arg-type]
    numbers = (3,) if held else ()
    return LawComparison(record, None, tuple(scores), 1.0, 500.0, numbers, "")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("laws", "supported", "words"),
    [
        ([("slip", 1, 0, 1, 50), ("ageing", 1, 11, 2, 90)], "slip",
         "is 11 below that of the ageing law with 1 state (a"),
        ([("slip", 1, 0, 1, 50), ("ageing", 1, 9, 2, 90)], None,
         "prefers the slip law with 1 state to the ageing law with 1 state by 9.0 (10"),
        ([("slip", 1, 0, 2, 90), ("ageing", 1, 11, 1, 50)], None, "predicts better"),
        ([("slip", 1, 0, 2, 90), ("ageing", 1, 11, 1, 81)], "slip", "is 11 below"),
        ([("slip", 1, 30, 1, 50), ("ageing", 1, 0, 1, 50)], "ageing", "30 below that of the slip"),
        (
            [("slip", 1, 12, 1, 50), ("slip", 2, 0, 1, 50), ("ageing", 1, 99, 1, 50)],
            "slip, 2 states",
            "asks for the second state, which lowers BIC by 12",
        ),
        (
            [("slip", 1, 8, 1, 50), ("slip", 2, 0, 1, 50), ("ageing", 1, 99, 1, 50)],
            "slip",
            "not needed: BIC is 8.0 lower with it",
        ),
        (
            [("slip", 1, 0, 1, 50), ("slip", 2, 14, 1, 50), ("ageing", 1, 99, 1, 50)],
            "slip",
            "not needed: BIC is 14 higher with it",
        ),
        (
            [("slip", 1, 0, 1, 50), ("ageing", 1, 99, 1, 50), ("ageing", 2, 4, 1, 50)],
            None,
            "prefers the slip law with 1 state to the ageing law with 2 states by 4.0",
        ),
        (
            [("slip", 1, 0, 1, 50), ("slip", 2, None, None, None), ("ageing", 1, 99, 1, 50)],
            "slip",
            "Nothing is said of a second state",
        ),
        ([("slip", 1, 0, 1, 50), ("ageing", 1, None, None, None)], None, "Nothing to compare"),
        ([("slip", 1, 0, None, None), ("ageing", 1, 40, None, None)], "slip", "decides). "),
        (
            [("slip", 1, 0, 1, 50), ("ageing", 1, 99, 1, 50), ("ageing", 2, 44, 1, 50)],
            "slip",
            "44 below that of the ageing law with 2 states (a",
        ),
    ],
)  # fmt: skip
def test_sentences(laws, supported, words) -> None:
    found = made_up(*laws)
    assert words in found.sentence + " "
    assert (None if found.supported is None else found.supported.name) == supported


def test_a_second_state_that_did_not_converge_is_not_fixed() -> None:
    laws = [("slip", 1, 0, 1, 50), ("slip", 2, 8.7, 1, 50), ("ageing", 1, 99, 1, 50)]
    words = "A second state is not fixed by the record, and not needed."
    found = made_up(*laws, loose=2)
    assert words in found.sentence and words not in made_up(*laws).sentence
    assert "8.7" not in found.sentence and "BIC is 8.7 higher" in made_up(*laws).sentence


@pytest.mark.parametrize(
    ("bics", "length", "supported", "words", "told"),
    [
        # the other law may explain as much with a second state, whose fit did not converge
        ((33, 3, 51, 0), 0.7, None, "The fit of the slip law with 2 states did not converge: a"
         " drift; it may be as good", "did not converge: a drift"),
        # it stood lower than all: no number of it is used
        ((33, -20, 51, 0), 1e-5, None, "it may be as good", "did not converge"),
        # far above the best it is no rival, and is named
        ((99, 60, 51, 0), 1e-5, "ageing, 2 states", "99 below that of the slip law with 1 state",
         "did not converge"),
        # no gain over one state: it is not there, and needs no comparison
        ((0, 8.7, 99, 40), 1e-5, "slip", "A second state is not fixed by the record, and not"
         " needed.", "not determined, not needed"),
    ],
)  # fmt: skip
def test_a_fit_that_did_not_converge_claims_nothing(bics, length, supported, words, told) -> None:
    """Of slip and ageing with one state and two; that of slip with two did not converge."""
    names = [("slip", 1), ("slip", 2), ("ageing", 1), ("ageing", 2)]
    laws = [(*name, bic, None, None) for name, bic in zip(names, bics, strict=True)]
    found = made_up(*laws, length=length)
    stuck = found.scores[1]
    stuck.fit.converged = stuck.fit.parameters["L2"].determined = False
    assert words in found.sentence
    assert (None if found.supported is None else found.supported.name) == supported
    assert ended(found, stuck).startswith(told) and ended(found, found.scores[3]) == ""
    assert f"{bics[1]:g}" not in found.sentence.split()
    assert stuck not in found.ranked and tabled_bic(found)[1] is None


def tabled_bic(found: LawComparison) -> list[object]:
    return [row.more["BIC above least"] for row in tabled(found)]


def test_where_no_fit_converged_nothing_is_said() -> None:
    found = made_up(("slip", 1, 0, 1, 50), ("ageing", 1, 99, 1, 50), loose=1)
    assert found.sentence == "Nothing to compare: no fit of a law converged."
    assert found.supported is None and found.next_step == "" and tabled_bic(found) == [None, None]


@pytest.mark.parametrize(
    ("laws", "command"),
    [
        ([("slip", 1, 12, 1, 50), ("slip", 2, 0, 1, 50)], "jaxfric loop on this record may"),
        ([("ageing", 1, 12, 1, 50), ("ageing", 2, 0, 1, 50), ("slip", 1, 90, 1, 50)],
         "jaxfric loop --law ageing on this record may"),
        ([("slip", 1, 8, 1, 50), ("slip", 2, 0, 1, 50)], ""),
        ([("slip", 1, 0, 1, 50), ("ageing", 1, 99, 1, 50), ("ageing", 2, 44, 1, 50)], ""),
        ([("mine", 2, 0, 1, 50), ("slip", 1, 99, 1, 50)], ""),
    ],
)  # fmt: skip
def test_a_second_state_is_asked_of_the_loop_too(laws, command) -> None:
    """It may answer otherwise, and the output says so where a second state is asked for."""
    told = made_up(*laws).next_step
    assert told.startswith(command) and bool(told) == bool(command)
    assert ("longer steps, up and down, decide" in told) == bool(command)


def test_where_the_likeliest_law_leaves_more_than_noise_the_loop_is_asked() -> None:
    laws = [("slip", 1, 0, 1, 50), ("ageing", 1, 99, 1, 50)]
    assert made_up(*laws).next_step == ""
    told = made_up(*laws, rms=3.0).next_step
    assert told.startswith("jaxfric loop asks what these laws lack: the likeliest leaves 3 times")
    second = made_up(("slip", 1, 12, 1, 50), ("slip", 2, 0, 1, 50), rms=3.0).next_step
    assert "may say otherwise of the second state" in second


@pytest.mark.parametrize(
    ("given", "law", "line"),
    [
        ({"stiffness": "1/um", "law": ["slip"]}, "slip", "jaxfric loop x.csv --stiffness 1/um"),
        ({"stiffness": "1/um", "slip_trend": True, "downsample_to": 9}, "ageing",
         "jaxfric loop x.csv --stiffness 1/um --downsample-to 9 --law ageing --include slip_trend"),
        ({"fit_stiffness": True}, "slip", ""),
    ],
)  # fmt: skip
def test_the_loop_of_a_comparison_can_be_pasted(given, law, line) -> None:
    assert loop_line(Call("compare", "", {"file": "x.csv"} | given), law) == line


def test_two_steps_are_too_few_to_hold_one_out() -> None:
    record, _ = record_of("slip", SMALL, 1e-3)
    words = "^the record has 1 velocity step, and 3 are needed to hold some out$"
    with pytest.raises(InputError, match=words):
        held_out_blocks(record, VelocitySteps(np.array([0.0, 20.0]), np.array([UM, 2 * UM])))


def test_warnings() -> None:
    laws = [("slip", 1, 0, 1, 50), ("ageing", 1, None, None, None)]
    assert made_up(*laws).warnings == ("ageing: could not be fitted (no end)",)
    _, far = made_up(*laws, rms=2.5).warnings
    assert "even the likeliest law, slip, leaves 2.4 times" in far or "leaves 2.5 times" in far


def test_a_likeliest_law_that_does_not_fit_is_not_supported_in_words() -> None:
    laws = [("slip", 1, 0, 1, 50), ("ageing", 1, 43, 1, 50)]
    fits, far = made_up(*laws).sentence, made_up(*laws, rms=5.5).sentence
    assert fits.startswith("The record supports the slip law with 1 state: its BIC is 43 below")
    assert far.startswith("None of the laws may be right; the likeliest is the slip law with 1")
    assert "43 below" in far and "supports" not in far


def test_a_law_that_rests_on_the_noise_of_a_step_is_told_so() -> None:
    """A record of one step and a longer one with the same step gave 14 and 3.8."""
    found = made_up(("slip", 1, 0, None, None), ("ageing", 1, 11, None, None), held=False)
    (text,) = dataclasses.replace(found, unasked="one step").warnings
    assert text.startswith("no step was held out: one step")
    assert "rests on the noise that is estimated from these rows" in text


BIC = {(0, 0): 5.0, (1, 0): 30.0, (0, 1): -20.0, (1, 1): -5.0}
"""Of two laws, 0 and 1, each under noises of two families, 0 and 1."""


class Made:
    """A law that knows this."""

    words = "slip law, 1 state"

    def __init__(self, law, noise):
        self.law, self.noise = law, noise

    def under(self, family, starts):
        assert starts == [f"found {family.terms[0].clock}"]
        return Made(self.law, (self.law, family.terms[0].clock))

    @property
    def cost(self):
        return BIC[self.noise]


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_every_law_is_asked_under_the_noise_that_was_found_for_another(order) -> None:
    """That of the first law alone is likelier for it than that of the second for the second; with
    the second's noise both are likelier, and it is taken for both."""
    families = {k: Family((Exponential.over(k),)) for k in order}
    alone = [SimpleNamespace(family=families[k], theta=f"found {k}") for k in order]
    rivals = [Made(law, noise) for law, noise in enumerate(alone)]
    found = likeliest(rivals)  # type: ignore[arg-type]
    assert [one.noise for one in found] == [(0, 1), (1, 1)]


# ---- the table ------------------------------------------------------------------------------


def test_a_table_of_fits(of_slip) -> None:
    good = of_slip.scores[0].fit
    fits = [TabledFit("a_b.csv", good, more={"x": 12.345}), TabledFit("c.csv", None, "no column")]
    first, second = csv_rows(fits, "file")
    assert first["file"] == "a_b.csv" and first["result"] == "converged" and first["states"] == 1
    values = good.values()
    assert first["A-B"] == pytest.approx(values["A"] - values["B"], rel=1e-6)
    assert second == {"file": "c.csv", "result": "no column"}
    shown = text_table(fits, "file", "fits")
    assert shown.head[:2] == ("file", "A-B") and shown.rows[1][-1] == "no fit"
    assert shown.rows[0][1].startswith(f"{values['A'] - values['B']:.4f}")
    lines = latex_text(fits, "file").splitlines()
    assert r"a\_b.csv" in lines[5] and lines[5].count("&") == lines[2].count("&") == 5
    assert "no fit" in lines[6] and "dagger" not in lines[5]
    other = dataclasses.replace(good, model=good.model._replace(law="ageing"))
    fits[1] = TabledFit("c.csv", other)
    shown = text_table(fits, "file", "fits", records=True)
    assert shown.head[1:3] == ("law", "K [1/µm]")
    assert [row[1:3] for row in shown.rows] == [("slip", "0.005"), ("ageing", "0.005")]
    lines = latex_text(fits, "file", records=True).splitlines()
    assert lines[2].startswith("file & law & $K$ & $a-b$") and r"[1/$\mu$m]" in lines[3]
    assert r"c.csv & ageing & $0.005$ & $" in lines[6]


def test_the_range_of_several_records_is_that_of_what_their_table_shows(of_slip) -> None:
    """The table has "-" for a - b where A is not determined; the first line does not give it."""
    good = of_slip.scores[0].fit
    loose = dataclasses.replace(good.parameters["A"], value=0.5, determined=False)
    spread = {"parameters": {**good.parameters, "A": loose}, "covariance": 1e8 * good.covariance}
    other = dataclasses.replace(good, **spread)
    value = f"{good.A_minus_B.value:.3g}".replace("-", "−")

    def told(*fits):
        return report_of_files([TabledFit(f"{k}.csv", fit) for k, fit in enumerate(fits)])

    report = told(good, other, good)
    column = report.tables[0].head.index("A-B")
    assert [row[column] == "-" for row in report.tables[0].rows] == [False, True, False]
    signs = "2 velocity weakening, 1 of unknown sign"
    assert report.headline[0] == f"3 of 3 records fitted: a - b is {value} in 2; {signs}"
    assert f"a - b is {value} in each; 2 velocity" in told(good, good).headline[0]
    assert "a - b is not determined in any; 1 of unknown sign" in told(other).headline[0]


def test_a_fit_before_which_friction_drifts_has_a_mark_of_its_own(of_slip) -> None:
    good = of_slip.scores[0].fit
    text = "before the velocity step friction changes by +0.0045, where the model is steady"
    told = Warned(text, WarningCode.DRIFT)
    drifts = dataclasses.replace(good, warnings=(*good.warnings, told))
    lines = latex_text([TabledFit("a.csv", good), TabledFit("b.csv", drifts)], "file").splitlines()
    assert ["ddagger" in line for line in lines[5:9]] == [False, True, False, True]
    assert "off by more than its error" in lines[8]


def test_a_slip_trend_has_a_column_and_files_have_no_folder(of_slip) -> None:
    """Per millimetre; blank for a fit without one, and no column where none has one."""
    good = of_slip.scores[0].fit
    trend = dataclasses.replace(good.parameters["A"], value=4.2, std=0.6, unit="1/m")
    other = dataclasses.replace(
        good,
        model=good.model._replace(slip_trend=True),
        parameters={**good.parameters, "slip_trend": trend},
    )
    fits = [TabledFit("far/a.csv", good), TabledFit("far/b.csv", other), TabledFit("c", None, "no")]
    shown = text_table(fits, "file", "fits")
    column = shown.head.index("trend [1/mm]")
    assert [row[column] for row in shown.rows] == ["", "0.00420(60)", ""]
    assert "trend" not in " ".join(text_table(fits[:1], "file", "fits").head)
    lines = latex_text(fits, "file").splitlines()
    assert lines[0] == r"\begin{tabular}{lccccc}" and r"$D_c$ & trend \\" in lines[2]
    assert lines[6].startswith("b.csv & $") and r"$0.00420(60)$ \\" in lines[6]
    assert lines[7].startswith("c & ") and "no fit" in lines[7]


def test_what_a_law_does_not_explain_is_marked_in_every_table(of_slip) -> None:
    """A residual of ten times the scatter beside a good one: a dagger, a footnote, a warning."""
    good = of_slip.scores[0].fit
    bad = dataclasses.replace(good, rms=10 * good.rms)
    bad = dataclasses.replace(bad, warnings=(*good.warnings, *misfit_warning(bad)))
    fits = [TabledFit("a.csv", good), TabledFit("b.csv", bad)]
    lines = latex_text(fits, "file").splitlines()
    assert [r"$^{\dagger}$" in line for line in lines[5:7]] == [False, True]
    assert "2 times the scatter" in lines[8]
    told = [row["warnings"] for row in csv_rows(fits, "file")]
    assert "jaxfric loop asks which" in told[1] and "scatter" not in told[0]


def test_a_comparison_is_short_in_a_notebook_and_whole_as_a_table(of_slip):
    assert repr(of_slip).startswith("LawComparison(") and len(repr(of_slip)) < 200
    assert of_slip.sentence in of_slip.summary()
    frame = of_slip.to_pandas()
    assert list(frame.index) == [score.name for score in of_slip.scores]
    assert frame["BIC above least"].min() == 0.0
    assert len(of_slip.plot().axes) == 1 + len(of_slip.scores)
