"""Codes of the changes to a run of velocity steps that distinguish one effect from another.

`separated_by` of an effect lists the changes that distinguish it from similar effects.
`report.words` puts the codes into words.
"""

from enum import StrEnum


class RunChange(StrEnum):
    """A change to a run that a plan of velocity steps can include."""

    DECADES = "three_velocities_over_two_decades"
    REPEAT = "first_velocity_repeated"
    UP_AND_DOWN = "up_and_down_steps"
    LONG_STEPS = "steps_longer_than_3_L2"
    SLOW_DWELL = "slow_dwell"
    DWELL = "dwell"
    SLIP_CHANNEL = "slip_channel"
    LOAD_POINT_CHANNEL = "load_point_channel"
