"""Sentences on next steps after a loop: another experiment, gains, feedforward, or a test."""

from collections.abc import Mapping

from ...effects import RunChange

NEXT: Mapping[str, str] = {
    "gains": "Find the smallest gains that keep the sliding steady with this model (replace the"
    " example values by those of your machine):",
    "feedforward": "Compensate the friction in the controller (formula, C function, table):",
    "predict": "Test the model on a record that it was not fitted to:",
    "run_to_make": "next run, to decide: {run}",
    "run": "Make this run: {run}. It can distinguish {told}.{lacking}",
    "channel": ", with a channel of slip",
    "effect_from": "{effect} from {others}",
    "lacks": " Not in this run: {changes}.",
    "lacks_one": "{changes} ({effect})",
    "family": "This record does not determine the shape of {effects}. A run that determines it"
    " has {where}.",
    "decides": "This record cannot distinguish {effect} from {others}. Distinguish them by a new"
    " run: {changes}.",
    "ask": "Check a run in advance: does it distinguish {effect} from {other}, and if not, which"
    " change of the run would?",
    "size": "Plan the next run, with the velocities of this record or others: how large must"
    " {effect} be to be identified?",
    "look": "See which variable the residual follows (location.png, in loop.html 'Where the"
    " structure sits'), and record the run again: structure that repeats comes from friction or"
    " the machine.",
    "own_effect": "Write an effect of your own, a class with an equation: `own=[...]` of"
    " close_loop in Python tries it beside the others.",
    "longer": "Record longer, with more {part}s or less noise. The effect is then identified, or"
    " it vanishes.",
}
"""A step by its code, and its parts."""

CHANGES: Mapping[RunChange, str] = {
    RunChange.DECADES: "three velocities over two decades",
    RunChange.REPEAT: "the first velocity repeated at the end",
    RunChange.UP_AND_DOWN: "up and down steps",
    RunChange.LONG_STEPS: "longer than 3 L2",
    RunChange.SLOW_DWELL: "a slow dwell",
    RunChange.DWELL: "a dwell",
    RunChange.SLIP_CHANNEL: "a slip channel",
    RunChange.LOAD_POINT_CHANNEL: "a load-point encoder channel",
}
"""Changes of a run that tell effects apart."""
