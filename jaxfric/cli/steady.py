"""`jaxfric axis` of a folder: the friction of a servo axis from runs at steady speeds."""

from pathlib import Path
from typing import TYPE_CHECKING

from . import options
from .common import doing, prepare_jax, stdout_console, told
from .folder import Folder, choose_folder, input_name

if TYPE_CHECKING:
    from ..loop.steady.loop import SteadyLoop
    from ..loop.steady.noise import SteadyNoise


def close_steady(
    folder: Path,
    effects: options.EffectOptions,
    axis: options.AxisOptions,
    reading: options.RecordOptions,
    output: options.OutputOptions,
) -> int:
    """Ask what the friction of a folder of steady runs lacks, write and print it; the exit code."""
    declared, excluded = effects.ids()
    doing(f"reading {input_name(folder)}")
    from ..loop.steady.loop import close_steady_loop
    from ..loop.steady.noise import steady_noise
    from ..plot.steady import draw_noise, draw_steady
    from ..report.steady_text import to_json

    curve = axis.steady(folder, reading)
    target = choose_folder(output.folder, input_name(folder), folder)
    with told() as progress:
        progress("fitting the curve of friction over velocity")
        result = close_steady_loop(curve, with_=declared, without=excluded)
        prepare_jax()
        progress("estimating the noise of the runs")
        noise = steady_noise(curve)
        content = target.save_json("steady.json", to_json(result, noise))
        progress("drawing the figures")
        target.draw("curve", lambda to: draw_steady(result, to))
        if noise is not None:
            target.draw("noise", lambda to: draw_noise(curve, noise, to))
    if output.json:
        print(content)
    else:
        _print(result, noise, target)
    code = target.close()
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
