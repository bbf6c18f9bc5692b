"""What a loop means and what to do next: the next command, or the run that would decide."""

import itertools
import shlex
from collections.abc import Sequence

import numpy as np

from ..effects import CATALOGUE, RunChange, separators
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
from .words import change_words, say

_MEMORY = "rate_and_state"
_SECOND, _LAW = "second_state", "ageing"
"""What `jaxfric fit --compare` asks of, by the ids of the loop."""
_ROOMS = {"machine": "the machine", "drive": "the drive", "sensor": "the force sensor"}


def meanings(loop: Loop) -> list[tuple[str, str, str]]:
    """For every added effect: its id and place in the model, its meaning, and its equation.

    Meaning and equation come from the catalogue; both are empty for an effect outside the
    catalogue.
    """
    found = []
    for id in loop.effects:
        effect = loop.words.catalogue.get(id)
        name = id if effect is None else f"{id} (in {_ROOMS.get(effect.room, effect.room)})"
        found.append((name, effect.meaning if effect else "", effect.equation if effect else ""))
    return found


def next_steps(loop: Loop, file: str = "loop.json") -> list[NextStep]:
    """The steps that follow from the verdict, the most informative first.

    A question that the record leaves open gives the run that would decide, and a command that
    checks this run. Gains follow if `jaxfric gains` accepts the loop, and for an axis the
    feedforward. If the model describes the record, the last step is a test on another record.

    `file` is the path of the loop's JSON file; by default it is in the folder of loop.html.
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


def _step(code: str, command: str = "", **values: object) -> NextStep:
    return NextStep(say(f"next.{code}", **values), command, code=code)


def _with_model(loop: Loop, file: str) -> list[NextStep]:
    """What to do with the model where it describes the record."""
    steps = []
    if takes_gains(loop):
        yours = "next.yours_both" if loop.record.friction_unit == "1" else "next.yours_mass"
        steps.append(_step("gains", _gains_line(loop, file), yours=say(yours)))
    known = any(one.code is LoopCode.FRICTION for one in loop.findings)
    if known and loop.verdict in CERTAIN:
        steps.append(_step("feedforward", f"jaxfric feedforward {file}"))
    if loop.verdict in CERTAIN:
        steps.append(_step("predict", f"jaxfric predict {file} OTHER.csv"))
    return [*steps, *_next_run(loop, file)]


def takes_gains(loop: Loop) -> bool:
    """Whether `jaxfric gains --from loop.json` computes gains with the model of this loop.

    Conditions: the verdict says that the model describes the record, the catalogue has all effects
    of the model, and the record determines all free parameters. For an axis, friction must also
    have a memory (rate_and_state), in newtons and metres.
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


def _wanted(loop: Loop) -> dict[str, tuple[str, ...]]:
    """Of every effect that the record cannot tell from others: what would."""
    from .loop_text import confused

    found = {id: loop.separations.get(id, ()) for id, _ in confused(loop)}
    if _asks_for_second(loop):
        found.setdefault(_SECOND, separators(CATALOGUE[_SECOND]))
    return {id: wanted for id, wanted in found.items() if wanted}


def _one_run(loop: Loop) -> PlannedRun | None:
    """The run with all that would tell what this record leaves open, as far as that changes its
    own velocities; None of an axis, and where it does not change them."""
    own, wanted = own_run(loop), _wanted(loop)
    if loop.words is AXIS or not wanted or not own.speeds:
        return None
    # time and slip grow together; a step at another velocity separates them
    apart = grow_together(loop.location, loop.base_fit.steps.velocities)
    another = [RunChange.DWELL] if apart else []
    run = deciding_run(own, [*itertools.chain(*wanted.values()), *another])
    return run if run.changes and min(run.speeds) > 0 else None


def _do_next(loop: Loop, run: PlannedRun, file: str) -> list[NextStep]:
    """The run to make next and what it has, then the commands that ask whether it tells."""
    from .loop_text import confused

    groups, wanted, own = dict(confused(loop)), _wanted(loop), own_run(loop)
    told, outside = [], []
    for id, changes in wanted.items():
        left = unplanned(run, changes)
        has = [one for one in changes if one not in left]
        other = _from(id, groups[id]) if id in groups else id
        told += [say("next.tells", effect=other, changes=change_words(has))] if has else []
        if left:
            outside.append(say("next.outside_one", changes=change_words(left), effect=id))
    comes = _begins_with(run, own) and loop.verdict == "outside_catalogue"
    values = {
        **_values_of(run),
        "run": run.words(),
        "told": "; ".join(told),
        "outside": say("next.outside", outside="; ".join(outside)) if outside else "",
        "time": say("next.time") if _new_velocity(loop, run, own) else "",
        "begins": say("next.begins", comes_back=say("next.comes_back")) if comes else "",
    }
    asks = _ask_leading(loop, file, run)
    asks += [step for id, others in groups.items() for step in _ask(loop, file, run, id, others)]
    return [_step("run", **values), *asks, *_of_families(loop)]


def _values_of(run: PlannedRun) -> dict[str, str]:
    return {
        "velocities": read_as(run.velocities()),
        "slip": f"{run.slip:.4g} {read_as(run.length)}",
    }


def run_to_make(loop: Loop) -> str:
    """The run that would decide the questions this record leaves open, in one line; "" if none."""
    run = _one_run(loop)
    return "" if run is None else say("next.run_to_make", **_values_of(run))


def _from(id: str, others: Sequence[str]) -> str:
    return say("next.effect_from", effect=id, others=listed(others, "or"))


def _begins_with(run: PlannedRun, own: PlannedRun) -> bool:
    return run.speeds[: len(own.speeds)] == own.speeds


def _new_velocity(loop: Loop, run: PlannedRun, own: PlannedRun) -> bool:
    """Whether the run has a velocity that tells variables which grow together in this record."""
    together = grow_together(loop.location, loop.base_fit.steps.velocities)
    return together and not set(run.speeds) <= set(own.speeds)


def _of_families(loop: Loop) -> list[NextStep]:
    """Of every steady curve whose shape is not told: where that would be."""
    return [
        _step("family", effects=listed(family.effects), where=where_told(family))
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
            values = {"others": listed(others, "or"), "changes": change_words(wanted)}
            found.append(_step("decides", effect=id, **values))
            if loop.words is not AXIS:
                run = deciding_run(own_run(loop), wanted)
                planned = say("next.planned", run=run.words())
                found += _ask(loop, file, run, id, others, planned)
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
    notes += [say("next.then", others=listed(more, "or"), other=first)] if more else []
    unasked = [other for other in others if not plannable(other)]
    notes += [say("next.unasked", others=listed(unasked, "or"))] if unasked else []
    values = {"effect": id, "other": first, "notes": "; ".join(notes)}
    line = f"jaxfric protocol {run.options()} --from {file} --distinguish {id},{first}"
    return [_step("ask_more" if notes else "ask", line, **values)]


def _ask_leading(loop: Loop, file: str, run: PlannedRun) -> list[NextStep]:
    """The command that asks whether a run tells the two from each other that would explain most
    but that this record does not fix; none where there are no two."""
    singles = [one.effects[0] for one in loop.unfixed() if len(one.effects) == 1]
    leading = [id for id in singles if plannable(id)][:2]
    if len(leading) < 2:
        return []
    a, b = leading
    line = f"jaxfric protocol {run.options()} --from {file} --distinguish {a},{b}"
    return [_step("ask_leading", line, effect=a, other=b)]


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
    notes = [say("next.own_velocities")]
    line = f"jaxfric protocol {run.options()} --from {file}"
    if not loop.effects:
        return [_step("size", line, notes=notes[0])]
    first, *more = loop.effects
    notes += [say("next.then", others=listed(more, "or"), other=first)] if more else []
    values = {"effect": first, "notes": "; ".join(notes)}
    return [_step("size_again", f"{line} --distinguish base,{first}", **values)]


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
        told.append(say("next.not_taken", gain=gain, why=words_of_refusal(why)))
    if alike:
        told.append(say("next.not_told", others=listed(alike, "or")))
    if not told:
        return []
    decides = run is None and _asks_for_second(loop)
    changes = change_words(separators(CATALOGUE[_SECOND]))
    what = say("next.compare_decides", changes=changes) if decides else ""
    return [_step("compare", told=" and ".join(told), decides=what)]


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
        again = run is None or not _begins_with(run, own_run(loop))
        back = say("next.comes_back")
        look = _step("look_again", comes_back=back) if again else _step("look")
        return [look, _step("own_effect")]
    if loop.verdict == "too_weak":
        parts = say("next.strokes" if loop.words is AXIS else "next.steps")
        return [_step("longer", parts=parts)]
    return []
