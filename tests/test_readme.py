"""The README's Python examples run as written."""

import re
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]


def test_examples_run(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert len(blocks) == 2
    names: dict = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), names)
    L, std = (float(word) for word in capsys.readouterr().out.split())
    assert abs(L - 20e-6) < 4 * std < 2e-6
    assert np.isfinite(names["slope"]) and names["slope"] > 0


def test_commands_name_files_that_exist():
    text = (ROOT / "README.md").read_text()
    for path in re.findall(r"\b(?:data|fits|tests)/[\w./]+\w", text):
        assert (ROOT / path).exists(), path
