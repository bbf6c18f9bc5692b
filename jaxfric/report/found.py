"""The results that verbs saved below a folder, each with its main numbers, for a page of all.

Read from the files alone, by their schema, so that results of any day can be on one page. A-B with
its error stands first where friction is rate-and-state.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..loop.result import TextTable
from ..runs.table import measured

_SKIPPED = (".zarr", ".git")
_LENGTHS = frozenset(("L", "L2", "L3"))


class FoundResult(NamedTuple):
    """One result: its file below the folder, what it is, its main sentence or '', its numbers, its
    warnings, the figures that lie beside it, and its page or None."""

    file: Path
    what: str
    sentence: str
    numbers: TextTable
    warnings: tuple[str, ...]
    figures: tuple[Path, ...]
    page: Path | None


class _Told(NamedTuple):
    """What a schema says: its kind, sentence, numbers, and names of figures and page."""

    what: str
    sentence: str
    numbers: TextTable
    figures: tuple[str, ...]
    page: str = ""


def find_results(folder: Path) -> tuple[list[FoundResult], list[str]]:
    """Results below a folder in the order of their paths, and files that are damaged, a line each.

    Files of other programs are passed over; so are the chunks of a study's store, of which only the
    store is told.
    """
    found: list[FoundResult] = []
    damaged: list[str] = []
    for path in sorted(folder.rglob("*")):
        inside = path.relative_to(folder)
        if any(part.endswith(_SKIPPED) for part in inside.parts[:-1]):
            continue
        if path.is_dir() and path.suffix == ".zarr":
            found.append(_store(path))
        elif path.suffix == ".json" and not path.name.startswith("."):
            one = _result(path, damaged)
            found += [] if one is None else [one]
    return found, damaged


def _store(path: Path) -> FoundResult:
    sentence = f"Its numbers are in the store; maps of it: jaxfric study --plot {path}"
    figures = tuple(sorted(path.parent.glob(f"{path.stem}-figures/*.png")))
    return FoundResult(path, "a study", sentence, _table([]), (), figures, None)


def _result(path: Path, damaged: list[str]) -> FoundResult | None:
    """The result of a JSON file; None where it is none of ours."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        damaged.append(f"{path}: cannot be read as JSON; it is left out")
        return None
    schema = content.get("schema") if isinstance(content, dict) else None
    teller = _TELLERS.get(str(schema).rpartition("/")[0])
    if teller is None:
        return None
    try:
        told = teller(content)
        warnings = tuple(str(line) for line in content.get("warnings", ()))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError):
        damaged.append(f"{path}: a file of schema {schema} that is damaged; it is left out")
        return None
    named = (path.with_name(name.format(stem=path.stem)) for name in told.figures)
    figures = [figure for figure in dict.fromkeys(named) if figure.is_file()]
    if path.name == "fit.json" and (drawn := path.with_name("posterior.png")).is_file():
        figures.append(drawn)
    page = path.with_name(told.page) if told.page else None
    there = page if page is not None and page.is_file() else None
    return FoundResult(
        path, told.what, told.sentence, told.numbers, warnings, tuple(figures), there
    )


def _table(rows: list[tuple[str, str, str]], note: str = "") -> TextTable:
    return TextTable("", ("", "value", "unit"), rows, note)


def _number(value: object, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if isinstance(value, int | float) else "-"


def _rate_dependence(table: Mapping) -> tuple[float, float]:
    """A less the sum of all B and its standard error, from parameters and their covariance."""
    parameters = table["parameters"]
    letters = {name: name.rpartition(".")[2].rstrip("0123456789") for name in parameters}
    sign = {n: 1.0 if k == "A" else -1.0 for n, k in letters.items() if k in ("A", "B")}
    value = sum(sign[name] * parameters[name]["value"] for name in sign)
    weight = np.array([sign.get(name, 0.0) for name in table["free"]])
    matrix = np.asarray(table["covariance"], float)
    return value, float(np.sqrt(max(weight @ matrix @ weight, 0.0)))


def _slope(fit: Mapping | None) -> str:
    """A-B with its error; '' without a fit that converged."""
    return measured(*_rate_dependence(fit)) if fit is not None and fit["converged"] else ""


def _parameters(table: Mapping) -> list[tuple[str, str, str]]:
    """A-B first, then every parameter that was fitted, with standard errors."""
    rows = []
    unit = str(table["parameters"].get("A", {}).get("unit", "1"))
    if "A" in table["parameters"]:
        value, error = _rate_dependence(table)
        rows.append(("A-B", measured(value, error), unit))
    for name, estimate in table["parameters"].items():
        if not estimate.get("free", True):
            continue
        length = name.rpartition(".")[2] in _LENGTHS
        scale, unit = (1e6, "µm") if length else (1.0, str(estimate.get("unit", "")))
        std = estimate.get("std")
        if std is None or not estimate.get("determined", True):
            text = "not determined"
        else:
            text = measured(scale * estimate["value"], scale * std)
        rows.append((f"{name} (D_c)" if length else name, text, unit))
    return [(name, text, "" if unit == "1" else unit) for name, text, unit in rows]


def _fit(content: Mapping) -> _Told:
    states = int(content["states"])
    law = f"{content['law']} law" + (f", {states} states" if states > 1 else "")
    if not content["converged"]:
        sentence = f"It did not converge ({content['result']}): its numbers mean nothing."
        return _Told(f"a fit of the {law}", sentence, _table([]), ("{stem}.png",))
    rows = [*_parameters(content), ("rms", _number(content["rms"]), "")]
    note = "in brackets: one standard error, in the last two digits"
    return _Told(f"a fit of the {law}", "", _table(rows, note), ("{stem}.png",))


def _run(content: Mapping) -> _Told:
    rows = []
    for step in content["steps"]:
        text = _slope(step["fit"]) or f"no fit: {step['failed'] or 'it did not converge'}"
        rows.append((f"A-B of step {step['number']}, at {step['time']:.5g} s", text, ""))
    count = len(content["steps"])
    kinds = f"{len(content['events'])} events, {count} velocity step{'s' * (count != 1)}"
    figures = ("events.png", "rates.png", "holds.png", "stick_slip.png", "stress_steps.png")
    return _Told("a whole run", f"{kinds}.", _table(rows), figures, "run.html")


def _loop(content: Mapping) -> _Told:
    after = content.get("after") or {}
    rows = _parameters(after) if "covariance" in after else []
    figures = ("residual.png", "location.png", "candidates.png")
    what = "a loop: what does the model lack?"
    return _Told(what, str(content["sentence"]), _table(rows), figures, "loop.html")


def _steady(content: Mapping) -> _Told:
    return _Told("friction at steady speeds", str(content["sentence"]), _table([]), ("curve.png",))


def _gains(content: Mapping) -> _Told:
    rows = [
        ("k_p", _number(content["kp"]), "N/m"),
        ("k_v", _number(content["kv"]), "N s/m"),
    ]
    for name, margin in content["margins"].items():
        unit = margin["unit"]
        rows.append(
            (f"margin {name}, worst", _number(margin["value"]), "" if unit == "1" else unit)
        )
    required = ", ".join(f"{name} {value:g}" for name, value in content["required"].items())
    sentence = f"Required in every scenario: {required}. Law: {content['law']}"
    return _Told("the smallest gains", sentence, _table(rows), ("gains.png", "end_map.png"))


def _comparison(content: Mapping) -> _Told:
    rows = []
    for one in content["laws"]:
        above = one["bic_above_best"]
        states = f", {one['states']} states" if one["states"] > 1 else ""
        slope = _slope(one["fit"]) or "not determined"
        text = "could not be fitted" if above is None else f"{above:.1f}"
        rows.append((f"{one['law']}{states}", f"BIC above least: {text}", f"A-B {slope}"))
    table = TextTable("", ("law", "", ""), rows)
    return _Told("friction laws compared", str(content["sentence"]), table, ("compare.png",))


def _fits(content: Mapping) -> _Told:
    rows = []
    for one in content["fits"]:
        rows.append((f"A-B of {one['file']}", _slope(one["fit"]) or "no fit", ""))
    return _Told("fits of several records", f"{len(rows)} records.", _table(rows), ())


def _sentence(what: str, *figures: str) -> Callable[[Mapping], _Told]:
    def told(content: Mapping) -> _Told:
        return _Told(what, str(content.get("sentence", "")), _table([]), figures)

    return told


_TELLERS: dict[str, Callable[[Mapping], _Told]] = {
    "jaxfric.fit": _fit,
    "jaxfric.fits": _fits,
    "jaxfric.run": _run,
    "jaxfric.loop": _loop,
    "jaxfric.steady": _steady,
    "jaxfric.gains": _gains,
    "jaxfric.comparison": _comparison,
    "jaxfric.prediction": _sentence("a saved model on another record", "prediction.png"),
    "jaxfric.feedforward": _sentence("friction to compensate", "feedforward.png"),
    "jaxfric.protocol": _sentence("a plan of velocity steps", "aliasing.png"),
    "jaxfric.stability": _sentence("linear stability", "force.png", "stiffness.png"),
}
"""What is told of a file, by its schema without the number."""
