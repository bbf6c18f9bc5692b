"""`jaxfric gains`: the smallest PD gains that are safe over a set of situations."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import InputError
from ..stability.margin_table import named_with_units
from . import options
from .common import OfMotion, optional_quantity, prepare_jax, read_law, told
from .folder import choose_law_folder
from .shown import Showing, show

if TYPE_CHECKING:
    from ..gains.result import Gains


def gains(
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
            help="Velocities: '5 um/s', '1, 2 um/s', or a range to cover, '1e-6..1e-3 m/s'; of a"
            " joint '1..5 rad/s', and all other options in rad and N m.",
        ),
    ] = None,
    margin: Annotated[
        list[str] | None,
        Parameter(
            negative=(),
            help="A margin that every scenario must have, NAME=NUMBER. Names:"
            f" {named_with_units()}. May be repeated. modulus=0.5 is required beside them, unless"
            " modulus is named; modulus=0 switches it off.",
        ),
    ] = None,
    samples: Annotated[
        int,
        Parameter(
            help="Samples of the law: from the fit's covariance, or so many draws of a posterior."
        ),
    ] = 64,
    confidence: Annotated[
        float, Parameter(help="Share of the samples in which the margins must hold.")
    ] = 1.0,
    seed: Annotated[int, Parameter(help="Seed of the samples.")] = 0,
    max_kp: Annotated[options.Text, Parameter(help="Largest k_p, '1e6 N/m'.")] = None,
    max_kv: Annotated[options.Text, Parameter(help="Largest k_v, '100 N*s/m'.")] = None,
    min_kp: Annotated[options.Text, Parameter(help="Smallest k_p, '10 N/m'.")] = None,
    scale_kp: Annotated[
        options.Text, Parameter(help="Unit of k_p in the norm, '1000 N/m'.")
    ] = None,
    scale_kv: Annotated[
        options.Text, Parameter(help="Unit of k_v in the norm, '10 N*s/m'.")
    ] = None,
    integral: Annotated[
        options.Text,
        Parameter(
            help="Integral gain k_i of a PID controller, '500 N/(m s)' or '5 N m/(rad s)': k_p and"
            " k_v are then the smallest with this k_i in the loop."
        ),
    ] = None,
    accuracy: Annotated[
        options.Text,
        Parameter(
            help="How near its target it must stop, '10 um': k_p is then at least the static"
            " friction over it."
        ),
    ] = None,
    sample_time: options.SampleTime = None,
    delay: options.Delay = None,
    basin: Annotated[
        float | None,
        Parameter(
            help="Raise the gains until velocity may jump by this factor, either way, and the "
            "simulated slider still settles."
        ),
    ] = None,
    check: Annotated[
        bool, Parameter(negative="--no-check", help="Check the gains by nonlinear simulation.")
    ] = True,
    map_: Annotated[
        bool,
        Parameter(
            name="--map",
            negative=(),
            help="Also map, by simulation from rest, the gains at which stick-slip disappears.",
        ),
    ] = False,
    out: options.Out = None,
    details: options.Details = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Find the smallest PD gains whose stability margins hold over velocities, masses and samples.

    Writes gains.json and figures to the output folder, by default ./NAME-gains/ with the options
    that differ from their default; NAME is the law's, or the folder's of the fit.
    """
    import numpy as np

    from ..gains.requirement import Requirement

    if velocity is None:
        raise InputError("--velocity is missing; give the velocities of the machine: '1..100 um/s'")
    prepare_jax()
    required = Requirement.parse(margin or ())
    if basin is not None and not check:
        raise InputError("--basin needs the simulations that --no-check leaves out")
    if integral is not None and (basin is not None or map_):
        raise InputError(
            "--basin and --map rest on simulations without integral action; leave out --integral"
        )
    if samples < 0:
        raise InputError(f"--samples is {samples}; it must be 0 or more")
    source = read_law(
        from_, law, parameters, normal_force, samples=samples, seed=seed, memory=memory
    )
    given = OfMotion(
        {
            "--velocity": (velocity, "m/s"),
            "--mass": (mass, "kg"),
            "--min-kp": (min_kp, "N/m"),
            "--max-kp": (max_kp, "N/m"),
            "--max-kv": (max_kv, "N*s/m"),
            "--scale-kp": (scale_kp, "N/m"),
            "--scale-kv": (scale_kv, "N*s/m"),
            "--integral": (integral, "N/(m*s)"),
            "--accuracy": (accuracy, "m"),
        },
        source.coordinate,
    )
    velocities, masses = np.asarray(given.values("--velocity")), given.masses()
    sampled = optional_quantity(sample_time, "s", "--sample-time")
    late = optional_quantity(delay, "s", "--delay")
    from ..gains import check_gains, find_gains
    from ..plot.gains import draw_gains
    from ..report import gains_json
    from ..report.gains_text import report

    folder = choose_law_folder(out, from_, law)
    with told() as progress:
        result = find_gains(
            source,
            velocity=velocities,
            mass=None if masses is None else np.asarray(masses),
            margin=required,
            confidence=confidence,
            scale=(given.read("--scale-kp"), given.read("--scale-kv")),
            lower=(given.read("--min-kp"), None),
            upper=(given.read("--max-kp"), given.read("--max-kv")),
            sample_time=sampled,
            delay=late,
            accuracy=given.positive("--accuracy"),
            integral_gain=given.read("--integral") or 0.0,
            progress=lambda text: progress(f"{text} (1 of 3)"),
        )
        if check:
            result = check_gains(
                result, basin=basin, progress=lambda text: progress(f"{text} (2 of 3)")
            )
        progress("drawing figures (3 of 3)")
        content = folder.save_json("gains.json", gains_json.content(result))
        folder.draw("gains", lambda to: draw_gains(result, to))
        if map_:
            folder.draw("end_map", lambda to: _draw_map(result, to, progress))
    new = tuple(line for line in result.warnings if line not in source.warnings)
    told_of = report(result)._replace(warnings=new)
    show(told_of, folder.written, content, Showing(json, details))
    code = folder.close()
    return code or int(bool(result.unsafe))


def _draw_map(result: "Gains", folder: Path, progress: Callable[[str], None]) -> list[str]:
    import jax.numpy as jnp

    from ..plot.cycle_map import cycle_map
    from ..plot.gains import draw_end_map
    from ..stability.analysis import steady_point

    progress("mapping the ends from rest")
    found = cycle_map(result)
    scenarios, k = result.scenarios, found.scenario
    return draw_end_map(
        found.ends,
        found.k_p,
        found.k_v,
        folder,
        point=steady_point(scenarios.law(k), jnp.asarray(scenarios.velocity[k])),
        mass=None if scenarios.mass is None else float(scenarios.mass[k]),
        optimum=(result.kp, result.kv),
        coordinate=result.coordinate,
    )
