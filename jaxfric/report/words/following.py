"""What to do after a loop: a run that decides, gains, a feedforward, a test on another record."""

from collections.abc import Mapping

NEXT: Mapping[str, str] = {
    "gains": "Find the smallest gains that hold it steady with this model ({yours} to state):",
    "yours_mass": "--mass is yours",
    "yours_both": "--mass and --normal-force are yours",
    "feedforward": "Compensate its friction in the controller (formula, C function, table):",
    "predict": "See whether the model is true on a record that it has not seen:",
    "run": "Make this run: {run}, {slip} each. It has what is known to tell {told}.{outside}{time}"
    "{begins}",
    "tells": "{effect}: {changes}",
    "effect_from": "{effect} from {others}",
    "outside": " Not in this run: {outside}.",
    "outside_one": "{changes} ({effect})",
    "time": " Its other velocity tells time from slip.",
    "begins": " It begins with this record's velocities: of what is missing, {comes_back}.",
    "comes_back": "what comes back is friction or the machine, what does not was that day's",
    "family": "The shape of {effects} is not told. A run that would decide: {where}.",
    "decides": "This record cannot tell {effect} from {others}. A run that would decide:"
    " {changes}.",
    "ask": "Whether it tells {effect} from {other} is known before the run, and if not which"
    " change would:",
    "ask_more": "Whether it tells {effect} from {other} is known before the run, and if not which"
    " change would ({notes}):",
    "planned": "planned: {run}",
    "then": "then the same with {others} for {other}",
    "unasked": "no plan can be asked of {others}",
    "ask_leading": "Whether it tells {effect} from {other}, which would explain most, is known"
    " before the run:",
    "own_velocities": "planned: the record's own velocities, for you to change",
    "size": "How large an effect must be to be named by the next run is known before ({notes}):",
    "size_again": "From which size on the next run shows {effect} again is known before ({notes}):",
    "compare": "jaxfric fit --compare may ask for a second state of this record: it fits all rows,"
    " and four laws alone. This loop {told}.{decides}",
    "compare_decides": " What would decide: {changes}.",
    "not_taken": "does not take one (BIC {gain:.0f} lower, but {why})",
    "not_told": "cannot tell one from {others}",
    "look": "Look where it sits (location.png, in loop.html 'Where the structure sits').",
    "look_again": "Look where it sits (location.png, in loop.html 'Where the structure sits'), and"
    " record the run again: {comes_back}.",
    "own_effect": "An effect of your own is a class with an equation: `own=[...]` of close_loop in"
    " Python tries it beside the others.",
    "longer": "A longer record, more {parts} or less noise would name it or make it vanish.",
    "strokes": "strokes",
    "steps": "velocity steps",
}
"""A step by its code, and its parts."""

PLAN: Mapping[str, str] = {
    "changed": "the record's velocities with {changes}",
    "as_told": "the record's own velocities, which are such a run",
    "as_it_was": "the record's own velocities, for you to change to that run",
    "again": "the first repeated at the end",
    "dwell": "a slow dwell at {speed} appended",
    "then": "{change}, then {more}",
    "appended": "{more} appended",
    "longer": "steps of 4 L2",
    "channel": "a channel of slip recorded too",
    "decades": "three over two decades in their place",
}
"""A plan: how it differs from the record."""
