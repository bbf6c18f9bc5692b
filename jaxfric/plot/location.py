"""Draw the variables that explain the residual: the share of each, and a profile over each."""

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..loop.result import LocationProfile, Loop
from ..loop.thresholds import SIGNIFICANT
from ..report.location_text import added_shares, share_text, shares_told, variable_words
from ..report.loop_text import in_words, readable
from ..report.words import TEMPLATES
from ..units import p_text
from . import style
from .palette import BLUE, GREY, ORANGE

_TINY = 0.01
_LINE = 0.16
"""Height of a line of a sentence [inch]."""


# ---- shares ----------------------------------------------------------------------------------


def location_figure(loop: Loop) -> Figure:
    """Figure with one bar for the share of missing friction that each variable explains.

    The bars and the unexplained rest add up to 100 %.
    """
    shares = added_shares(loop.location)
    sentence, *_ = shares_told(loop.location, loop.base_fit.steps.velocities)
    words = textwrap.fill(sentence, style.letters(style.DOUBLE, style.TITLE))
    height = 0.1 + _LINE * (1 + words.count("\n"))
    figure = style.new_figure(style.DOUBLE, height + (0.5 + 0.24 * len(shares) if shares else 0.0))
    if shares:
        _bars(figure.subplots(), shares)
    style.finish(figure).suptitle(words, x=0.01, ha="left", fontsize=style.TITLE, parse_math=False)
    return figure


def _bars(axis: Axes, shares: Sequence[tuple[str | None, float]]) -> None:
    values = [100 * share for _, share in shares]
    colours = [GREY if name is None else BLUE for name, _ in shares]
    names, texts = zip(*((variable_words(name), share_text(x)) for name, x in shares), strict=True)
    style.lying_bars(axis, names, values, colours, texts)
    axis.set_xlim(0, 100)
    style.tidy(axis, x="share of the missing friction [%], beyond that of the bars above")
    axis.grid(False, axis="y")


# ---- profiles --------------------------------------------------------------------------------


def profiles_figure(loop: Loop) -> Figure:
    """Figure with one panel for each variable: missing friction as a function of the variable."""
    figure, panels = style.side_by_side(len(loop.location), height=1.75)
    for axis, profile in zip(panels, loop.location, strict=False):
        _profile(axis, profile, loop, readable(loop)[0])
    for axis in panels[::3]:
        style.tidy(axis, y="missing friction / rms")
    if not loop.location:
        panels[0].text(0.5, 0.5, "no structure was searched for", ha="center", va="center")
        panels[0].set_axis_off()
    rms = in_words(loop, loop.before.rms["train"])
    title = f"Missing friction in units of the rms of the base, {rms}, by each variable alone"
    return style.finish(figure, title)


def _profile(axis: Axes, profile: LocationProfile, loop: Loop, size: float) -> None:
    label = TEMPLATES.get(f"along.{profile.variable}", profile.variable)
    x, unit = np.asarray(profile.centres, float), profile.unit
    if profile.variable == "log_velocity":  # ln V/V0
        x, unit = loop.base_fit.values()["V0"] * np.exp(x), "m/s"
    if unit == "F":
        x, unit = size * x, readable(loop)[1]
    left = loop.before.rms["train"]
    amplitude, error = profile.amplitudes / left, profile.errors / left
    known = np.isfinite(amplitude) & np.isfinite(error)
    for sign, text in ((-1, "noise of a row"), (1, "")):
        axis.axhline(sign * loop.sigma / left, color=GREY, lw=1.0, ls=":", label=text)
    axis.errorbar(
        x[known], amplitude[known], error[known], fmt="o-", color=BLUE, ecolor=ORANGE, ms=3,
        lw=0.7, elinewidth=1.2, capsize=2, label="missing friction, bars: standard error",
    )  # fmt: skip
    even = dict.fromkeys(("position", "velocity", "time"), np.inf)
    many = {"log_velocity": 3, "periodic_in_slip": 5, **even}.get(profile.variable, 30)
    log = "x" if np.all(x > 0) and np.max(x) > many * np.min(x) else ""
    title = _share_and_p(profile)
    style.tidy(axis, title, x=(label, unit), log=log, zero=True)


def _share_and_p(profile: LocationProfile) -> str:
    """Title of a panel: what the variable below it explains, and whether that may be chance."""
    p = p_text(profile.p_value)
    if not profile.p_value < SIGNIFICANT:
        return f"{'no more than chance, ' if np.isfinite(profile.p_value) else ''}{p}"
    if not np.isfinite(profile.explained):
        return f"share too small, {p}"
    tiny = ", tiny" if profile.explained < _TINY else ""
    return f"{share_text(profile.explained)}{tiny}, {p}"
