"""Figures of where structure sits: shares that add up, and the profile over every variable."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from ..loop.residual_tests import p_text
from ..loop.result import LocationProfile, Loop
from ..loop.thresholds import SIGNIFICANT
from ..report.location_text import added_shares, share_text, shares_told, variable_words
from ..report.loop_text import in_words, readable
from .palette import BLACK, BLUE, GREY, ORANGE
from .stability import new_figure, prefixed, save, tidy
from .ticks import plain_log

_TINY = 0.01
_WIDE, _WIDE_PANEL, _LINE = 92, 50, 0.21
"""Letters in a line over the shares, and over each column of profiles; height of a line [inch]."""
_VARIABLES = {
    "slip": ("slip", "slip since the first row"),
    "log_velocity": ("velocity", "velocity"),
    "state": ("state", "θ − θ_ss, state from its steady value"),
    "position": ("position", "position"),
    "velocity": ("velocity", "velocity"),
    "since_reversal": ("distance since the stop", "distance since the last stop or reversal"),
    "time": ("time", "time since the first row"),
    "time_since_step": ("time since the step", "time since the last velocity step"),
    "relaxation_length": ("relaxation", "slip over which friction relaxes after a step"),
    "wavelength": ("ripple (size)", "wavelength of friction along the slip"),
}


# ---- shares ----------------------------------------------------------------------------------


def save_location(loop: Loop, folder: Path) -> list[str]:
    """Bars of what each variable carries of the missing friction; with the rest they make 100 %."""
    shares = added_shares(loop.location)
    lines = shares_told(loop.location, loop.base_fit.steps.velocities)
    told = "\n".join(textwrap.fill(line, _WIDE) for line in lines)
    if shares:
        figure = new_figure(9.0, 1.9 + 0.42 * len(shares))
        _bars(figure.subplots(), shares)
    else:  # no more than its words
        figure = new_figure(9.0, 0.15 + _LINE * (1 + told.count("\n")))
    figure.suptitle(told, x=0.01, ha="left", fontsize=11)
    return save(figure, folder, "location")


def _bars(axis: Axes, shares: Sequence[tuple[str | None, float]]) -> None:
    names = [variable_words(name) for name, _ in shares]
    values = [100 * share for _, share in shares]
    colours = [GREY if name is None else BLUE for name, _ in shares]
    bars = axis.barh(range(len(shares)), values, color=colours, height=0.66)
    for bar, (_, share) in zip(bars, shares, strict=True):
        at = bar.get_width(), bar.get_y() + 0.5 * bar.get_height()
        axis.annotate(
            share_text(share), at, (5, 0), textcoords="offset points", va="center", fontsize=10
        )
    axis.set_yticks(range(len(shares)), names, fontsize=10)
    axis.set_ylim(len(shares) - 0.4, -0.6)
    axis.set_xlim(0, 112)
    axis.set_xticks([0, 20, 40, 60, 80, 100])
    axis.set_xlabel("share of the missing friction [%]; the bars add up to 100 %")
    tidy(axis, "")
    axis.grid(False, axis="y")


# ---- profiles --------------------------------------------------------------------------------


def save_profiles(loop: Loop, folder: Path) -> list[str]:
    """A panel for every variable: missing friction over it, as bumps that act in the law."""
    number = len(loop.location)
    columns = min(3, max(number, 1))
    rows = max(1, -(-number // columns))
    told = "\n".join(textwrap.fill(line, _WIDE_PANEL * columns) for line in _how_to_read(loop))
    figure = new_figure(4.3 * columns, 3.3 * rows + 0.18 * (1 + told.count("\n")))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, profile in zip(panels, loop.location, strict=False):
        _profile(axis, profile, loop, readable(loop)[0])
    for axis in panels[::columns]:
        axis.set_ylabel("missing friction / rms left")
    for axis in panels[number:]:
        axis.set_axis_off()
    if number == 0:
        panels[0].text(0.5, 0.5, "no structure was searched for", ha="center", va="center")
    figure.suptitle(told, x=0.01, ha="left", fontsize=10.5)
    return save(figure, folder, "profiles")


def _how_to_read(loop: Loop) -> list[str]:
    left = loop.before.rms["train"]
    return [
        "Where friction differs from the base model. Each variable is asked alone: shares overlap"
        " and do not add up to 100 %.",
        f"In units of the rms that the base leaves in its train block, {in_words(loop, left)},"
        f" of which the noise of a {loop.words.row} is the dotted {loop.sigma / left:.2g}.",
        "Left out is what the base's own parameters take up. The machine shows a part only, and"
        " neighbours of opposite sign cancel. Bars: standard error.",
        "p: how often noise alone gains as much in likelihood by bumps over a variable, its size"
        " and memory found anew. Each variable by itself; the table of tests corrects for all that"
        " is asked.",
    ]


def _profile(axis: Axes, profile: LocationProfile, loop: Loop, size: float) -> None:
    name, label = _VARIABLES.get(profile.variable, (profile.variable, profile.variable))
    x, unit = np.asarray(profile.centres, float), profile.unit
    if profile.variable == "log_velocity" and unit != "m/s":
        x, unit = _velocity_of(x, loop), "m/s"
    if unit in ("m", "m/s", "rad", "rad/s", "s"):
        largest = float(np.max(np.abs(x)))
        factor, unit = prefixed(min(largest, loop.words.most.get(unit, np.inf)), unit)
        x = factor * x
    if unit == "F":
        x, unit = size * x, readable(loop)[1]
    left = loop.before.rms["train"]
    amplitude, error = profile.amplitudes / left, profile.errors / left
    known = np.isfinite(amplitude) & np.isfinite(error)
    for level in (-loop.sigma, loop.sigma):
        axis.axhline(level / left, color=GREY, lw=1.0, ls=":")
    axis.axhline(0, color=BLACK, lw=0.8)
    axis.errorbar(
        x[known], amplitude[known], error[known], fmt="o-", color=BLUE, ecolor=ORANGE, ms=4,
        lw=0.8, elinewidth=1.6, capsize=2.5,
    )  # fmt: skip
    even = dict.fromkeys(("position", "velocity", "time"), np.inf)
    many = {"log_velocity": 3, "wavelength": 5, **even}.get(profile.variable, 30)
    if np.all(x > 0) and np.max(x) > many * np.min(x):
        plain_log(axis, "x")
    axis.set_xlabel(label if unit in ("", "1") else f"{label} [{unit}]")
    tidy(axis, _share_and_p(name, profile))


def _share_and_p(name: str, profile: LocationProfile) -> str:
    """Title of a panel: what the variable explains, and whether that may be chance."""
    p = p_text(profile.p_value)
    if not profile.p_value < SIGNIFICANT:
        return f"{name}\n{p}{': no more than chance' if np.isfinite(profile.p_value) else ''}"
    if not np.isfinite(profile.explained):
        return f"{name}\n{p}; too little is left for a share"
    share = share_text(profile.explained)
    tiny = ": hardly chance, but a tiny share" if profile.explained < _TINY else ""
    return f"{name} alone explains {share}\n{p}{tiny}"


def _velocity_of(logarithm: np.ndarray, loop: Loop) -> np.ndarray:
    """Velocity [m/s] from its logarithm, of m/s or of V0: whichever is a velocity of the record."""
    V = np.abs(loop.base_fit.steps.velocities)
    middle = float(np.mean(np.log(V[V > 0]))) if np.any(V > 0) else 0.0
    V0 = loop.base_fit.values().get("V0", 1.0)
    of = min(1.0, V0, key=lambda unit: abs(np.mean(logarithm) + np.log(unit) - middle))
    return of * np.exp(logarithm)
