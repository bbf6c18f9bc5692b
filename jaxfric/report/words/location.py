"""Words for the variables that the structure of a residual follows."""

from collections.abc import Mapping

VARIABLE: Mapping[str, str] = {
    "log_velocity": "velocity",
    "slip_since_step": "the slip since a step",
    "since_reversal": "the distance since a stop",
    "time_since_step": "the time since a step",
    "state": "the state",
    "periodic_in_slip": "a ripple along the path",
    "block_means": "slow changes along the record",
    "step_locked": "the same shape after every change of velocity",
    "none": "not explained",
}
"""A variable of a profile or the structure of a test; another is called by its name."""

LOCATION: Mapping[str, str] = {
    "best_p": "The residual of the base model follows {variable} best ({p}).",
    "would": "{subjects} alone would explain {share} of the residual of the base model.",
    "alike": "{variables} grow together in this record, which cannot distinguish them. Steps at"
    " other velocities or a hold would separate them.",
    "only_noise": "The residual of the base model follows no variable more than noise does.",
    "no_shares": "This residual is too small compared with the noise to be divided into shares.",
    "nothing": "The residual of the base model is consistent with noise: there is nothing to"
    " locate.",
    "unexplained": "No variable explains the residual of the base model.",
    "bars": "Each bar below the first shows what its variable explains beyond the variables above.",
    "share": "{percent:.0f} %",
    "small_share": "less than 1 %",
}
"""Sentences on the location, and their parts."""
