"""Options that several verbs have."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter, Token

from ..errors import InputError

File = Annotated[Path, Parameter(help="The record: a CSV or other table of columns.")]
Columns = Annotated[
    list[str] | None,
    Parameter(
        name="--column",
        help="Say which column is what, as ROLE=NAME or 'ROLE=NAME [UNIT]'. Roles: time, friction, "
        "load_point_displacement, load_point_velocity, load_point_encoder, slip, normal_stress, "
        "shear_stress (over normal_stress it is friction; both may be forces); of an axis time, "
        "position, motor_force, control_signal, motor_current, reference_position, velocity, "
        "disturbance (added to the output of the controller). ROLE=none: no column has it; "
        "#3 is the third column. time=1kHz: no column has it, rows come at that rate; "
        "'load_point_velocity=10 um/s': the load point moves at that speed all the time. May be"
        " repeated.",
        negative=(),
    ),
]
DropBad = Annotated[
    bool,
    Parameter(
        negative=(),
        help="Leave out rows with cells that are no numbers, of a slider also those far out of"
        " their neighbours.",
    ),
]
Reduce = Annotated[
    Path | None,
    Parameter(
        help="First make columns in units of what the press recorded, by this script of the"
        " laboratory: a command file of xlook, or a TOML file."
    ),
]
Steps = Annotated[
    str | None,
    Parameter(
        help="Velocity steps, '0 s: 2 um/s, 60 s: 20 um/s', instead of those found; of a record"
        " that begins at the step: 'before: 2 um/s, 0 s: 20 um/s'."
    ),
]


def named(type_: object, tokens: Sequence[Token]) -> str:
    """A path or URL that is written out: an empty one is no name of the current folder."""
    text = tokens[0].value
    if not text.strip():
        raise InputError(
            f"{tokens[0].keyword or 'a path'} is empty; write . for the current folder"
        )
    return text


def named_path(type_: object, tokens: Sequence[Token]) -> Path:
    """The path that an option names, read as by `named`."""
    return Path(named(type_, tokens))


Since = Annotated[
    str | None,
    Parameter(
        name="--from",
        allow_leading_hyphen=True,
        help="Leave out all rows before this time since the first row, '120 s', or, of a slider,"
        " before the load point has moved so far, '9500 um'.",
    ),
]
Until = Annotated[
    str | None,
    Parameter(
        name="--to",
        allow_leading_hyphen=True,
        help="Leave out all rows after this time or displacement since the first row.",
    ),
]
Out = Annotated[
    Path | None,
    Parameter(
        converter=named_path,
        help="Output folder; one that holds the results of another record is refused.",
    ),
]
Text = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
"""An option that may begin with a minus sign: a negative quantity is then refused as such."""
Rig = Annotated[
    Literal["slider", "axis", "steady"],
    Parameter(
        help="slider: velocity steps of a press. axis: a servo axis that moves back and forth,"
        " from its motor force and encoder. steady: a folder of runs at steady speeds."
    ),
]
DriveGain = Annotated[
    str | None,
    Parameter(help='Of an axis: motor force per control signal, as in "35.15 N/V".'),
]
PositionGain = Annotated[
    str | None,
    Parameter(help='Of an axis under two nested loops: kp of the outer one, "160 1/s".'),
]
VelocityGain = Annotated[
    str | None,
    Parameter(help='Of an axis: kv of the inner loop, "240 V s/m", or in force "8436 N s/m".'),
]
RatedTorque = Annotated[
    str | None,
    Parameter(help='Of an axis whose torque is recorded in per cent of it: "9.84 mN m".'),
]
Flip = Annotated[
    list[Literal["force", "motion", "both"]] | None,
    Parameter(
        negative=(),
        consume_multiple=True,
        help="Of an axis: turn a sign, that of the force, that of the motion, or (without a word)"
        " of both.",
    ),
]
Held = Annotated[
    bool,
    Parameter(
        negative=(),
        help="Of an axis: the force is a command that the controller holds until the next row."
        " Known without it where the gains of its loops are.",
    ),
]
With = Annotated[
    list[str] | None,
    Parameter(
        name="--with",
        negative=(),
        help="Effects that the base model has from the start: ids, separated by commas.",
    ),
]
Most = Annotated[int, Parameter(help="Largest number of effects that may be added.")]
Json = Annotated[
    bool,
    Parameter(negative=(), help="Print one JSON document on stdout instead of tables and lines."),
]
Details = Annotated[
    bool,
    Parameter(
        negative=(),
        help="Print all tables: errors by block and velocity, tests, models, what is alike.",
    ),
]
Quiet = Annotated[
    bool,
    Parameter(negative=(), help="Say nothing of progress on stderr; warnings and errors stay."),
]
"""Read where the command begins to tell what it does, of every verb: see `app`."""
EFFECTS = (
    "second_state, ageing, velocity_dependent_L, evolution_cutoff, viscous, stribeck, slip_trend, "
    "run_in, position_periodic, normal_stress, thermal, frictional_delay, stiffness, damping, "
    "inertia, servo_lag, sensor_lag, sensor_delay, time_drift, gain"
)
"""The ids of the catalogue, written here too so that --help need not load it."""
AXIS_EFFECTS = (
    "direction_asymmetry, cubic, stribeck, log_viscous, gravity, position_periodic, "
    "position_dependence, time_drift, presliding, rate_and_state, servo_lag, sensor_lag, "
    "sensor_delay"
)
"""Ids of the effects of an axis."""
STEADY_EFFECTS = "direction_asymmetry, stribeck, cubic"
"""Ids of the effects of a curve of steady speeds."""


def _without(effects: str) -> Parameter:
    return Parameter(negative=(), help=f"Effects that are not considered. All ids: {effects}.")


Without = Annotated[list[str] | None, _without(EFFECTS)]
WithoutOfAxis = Annotated[list[str] | None, _without(AXIS_EFFECTS)]
WithoutOfSteady = Annotated[list[str] | None, _without(STEADY_EFFECTS)]


From = Annotated[
    Path | None,
    Parameter(
        name="--from",
        help="A fit.json of 'jaxfric fit' (or posterior.nc of its --prior), or a loop.json of"
        " 'jaxfric loop' or 'jaxfric axis', from which the law is taken; of a loop with the effects"
        " that it found, of a posterior with its draws as samples. Or a table of friction against"
        " speed: two columns with units, speed [mm/s] and friction [N] say.",
    ),
]
Memory = Annotated[
    str | None,
    Parameter(
        help="Of a table of friction against speed: the distance over which friction follows it,"
        " '1 mm'. Without it friction has no memory, and only damping holds the slider."
    ),
]
LawName = Annotated[
    str | None,
    Parameter(
        help="A law by name instead: slip, ageing, stribeck, gaussian-stribeck, delay or dahl."
    ),
]
LawParameters = Annotated[
    str | None, Parameter(help="Its parameters: 'A=1 N, B=3 N, L=1 mm, V0=2 mm/s'.")
]
NormalForce = Annotated[
    str | None,
    Parameter(
        allow_leading_hyphen=True,
        help="Normal force, '500 N': needed where the fit is of a friction coefficient.",
    ),
]
Mass = Annotated[
    str | None,
    Parameter(
        allow_leading_hyphen=True,
        help="Mass of the slider: '2 kg', '1, 2 kg' or '1..3 kg'; by default none or, where the law"
        " is from the loop.json of an axis, its own.",
    ),
]
SampleTime = Annotated[
    str | None,
    Parameter(
        allow_leading_hyphen=True,
        help="How often the controller samples, '1 ms': its delay of 1.5 samples (hold and"
        " computing) is then in the loop.",
    ),
]
Delay = Annotated[
    str | None,
    Parameter(
        allow_leading_hyphen=True,
        help="Instead of --sample-time: the loop's whole delay, '1 ms', which is then in it. (The"
        " margin delay is what is survived beyond it.)",
    ),
]
Damping = Annotated[Text, Parameter(help="Damping or velocity gain, '0.5 N*s/m' (none: 0).")]
