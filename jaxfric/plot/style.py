"""The style of all figures: widths of a journal, type size, panels, legends, units, and files.

A figure is as wide as one or two columns of a journal. The type size in print is `LETTERS` points.
To draw a figure: `panels` makes the axes, `samples` and `curve` draw records and models, `finish`
places titles and legend and sets the type size, `save` writes the files.
"""

import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from .. import units
from ..records.joints import gaps
from ..records.steps import VelocitySteps
from ..report import html
from .palette import BAND, BLACK, BLUE, GREY
from .ticks import plain_log

SINGLE, DOUBLE = 85 / 25.4, 170 / 25.4
"""Widths of one and of two columns of a journal [inch]."""
LETTERS, TITLE = 7.0, 8.0
"""Sizes of letters, and of those of titles [pt]."""
DOTS = 220.0
"""Dots in an inch of a PNG."""
_LETTER = 0.58
"""Width of a letter on average, of its size."""
_MOST_COLUMNS, _HANDLE, _LEGEND = 6, 8, 0.35
"""Columns of a legend, letters that its handles take the room of, and the height that a figure has
for it [inch]: of one or two lines."""
_LONGEST = 40
"""Letters of the name of a file in a title."""
_DECADES = 30.0
"""A logarithmic axis that is longer has the prefix of its middle, a shorter one that of its end."""


# ---- figures and panels ------------------------------------------------------------------------


def new_figure(width: float, height: float) -> Figure:
    """Make a figure of a given size [inch] without a window or global state of pyplot."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panels(heights: Sequence[float], *, last_alone: bool = False) -> tuple[Figure, list[Axes]]:
    """Make a figure of stacked panels of given `heights` [inch] that share one horizontal axis.

    With `last_alone` the last panel has a separate horizontal axis.
    """
    figure = new_figure(DOUBLE, sum(heights) + 0.75)
    grid = figure.subplots(len(heights), squeeze=False, height_ratios=heights)
    axes = list(grid.ravel())
    together = axes[: len(axes) - last_alone]
    for axis in together[1:]:
        axis.sharex(together[0])
    for axis in together[:-1]:
        axis.tick_params(which="both", labelbottom=False)
    for axis in axes:
        axis.margins(x=0.01)
    return figure, axes


def side_by_side(
    count: int, *, height: float, most: int = 3, share: bool = False, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """Make a figure of panels of one `height` [inch], with at most `most` panels in a row.

    With `sharey` the panels share the vertical axis. With `share` the panels share both axes.
    """
    count = max(count, 1)
    columns = min(count, most)
    rows = -(-count // columns)
    figure = new_figure(DOUBLE, height * rows + 0.5)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=share, sharey=share or sharey)
    axes = list(grid.ravel())
    for axis in axes[count:]:
        axis.set_axis_off()
    for axis in axes[count - columns : count]:  # also where no panel is below
        axis.tick_params(labelbottom=True)
    return figure, axes[:count]


def tidy(
    axis: Axes, title: str | None = None, *, x: str | tuple[str, str] = "",
    y: str | tuple[str, str] = "", log: str = "", grid: bool = True, zero: bool = False,
) -> None:  # fmt: skip
    """Style a drawn panel: a one-line title at the left, and labels of both axes.

    An axis has a name, or a name and a unit. An axis with an SI unit is drawn in SI, and its
    numbers are shown with a suitable prefix. `log` names logarithmic axes, "x", "y" or "xy"; `grid`
    draws a light grid; `zero` draws a line at 0. Names and titles that are not given stay
    unchanged.
    """
    if title is not None:
        axis.set_title(title, loc="left", fontsize=TITLE, parse_math=False)
    for which, name in (("x", x), ("y", y)):
        if name or which in log:
            name_axis(axis, which, name, log=which in log)
    if zero:
        axis.axhline(0, color=BLACK, lw=0.7, zorder=1.9)
    axis.set_axisbelow(True)
    axis.grid(False)
    if grid:
        axis.grid(True, which="major", color="0.92", zorder=0)


def name_axis(axis: Axes, which: str, name: str | tuple[str, str], *, log: bool) -> float:
    """Name an axis, "x" or "y"; return the factor from drawn to shown numbers."""
    name, si = (name, "") if isinstance(name, str) else name
    if log:  # first: the margin of a linear axis may end near 0
        axis.set(**{f"{which}scale": "log"})
    side = axis.xaxis if which == "x" else axis.yaxis
    low, high = sorted(side.get_view_interval())
    about, log = max(-low, high), log or side.get_scale() == "log"
    if log and high > _DECADES * low > 0:
        about = max(math.sqrt(low * high), about / 100)
    size, unit = prefixed(about, si)
    if name:
        side.set_label_text(named(name, unit), parse_math=False)
    if log:
        plain_log(axis, which, size)
    elif size != 1.0:
        side.set_major_formatter(lambda at, _: f"{size * at:.8g}".replace("-", "−"))
    return size


def finish(
    figure: Figure, title: str = "", *, of: str = "", legend: Sequence[Artist] = (),
    notes: Sequence[str] = (), colour: str = "black",
) -> Figure:  # fmt: skip
    """Finish a figure with a one-line title, type of one size, and a legend below the panels.

    The title begins with the name of the file at the path `of`. The legend explains the artists in
    `legend`, then all labelled artists of the panels, and ends with `notes`, which are text without
    a symbol.
    """
    for axis in figure.axes:
        if axis.axison:
            axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(which="both", labelsize=LETTERS)
        axis.tick_params(which="minor", pad=5)  # in line with the numbers of longer ticks
        labels = (side.label for side in (axis.xaxis, axis.yaxis))
        offsets = (side.get_offset_text() for side in (axis.xaxis, axis.yaxis))
        for text in (*axis.texts, *labels, *offsets):
            text.set_fontsize(LETTERS)
    title = ": ".join(filter(None, (shortened(printable(of), _LONGEST), title)))
    if title:
        title = wrapped(title, figure.get_figwidth())
        figure.suptitle(title, x=0.01, ha="left", fontsize=TITLE, parse_math=False, color=colour)
    figure.align_ylabels()
    shown = [handle for axis in figure.axes for handle in axis.get_legend_handles_labels()[0]]
    words = [Line2D([], [], ls="", label=text) for text in notes]
    legend_below(figure, [*legend, *shown, *words])
    return figure


def shortened(text: str, most: int) -> str:
    """Shorten a text to at most `most` letters; a shortened text ends in "..."."""
    return text if len(text) <= most else f"{text[: most - 4].rstrip()} ..."


def wrapped(title: str, width: float) -> str:
    """Break a title into lines of at most `width` [inch]."""
    lines = (textwrap.fill(line, letters(width, TITLE)) for line in title.split("\n"))
    return "\n".join(lines)


def letters(width: float, size: float = LETTERS) -> int:
    """Number of letters of a type size [pt] that fit into a line of `width` [inch]."""
    return int(72 * width / (_LETTER * size))


def printable(path: str) -> str:
    """The name of a file, with a question mark for each byte that is not a character."""
    return html.printable(Path(path).name)


def in_folder(path: str) -> str:
    """The name of a file and of its folder: all models are called fit.json or loop.json."""
    return html.printable("/".join(Path(path).parts[-2:]))


# ---- legends -----------------------------------------------------------------------------------


def legend_below(figure: Figure, artists: Sequence[Artist]) -> None:
    """Put one legend below all panels, in as many columns and lines as fit."""
    found: dict[str, Artist] = {}
    for artist in artists:
        found.setdefault(str(artist.get_label()), artist)
    width = letters(figure.get_figwidth()) - _HANDLE
    labels = ["\n".join(textwrap.fill(x, width) for x in text.split("\n")) for text in found]
    for columns in range(min(len(found), _MOST_COLUMNS), 0, -1):
        legend = figure.legend(
            found.values(), labels, loc="outside lower left", ncol=columns, frameon=False,
            fontsize=LETTERS, columnspacing=1.2, handlelength=1.8, borderpad=0.1,
        )  # fmt: skip
        for handle in legend.legend_handles:  # points and lines of a record may be too small
            if isinstance(handle, Line2D):
                handle.set_markersize(max(handle.get_markersize(), 4.0))
                handle.set_linewidth(max(handle.get_linewidth(), 1.2))
        box = legend.get_window_extent()
        if columns == 1 or box.width <= 0.98 * figure.bbox.width:
            more = max(box.height / figure.dpi - _LEGEND, 0.0)  # panels keep their height
            figure.set_figheight(figure.get_figheight() + more)
            return
        legend.remove()


def beside(axis: Axes, text: str) -> None:
    """Put words at the right of a panel, outside the data."""
    axis.text(1.02, 1.0, text, transform=axis.transAxes, va="top", fontsize=LETTERS)


def lying_bars(
    axis: Axes, names: Sequence[str], values: Sequence[float], colours: Sequence[str],
    texts: Sequence[str],
) -> None:  # fmt: skip
    """Draw horizontal bars, the first on top, and a text at the right of each."""
    axis.barh(range(len(names)), values, color=colours, height=0.68, zorder=2)
    axis.set_yticks(range(len(names)), names, parse_math=False)
    axis.set_ylim(len(names) - 0.4 if names else 0.6, -0.6)
    beside_rows(axis, texts)


def beside_rows(axis: Axes, texts: Sequence[str]) -> None:
    """Put texts in a column at the right of a panel, where no line passes through them."""
    for place, text in enumerate(texts):
        axis.text(1.02, place, text, transform=axis.get_yaxis_transform(), va="center")


def square(colour: str, text: str) -> Line2D:
    """A coloured square of a legend."""
    return Line2D([], [], ls="", marker="s", color=colour, mec="0.6", mew=0.5, ms=6, label=text)


# ---- records and models --------------------------------------------------------------------------


class Along(NamedTuple):
    """The horizontal position of the rows of a record in a figure."""

    x: np.ndarray
    label: tuple[str, str]
    """Its name and SI unit."""
    starts: np.ndarray
    """Where the velocities begin, the first one at the first row."""
    pauses: np.ndarray
    """Rows before which the recorder paused: no curve is drawn across."""


def along(steps: VelocitySteps | None, time: np.ndarray, *, over_path: bool = True) -> Along:
    """Load-point displacement since the first row if the load point always advances, else time."""
    pauses = gaps(time) + 1 if len(time) > 1 else np.zeros(0, int)
    over_time = "time since the first row", "s"
    if steps is None:
        return Along(time, over_time, np.zeros(0), pauses)
    one_way = np.all(steps.velocities > 0) or np.all(steps.velocities < 0)
    if not (over_path and one_way):
        return Along(time, over_time, steps.times, pauses)
    label = "load-point displacement since the first row", "m"
    return Along(steps.displacement(time), label, steps.displacement(steps.times), pauses)


def samples(axis: Axes, x: np.ndarray, y: np.ndarray, label: str = "record", colour=BLUE) -> None:
    """Draw measured values as points."""
    size = min(max(60 / math.sqrt(len(x) + 1), 2.0), 4.0)  # few points would not be seen
    axis.plot(x, y, ".", color=colour, ms=size, mew=0, rasterized=True, label=label, zorder=1.5)


def curve(
    axis: Axes, place: Along, y: np.ndarray, label: str | None = None, colour: str = BLUE,
    width: float = 1.0,
) -> None:  # fmt: skip
    """Draw values computed at the rows of a record as a line, broken at pauses of the recorder."""
    x, y = (np.insert(np.asarray(v, float), place.pauses, np.nan) for v in (place.x, y))
    axis.plot(x, y, color=colour, lw=width, label=label, zorder=2)


def bars(
    axis: Axes, x: np.ndarray, y: np.ndarray, error: np.ndarray, label: str | None = None,
    colour: str = BLUE, marker: str = "o", *, hollow: bool = False,
) -> None:  # fmt: skip
    """Draw values with their errors."""
    axis.errorbar(
        x, y, error, fmt=marker, color=colour, mfc="white" if hollow else colour, label=label,
        ms=3, lw=0.8, capsize=2,
    )  # fmt: skip


def mark(
    axis: Axes, x: float | np.ndarray, y: float | np.ndarray, marker: str, label: str | None,
    colour: str = BLACK, *, face: str | None = None, size: float = 6.0,
) -> None:  # fmt: skip
    """Draw highlighted points above all other artists, also beyond the panel's border."""
    axis.plot(
        x, y, marker, color=colour, mfc=face or colour, ms=size, ls="", mew=1.2, label=label,
        zorder=6, clip_on=False,
    )  # fmt: skip


def mark_steps(axes: Sequence[Axes], place: Along, label: str = "velocity step") -> None:
    """Draw dashed lines at changes of velocity."""
    for axis in axes:
        for start in place.starts[1:]:
            axis.axvline(start, color=GREY, lw=0.7, ls="--", zorder=0.5, label=label)


def stairs(
    axis: Axes, place: Along, velocities: np.ndarray, name: tuple[str, str], colour: str = BLACK,
    label: str = "",
) -> None:  # fmt: skip
    """Draw commanded velocities [SI], and their numbers where space allows; name the axis."""
    ends = np.append(place.starts, place.x[-1])
    axis.stairs(velocities, ends, baseline=None, color=colour, lw=1.3, label=label)
    if log := bool(np.all(velocities > 0)):
        axis.set_ylim(velocities.min() / 2, velocities.max() * 8)
    else:
        axis.margins(y=0.4)
    size = name_axis(axis, "y", name, log=log)
    axis.yaxis.set_minor_formatter(NullFormatter())  # step numbers are more informative
    room = letters(0.85 * DOUBLE)
    for k, share in enumerate(np.abs(np.diff(ends)) / np.ptp(place.x)):
        text = f"{float(f'{size * velocities[k]:.3g}'):.15g}".replace("-", "−")  # 2000, not 2e+03
        if len(text) + 1 <= room * share:  # a longer text would lie on the neighbouring line
            at = 0.5 * (ends[k] + ends[k + 1]), velocities[k]
            axis.annotate(text, at, (0, 2), textcoords="offset points", ha="center")


def band(axis: Axes, half: float, label: str, colour: str = BAND) -> None:
    """Shade the values up to `half` on both sides of 0."""
    axis.axhspan(-half, half, color=colour, lw=0, label=label, zorder=0.2)


def ordinary(
    values: np.ndarray, used: np.ndarray | slice = slice(None)
) -> tuple[tuple[float, float] | None, int]:
    """Axis limits that outliers do not affect, and the number of rows with values beyond them.

    `values` are curves over the same rows, with shape (k, n), or one curve (n). Outliers are
    farther from the range of 99 % of the `used` rows of the first curve than the width of this
    range. The limits are None unless all values together span more than four times this range.
    """
    values = np.atleast_2d(values)
    low, high = np.quantile(values[0, used], [0.005, 0.995])
    far = (values < 2 * low - high) | (values > 2 * high - low)
    if np.nanmax(values) - np.nanmin(values) <= 4 * (high - low):
        return None, 0
    near = values[~far & np.isfinite(values)]
    margin = 0.05 * np.ptp(near)
    return (float(near.min() - margin), float(near.max() + margin)), int(far.any(axis=0).sum())


def beyond(rows: int) -> str:
    """Words on the number of rows beyond the limits of a panel; "" without such rows."""
    return "" if not rows else f"{rows} row{' lies' if rows == 1 else 's lie'} beyond the panel"


def motor_label(unit: str, *, rotary: bool = False) -> tuple[str, str]:
    """The name of an axis of a motor's force, and the unit; on a rotary axis it is a torque."""
    return f"motor {'torque' if rotary or unit == 'N m' else 'force'}", unit


def friction_label(unit: str) -> tuple[str, str]:
    """The name of an axis of friction, by its unit, and the unit."""
    return "friction coefficient" if unit == "1" else "friction force", unit


def shade(
    axis: Axes, x: np.ndarray, y: np.ndarray, codes: np.ndarray, colours: Mapping[str, str]
) -> list[Artist]:
    """Colour a map by whole numbers; each number is a position in the list of `colours`.

    The rows of `codes` run along y. x and y are centres or borders of the cells. The function
    returns the legend squares of the colours that occur.
    """
    codes, limits = np.asarray(codes, int), (-0.5, len(colours) - 0.5)
    colour_of = ListedColormap(list(colours.values()))
    axis.pcolormesh(x, y, codes, cmap=colour_of, clim=limits, rasterized=True, zorder=0)
    named = enumerate(colours.items())
    return [square(colour, name) for k, (name, colour) in named if (codes == k).any()]


# ---- units and files -----------------------------------------------------------------------------


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """Return a factor and a prefixed unit in which `largest` lies between 0.1 and 1000."""
    size, shown = (1.0, unit) if 0.1 <= largest < 1 else units.prefix(largest, unit)
    return 1.0 / size, shown


def most(values: np.ndarray) -> float:
    """The largest absolute finite value; 0 without finite values."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))


def told(value: float, unit: str, digits: int = 4) -> str:
    """Write a value as text, with a prefix of its unit."""
    return units.prefixed(value, unit, digits)


def named(name: str, unit: str) -> str:
    """The name of an axis and its unit in brackets; the unit "1" is not shown."""
    label = name if unit in ("", "1") else f"{name} [{unit.replace('*', ' ')}]"
    return label.replace("\n ", "\n").rstrip("\n")


def save(figure: Figure, folder: Path, name: str) -> list[str]:
    """Write NAME.png and NAME.svg; return the names of the files."""
    names = [f"{name}.png", f"{name}.svg"]
    write(figure, *(folder / written for written in names))
    return names


def write(figure: Figure, *paths: str | Path) -> None:
    """Write a figure to each of `paths`, as PNG, SVG or PDF by the path's ending.

    `Figure.savefig` would compute the layout of the figure again for each file. The layout takes as
    long as the writing.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        figure.set_dpi(DOTS)
        if figure.axes:
            engine.execute(figure)
        figure.set_layout_engine(None)
    for path in paths:
        figure.savefig(str(path), dpi=DOTS)
