"""Content of small loop.json files of an axis, to make feedforwards of."""

import json
from pathlib import Path

import numpy as np

BASE = {"M": 2.0, "F_v": 30.0, "F_c": 10.0, "F_0": 1.5}
FOUND = {
    "direction_asymmetry": {"d": 4.0},
    "cubic": {"c": 50.0},
    "stribeck": {"fs": 3.0, "vs": 0.02, "n": 1.3},
    "log_viscous": {"c": 1.2, "v_c": 0.004},
    "rate_and_state": {"A": 0.4, "B": 0.9, "L": 1e-3, "v_c": 0.003},
    "gravity": {"a": 5.0, "b": -2.0},
    "position_dependence": {"k": 7.0, "m": 3.0},
    "position_periodic": {"c": 0.3, "s": 0.4, "wavelength": 5e-3},
    "presliding": {"a": 9.0, "sigma_1": 20.0, "x_c": 1e-4},
    "time_drift": {"r": 0.1, "s": 0.2},
    "servo_lag": {"tau": 2e-3},
    "sensor_lag": {"tau": 1e-3},
    "sensor_delay": {"d": 1e-3},
}
"""Effects of an axis with values of their parameters, SI."""
SLOWEST, FASTEST, WIDTH = 0.01, 0.3, 5e-4


def model(*effects: str, part: float = 0.01, loose=(), axis=None, **changes) -> dict:
    """The entries of a loop.json that a feedforward is made of; independent errors, each `part` of
    its parameter."""
    values = BASE | {f"{e}.{name}": v for e in effects for name, v in FOUND[e].items()}
    spread = np.diag((part * np.abs(list(values.values()))) ** 2).tolist()
    about = {
        "coordinate": "linear", "sign_width": WIDTH, "acceleration": 2.0, "covariance": spread,
        "gains": {"slowest": SLOWEST, "fastest": FASTEST, "sentence": "Nothing is said."},
    }  # fmt: skip
    content = {
        "schema": "jaxfric.loop/2",
        "friction_unit": "N",
        "law": "coulomb_viscous",
        "verdict": "effects",
        "steps": [[0.0, 0.02], [1.0, -0.25]],
        "effects": list(effects),
        "candidates": [{"effects": list(effects), "converged": True}],
        "location_map": [{"variable": "position", "centres": [-0.05, 0.0, 0.15]}],
        "after": {
            "parameters": {
                k: {"value": v, "determined": k not in loose} for k, v in values.items()
            },
            "free": list(values),
            "covariance": (100 * np.asarray(spread)).tolist(),
        },
        "axis": {**about, **(axis or {})},
        "warnings": ["the loop's own"],
    }
    return {**content, **changes}


def saved(folder: Path, *effects: str, **changes) -> Path:
    """The file of such a model."""
    path = folder / "loop.json"
    path.write_text(json.dumps(model(*effects, **changes)), encoding="utf-8")
    return path


def by_hand(p: dict, v: float, fade: float, q: float = 0.0, a: float = 0.0) -> float:
    """The feedforward of parameters by name, from the equations of the effects, written out."""
    s, speed, width = np.tanh(v / fade), abs(v), WIDTH
    level = p["F_c"] + p.get("direction_asymmetry.d", 0.0) * v
    if "stribeck.fs" in p:
        level += p["stribeck.fs"] * np.exp(-((speed / p["stribeck.vs"]) ** p["stribeck.n"]))
    if "log_viscous.c" in p:
        level += p["log_viscous.c"] * np.log(1 + speed / max(p["log_viscous.v_c"], width))
    if "rate_and_state.A" in p:
        less = p["rate_and_state.A"] - p["rate_and_state.B"]
        level += less * np.log(1 + speed / max(p["rate_and_state.v_c"], width))
    level += p.get("position_dependence.m", 0.0) * q
    force = p["M"] * a + p["F_v"] * v + p["F_0"] + p.get("cubic.c", 0.0) * v**3
    force += p.get("position_dependence.k", 0.0) * q
    force += p.get("gravity.a", 0.0) * np.sin(q) + p.get("gravity.b", 0.0) * np.cos(q)
    if "position_periodic.c" in p:
        phase = 2 * np.pi * q / p["position_periodic.wavelength"]
        force += p["position_periodic.c"] * np.cos(phase) + p["position_periodic.s"] * np.sin(phase)
    return float(force + s * level)
