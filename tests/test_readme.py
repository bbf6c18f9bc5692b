"""The README's Python examples run as written."""

import re
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]


def test_examples_run(monkeypatch, capsys, tmp_path):
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert len(blocks) == 5
    names: dict = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), names)
    L, std, kp, kv, modulus = (float(word) for word in capsys.readouterr().out.split())
    # on the curve k_p = 1.5 k_cr(k_v) of (25), in the worse of the two scenarios
    worst = max(
        (3 - X) / 1e-3 * (2 * V**2 / (X * 1e-3) + 1) for V in (2e-3, 5e-3) for X in [1 + kv * V]
    )
    np.testing.assert_allclose(kp, 1.5 * worst, rtol=1e-6)
    assert 0 < modulus < 1
    assert abs(L - 20e-6) < 4 * std < 2e-6
    found = names["found"].modulus
    X = 1 + 0.5 * found.V0  # (25) again
    k_cr = (3 - X) / 1e-3 * (2 * found.V0**2 / (X * 1e-3) + 1)
    np.testing.assert_array_equal(found > 0, found.k_p > k_cr)
    assert np.isfinite(names["slope"]) and names["slope"] > 0


def test_commands_name_files_that_exist():
    text = (ROOT / "README.md").read_text()
    for path in re.findall(r"\b(?:data|fits|tests)/[\w./]+\w", text):
        assert (ROOT / path).exists(), path
