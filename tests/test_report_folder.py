"""`jaxfric report`: one page over the results below a folder."""

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from command import STEPS, STIFFNESS, assert_refused, record_text, run, written

from jaxfric.report.found import FoundResult, find_results

FITS = Path(__file__).parents[1] / "fits"


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fitted")
    path = written(folder / "run.csv", record_text())
    assert run("fit", path, *STIFFNESS, *STEPS, "--out", folder / "a fit & more").code == 0
    return folder


@pytest.fixture
def results(fitted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return shutil.copytree(fitted, tmp_path, dirs_exist_ok=True)


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
    # a number that breaks within its digits is another number
    assert not re.search(
        r"\btd(?!:not\(\.n\))[^{}]*\{[^}]*(normal|anywhere)", text.split("base64")[0]
    )
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


def saved(folder: Path, **content: object) -> FoundResult:
    """The result of a file with this content."""
    folder.mkdir(exist_ok=True)
    written(folder / "a.json", json.dumps({"schema": f"jaxfric.{folder.name}/1"} | content))
    (found,), damaged = find_results(folder)
    assert damaged == []
    return found


def estimate(value: float, std: float | None = None, unit: str = "1", determined: bool = True):
    return {"value": value, "std": std, "unit": unit, "free": std is not None} | (
        {} if determined else {"determined": False}
    )


def of_force(**more: object) -> dict:
    """What is saved of a fit to a force, in newtons and metres."""
    parameters = {
        "A": estimate(0.4, 0.01, "N"),
        "B": estimate(0.6, 0.02, "N"),
        "L": estimate(5e-6, 1e-7, "m"),
        "K": estimate(333648686.0, 36137588.0, "N/m"),
    }
    found = {"converged": True, "result": "converged", "parameters": parameters, "free": ["A", "B"]}
    found |= {"covariance": [[1e-4, 0.0], [0.0, 4e-4]], "warnings": [], "rms": 0.1}
    return found | {"law": "slip", "states": 1} | more


def test_a_stiffness_is_in_a_unit_that_can_be_read(tmp_path: Path) -> None:
    rows = saved(tmp_path / "fit", **of_force()).numbers.rows
    assert rows[0] == ("A-B", "-0.200(22)", "N")
    assert ("L (D_c)", "5.00(10)", "µm") in rows and ("K", "334(36)", "N/µm") in rows


def test_fits_of_several_records_have_all_parameters_and_warn(tmp_path: Path) -> None:
    one = {"file": "a.csv", "failed": None, "fit": of_force()}
    found = saved(tmp_path / "fits", fits=[one])
    assert found.mark == "" and found.numbers.head[1:4] == ("A-B [N]", "A [N]", "B [N]")
    cells = ("a.csv", "-0.200(22)", "0.400(10)", "0.600(20)", "5.00(10)", "334(36)", "")
    assert found.numbers.rows == [cells]
    warned = {"file": "b.csv", "failed": None, "fit": of_force(warnings=["too large"])}
    failed = {"file": "c.csv", "failed": "no column", "fit": None}
    found = saved(tmp_path / "fits", fits=[one, warned, failed])
    assert found.mark == " (it warns)"
    assert found.warnings == ("b.csv: too large", "c.csv: no fit: no column")
    assert found.numbers.rows[2] == ("c.csv", *[""] * 5, "no fit: no column")
    laws = [{"law": "slip", "states": 2, "bic_above_best": 8.667, "fit": of_force()}]
    found = saved(tmp_path / "comparison", laws=laws, sentence="", warnings=[])
    assert found.numbers.rows == [("slip, 2 states", "8.7", *cells[1:])]
    loose = of_force()
    loose["parameters"]["B"]["determined"] = False
    assert saved(tmp_path / "fit", **loose).numbers.rows[0][1] == "not determined"


@pytest.mark.parametrize(
    ("verdict", "mark"),
    [("outside_catalogue", " (what is missing is not"), ("effects", ""), ("no_missing_effect", "")],
)
@pytest.mark.parametrize("kind", ["loop", "steady"])
def test_what_a_verdict_leaves_open_is_marked(tmp_path: Path, kind, verdict, mark) -> None:
    assert saved(tmp_path / kind, verdict=verdict, sentence="x").mark.startswith(mark)
    found = saved(tmp_path / kind, verdict=verdict, sentence="x", warnings=["y"])
    assert found.mark.startswith(" (it warns") and (";" in found.mark) == bool(mark)


def test_a_plan_says_whether_it_tells_effects_apart(tmp_path: Path) -> None:
    plan = {"pairs": [{"effects": ["ageing", "gain"]}], "unseen": ["thermal"]}
    changes = [{"change": "repeat", "text": "the first velocity again"}, {"change": "", "text": ""}]
    content = {"plan": plan, "changes": changes, "recommended": "repeat"}
    no, rest = (
        "It cannot tell ageing from gain",
        "It cannot tell apart ageing/gain. It does not see",
    )
    rest = f"{rest} thermal."
    again = "the first velocity again."
    assert saved(tmp_path / "protocol", **content).sentence == f"{rest} Recommended: {again}"
    dwell = {"text": "a slow dwell", "enough": True}
    for change, more in (
        (None, ""),
        (dwell, "; it would with a slow dwell"),
        (dwell | {"enough": False}, ""),
    ):
        asked = {"effects": ["ageing", "gain"], "told_apart": False, "change": change}
        told = saved(tmp_path / "protocol", **content, asked=asked).sentence
        assert told == f"{no}{more}. {rest} For most pairs: {again}"
    content = {"plan": {"pairs": [], "unseen": []}, "changes": [], "recommended": None}
    told = "It tells all effects apart that it sees."
    assert saved(tmp_path / "protocol", **content).sentence == told


@pytest.mark.parametrize(
    ("kp", "delay", "row"),
    [
        (2.035e-4, None, ("k_p", "any k_p > 0", "")),
        (2.035e-4, 1e-3, ("k_p", "any small k_p", "")),
        (5.0, None, ("k_p", "5", "N/m")),
    ],
)
def test_gains_of_any_stiffness_are_told_as_the_command_does(tmp_path: Path, kp, delay, row):
    content = {"kp": kp, "kv": 1.0, "limits": {"kp": [2.035e-4, None]}, "controller_delay": delay}
    content |= {"scales": {"kp": 2.035e5}, "margins": {}, "required": {}, "law": "slip"}
    content |= {"units": {"kp": "N/m", "kv": "N s/m"}}
    assert saved(tmp_path / "gains", **content).numbers.rows[0] == row


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
