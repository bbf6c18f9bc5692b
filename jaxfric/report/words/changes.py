"""Words for changes of a run that tell effects apart."""

from collections.abc import Mapping

from ...effects import RunChange

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
