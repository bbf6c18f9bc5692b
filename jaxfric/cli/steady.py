"""`jaxfric steady`: the friction of a servo axis from a folder of runs at steady speeds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from . import options
from .common import doing, prepare_jax, refuse_unused, stdout_console, told
from .folder import Folder, choose_folder, input_name

if TYPE_CHECKING:
    from ..loop.steady.loop import SteadyLoop
    from ..loop.steady.noise import SteadyNoise


def steady(
    file: Annotated[
        Path, Parameter(help="A folder of runs at steady speeds, each a table of columns.")
    ],
    /,
    *,
    effects: options.EffectOptions = options.EffectOptions(),
    axis: options.AxisOptions = options.AxisOptions(),
    reading: options.RecordOptions = options.RecordOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Name the effect that the friction of steady speeds has beyond Coulomb and viscous friction.

    Every run of the folder is one speed; --from and --to cut all of them alike. Writes steady.json
    and the figures curve and noise to the output folder, by default ./NAME-loop/ with the options
    that differ from their default.
    """
    declared, excluded = effects.ids()
    refuse_unused("runs at steady speeds", axis.of_loops)
    doing(f"reading {input_name(file)}")
    from ..loop.steady.loop import close_steady_loop
    from ..loop.steady.noise import steady_noise
    from ..plot.steady import draw_noise, draw_steady
    from ..report.steady_text import to_json

    curve = axis.steady(file, reading)
    folder = choose_folder(output.folder, input_name(file), file)
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
    if output.json:
        print(content)
    else:
        _print(result, noise, folder)
    code = folder.close()
    return 1 if result.verdict == "ambiguous" else code


def _print(result: "SteadyLoop", noise: "SteadyNoise | None", folder: Folder) -> None:
    from ..report.steady_text import noise_text, sentence, tables
    from ..report.tables import print_tables

    console = stdout_console()
    console.print(f"{result.verdict}: {result.sentence}", markup=False)
    for note in result.curve.provenance.notes:
        console.print(f"  - {note}", markup=False)
    print_tables(console, tables(result))
    console.print(f"\nGains: {sentence(result)}", markup=False)
    if noise is not None:
        first, *more = noise_text(noise, result.curve)
        console.print(f"\n{first[:1].upper()}{first[1:]}", markup=False)
        for line in more:
            console.print(f"  - {line}", markup=False)
    console.print(folder.written, markup=False, soft_wrap=True)
