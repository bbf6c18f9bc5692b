"""What a closed loop means, and what to do next: the command that goes on, the run that decides."""

import shlex
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..effects import CATALOGUE
from ..laws.loop_source import CERTAIN
from ..loop.family import listed
from ..loop.result import CandidateScore, Loop
from ..loop.thresholds import ACCEPT
from ..loop.words import AXIS
from ..units import factor
from .loop_plan import deciding_run, own_run, plannable

_MEMORY = "rate_and_state"
_SECOND, _LAW = "second_state", "ageing"
"""What `jaxfric compare` asks of, by the ids of the loop."""
_LOOSE = "not fixed"
_ROOMS = {"machine": "the machine", "drive": "the drive", "sensor": "the force sensor"}


class NextStep(NamedTuple):
    """Something to do: a sentence, and the command line where there is one."""

    text: str
    command: str = ""


def meanings(loop: Loop) -> list[tuple[str, str, str]]:
    """Of every effect that was added: its id and room, what it says in words, and its equation.

    Words and equation are those of the catalogue; both are empty for an effect that is not in it.
    """
    found = []
    for id in loop.effects:
        effect = loop.words.catalogue.get(id)
        name = id if effect is None else f"{id} (in {_ROOMS.get(effect.room, effect.room)})"
        found.append((name, effect.meaning if effect else "", effect.equation if effect else ""))
    return found


def next_steps(loop: Loop, file: str = "loop.json") -> list[NextStep]:
    """What the verdict asks for, most telling first.

    Of an ambiguous one the run that would decide; gains where `jaxfric gains` takes the loop; of
    an axis its feedforward; a test on another record where the model describes this one. `file` is
    where the loop lies: beside loop.html where nothing else is said.
    """
    file = shlex.quote(file)
    steps = [*_deciding(loop, file), *_beside_compare(loop), *_where_none(loop)]
    if takes_gains(loop):
        own = "--mass is yours to state"
        if loop.record.friction_unit == "1":
            own = "--mass and --normal-force are yours to state"
        text = f"Find the smallest gains that hold it steady with this model ({own}):"
        steps.append(NextStep(text, _gains_line(loop, file)))
    if loop.words is AXIS and loop.verdict in CERTAIN:
        text = "Compensate its friction in the controller (formula, C function, table):"
        steps.append(NextStep(text, f"jaxfric feedforward {file}"))
    if loop.verdict in CERTAIN:
        text = "See whether the model is true on a record that it has not seen:"
        steps.append(NextStep(text, f"jaxfric predict {file} OTHER.csv"))
    return [*steps, *_next_run(loop, file)]


def takes_gains(loop: Loop) -> bool:
    """Whether `jaxfric gains --from loop.json` computes gains with the model of this loop.

    Its verdict must say that the model describes the record, its effects be those of the
    catalogue, and its free parameters determined; of an axis, friction must have a memory
    (rate_and_state) and be in newtons and metres.
    """
    after = loop.after
    known = set(after.effects) <= set(loop.words.catalogue)
    sure = all(after.parameters[name].determined for name in after.free)
    if not (loop.verdict in CERTAIN and known and sure):
        return False
    if loop.words is AXIS:
        linear = loop.length_unit == "m" and loop.record.friction_unit == "N"
        return linear and _MEMORY in after.effects
    return loop.record.friction_unit in ("1", "N")


def _gains_line(loop: Loop, file: str) -> str:
    """The command for gains over the speeds that the record showed."""
    words = [f"jaxfric gains --from {file}"]
    if loop.words is not AXIS:
        words += ['--normal-force "500 N"'] if loop.record.friction_unit == "1" else []
        words += ['--mass "2 kg"']
    unit = loop.words.speed
    speeds = np.abs(loop.base_fit.steps.velocities) / factor(unit, "m/s", "velocity")
    speeds = speeds[speeds > 0]
    ends = list(dict.fromkeys(f"{speed:.4g}" for speed in (speeds.min(), speeds.max())))
    return " ".join([*words, f'--velocity "{"..".join(ends)} {unit}"'])


def _deciding(loop: Loop, file: str) -> list[NextStep]:
    """The runs that would tell what this record leaves open, and the plans of them."""
    from .loop_text import confused

    found = []
    for id, others in confused(loop):
        wanted = loop.separations.get(id)
        if wanted:
            told = f"This record cannot tell {id} from {listed(others, 'or')}."
            found.append(NextStep(f"{told} A run that would decide: {wanted}."))
            found += _plan(loop, file, wanted, id, others)
    for family in loop.families:
        if family.decided_by:
            told = f"The shape of {listed(family.effects)} is not told."
            found.append(NextStep(f"{told} A run that would decide: {family.wanted()}."))
    return found


def _plan(loop: Loop, file: str, wanted: str, id: str, others: Sequence[str]) -> list[NextStep]:
    """The command that asks whether the run that is wanted tells an effect from its likeliest
    rival, before it is made; none of an axis, and where no plan can be asked for the two."""
    from .loop_text import likeliest

    rivals = [other for other in likeliest(loop, id, others) if plannable(other)]
    if loop.words is AXIS or not (plannable(id) and rivals):
        return []
    run, (first, *more) = deciding_run(own_run(loop), wanted), rivals
    rest = f"; then the same with {listed(more, 'or')} for {first}" if more else ""
    unasked = [other for other in others if not plannable(other)]
    rest += f"; no plan can be asked of {listed(unasked, 'or')}" if unasked else ""
    text = f"Whether it tells {id} from {first} is known before the run (planned: {run.words()}"
    line = f"jaxfric protocol {run.options()} --from {file} --tell {id},{first}"
    return [NextStep(f"{text}{rest}):", line)]


def _next_run(loop: Loop, file: str) -> list[NextStep]:
    """After a clear verdict on a slider: what the next run would show, by a plan of this one.

    Of effects that were named, from which size on it shows them again; where none is missing, how
    large one must be to be named. Nothing where the plan is none that can be asked for.
    """
    clear = loop.verdict in ("effects", "no_missing_effect") and loop.words is not AXIS
    run, effects = own_run(loop), loop.after.effects
    possible = len(set(run.speeds)) > 1 and min(run.speeds) > 0
    if not (clear and possible and all(map(plannable, effects))):
        return []
    planned = "planned: the record's own velocities, for you to change"
    line = f"jaxfric protocol {run.options()} --from {file}"
    if not loop.effects:
        text = f"How large an effect must be to be named by the next run is known before ({planned}"
        return [NextStep(f"{text}):", line)]
    first, *more = loop.effects
    rest = f"; then the same with {listed(more, 'or')} for {first}" if more else ""
    text = f"From which size on the next run shows {first} again is known before ({planned}{rest}):"
    return [NextStep(text, f"{line} --tell base,{first}")]


def _beside_compare(loop: Loop) -> list[NextStep]:
    """Why `jaxfric compare` may ask for a second state where this loop does not, in a line.

    It knows laws alone, and all rows fit them. Nothing where the loop saw no sign of such a state.
    """
    from .loop_text import confused

    if loop.words is AXIS:
        return []
    refused = _refused_second(loop)
    told = []
    if refused is not None:
        gain, why = refused
        told.append(f"does not take one (BIC {gain:.0f} lower, but {why})")
    groups = [{id, *others} for id, others in confused(loop)]
    alike = dict.fromkeys(e for g in groups if _SECOND in g for e in g - {_SECOND, _LAW})
    if alike:
        told.append(f"cannot tell one from {listed(sorted(alike), 'or')}")
    if not told:
        return []
    text = (
        "jaxfric compare may ask for a second state of this record: it fits all rows, and four laws"
        f" alone. This loop {' and '.join(told)}."
    )
    decides = refused is None or refused[1].endswith(_LOOSE)
    what = f" What would decide: {CATALOGUE[_SECOND].separated_by}." if decides else ""
    return [NextStep(text + what)]


def _refused_second(loop: Loop) -> tuple[float, str] | None:
    """Of a second state that BIC asks for and the loop does not take: by how much BIC is lower than
    without it, and why it is refused."""
    known: dict[frozenset[str], CandidateScore] = {frozenset(c.effects): c for c in loop.ranked()}
    for effects, one in known.items():
        without = known.get(effects - {_SECOND})
        if _SECOND not in effects or _SECOND in loop.after.effects or without is None:
            continue
        gain = one.delta_bic - without.delta_bic
        if one.refused and one.converged and one.physical and gain > ACCEPT:
            return gain, one.refused
    return None


def _where_none(loop: Loop) -> list[NextStep]:
    """What to do where no effect is named."""
    if loop.verdict == "outside_catalogue":
        return [
            NextStep(
                "Look where it sits (below), and record the run again: what comes back is friction"
                " or the machine, what does not was that day's."
            ),
            NextStep(
                "An effect of your own is a class with an equation: `own=[...]` of close_loop in"
                " Python tries it beside the others."
            ),
        ]
    if loop.verdict == "too_weak":
        part = "strokes" if loop.words is AXIS else "velocity steps"
        text = f"A longer record, more {part} or less noise would name it or make it vanish."
        return [NextStep(text)]
    return []
