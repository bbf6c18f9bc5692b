"""Words for where the structure of a residual sits."""

from collections.abc import Mapping

VARIABLE: Mapping[str, str] = {
    "log_velocity": "velocity",
    "slip_since_step": "the slip since a step",
    "since_reversal": "the distance since a stop",
    "time_since_step": "the time since a step",
    "state": "the state",
    "periodic_in_slip": "a ripple along the path",
    "none": "not explained",
    "others": "all others together",
}
"""A variable of a profile; another is called by its name."""

QUESTION: Mapping[str, str] = {
    "block_means": "slow changes along the record",
    "step_locked": "the same shape after every change of velocity",
    "slip": "follows the slip",
    "position": "follows the position",
    "time": "follows time",
    "log_velocity": "follows the velocity",
    "velocity": "follows the velocity",
    "state": "follows the state of the contact",
    "time_since_step": "follows the time since a step",
    "slip_since_step": "follows the slip since a step",
    "since_reversal": "follows the distance since a stop",
    "periodic_in_slip": "a ripple along the path",
}
"""The structure that each test looks for, by the name of the test or variable."""

LOCATION: Mapping[str, str] = {
    "smooth": "A smooth curve would explain {share} of what the base model leaves, along any of"
    " several variables. {alike}",
    "best_p": "What the base model leaves {does} best ({p}).",
    "one": "Friction that {does} would explain {share} of what the base model leaves.",
    "two": "Friction that {does}, either alone, would explain about {share} of what the base model"
    " leaves.",
    "several": "Friction that {does}, each alone, would explain about {share} of what the base"
    " model leaves.",
    "alike_one_step": "With one velocity step {variables} grow together: but for the shape of a"
    " curve this record cannot tell them apart; a second step or a hold would.",
    "alike": "{variables} explain about as much: this record cannot tell them apart; steps at"
    " other velocities or a hold would.",
    "follows": "follows {variables}",
    "ripples": "ripples along the path",
    "only_noise": "Over no variable does the base model leave more than noise alone gives.",
    "no_shares": "It is too little beside the noise to be parted into shares.",
    "nothing": "What the base model leaves is no more than noise: there is nothing to place.",
    "unexplained": "No variable explains what the base model leaves.",
    "carries": "{subject} carries {share} of what the model lacks.",
    "curve": "a smooth curve",
    "rivals": "{rivals} in its place would explain about as much.",
    "bars": "Each bar below the first is what that variable explains beyond those above.",
    "share": "{percent:.0f} %",
    "small_share": "less than 1 %",
}
"""Sentences on the location, and their parts."""
