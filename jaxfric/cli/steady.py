"""`jaxfric steady`: the friction of a servo axis from a folder of runs at steady speeds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from . import options
from .common import AxisColumns, doing, effect_ids, prepare_jax, told
from .folder import choose_folder, input_name
from .shown import Showing, show

if TYPE_CHECKING:
    pass


def steady(
    file: Annotated[
        Path, Parameter(help="A folder of runs at steady speeds, each a table of columns.")
    ],
    /,
    *,
    with_: options.With = None,
    without: options.WithoutOfSteady = None,
    drive_gain: options.DriveGain = None,
    rated_torque: options.RatedTorque = None,
    flip: options.Flip = None,
    column: options.Columns = None,
    drop_bad: options.DropBad = False,
    since: options.Since = None,
    until: options.Until = None,
    out: options.Out = None,
    details: options.Details = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Name the effect that the friction of steady speeds has beyond Coulomb and viscous friction.

    Every run of the folder is one speed; --from and --to cut all of them alike. Writes steady.json
    and the figures curve and noise to the output folder, by default ./NAME-loop/ with the options
    that differ from their default.
    """
    declared, excluded = effect_ids(with_, "--with"), effect_ids(without, "--without")
    columns = AxisColumns.of(column, drive_gain, rated_torque, flip, drop_bad)
    doing(f"reading {input_name(file)}")
    from ..loop.steady.loop import close_steady_loop
    from ..loop.steady.noise import steady_noise
    from ..plot.steady import draw_noise, draw_steady
    from ..records import read_steady
    from ..report.steady_text import to_json

    curve = read_steady(file, **columns._asdict(), window=(since, until))
    folder = choose_folder(out, input_name(file), file)
    with told() as progress:
        progress("fitting the curve of friction over velocity")
        result = close_steady_loop(curve, with_=declared, without=excluded)
        prepare_jax()
        progress("estimating the noise of the runs")
        noise = steady_noise(curve)
        content = folder.save_json("steady.json", to_json(result, noise))
        progress("drawing the figures")
        folder.draw("curve", lambda to: draw_steady(result, to))
        if noise is not None:
            folder.draw("noise", lambda to: draw_noise(curve, noise, to))
    from ..report.steady_text import report

    told_of = report(result, noise)
    show(told_of, folder.written, content, Showing(json, details))
    code = folder.close()
    return 1 if result.verdict == "ambiguous" else code
