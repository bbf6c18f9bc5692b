"""Words carry no logic: with every sentence replaced by its place all else comes out the same."""

import ast
import json
import os
import string
import subprocess
import sys
from enum import StrEnum
from pathlib import Path

import numpy as np
import pytest
from coded import OPEN, coded, differences
from command import record_text, written

from jaxfric.effects import RunChange
from jaxfric.findings import WarningCode
from jaxfric.loop import LoopCode
from jaxfric.loop.refusal import Fault
from jaxfric.prediction.result import NoteCode
from jaxfric.report.words import REASONS, TEMPLATES, WARNINGS, change_words, say
from jaxfric.runs.reasons import RunReason
from jaxfric.stability.reasons import ClaimReason

HERE = Path(__file__).parent
DATA = HERE.parent / "data"
LAW = ("--law", "slip", "--parameters", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
STRENGTHENS = ("--law", "slip", "--parameters", "A=3 N, B=1 N, L=1 mm, V0=2 mm/s")
STRIBECK = ("--law", "stribeck", "--parameters",
            "c0=20 N, c1=170 N*s/m, c2=5 N, c3=10 mm/s, c4=1")  # fmt: skip
STEPS = ("--steps", "0 s: 2 um/s, 20 s: 10 um/s")
SOFT, STIFF = ("--stiffness", "9.4e-4/um"), ("--stiffness", "5e-3/um")
SLOW = ("--velocity", "2 mm/s", "--mass", "2")
CALLS = {
    "a record": ("inspect", DATA / "velocity_step.csv"),
    "a record of many steps": ("inspect", DATA / "velocity_steps.csv"),
    "a record of an axis": ("inspect", DATA / "axis.csv", "--rig", "axis"),
    "runs of an axis": ("inspect", "runs", "--rig", "steady"),
    "a fit": ("fit", "run.csv", *STIFF, *STEPS, "--out", "fitted"),
    "a fit with an outlier": ("fit", "outlier.csv", *STIFF, *STEPS),
    "a fit with a trend": ("fit", "run.csv", *STIFF, *STEPS, "--slip-trend"),
    "a fit of a force": ("fit", DATA / "force_step.csv", "--stiffness", "4e5 N/m"),
    "a fit that lacks a state": ("fit", DATA / "hidden_state.csv", *SOFT),
    "two states": ("fit", DATA / "hidden_state.csv", *SOFT, "--states", "2"),
    "the ageing law": ("fit", DATA / "ageing_steps.csv", "--law", "ageing", "--stiffness",
                       "6e-3/um"),
    "a stiffness below the critical one": ("fit", "run.csv", "--stiffness", "2e-4/um", *STEPS),
    "a fit on another record": ("predict", "fitted/fit.json", "again.csv"),
    "stability of a fit": ("stability", "--from", "fitted/fit.json", "--velocity", "1 um/s",
                           "--mass", "2", "--normal-force", "500 N"),
    "stability": ("stability", *LAW, *SLOW),
    "stability of Stribeck friction": ("stability", *STRIBECK, *SLOW, "--kp", "5 kN/m", "--kv",
                                       "300 N*s/m"),
    "stability of a strengthening law": ("stability", *STRENGTHENS, *SLOW),
    "gains": ("gains", *LAW, "--velocity", "1..10 mm/s", "--mass", "2"),
    "gains where none are needed": ("gains", *STRENGTHENS, *SLOW),
    "a motion": ("simulate", *LAW, "--velocity", "2 mm/s", "--kp", "6 kN/m", "--duration", "3 s"),
    "steady speeds": ("axis", "runs", "--out", "steadied"),
    "a feedforward": ("feedforward", "steadied/steady.json", "--at", "0.3 rad/s"),
    "a posterior": ("fit", "run.csv", *STIFF, *STEPS, "--prior", "priors.toml",
                    "--out", "drawn"),
    "stability of a posterior": ("stability", "--from", "drawn/posterior.nc", "--velocity",
                                 "1 m/s", "--mass", "2", "--normal-force", "500 N"),
    "a prediction beyond the record": ("predict", "fitted/fit.json", "fast.csv"),
    "a plan": ("protocol", "1, 1.5, 1, 1.5 um/s", "--stiffness", "3e-4/um",
               "--slip-per-step", "20 um", "--noise", "3e-4", "--rows", "40"),
    "ramps of a run": ("run", "ramps.csv", "--stiffness", "9e-3/um"),
    "a loop": ("loop", DATA / "force_step.csv", "--stiffness", "4e5 N/m", "--downsample-to", "300",
               "--max-effects", "1"),
    "no file": ("fit", "none.csv"),
    "no unit": ("fit", "run.csv", "--stiffness", "5"),
    "an unknown law": ("fit", "run.csv", "--law", "dieterich"),
    "no column": ("fit", "runs/0.csv"),
}  # fmt: skip


PRIORS = "[priors]\nA = {normal = [0.010, 0.002]}\nB = {uniform = [0, 0.05]}\n"


def ramps() -> str:
    """A run that is unloaded and loaded again once, K = 5e-3/um, with a gap of the clock."""
    t = np.arange(0, 200, 0.05)
    x = np.interp(t, [0, 80, 90, 200], [0, 400, 350, 900])
    f = np.full(len(t), 0.6)
    for i in range(1, len(t)):
        f[i] = min(f[i - 1] + 5e-3 * (x[i] - x[i - 1]), 0.6)
    f += 3e-4 * np.random.default_rng(0).standard_normal(len(t))
    clock = t + 60 * (t > 40)
    rows = (f"{a:.6g},{b:.6g},{c:.6g}" for a, b, c in zip(clock, x, f, strict=True))
    return "\n".join(["time [s],load_point_displacement [um],friction [1]", *rows]) + "\n"


def runs(folder: Path) -> None:
    """Runs of an axis at steady speeds, both ways: Coulomb, viscous and Stribeck friction."""
    folder.mkdir()
    random = np.random.default_rng(0)
    time = np.arange(0, 3, 0.01)
    for k, speed in enumerate((-0.9, -0.5, -0.2, -0.1, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9)):
        force = np.sign(speed) * (9 + 3 * np.exp(-((speed / 0.2) ** 2))) + 6 * speed
        columns = (time, speed * time, np.full_like(time, speed), np.full_like(time, force))
        noise = 0.2 * random.standard_normal(len(time))
        table = np.stack([*columns[:3], columns[3] + noise], axis=1)
        head = "time [s],position [rad],velocity [rad/s],motor_force [N m]"
        np.savetxt(folder / f"{k}.csv", table, "%.7g", ",", header=head, comments="")


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> dict[str, dict]:
    """What the calls come to, with the sentences and with their places instead."""
    found = {}
    for how in ("plain", "coded"):
        folder = tmp_path_factory.mktemp(how)
        lines = record_text().splitlines()
        written(folder / "run.csv", record_text())
        written(folder / "again.csv", record_text())
        cells = lines[40].split(",")
        lines[40] = ",".join([*cells[:-1], f"{float(cells[-1]) + 0.01:.6f}"])
        written(folder / "outlier.csv", "\n".join(lines) + "\n")
        runs(folder / "runs")
        written(folder / "priors.toml", PRIORS)
        written(folder / "ramps.csv", ramps())
        written(folder / "fast.csv", record_text().replace("[um]", "[mm]"))
        calls = {name: [*map(str, call), "--json", "--quiet"] for name, call in CALLS.items()}
        (folder / "calls.json").write_text(json.dumps(calls))
        script = [sys.executable, HERE / "coded.py", how, "calls.json", "results.json"]
        paths = [str(HERE.parent), str(HERE), os.environ.get("PYTHONPATH", "")]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
        subprocess.run(script, cwd=folder, check=True, capture_output=True, env=environment)
        found[how] = json.loads((folder / "results.json").read_text())
    return found


@pytest.mark.parametrize("name", CALLS)
def test_without_words_all_else_is_the_same(results, name) -> None:
    plain, other = (results[how][name] for how in ("plain", "coded"))
    assert plain["code"] == other["code"], other["err"]
    assert (plain["code"] == 2) == (plain["json"] is None)
    assert list(differences(plain["json"], other["json"])) == []
    if plain["code"]:
        assert OPEN not in plain["err"] and OPEN in other["err"]


def test_the_sentences_were_replaced(results) -> None:
    """Verdicts, warnings and the claim on stability are codes in the other results."""
    fit, loop, steady = (
        results["coded"][name]["json"]
        for name in ("a fit that lacks a state", "a loop", "steady speeds")
    )
    assert fit["warnings"] and all(OPEN in text for text in fit["warnings"])
    assert OPEN in loop["sentence"] and OPEN in steady["sentence"]
    assert all(one["code"] for one in fit["warned"])


@pytest.mark.parametrize(
    "line",
    [
        "found = why.endswith('not fixed')",
        "found = any(part in why for part in ('not fixed', 'no sign'))",
        "found = 'rows do not' in why",
        "found = why.split(' not ')[0] != why",
        "found = why == 'the rows do not fix L2: it is not fixed'",
        "found = f'the {1} rows do not fix {2}'.startswith('the 1 rows')",
    ],
)
def test_logic_by_words_is_noticed(line) -> None:
    source = f"why = 'the rows do not fix L2: it is not fixed'\n{line}\n"
    told = []
    for tree in (ast.parse(source), coded(ast.parse(source), "planted")):
        names: dict = {}
        exec(compile(tree, "planted", "exec"), names)
        told.append(names["found"])
    assert told == [True, False]


def test_what_is_no_sentence_stays() -> None:
    source = """'''The rows of it.'''
unit, code, text = 'N s/m', 'not_fixed', 'forwards'
def f(x: Float[Array, 'rows of columns']) -> None:
    '''Look at the rows.'''
    return f'{x:.2f} {unit}'
"""
    assert ast.dump(coded(ast.parse(source), "m")) == ast.dump(ast.parse(source))


# ---- templates -----------------------------------------------------------------------------


def says() -> list[tuple[str, ast.Call]]:
    """Calls of `say` with a code, by place."""
    found = []
    for path in sorted((HERE.parent / "jaxfric" / "report").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "say":
                found.append((f"{path.name}:{node.lineno}", node))
    return found


def codes(node: ast.expr) -> list[str]:
    """Codes that an argument may be."""
    if isinstance(node, ast.IfExp):
        return [*codes(node.body), *codes(node.orelse)]
    return [node.value] if isinstance(node, ast.Constant) else []


def fields(words: str) -> set[str]:
    """Names of the values of a template; options are no values."""
    found = {name for _, name, _, _ in string.Formatter().parse(words) if name}
    return {name for name in found if not name.startswith("option[")}


def test_every_sentence_that_is_said_has_its_template_and_all_values() -> None:
    missing = []
    for place, call in says():
        given = {one.arg for one in call.keywords}
        for code in codes(call.args[0]):
            if code not in TEMPLATES or (
                None not in given and not fields(TEMPLATES[code]) <= given
            ):
                missing.append((place, code))
    assert says() and missing == []


def test_every_warning_and_reason_that_is_made_has_its_words_and_all_values() -> None:
    missing, made = [], 0
    every = {**WARNINGS, **REASONS}
    for path in sorted((HERE.parent / "jaxfric").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or getattr(node.func, "id", "") not in MAKERS:
                continue
            made, given = made + 1, {one.arg for one in node.keywords}
            for code in names(node.args[0]):
                words = every.get(code)
                if words is None or (None not in given and not fields(words) <= given):
                    missing.append((path.name, node.lineno, code))
    assert made > 80 and missing == []
    assert REASONS.keys() == {*map(str, RunReason), *map(str, NoteCode), *map(str, ClaimReason)}
    assert set(map(str, WarningCode)) - WARNINGS.keys() == IN_PLACE
    assert WARNINGS.keys() <= set(map(str, WarningCode))


MAKERS = ("warned", "because", "without", "no_claim")
CODES = {one.__name__: one for one in (WarningCode, RunReason, NoteCode, ClaimReason)}
IN_PLACE = {WarningCode.GLITCHES, WarningCode.SECOND_SEARCH}
"""Warnings whose words are put together where they are made."""


def names(node: ast.expr) -> list[StrEnum]:
    """Codes of warnings and reasons that an argument may be."""
    return [CODES[n.value.id][n.attr] for n in ast.walk(node) if isinstance(n, ast.Attribute)
            and getattr(n.value, "id", "") in CODES]  # fmt: skip


def test_every_code_has_its_words() -> None:
    assert {f"refusal.{fault}" for fault in Fault} <= TEMPLATES.keys()
    withheld = (LoopCode.EDGE, LoopCode.RUNS_AWAY, LoopCode.FEEDBACK, LoopCode.SPRING)
    assert {f"finding.{code}" for code in withheld} <= TEMPLATES.keys()
    for verdict in ("no_missing_effect", "ambiguous", "outside_catalogue", "too_weak"):
        assert say(f"headline.{verdict}")
    assert all(change_words([change]) for change in RunChange)
