"""Read measured records and find their velocity steps. This package does not need JAX."""

from .axis_record import AxisRecord, Drive, axis_from_arrays
from .formats import read_table
from .read import read, to_record
from .read_axis import read_axis
from .record import Provenance, Record, Sampling, from_arrays
from .run_motion import record_steps
from .steady import SteadyCurve, read_steady
from .steps import VelocitySteps, find_steps, find_steps_in_velocity
from .table import Table

__all__ = [
    "AxisRecord",
    "Drive",
    "Provenance",
    "Record",
    "Sampling",
    "SteadyCurve",
    "Table",
    "VelocitySteps",
    "axis_from_arrays",
    "find_steps",
    "find_steps_in_velocity",
    "from_arrays",
    "read",
    "read_axis",
    "read_steady",
    "read_table",
    "record_steps",
    "to_record",
]
