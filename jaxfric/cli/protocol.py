"""`jaxfric protocol`: find the effects that a planned sequence of velocity steps distinguishes."""

import dataclasses
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import InputError
from ..units import has_dimension, parse_quantity, unit_in
from . import options
from .call import current_call
from .common import optional_quantity, prepare_jax
from .folder import choose_folder, source_name
from .plan_line import changed_line
from .told import doing

if TYPE_CHECKING:
    from ..protocol.base import Base


@options.FLAT
@dataclasses.dataclass(frozen=True)
class PlanOptions:
    """Options: the planned experiment, and the pair of effects to distinguish."""

    slip_per_step: Annotated[str, Parameter(allow_leading_hyphen=True)]
    """Load-point motion at each velocity, 150um."""
    stiffness: options.Text = None
    """Required, unless --from has one: stiffness of the machine with unit, 5e-3/um, or 2e6 N/m for
    a force."""
    noise: options.Text = None
    """Required, unless --from has one: noise of a sample, 3e-4, or 0.5 N."""
    rows: Annotated[int, options.MORE] = 250
    """Number of samples at each velocity."""
    slip_channel: Annotated[options.Text, options.MORE] = None
    """Plan a slip channel with this noise, '0.1 um'."""
    distinguish: options.EffectIds = ()
    """Two effects to distinguish, 'ageing,second_state'; one pair a command. The name base in place
    of an effect is the law without effects. The first line answers whether the plan distinguishes
    the two. The base model then omits the two effects even if the file of --from has them."""


def _base(model: options.NamedLaw, stiffness: str | None) -> "Base":
    """Return the base model, from the options or from the file of --from."""
    from ..protocol.base import base_of_file, base_of_text

    if model.from_ is not None:
        if model.parameters is not None or model.law is not None:
            raise InputError("--from excludes --law and --parameters; give one")
        return base_of_file(model.from_)
    law = model.law or "slip"
    unit = "N" if stiffness is not None and has_dimension(stiffness, "N/m") else "1"
    if model.parameters is not None:
        return base_of_text(model.parameters, unit, law)
    if unit == "N":
        raise InputError(
            "--stiffness is of a force, so --parameters in newtons are needed, as in"
            " 'f0=30 N, A=0.5 N, B=0.7 N, L=20 um'"
        )
    return base_of_text(law=law)


def protocol(
    velocities: Annotated[
        str,
        Parameter(
            allow_leading_hyphen=True,
            help="Velocities of the load point in order: '1, 10, 1, 3, 10 um/s'.",
        ),
    ],
    /,
    *,
    how: PlanOptions,
    model: options.NamedLaw = options.NamedLaw(),
    effects: options.EffectOptions = options.EffectOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Compute which effects a planned experiment can distinguish, and how to improve its plan.

    The command writes protocol.json and the figure aliasing to the output folder, by default
    ./protocol/. Options that differ from their default are part of the folder's name.
    """
    commanded = read_velocities(velocities)
    slip = parse_quantity(how.slip_per_step, "m", "--slip-per-step")
    slip_noise = optional_quantity(how.slip_channel, "m", "--slip-channel")
    asked = _pair_of(how.distinguish)
    declared, excluded = effects.include, effects.exclude
    prepare_jax()
    from ..protocol.base import named_pair
    from ..protocol.plan import Planned, plan
    from ..protocol.remedy import Answer, answer_of
    from ..report.protocol_text import found_too_small, report

    base = _base(model, how.stiffness)
    unit, known = base.friction_unit, base.parameters
    planned = base.without(asked or (), declared)
    included = tuple(dict.fromkeys((*planned.effects, *declared)))
    if asked is not None:
        asked = named_pair(asked, base.law, included, excluded)
    what = Planned(
        commanded,
        slip_per_step=slip,
        stiffness=_required(how.stiffness, f"{unit}/m", "--stiffness", base.stiffness),
        noise=_required(how.noise, unit, "--noise", base.noise),
        parameters=planned.parameters,
        law=base.law,
        friction_unit=unit,
        rows=how.rows,
        slip_noise=slip_noise,
        noise_from=str(model.from_) if how.noise is None else "--noise",
    )
    source = "" if model.from_ is None else source_name(model.from_)
    folder = choose_folder(output, source, model.from_)
    found = plan(what, include=included, exclude=excluded, progress=doing)
    answer = Answer() if asked is None else answer_of(found, asked, known)
    line = "" if answer.change is None else changed_line(current_call(), answer.change)
    small = [] if answer.pair is None else found_too_small(found, answer.pair, known)
    found = dataclasses.replace(found, warnings=(*small, *base.warnings, *found.warnings))
    typical = model.from_ is None and model.parameters is None
    folder.save_json("protocol.json", found.to_json() | answer.to_json(line))
    folder.draw_figure("aliasing", found.plot)
    return folder.finish(report(found, answer, typical=typical, command=line))


def _pair_of(ids: tuple[str, ...]) -> tuple[str, str] | None:
    """The two ids of --distinguish."""
    if not ids:
        return None
    if len(ids) != 2:
        raise InputError(
            f"--distinguish '{','.join(ids)}' names {len(ids)}, not two that differ; give one"
            " pair a command, as in --distinguish ageing,second_state, or base,ageing"
        )
    return ids[0], ids[1]


def read_velocities(text: str) -> list[float]:
    """Read velocities [m/s] from a text, in the order of the text.

    A velocity without a unit has the unit of the last velocity in the text.
    """
    pieces = [piece.strip() for piece in text.split(",")]
    if not all(pieces):
        raise InputError(f"velocities: '{text}' is no list; write it as in '1, 10, 1 um/s'")
    unit = unit_in(text)
    if not unit:
        raise InputError(f"velocities: '{text}' has no unit; write it as in '1, 10, 1 um/s'")
    texts = [piece if unit_in(piece) else f"{piece} {unit}" for piece in pieces]
    return [parse_quantity(text, "m/s", "velocities") for text in texts]


def _required(text: str | None, unit: str, option: str, known: float | None) -> float:
    """Return a quantity of an option in `unit`; without the option return `known`."""
    value = optional_quantity(text, unit, option)
    if value is None:
        value = known
    if value is None:
        raise InputError(f"{option} is missing; give it, or a fit that has it, with --from")
    return value
