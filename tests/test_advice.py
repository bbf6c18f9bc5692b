"""What messages, --help and README propose is accepted by the options that it is proposed for.

Values are collected from the source: texts of `jaxfric/`, help of the verbs, commands of README
and of the documentation.
A value with a gap that is filled when it is said needs a sample in `FILLED`. And where a file is
refused with an advice, the advice is followed until the file reads.
"""

import ast
import re
import shlex
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pages import PAGES, blocks_of

from jaxfric.cli.app import app
from jaxfric.cli.options import RecordOptions
from jaxfric.errors import InputError, words_of_the_command
from jaxfric.fitting.typed import typed_parameters
from jaxfric.gains.requirement import Requirement
from jaxfric.laws.source import law_from_parameters
from jaxfric.protocol.base import TYPICAL
from jaxfric.records import VelocitySteps, read, read_axis
from jaxfric.records.axis_units import FORCE_UNITS, quantity_of, spelling
from jaxfric.records.columns import FORCES
from jaxfric.records.roles import AXIS, SLIDER
from jaxfric.units import has_dimension, parse_values

ROOT = Path(__file__).parents[1]
OPTION = re.compile(r"(--[a-z][a-z-]+)[ =](?:'([^']+)'|\"([^\"]+)\"|([^\s,;:)'\"]+))")
WORTH = re.compile(r"[-+.]?\d|.*=|.*\.json$|slip$|axis$|slider$|steady$|\{")
"""What an option is followed by without quotes is a value, not the next word, where it is this."""


def one_of(*units: str) -> Callable[[str], object]:
    """A quantity in one of the units, as the drive's gains are read."""

    def parse(text: str) -> float:
        errors = []
        for unit in units:
            try:
                return quantity_of(text, unit, "value")
            except InputError as error:
                errors.append(str(error))
        raise InputError("; ".join(errors))

    return parse


def values(*units: str) -> Callable[[str], object]:
    """One, several or a range of quantities in one of the units; of a mass a number alone."""

    def parse(text: str) -> list[float]:
        for unit in units[:-1]:
            try:
                return parse_values(text, unit, "value")
            except InputError:
                pass
        bare = re.fullmatch(r"[\d.]+", text) and units == ("kg",)
        return parse_values(f"{text} kg" if bare else text, units[-1], "value")

    return parse


def column(text: str) -> None:
    """ROLE=NAME [UNIT]: the role of a slider or axis, a unit of that role's."""
    (role, name), *_ = (RecordOptions([text]).roles("--column") or {}).items()
    assert role in SLIDER.roles or role in AXIS.roles or role in FORCES, role
    unit = SLIDER.split(name)[1]
    if unit is None or unit == "UNIT":
        return
    si = {"s", "m", "m/s", "1", "Pa", "rad", "rad/s", "N", "N*m", "V", "A"}
    assert any(has_dimension(spelling(unit), one) for one in si), unit


def law(text: str) -> None:
    if text == TYPICAL:  # of a coefficient, in `protocol`
        return
    for name in ("slip", "ageing", "stribeck", "delay", "dahl"):
        try:
            law_from_parameters(name, text)
            return
        except InputError as error:
            last = error
    raise last


def start(text: str) -> None:
    typed_parameters(text)


def file(text: str) -> None:
    assert Path(text).suffix in (".json", ".zarr", ".toml", ".csv"), text


@pytest.fixture(autouse=True)
def as_the_command_says():
    """Messages speak of options, not of arguments."""
    with words_of_the_command():
        yield


FORCE = ("N", "N*m")
PARSERS: dict[str, Callable[[str], object]] = {
    "--acceleration": one_of("m/s^2", "rad/s^2"),
    "--column": column,
    "--cutoff": one_of("Hz"),
    "--damping": values("N*s/m"),
    "--drive-gain": one_of("N/V", "N*m/V", "N/A", "N*m/A"),
    "--duration": values("s"),
    "--from": lambda text: (values("s", "m") if " " in text else file)(text),
    "--fade-speed": one_of("m/s", "rad/s"),
    "--friction": values("N"),
    "--jump": values("m/s", "m"),
    "--kp": values("N/m"),
    "--kv": values("N*s/m"),
    "--lag": one_of("s"),
    "--margin": lambda text: Requirement.parse([text]),
    "--mass": values("kg"),
    "--max-kp": values("N/m"),
    "--max-kv": values("N*s/m"),
    "--noise": float,
    "--normal-force": values("N"),
    "--parameters": law,
    "--position-gain": one_of("1/s"),
    "--rated-torque": one_of(*FORCE),
    "--slip-per-step": values("m"),
    "--start": start,
    "--steps": VelocitySteps.parse,
    "--stiffness": one_of("1/m", "N/m"),
    "--to": values("s", "m"),
    "--velocity": values("rad/s", "m/s"),
    "--velocity-gain": one_of("N*s/m", "N*m*s/rad", "V*s/m", "V*s/rad", "A*s/m", "A*s/rad"),
}
"""How the value of an option is read. Others are choices and counts, which cyclopts reads."""

FILLED = {
    ("--column", "{missing[0]}=NAME [{unit}]"): ["time=NAME [s]", "friction=NAME [1]"],
    ("--column", "{missing[0]}=#1 [{unit}]"): ["time=#1 [s]", "friction=#1 [1]"],
    ("--column", "{role.name}=#{best[0] + 1}"): ["time=#3"],
    ("--column", "{role}=NAME [{unit}]"): ["position=NAME [0.8 rad]", "velocity=NAME [0.8 mm/s]"],
    ("--column", "{role}=NAME [{example}]"): ["friction=NAME [N]", "time=NAME [ms]"],
    ("--column", "{role.name}={NO_COLUMN}"): ["disturbance=none"],
    ("--column", "{other.name}={name} [{unit}]"): ["motor_current=i [A]"],
    ("--column", "{role.name}={name} [{example}]"): ["disturbance=u [N]", "velocity=v [mm/s]"],
    ("--column", "{role.name}={name} [0.01 {example}]"): ["position=x [0.01 rad]"],
    ("--column", "friction={shear} [kN]"): ["friction=Scherkraft [kN]"],
    ("--column", "friction={name} [0.2]"): ["friction=tau [0.2]"],
    ("--column", "friction={over} [0.2]"): ["friction=tau [0.2]"],
    ("--column", "friction=NAME [-1 {record.friction_unit}]"): ["friction=mu [-1 1]"],
    ("--column", "normal_stress=NAME [-1 {unit}]"): ["normal_stress=NAME [-1 MPa]"],
    ("--column", "{role}=none"): ["normal_stress=none"],
    ("--column", "{role}={name} [0.4 MPa]"): ["normal_stress=Normalkraft [0.4 MPa]"],
    ("--column", "{text}"): [],  # what the user wrote
    ("--column", "{example}"): ["friction=mu", "motor_force=F"],
    ("--fade-speed", "{part} {speed}"): ["0.00505 m/s", "0.016 rad/s"],
    ("--from", "{file}"): ["loop.json", "results/loop.json"],
    ("--drive-gain", "{drive_gain}"): [],
    ("--drive-gain", "{example}"): [
        "35.15 N/V",
        *(f"0.05 {force}/{unit}" for force in FORCE_UNITS.values() for unit in "VA"),
    ],
    ("--drive-gain", "0.05 {gain}/V"): ["0.05 N/V", "0.05 N m/V"],
    ("--rated-torque", "{rated_torque}"): [],
    ("--slip-per-step", "{self.slip} {self.length}"): ["150 um", "0.2 mm"],
    ("--velocity", "{'..'.join(ends)} {unit}"): ["1..10 um/s", "0.5..2 mm/s"],
    ("--rated-torque", "9.84 m{self.force}"): [f"9.84 m{f}" for f in FORCE_UNITS.values()],
}


def texts(path: Path) -> list[str]:
    """All texts of a module; gaps of f-strings in braces."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inner = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr)
        for part in node.values
    }
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            found.append("".join(_part(part) for part in node.values))
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inner
        ):
            found.append(node.value)
    return found


def _part(node: ast.expr) -> str:
    if isinstance(node, ast.FormattedValue):
        return "{" + ast.unparse(node.value) + "}"
    return str(getattr(node, "value", ""))


def proposed(text: str) -> list[tuple[str, str]]:
    """Options with their values."""
    return [
        (option, single or double or bare)
        for option, single, double, bare in OPTION.findall(text)
        if single or double or WORTH.match(bare)
    ]


@cache
def in_messages() -> list[tuple[str, str]]:
    pairs = {
        pair
        for path in sorted((ROOT / "jaxfric").rglob("*.py"))
        for text in texts(path)
        for pair in proposed(text)
        if pair[0] in PARSERS
    }
    return sorted(pairs)


def accepted(option: str, value: str) -> None:
    try:
        PARSERS[option](value)
    except (InputError, ValueError, AssertionError) as error:
        pytest.fail(f"{option} '{value}' is proposed and refused: {error}")


def test_there_is_something_to_test() -> None:
    assert in_messages()


@pytest.mark.parametrize(("option", "value"), in_messages())
def test_values_that_messages_propose(option: str, value: str) -> None:
    if "{" in value and (option, value) not in FILLED:
        plain = re.sub(r"\{[^}]*\}", "1", value)
        assert re.fullmatch(r"\{[^}]*\} \w+", value), (
            f"add a sample of {option} '{value}' to FILLED"
        )
        return accepted(option, plain)
    for sample in FILLED.get((option, value), [value]):
        accepted(option, sample)


def helped() -> list[tuple[str, str]]:
    """Quoted values in the help of options that have a parser."""
    found = set()
    for name in (n for n in app if not n.startswith("-")):
        for argument in app[name].assemble_argument_collection(parse_docstring=True):
            quoted = re.findall(r"'([^']+)'|\"([^\"]+)\"", argument.parameter.help or "")
            found |= {(argument.name, one or two) for one, two in quoted}
    return sorted(pair for pair in found if pair[0] in PARSERS and pair[1] != "ROLE=NAME [UNIT]")


@pytest.mark.parametrize(("option", "value"), helped())
def test_values_that_help_proposes(option: str, value: str) -> None:
    if re.match(r"jaxfric ", value):
        return
    accepted(option, value)


def commands() -> list[str]:
    """Commands of README and of the pages of the documentation, each once."""
    lines = [
        line for page in PAGES for line in blocks_of(page, "sh") if line.startswith("jaxfric ")
    ]
    return list(dict.fromkeys(lines))


@pytest.mark.parametrize("line", commands())
def test_commands_of_the_pages(line: str) -> None:
    """Each parses, and its options take their values; its files of data/ are there."""
    words = shlex.split(line, comments=True)[1:]
    app.parse_args(words, exit_on_error=False, print_error=False)
    for option, value in pairwise(words):
        if option in PARSERS:
            accepted(option, value)
    for word in words:
        assert not word.startswith("data/") or (ROOT / word).is_file(), word


# ---- following advice ---------------------------------------------------------------------

OPTIONS = {"--drive-gain": "drive_gain", "--rated-torque": "rated_torque"}


def follow(reader: Callable, path: Path, names: dict[str, str]) -> tuple[object, list[str]]:
    """Read a file, doing what each refusal says; `names` stand for NAME in its proposals."""
    told: list[str] = []
    columns: dict[str, str] = {}
    options: dict[str, str] = {}
    for _ in range(6):
        try:
            return reader(path, columns=columns, **options), told
        except InputError as error:
            told.append(str(error))
        option, value = proposed(told[-1])[0]
        if option == "--column":
            role, name = value.split("=", 1)
            columns[role] = name.replace("NAME", names.get(role, "NAME"))
        else:
            options[OPTIONS[option]] = value
    pytest.fail(f"advice that does not help: {told}")


T = 0.01 * np.arange(60)
SHAPES = {
    "t": T,
    "x": np.sin(6 * T),
    "y": np.cos(7 * T) + T,
    "z": 2 + 0.01 * np.sin(T),
    "n": 25 + T,
}
BOTH, LOAD = {"time": "stamp", "motor_force": "load"}, {"normal_stress": "load"}


@pytest.mark.parametrize(
    ("reader", "header", "names", "advice"),
    [
        (read_axis, "t:time,x:position [mm],y:motor_force [N]", {}, 1),
        (read_axis, "t:time [s],x:position,y:motor_force [N]", {}, 1),
        (read_axis, "t:time [s],x:position [mm],y:current [A]", {}, 1),
        (read_axis, "t:time [s],x:position [deg],y:current [A]", {}, 1),
        (read_axis, "t:time [s],x:position [mm],y:control [V]", {}, 1),
        (read_axis, "t:time [s],x:position [rad],y:control [V]", {}, 1),
        (read_axis, "t:time [s],x:position [counts],y:motor_force [N]", {}, 1),
        (read_axis, "t:time [s],x:position [counts],y:motor_force [N m]", {}, 1),
        (read_axis, "t:time [s],x:position,y:motor_torque [N m]", {}, 1),
        (read_axis, "t:time [s],x:position,y:motor_torque [%]", {}, 1),
        (read_axis, "t:time [s],x:position [rad],y:motor_force [N]", {"position": "position"}, 1),
        (read_axis, "t:time [s],x:position [mm],y:motor_torque [N m]", {"position": "position"}, 1),
        (read_axis, "t:time [s],x:position [mm],y:motor_force [raw]", {}, 1),
        (read_axis, "t:time [s],x:place [mm],y:motor_force [N]", {"position": "place"}, 1),
        (read_axis, "t:stamp [s],x:position [mm],y:load", BOTH, 2),
        (read_axis, "t:time [s],x:position [mm],y:motor_force [N],n:pulses", {}, 1),
        (read_axis, "t:time [s],x:angle [rad],y:torque [N m],n:disturbance [%]", {}, 1),
        (read_axis, "t:time [s],x:position [mm],y:motor_force [N],n:disturbance [A]", {}, 1),
        (read, "t:stamp [s],x:displacement [um],z:friction", {"time": "stamp"}, 1),
        (read, "t:time [s],x:stretch [um],z:mu", {"load_point_displacement": "stretch"}, 1),
        (read, "t:time [s],x:displacement [um],z:ratio", {"friction": "ratio"}, 1),
        (read, "t:time [s],x:displacement [um],z:tau [MPa],n:load [MPa]", LOAD, 1),
        (read, "t:time [s],x:load [bits],z:mu", {"load_point_displacement": "load"}, 1),
    ],
)  # fmt: skip
def test_advice_that_is_followed(tmp_path: Path, reader, header, names, advice: int) -> None:
    keys, titles = zip(*(part.split(":") for part in header.split(",")), strict=True)
    rows = zip(*(SHAPES[key] for key in keys), strict=True)
    lines = [",".join(titles), *(",".join(f"{value:.5f}" for value in row) for row in rows)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(lines) + "\n")
    record, told = follow(reader, path, names)
    assert len(told) == advice, told
    assert len(record) == len(T)  # type: ignore[arg-type]
