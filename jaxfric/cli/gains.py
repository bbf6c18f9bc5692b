"""`jaxfric gains`: the smallest PD gains whose margins hold in every scenario."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter, validators

import jaxfric

from ..errors import InputError
from ..stability.margin_table import named_with_units
from . import options
from .common import OfMotion, prepare_jax, refuse_unused
from .options import Text
from .told import doing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..gains.result import Gains


@options.FLAT
@dataclass(frozen=True)
class GainOptions:
    """Margins and bounds of the gains."""

    margin: Annotated[
        list[str] | None,
        Parameter(
            help="A margin that every scenario must reach, NAME=NUMBER. May be repeated; names:"
            f" {named_with_units()}. modulus=0.5 is always required too, unless another modulus is"
            " named; modulus=0 switches it off."
        ),
    ] = None
    samples: Annotated[int, Parameter(validator=validators.Number(gte=0)), options.MORE] = 64
    """Number of samples of the law, from the fit's covariance or from posterior draws."""
    confidence: Annotated[float, options.MORE] = 1.0
    """Share of the samples in which the margins must hold."""
    seed: Annotated[int, options.MORE] = 0
    """Seed of the samples."""
    max_kp: Text = None
    """Largest allowed k_p, '1e6 N/m'."""
    max_kv: Text = None
    """Largest allowed k_v, '100 N*s/m'."""
    min_kp: Annotated[Text, options.MORE] = None
    """Smallest allowed k_p, '10 N/m'."""
    scale_kp: Annotated[Text, options.MORE] = None
    """Unit of k_p in the norm, '1000 N/m'."""
    scale_kv: Annotated[Text, options.MORE] = None
    """Unit of k_v in the norm, '10 N*s/m'."""
    accuracy: Annotated[Text, options.MORE] = None
    """Largest position error at rest, '10 um'. k_p is then at least static friction divided by
    this error."""
    integral: options.Integral = None


@options.FLAT
@dataclass(frozen=True)
class CheckOptions:
    """Options: nonlinear simulations of a slider with the gains."""

    basin: Annotated[float | None, options.MORE] = None
    """Raise the gains until the slider tolerates velocity jumps by this factor. The slider is
    simulated after a jump up and a jump down, and must settle."""
    check: Annotated[bool, Parameter(negative="--no-check")] = True
    """Check the gains by nonlinear simulation (--no-check: do not)."""
    map_: Annotated[bool, Parameter(name="--map"), options.MORE] = False
    """Also map the gains at which stick-slip disappears, by simulations from rest."""


def gains(
    *,
    law: options.LawOptions = options.LawOptions(),
    velocity: Annotated[str, options.VELOCITY],
    mass: options.Mass = None,
    target: GainOptions = GainOptions(),
    late: options.DelayOptions = options.DelayOptions(),
    simulated: CheckOptions = CheckOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Find the smallest PD gains whose stability margins hold over velocities, masses and samples.

    The command writes gains.json and figures to the output folder, by default ./NAME-gains/. NAME
    is the name of the law, or of the folder of the fit. Options that differ from their default are
    part of the folder's name.
    """
    import numpy as np

    from ..gains.requirement import Requirement
    from ..laws.source import without_first

    prepare_jax()
    required = Requirement.parse(target.margin or ())
    if simulated.basin is not None and not simulated.check:
        raise InputError("--basin needs the simulations that --no-check leaves out")
    if target.integral is not None and (simulated.basin is not None or simulated.map_):
        raise InputError(
            "--basin and --map rest on simulations without integral action; leave out --integral"
        )
    source = law.source(samples=target.samples, seed=target.seed)
    if target.samples and without_first(source.samples) is None:
        refuse_unused("a law without errors", "samples", "confidence", "seed")
    given = OfMotion(source.coordinate, target, velocity=velocity, mass=mass)
    velocities, masses = np.asarray(given.values("--velocity")), given.values("--mass")
    sampled, delay = late.read()
    from ..report.gains import content, report

    folder = law.folder(output)
    result = jaxfric.find_gains(
        source,
        velocity=velocities,
        mass=np.asarray(masses) if masses else None,
        margin=required,
        confidence=target.confidence,
        scale=(given.read("--scale-kp"), given.read("--scale-kv")),
        lower=(given.read("--min-kp"), None),
        upper=(given.read("--max-kp"), given.read("--max-kv")),
        sample_time=sampled,
        delay=delay,
        accuracy=given.one("--accuracy"),
        integral_gain=given.read("--integral") or 0.0,
        progress=lambda text: doing(f"{text} (1 of 3)"),
    )
    if simulated.check:
        say = lambda text: doing(f"{text} (2 of 3)")  # noqa: E731
        result = jaxfric.check_gains(result, basin=simulated.basin, progress=say)
    folder.save_json("gains.json", content(result))
    new = tuple(line for line in result.warnings if line not in source.warnings)
    folder.answer(report(result)._replace(warnings=new))
    folder.draw_figure("gains", result.plot)
    if simulated.map_:
        folder.draw_figure("end_map", lambda: _end_map(result))
    return folder.end() or int(bool(result.unsafe))


def _end_map(result: "Gains") -> "Figure":
    from ..gains.cycle_map import cycle_map
    from ..plot.gains import end_map_figure

    doing("mapping the ends from rest")
    return end_map_figure(result, cycle_map(result))
