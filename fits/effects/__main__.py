"""How every effect of the catalogue looks in a record: `python -m fits.effects [OUT] [ID ...]`.

For each effect a little of it is put into the model, to first order. What the parameters of the
base model (A, B, L, f0 of a slider; mass, viscous and Coulomb friction and offset of an axis) can
take up of the change is taken off by least squares. The rest is what the residual of a fit without
the effect looks like, and is drawn: only its shape matters, so its largest value is 1.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import jax
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from jaxfric import cache_compiled
from jaxfric.effects import AXIS_CATALOGUE, CATALOGUE, AbstractEffect
from jaxfric.effects.axis import ANGLE

from .rigs import AxisStrokes, SliderSteps

HERE = Path(__file__).parent
LINE, STEP = "#1f4e79", "#aaaaaa"


def left(change: np.ndarray, base: np.ndarray) -> np.ndarray:
    """A change less what the columns of `base` can make of it, scaled to a largest value of 1."""
    scale = np.linalg.norm(base, axis=0)
    weights, *_ = np.linalg.lstsq(base / scale, change, rcond=None)
    rest = change - base / scale @ weights
    return rest / np.max(np.abs(rest))


def draw(
    path: Path, along: np.ndarray, rest: np.ndarray, marks: list[tuple[float, str]], label: str
) -> None:
    """One picture: what is left along the record, and where its velocity changes."""
    figure, axis = plt.subplots(figsize=(7.2, 2.0), layout="constrained")
    axis.axhline(0, color=STEP, lw=0.8)
    for place, text in marks:
        axis.axvline(place, color=STEP, lw=0.8, ls=":")
        axis.text(place, 1.16, f" {text}", fontsize=7.5, color="#555555", va="bottom")
    axis.plot(along, rest, color=LINE, lw=1.3)
    axis.set_ylim(-1.15, 1.15)
    axis.set_yticks([-1, 0, 1])
    axis.set_xlim(along[0], along[-1])
    axis.set_xlabel(label, fontsize=8)
    axis.set_ylabel("record - fit", fontsize=8)
    axis.tick_params(labelsize=8)
    axis.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def pictures(
    out: Path,
    setup: SliderSteps | AxisStrokes,
    catalogue: dict[str, type[AbstractEffect]],
    wanted: Callable[[str], bool],
) -> None:
    """The pictures of a catalogue, `ID.png` each."""
    base = setup.base()
    for id, effect in catalogue.items():
        if wanted(id):
            rest = left(setup.change(effect), base)
            draw(out / f"{id}.png", setup.along, rest, setup.marks, setup.label)
            print(out / f"{id}.png", flush=True)


def main(out: Path, ids: list[str]) -> None:
    """All pictures, or those of some ids."""
    jax.config.update("jax_enable_x64", True)
    cache_compiled()
    pictures(out / "slider", SliderSteps(), CATALOGUE, lambda id: not ids or id in ids)
    for turns in (False, True):
        some = {i: e for i, e in AXIS_CATALOGUE.items() if (e.channel == ANGLE) == turns}
        pictures(out / "axis", AxisStrokes(turns=turns), some, lambda id: not ids or id in ids)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else HERE, sys.argv[2:])
