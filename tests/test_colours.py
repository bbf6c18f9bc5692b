"""Colours that one figure shows together are told apart by the colour-blind too."""

import re
from pathlib import Path

import numpy as np
import pytest
from colours import SIGHT, distances, lab
from matplotlib.colors import to_rgb

from jaxfric.plot import palette

LEAST = 15.0
"""Distance in L*a*b* of two colours of a figure, some times what is just seen side by side."""
TOGETHER = {
    "record and model": (
        palette.TRAIN,
        palette.SELECT,
        palette.REPORT,
        palette.GREY,
        palette.BLUE,
        palette.ORANGE,
        palette.BLACK,
    ),
    "candidates": (palette.BLUE, palette.MIDDLE, palette.LIGHT, palette.PALE, palette.ORANGE),
    "location": (palette.BLUE, palette.GREY),
    "profiles": (palette.BLUE, palette.ORANGE, palette.GREY, palette.BLACK),
    "noise": (palette.BAND, palette.BLUE, palette.ORANGE),
    "gains": (
        palette.MEETS,
        palette.STABLE,
        palette.UNSTABLE,
        palette.BAND,
        palette.BLUE,
        palette.ORANGE,
        palette.BLACK,
    ),
    "feedforward": (palette.BAND, palette.GREY, palette.ORANGE, palette.BLUE, palette.BLACK),
    "margins": (*palette.LINES, palette.ORANGE, palette.BAND, palette.BLACK),
    "ends": (palette.STABLE, palette.CYCLE, palette.ESCAPE, palette.OPEN, palette.BLACK),
    "stability": (
        palette.STABLE,
        palette.UNSTABLE,
        palette.BLUE,
        palette.ORANGE,
        palette.BLACK,
        palette.BAND,
    ),
    "events of a run": palette.EIGHT,
    "laws of stick-slip": (palette.BLUE, palette.ORANGE, palette.SKY, palette.GREY),
    "fit": (palette.BLUE, palette.ORANGE, palette.GREY),
    "posterior": (palette.BLUE, palette.ORANGE, palette.GREY),
    "laws compared": (*palette.EIGHT, palette.HELD),
    "other codes of a study": palette.CODES,
}
"""Colours that a reader must tell apart, by figure."""
PLOT = Path(palette.__file__).parent
ALLOWED = {"white", "black", "none"}


def close(colours):
    """Pairs that are too close, with the sight in which they are."""
    return {key: size for key, size in distances(colours).items() if size < LEAST}


@pytest.mark.parametrize("figure", TOGETHER)
def test_colours_of_a_figure_are_told_apart(figure):
    assert not close(TOGETHER[figure])


@pytest.mark.parametrize(
    ("pair", "sights"),
    [
        (("#c8501e", "#8a8a00"), {"deuteranopia"}),  # a red and an olive
        (("#555555", "#d81b60"), {"protanopia"}),
        (("#2a9d8f", "0.55"), {"protanopia", "deuteranopia"}),  # a green and a grey
        (("#f4c9b4", "#ffe28a"), {"tritanopia"}),  # a pink and a yellow
        (("#1f4e79", "#204f7a"), set(SIGHT)),
        (("#1f4e79", "#c8501e"), set()),
    ],
)
def test_colours_that_somebody_confuses_are_found(pair, sights):
    assert {sight for sight, *_ in close(pair)} == sights


def test_the_colour_space_is_that_of_the_standard():
    """L*a*b* of sRGB's primaries, as published; greys stay greys in every kind of sight."""
    for colour, known in (
        ("#ff0000", (53.24, 80.09, 67.20)),
        ("#00ff00", (87.73, -86.18, 83.18)),
        ("#0000ff", (32.30, 79.19, -107.86)),
        ("#ffffff", (100.0, 0.0, 0.0)),
    ):
        assert lab(colour) == pytest.approx(known, abs=0.05)
    for sight, matrix in SIGHT.items():
        assert matrix.sum(axis=1) == pytest.approx(1.0, abs=1e-5)
        assert lab("0.5", sight) == pytest.approx(lab("0.5"), abs=0.05)
    # who has no long cones sees red as dark
    assert lab("#ff0000", "protanopia")[0] < 0.8 * lab("#ff0000")[0]


def test_no_figure_has_a_colour_of_its_own():
    """Colours but greys of grids and letters are named in the palette; a planted one is seen."""

    def strange(text):
        found = re.findall(r'"(#[0-9a-fA-F]{3,8}|C\d|tab:\w+)"', text)
        words = re.findall(r'\b(?:color|c|fc|ec|mec|mfc|facecolor|edgecolor)s?="([a-z]+)"', text)
        return found + [word for word in words if word not in ALLOWED]

    assert strange('axis.plot(x, color="#123456")') and strange('Patch(fc="red")')
    for file in sorted(PLOT.glob("*.py")):
        if file.name != "palette.py":
            assert not strange(file.read_text(encoding="utf-8")), file.name


def test_every_colour_of_the_palette_is_asked_about():
    used = {to_rgb(colour) for colours in TOGETHER.values() for colour in colours}
    named = [v for k, v in vars(palette).items() if k.isupper() and isinstance(v, str)]
    assert named and all(to_rgb(colour) in used for colour in named)
    assert np.all([len(set(colours)) == len(colours) for colours in TOGETHER.values()])
