"""`jaxfric axis FOLDER`: friction of a servo axis from runs at steady speeds."""

from pathlib import Path

from . import options
from .common import doing, prepare_jax, told
from .folder import choose_folder, input_name
from .shown import show


def close_steady(
    folder: Path,
    effects: options.EffectOptions,
    axis: options.AxisOptions,
    reading: options.RecordOptions,
    output: options.OutputOptions,
) -> int:
    """Run the loop on the friction curve of steady runs; write and print the result.

    The function returns the exit code.
    """
    declared, excluded = effects.ids()
    doing(f"reading {input_name(folder)}")
    from ..loop.steady.loop import close_steady_loop
    from ..loop.steady.noise import steady_noise
    from ..plot.steady import noise_figure, steady_figure
    from ..report.steady_text import to_json

    curve = axis.steady(folder, reading)
    target = choose_folder(output.folder, input_name(folder), folder)
    with told() as progress:
        progress("fitting the curve of friction over velocity")
        result = close_steady_loop(curve, include=declared, exclude=excluded)
        prepare_jax()
        progress("estimating the noise of the runs")
        noise = steady_noise(curve)
        content = target.save_json("steady.json", to_json(result, noise))
        progress("drawing the figures")
        target.draw_figure("curve", lambda: steady_figure(result))
        if noise is not None:
            target.draw_figure("noise", lambda: noise_figure(curve, noise))
    from ..report.steady_text import report

    told_of = report(result, noise)
    show(told_of, target.written, content, output)
    code = target.close()
    return 1 if result.verdict == "ambiguous" else code
