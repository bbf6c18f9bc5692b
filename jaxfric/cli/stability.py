"""`jaxfric stability`: what the linear theory says of a friction law, with pictures."""

import dataclasses
from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError
from . import options
from .common import OfMotion, optional_quantity, prepare_jax, read_law, read_samples, told, warn
from .folder import choose_law_folder
from .shown import Showing, show


def stability(
    *,
    from_: options.From = None,
    law: options.LawName = None,
    parameters: options.LawParameters = None,
    normal_force: options.NormalForce = None,
    memory: options.Memory = None,
    mass: options.Mass = None,
    velocity: Annotated[
        str | None,
        Parameter(
            allow_leading_hyphen=True,
            help="Velocities: '5 um/s', '1, 2 um/s', or a range '1e-6..1e-3 m/s'.",
        ),
    ] = None,
    kp: Annotated[
        options.Text,
        Parameter(help="Stiffness or position gain, '3 kN/m': gives poles and margins."),
    ] = None,
    kv: options.Damping = None,
    ki: Annotated[
        options.Text,
        Parameter(help="Integral gain of a PID controller, '500 N/(m s)', in poles and margins."),
    ] = None,
    sample_time: options.SampleTime = None,
    delay: options.Delay = None,
    out: options.Out = None,
    details: options.Details = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Show the linear stability of steady sliding: critical stiffness, damping, poles, margins.

    Writes stability.json and figures to the output folder, by default ./NAME-stability/;
    NAME is the law's, or the folder's of the fit.
    """
    if velocity is None:
        raise InputError("--velocity is missing; give one, '5 um/s', or a range, '1..100 um/s'")
    sampled = optional_quantity(sample_time, "s", "--sample-time")
    told_late = optional_quantity(delay, "s", "--delay")
    prepare_jax()
    source = read_law(from_, law, parameters, normal_force, memory=memory)
    options = {"--velocity": (velocity, "m/s"), "--mass": (mass, "kg")}
    given = OfMotion(
        options | {"--kp": (kp, "N/m"), "--kv": (kv, "N*s/m"), "--ki": (ki, "N/(m*s)")},
        source.coordinate,
    )
    velocities, one_mass = given.values("--velocity"), given.mass()
    k_p, k_v = given.positive("--kp"), given.damping("--kv")
    one_mass = source.mass if one_mass is None else one_mass
    unseen = source.unseen(velocities)
    warn(unseen)
    folder = choose_law_folder(out, from_, law)
    from ..stability.analysis import study, with_samples
    from ..stability.linear import controller_delay

    late = controller_delay(sampled, told_late)
    with told() as progress:
        progress("linear theory (1 of 2; then figures)")
        found = study(
            source.law,
            velocities,
            mass=one_mass,
            k_p=k_p,
            k_v=k_v,
            delay=late,
            k_i=given.read("--ki") or 0.0,
        )
        found = dataclasses.replace(found, coordinate=given.coordinate)
        if (samples := read_samples(from_, normal_force)) is not None:
            found = with_samples(found, samples)
        from ..plot.delay import draw_delay
        from ..plot.stability import drawers
        from ..report.stability_json import content
        from ..report.stability_text import report

        progress("drawing figures (2 of 2)")
        known = content(found, source.text, (*source.warnings, *unseen))
        written = folder.save_json("stability.json", known)
        for name, draw in drawers(found).items():
            folder.draw(name, lambda to, draw=draw: draw(found, to))
        if found.delayed:
            folder.draw("delay_chart", lambda to: draw_delay(found, to))
    told_of = report(found, source.text)
    show(told_of, folder.written, written, Showing(json, details))
    return folder.close()
