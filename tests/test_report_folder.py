"""`jaxfric report`: one page over the results below a folder."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from command import STEPS, STIFFNESS, assert_refused, record_text, run, written

from jaxfric.report.found import find_results

FITS = Path(__file__).parents[1] / "fits"


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    written(Path("run.csv"), record_text())
    assert run("fit", "run.csv", *STIFFNESS, *STEPS, "--out", "a fit & more").code == 0
    return tmp_path


class _Links(HTMLParser):
    def __init__(self, text: str):
        super().__init__()
        self.targets, self.ids = [], set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        named = dict(attrs)
        self.targets += [named["href"]] if tag == "a" else []
        self.ids |= {named["id"]} if "id" in named else set()


def test_a_page_of_a_fit(results: Path) -> None:
    code, out, err = run("report", ".")
    assert (code, err) == (0, "") and "a fit of the slip law" in out
    text = Path("report.html").read_text()
    assert "a fit &amp; more" in text and "jaxfric report ." in text
    assert text.count("<figure>") == 1 and "http" not in text.split("base64")[0]
    links = _Links(text)
    assert {t[1:] for t in links.targets if t[0] == "#"} <= links.ids
    files = [t for t in links.targets if t[0] != "#"]
    assert files and all((results / unquote(t)).is_file() for t in files)


def test_the_numbers_are_those_of_the_file(results: Path) -> None:
    (found,), damaged = find_results(results)
    assert damaged == []
    content = json.loads((results / "a fit & more" / "fit.json").read_text())
    name, text, _ = found.numbers.rows[0]
    value, digits = re.fullmatch(r"(-?[\d.]+)\((\d+)\)", text).groups()
    A, B = (content["parameters"][k]["value"] for k in "AB")
    assert name == "A-B" and float(value) == pytest.approx(A - B, abs=10 ** -len(value[3:]))
    i, j = content["free"].index("A"), content["free"].index("B")
    C = np.array(content["covariance"])
    error = np.sqrt(C[i, i] + C[j, j] - 2 * C[i, j])
    assert float(digits) * 10.0 ** -len(value.split(".")[1]) == pytest.approx(error, rel=0.06)


def test_results_of_every_kind_are_told() -> None:
    found, damaged = find_results(FITS)
    assert damaged == []
    kinds = {one.what for one in found}
    assert {"the smallest gains", "friction at steady speeds", "a fit of the slip law"} <= kinds
    loops = [one for one in found if one.what.startswith("a loop")]
    assert loops and all(one.sentence and one.figures for one in loops)
    assert any(one.page is not None for one in loops)
    warned = json.loads((FITS / "undeclared_effect/loop/loop.json").read_text())["warnings"]
    (story,) = (one for one in loops if "undeclared" in str(one.file))
    assert story.warnings == tuple(warned)
    assert story.numbers.rows[0][0] == "A-B"


def test_a_folder_without_results_is_refused(results: Path) -> None:
    Path("empty").mkdir()
    assert_refused(run("report", "empty"), "empty: no results below it")
    assert list(Path("empty").iterdir()) == []
    assert_refused(run("report", "nowhere"), "no such folder")
    written(Path("empty/other.json"), '{"schema": "another/1"}')
    written(Path("empty/torn.json"), '{"schema": ')
    assert_refused(run("report", "empty"), "torn.json: cannot be read")


def test_a_damaged_result_loses_no_other(results: Path) -> None:
    written(Path("damaged.json"), '{"schema": "jaxfric.fit/1", "law": "slip"}')
    code, out, err = run("report", ".", "--json")
    assert code == 0 and len(json.loads(out)["results"]) == 1
    assert "warning: " in err and "damaged.json" in err
    assert "damaged.json" in Path("report.html").read_text()
