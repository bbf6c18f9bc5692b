"""Draw a study: maps over two parameters, and curves over one parameter.

The figures need only the Dataset of a store: its attributes hold names, units, codes and their
meanings. Outputs with further dimensions (motions in time) are not drawn.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure

from ..stability.margin_table import MARGINS
from . import style
from .marginals import draw_marginals
from .side import Side, code_colours, side_of

if TYPE_CHECKING:
    from xarray import Dataset

_PANELS = 4
_REGULAR = 3e-3
"""A spread of the periods below this part of the period is that of the solver: cycles that repeat
show up to 1.4e-3 at an rtol of 1e-6, as crossings are interpolated within its steps."""
_SHARE, _NOT_YET = "share_of_", "not computed yet"
_GOOD = {"stability": "whose steady sliding is stable", "end": "that end steady"}
"""Of coded outputs in words: the members with their first code."""
_INFINITE = {"period": "no cycle", "period_spread": "no cycle"} | dict.fromkeys(
    ("velocity_amplitude", "slip_amplitude", "least_velocity"), "ran away"
)
"""Of outputs of how a slider ends: what an infinite number says."""
_OF_CYCLES = ("velocity_amplitude", "slip_amplitude", "period", "period_spread")


def draw_study(found: "Dataset", folder: Path) -> list[str]:
    """Write a map of every output over the two longest dimensions, and all marginal curves.

    `found` is the Dataset of a store (`study.load`). Further dimensions of an output are shown in
    up to four panels, or at the middle value of the dimension. If the grid has samples and two or
    more dimensions, the map of a coded output shows the share of samples with the first code. No
    map is drawn of an output without any number, or of the spread of periods if all cycles are
    regular. The function returns the names of the files. If no parameter varies, no file is
    written.
    """
    found = _without_noise(found)
    known, dims = list(map(str, found.data_vars)), tuple(map(str, found["outcome"].dims))
    coded = [n for n in known if "flag_values" in found[n].attrs]
    outputs = [n for n in known if n != "done" and found[n].dims == dims]
    outputs = [n for n in outputs if n != "outcome"] + ["outcome"]
    names = []
    for name in outputs:
        if "sample" in dims:
            if name not in coded or name == "outcome":
                continue
            shares = _shares(found, name)
            name = _SHARE + name
            figure = _map(shares, name, tuple(d for d in dims if d != "sample"), coded=False)
        elif name == "outcome" and not np.any(found[name].values):
            continue  # all members were computed
        else:
            figure = _map(found, name, dims, coded=name in coded)
        if figure is not None:
            names += style.save(figure, folder, f"map_{name}")
    shown = sorted((n for n in outputs if n != "outcome"), key=lambda n: n not in coded)
    figure = draw_marginals(found, shown, coded)
    return names if figure is None else names + style.save(figure, folder, "marginals")


def _shown_at(found: "Dataset", name: str, index: int) -> str:
    value, unit = float(found[name].values[index]), found[name].attrs.get("units", "1")
    return f"{name} = {value:.3g}" if unit == "1" else f"{name} = {style.told(value, unit, 3)}"


def _without_noise(found: "Dataset") -> "Dataset":
    """The study with a spread of periods of 0 where it is no more than that of the solver."""
    if not {"end", "period", "period_spread"} <= set(found.data_vars):
        return found
    spread = found["period_spread"]
    regular = np.isfinite(spread) & (spread < _REGULAR * np.abs(found["period"]))
    kept = spread.where(~regular, 0.0)
    if regular.any():
        kept.attrs["long_name"] = f"{spread.attrs.get('long_name', '')}; 0: regular"
    return found.assign(period_spread=kept)


def _shares(found: "Dataset", name: str) -> "Dataset":
    """The share [%] of the samples that have the first code of an output, of those computed."""
    codes, about = found[name], found[name].attrs
    known = (codes >= 0).sum("sample")
    share = 100 * (codes == 0).sum("sample") / known.where(known > 0)
    first = about["flag_meanings"].split()[0].replace("_", " ")
    words = _GOOD.get(name, f"with the code {first}")
    text = f"share of the {found.sizes['sample']} samples {words}"
    text += f"; {about['long_name']}" if name != "stability" else ""
    share.attrs = {"units": "%", "long_name": text}
    return found.isel(sample=0).assign({_SHARE + name: share})


def _map(found: "Dataset", name: str, dims: tuple[str, ...], *, coded: bool) -> Figure | None:
    """Maps over the two longest dimensions of a grid, in panels over the next one; none of what
    only cycles have, where no member ends in one."""
    grid = [d for d in dims if found.sizes[d] > 1]
    every = np.asarray(found[name].values)
    if len(grid) < 2 or not (coded or np.isfinite(every).any()):
        return None
    if name == "period_spread" and "end" in found and not every[np.isfinite(every)].any():
        return None  # all cycles are regular
    if name in _OF_CYCLES and "end" in found and not np.any(found["end"].values > 0):
        return None  # after the motion has come to rest only errors of the solver remain
    longest = sorted(grid, key=lambda d: -found.sizes[d])
    x, y = sorted(longest[:2], key=dims.index)
    middle = {d: found.sizes[d] // 2 for d in dims if d not in (x, y)}
    shown = [middle]
    for d in longest[2:3]:
        places = np.linspace(0, found.sizes[d] - 1, min(_PANELS, found.sizes[d]))
        shown = [middle | {d: int(i + 0.5)} for i in places]
    values = [np.asarray(found[name].isel(panel).transpose(y, x).values) for panel in shown]
    figure, axes = style.side_by_side(len(shown), height=2.5, most=2, share=True)
    sides = side_of(found, x), side_of(found, y)
    edges = [_edges(side) for side in sides]
    about, legend = found[name].attrs, []
    meanings = about["flag_meanings"].split() if coded else []
    if coded:
        colours = {_NOT_YET: "white"} | code_colours(meanings)
        for axis, part in zip(axes, values, strict=True):
            legend += style.shade(axis, *edges, part + 1, colours)
    else:
        infinite = _INFINITE.get(name, "infinite") if "end" in found else "infinite"
        _numbers(figure, axes, edges, values, name, about.get("units", "1"), infinite)
    for k, (axis, panel) in enumerate(zip(axes, shown, strict=True)):
        held = [_shown_at(found, d, i) for d, i in panel.items() if found.sizes[d] > 1]
        labels = sides[0].label if k >= len(shown) - 2 else "", "" if k % 2 else sides[1].label
        log = "".join(which for which, side in zip("xy", sides, strict=True) if side.log)
        axis.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
        style.tidy(axis, ", ".join(held), x=labels[0], y=labels[1], log=log, grid=False)
    fixed = [_shown_at(found, d, 0) for d in dims if found.sizes[d] == 1]
    title = "; ".join([about.get("long_name", name), *([", ".join(fixed)] if fixed else [])])
    if len(shown) > 1 and len(shown) < found.sizes[longest[2]]:
        title += f"; at {len(shown)} of {found.sizes[longest[2]]} values of {longest[2]}"
    ends = np.unique(every) if coded else []
    if len(ends) == 1 and ends[0] >= 0:
        title += f": {meanings[int(ends[0])].replace('_', ' ')} everywhere"
    return style.finish(figure, title[:1].upper() + title[1:], legend=legend)


def _edges(side: Side) -> np.ndarray:
    """Borders between cells around the values."""
    x = np.log(side.values) if side.log else side.values
    between = 0.5 * (x[1:] + x[:-1])
    first, last = x[0] - (between[0] - x[0]), x[-1] + (x[-1] - between[-1])
    edges = np.concatenate([[first], between, [last]])
    return np.exp(edges) if side.log else edges


def _numbers(
    figure: Figure, axes: Sequence[Axes], edges: Sequence[np.ndarray],
    values: Sequence[np.ndarray], name: str, unit: str, infinite: str,
) -> None:  # fmt: skip
    """Maps of numbers with their scale of colours; what has no number is grey."""
    every = np.concatenate([part.ravel() for part in values])
    finite = every[np.isfinite(every)]
    low, high = np.percentile(finite, [1, 99])
    label, nothing = name.replace("_", " ") if len(name) > 4 else name, "no number"
    norm, cmap = _scale(low, high, name, finite)
    if unit == "%":
        label, nothing, norm, cmap = "share of samples", _NOT_YET, Normalize(0, 100), "cividis"
    for axis, part in zip(axes, values, strict=True):
        shown = np.where(np.isfinite(part), part, np.nan)
        mesh = axis.pcolormesh(*edges, shown, cmap=cmap, norm=norm, rasterized=True)
        axis.set_facecolor("0.87")
    below, above = np.min(finite) < norm.vmin, np.max(finite) > norm.vmax
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]
    bar = figure.colorbar(mesh, ax=list(axes), extend=extend, shrink=0.9, pad=0.02)
    style.tidy(bar.ax, y=(label, unit), grid=False)
    kinds = [(infinite, np.isinf(every)), (nothing, np.isnan(every))]
    if grey := " or ".join(kind for kind, mask in kinds if mask.any()):
        style.tidy(bar.ax, y=f"{bar.ax.get_ylabel()}; grey: {grey}", grid=False)


def _scale(low: float, high: float, name: str, finite: np.ndarray) -> tuple[Normalize, str]:
    """Colour scale: two colours about the limit of stability of a margin; else log or plain."""
    limit = MARGINS[name].limit if name in MARGINS else None
    if limit == 0.0 and low < 0 < high:
        reach = max(high, -low)
        return TwoSlopeNorm(0.0, -reach, reach), "RdBu"
    positive = finite[finite > 0]
    if positive.size == finite.size and high > 30 * low:
        if limit == 1.0 and low < 1 < high:
            reach = max(np.log(high), -np.log(low))
            return LogNorm(np.exp(-reach), np.exp(reach)), "RdBu"
        return LogNorm(low, high), "viridis"
    return Normalize(low, high if high > low else low + 1e-12), "viridis"
