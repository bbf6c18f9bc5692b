"""Draw each output of a study over each parameter, for all values of the other parameters."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import style
from .palette import BLUE
from .side import Side, code_colours, side_of
from .ticks import plain_log, whole_numbers

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

_BINS, _FEW_BINS, _IN_A_BIN = 16, 4, 8
"""Bins of a sampled parameter: no more, no fewer, and with so many samples in each if it can be."""
_MOST = 400_000
"""Members that are read."""
_WIDE, _HEIGHT, _ACROSS = 17, 1.6, 4
_LEAST, _PANELS = 0.05, 24
"""Panels are drawn in which the median changes by more than this part of the range of its output,
or a share of a code by more than this part; no more than `_PANELS`."""
_ROUNDING = 1e-6
"""An output that varies by no more than this part of its size is constant."""

Pair: TypeAlias = tuple[str, str]
"""An output and the parameter that it is drawn over."""


def draw_marginals(found: "Dataset", outputs: Sequence[str], coded: Sequence[str]) -> Figure | None:
    """Draw each output over each parameter: the median and the central 90 %, or shares of codes.

    For an output in `coded`, the shares of its codes are drawn. All panels of an output share one
    scale. Only the panels in which an output changes are drawn, those in which it changes most. If
    nothing changes, the first panels are drawn. The title names the outputs without a panel.
    Returns None if no parameter varies, or no output has a number.
    """
    members, sides = _members(found, outputs)
    bands = {
        (output, name): _band(members, output, name, coded=output in coded)
        for output in outputs
        if members[output].notna().any()
        for name in sides
    }
    pairs = _moving(members, bands, coded)
    if not pairs:
        return None
    across = min(len(pairs), _ACROSS)
    rows = -(-len(pairs) // across)
    figure = style.new_figure(style.DOUBLE, _HEIGHT * rows + 0.6)
    # the layout ignores the width of names below panels: names in the last column need room
    figure.set_layout_engine("constrained", rect=(0.0, 0.0, 0.97, 1.0))
    panels: dict[str, dict[str, Axes]] = {}
    for k, (output, name) in enumerate(pairs):
        first = next(iter(panels.setdefault(output, {}).values()), None)
        axis = figure.add_subplot(rows, across, k + 1, sharey=first)
        axis.tick_params(which="both", labelleft=k % across == 0 or first is None)
        panels[output][name] = axis
    legend = []
    for output, over in panels.items():
        about, unit = found[output].attrs, "share"
        drawn = {axis: bands[output, name] for name, axis in over.items()}
        if output in coded:
            legend += _draw_shares(drawn, about["flag_meanings"].split())
        else:
            _draw_bands(drawn)
            unit = about.get("units", "1")
        label = textwrap.fill(about.get("long_name", output), _WIDE)
        for name, axis in over.items():
            side, named = sides[name], axis.yaxis.get_tick_params()["labelleft"]
            if not side.log:
                whole_numbers(axis, "x", most=2)
            x, y = textwrap.fill(side.label[0], _WIDE), (label, unit) if named else ""
            style.tidy(axis, x=(x, side.label[1]), y=y, log="x" if side.log else "")
    style.finish(figure, legend=legend)
    lines = ["Over all other parameters: median, and where nine in ten lie; shares of codes"]
    if len(pairs) < len(bands):
        left = len(bands) - len(pairs)
        lines.append(f"Left out: {left} panels in which little or nothing moves")
    if never := [output for output in outputs if output not in panels]:
        names = ", ".join(found[name].attrs.get("long_name", name) for name in never)
        lines.append(f"No panel, for nothing moves or no number is known: {names}")
    title = "\n".join(textwrap.fill(line, style.letters(style.DOUBLE)) for line in lines)
    figure.suptitle(title, x=0.01, ha="left", fontsize=style.LETTERS)
    return figure


def _members(found: "Dataset", outputs: Sequence[str]) -> tuple["DataFrame", dict[str, Side]]:
    """Members as rows, and each parameter that varies as an axis; sampled parameters in bins."""
    import pandas

    dims = list(map(str, found["outcome"].dims))
    steps = dict.fromkeys(dims, 1)
    while np.prod([-(-found.sizes[d] // steps[d]) for d in dims], dtype=float) > _MOST:
        steps[max(dims, key=lambda d: found.sizes[d] / steps[d])] += 1
    part = found[list(outputs)].isel({d: slice(None, None, steps[d]) for d in dims})
    members = part.to_dataframe().reset_index().replace([np.inf, -np.inf], np.nan)
    sides = {}
    for name in map(str, found.coords):
        if found[name].ndim != 1 or found[name].dims[0] not in dims or members[name].nunique() < 2:
            continue
        sides[name] = side_of(found, name)
        if name not in dims:
            low, high = members[name].min(), members[name].max()
            sides[name] = sides[name]._replace(log=bool(low > 0 and high > 20 * low))
            bins = min(max(len(part[name]) // _IN_A_BIN, _FEW_BINS), _BINS)
            place, edges = pandas.qcut(
                members[name], bins, labels=False, retbins=True, duplicates="drop"
            )
            members[name] = (0.5 * (edges[1:] + edges[:-1]))[place]
    return members, sides


def _band(members: "DataFrame", output: str, name: str, *, coded: bool) -> "DataFrame":
    """By values of a parameter (rows): the share of each code, or 5, 50 and 95 % of an output."""
    groups = members.groupby(name)[output]
    levels = np.asarray([0.05, 0.5, 0.95])
    found = groups.value_counts(normalize=True) if coded else groups.quantile(levels)
    return found.unstack(fill_value=0.0)  # ty: ignore[invalid-explicit-return]


def _moving(
    members: "DataFrame", bands: Mapping[Pair, "DataFrame"], coded: Sequence[str]
) -> list[Pair]:
    """Those of the pairs in which an output moves most, up to `_PANELS`; any if none moves."""

    def movement(pair: Pair) -> float:
        if pair[0] in coded:
            return float(np.ptp(bands[pair], axis=0).max())
        low, high = members[pair[0]].quantile([0.05, 0.95])
        constant = high - low <= _ROUNDING * members[pair[0]].abs().max()
        middle = bands[pair][0.5]
        return 0.0 if constant else (middle.max() - middle.min()) / (high - low)

    moves = {pair: movement(pair) for pair in bands}
    most = sorted((pair for pair in bands if moves[pair] > _LEAST), key=lambda p: -moves[p])
    return [pair for pair in bands if pair in most[:_PANELS]] or list(bands)[:_PANELS]


def _draw_bands(panels: Mapping[Axes, "DataFrame"]) -> None:
    """Bands of an output on one scale, each panel over a parameter."""
    for axis, band in panels.items():
        x, low, middle, high = band.index.to_numpy(), *band.to_numpy().T
        axis.fill_between(x, low, high, color=BLUE, alpha=0.18, lw=0)
        few = np.isfinite(middle).sum() < 6
        axis.plot(x, middle, color=BLUE, lw=1.4, marker="." if few else None)
    first = next(iter(panels))
    ends = np.concatenate([band.to_numpy().ravel() for band in panels.values()])
    if np.nanmin(ends) > 0 and np.nanmax(ends) > 50 * np.nanmin(ends):
        plain_log(first, "y")  # all panels of an output share one axis
    else:
        whole_numbers(first, "y", least=0.01)


def _draw_shares(panels: Mapping[Axes, "DataFrame"], names: Sequence[str]) -> list[Artist]:
    """Shares of codes, each panel over a parameter; the squares of those that occur."""
    colours = code_colours(names)
    shares = {
        axis: s.reindex(columns=range(len(names)), fill_value=0) for axis, s in panels.items()
    }
    for axis, share in shares.items():
        axis.stackplot(share.index, share.to_numpy().T, colors=list(colours.values()), lw=0)
        axis.set_ylim(0, 1)
    seen = np.any([(share > 0).any() for share in shares.values()], axis=0)
    pairs = zip(colours.items(), seen, strict=True)
    return [style.square(colour, name) for (name, colour), occurs in pairs if occurs]
