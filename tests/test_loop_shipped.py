"""The verdict on a record that ships: noise correlated over 2 s in rows of 0.03 to 0.4 s."""

import csv
import json
from pathlib import Path

import pytest
from command import run

RECORD = Path(__file__).parents[1] / "data" / "velocity_steps.csv"
TRUTH = {"A": 0.008, "B": 0.012, "L": 15e-6}


def parameters(verb: str, record: Path, *options: str) -> tuple[dict, dict]:
    folder = f"{verb}-{record.stem}"
    out = run(verb, record, "--stiffness", "4e-3/um", "--json", "--out", folder, *options)
    assert out.code == 0, out.err
    content = json.loads(out.out)
    return content, content["parameters"] if verb == "fit" else content["after"]["parameters"]


@pytest.mark.long
def test_nothing_is_missing_and_errors_are_those_of_the_fit(tmp_path, monkeypatch):
    """With all its columns, and with those alone that the fit uses too.

    The loop fits the train block, the fit the whole record; both weigh rows by the noise.
    """
    monkeypatch.chdir(tmp_path)
    whole, found = parameters("loop", RECORD)
    assert whole["verdict"] == "no_missing_effect" and whole["effects"] == []
    assert all(abs(found[n]["value"] - t) < 3 * found[n]["std"] for n, t in TRUTH.items())
    lines = [line for line in RECORD.read_text().splitlines() if not line.startswith("#")]
    with Path("three.csv").open("w", newline="") as file:
        csv.writer(file).writerows(row[:3] for row in csv.reader(lines))
    fit, by_fit = parameters("fit", Path("three.csv"), "--weighting", "whitened")
    loop, by_loop = parameters("loop", Path("three.csv"))
    assert loop["verdict"] == "no_missing_effect"
    for content in (fit, loop):
        (part,) = content["noise"]["parts"]
        assert part["over"] == "time" and part["memory"] == pytest.approx(2.0, rel=0.3)
        assert content["noise"]["correlated_share"] == pytest.approx(0.5, abs=0.1)
    for name in TRUTH:
        assert by_loop[name]["std"] == pytest.approx(by_fit[name]["std"], rel=0.25)
