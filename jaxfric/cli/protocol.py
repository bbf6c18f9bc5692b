"""`jaxfric protocol`: find the effects that a planned sequence of velocity steps distinguishes."""

import dataclasses
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..errors import InputError
from . import options
from .call import current_call
from .common import effect_ids, optional_quantity, prepare_jax, told
from .folder import choose_folder, source_name
from .plan_line import changed_line
from .shown import show

if TYPE_CHECKING:
    from ..protocol.base import Base

EXAMPLES = {"--slip-per-step": "150um", "--stiffness": "5e-3/um", "--noise": "3e-4"}
"""Values of the options that are required."""


@options.FLAT
@dataclasses.dataclass(frozen=True)
class PlanOptions:
    """Options: the planned experiment, and the pair of effects to distinguish."""

    slip_per_step: options.Text = None
    """Required: load-point motion at each velocity, 150um."""
    stiffness: Annotated[
        options.Stiffness, options.required(options.STIFFNESS, unless=", unless --from has one")
    ] = None
    noise: options.Text = None
    """Required, unless --from has one: noise of a sample, 3e-4, or 0.5 N."""
    rows: Annotated[int, options.MORE] = 250
    """Number of samples at each velocity."""
    slip_channel: Annotated[options.Text, options.MORE] = None
    """Plan a slip channel with this noise, '0.1 um'."""
    distinguish: list[str] | None = None
    """Two effects to distinguish, 'ageing,second_state'. The name base in place of an effect is
    the law without effects. The first line answers whether the plan distinguishes the two. The
    base model then omits the two effects even if the file of --from has them."""
    from_: options.From = None
    law: Annotated[str | None, options.LAW] = None
    parameters: options.Parameters = None

    def base(self) -> "Base":
        """Return the base model, from the options or from the file of --from."""
        from ..protocol.base import base_of_file, base_of_text
        from ..units import has_dimension

        if self.from_ is not None:
            if self.parameters is not None or self.law is not None:
                raise InputError("--from excludes --law and --parameters; give one")
            return base_of_file(self.from_)
        law = self.law or "slip"
        unit = "1"
        if self.stiffness is not None and has_dimension(self.stiffness, "N/m"):
            unit = "N"
        if self.parameters is not None:
            return base_of_text(self.parameters, unit, law)
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
    how: PlanOptions = PlanOptions(),
    effects: options.EffectOptions = options.EffectOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Compute which effects a planned experiment can distinguish, and how to improve its plan.

    The command writes protocol.json and the figure aliasing to the output folder, by default
    ./protocol/. Options that differ from their default are part of the folder's name.
    """
    declared, excluded = effects.ids()
    commanded = read_velocities(velocities)
    slip = _required(how.slip_per_step, "m", "--slip-per-step")
    slip_noise = optional_quantity(how.slip_channel, "m", "--slip-channel")
    asked = _pair_of(how.distinguish)
    with told() as progress:
        prepare_jax()
        from ..plot.aliasing import protocol_figure
        from ..protocol.base import named_pair
        from ..protocol.plan import Planned, plan
        from ..protocol.remedy import Answer, answer_of
        from ..report.protocol_text import found_too_small, report

        base = how.base()
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
            noise_from=str(how.from_) if how.noise is None else "--noise",
        )
        source = [how.from_] if how.from_ else []
        folder = choose_folder(output.folder, "".join(map(source_name, source)), *source)
        found = plan(what, include=included, exclude=excluded, progress=progress)
        answer = Answer() if asked is None else answer_of(found, asked, known)
        line = "" if answer.change is None else changed_line(current_call(), answer.change)
        small = [] if answer.pair is None else found_too_small(found, answer.pair, known)
        found = dataclasses.replace(found, warnings=(*small, *base.warnings, *found.warnings))
        typical = how.from_ is None and how.parameters is None
        content = folder.save_json("protocol.json", found.to_json() | answer.to_json(line))
        progress("drawing figures")
        folder.draw_figure("aliasing", lambda: protocol_figure(found))
    show(report(found, answer, typical=typical, command=line), folder.written, content, output)
    return folder.close()


def _pair_of(texts: list[str] | None) -> tuple[str, str] | None:
    """The two ids of --distinguish."""
    ids = effect_ids(texts, "--distinguish")
    if not ids:
        return None
    if len(ids) != 2:
        raise InputError(
            f"--distinguish '{','.join(texts or ())}' names {len(ids)}, not two that differ; write"
            " --distinguish ageing,second_state, or --distinguish base,ageing"
        )
    return ids[0], ids[1]


def read_velocities(text: str) -> list[float]:
    """Read velocities [m/s] from a text, in the order of the text.

    A velocity without a unit has the unit of the last velocity in the text.
    """
    from ..units import parse_quantity

    pieces = [piece.strip() for piece in text.split(",")]
    if not all(pieces):
        raise InputError(f"velocities: '{text}' is no list; write it as in '1, 10, 1 um/s'")
    unit = pieces[-1].lstrip("+-0123456789.eE").strip()
    if not unit:
        raise InputError(f"velocities: '{text}' has no unit; write it as in '1, 10, 1 um/s'")
    bare = [not piece.lstrip("+-0123456789.eE") for piece in pieces]
    texts = [
        f"{piece} {unit}" if alone else piece for piece, alone in zip(pieces, bare, strict=True)
    ]
    return [parse_quantity(text, "m/s", "velocities") for text in texts]


def _required(text: str | None, unit: str, option: str, known: float | None = None) -> float:
    """A quantity of an option, in a unit such as "1/m" or "N"; without the option the `known`."""
    value = optional_quantity(text, unit, option)
    if value is None:
        value = known
    if value is None:
        raise InputError(f"{option} is missing; give one, as in {option} {EXAMPLES[option]}")
    return value
