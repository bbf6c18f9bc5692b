"""`jaxfric stability`: linear stability of steady sliding under a friction law, with figures."""

import dataclasses
from typing import Annotated

from . import options
from .common import OfMotion, prepare_jax, warn
from .told import doing


def stability(
    *,
    law: options.LawOptions = options.LawOptions(),
    mass: options.Mass = None,
    velocity: Annotated[str, options.VELOCITY],
    kp: Annotated[str | None, options.GAIN] = None,
    kv: options.Damping = None,
    ki: options.Integral = None,
    late: options.DelayOptions = options.DelayOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Show the linear stability of steady sliding: critical stiffness, damping, poles, margins.

    The command writes stability.json and figures to the output folder, by default
    ./NAME-stability/. NAME is the name of the law, or of the folder of the fit.
    """
    sampled = late.read()
    prepare_jax()
    source = law.source()
    given = OfMotion(source.coordinate, velocity=velocity, mass=mass, kp=kp, kv=kv, ki=ki)
    velocities, one_mass = given.values("--velocity"), given.one("--mass")
    k_p, k_v = given.one("--kp"), given.damping("--kv")
    one_mass = source.mass if one_mass is None else one_mass
    unseen = source.unseen(velocities)
    warn(unseen)
    folder = law.folder(output)
    from ..stability.analysis import study, with_samples
    from ..stability.linear import controller_delay

    delay = controller_delay(*sampled)
    doing("linear theory (then figures)")
    found = study(
        source.law,
        velocities,
        mass=one_mass,
        k_p=k_p,
        k_v=k_v,
        delay=delay,
        k_i=given.read("--ki") or 0.0,
    )
    found = dataclasses.replace(found, coordinate=given.coordinate)
    if (samples := law.samples()) is not None:
        found = with_samples(found, samples)
    from ..plot.delay import delay_figure
    from ..plot.stability import figures
    from ..report.stability import content, report

    known = content(found, source.text, (*source.warnings, *unseen))
    folder.save_json("stability.json", known)
    for name, figure in figures(found).items():
        folder.draw_figure(name, lambda figure=figure: figure(found))
    if found.delayed:
        folder.draw_figure("delay_chart", lambda: delay_figure(found))
    return folder.finish(report(found, source.text))
