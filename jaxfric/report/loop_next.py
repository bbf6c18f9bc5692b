"""Say what a loop's result means, and which command or experiment to try next."""

import shlex

import numpy as np

from ..loop.family import listed
from ..loop.findings import LoopCode
from ..loop.result import Loop
from ..saved.entry import CERTAIN
from ..units import factor
from .aliases import confused, likeliest
from .loop_plan import PlannedRun, deciding_run, own_run, plannable, unplanned
from .report import NextStep
from .rig_words import AXIS
from .verdict_text import where_told
from .words import change_words, say

_MEMORY = "rate_and_state"
_WITHOUT = {"outside_catalogue": ("look", "own_effect"), "too_weak": ("longer",)}
"""Steps where no effect is named, by verdict."""
_ROOMS = {"machine": "the machine", "drive": "the drive", "sensor": "the force sensor"}


def meanings(loop: Loop) -> list[tuple[str, str, str]]:
    """Return id, place in the model, meaning and equation of every added effect.

    Meaning and equation of an effect come from the catalogue. For an effect outside the catalogue,
    meaning and equation are empty.
    """
    found = []
    for id in loop.effects:
        effect = loop.words.catalogue.get(id)
        name = f"{id} (in {_ROOMS.get(effect.room, effect.room)})" if effect else id
        found.append((name, effect.meaning if effect else "", effect.equation if effect else ""))
    return found


def next_steps(loop: Loop, file: str = "loop.json") -> list[NextStep]:
    """Next steps that follow from the loop's verdict, the most informative step first.

    If the record leaves a question open, a step describes the experiment that would decide. The
    step includes a command that checks the planned experiment. If something is missing that the
    catalogue does not explain, the named effects may be imitations. No step then distinguishes them
    from similar effects; the first step finds where the residual sits. The next step is
    `jaxfric gains` if it accepts the loop, and for an axis `jaxfric feedforward`. If the model
    describes the record, the last step is a test on another record.

    `file` is the path of the loop's JSON file; by default it is in the folder of loop.html.
    """
    file = shlex.quote(file)
    first = [] if loop.verdict == "outside_catalogue" else _deciding(loop, file)
    for family in loop.families:
        if family.decided_by:
            values = {"effects": listed(family.effects), "where": where_told(family)}
            first.append(_step("family", **values))
    without = [_step(code, part=loop.words.part) for code in _WITHOUT.get(loop.verdict, ())]
    rest = [*without, *_with_model(loop, file)]
    if not first:
        return rest
    count = 2 if len(first) > 1 and first[1].command else 1
    beside = (step._replace(also=True) for step in (*first[count:], *rest))
    return [*first[:count], *beside]


def _step(code: str, command: str = "", **values: object) -> NextStep:
    return NextStep(say(f"next.{code}", **values), command, code=code)


# ---- with the model ------------------------------------------------------------------------------


def _with_model(loop: Loop, file: str) -> list[NextStep]:
    """What to do with the model where it describes the record."""
    if loop.verdict not in CERTAIN:
        return _next_run(loop, file)
    gains = takes_gains(loop) and loop.after.sign_is_known
    steps = [_step("gains", _gains_line(loop, file))] if gains else []
    if any(one.code is LoopCode.FRICTION for one in loop.findings):
        steps.append(_step("feedforward", f"jaxfric feedforward {file}"))
    if {*loop.before.effects, *loop.effects} <= set(loop.words.catalogue):
        steps.append(_step("predict", f"jaxfric predict {file} OTHER.csv"))
    return [*steps, *_next_run(loop, file)]


def takes_gains(loop: Loop) -> bool:
    """Whether `jaxfric gains --from loop.json` computes gains with the model of this loop.

    Conditions: the verdict says that the model describes the record, the catalogue has all effects
    of the model, and the record determines all free parameters. For an axis, friction must also
    have a memory (rate_and_state), and units must be newtons and metres.
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
    line = f"jaxfric protocol {run.options()} --from {file}"
    first = loop.effects[0] if loop.effects else ""
    line += f" --distinguish base,{first}" if first else ""
    return [_step("size", line, effect=first or "an effect")]


# ---- what would decide ---------------------------------------------------------------------------


def run_to_make(loop: Loop) -> PlannedRun | None:
    """Plan one run with all changes that would decide what this record leaves open.

    The result is None for an axis, and if no change alters the record's own velocities.
    """
    own = own_run(loop)
    wanted = [one for id, _ in confused(loop) for one in loop.separations.get(id, ())]
    if loop.words is AXIS or not wanted or not own.speeds:
        return None
    run = deciding_run(own, wanted)
    return run if run != own and min(run.speeds) > 0 else None


def _deciding(loop: Loop, file: str) -> list[NextStep]:
    """The run that would tell what this record leaves open, and the commands that check it.

    The first step names the effects that the run can tell apart, and the changes that it lacks.
    Without one run for all questions: what would answer each.
    """
    run, steps, told, lacks = run_to_make(loop), [], [], []
    for id, others in confused(loop):
        wanted, alike = loop.separations.get(id, ()), listed(others, "or")
        if run is None and wanted:
            steps.append(_step("decides", effect=id, others=alike, changes=change_words(wanted)))
        if run is not None:
            left = unplanned(run, wanted)
            told += [f"{id} from {alike}"] if len(left) < len(wanted) else []
            lacks += [f"{change_words(left)} ({id})"] if left else []
        if run is not None or (wanted and loop.words is not AXIS):
            rival = next(filter(plannable, likeliest(loop, id, others)), None)
            if rival is not None and plannable(id):
                line = f"jaxfric protocol {(run or own_run(loop)).options()} --from {file}"
                line = f"{line} --distinguish {id},{rival}"
                steps.append(_step("ask", line, effect=id, other=rival))
    if run is None:
        return steps
    lacking = f" Not in this run: {'; '.join(lacks)}." if lacks else ""
    return [_step("run", run=run.words(), told="; ".join(told), lacking=lacking), *steps]
