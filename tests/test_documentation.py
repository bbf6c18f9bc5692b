"""What the documentation is made from: names, effects, messages. `.ci/docs/build` builds it."""

import importlib
import importlib.util
import re
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from command import run

import jaxfric
from jaxfric.cli.app import app
from jaxfric.effects import AXIS_CATALOGUE, CATALOGUE

ROOT = Path(__file__).parents[1]
DOCS = ROOT / ".ci" / "docs"


def script(name: str):
    """A script of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(f"docs_{name}", DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_every_public_name_is_in_the_reference_with_its_docstring():
    reference = script("reference")
    pages = reference.pages()
    shown = re.findall(r"^::: (\S+)$", "\n".join(pages.values()), re.M)
    assert len(shown) == len(set(shown))
    for name in jaxfric.__all__:
        value = getattr(jaxfric, name)
        if callable(value):
            assert f"{value.__module__}.{value.__qualname__}" in shown, name
            assert value.__doc__ and f"`jaxfric.{name}`" in pages["reference/index.md"], name


def test_what_the_reference_shows_can_be_imported():
    reference = script("reference")
    for path in re.findall(r"^::: (\S+)$", "\n".join(reference.pages().values()), re.M):
        module, _, name = path.rpartition(".")
        assert hasattr(importlib.import_module(module), name), path


def test_a_name_without_a_page_is_refused(monkeypatch):
    reference = script("reference")
    fewer = {k: v for k, v in reference.PAGES.items() if k != "gains"}
    monkeypatch.setattr(reference, "PAGES", fewer)
    with pytest.raises(ValueError, match=r"without a page.*find_gains"):
        reference.pages()


def test_every_verb_and_option_is_in_the_reference():
    text = script("command").pages()["reference/command.md"]
    for verb in (name for name in app if not name.startswith("-")):
        assert f"## jaxfric {verb}" in text
    assert "`--stiffness STR`" in text and "--slip-per-step" in text


def test_every_effect_has_a_picture_and_an_entry():
    (text,) = script("catalogue").pages(ROOT).values()
    for folder, effects in (("slider", CATALOGUE), ("axis", AXIS_CATALOGUE)):
        pictures = {path.stem for path in (ROOT / "fits" / "effects" / folder).glob("*.png")}
        assert pictures == set(effects)
        assert all(f"{{#{folder}-{id}}}" in text for id in effects)


def test_a_long_equation_scrolls_by_itself(monkeypatch):
    """Of the theory at 420 px the whole page scrolled sideways to 716 px."""
    for name in ("latex2mathml", "mkdocs"):
        pytest.importorskip(name)
    monkeypatch.setattr(sys, "path", list(sys.path))
    with mock.patch.dict(sys.modules):  # hooks.py names its neighbours as other tests name theirs
        hooks = script("hooks")
    html = hooks.equations("so\n\n$$ a = b $$\n\nand $c$")
    (block,) = re.findall(r"<div[^>]*>.*?</div>", html)
    assert "overflow-x: auto" in block.split(">")[0] and 'display="block"' in block


def test_docstrings_become_markdown():
    pytest.importorskip("griffe")
    text = "Fits.\n\nParameters\n----------\na, b : of it,\n    and more.\n\nNot tried."
    want = "Fits.\n\n**Parameters**\n\n- `a, b`: of it, and more.\n\nNot tried."
    assert script("docstrings").markdown(text) == want


# ---- links ---------------------------------------------------------------------------------

WRITTEN = (
    ROOT / "README.md",
    ROOT / "data" / "README.md",
    *sorted((DOCS / "pages").glob("*.md")),
    *sorted(ROOT.glob("fits/*/README.md")),
)


def dead_links(page: Path, text: str) -> list[str]:
    """Links and pictures of a page that lead to nothing in the project."""
    found = re.findall(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"", text)
    links = [(link or other).partition("#")[0] for link, other in found]
    inside = [link for link in links if link and "://" not in link]
    return [link for link in inside if not (page.parent / link).exists()]


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_leads_to_a_file_of_the_project(page):
    """Not only to one of the site: the repository shows the pages, too."""
    assert dead_links(page, page.read_text(encoding="utf-8")) == []


def test_a_dead_link_is_noticed():
    text = 'see [a](effects.md#x), [b](https://e.org), [c](#d), [e](fits/) <img src="no.png">'
    assert dead_links(ROOT / "README.md", text) == ["effects.md", "no.png"]


# ---- troubleshooting ----------------------------------------------------------------------

HEAD = "time [s],load_point_displacement [um],friction [1]"
ROWS = [f"{t:.3f},{t:.4f},{0.6 + 1e-4 * np.sin(40 * t):.6f}" for t in np.arange(0, 5, 0.01)]
LAW = ("--law", "slip", "--parameters", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
STEP = str(ROOT / "data" / "velocity_step.csv")
AXIS = str(ROOT / "data" / "axis.csv")
K = ("--stiffness", "5e-3/um")
FILES = {
    "no_unit.csv": ("time,load_point_displacement,friction", ROWS),
    "names.csv": ("t1 [s],lvdt [um],mu [1]", ROWS),
    "again.csv": (HEAD, ROWS[:300] + ROWS[200:]),
    "back.csv": (HEAD, [*ROWS[:300], ROWS[200], *ROWS[300:]]),
    "bad.csv": (HEAD, [*ROWS[:100], "1.0,abc,0.6", *ROWS[100:]]),
    "short.csv": (HEAD, ROWS[:10]),
    "even.csv": (HEAD, ROWS),
    "stress.csv": ("time [s],load_point_displacement [um],friction [MPa]", ROWS),
}
FIT_JSON = str(ROOT / "fits" / "p655_step1" / "one_state" / "fit.json")
CALLS = [
    ("fit", "names.csv", *K),
    ("fit", "no_unit.csv", *K),
    ("fit", "stress.csv", *K),
    ("fit", AXIS, *K),
    ("axis", STEP),
    ("fit", "again.csv", *K),
    ("fit", "back.csv", *K),
    ("fit", "bad.csv", *K),
    ("fit", "short.csv", *K),
    ("fit", "nowhere.csv", *K),
    ("fit", STEP, *K, "--from", "900 s"),
    ("fit", "even.csv", *K),
    ("run", "even.csv", *K),
    ("fit", STEP, *K, "--steps", "0 s: 2 um/s, 900 s: 20 um/s"),
    ("fit", STEP),
    ("fit", STEP, "--stiffness", "5e-6/um"),
    ("loop", STEP),
    ("fit", STEP, "--stiffness", "5e-3"),
    ("fit", STEP, "--stiffness", "4e5 N/m"),
    ("fit", STEP, *K, "--law", "dieterich"),
    ("loop", STEP, *K, "--include", "second"),
    ("gains", *LAW, "--velocity", "2 mm/s", "--margin", "stifness=2"),
    ("fit", STEP, *K, "--sttates", "2"),
    ("gains", "--from", FIT_JSON, "--mass", "2", "--velocity", "1 um/s"),
    ("gains", *LAW, "--mass", "2"),
    ("simulate", *LAW, "--velocity", "2 mm/s"),
    ("axis", AXIS, "--position-gain", "25 1/s"),
]
"""A call for every heading of the page of troubleshooting, in its order."""


def headings() -> list[str]:
    text = (DOCS / "pages" / "troubleshooting.md").read_text(encoding="utf-8")
    return re.findall(r"^### `(.*)`$", text, re.M)


@pytest.mark.parametrize(("heading", "call"), list(zip(headings(), CALLS, strict=True)))
def test_a_message_of_the_page_is_what_is_said(heading, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in set(call) & set(FILES):
        head, rows = FILES[name]
        Path(name).write_text("\n".join([head, *rows]) + "\n")
    outcome = run(*call)
    assert outcome.code == 2
    pattern = ".*".join(re.escape(part.strip()) for part in heading.split("…"))
    assert re.search(pattern, outcome.err), outcome.err
