"""What a good fit looks like, with arrows: `python figure.py [RECORD] [OUT]`.

Fits `data/velocity_step.csv`, a step from 1 to 10 um/s, and draws it: record and model, where
A, B, L and the stiffness show, and two panels that say whether the model is right.
"""

import sys
from pathlib import Path

import jax
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

import jaxfric

HERE = Path(__file__).parent
RECORD, FIT, BAND, WORDS = "#9db4cc", "#c1440e", "#dddddd", "#222222"
TO = 240.0


def say(axis: Axes, text: str, at: tuple[float, float], words: tuple[float, float]) -> None:
    """An arrow from the words to a point, both in the coordinates of the data."""
    arrow = dict(arrowstyle="->", color=WORDS, lw=1.0)
    axis.annotate(text, at, words, arrowprops=arrow, fontsize=9.5, color=WORDS, va="center")


def heights(axis: Axes, text: str, x: float, low: float, high: float) -> None:
    """A two-headed arrow between two heights, with words to its right."""
    axis.annotate("", (x, high), (x, low), arrowprops=dict(arrowstyle="<->", color=WORDS, lw=1.0))
    axis.text(x + 2, (low + high) / 2, text, fontsize=9.5, color=WORDS, va="center")


def draw_record(axis: Axes, fit: jaxfric.Fit, along: np.ndarray, step: float) -> None:
    """The record, the model, and what every parameter does to it."""
    value = {name: estimate.value for name, estimate in fit.parameters.items()}
    speeds = np.asarray(fit.steps.velocities)
    rise = np.log(speeds[1] / speeds[0])
    low = value["f0"]
    end = low + (value["A"] - value["B"]) * rise
    axis.plot(along, fit.record.friction, color=RECORD, lw=1.0, label="record")
    axis.plot(along, fit.predicted, color=FIT, lw=1.8, label="fit")
    for height in (low, end):
        axis.plot([step - 20, TO], [height, height], color="#888888", lw=0.7, ls=":")
    peak = int(np.argmax(fit.predicted))
    words = "(A - B) ln(10): friction of steady\nsliding falls, so it may stick-slip"
    heights(axis, words, 150, end, low)
    say(
        axis,
        "the peak: direct effect A ln(10)\n(a little less: some is forgotten on the way up)",
        (along[peak], fit.predicted[peak]),
        (along[peak] + 22, low + 0.0185),
    )
    at = int(np.searchsorted(fit.predicted[peak:] < end + 0.37 * (fit.predicted[peak] - end), True))
    say(
        axis,
        "the fall: evolution effect B ln(10),\nover the slip length L: after each 20 µm\n"
        "of slip a third of it is left",
        (along[peak + at], fit.predicted[peak + at]),
        (along[peak] + 45, low + 0.0085),
    )
    half = int(np.searchsorted(fit.predicted[:peak], low + 0.5 * (fit.predicted[peak] - low)))
    say(
        axis,
        "the rise: stiffness K\nof press and specimen",
        (along[half], fit.predicted[half]),
        (step - 58, low + 0.0135),
    )
    axis.set_ylabel("friction coefficient")
    axis.legend(loc="upper right", frameon=False)
    axis.set_ylim(end - 0.003, low + 0.0225)
    axis.set_title("A step of velocity from 1 to 10 µm/s, and its fit", loc="left", fontsize=11)


def draw_residual(axis: Axes, fit: jaxfric.Fit, along: np.ndarray, step: float) -> None:
    """What the fit leaves, in the band of its noise."""
    wide = 1.96 * fit.noise.sigma
    axis.axhspan(-wide, wide, color=BAND, lw=0)
    axis.plot(along, fit.residual, color=RECORD, lw=0.7)
    axis.axhline(0, color="#888888", lw=0.7)
    say(
        axis,
        "good: no hump after the step, no trend,\n19 of 20 rows in the grey band of the noise",
        (step + 25, -0.3 * wide),
        (step + 45, 2.15 * wide),
    )
    axis.set_ylim(-1.9 * wide, 3.0 * wide)
    axis.set_ylabel("record - fit")
    axis.set_xlabel("load-point displacement [µm]")


def main(record: Path, out: Path) -> None:
    """Fit the record and write the figure."""
    jax.config.update("jax_enable_x64", True)
    fit = jaxfric.fit(jaxfric.read(record), stiffness="5e-3/um")
    moved = np.asarray(fit.record.load_point_displacement)
    along = 1e6 * (moved - moved[0])
    step = 1e6 * float(np.interp(fit.steps.times[1], fit.record.relative_time, moved - moved[0]))
    figure, axes = plt.subplots(
        2, 1, figsize=(9.0, 6.4), height_ratios=(2.4, 1), sharex=True, layout="constrained"
    )
    draw_record(axes[0], fit, along, step)
    draw_residual(axes[1], fit, along, step)
    axes[0].set_xlim(step - 62, step + TO - 40)
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    given = [Path(word) for word in sys.argv[1:]]
    rest = [HERE.parents[1] / "data" / "velocity_step.csv", HERE / "good_fit.png"][len(given) :]
    main(*given, *rest)
