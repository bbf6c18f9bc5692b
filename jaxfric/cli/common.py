"""What several verbs share: options, reading a record, preparing JAX."""

import contextlib
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ..errors import InputError
from .told import doing as doing
from .told import told as told

File = Annotated[Path, Parameter(help="The record: a CSV or other table of columns.")]
Columns = Annotated[
    list[str] | None,
    Parameter(
        name="--column",
        help="Say which column is what, as ROLE=NAME or 'ROLE=NAME [UNIT]'. Roles: time, friction, "
        "load_point_displacement, load_point_velocity, load_point_encoder, slip, normal_stress, "
        "shear_stress (over normal_stress it is friction); of an axis time, position, "
        "motor_force, control_signal, motor_current, reference_position, velocity, "
        "disturbance (added to the controller's output). ROLE=none: no column has it; "
        "#3 is the third column. time=1kHz: no column has it, rows come at that rate. May be"
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
Steps = Annotated[
    str | None,
    Parameter(help="Velocity steps, '0 s: 2 um/s, 60 s: 20 um/s', instead of those found."),
]


def named(type_: object, tokens) -> str:
    """A path or URL that is written out: an empty one is no name of the current folder."""
    text = tokens[0].value
    if not text.strip():
        raise InputError(
            f"{tokens[0].keyword or 'a path'} is empty; write . for the current folder"
        )
    return text


def named_path(type_: object, tokens) -> Path:
    """The same as a path."""
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
Out = Annotated[Path | None, Parameter(converter=named_path, help="Output folder.")]
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

EFFECTS = (
    "second_state, aging, velocity_dependent_L, evolution_cutoff, viscous, stribeck, slip_trend, "
    "run_in, position_periodic, normal_stress, thermal, frictional_delay, stiffness, damping, "
    "inertia, servo_lag, sensor_lag, sensor_delay, time_drift, gain"
)
"""The ids of the catalogue, written here too so that --help need not load it."""
AXIS_EFFECTS = (
    "direction_asymmetry, cubic, stribeck, log_viscous, position_periodic, position_dependence, "
    "time_drift, presliding, rate_and_state, servo_lag, sensor_lag, sensor_delay"
)
"""Those of an axis."""


def read_record(
    file: Path,
    columns: list[str] | None,
    drop_bad: bool,
    since: str | None = None,
    until: str | None = None,
):
    """The record, with columns given as ROLE=NAME texts, cut to the window of `Since`, `Until`."""
    from ..records import read

    record = read(file, columns=_roles(columns, "friction=mu"), drop_bad=drop_bad)
    warn(record.provenance.doubts)
    return windowed(record, since, until)


def windowed(record, since: str | None, until: str | None):
    """The rows of a record (of a slider or an axis) that `Since` and `Until` ask for."""
    return record if since is None and until is None else record.window(since, until)


def axis_roles(columns: list[str] | None) -> dict[str, str] | None:
    """Columns of an axis, given as ROLE=NAME texts."""
    return _roles(columns, "motor_force=F")


def _roles(columns: list[str] | None, example: str) -> dict[str, str] | None:
    roles = {}
    for text in columns or []:
        role, equals, name = text.partition("=")
        if not equals or not name.strip():
            raise InputError(f"--column '{text}' is not ROLE=NAME, as in --column {example}")
        roles[role.strip()] = name.strip()
    return roles or None


def tell_reading(record) -> None:
    """What was assumed of the columns of a record, and which are not used, on stderr."""
    for note in record.provenance.notes:
        print(f"jaxfric: note: {note}", file=sys.stderr)


def refuse_options(rig: str, of_others: dict[str, object]) -> None:
    """Refuse options that a rig has no use for."""
    other = "slider" if rig == "axis" else "axis"
    refuse_unused(f"--rig {rig}", of_others, f", or choose --rig {other}")


def refuse_unused(by: str, options: dict[str, object], instead: str = "") -> None:
    """Refuse options that something has no use for."""
    wrong = [option for option, given in options.items() if given]
    if wrong:
        raise InputError(
            f"{' and '.join(wrong)} would not be used with {by}; leave it out{instead}"
        )


def flipped(flip: Sequence[str] | None) -> str | Literal[False]:
    """Which sign `Flip` asks to turn."""
    if flip is None:
        return False
    return flip[0] if len(set(flip)) == 1 else "both"


def prepare_jax() -> None:
    """64-bit numbers, and a compilation cache in the user's cache folder if there can be one."""
    doing("loading JAX")
    import jax

    from ..cache import cache_compiled

    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        with contextlib.suppress(InputError):
            cache_compiled()


From = Annotated[
    Path | None,
    Parameter(
        name="--from",
        help="A fit.json of 'jaxfric fit', or a loop.json of 'jaxfric loop', from which the law is "
        "taken; of the loop with the effects that it found.",
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


def warn(lines: Iterable[str]) -> None:
    """Print each line as a warning on stderr."""
    for line in lines:
        print(f"jaxfric: warning: {line}", file=sys.stderr)


def read_law(
    fit: Path | None,
    law: str | None,
    parameters: str | None,
    normal_force: str | None,
    *,
    samples: int = 0,
    seed: int = 0,
):
    """The law that the options name, as a `LawSource`."""
    from ..laws.file import law_from_file
    from ..laws.source import law_from_parameters
    from ..units import parse_quantity

    if fit is not None:
        if law is not None or parameters is not None:
            raise InputError("--from and --law with --parameters exclude each other; give one")
        force = None
        if normal_force is not None:
            force = parse_quantity(normal_force, "N", "--normal-force")
            if not force > 0:
                raise InputError(f"--normal-force: '{normal_force}' is not positive")
        source = law_from_file(fit, normal_force=force, samples=samples, seed=seed)
        warn(source.warnings)
        return source
    if law is None or parameters is None:
        raise InputError(
            "no friction law: give a fit with --from fit.json, or --law slip with --parameters"
            " 'A=1 N, B=3 N, L=1 mm, V0=2 mm/s'"
        )
    if normal_force is not None:
        raise InputError("--normal-force goes with --from; give --parameters in newtons")
    return law_from_parameters(law, parameters)


def read_masses(text: str | None, *, count: int = 5) -> list[float] | None:
    """Masses [kg]; a number alone is in kilograms. None where none is given."""
    from ..units import parse_values

    if text is None:
        return None
    try:
        float(text)
    except ValueError:
        return parse_values(text, "kg", "--mass", count=count)
    return parse_values(f"{text} kg", "kg", "--mass", count=count)


def optional_quantity(text: str | None, unit: str, option: str) -> float | None:
    """A quantity [`unit`] or None."""
    from ..units import parse_quantity

    return None if text is None else parse_quantity(text, unit, option)


def effect_ids(texts: list[str] | None, option: str) -> tuple[str, ...]:
    """Ids of an option that may be repeated and hold commas, each once."""
    found = [id.strip() for text in texts or [] for id in text.split(",")]
    if texts and not all(found):
        raise InputError(
            f"{option} '{','.join(texts)}' has an empty id; write {option} viscous,gain"
        )
    return tuple(dict.fromkeys(found))
