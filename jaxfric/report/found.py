"""The results that verbs saved below a folder, each with its main numbers, for a page of all.

Read from the files alone, by their schema, so that results of any day can be on one page. A-B with
its error stands first where friction is rate-and-state.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..runs.table import BRACKETS, amount
from ..units import measured
from .tables import TextTable

_SKIPPED = (".zarr", ".git")
_LENGTHS = frozenset(("L", "L2", "L3"))
_PER_MICROMETRE = {"m": (1e6, "µm"), "1/m": (1e-6, "1/µm"), "N/m": (1e-6, "N/µm")}
"""How many of a readable unit one SI unit is, for lengths and stiffnesses."""
_LEFT_OPEN = {
    "outside_catalogue": "what is missing is not named",
    "ambiguous": "it cannot say which effect is missing",
}
"""What a verdict leaves open, for the list of results."""


class FoundResult(NamedTuple):
    """One result: its file below the folder, what it is, its main sentence or '', its numbers, its
    warnings, the figures that lie beside it, its page or None, and what its verdict leaves open."""

    file: Path
    what: str
    sentence: str
    numbers: TextTable
    warnings: tuple[str, ...]
    figures: tuple[Path, ...]
    page: Path | None
    left_open: str = ""

    @property
    def mark(self) -> str:
        """What a reader of the list of results must know of it, in brackets; '' for nothing."""
        marks = [*(["it warns"] if self.warnings else []), *filter(None, [self.left_open])]
        return f" ({'; '.join(marks)})" if marks else ""


class _Told(NamedTuple):
    """What a schema says: its kind, sentence, numbers, names of figures and page, and the warnings
    of what is in it."""

    what: str
    sentence: str
    numbers: TextTable
    figures: tuple[str, ...]
    page: str = ""
    warnings: tuple[str, ...] = ()


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
        warnings = (*told.warnings, *(str(line) for line in content.get("warnings", ())))
        left_open = _LEFT_OPEN.get(str(content.get("verdict")), "")
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
        path, told.what, told.sentence, told.numbers, warnings, tuple(figures), there, left_open
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


def _rate_text(table: Mapping, unknown: str) -> str:
    """A-B with its error, or `unknown` where A or a B is not determined."""
    known = table["parameters"]
    of = [n for n in known if n.rpartition(".")[2].rstrip("0123456789") in ("A", "B")]
    determined = all(known[n].get("determined", True) for n in of)
    return measured(*_rate_dependence(table)) if determined else unknown


def _of_fits(
    head: tuple[str, ...], rows: Sequence[tuple[tuple[str, ...], Mapping | None, str]]
) -> TextTable:
    """A table of fits: cells that come first, under `head`, the parameters, K, and why there are
    none."""
    fits = [fit for _, fit, _ in rows if fit is not None]
    force = any(fit["parameters"]["A"].get("unit") == "N" for fit in fits)
    own = [f"{name} [N]" if force else name for name in ("A-B", "A", "B")]
    K = "K [N/µm]" if force else "K [1/µm]"
    heads = (*head, *own, "L (D_c) [µm]", K, "")
    return TextTable(
        "", heads, [(*first, *_of_fit(fit), why) for first, fit, why in rows], BRACKETS
    )


def _of_fit(fit: Mapping | None) -> tuple[str, ...]:
    """A-B, A, B, L and K as text; blank without a fit that converged, a dash: not determined."""
    if fit is None or not fit["converged"]:
        return ("",) * 5
    known = fit["parameters"]
    states = [name[1:] for name in known if name[0] == "B"]
    cells = [_rate_text(fit, "-")]
    for letter, of in (("A", [""]), ("B", states), ("L", states), ("K", [""])):
        cells.append(", ".join(_estimated(letter + s, known.get(letter + s)) for s in of))
    return tuple(cells)


def _estimated(name: str, estimate: Mapping | None) -> str:
    """A parameter in the unit of `_of_fits`, with its error where it was fitted."""
    if estimate is None:
        return ""
    if not estimate.get("determined", True):
        return "-"
    scale = {"L": 1e6, "K": 1e-6}.get(name[0], 1.0)
    return measured(scale * estimate["value"], scale * (estimate.get("std") or 0.0))


def _parameters(table: Mapping) -> list[tuple[str, str, str]]:
    """A-B first, then every parameter that was fitted, with standard errors."""
    rows = []
    unit = str(table["parameters"].get("A", {}).get("unit", "1"))
    if "A" in table["parameters"]:
        rows.append(("A-B", _rate_text(table, "not determined"), unit))
    for name, estimate in table["parameters"].items():
        if not estimate.get("free", True):
            continue
        last, unit = name.rpartition(".")[2], str(estimate.get("unit", ""))
        length, scale = last in _LENGTHS, 1.0
        if length or last == "K":
            scale, unit = _PER_MICROMETRE.get(unit, (1.0, unit))
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
    return _Told(f"a fit of the {law}", "", _table(rows, BRACKETS), ("{stem}.png",))


def _run(content: Mapping) -> _Told:
    rows = [
        ((str(step["number"]), f"{step['time']:.5g}"), step["fit"], _why(step))
        for step in content["steps"]
    ]
    table = _of_fits(("step", "time [s]"), rows)
    count = len(content["steps"])
    kinds = f"{len(content['events'])} events, {count} velocity step{'s' * (count != 1)}"
    figures = ("events.png", "rates.png", "holds.png", "stick_slip.png", "stress_steps.png")
    return _Told("a whole run", f"{kinds}.", table, figures, "run.html")


def _why(one: Mapping) -> str:
    """Why there are no numbers; '' where there are."""
    if one["fit"] is None:
        return f"no fit: {one['failed']}"
    return "" if one["fit"]["converged"] else f"it did not converge: {one['fit']['result']}"


def _loop(content: Mapping) -> _Told:
    after = content.get("after") or {}
    rows = _parameters(after) if "covariance" in after else []
    figures = ("residual.png", "location.png", "candidates.png")
    what = "a loop: what does the model lack?"
    return _Told(what, str(content["sentence"]), _table(rows), figures, "loop.html")


def _steady(content: Mapping) -> _Told:
    withheld = tuple(str(line) for line in content.get("withheld", ()))
    what = "friction at steady speeds"
    return _Told(what, str(content["sentence"]), _table([]), ("curve.png",), warnings=withheld)


def _gains(content: Mapping) -> _Told:
    # at its default lower limit k_p stands for any stiffness, as in the words of the command
    low, any_ = content["limits"]["kp"][0], ("k_p", "any k_p > 0", "")
    if content.get("controller_delay") is not None:
        any_ = ("k_p", "any small k_p", "")
    is_any = content["kp"] <= 1.000001 * low <= 1e-8 * content["scales"]["kp"]
    rows = [
        any_ if is_any else ("k_p", _number(content["kp"]), content["units"]["kp"]),
        ("k_v", _number(content["kv"]), content["units"]["kv"]),
    ]
    resting = content.get("at_rest") or {}
    if resting.get("dead_band") is not None:
        unit = resting["units"]["dead_band"]
        rows.append(("stops within", _number(resting["dead_band"]), unit))
    for name, margin in content["margins"].items():
        unit = margin["unit"]
        rows.append(
            (f"margin {name}, worst", _number(margin["value"]), "" if unit == "1" else unit)
        )
    required = ", ".join(f"{name} {value:g}" for name, value in content["required"].items())
    sentence = f"Required in every scenario: {required}. Law: {content['law']}"
    if content.get("not_recommended"):
        sentence = f"NOT RECOMMENDED: {'; '.join(content['not_recommended'])}. {sentence}"
    return _Told("the smallest gains", sentence, _table(rows), ("gains.png", "end_map.png"))


def _comparison(content: Mapping) -> _Told:
    rows = []
    for one in content["laws"]:
        above = one["bic_above_best"]
        states = f", {one['states']} states" if one["states"] > 1 else ""
        bic = "" if above is None else amount(above)
        why = "could not be fitted" if above is None else ""
        rows.append(((f"{one['law']}{states}", bic), one["fit"], why))
    table = _of_fits(("law", "BIC above least"), rows)
    return _Told("friction laws compared", str(content["sentence"]), table, ("compare.png",))


def _fits(content: Mapping) -> _Told:
    rows = [((str(one["file"]),), one["fit"], _why(one)) for one in content["fits"]]
    table = _of_fits(("file",), rows)
    warnings = [
        f"{one['file']}: {text}"
        for one in content["fits"]
        for text in (one["fit"].get("warnings", ()) if one["fit"] else (_why(one),))
    ]
    sentence = f"{len(rows)} records."
    return _Told("fits of several records", sentence, table, (), warnings=tuple(warnings))


def _protocol(content: Mapping) -> _Told:
    """The plan of velocity steps: whether it tells effects apart, and what would help."""
    plan, asked = content["plan"], content.get("asked")
    sentences = []
    if asked is not None:
        names = " from ".join(asked["effects"])
        would = None if asked["told_apart"] else asked.get("change")
        would = f"; it would with {would['text']}" if would and would["enough"] else ""
        told = "tells" if asked["told_apart"] else "cannot tell"
        sentences.append(f"It {told} {names}{would}.")
    pairs = ["/".join(pair["effects"]) for pair in plan["pairs"]]
    sentences.append(
        f"It cannot tell apart {', '.join(pairs)}."
        if pairs
        else "It tells all effects apart that it sees."
    )
    if plan["unseen"]:
        sentences.append(f"It does not see {', '.join(plan['unseen'])}.")
    best = [c["text"] for c in content["changes"] if c["change"] == content["recommended"]]
    what = "Recommended" if asked is None else "For most pairs"
    sentences += [f"{what}: {text}." for text in best]
    figures = ("aliasing.png",)
    return _Told("a plan of velocity steps", " ".join(sentences), _table([]), figures)


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
    "jaxfric.protocol": _protocol,
    "jaxfric.stability": _sentence("linear stability", "force.png", "stiffness.png"),
}
"""What is told of a file, by its schema without the number."""
