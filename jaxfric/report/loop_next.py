"""What a closed loop means, and what to do next: the command that goes on, the run that decides."""

import shlex
from collections.abc import Sequence

import numpy as np

from ..effects import CATALOGUE
from ..loop.family import listed
from ..loop.findings import LoopCode
from ..loop.refusal import Fault, Refusal
from ..loop.result import CandidateScore, Loop
from ..loop.thresholds import ACCEPT
from ..saved.entry import CERTAIN
from ..units import factor, read_as
from .location_text import grow_together
from .loop_plan import PlannedRun, deciding_run, own_run, plannable, unplanned
from .report import NextStep
from .rig_words import AXIS
from .verdict_text import where_told, words_of_refusal

_MEMORY = "rate_and_state"
_SECOND, _LAW = "second_state", "ageing"
"""What `jaxfric fit --compare` asks of, by the ids of the loop."""
_COMES_BACK = "what comes back is friction or the machine, what does not was that day's"
_ROOMS = {"machine": "the machine", "drive": "the drive", "sensor": "the force sensor"}


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

    Where the record leaves something open the one run that would decide, with the command that asks
    whether it does, and the rest beside that; gains where `jaxfric gains` takes the loop; of an
    axis its feedforward; a test on another record where the model describes this one. `file` is
    where the loop lies: beside loop.html where nothing else is said.
    """
    file = shlex.quote(file)
    run = _one_run(loop)
    first = _deciding(loop, file) if run is None else _do_next(loop, run, file)
    rest = [*_beside_compare(loop, run), *_where_none(loop, run), *_with_model(loop, file)]
    if not first:
        return rest
    count = 2 if len(first) > 1 and first[1].command else 1
    beside = (step._replace(also=True) for step in (*first[count:], *rest))
    return [*first[:count], *beside]


def _with_model(loop: Loop, file: str) -> list[NextStep]:
    """What to do with the model where it describes the record."""
    steps = []
    if takes_gains(loop):
        own = "--mass is yours to state"
        if loop.record.friction_unit == "1":
            own = "--mass and --normal-force are yours to state"
        text = f"Find the smallest gains that hold it steady with this model ({own}):"
        steps.append(NextStep(text, _gains_line(loop, file)))
    known = any(one.code is LoopCode.FRICTION for one in loop.findings)
    if known and loop.verdict in CERTAIN:
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
    """The command for gains over the speeds that the record showed, of a controller at 1 kHz."""
    words = [f"jaxfric gains --from {file}"]
    if loop.words is not AXIS:
        words += ['--normal-force "500 N"'] if loop.record.friction_unit == "1" else []
        words += ['--mass "2 kg"']
    unit = loop.words.speed
    speeds = np.abs(loop.base_fit.steps.velocities) / factor(unit, "m/s", "velocity")
    speeds = speeds[speeds > 0]
    ends = list(dict.fromkeys(f"{speed:.4g}" for speed in (speeds.min(), speeds.max())))
    return " ".join([*words, f'--velocity "{"..".join(ends)} {unit}"', '--sample-time "1 ms"'])


def _wanted(loop: Loop) -> dict[str, str]:
    """Of every effect that the record cannot tell from others: what would, in words."""
    from .loop_text import confused

    found = {id: loop.separations.get(id, "") for id, _ in confused(loop)}
    if _asks_for_second(loop):
        found.setdefault(_SECOND, CATALOGUE[_SECOND].separated_by)
    return {id: wanted for id, wanted in found.items() if wanted}


def _one_run(loop: Loop) -> PlannedRun | None:
    """The run with all that would tell what this record leaves open, as far as that changes its
    own velocities; None of an axis, and where it does not change them."""
    own, wanted = own_run(loop), _wanted(loop)
    if loop.words is AXIS or not wanted or not own.speeds:
        return None
    # time and slip, which grow together, are told by a step at another velocity
    another = ["a dwell"] if grow_together(loop.location, loop.base_fit.steps.velocities) else []
    run = deciding_run(own, *wanted.values(), *another)
    return run if run.changes and min(run.speeds) > 0 else None


def _do_next(loop: Loop, run: PlannedRun, file: str) -> list[NextStep]:
    """The run to make next and what it has, then the commands that ask whether it tells."""
    from .loop_text import confused

    groups, wanted, own = dict(confused(loop)), _wanted(loop), own_run(loop)
    told, outside = [], []
    for id, text in wanted.items():
        left = unplanned(run, text)
        has = ", ".join(part for part in text.split(", ") if part not in left.split(", "))
        other = f"{id} from {listed(groups[id], 'or')}" if id in groups else id
        told += [f"{other}: {has}"] if has else []
        outside += [f"{left} ({id})"] if left else []
    each = f"{run.slip:.4g} {read_as(run.length)} each"
    text = f"Make this run: {run.words()}, {each}. It has what is known to tell {'; '.join(told)}."
    text += f" Not in this run: {'; '.join(outside)}." if outside else ""
    text += " Its other velocity tells time from slip." if _new_velocity(loop, run, own) else ""
    if _begins_with(run, own) and loop.verdict == "outside_catalogue":
        text += f" It begins with this record's velocities: of what is missing, {_COMES_BACK}."
    asks = _ask_leading(loop, file, run)
    asks += [step for id, others in groups.items() for step in _ask(loop, file, run, id, others)]
    return [NextStep(text), *asks, *_of_families(loop)]


def _begins_with(run: PlannedRun, own: PlannedRun) -> bool:
    return run.speeds[: len(own.speeds)] == own.speeds


def _new_velocity(loop: Loop, run: PlannedRun, own: PlannedRun) -> bool:
    """Whether the run has a velocity that tells variables which grow together in this record."""
    together = grow_together(loop.location, loop.base_fit.steps.velocities)
    return together and not set(run.speeds) <= set(own.speeds)


def _of_families(loop: Loop) -> list[NextStep]:
    """Of every steady curve whose shape is not told: where that would be."""
    return [
        NextStep(
            f"The shape of {listed(family.effects)} is not told. A run that would decide:"
            f" {where_told(family)}."
        )
        for family in loop.families
        if family.decided_by
    ]


def _deciding(loop: Loop, file: str) -> list[NextStep]:
    """The runs that would tell what this record leaves open, and the plans of them."""
    from .loop_text import confused

    found = []
    for id, others in confused(loop):
        wanted = loop.separations.get(id)
        if wanted:
            told = f"This record cannot tell {id} from {listed(others, 'or')}."
            found.append(NextStep(f"{told} A run that would decide: {wanted}."))
            if loop.words is not AXIS:
                run = deciding_run(own_run(loop), wanted)
                found += _ask(loop, file, run, id, others, f"planned: {run.words()}")
    return [*found, *_of_families(loop)]


def _ask(
    loop: Loop, file: str, run: PlannedRun, id: str, others: Sequence[str], said: str = ""
) -> list[NextStep]:
    """The command that asks whether a run tells an effect from its likeliest rival, before it is
    made; none where no plan can be asked for the two. `said` is put in brackets first."""
    from .loop_text import likeliest

    rivals = [other for other in likeliest(loop, id, others) if plannable(other)]
    if not (plannable(id) and rivals):
        return []
    first, *more = rivals
    notes = [said] if said else []
    notes += [f"then the same with {listed(more, 'or')} for {first}"] if more else []
    unasked = [other for other in others if not plannable(other)]
    notes += [f"no plan can be asked of {listed(unasked, 'or')}"] if unasked else []
    text = f"Whether it tells {id} from {first} is known before the run, and if not which change"
    text += f" would ({'; '.join(notes)}):" if notes else " would:"
    line = f"jaxfric protocol {run.options()} --from {file} --distinguish {id},{first}"
    return [NextStep(text, line)]


def _ask_leading(loop: Loop, file: str, run: PlannedRun) -> list[NextStep]:
    """The command that asks whether a run tells the two from each other that would explain most
    but that this record does not fix; none where there are no two."""
    singles = [one.effects[0] for one in loop.unfixed() if len(one.effects) == 1]
    leading = [id for id in singles if plannable(id)][:2]
    if len(leading) < 2:
        return []
    a, b = leading
    text = f"Whether it tells {a} from {b}, which would explain most, is known before the run:"
    line = f"jaxfric protocol {run.options()} --from {file} --distinguish {a},{b}"
    return [NextStep(text, line)]


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
    return [NextStep(text, f"{line} --distinguish base,{first}")]


def _beside_compare(loop: Loop, run: PlannedRun | None = None) -> list[NextStep]:
    """Why `jaxfric fit --compare` may ask for a second state where this loop does not, in a line.

    It knows laws alone, and all rows fit them. Nothing where the loop saw no sign of such a state.
    What would decide is said where no `run` that has it was named.
    """
    if loop.words is AXIS:
        return []
    refused, alike, told = _refused_second(loop), _like_second(loop), []
    if refused is not None:
        gain, why = refused
        told.append(f"does not take one (BIC {gain:.0f} lower, but {words_of_refusal(why)})")
    if alike:
        told.append(f"cannot tell one from {listed(alike, 'or')}")
    if not told:
        return []
    text = (
        "jaxfric fit --compare may ask for a second state of this record: it fits all rows, and"
        f" four laws alone. This loop {' and '.join(told)}."
    )
    what = f" What would decide: {CATALOGUE[_SECOND].separated_by}."
    return [NextStep(text + (what if run is None and _asks_for_second(loop) else ""))]


def _like_second(loop: Loop) -> list[str]:
    """Effects that the record cannot tell from a second state, or from each other beside one."""
    from .loop_text import confused

    groups = [{id, *others} for id, others in confused(loop)]
    return sorted({e for g in groups if _SECOND in g for e in g - {_SECOND, _LAW}})


def _asks_for_second(loop: Loop) -> bool:
    """Whether another run would say if there is a second state."""
    refused = _refused_second(loop)
    open_ = refused is not None or bool(_like_second(loop))
    return open_ and (refused is None or refused[1].code is Fault.NOT_FIXED)


def _refused_second(loop: Loop) -> tuple[float, Refusal] | None:
    """Of a second state that BIC asks for and the loop does not take: by how much BIC is lower than
    without it, and why it is refused."""
    known: dict[frozenset[str], CandidateScore] = {frozenset(c.effects): c for c in loop.ranked()}
    for effects, one in known.items():
        without = known.get(effects - {_SECOND})
        if _SECOND not in effects or _SECOND in loop.after.effects or without is None:
            continue
        gain = without.delta_bic - one.delta_bic
        if one.rejection and one.converged and one.physical and gain > ACCEPT:
            return gain, one.rejection
    return None


def _where_none(loop: Loop, run: PlannedRun | None = None) -> list[NextStep]:
    """What to do where no effect is named; to record it again where no `run` begins with it."""
    if loop.verdict == "outside_catalogue":
        look = "Look where it sits (location.png, in loop.html 'Where the structure sits')"
        if run is None or not _begins_with(run, own_run(loop)):
            look += f", and record the run again: {_COMES_BACK}"
        return [
            NextStep(f"{look}."),
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
