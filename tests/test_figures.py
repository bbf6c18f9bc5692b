"""What figures show: ticks, scales and panels, read from the artists that are drawn."""

import itertools
from types import SimpleNamespace

import matplotlib.figure
import numpy as np
import pytest
from matplotlib.text import Text

import jaxfric as jf
from jaxfric.gains.scenarios import Scenarios
from jaxfric.laws.source import stack
from jaxfric.loop.result import LocationProfile
from jaxfric.loop.steady.loop import close_steady_loop
from jaxfric.plot import gain_map, steady, style
from jaxfric.plot import run as plot_run
from jaxfric.plot.aliasing import _cell, aliasing_figure
from jaxfric.plot.location import _share_and_p
from jaxfric.plot.marginals import draw_marginals
from jaxfric.plot.side import by_factors
from jaxfric.plot.study import _map, _shares, _without_noise, draw_study
from jaxfric.plot.style import new_figure, write
from jaxfric.plot.ticks import plain_log, whole_numbers
from jaxfric.records.steady import SteadyCurve
from jaxfric.runs.events import Event


def labels(axis) -> list[str]:
    """The numbers along an axis that lie within its limits."""
    low, high = sorted(axis.get_view_interval())
    texts = []
    for locator, formatter in (
        (axis.get_major_locator(), axis.get_major_formatter()),
        (axis.get_minor_locator(), axis.get_minor_formatter()),
    ):
        ticks = [x for x in locator() if low <= x <= high]
        texts += [text for text in formatter.format_ticks(ticks) if text]
    return texts


@pytest.mark.parametrize(
    ("limits", "shown"),
    [
        ((0.5, 60.0), {"1", "10"}),
        ((0.3, 15.0), {"1", "10"}),
        ((2.0, 90.0), {"2", "5", "10", "20", "50"}),  # one power of ten
        ((0.8, 9.0), {"1", "2", "5"}),
        ((2.1, 4.6), {"3", "4"}),  # neither 2 nor 5
        ((3.1, 3.9), {"3.2", "3.4", "3.6", "3.8"}),
        ((2e-7, 3e-6), {r"$10^{-6}$", r"$2\times10^{-6}$", r"$5\times10^{-7}$"}),
    ],
)
def test_a_logarithmic_axis_bears_two_numbers_or_more(limits, shown) -> None:
    axes = new_figure(4, 3).subplots()
    plain_log(axes, "x")
    axes.set_xlim(*limits)  # after it became logarithmic
    assert shown <= set(labels(axes.xaxis))
    assert 2 <= len(labels(axes.xaxis)) <= 9


@pytest.mark.parametrize(
    ("log", "limits", "label", "shown"),
    [
        ("", (0.0, 4.2e-3), "velocity [mm/s]", {"0", "1", "2", "3", "4"}),
        ("x", (1e-3, 5e-2), "velocity [mm/s]", {"1", "10"}),
        ("", (0.0, 3.1), "velocity [m/s]", {"0", "1", "2", "3"}),
    ],
)
def test_an_axis_in_si_shows_the_prefix_of_its_unit(log, limits, label, shown) -> None:
    """Also when the panel has a title afterwards."""
    axes = new_figure(4, 3).subplots()
    axes.plot(limits, [0, 1])
    axes.set_xlim(*limits)
    style.tidy(axes, x=("velocity", "m/s"), log=log)
    style.tidy(axes, "title")
    assert axes.get_xlabel() == label and shown <= {
        t.rstrip("0").rstrip(".") if "." in t else t for t in labels(axes.xaxis)
    }


def test_a_logarithmic_axis_has_the_prefix_of_what_is_drawn() -> None:
    """1 to 21 um/s: the margin of a linear axis would end at 1e-10 m/s."""
    axes = new_figure(4, 3).subplots()
    axes.plot([1.001e-6, 21e-6], [0, 1])
    style.tidy(axes, x=("velocity", "m/s"), log="x")
    assert axes.get_xlabel() == "velocity [µm/s]"


def study_of(**outputs):
    """A study over stiffness and velocity, with its outputs as functions of both."""
    xarray = pytest.importorskip("xarray")
    k, v = np.geomspace(1e3, 1e5, 9), np.asarray([1e-6, 1e-5])
    both = np.meshgrid(k, v, indexing="ij")
    dims = ("k_p", "V0")
    found = {name: (dims, of(*both)) for name, (of, _) in outputs.items()}
    dataset = xarray.Dataset(
        {**found, "outcome": (dims, np.zeros((9, 2), int))}, coords={"k_p": k, "V0": v}
    )
    dataset["k_p"].attrs = {"units": "N/m", "spacing": "log"}
    dataset["V0"].attrs = {"units": "m/s"}
    for name, (_, text) in outputs.items():
        dataset[name].attrs = {"units": "1", "long_name": text}
    return dataset


def test_panels_of_a_row_share_one_scale() -> None:
    """A margin that grows with stiffness and velocity: three decades, and one decade in each."""
    long = "stiffness margin, k_p over the critical stiffness"
    found = study_of(
        gain=(lambda k, v: k / 1e4 * v / 1e-6, long),
        nothing=(lambda k, v: np.nan * k, "what nobody knows"),
    )
    figure = draw_marginals(found, ["gain", "nothing"], [])
    assert isinstance(figure, matplotlib.figure.Figure)
    left, right = figure.axes  # a row without any number is left out, and named
    assert "what nobody knows" in figure.get_suptitle()
    assert left.get_yscale() == right.get_yscale() == "log"
    assert left.get_ylim() == right.get_ylim()
    line = right.lines[0]
    drawn = right.transData.transform(np.stack(line.get_data(), axis=1))[:, 1]
    median = left.transData.transform([(1e4, 1.0), (1e4, 10.0)])[:, 1]
    assert drawn == pytest.approx(median)
    assert left.get_ylabel().replace("\n", " ") == long


@pytest.mark.parametrize(
    ("values", "log"),
    [
        ([1, 10], True),
        ([1, 3, 10], True),
        ([10, 1, 3], True),
        ([1, 2, 3, 4, 5, 6, 7, 8, 9, 10], False),
        ([1, 7], False),
        ([0, 10], False),
        ([-1, 10], False),
        ([5], False),
        ([1, 5, 10], False),
        ([1, 4, 10], True),
    ],
)
def test_listed_values_that_differ_by_factors_stand_on_a_logarithmic_axis(values, log) -> None:
    assert by_factors(1e-6 * np.asarray(values, float)) == log


def test_the_title_of_the_curves_of_a_study_stays_within_the_figure() -> None:
    """Also where many outputs have no number; and two velocities, 1 and 10, are a decade."""
    nothing = {f"n{i}": (lambda k, v: np.nan * k, f"what nobody knows of {i}") for i in range(9)}
    found = study_of(gain=(lambda k, v: k / 1e4 * v / 1e-6, "gain"), **nothing)
    figure = draw_marginals(found, list(found.data_vars)[:-1], [])
    assert isinstance(figure, matplotlib.figure.Figure)
    assert figure.axes[1].get_xscale() == "log"
    figure.draw_without_rendering()
    assert figure._suptitle.get_window_extent().x1 <= figure.bbox.x1
    assert "what nobody knows of 8" in figure.get_suptitle().replace("\n", " ")


def test_of_many_curves_those_that_move_are_drawn() -> None:
    """15 outputs of two parameters: each row has the panels over which its output moves."""
    flat = {f"n{i}": (lambda k, v: 1.0 + 0 * k, f"what stays {i}") for i in range(12)}
    found = study_of(
        gain=(lambda k, v: k / 1e4, "gain"),
        speed=(lambda k, v: 1e6 * v, "speed"),
        both=(lambda k, v: np.log(k) + 3 * np.log(v), "both"),
        **flat,
    )
    figure = draw_marginals(found, list(found.data_vars)[:-1], [])
    assert isinstance(figure, matplotlib.figure.Figure)
    drawn = [axis for axis in figure.axes if axis.axison]
    assert [axis.get_xlabel().split(" ")[0] for axis in drawn] == ["k_p", "V0", "k_p", "V0"]
    assert [axis.get_ylabel() for axis in drawn if axis.get_ylabel()] == ["gain", "speed", "both"]
    told = figure.get_suptitle().replace("\n", " ")
    assert all(f"what stays {i}" in told for i in range(12))
    assert "Left out: 26 panels in which little or nothing moves" in told
    figure = draw_marginals(found, ["n0", "n1", "n2", "gain"], [])  # the same of a few
    assert isinstance(figure, matplotlib.figure.Figure)
    assert len(figure.axes) == 1 and "Left out: 7 panels" in figure.get_suptitle()
    constant = draw_marginals(found, ["n0"], [])
    assert isinstance(constant, matplotlib.figure.Figure) and len(constant.axes) == 2


def test_the_curves_of_a_large_study_stay_of_a_size_that_can_be_read() -> None:
    """60 panels in all of which something moves: those that move most;
    and no number of an axis stands beside it, as in 0.05 "+3.036e2"."""
    many = {
        f"n{i}": ((lambda k, v, i=i: 300 + np.log(k) * 1e-3 + i * np.log(v)), f"output {i}")
        for i in range(30)
    }
    found = study_of(**many)
    figure = draw_marginals(found, list(many), [])
    assert isinstance(figure, matplotlib.figure.Figure)
    figure.draw_without_rendering()
    assert len(figure.axes) == 24 and max(figure.get_size_inches()) < 17
    assert figure._suptitle.get_window_extent().x1 <= figure.bbox.x1
    every = [side for axis in figure.axes for side in (axis.xaxis, axis.yaxis)]
    assert all(side.get_offset_text().get_text() == "" for side in every)
    assert all(len(side.get_ticklocs()) < 9 for side in every if side.get_scale() == "linear")
    assert all(len({y for y in axis.get_ylim()}) == 2 for axis in figure.axes)


def test_a_constant_looks_constant() -> None:
    """Rounding of 1e-13 about 99.9 fills no axis, and an axis about it bears whole numbers."""
    axes = new_figure(4, 3).subplots()
    axes.plot([0, 1], [99.9, 99.9 * (1 + 1e-13)])
    whole_numbers(axes, "y", least=0.01)
    low, high = axes.get_ylim()
    assert high - low == pytest.approx(0.999) and low + high == pytest.approx(199.8)
    axes.figure.draw_without_rendering()
    assert axes.yaxis.get_offset_text().get_text() == ""
    axes.set_ylim(10, 20)
    whole_numbers(axes, "y", least=0.01)
    assert axes.get_ylim() == (10, 20)


def test_samples_over_a_grid_have_maps_of_shares(tmp_path) -> None:
    """Of five samples k of them are stable at the k-th stiffness, and one is not computed."""
    xarray = pytest.importorskip("xarray")
    codes = np.asarray([[[0 if s < k else 1] * 2 for k in range(6)] for s in range(5)])
    codes[0, 5, :] = -1
    about = {"flag_values": [0, 1], "flag_meanings": "stable unstable", "long_name": "stability"}
    dims = ("sample", "k_p", "V0")
    found = xarray.Dataset(
        {"stability": (dims, codes, about), "outcome": (dims, 0 * codes)},
        coords={"k_p": np.geomspace(1e3, 1e5, 6), "V0": np.asarray([1e-6, 1e-5])},
    )
    shares = _shares(found, "stability")["share_of_stability"]
    expected = 100 * np.arange(6) / 5
    np.testing.assert_allclose(shares.values, np.stack([expected, expected], axis=1))
    assert shares.dims == ("k_p", "V0") and "5 samples whose steady sliding" in shares.long_name
    figure = _map(_shares(found, "stability"), "share_of_stability", dims[1:], coded=False)
    assert isinstance(figure, matplotlib.figure.Figure)
    (mesh,) = figure.axes[0].collections
    assert (mesh.norm.vmin, mesh.norm.vmax) == (0, 100) and mesh.get_cmap().name == "cividis"
    assert figure.axes[1].get_ylabel() == "share of samples [%]"
    assert "map_share_of_stability.png" in draw_study(found, tmp_path)


def test_a_spread_of_periods_is_drawn_where_it_is_more_than_the_solver_s() -> None:
    """Regular cycles of 10 s, but for 1 ms: no map; one that differs by 1 s: the others are 0."""
    coded = {"flag_values": [0, 1], "flag_meanings": "steady limit_cycle", "units": "1"}
    found = study_of(
        end=(lambda k, v: (k > 2e3).astype(int), "end"),
        period=(lambda k, v: np.where(k > 2e3, 10.0, np.inf), "period"),
        period_spread=(lambda k, v: np.where(k > 2e3, 1e-3, np.inf), "spread"),
    )
    found["end"].attrs |= coded
    quiet = _without_noise(found)
    assert set(np.unique(quiet["period_spread"])) == {0.0, np.inf}
    assert _map(quiet, "period_spread", ("k_p", "V0"), coded=False) is None
    figure = _map(quiet, "period", ("k_p", "V0"), coded=False)
    assert isinstance(figure, matplotlib.figure.Figure)
    assert figure.axes[1].get_ylabel().endswith("grey: no cycle")
    found["period_spread"].values[-1, 0] = 1.0
    figure = _map(_without_noise(found), "period_spread", ("k_p", "V0"), coded=False)
    assert isinstance(figure, matplotlib.figure.Figure)
    assert figure.get_suptitle() == "Spread; 0: regular"
    (mesh,) = figure.axes[0].collections
    assert sorted(set(np.ma.compressed(mesh.get_array()))) == [0.0, 1.0]


@pytest.mark.parametrize(("count", "words"), [(3, ""), (4, ""), (9, "; at 4 of 9 values of mass")])
def test_maps_at_some_of_many_values_say_so(count, words) -> None:
    """And the last tick of a panel ends before the first of the next begins."""
    xarray = pytest.importorskip("xarray")
    sides = {"k_p": np.geomspace(1e5, 1e6, 64), "V0": np.geomspace(1e-6, 1e-5, 16)}
    sides["mass"] = np.linspace(1.0, 2.0, count)
    data = np.random.default_rng(0).uniform(size=[len(x) for x in sides.values()])
    found = xarray.Dataset({"gain": (tuple(sides), data, {"long_name": "gain"})}, sides)
    found["k_p"].attrs["spacing"] = "log"
    for name, unit in (("k_p", "N/m"), ("V0", "m/s"), ("mass", "kg"), ("gain", "1")):
        found[name].attrs["units"] = unit
    figure = _map(found, "gain", tuple(sides), coded=False)
    assert isinstance(figure, matplotlib.figure.Figure)
    assert figure.get_suptitle() == f"Gain{words}"
    figure.draw_without_rendering()
    lower = [axis for axis in figure.axes if axis.get_visible()][2:4]
    boxes = [t.get_window_extent() for axis in lower for t in axis.get_xticklabels()]
    boxes = sorted((box for box in boxes if box.width > 1), key=lambda box: box.x0)
    assert all(a.x1 < b.x0 for a, b in itertools.pairwise(boxes))


@pytest.mark.parametrize(("cycles", "title"), [(False, "End: steady everywhere"), (True, "End")])
def test_where_all_end_steady_a_map_says_so_and_none_is_of_cycles(cycles, title) -> None:
    """What is left of the velocity then is an error of the solver."""
    found = study_of(
        end=(lambda k, v: ((k > 2e3) & cycles).astype(int), "end"),
        velocity_amplitude=(lambda k, v: 1e-11 * k, "amplitude"),
    )
    found["end"].attrs |= {"flag_values": [0, 1], "flag_meanings": "steady limit_cycle"}
    figure = _map(found, "end", ("k_p", "V0"), coded=True)
    assert isinstance(figure, matplotlib.figure.Figure) and figure.get_suptitle() == title
    amplitude = _map(found, "velocity_amplitude", ("k_p", "V0"), coded=False)
    assert (amplitude is not None) == cycles


@pytest.mark.parametrize(
    ("middle", "words"),
    [
        (-0.01, "all below 0: velocity weakening"),
        (0.01, "all above 0: velocity strengthening"),
        (0.0, "below the line: velocity weakening"),
    ],
)
def test_rates_of_a_run_fill_their_panels(monkeypatch, middle, words) -> None:
    """Bars within 4e-4 about one value, at 99.9 MPa: 0 need not be there, and a servo's 0.01 MPa
    fills no axis."""
    steps = []
    for i in range(5):
        event = SimpleNamespace(before=1e-6, after=1e-5, normal_stress=99.9e6 + 2e3 * i)
        fit = SimpleNamespace(converged=True, pair=(middle + 4e-5 * i, 1e-4))
        fit.A_minus_B = SimpleNamespace(determined=i != 2)
        steps.append(SimpleNamespace(fit=fit, event=event, position=1e-3 * i))
    steps[2].fit.pair = (9.0, 5.0)  # nothing is known of it
    monkeypatch.setattr(plot_run, "has_trend", lambda _: False)
    monkeypatch.setattr(plot_run, "rate_of", lambda fit, trend: fit.pair)
    monkeypatch.setattr(plot_run, "misses", lambda step: step is steps[4])
    figure = plot_run.rates_figure(SimpleNamespace(steps=steps))
    figure.draw_without_rendering()
    low, high = figure.axes[0].get_ylim()
    assert 0.7 * (high - low) < 1.6e-4 + 2 * 1.96e-4 < high - low
    assert figure.axes[0].get_title(loc="left") == words and not figure.axes[0].texts
    left, right = figure.axes[2].get_xlim()
    assert right - left == pytest.approx(0.999e6, rel=1e-3)
    marks = {c.get_label(): c.lines[0] for c in figure.axes[1].containers}
    sure, missed = marks["step up"], marks["step up, missed (*)"]
    assert [len(sure.get_xdata()), len(missed.get_xdata())] == [3, 1]
    assert missed.get_markerfacecolor() == "white" != sure.get_markerfacecolor()
    assert all(axis.xaxis.get_offset_text().get_text() == "" for axis in figure.axes)


def test_the_mark_of_a_step_that_tells_little_is_seen_though_its_bar_is_cut() -> None:
    axis = new_figure(4.0, 3.0).subplots()
    plot_run._fill(axis, np.array([[1e-3, 1e-4], [1.2e-3, 1e-4], [1.1e-3, 1e-4], [3e-3, 3e-3]]))
    low, high = axis.get_ylim()
    assert low < 8e-4 and 3e-3 < high < 4e-3


def test_numbers_of_steps_beside_each_other_stand_in_two_lines() -> None:
    """Steps 60 rows apart of 30 000: their numbers would lie on each other. There is no third."""
    figure = new_figure(6.7, 4)
    axis = figure.subplots()
    axis.set_xlim(0, 30000)
    plot_run._number(axis, (10000, 19000, 19060, 19120, 25000))
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axis.texts]
    assert [text.get_text() for text in axis.texts] == ["1", "2", "3", "5"]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    assert all(box.y0 >= axis.get_window_extent().y1 for box in boxes)


def test_a_scale_of_colours_ends_where_its_values_do() -> None:
    """No arrow below an amplitude of 0: it said that some are negative."""
    for most, arrows in ((0.0, "neither"), (1e6, "max")):
        top = np.zeros((9, 2))
        top[-1, -1] = most  # one value beyond the last per cent, where the scale ends
        found = study_of(slip_amplitude=(lambda k, V, top=top: np.maximum(k, 2e4) + top, "slip"))
        figure = _map(found, "slip_amplitude", ("k_p", "V0"), coded=False)
        assert isinstance(figure, matplotlib.figure.Figure)
        assert figure.axes[-1]._colorbar.extend == arrows


def test_the_border_of_stability_is_that_of_the_worst_scenario() -> None:
    """Without mass it is k_p = (B - A - k_v V)/L (25), here of the lower of two velocities."""
    A, B, L = 5.0, 9.0, 2e-5
    law = jf.RateState(300.0, A, [B], [L], 1e-6)
    velocities = np.asarray([1e-6, 1e-4])
    scenarios = Scenarios.at(stack([law]), velocities, None, np.zeros(2, int))
    k_p, k_v = np.linspace(1.0, 3e5, 121), np.linspace(0.0, 3e6, 121)
    expected = k_p[None, :] > (B - A - k_v[:, None] * velocities[0]) / L
    np.testing.assert_array_equal(gain_map._stable(scenarios, k_p, k_v), expected)
    assert expected.any() and not expected.all()


def test_a_study_of_one_member_has_no_curves() -> None:
    found = study_of(gain=(lambda k, v: k / 1e4, "gain")).isel(k_p=[0], V0=[0])
    assert draw_marginals(found, ["gain"], []) is None


def test_no_legend_of_a_steady_curve_lies_on_a_panel() -> None:
    """A run at any speed may have any friction: within a panel a legend hides what is there."""
    speed = np.concatenate([-np.geomspace(0.5, 20, 8)[::-1], np.geomspace(0.5, 20, 8)])
    one = np.ones(16)
    force = 2 * np.sign(speed) + np.sign(speed) * np.exp(-np.abs(speed))
    curve = SteadyCurve(speed, force, one, one, one, 0.01 * one, 0 * one, tuple("abcdefghijklmnop"))
    figure = steady.steady_figure(close_steady_loop(curve))
    figure.draw_without_rendering()
    legends = [*figure.legends, *(a.get_legend() for a in figure.axes if a.get_legend())]
    assert {t.get_text() for one in legends for t in one.get_texts()} >= {
        "runs: mean ± its error", "base: Coulomb and viscous",
    }  # fmt: skip
    for legend in legends:
        for axis in figure.axes:
            assert not legend.get_window_extent().overlaps(axis.get_window_extent())


@pytest.mark.parametrize(
    ("explained", "p", "words"),
    [
        (0.98, 0.0, "98 %, p < 1e-12"),
        (0.004, 0.0, "less than 1 %, tiny, p < 1e-12"),
        (0.011, 1e-3, "1 %, p = 0.001"),
        (0.5, 0.0101, "no more than chance, p = 0.01"),
        (np.nan, 1e-15, "share too small, p < 1e-12"),
        (np.nan, np.nan, "p unknown"),
    ],
)
def test_a_share_and_its_p_are_told_together(explained, p, words) -> None:
    one = np.ones(1)
    assert _share_and_p(LocationProfile("slip", "m", one, one, one, explained, p)) == words


@pytest.mark.parametrize(
    ("cosine", "text", "framed"),
    [
        (0.949, ".94", False),
        (0.95, ".95", True),
        (0.944, ".94", False),
        (0.996, ".99", True),
        (1.0, "1.00", True),
    ],
)
def test_every_cosine_that_reads_as_alike_is_framed(cosine, text, framed) -> None:
    axis = new_figure(3, 3).subplots()
    _cell(axis, 1, 0, cosine)
    assert axis.texts[0].get_text() == text and bool(axis.patches) == framed


def test_a_figure_has_the_width_of_a_journal_and_letters_that_can_be_read() -> None:
    """85 or 170 mm, and no letters below 7 points; the legend lies within the figure."""
    ids = ["servo_lag", "sensor_lag", "velocity_dependent_L"]
    study = study_of(gain=(lambda k, v: k / 1e4, "gain"), speed=(lambda k, v: v, "speed"))
    figures = [
        aliasing_figure(ids, np.full((3, 3), 0.4), added=ids[:1]),
        draw_marginals(study, ["gain", "speed"], []),
        _map(study, "gain", ("k_p", "V0"), coded=False),
    ]
    for figure in figures:
        figure.canvas.draw()
        assert any(figure.get_figwidth() * 25.4 == pytest.approx(mm) for mm in (85, 170))
        seen = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
        assert seen and min(text.get_fontsize() for text in seen) >= 7
        assert all(box.get_window_extent().x1 <= figure.bbox.x1 for box in figure.legends)


def test_a_legend_of_many_words_stays_within_its_figure() -> None:
    figure = new_figure(85 / 25.4, 3.0)
    words = "rows 1, 3, 5 and 9 to 10 apart are more alike than the noise model says; " * 3
    axis = figure.subplots()
    axis.plot([0, 1], [0, 1], label=words)
    axis.plot([0, 1], [1, 0], label="model")
    style.finish(figure, "a title of many words " * 9)
    figure.canvas.draw()
    (legend,) = figure.legends
    boxes = legend.get_window_extent(), figure._suptitle.get_window_extent()
    assert all(box.x0 >= 0 and box.x1 <= figure.bbox.x1 for box in boxes)
    assert not boxes[0].overlaps(axis.get_window_extent())
    assert " ".join(legend.get_texts()[0].get_text().split()) == words.strip()


def test_events_of_a_run_stand_over_the_displacement() -> None:
    """Whatever the load point did in a time: a hold of an hour is a place."""
    t = np.arange(0, 100.0)
    load = 1e-6 * np.minimum(t, 50.0)
    record = jf.from_arrays(t, 0.6 + 0 * t, load_point_displacement=load)
    figure = plot_run.events_figure(record, [Event("hold", 50.0, 1e-6, 0.0, 50.0, 99.0)])
    top, bottom = figure.axes
    assert "displacement" in bottom.get_xlabel()
    np.testing.assert_allclose(top.lines[0].get_xdata(), load, atol=1e-12)
    places = [line.get_xdata()[0] for line in top.lines[1:]]
    assert places == pytest.approx([5e-5])


def test_a_figure_is_laid_out_once_for_all_its_files(tmp_path, monkeypatch):
    """As matplotlib lays it out, which draws it once more for the layout of every file."""
    made = []
    for _ in range(2):
        figure = new_figure(5, 4)
        left, right = figure.subplots(1, 2)
        left.set_ylabel("friction\nof a slider")
        right.set_title("a long title that takes room")
        made.append(figure)
    drawn = []
    draw = matplotlib.figure.Figure.draw
    monkeypatch.setattr(
        matplotlib.figure.Figure, "draw", lambda *args: (drawn.append(1), draw(*args))
    )
    write(made[0], tmp_path / "one.png", tmp_path / "one.svg")
    assert len(drawn) == 2 and all(file.stat().st_size for file in tmp_path.iterdir())
    made[1].savefig(tmp_path / "two.png", dpi=style.DOTS)
    for a, b in zip(made[0].axes, made[1].axes, strict=True):
        np.testing.assert_allclose(a.get_position().bounds, b.get_position().bounds, atol=1e-12)
