"""What figures show: ticks, scales and panels, read from the artists that are drawn."""

import matplotlib.figure
import numpy as np
import pytest

from jaxfric.plot.loop import _cell
from jaxfric.plot.marginals import draw_marginals
from jaxfric.plot.stability import new_figure
from jaxfric.plot.ticks import plain_log


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
    """A margin that grows with stiffness alone: two decades in one column, a line in the other."""
    long = "stiffness margin, k_p over the critical stiffness"
    found = study_of(
        gain=(lambda k, v: k / 1e4, long), nothing=(lambda k, v: np.nan * k, "what nobody knows")
    )
    figure = draw_marginals(found, ["gain", "nothing"], [])
    assert isinstance(figure, matplotlib.figure.Figure)
    left, right = figure.axes  # a row without any number is left out, and named
    assert "what nobody knows" in figure.get_suptitle()
    assert left.get_yscale() == right.get_yscale() == "log"
    assert left.get_ylim() == right.get_ylim()
    line = right.lines[0]
    drawn = right.transData.transform(np.stack(line.get_data(), axis=1))[:, 1]
    median = left.transData.transform((1e4, 1.0))[1]
    assert drawn == pytest.approx(median)
    assert left.get_ylabel().replace("\n", " ") == long


def test_a_study_of_one_member_has_no_curves() -> None:
    found = study_of(gain=(lambda k, v: k / 1e4, "gain")).isel(k_p=[0], V0=[0])
    assert draw_marginals(found, ["gain"], []) is None


@pytest.mark.parametrize(
    ("cosine", "text", "framed"),
    [(0.949, ".94", False), (0.95, ".95", True), (0.944, ".94", False), (0.996, "1.0", True)],
)
def test_every_cosine_that_reads_as_alike_is_framed(cosine, text, framed) -> None:
    axis = new_figure(3, 3).subplots()
    _cell(axis, 1, 0, cosine)
    assert axis.texts[0].get_text() == text and bool(axis.patches) == framed
