"""Changes of a run of velocity steps that tell effects from one another, as codes.

An effect lists those that separate it from its likes in `separated_by`; `report.words` says them.
"""

from enum import StrEnum


class RunChange(StrEnum):
    """A change of a run that a plan of velocity steps can have."""

    DECADES = "three_velocities_over_two_decades"
    REPEAT = "first_velocity_repeated"
    UP_AND_DOWN = "up_and_down_steps"
    LONG_STEPS = "steps_longer_than_3_L2"
    SLOW_DWELL = "slow_dwell"
    DWELL = "dwell"
    SLIP_CHANNEL = "slip_channel"
    LOAD_POINT_CHANNEL = "load_point_channel"
