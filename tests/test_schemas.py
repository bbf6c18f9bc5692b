"""Files of results: their schemas, and files of version 1 that are read as those of today.

The files of version 1 in `schema_1` are of the worked fits (the undeclared effect, EMPS, screw
drive 1) as version 0.1.0 wrote them, but for some models, profiles and rows.
"""

import json
from pathlib import Path

import pytest
from command import assert_refused, run

from jaxfric import schemas
from jaxfric.compensation import feedforward
from jaxfric.prediction.model import load_model
from jaxfric.saved import law_from_fit
from jaxfric.saved.entry import fitted_law
from jaxfric.saved.files import read_saved
from jaxfric.schemas import FIT, LOOP, STEADY

OLD = Path(__file__).parent / "schema_1"
KINDS = {"fit": FIT, "loop": LOOP, "axis_loop": LOOP, "steady": STEADY}
SUPPORT = {"direction", "rows", "slowest", "fastest"}


def old(name: str) -> dict:
    return json.loads((OLD / f"{name}.json").read_text())


def tables(value):
    """Every table of a file, at any depth."""
    if isinstance(value, dict):
        yield value
    for one in value.values() if isinstance(value, dict) else value:
        if isinstance(one, dict | list):
            yield from tables(one)


@pytest.mark.parametrize("name", KINDS)
def test_a_file_of_version_1_is_read_as_one_of_today(name):
    before = old(name)
    _, now = read_saved(OLD / f"{name}.json", KINDS[name])
    assert before["schema"].endswith("/1") and now["schema"] == KINDS[name]
    known = ([t for t in tables(content) if set(t) != SUPPORT] for content in (before, now))
    pairs = list(zip(*known, strict=True))
    changes = [(a["delta_bic"], b["delta_bic"]) for a, b in pairs if "delta_bic" in a]
    assert all(a == -b for a, b in changes) and bool(changes) == (name != "fit")
    estimates = [(a, b) for a, b in pairs if "std" in a and "free" in a]
    assert bool(estimates) == (name != "steady")
    for a, b in estimates:
        assert (b["std"] is None) == (not a["free"] or a["std"] is None)
        assert a["value"] == b["value"]
    support = [one for table in tables(now) for one in table.get("support", ())]
    assert support and all(set(one) == SUPPORT for one in support)
    for key in ("heldout_rms", "most_held_out", "refused", "fault", "wavelength", "glitches"):
        assert not any(key in table for table in tables(now))


def test_other_keys_have_the_names_of_today():
    _, now = read_saved(OLD / "axis_loop.json", LOOP)
    before = old("axis_loop")
    assert now["noise"]["held_out_threshold"] == before["noise"]["most_held_out"]
    assert now["noise"]["outliers"] == before["noise"]["glitches"]
    assert now["axis"]["sign_width"] == before["axis"]["width"]
    assert now["tests"]["periodic_in_slip"] == before["tests"]["wavelength"]
    assert now["friction_law"]["width"] == before["friction_law"]["width"]
    models = zip(before["candidates"], now["candidates"], strict=True)
    assert all(a["heldout_rms"] == b["validation_rms"] for a, b in models)


@pytest.mark.parametrize("name", ["fit", "loop", "axis_loop"])
def test_a_law_of_version_1_is_that_of_its_file(name):
    """Of its entry, and made anew of the other entries of files from before there was one."""
    before = old(name)
    values = {n: p["value"] for n, p in before["friction_law"]["parameters"].items()}
    assert dict(fitted_law(OLD / f"{name}.json").parameters) == values
    assert load_model(OLD / f"{name}.json").warnings() is not None


def test_an_older_file_without_a_law_is_read(tmp_path):
    for name in ("fit", "loop", "axis_loop"):
        content = old(name)
        whole = fitted_law(OLD / f"{name}.json")
        del content["friction_law"]
        (tmp_path / "old.json").write_text(json.dumps(content))
        found = fitted_law(tmp_path / "old.json")
        assert dict(found.parameters) == dict(whole.parameters)
        assert (found.width, found.reach) == (whole.width, whole.reach)


def test_gains_and_a_feedforward_are_made_of_version_1():
    law = law_from_fit(OLD / "loop.json", normal_force="500 N", samples=2)
    assert law.law is not None
    for name in ("axis_loop", "steady"):
        assert feedforward(OLD / f"{name}.json").to_json()["schema"] == schemas.FEEDFORWARD


def test_what_no_version_reads_is_refused_in_a_line(tmp_path):
    """Of a later version, of another kind, and a result that nothing is made of."""
    for schema in ("jaxfric.loop/9", "jaxfric.gains/1", "jaxfric.record/1"):
        path = tmp_path / "file.json"
        path.write_text(json.dumps({**old("loop"), "schema": schema}))
        outcome = run("gains", "--from", path, "--mass", "1 kg", "--velocity", "1 um/s")
        assert_refused(outcome, f"'{schema}'", LOOP, "jaxfric loop")


@pytest.mark.parametrize("damage", [{"candidates": 3}, {"noise": None}, {"tests": [[]]},
                                    {"location_map": [{"variable": ["slip"]}]}])  # fmt: skip
def test_a_damaged_entry_of_version_1_stops_no_reading(tmp_path, damage):
    path = tmp_path / "loop.json"
    path.write_text(json.dumps(old("loop") | damage))
    ((key, value),) = damage.items()
    assert read_saved(path, LOOP)[1][key] == value
    assert fitted_law(path).name == "slip"


def test_every_schema_is_listed_once():
    listed = [v for v in vars(schemas).values() if isinstance(v, str) and v.startswith("jaxfric.")]
    names = [schema for schema in listed if "/" in schema]
    kinds = [schema.partition("/")[0] for schema in names]
    assert len(kinds) == len(set(kinds)) and set(schemas.VERBS) <= set(names)


def test_effects_that_predict_worse_are_not_used_of_version_1_either(tmp_path):
    content = old("loop")
    content["verdict"] = "outside_catalogue"
    path = tmp_path / "loop.json"
    path.write_text(json.dumps(content))
    assert fitted_law(path).effects
    content["after"]["in_sigma"]["report"] = 2 * content["before"]["in_sigma"]["report"]
    path.write_text(json.dumps(content))
    found = fitted_law(path)
    assert not found.effects and any("predict the test rows worse" in w for w in found.warnings)
    before = {name: p["value"] for name, p in content["before"]["parameters"].items()}
    assert found.parameters["A"] == before["A"] != content["after"]["parameters"]["A"]["value"]
