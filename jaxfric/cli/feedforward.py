"""`jaxfric feedforward`: the friction of an axis as a formula, a C function and a table."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import jaxfric

from . import options
from .call import current_call
from .common import prepare_jax, warn
from .folder import choose_folder, source_name
from .told import doing


@options.FLAT
@dataclass(frozen=True)
class MapOptions:
    """Options: motion and units of the controller that runs the feedforward."""

    at: options.Text = None
    """Print the friction at these speeds first, forwards and backwards: "50 mm/s", "1, 5 rad/s"."""
    acceleration: options.Text = None
    """Acceleration of the reference at a reversal, "2 m/s^2" or "50 rad/s^2". Default: the
    acceleration in the record, if the file has it."""
    lag: options.Text = None
    """Delay of the axis behind its reference at a reversal, "4 ms"."""
    fade_speed: options.Text = None
    """Fade the compensation below this speed, "5 mm/s", instead of the derived speed."""
    drive_gain: options.DriveGain = None
    name: str = "axis"
    """Name of the axis in C: NAME_feedforward."""


def feedforward(
    model: Annotated[Path, Parameter(help="A loop.json or steady.json of 'jaxfric axis'.")],
    /,
    *,
    how: MapOptions = MapOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Compensate the friction of an axis or joint: formula, C function, table, and fade speed.

    The controller computes the compensation from velocity and acceleration of the reference, and
    adds the compensation to its output. The command writes feedforward.c, .csv, .tex, .json and the
    figure feedforward to the output folder, by default ./MODEL-feedforward/.
    """
    prepare_jax()
    from ..compensation import NothingToCompensate
    from ..compensation.spot import speeds
    from ..report.feedforward_text import made_by, report, tex

    doing("computing the feedforward")
    try:
        found = jaxfric.feedforward(
            model,
            acceleration=how.acceleration,
            lag=how.lag,
            fade_speed=how.fade_speed,
            drive_gain=how.drive_gain,
        )
        asked = [] if how.at is None else [found.at(v) for v in speeds(how.at, found.about.length)]
    except NothingToCompensate as error:
        warn([str(error)], "error")
        return 1
    source = found.c(how.name, made_by=made_by(current_call().command))
    folder = choose_folder(output, source_name(model), model)
    texts = {"c": source, "csv": found.csv(), "tex": tex(found)}
    named = {f"feedforward.{kind}": text for kind, text in texts.items()}
    folder.save_json("feedforward.json", found.to_json(asked), named)
    folder.draw_figure("feedforward", found.plot)
    return folder.finish(report(found, asked))
