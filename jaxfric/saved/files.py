"""Read and check the JSON files of fits, loops and steady curves."""

import json
import math
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, option
from ..findings import WarningCode, marked, read_warnings, warned
from ..schemas import FIT, STEADY, VERBS
from .upgrade import upgraded


@typing.runtime_checkable
class SavedResult(typing.Protocol):
    """A result that can be written to a file: a Fit, a Loop."""

    def to_json(self) -> dict: ...


Saved = SavedResult | str | Path
"""A Fit or a Loop, or the path of its file."""


def read_saved(source: Saved, *schemas: str) -> tuple[Path, dict]:
    """Return path and content of a file with one of the `schemas`.

    For a result object, the function returns a name for messages, and the content that a file of
    the result would have. Files of earlier versions are converted to the current form.

    Raises
    ------
    InputError : no such file, no JSON, another schema, a fit that did not converge; warnings that
        are not a list of lines.
    """
    verbs = " or ".join(VERBS[schema] for schema in schemas)
    if isinstance(source, SavedResult):
        content = json.loads(json.dumps(source.to_json()))
        of = content.get("record")
        of = f" of {of['path']}" if isinstance(of, dict) and "path" in of else ""
        path = Path(f"{type(source).__name__}{of}")
        return path, _checked(path, content, *schemas)
    path = Path(source)
    if path.suffix == ".nc":
        raise InputError(
            f"{path}: a posterior, which is not read here; a file of {verbs} is needed, as the"
            " fit.json beside it"
        )
    try:
        content = upgraded(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; make one with: {verbs}") from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror}; name a file of {verbs}, NAME/fit.json say"
        ) from None
    except ValueError as error:
        place = f" (line {error.lineno})" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{path}: not a JSON file, or damaged{place}; make it again") from None
    return path, _checked(path, content, *schemas)


def _checked(path: Path, content: dict, *schemas: str) -> dict:
    """Return the content of a file if it has one of the `schemas` and may be used."""
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema == STEADY and STEADY not in schemas:
        curve = content.get("curve")
        rotary = isinstance(curve, dict) and curve.get("coordinate") == "rotary"
        units, law = "N and m/s", "c0=20 N, c1=170 N*s/m, c2=5 N, c3=10 mm/s, c4=1"
        if rotary:
            units = "N m and rad/s"
            law = "c0=0.2 N m, c1=0.01 N m s/rad, c2=0.05 N m, c3=1 rad/s, c4=1"
        raise InputError(
            f"{path}: a steady-state curve, whose friction has no memory: its entry gains has the"
            f" required damping. For margins give its law by name, in {units}:"
            f" {option('law', 'stribeck')} {option('parameters', law)}"
        )
    if schema not in schemas:
        found = f"its schema is '{schema}'" if schema else "it names no schema"
        known = " or ".join(f"'{name}' ({VERBS[name]})" for name in schemas)
        raise InputError(f"{path}: {found}; a file of schema {known} is needed")
    if schema == FIT and content.get("converged", True) is not True:
        if content["converged"] is not False:
            refuse_damage(path, FIT, f"converged is {content['converged']!r}, not true or false")
        raise InputError(
            f"{path}: this fit did not converge ({content.get('result', 'no reason is given')}), so"
            " its parameters mean nothing; fit the record again, with other steps, stiffness or"
            " starting values"
        )
    if not is_lines(content.get("warnings", [])):
        refuse_damage(path, str(schema), "the warnings are no list of lines")
    return content


def is_lines(warnings: object) -> bool:
    """Whether the value is a list of texts."""
    return isinstance(warnings, list) and all(isinstance(line, str) for line in warnings)


def own_warnings(content: Mapping) -> tuple[str, ...]:
    """Return the warnings in a fit.json or loop.json, each marked as from the file.

    The warnings hold for all results from the file's parameters, so that every command prints these
    warnings. A fit.json without the entry `converged` is used, with a warning.
    """
    verb = "fit" if content["schema"] == FIT else "loop"
    lines = [*read_warnings(content)]
    if content["schema"] == FIT and "converged" not in content:
        lines.append(warned(WarningCode.UNSAID))
    return marked(f"the {verb} warned", filter(None, dict.fromkeys(lines)))


def refuse_damage(path: Path, schema: str, problem: str | None) -> None:
    """Raise `InputError` if there is a problem with a file of the right schema."""
    if problem:
        raise InputError(f"{path}: damaged: {problem}; make it again with: {VERBS[schema]}")


def missing_key(content: object, keys: Sequence[str], where: str = "") -> str | None:
    """Return a problem with the first of `keys` that a table lacks, or None."""
    if not isinstance(content, dict):
        return f"'{where}' is no table"
    return next((f"'{where}{key}' is missing" for key in keys if key not in content), None)


def table_damage(table: Any, needed: Sequence[str] = (), where: str = "") -> str | None:
    """Return the fault in "parameters", "free" and "covariance" of a table, in words, or None."""
    problem = missing_key(table, ("parameters", "free", "covariance"), where)
    if problem:
        return problem
    parameters, free = table["parameters"], table["free"]
    if not isinstance(parameters, dict):
        return "the parameters are no table"
    if not isinstance(free, list) or not all(isinstance(name, str) for name in free):
        return "the free parameters are no list of names"
    for name in needed:
        if name not in parameters:
            return f"parameter {name} is missing"
    for name, item in parameters.items():
        value = item.get("value") if isinstance(item, dict) else None
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and math.isfinite(value)):
            return f"parameter {name} has no value"
    try:
        matrix = np.asarray(table["covariance"], float)
    except (TypeError, ValueError):
        return "the covariance is not a matrix of numbers"
    size = len(free)
    if matrix.shape != (size, size) and size:
        return f"the covariance has shape {matrix.shape} for {size} free parameters"
    if not set(free) <= set(parameters):
        return "a free parameter is not among the parameters"
    return None


def values_of(table: Mapping) -> dict[str, float]:
    """Return parameter values by name (SI)."""
    return {name: float(item["value"]) for name, item in table["parameters"].items()}
