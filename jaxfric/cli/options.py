"""Options that several verbs share; this module declares each option once.

A group of options is a frozen dataclass, which cyclopts flattens into single options. The docstring
of a field is the option's help. `--help` prints the first sentence of the docstring, and only
options of the group "Parameters". `--help-all` prints the whole docstrings of all options (see
`help`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from cyclopts import Group, Parameter, Token, validators

from ..errors import InputError
from ..pairs import read_pairs
from .common import effect_ids, optional_quantity, warn
from .folder import Folder, choose_folder, input_name, source_name
from .shown import OutputOptions as OutputOptions
from .told import doing

if TYPE_CHECKING:
    from ..laws.source import LawSource
    from ..records import AxisRecord, Record
    from ..records.steady import SteadyCurve
    from ..stability.analysis import Law as Samples

AnyRecord = TypeVar("AnyRecord", "Record", "AxisRecord")
_AXIS_COLUMN = "--column motor_force=F"
FLAT = Parameter(name="*")
"""A dataclass whose fields are options of their own."""
MORE = Parameter(group=Group("More options"))
"""An option that a first user does not need: only --help-all lists it."""
Text = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
"""An option whose value may begin with a minus sign, so that the verb can refuse a negative one."""


# ---- records ----------------------------------------------------------------------------------

File = Annotated[
    Path,
    Parameter(
        help="The record: a CSV or other table of columns. For runs at steady speeds: their folder."
    ),
]


@FLAT
@dataclass(frozen=True)
class RecordOptions:
    """Options for reading the rows of a slider's or an axis' record."""

    column: Annotated[list[str] | None, Parameter(name="--column")] = None
    """Assign a column to a role, ROLE=NAME or 'ROLE=NAME [UNIT]'. May be repeated. Roles: time,
    friction, load_point_displacement, load_point_velocity, load_point_encoder, slip, normal_stress,
    shear_stress (divided by normal_stress it is friction; both may be forces). Roles of an axis:
    time, position, motor_force, control_signal, motor_current, reference_position, velocity,
    disturbance (added to the output of the controller). #3 is the third column. ROLE=none: no
    column has this role. time=1kHz: no time column; the sampling rate is 1 kHz.
    'load_point_velocity=10 um/s': the load point moves at this constant speed."""
    drop_bad: bool = False
    """Leave out rows that have cells without a number. For a slider also rows far from their
    neighbours."""
    since: Annotated[Text, Parameter(name="--from")] = None
    """Leave out rows before this time after the first row, '120 s'. For a slider also a load-point
    displacement, '9500 um'."""
    until: Annotated[Text, Parameter(name="--to")] = None
    """Leave out rows after this time or displacement, counted from the first row."""

    def roles(self, example: str) -> dict[str, str] | None:
        """Return the column of each role in --column; None without --column."""
        return read_pairs(self.column or (), "--column", example, form="ROLE=NAME") or None

    def windowed(self, record: AnyRecord) -> AnyRecord:
        """Return the part of a record between the options --from and --to."""
        if self.since is None and self.until is None:
            return record
        return record.window(self.since, self.until)  # ty: ignore[invalid-explicit-return]


@FLAT
@dataclass(frozen=True)
class SliderOptions(RecordOptions):
    """Options for reading a slider's record."""

    reduce: Annotated[Path | None, MORE] = None
    """Reduce the record first with this script: an xlook command file, or a TOML file. The script
    converts what the press recorded to columns with units."""

    def read(self, file: Path) -> "Record":
        """Read the record; if a script is given, reduce the record by the script."""
        doing(f"reading {file.name}")
        from ..records import read

        columns = self.roles("--column friction=mu")
        record = read(file, columns=columns, drop_bad=self.drop_bad, reduce=self.reduce)
        record = self.windowed(record)
        warn(record.doubts)
        return record


Steps = Annotated[
    str | None,
    Parameter(
        help="Velocity steps, '0 s: 2 um/s, 60 s: 20 um/s'. They replace the steps found in the"
        " record. If the record begins at a step: 'before: 2 um/s, 0 s: 20 um/s'."
    ),
]
Rig = Annotated[
    Literal["slider", "axis", "steady"],
    Parameter(
        help="What was recorded: slider, axis or steady. Slider: velocity steps of a press. Axis:"
        " motor force and encoder of a servo axis that moves back and forth. Steady: a folder of"
        " runs at steady speeds."
    ),
]


DriveGain = Annotated[
    Text,
    Parameter(
        help='For an axis: motor force per control signal or motor current, "35.15 N/V", "9 N m/A".'
    ),
]


@FLAT
@dataclass(frozen=True)
class AxisOptions:
    """Options: gains and signs that turn the columns of a servo axis into force and motion."""

    drive_gain: DriveGain = None
    position_gain: Annotated[Text, MORE] = None
    """For an axis with cascaded control: kp of the outer position loop, "160 1/s"."""
    velocity_gain: Annotated[Text, MORE] = None
    """For an axis with cascaded control: kv of the inner velocity loop, "240 V s/m". Or in force,
    "8436 N s/m"."""
    rated_torque: Text = None
    """Rated torque, "9.84 mN m", for torque recorded in per cent of the rated torque."""
    flip_sign: Annotated[
        list[Literal["force", "motion", "both"]] | None, Parameter(consume_multiple=True), MORE
    ] = None
    """For an axis: change the sign of the force, of the motion, or (without a value) of both."""

    def axis(self, file: Path, reading: RecordOptions) -> "AxisRecord":
        """Read the record of an axis."""
        doing(f"reading {file.name}")
        from ..records import read_axis

        record = read_axis(
            file,
            columns=reading.roles(_AXIS_COLUMN),
            drive_gain=self.drive_gain,
            position_gain=self.position_gain,
            velocity_gain=self.velocity_gain,
            rated_torque=self.rated_torque,
            flip_sign=self.flipped,
            drop_bad=reading.drop_bad,
        )
        return reading.windowed(record)

    def steady(self, folder: Path, reading: RecordOptions) -> "SteadyCurve":
        """Read the steady-state friction curve of a folder of runs at steady speeds."""
        doing(f"reading {input_name(folder)}")
        from ..records import read_steady

        return read_steady(
            folder,
            columns=reading.roles(_AXIS_COLUMN),
            drive_gain=self.drive_gain,
            rated_torque=self.rated_torque,
            flip_sign=self.flipped,
            drop_bad=reading.drop_bad,
            window=(reading.since, reading.until),
        )

    @property
    def flipped(self) -> str | Literal[False]:
        """Return which signs to change: "force", "motion" or "both"; False for no sign."""
        if self.flip_sign is None:
            return False
        return self.flip_sign[0] if len(set(self.flip_sign)) == 1 else "both"


OF_SIGNALS = ("drive_gain", "rated_torque", "flip_sign")
"""Options of an axis that convert columns."""
OF_LOOPS = ("position_gain", "velocity_gain")
"""Options of an axis with cascaded control."""


@FLAT
@dataclass(frozen=True)
class HeldAxisOptions(AxisOptions):
    """Options of a servo axis whose motion a model predicts."""

    zero_order_hold: bool = False
    """For an axis: the force is a zero-order hold command of the controller. Not needed if the
    gains of the controller's loops are given."""


# ---- models -----------------------------------------------------------------------------------

STIFFNESS = Parameter(
    allow_leading_hyphen=True,
    help="Stiffness of the machine with unit: 1.6e-3/um, or 2e6 N/m for a force. For several files:"
    " one value, or one per file in their order. With a recorded normal stress also 0.16 MPa/um,"
    " which is divided by the mean normal stress, in a run by that of each event. For a run also"
    " ramps: the stiffness during unloading and reloading.",
)
"""`fit` takes a list of them, one for each record."""
Stiffness = Annotated[str | None, STIFFNESS]
LAW = Parameter(
    help="Friction law, slip or ageing. With --parameters also stribeck, gaussian-stribeck, delay"
    " or dahl. For several files: one law, or one per file in their order."
)
DownsampleTo = Annotated[
    int | None,
    Parameter(
        help="Reduce the record to about this number of rows by block averaging. The fit is faster"
        " by the same factor. White noise falls with the square root of the rows in a block; errors"
        " are computed from the residual of the means. Default: 4000 rows for each window of a run,"
        " 8192 rows for a loop (all rows if averaging would flatten a peak), all rows for a fit."
    ),
    MORE,
]
Events = Annotated[
    Path | None,
    Parameter(help="Use the events of this file, which 'jaxfric run' wrote."),
]


@FLAT
@dataclass(frozen=True)
class ModelOptions:
    """The rate-and-state model to fit."""

    states: Literal["1", "2", "3"] = "1"
    """Number of state variables."""
    fit_stiffness: bool = False
    """Fit the stiffness too. --stiffness is then optional. In a run each step has its own
    stiffness."""
    slip_trend: bool = False
    """Fit a linear change of friction with slip as well."""

    def model(self) -> dict[str, Any]:
        """Return these options as arguments of a fit."""
        names = ("fit_stiffness", "slip_trend")
        return {"states": int(self.states), **{name: getattr(self, name) for name in names}}


def _ids(type_: object, tokens: Sequence[Token]) -> tuple[str, ...]:
    """Return distinct ids of a repeated option, or of ids joined by commas."""
    return effect_ids([token.value for token in tokens], tokens[0].keyword or "")


EffectIds = Annotated[tuple[str, ...], Parameter(converter=_ids, n_tokens=1)]
"""Ids of effects, separated by commas; the option may be repeated."""


@FLAT
@dataclass(frozen=True)
class EffectOptions:
    """Options: effects in the base model, and effects that the loop must not try."""

    include: EffectIds = ()
    """Effects that the base model has from the start: ids, separated by commas."""
    exclude: EffectIds = ()
    """Effects that the loop does not try: ids, separated by commas. An unknown id lists
    all ids."""


@FLAT
@dataclass(frozen=True)
class SearchOptions(EffectOptions):
    """Options: effects that the loop may add."""

    max_effects: Annotated[int, Parameter(validator=validators.Number(gte=1)), MORE] = 8
    """Largest number of effects that may be added."""


# ---- laws and controllers ---------------------------------------------------------------------


@FLAT
@dataclass(frozen=True)
class NamedLaw:
    """Options: a friction law, from a file or by name with parameters."""

    from_: Annotated[Path | None, Parameter(name="--from")] = None
    """Take the friction law from a fit.json or loop.json. A loop.json adds the effects that its
    loop found. A posterior.nc of 'jaxfric fit --prior' gives its draws as samples. A table of
    friction against speed has two columns with units, such as speed [mm/s] and friction [N]."""
    law: Annotated[str | None, LAW] = None
    parameters: str | None = None
    """Parameters of --law, 'A=1 N, B=3 N, L=1 mm, V0=2 mm/s'. Default of a protocol: f0=0.6,
    A=0.010, B=0.014, L=20 um."""


@FLAT
@dataclass(frozen=True)
class LawOptions(NamedLaw):
    """Options: a friction law in newtons."""

    normal_force: Text = None
    """Normal force, '500 N'. Required if the fit is of a friction coefficient."""
    memory: Annotated[Text, MORE] = None
    """For a table of friction against speed: memory distance of friction, '1 mm'. Without
    this distance friction has no memory, so that only damping can stabilise the slider."""

    def source(self, *, samples: int = 0, seed: int = 0) -> "LawSource":
        """Return the law of these options, with the given number of samples."""
        from ..laws.source import law_from_parameters
        from ..saved.law import law_from_fit

        if self.from_ is not None:
            if self.law is not None or self.parameters is not None:
                raise InputError("--from and --law with --parameters exclude each other; give one")
            source = law_from_fit(
                self.from_,
                normal_force=self.normal_force,
                samples=samples,
                seed=seed,
                memory=self.memory,
            )
            warn(source.warnings)
            return source
        if self.memory is not None:
            raise InputError("--memory goes with --from and a table of friction against speed")
        if self.law is None or self.parameters is None:
            raise InputError(
                "no friction law: give a fit with --from fit.json, or --law slip with --parameters"
                " 'A=1 N, B=3 N, L=1 mm, V0=2 mm/s'"
            )
        if self.normal_force is not None:
            raise InputError("--normal-force goes with --from; give --parameters in newtons")
        return law_from_parameters(self.law, self.parameters)

    def samples(self) -> "Samples | None":
        """Return 256 posterior samples of the law; None without a file or a determined fit.

        If parameters are undetermined, `source` has already printed a warning.
        """
        from ..laws.source import without_first
        from ..saved.law import law_from_fit

        if self.from_ is None:
            return None
        try:
            source = law_from_fit(self.from_, normal_force=self.normal_force, samples=256)
            return without_first(source.samples)
        except InputError:
            return None

    def folder(self, output: OutputOptions) -> Folder:
        """Return the output folder of a call, named after the law's file or the law."""
        source = self.law or "" if self.from_ is None else source_name(self.from_)
        return choose_folder(output, source, self.from_, unnamed=("law",))


MASS = Parameter(
    allow_leading_hyphen=True,
    help="Mass with unit, '2 kg', if inertia matters. For gains also '1, 2 kg' or '1..3 kg'. If"
    " friction is a coefficient: mass over normal force, 3e-6 s^2/m. In a fit with mass the column"
    " friction is the force at the interface, not the spring force of a load cell. Default: none,"
    " or the mass in the fit.json or loop.json. For several files: one mass, or one per file in"
    " their order.",
)
Mass = Annotated[str | None, MASS]
VELOCITY = Parameter(
    allow_leading_hyphen=True,
    help="Velocities '5 um/s', '1, 2 um/s' or a range '1e-6..1e-3 m/s'. For a joint '1..5 rad/s';"
    " then all other options are in rad and N m. A simulation needs one velocity.",
)
GAIN = Parameter(
    name=("--kp", "--stiffness"),
    allow_leading_hyphen=True,
    help="Position gain or stiffness, '3 kN/m'. The verb stability needs it for poles and margins.",
)
Integral = Annotated[
    Text,
    Parameter(
        name=("--integral", "--ki"),
        help="Integral gain k_i of a PID controller, '500 N/(m s)' or '5 N m/(rad s)'. Poles,"
        " margins and the smallest gains then include it.",
    ),
    MORE,
]
Damping = Annotated[Text, Parameter(help="Damping or velocity gain, '0.5 N*s/m' (default: 0).")]


@FLAT
@dataclass(frozen=True)
class DelayOptions:
    """Delay of the controller."""

    sample_time: Text = None
    """Sample time of the controller, '1 ms'; counts as 1.5 samples of delay. The computation takes
    1 sample, the zero-order hold 0.5."""
    delay: Text = None
    """Total delay of the loop, '1 ms', instead of --sample-time. The delay margin is the additional
    delay that the loop tolerates."""

    def read(self) -> tuple[float | None, float | None]:
        """Return the sample time and the delay [s]."""
        sampled = optional_quantity(self.sample_time, "s", "--sample-time")
        return sampled, optional_quantity(self.delay, "s", "--delay")
