"""Measured records: read them, and find the velocity steps in them. Nothing here needs JAX."""

from .read import read, to_record
from .record import Provenance, Record, Sampling, from_arrays
from .steps import VelocitySteps, find_steps, find_steps_in_velocity, record_steps
from .table import Table, read_table

__all__ = [
    "Provenance",
    "Record",
    "Sampling",
    "Table",
    "VelocitySteps",
    "find_steps",
    "find_steps_in_velocity",
    "from_arrays",
    "read",
    "read_table",
    "record_steps",
    "to_record",
]
