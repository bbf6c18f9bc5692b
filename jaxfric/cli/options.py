"""Options that several verbs have: each is declared here once, with one sentence for all of them.

A group of options is a frozen dataclass, which cyclopts flattens into single options; the docstring
of a field is the option's help. `--help` shows the first sentence of the options of the group
"Parameters", `--help-all` all sentences of all options (see `help`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

from cyclopts import Group, Parameter, Token

from ..errors import InputError
from ..pairs import read_pairs
from .common import effect_ids, optional_quantity, warn
from .folder import Folder, choose_folder, source_name

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
"""An option that a first user does not need: it stands in --help-all only."""
Text = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
"""An option that may begin with a minus sign: a negative quantity is then refused as such."""
Texts = Annotated[list[str] | None, Parameter(allow_leading_hyphen=True)]
"""The same, which may be repeated."""


def required(option: Parameter, unless: str = "") -> Parameter:
    """The same option of a verb that cannot do without it: its help begins with that."""
    text = option.help or ""
    return Parameter(help=f"Required{unless}: {text[:1].lower()}{text[1:]}")


def named(type_: object, tokens: Sequence[Token]) -> str:
    """A path or URL that is written out: an empty one is no name of the current folder."""
    text = tokens[0].value
    if not text.strip():
        raise InputError(
            f"{tokens[0].keyword or 'a path'} is empty; write . for the current folder"
        )
    return text


# ---- output -----------------------------------------------------------------------------------


@FLAT
@dataclass(frozen=True)
class OutputOptions:
    """Where a verb writes, and what it prints."""

    out: Annotated[str | None, Parameter(converter=named)] = None
    """Output folder. One that holds the results of another record is refused. Of a study the
    store, a folder or s3://BUCKET/NAME.zarr (also gs://, az://), by default NAME.zarr; with --plot
    the folder of the figures."""
    details: bool = False
    """Print all tables and sentences, not the answer alone."""
    json: bool = False
    """Print one JSON document on stdout instead of tables and lines."""
    quiet: bool = False
    """Say nothing of progress on stderr. Warnings and errors stay."""

    @property
    def folder(self) -> Path | None:
        """The folder that --out names."""
        return None if self.out is None else Path(self.out)


# ---- records ----------------------------------------------------------------------------------

File = Annotated[
    Path,
    Parameter(
        help="The record: a CSV or other table of columns. Runs at steady speeds: their folder."
    ),
]


@FLAT
@dataclass(frozen=True)
class RecordOptions:
    """How the rows of a record, of a slider or an axis, are read."""

    column: Annotated[list[str] | None, Parameter(name="--column")] = None
    """Say which column is what, as ROLE=NAME or 'ROLE=NAME [UNIT]'. May be repeated. Roles: time,
    friction, load_point_displacement, load_point_velocity, load_point_encoder, slip, normal_stress,
    shear_stress (over normal_stress it is friction; both may be forces); of an axis time, position,
    motor_force, control_signal, motor_current, reference_position, velocity, disturbance (added to
    the output of the controller). ROLE=none: no column has it; #3 is the third column. time=1kHz:
    no column has it, rows come at that rate; 'load_point_velocity=10 um/s': the load point moves at
    that speed all the time."""
    drop_bad: bool = False
    """Leave out rows with cells that are no numbers. Of a slider also rows that are far from their
    neighbours."""
    since: Annotated[Text, Parameter(name="--from")] = None
    """Leave out all rows before this time since the first row, '120 s'. Of a slider it may be a
    displacement of the load point, '9500 um'."""
    until: Annotated[Text, Parameter(name="--to")] = None
    """Leave out all rows after this time or displacement since the first row."""

    def slider(self, file: Path, reduce: Path | None) -> "Record":
        """The record of a slider, reduced by a script where there is one."""
        from ..records import read

        columns = self.roles("--column friction=mu")
        record = read(file, columns=columns, drop_bad=self.drop_bad, reduce=reduce)
        warn(record.provenance.doubts)
        return self.windowed(record)

    def roles(self, example: str) -> dict[str, str] | None:
        """The columns by their roles."""
        return read_pairs(self.column or (), "--column", example, form="ROLE=NAME") or None

    def windowed(self, record: AnyRecord) -> AnyRecord:
        """The rows of a record that --from and --to ask for."""
        if self.since is None and self.until is None:
            return record
        return record.window(self.since, self.until)  # ty: ignore[invalid-explicit-return]


Reduce = Annotated[
    Path | None,
    Parameter(
        help="Reduce the record first by this script of the laboratory. It makes columns in units"
        " of what the press recorded: a command file of xlook, or a TOML file."
    ),
    MORE,
]
Steps = Annotated[
    str | None,
    Parameter(
        help="Velocity steps, '0 s: 2 um/s, 60 s: 20 um/s'. They replace those found in a record;"
        " of one that begins at the step: 'before: 2 um/s, 0 s: 20 um/s'."
    ),
]
Rig = Annotated[
    Literal["slider", "axis", "steady"],
    Parameter(
        help="What was recorded: slider, axis or steady. A slider: velocity steps of a press. An"
        " axis: a servo axis that moves back and forth, from its motor force and encoder. Steady: a"
        " folder of runs at steady speeds."
    ),
]


DriveGain = Annotated[
    Text, Parameter(help='Of an axis: motor force per control signal, "35.15 N/V".')
]


@FLAT
@dataclass(frozen=True)
class AxisOptions:
    """What the columns of a servo axis mean."""

    drive_gain: DriveGain = None
    position_gain: Annotated[Text, MORE] = None
    """Of an axis under two nested loops: kp of the outer one, "160 1/s"."""
    velocity_gain: Annotated[Text, MORE] = None
    """Of an axis under two nested loops: kv of the inner one, "240 V s/m". Or in force,
    "8436 N s/m"."""
    rated_torque: Text = None
    """Of an axis whose torque is recorded in per cent of it: "9.84 mN m"."""
    flip_sign: Annotated[
        list[Literal["force", "motion", "both"]] | None, Parameter(consume_multiple=True), MORE
    ] = None
    """Of an axis: turn the sign of the force, of the motion, or (without a word) of both."""

    def axis(self, file: Path, reading: RecordOptions) -> "AxisRecord":
        """The record of an axis."""
        from ..records import read_axis

        record = read_axis(
            file,
            columns=reading.roles(_AXIS_COLUMN),
            drive_gain=self.drive_gain,
            position_gain=self.position_gain,
            velocity_gain=self.velocity_gain,
            rated_torque=self.rated_torque,
            flip=self.flipped,
            drop_bad=reading.drop_bad,
        )
        return reading.windowed(record)

    def steady(self, folder: Path, reading: RecordOptions) -> "SteadyCurve":
        """The curve of a folder of runs at steady speeds."""
        from ..records import read_steady

        return read_steady(
            folder,
            columns=reading.roles(_AXIS_COLUMN),
            drive_gain=self.drive_gain,
            rated_torque=self.rated_torque,
            flip=self.flipped,
            drop_bad=reading.drop_bad,
            window=(reading.since, reading.until),
        )

    @property
    def flipped(self) -> str | Literal[False]:
        """The sign that is turned, "both", or False for none."""
        if self.flip_sign is None:
            return False
        return self.flip_sign[0] if len(set(self.flip_sign)) == 1 else "both"

    @property
    def of_signals(self) -> dict[str, object]:
        """The options that say what the columns are, by name, as far as they are given."""
        return {
            "--drive-gain": self.drive_gain,
            "--rated-torque": self.rated_torque,
            "--flip-sign": self.flipped,
        }

    @property
    def of_loops(self) -> dict[str, object]:
        """The options of the controller's loops, by name."""
        return {"--position-gain": self.position_gain, "--velocity-gain": self.velocity_gain}


ZeroOrderHold = Annotated[
    bool,
    Parameter(
        help="Of an axis: the force is a command that the controller holds until the next row."
        " Known without it where the gains of its loops are."
    ),
]

# ---- models -----------------------------------------------------------------------------------

STIFFNESS = Parameter(
    allow_leading_hyphen=True,
    help="Stiffness of the machine with unit: 1.6e-3/um, or 2e6 N/m for a force. Of several files"
    " once for all, or once for each in their order. Of a run also 0.16 MPa/um, which under another"
    " normal stress is another friction per length, or ramps: that of unloading and reloading.",
)
"""Of a list in `fit`, which takes several records."""
Stiffness = Annotated[str | None, STIFFNESS]
LAW = Parameter(
    help="Friction law, slip or ageing. With --parameters also stribeck, gaussian-stribeck, delay"
    " or dahl; of several files as --stiffness."
)
DownsampleTo = Annotated[
    int | None,
    Parameter(
        help="Fit means over neighbouring rows, about so many. It is quicker by as much; white"
        " noise falls with the root of the rows in a mean, and errors are those of what is left. A"
        " run takes 4000 for each of its windows."
    ),
    MORE,
]
Events = Annotated[
    Path | None,
    Parameter(help="Take the events of this file, as 'jaxfric run' wrote it."),
]


@FLAT
@dataclass(frozen=True)
class ModelOptions:
    """The model of rate-and-state friction that is fitted."""

    states: Literal["1", "2", "3"] = "1"
    """Number of state variables."""
    fit_stiffness: bool = False
    """Fit the stiffness too. Then it need not be given; of a run every step finds its own."""
    slip_trend: bool = False
    """Fit a linear change of friction with slip as well."""


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
EXCLUDE = Parameter(
    help=f"Effects that are not considered. All ids of a slider: {EFFECTS}; of an axis:"
    f" {AXIS_EFFECTS}; of runs at steady speeds: {STEADY_EFFECTS}."
)


@FLAT
@dataclass(frozen=True)
class EffectOptions:
    """Effects of the catalogue that a base model has, and that it must not have."""

    include: list[str] | None = None
    """Effects that the base model has from the start: ids, separated by commas."""
    exclude: Annotated[list[str] | None, EXCLUDE] = None

    def ids(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The effects that the base has, and those that are left out."""
        return effect_ids(self.include, "--include"), effect_ids(self.exclude, "--exclude")


MaxEffects = Annotated[int, Parameter(help="Largest number of effects that may be added."), MORE]

# ---- laws and controllers ---------------------------------------------------------------------

From = Annotated[
    Path | None,
    Parameter(
        name="--from",
        help="A fit.json or loop.json from which the law is taken. Of a loop with the effects that"
        " it found. Also posterior.nc of 'jaxfric fit --prior', with its draws as samples; or a"
        " table of friction against speed: two columns with units, speed [mm/s] and friction [N]"
        " say.",
    ),
]
Parameters = Annotated[
    str | None,
    Parameter(
        help="Parameters of --law, 'A=1 N, B=3 N, L=1 mm, V0=2 mm/s'. Of a plan they are f0=0.6,"
        " A=0.010, B=0.014, L=20 um where none are given."
    ),
]


@FLAT
@dataclass(frozen=True)
class LawOptions:
    """A friction law in newtons: that of a file, or a named one."""

    from_: From = None
    law: Annotated[str | None, LAW] = None
    parameters: Parameters = None
    normal_force: Text = None
    """Normal force, '500 N'. Needed where the fit is of a friction coefficient."""
    memory: Annotated[Text, MORE] = None
    """Of a table of friction against speed: the distance over which friction follows it, '1 mm'.
    Without it friction has no memory, and only damping holds the slider."""

    def source(self, *, samples: int = 0, seed: int = 0) -> "LawSource":
        """The law, with so many samples of it."""
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

    def samples(self, number: int = 256) -> "Samples | None":
        """So many samples of the law; None without a file, and of a fit that leaves parameters
        undetermined, of which its law has warned."""
        from ..laws.source import without_first
        from ..saved.law import law_from_fit

        if self.from_ is None:
            return None
        try:
            source = law_from_fit(self.from_, normal_force=self.normal_force, samples=number)
            return without_first(source.samples)
        except InputError:
            return None

    def folder(self, output: OutputOptions) -> Folder:
        """The folder of a call on this law, named after its file or after the law."""
        if self.from_ is not None:
            return choose_folder(output.folder, source_name(self.from_), self.from_)
        return choose_folder(output.folder, self.law or "", unnamed=("law",))


MASS = Parameter(
    allow_leading_hyphen=True,
    help="Mass with unit, where inertia counts: '2 kg'. Also '1, 2 kg' or '1..3 kg' of gains;"
    " 3e-6 s^2/m (over the normal force) where friction is a coefficient. By default none or, where"
    " the law is from the loop.json of an axis, its own; of several files as --stiffness.",
)
Mass = Annotated[str | None, MASS]
VELOCITY = Parameter(
    help="Velocities '5 um/s', '1, 2 um/s' or a range '1e-6..1e-3 m/s'. Of a joint '1..5 rad/s',"
    " and all other options in rad and N m. A simulation takes one."
)
Velocity = Annotated[Text, VELOCITY]
GAIN = Parameter(
    name=("--kp", "--stiffness"),
    help="Position gain or stiffness, '3 kN/m'. With it stability gives poles and margins.",
)
Gain = Annotated[Text, GAIN]
Integral = Annotated[
    Text,
    Parameter(
        name=("--integral", "--ki"),
        help="Integral gain k_i of a PID controller, '500 N/(m s)' or '5 N m/(rad s)'. It is in"
        " poles and margins; the gains that are found are the smallest with it.",
    ),
    MORE,
]
Damping = Annotated[Text, Parameter(help="Damping or velocity gain, '0.5 N*s/m' (none: 0).")]


@FLAT
@dataclass(frozen=True)
class DelayOptions:
    """How late the controller acts."""

    sample_time: Text = None
    """How often the controller samples, '1 ms'. Its delay of 1.5 samples (hold and computing) is
    then in the loop."""
    delay: Annotated[Text, MORE] = None
    """Instead of --sample-time: the loop's whole delay, '1 ms', which is then in it. (The margin
    delay is what is survived beyond it.)"""

    def read(self) -> tuple[float | None, float | None]:
        """The sample time and the delay [s]."""
        sampled = optional_quantity(self.sample_time, "s", "--sample-time")
        return sampled, optional_quantity(self.delay, "s", "--delay")
