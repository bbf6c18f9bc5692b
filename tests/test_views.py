"""Results in a notebook: short, whole, and with the methods that make sense for them."""

import dataclasses
import html.parser
import importlib
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.figure
import numpy as np
import pytest
from test_derived import VALUES, covariance_of, fit_of
from test_loop_report import HOSTILE, make_loop
from test_protocol import designed

import jaxfric as jf
from jaxfric import described, views
from jaxfric.fitting.axis_fit import AxisFit
from jaxfric.gains.set_points import Schedule, SetPoint
from jaxfric.loop.result import VERDICTS
from jaxfric.prediction.result import Comparison, Prediction
from jaxfric.records.record import Provenance
from jaxfric.runs.events import Event
from jaxfric.runs.fits import RunFit, StepFit
from jaxfric.simulation import RESULTS
from jaxfric.simulation.trajectory import Trajectory, result_words
from jaxfric.views import arrays, tables

ROOT = Path(__file__).parents[1]
METHODS = {
    "plot": (described.Drawable, lambda view: view.figure),
    "to_pandas": (described.Tabular, lambda view: getattr(tables, view.name, None)),
    "to_xarray": (described.Gridded, lambda view: getattr(arrays, view.name, None)),
}


def trajectory(batch=(), result=RESULTS.successful):
    """Ten rows of a made-up motion; `batch` more of them."""
    time = np.linspace(0.0, 9.0, 10)
    whole = np.broadcast_to(time, (*batch, 10))
    codes = jax.tree.map(lambda x: jnp.broadcast_to(x, batch), result)
    return Trajectory(
        time=jnp.asarray(whole), force=jnp.asarray(0.6 + 0 * whole),
        recorded=jnp.asarray(0.6 + 0 * whole), velocity=jnp.asarray(1e-6 + 0 * whole),
        slip=jnp.asarray(1e-6 * whole), state=jnp.zeros((*batch, 10, 1)), result=codes,
        end=jnp.full(batch, 9.0), num_steps=jnp.full(batch, 7),
    )  # fmt: skip


def prediction():
    time = np.linspace(0.0, 1.0, 30)
    compared = Comparison("fit", "given", 2e-3, "1", 0.1, 2.0)
    return Prediction(
        "fit.json", Provenance(HOSTILE), "slider", "1", (compared,), {}, 1e-3, 1e-3, (), time,
        0.6 + time, 0.6 + time, None, ("f0 was fitted",), ("a doubt",), 1.3, 0.0,
    )  # fmt: skip


def compensation():
    """Of a saved curve of steady speeds."""
    return jf.feedforward(ROOT / "fits" / "screwdrive1" / "loop" / "steady.json")


def run():
    fit = fit_of(VALUES, covariance_of(VALUES, 0.02))
    event = Event("step", 20.0, 0.0, 50.0, 1e-6, 1e-5)
    steps = StepFit(1, event, 2e-5, fit), StepFit(2, event, 3e-5, None, "too few rows")
    return RunFit(fit.record, (event, event), steps)


def axis_fit():
    return AxisFit(
        "inverse dynamics",
        {"M": 95.1, "F_c": 20.0},
        {"M": 0.1, "F_c": 0.2},
        0.02,
        1.3,
        True,
        ("M",),
    )


def axis_record():
    t = np.linspace(0.0, 4.0, 400)
    force = 0.1 * np.sign(np.cos(2 * t)) + 0.01 * np.random.default_rng(0).standard_normal(400)
    made = jf.records.axis_from_arrays(t, force, position=np.sin(2 * t), coordinate="rotary")
    return dataclasses.replace(made, provenance=Provenance(HOSTILE))


def schedule():
    points = (
        SetPoint(1e-6, 3e3, 0.5, 2.0, 2.5, "escape", "limit_cycle"),
        SetPoint(3e-6, 3e3, 0.7, 2.0, 2.5, "escape", "steady"),
    )
    return Schedule(points, False, (1e-6, 3e-6), ("the law is a guess",))


MADE = {
    "Feedforward": compensation,
    "Fit": lambda: fit_of(VALUES, covariance_of(VALUES, 0.02)),
    "Loop": lambda: make_loop("effects", path=HOSTILE),
    "Prediction": prediction,
    "Record": lambda: fit_of(VALUES, covariance_of(VALUES, 0.02)).record,
    "RunFit": run,
    "AxisFit": axis_fit,
    "Schedule": schedule,
    "Trajectory": trajectory,
    "AxisRecord": axis_record,
    "Protocol": lambda: dataclasses.replace(designed(0.96, after=0.5), warnings=("K is low",)),
}


@pytest.fixture(params=MADE)
def result(request):
    return MADE[request.param]()


class Tags(html.parser.HTMLParser):
    """Counts tags that were opened and not closed."""

    def __init__(self):
        super().__init__()
        self.open, self.text = [], ""

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


# ---- the registry -----------------------------------------------------------------------------


def classes():
    """Every class of the package that is described."""
    [getattr(jf, name) for name in jf.__all__]
    found, last = described.Described.__subclasses__(), {}
    for one in found:
        found += one.__subclasses__()
        last |= {} if one.__subclasses__() else {one.__name__: one}
    return last


def test_every_described_class_has_a_view_and_every_view_a_class():
    assert set(classes()) == set(views.VIEWS)


@pytest.mark.parametrize("name", views.VIEWS)
@pytest.mark.parametrize("method", METHODS)
def test_a_class_has_the_methods_that_its_view_can_serve(name, method):
    mixin, part = METHODS[method]
    assert issubclass(classes()[name], mixin) == bool(part(views.VIEWS[name]))
    assert hasattr(classes()[name], method) == bool(part(views.VIEWS[name]))


@pytest.mark.parametrize("view", views.VIEWS.values(), ids=views.VIEWS)
def test_every_function_of_a_view_is_there(view):
    for name in (f"report.{view.report}", *([f"plot.{view.figure}"] if view.figure else [])):
        module, _, function = name.rpartition(".")
        assert callable(getattr(importlib.import_module(f"jaxfric.{module}"), function))


def test_only_a_posterior_has_draws():
    assert [n for n, c in classes().items() if issubclass(c, described.Drawn)] == ["Posterior"]


def test_a_result_loads_no_view_before_it_is_shown():
    code = (
        "import sys, numpy, jaxfric as j\n"
        "r = j.from_arrays(numpy.arange(30.), numpy.ones(30),"
        " load_point_displacement=numpy.arange(30.))\n"
        "before = 'jaxfric.views' in sys.modules\n"
        "print(before, repr(r), 'pandas' in sys.modules, 'xarray' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("False Record(arrays: 30 rows over 29 s, every 1 s; ")
    assert done.stdout.endswith("False False\n")


# ---- each result ------------------------------------------------------------------------------


def test_a_repr_is_one_short_line_that_names_the_class(result):
    text = repr(result)
    assert text.startswith(f"{type(result).__name__}(") and text.endswith(")")
    assert "\n" not in text and len(text) < 300


def test_a_summary_says_what_the_page_says(result):
    told, page = result.summary(), views.report(result)
    assert told.startswith(f"{type(result).__name__}\n{page.headline[0]}")
    for table in page.tables:
        assert not table.rows or table.title in told
    assert all(f"warning: {w}"[:60] in told.replace("\n", " ") for w in page.warnings)


def test_html_is_closed_and_escaped(result):
    text, tags = result._repr_html_(), Tags()
    tags.feed(text)
    assert tags.open == [] and text.startswith('<div class="jaxfric">')
    assert HOSTILE not in text and "<b>&.csv" not in text
    for warning in views.report(result).warnings:
        assert f"warning: {warning}" in tags.text


def test_a_plot_is_a_figure_that_a_notebook_shows(result):
    if not isinstance(result, described.Drawable):
        assert not hasattr(result, "plot")
        return
    figure = result.plot()
    assert isinstance(figure, matplotlib.figure.Figure)
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert figure.get_axes()


@pytest.mark.parametrize("method", ["to_pandas", "to_xarray"])
def test_a_missing_package_is_named_with_the_line_to_type(result, method, monkeypatch):
    if not hasattr(result, method):
        return
    package = method.removeprefix("to_")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(jf.InputError) as caught:
        getattr(result, method)()
    assert (
        str(caught.value)
        == f'{method} needs {package}; install it: pip install "jaxfric[notebook]"'
    )


# ---- what the tables hold ---------------------------------------------------------------------


def test_a_fit_as_tables():
    fit = MADE["Fit"]()
    table = fit.to_pandas()
    assert list(table.index) == ["A_minus_B", "f0", "A", "B", "L", "K", "V0"]
    assert table.loc["L", "value"] == 2e-5 and table.loc["L", "unit"] == "m"
    assert table.loc["A_minus_B", "std"] == fit.A_minus_B.std
    # of numbers in metres pandas shows one digit
    assert table.columns[0] == "shown" and table.loc["L", "shown"] == "2.000e−5 ± 0.040e−5 m"
    assert table.attrs["converged"] is True and table.attrs["law"] == "slip"
    data = fit.to_xarray()
    np.testing.assert_array_equal(data["residual"], fit.record.friction - fit.predicted)
    assert data["time"].attrs["units"] == "s" and data["friction"].attrs["units"] == "1"
    loose = fit_of(VALUES, covariance_of(VALUES, 0.02), undetermined=("L",)).to_pandas()
    assert np.isnan(loose.loc["L", "std"]) and not loose.loc["L", "determined"]
    assert loose.loc["L", "shown"] == "undetermined"


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_of_a_loop_is_a_line_and_tables(verdict):
    loop = make_loop(verdict, path=HOSTILE)
    assert repr(loop).startswith("Loop(") and len(repr(loop)) < 300
    table = loop.to_pandas()
    after = table[table.model == "after"].set_index("name")
    assert after.loc["A", "value"] == loop.after.parameters["A"].value
    assert table.attrs["verdict"] == verdict and table.attrs["warnings"]
    data = loop.to_xarray()
    np.testing.assert_array_equal(data["residual_after"], -loop.after.residual)
    assert int((data["block"] == "report").sum()) == int(loop.blocks.report.sum())
    told = loop.summary()
    assert verdict in told and told.index("Parameters") < told.index("Error before and after")
    assert loop.after.A_minus_B is not None and "A-B (a-b)" in told


def test_a_trajectory_tells_its_result_in_words():
    assert "10 times to 9 s; successful" in repr(trajectory())
    early = trajectory(result=RESULTS.ran_away)
    assert "ran away" in repr(early) and "velocity passed the runaway limit" in early.summary()
    assert repr(trajectory((3, 2))) == "Trajectory(batch of 3 x 2, 10 times to 9 s; 6 successful)"
    data = trajectory((3,), RESULTS.max_steps_reached).to_xarray()
    assert list(data["result"].values) == ["exhausted max_steps"] * 3
    assert data["slip"].dims == ("member", "time") and data["time"].shape == (10,)
    with pytest.raises(jf.InputError, match="a batch of"):
        trajectory((3,)).to_pandas()
    table = trajectory().to_pandas()
    assert table.columns[0] == "force [F]" and table.attrs["result"] == "successful"


def test_a_traced_trajectory_has_a_repr():
    seen = []
    jax.jit(lambda t: (seen.append(repr(t)), t.force)[1])(trajectory())
    jax.vmap(lambda t: (seen.append(repr(t)), t.force)[1])(trajectory((4,)))
    assert seen == ["Trajectory(10 times; being traced)"] * 2


@pytest.mark.parametrize(
    "name", [n for n in vars(RESULTS) if not n.startswith("_")] or ["ran_away", "impossible"]
)
def test_every_result_of_ours_has_words(name):
    assert result_words(getattr(RESULTS, name)) != "the solver failed"
    assert result_words(RESULTS.dt_min_reached) == "the solver failed"


def test_a_run_as_a_table_and_in_a_line():
    found = run()
    assert repr(found) == "RunFit(1 of 2 velocity steps fitted)"
    table = found.to_pandas()
    assert table.loc[1, "A-B"] == pytest.approx(-0.004) and table.loc[2, "result"] == "too few rows"
    assert "warning: step 2: too few rows" in found.summary()


def test_the_record_of_an_axis_as_tables():
    record = axis_record()
    assert repr(record).endswith("400 rows over 4 s, every 0.01 s; time, motor_force, position)")
    table, data = record.to_pandas(), record.to_xarray()
    np.testing.assert_array_equal(table["position"], record.position)
    assert table.attrs["units"] == {"time": "s", "motor_force": "N m", "position": "rad"}
    assert data["motor_force"].attrs["units"] == "N m" and data["time"].attrs["units"] == "s"


def test_a_protocol_as_a_table_and_in_a_line():
    plan = designed(0.96, sizes=(0.01, None))
    assert repr(plan).startswith("Protocol(") and "ageing/velocity_dependent_L" in repr(plan)
    table = plan.to_pandas()
    assert list(table.index) == ["ageing", "velocity_dependent_L"]
    assert table.loc["ageing", "smallest"] == 0.01
    assert np.isnan(table.loc["velocity_dependent_L", "smallest"])
    assert table.attrs["alike"] == [["ageing", "velocity_dependent_L", 0.96]]


def test_an_axis_fit_does_not_tell_what_is_loose():
    assert "undetermined" in axis_fit().summary() and "95.1" in repr(axis_fit())
    assert list(axis_fit().to_pandas()["determined"]) == [False, True]
