"""Next steps after a loop: a run that decides, gains, a feedforward, a test on another record."""

from collections.abc import Mapping

NEXT: Mapping[str, str] = {
    "gains": "Find the smallest gains that keep the sliding steady with this model (you state"
    " {yours}):",
    "yours_mass": "--mass",
    "yours_both": "--mass and --normal-force",
    "feedforward": "Compensate the friction in the controller (formula, C function, table):",
    "predict": "Test the model on a record that it was not fitted to:",
    "run_to_make": "next run, to decide: {velocities}, {slip} each",
    "run": "Make this run: {velocities}, {slip} each ({run}). It can distinguish {told}.{outside}"
    "{time}{begins}",
    "tells": "{effect}: {changes}",
    "effect_from": "{effect} from {others}",
    "outside": " Not in this run: {outside}.",
    "outside_one": "{changes} ({effect})",
    "time": " The other velocity of this run separates time from slip.",
    "begins": " The run begins with the velocities of this record: {comes_back}.",
    "comes_back": "structure that repeats comes from friction or the machine, structure that does"
    " not repeat from the day of this record",
    "family": "This record does not determine the shape of {effects}. A run that determines it"
    " has {where}.",
    "decides": "This record cannot distinguish {effect} from {others}. Distinguish them by a new"
    " run: {changes}.",
    "ask": "Check a run in advance: does it distinguish {effect} from {other}, and if not, which"
    " change of the run would?",
    "ask_more": "Check a run in advance: does it distinguish {effect} from {other}, and if not,"
    " which change of the run would ({notes})?",
    "planned": "planned: {run}",
    "then": "then the same with {others} in place of {other}",
    "unasked": "no plan can be tested for {others}",
    "ask_leading": "Check a run in advance: does it distinguish {effect} from {other}, the effect"
    " that explains most?",
    "own_velocities": "planned: the velocities of this record, for you to change",
    "size": "Plan the next run: how large must an effect be to be identified ({notes})?",
    "size_again": "Plan the next run: how large must {effect} be to appear again ({notes})?",
    "compare": "jaxfric fit --compare may prefer a second state for this record, because it fits"
    " all rows and tries only four laws. This loop {told}.{decides}",
    "compare_decides": " A run that would decide: {changes}.",
    "not_taken": "does not add one (BIC {gain:.0f} lower, but {why})",
    "not_told": "cannot distinguish one from {others}",
    "look": "See which variable the residual follows (location.png, in loop.html 'Where the"
    " structure sits').",
    "look_again": "See which variable the residual follows (location.png, in loop.html 'Where the"
    " structure sits'), and record the run again: {comes_back}.",
    "own_effect": "Write an effect of your own, a class with an equation: `own=[...]` of"
    " close_loop in Python tries it beside the others.",
    "longer": "Record longer, with more {parts} or less noise. The effect is then identified, or"
    " it vanishes.",
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
