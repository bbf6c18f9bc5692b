"""`jaxfric protocol`: what will a planned sequence of velocity steps be able to tell apart?"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple, TypeVar

from cyclopts import Parameter

from ..errors import InputError, did_you_mean
from ..pairs import read_pairs
from . import options
from .call import current_call
from .common import effect_ids, optional_quantity, prepare_jax, told
from .folder import choose_folder, source_name
from .plan_line import changed_line
from .shown import show

if TYPE_CHECKING:
    from ..protocol.design import Change, Pair, Protocol
    from ..protocol.remedy import Remedy

TYPICAL = "f0=0.6, A=0.010, B=0.014, L=20 um"
"""A friction coefficient where neither a fit nor parameters are given."""
EXAMPLES = {"--slip-per-step": "150um", "--stiffness": "5e-3/um", "--noise": "3e-4"}
"""Values of the options that are required."""
T = TypeVar("T")


@options.FLAT
@dataclasses.dataclass(frozen=True)
class PlanOptions:
    """The planned experiment, and the pair of effects to distinguish."""

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
    """Two effects to distinguish, 'ageing,second_state'. Or an effect and base (the law without
    effects). The first line answers whether the plan distinguishes them. The base model then omits
    these two even if the file of --from has them."""
    from_: options.From = None
    law: Annotated[str | None, options.LAW] = None
    parameters: options.Parameters = None


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
    """Before an experiment, compute which effects it can distinguish, and how to improve it.

    Writes protocol.json and the figure aliasing to the output folder, by default ./protocol/
    with the options that differ from their default.
    """
    declared, excluded = effects.ids()
    wrong = _Wrong()
    commanded = wrong.of(lambda: read_velocities(velocities))
    slip = wrong.of(lambda: _given(how.slip_per_step, "m", "--slip-per-step"))
    slip_noise = wrong.of(lambda: optional_quantity(how.slip_channel, "m", "--slip-channel"))
    asked = wrong.of(lambda: _pair_of(how.distinguish))
    with told() as progress:
        base = wrong.of(lambda: _base(how.from_, how.parameters, how.law, how.stiffness))
        known, found_law, unit, more, warned = base or ({}, "", "1", (), ())
        K, sigma = known.pop("K", None), known.pop("noise", None)
        if base or how.stiffness is None:
            K = wrong.of(lambda: _size(how.stiffness, f"{unit}/m", "--stiffness", K))
        if base or how.noise is None:
            sigma = wrong.of(lambda: _size(how.noise, unit, "--noise", sigma))
        wrong.refuse()
        assert commanded is not None and slip is not None and K is not None and sigma is not None
        prepare_jax()
        from ..plot.loop import save_aliasing
        from ..protocol.plan import Planned, plan

        values, more = _without_asked(known, more, asked or (), declared)
        if asked is not None:
            asked = _known_pair(asked, found_law, (*more, *declared), excluded)
        source = [how.from_] if how.from_ else []
        folder = choose_folder(output.folder, "".join(map(source_name, source)), *source)
        found = plan(
            Planned(
                commanded,
                slip_per_step=slip,
                stiffness=K,
                noise=sigma,
                parameters=values,
                law=found_law,
                friction_unit=unit,
                rows=how.rows,
                slip_noise=slip_noise,
                noise_from=str(how.from_) if how.noise is None else "--noise",
            ),
            with_=tuple(dict.fromkeys((*more, *declared))),
            without=excluded,
            progress=progress,
        )
        answer = _Answer() if asked is None else _answer(found, asked, known)
        found = dataclasses.replace(found, warnings=(*answer.small, *warned, *found.warnings))
        progress("drawing figures")
        content = folder.save_json("protocol.json", found.to_json() | answer.to_json())
        ids, cosines = found.design.ids, found.design.cosines
        folder.draw("aliasing", lambda to: save_aliasing(ids, cosines, to, what="this plan"))
    from ..report.protocol_text import report
    from ..report.report import NextStep

    typical = how.from_ is None and how.parameters is None
    pair, better, line, _, less = answer
    told_of = report(found, typical=typical, pair=pair, better=better, less=less)
    steps = [NextStep("", line)] if line else []
    show(told_of._replace(next_steps=steps), folder.written, content, output)
    return folder.close()


class _Answer(NamedTuple):
    """What is told of the pair that --distinguish asks for; empty where none is asked for."""

    pair: "Pair | None" = None
    better: "Remedy | None" = None
    line: str = ""
    """The command of the plan with the change of `better`."""
    small: Sequence[str] = ()
    less: "Change | None" = None
    """A change that is told of in place of `better`, as it takes less time."""

    def to_json(self) -> dict[str, object]:
        """The part of protocol.json."""
        if self.pair is None:
            return {}
        better = self.better
        line = {"command": self.line or None}
        change = None if better is None else better.to_json() | line
        less = None if self.less is None else self.less.planned() | line
        return {"asked": self.pair.to_json() | {"change": change, "shorter": less}}


def _answer(found: "Protocol", asked: tuple[str, str], known: Mapping[str, float]) -> _Answer:
    from ..protocol.remedy import remedy, shorter
    from ..report.protocol_text import found_too_small

    pair, better = found.design.pair(*asked), remedy(found, asked, known)
    less = shorter(found, asked, known) if better is None else None
    change = less if better is None else better.change
    line = "" if change is None else changed_line(current_call(), change)
    return _Answer(pair, better, line, found_too_small(found, pair, known), less)


class _Wrong:
    """What is wrong with the options: all of it is told at once."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def of(self, read: Callable[[], T]) -> T | None:
        """What `read` gives; None where it refuses."""
        try:
            return read()
        except InputError as error:
            self.texts.append(str(error))
            return None

    def refuse(self) -> None:
        """Raises `InputError` with all that was wrong."""
        if self.texts:
            raise InputError("; and ".join(self.texts))


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


def _without_asked(
    values: Mapping[str, float], of_file: Sequence[str], asked: Sequence[str], typed: Sequence[str]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Parameters, and effects of the base that a file has, without the effects that are asked for:
    a loop found them, and whether they would be told is the question. Those of --include stay."""
    gone = {id for id in asked if id in of_file and id not in typed}
    kept = {name: value for name, value in values.items() if name.split(".")[0] not in gone}
    return kept, tuple(id for id in of_file if id not in gone)


def _known_pair(
    ids: tuple[str, str], law: str, with_: Sequence[str], without: Sequence[str]
) -> tuple[str, str]:
    """The pair by the ids of a plan; the law of the base model is the base."""
    from ..effects import CATALOGUE
    from ..laws.registry import takes
    from ..protocol.design import BASE

    effects = {id: effect for id, effect in CATALOGUE.items() if effect.channel is None}
    known = [id for id, effect in effects.items() if id not in without and takes(law, effect)]
    a, b = (BASE if id == law and id not in known else id for id in ids)
    for id in (a, b):
        if id in with_:
            raise InputError(
                f"--distinguish: the base model has {id} (--include); ask for another effect"
            )
        if id not in known and id != BASE:
            names = (BASE, *known)
            raise InputError(
                f"--distinguish: no effect '{id}' in this plan{did_you_mean(id, names)}"
            )
    if a == b:
        raise InputError(f"--distinguish: both are the base model, the {law} law; name an effect")
    return a, b


def read_velocities(text: str) -> list[float]:
    """Velocities [m/s] of a text in their order; one without a unit takes the last one's."""
    from ..units import parse_quantity

    pieces = [piece.strip() for piece in text.split(",")]
    if not all(pieces):
        raise InputError(f"velocities: '{text}' is no list; write it as in '1, 10, 1 um/s'")
    unit = pieces[-1].lstrip("+-0123456789.eE").strip()
    if not unit:
        raise InputError(f"velocities: '{text}' has no unit; write it as in '1, 10, 1 um/s'")
    out = []
    for piece in pieces:
        bare = not piece.lstrip("+-0123456789.eE")
        value = parse_quantity(f"{piece} {unit}" if bare else piece, "m/s", "velocities")
        if not value > 0:
            raise InputError(
                f"velocities: '{piece}' is not positive; a protocol takes forward motion only"
            )
        out.append(value)
    return out


def _given(text: str | None, unit: str, option: str) -> float:
    """A quantity of an option that is required."""
    value = optional_quantity(text, unit, option)
    if value is None:
        raise InputError(f"{option} is missing; give one, as in {option} {EXAMPLES[option]}")
    return value


def _size(text: str | None, unit: str, option: str, known: float | None) -> float:
    """A positive quantity in a unit such as "1/m" or "N", of an option or known from a file."""
    if text is None and known is not None:
        return known
    value = _given(text, unit, option)
    if not value > 0:
        raise InputError(f"{option}: '{text}' is not positive")
    return value


def _base(
    file: Path | None, parameters: str | None, law: str | None, stiffness: str | None
) -> tuple[dict[str, float], str, str, tuple[str, ...], tuple[str, ...]]:
    """Parameters (SI), law, unit of friction, effects that the base has, and warnings."""
    from ..units import has_dimension

    if file is not None:
        if parameters is not None or law is not None:
            raise InputError("--from excludes --law and --parameters; give one")
        return _from_file(file)
    unit = "N" if stiffness is not None and has_dimension(stiffness, "N/m") else "1"
    if parameters is None and unit == "N":
        raise InputError(
            "--stiffness is of a force, so --parameters in newtons are needed, as in"
            " 'f0=30 N, A=0.5 N, B=0.7 N, L=20 um'"
        )
    values = _from_text(TYPICAL if parameters is None else parameters, unit)
    return values, law or "slip", unit, (), ()


def _from_text(text: str, unit: str) -> dict[str, float]:
    from ..fitting.problem import quantity_of
    from ..units import parse_quantity

    values: dict[str, float] = {}
    for name, value in read_pairs(text, "--parameters", f"'{TYPICAL}'").items():
        if name.rstrip("0123456789") not in ("A", "B", "L") and name not in ("f0", "V0"):
            raise InputError(f"--parameters: '{name}' is unknown; there are: f0, A, B, L, V0")
        about = quantity_of(name)
        values[name] = parse_quantity(
            value, about.unit_for(unit).replace(" ", "*"), f"--parameters: {name}"
        )
    return values


def _from_file(
    path: Path,
) -> tuple[dict[str, float], str, str, tuple[str, ...], tuple[str, ...]]:
    """Inputs of a plan from a fit.json, or from the fit after the loop of a loop.json."""
    from ..saved.entry import law_in
    from ..saved.files import own_warnings, read_saved
    from ..schemas import FIT, LOOP

    _, content = read_saved(path, FIT, LOOP)
    fitted = law_in(path, content)
    if fitted.is_axis:
        raise InputError(
            f"{path}: it is of an axis, and a protocol is of a slider; give a fit.json, or the"
            " loop.json of 'jaxfric loop'"
        )
    stiffness, noise = (
        _numbers(content, K="stiffness"),
        _numbers(content.get("noise"), noise="sigma"),
    )
    effects = tuple(effect.id for effect in fitted.effects)
    values = {**stiffness, **fitted.parameters, **noise}
    return values, fitted.name, fitted.friction_unit, effects, own_warnings(content)


def _numbers(table: object, **keys: str) -> dict[str, float]:
    """Numbers of a table of a file, as far as there are, under other names."""
    known = table if isinstance(table, dict) else {}
    found = {name: known.get(key) for name, key in keys.items()}
    return {name: float(v) for name, v in found.items() if isinstance(v, int | float)}
