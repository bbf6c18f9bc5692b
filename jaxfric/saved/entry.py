"""The entry "friction_law" of a result file: the parameters of a law, in one form for all results.

    name            a rate-and-state law of the registry, or "coulomb_viscous" of an axis
    states          number of states of the law without effects; 0 for an axis
    friction_unit   "1" for a friction coefficient, "N", "N m" or "%"; parameters are SI with it
    coordinate      "linear" or "rotary"
    origin          the source of the law, in words
    effects         ids of the effects found, and of the effects of the base
    parameters      by name {value, unit, determined}: f0, A, B, L, B2, ..., V0 of a slider, M, F_v,
                    F_c, F_0 of an axis, and effect.parameter
    free            names of the p parameters with an error
    covariance      (p, p), in the order of `free`
    velocity        slowest and fastest velocity of the record [m/s], or null
    width, reach    of an axis' record [m/s], [m]
    warnings        lines to read before using the law
    warned          code and values of each line

For files of older versions, this module makes the entry "friction_law" from other entries.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..effects import effects_of_file
from ..errors import InputError
from ..findings import WarningCode, listed, read_warnings, warned
from ..laws.fitted import FittedLaw
from ..laws.registry import count_states, fixed_states, is_rate_state
from ..quantity import numbered_names
from ..rig import Rig
from ..rig.axis import LAW, AxisRig
from ..schemas import FIT, LOOP
from ..stability.claims import Claim, held_with_trend, no_claim, one_sign, rate_state_claim
from ..stability.reasons import ClaimReason
from .files import (
    Saved,
    is_lines,
    missing_key,
    own_warnings,
    read_saved,
    refuse_damage,
    table_damage,
    values_of,
)

ENTRY = "friction_law"
CERTAIN = ("no_missing_effect", "effects", "ambiguous")
"""Verdicts whose model describes the record."""
_KEYS = (
    *("name", "states", "friction_unit", "coordinate", "origin", "effects", "parameters", "free"),
    *("covariance", "velocity", "width", "reach", "warnings"),
)


def fitted_law(source: Saved, *schemas: str) -> FittedLaw:
    """Return the law of a Fit or a Loop, or of a result file with one of the `schemas`.

    Raises
    ------
    InputError : file missing, damaged or of another schema; a fit that did not converge; an effect
        that is not in the catalogue.
    """
    return law_in(*read_saved(source, *(schemas or (FIT, LOOP))))


def law_in(path: Path, content: Mapping) -> FittedLaw:
    """Return the law of a result file with this content.

    Raises
    ------
    InputError : damaged content; an effect that is not in the catalogue.
    """
    schema, entry = content["schema"], content.get(ENTRY)
    if entry is None:
        try:
            where = "" if schema == FIT else "after."
            problem = table_damage(_table(content), where=where)
            entry = None if problem else law_entry(content)
        except KeyError as error:
            problem = f"{error} is missing"
        except (AttributeError, TypeError, ValueError):
            problem = "an entry that its law is made of has another form"
        refuse_damage(path, schema, problem)
    return read_entry(path, entry, schema)


def read_entry(path: Path, entry: object, schema: str) -> FittedLaw:
    """Check the entry of a file with a `schema`, and return the law of the entry.

    Raises
    ------
    InputError : damaged content; a law or an effect that is not registered.
    """
    law = entry.get("name") if isinstance(entry, dict) else None
    if law is not None and law != LAW and not is_rate_state(law):
        raise InputError(
            f"{path}: law '{law}' is not known; register a law of your own first, in"
            " jaxfric.laws.REGISTRY"
        )
    refuse_damage(path, schema, _damage(entry))
    own: dict[str, Any] = {key: entry[key] for key in _KEYS}  # ty: ignore[not-subscriptable]
    try:
        rig = AxisRig if own["name"] == LAW else Rig
        own["effects"] = effects_of_file(own["effects"], rig)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    own["loose"] = [n for n, item in own["parameters"].items() if not item.get("determined", True)]
    own["parameters"] = values_of(own)
    own["warnings"] = read_warnings(entry)  # ty: ignore[invalid-argument-type]
    own["velocity"] = None if own["velocity"] is None else tuple(own["velocity"])
    own["covariance"] = np.asarray(own["covariance"], float).reshape(2 * [len(own["free"])])
    fitted = FittedLaw(str(path), **own)
    missing = next((name for name in fitted.quantities() if name not in fitted.parameters), None)
    refuse_damage(path, schema, missing and f"parameter {missing} is missing")
    return fitted


def _damage(entry: object) -> str | None:
    """Return the fault of an entry in words: what is missing or wrong; None if it is valid."""
    problem = missing_key(entry, _KEYS, f"{ENTRY}.")
    if problem:
        return problem
    assert isinstance(entry, dict)
    name, states, seen = entry["name"], entry["states"], entry["velocity"]
    always = 0 if name == LAW else fixed_states(name)
    if states not in (range(1, 10) if always is None else (always,)):
        return f"the number of states is '{states}'"
    pair = isinstance(seen, list) and len(seen) == 2 and all(map(_is_size, seen))
    valid = {
        "effects": is_lines(entry["effects"]),
        "warnings": is_lines(entry["warnings"]),
        "coordinate": entry["coordinate"] in ("linear", "rotary"),
        "width": _is_size(entry["width"]),
        "reach": _is_size(entry["reach"]),
        "velocity": seen is None or pair,
    }
    wrong = next((key for key, good in valid.items() if not good), None)
    return table_damage(entry) if wrong is None else f"'{wrong}' is {entry[wrong]!r}"


def _is_size(number: object) -> bool:
    return isinstance(number, int | float) and 0 <= number < math.inf


def law_entry(content: Mapping) -> dict[str, Any]:
    """Make the entry "friction_law" of a fit.json or loop.json from its other entries, `content`.

    Raises KeyError, TypeError, ValueError or AttributeError if `content` is damaged.
    """
    fit, law = content["schema"] == FIT, content["law"]
    axis, table = law == LAW, _table(content)
    known = {law_name(name): item for name, item in table["parameters"].items()}
    if not axis:
        known.setdefault("V0", {"value": content.get("reference_velocity"), "unit": "m/s"})
    about = content.get("axis") or {}
    if fit:
        states, origin = content["states"], f"{content['states']} state(s), fitted"
        velocities, found = (content.get("steps") or {}).get("velocities", []), []
        warnings = _doubts(content)
    else:
        states = 0 if axis else count_states(law if is_rate_state(law) else None, known)
        origin = f"from the loop ({content['verdict']})"
        velocities = [step[-1] for step in content.get("steps", [])]
        found = content["effects"] if supported(content) == "after" else []
        warnings = [*verdict_words(content), *_claim(about), *_undetermined(table)]
    declared = [name.split(".")[0] for name in known if "." in name]
    return {
        "name": law,
        "states": states,
        "friction_unit": content["friction_unit"],
        "coordinate": about.get("coordinate") or "linear",
        "origin": origin,
        "effects": list(dict.fromkeys(found + declared)),
        "parameters": {
            name: {
                "value": item["value"],
                "unit": item.get("unit"),
                "determined": item.get("determined", True),
            }
            for name, item in known.items()
        },
        "free": [law_name(name) for name in table["free"]],
        "covariance": table["covariance"],
        "velocity": seen_velocities(velocities),
        "width": about.get("sign_width") or 0.0,
        "reach": about.get("least_slip_length") or 0.0,
        **listed((*own_warnings(content), *warnings)),
    }


def _table(content: Mapping) -> Mapping:
    """Return the part of a file with the parameters of the model to use."""
    return content if content["schema"] == FIT else content[supported(content)]


def law_name(name: str) -> str:
    """Return a parameter's name in the entry: a slip trend of the base is named as an effect."""
    return "slip_trend.s" if name == "slip_trend" else name


def seen_velocities(velocities: Sequence[float]) -> list[float] | None:
    """Return the slowest and fastest velocity [m/s] of a record except 0; None if all are 0."""
    sizes = [abs(v) for v in velocities if v != 0]
    return [min(sizes), max(sizes)] if sizes else None


def open_words(what: str, claim: Claim, of: str) -> list[str]:
    """Warn if a result (`what`) supports no claim on stability; the warning names its `of`."""
    if claim.kind != "open":
        return []
    return [warned(WarningCode.NO_CLAIM, what=what, reasons=claim.reasons, of=of)]


def _doubts(content: Mapping) -> list[str]:
    """Warn if the parameters of a fit.json support no claim on stability."""
    known, free = content["parameters"], content["free"]
    names = numbered_names(content["states"])
    weight = np.array([(name == "A") - (name in names[0::2]) for name in free], float)
    covariance = np.asarray(content["covariance"], float).reshape(len(free), len(free))
    variance = float(weight @ covariance @ weight)
    claim = rate_state_claim(
        known["A"]["value"],
        [known[name]["value"] for name in names[0::2]],
        math.sqrt(variance) if variance >= 0 else math.nan,
        determined=all(known[name].get("determined", True) for name in ("A", *names)),
    )
    if claim.kind != "open" and not _is_known(content):
        claim = no_claim(ClaimReason.OTHER_LENGTH)
    claim = held_with_trend(claim, content.get("A_minus_B_with_trend"))
    return open_words("fit", claim, "values and samples")


def _undetermined(table: Mapping) -> list[str]:
    """Warn if the model of a loop leaves the sign of A - B undetermined."""
    unknown = no_claim(ClaimReason.UNDETERMINED, parameter="the sign of A - B")
    claim = Claim("critical") if _is_known(table) else unknown
    return open_words("loop", claim, "values and samples")


def _is_known(table: Mapping) -> bool:
    """Whether a model of a file determines its A - B with its sign, if it has one."""
    rate = table.get("A_minus_B") or {}
    return rate.get("determined", True) and one_sign((rate.get("lower"), rate.get("upper")))


def _claim(about: Mapping) -> list[str]:
    """Warn if the loop of an axis makes no claim on stability."""
    gains = about.get("gains") or {}
    if gains.get("claim") != "open":
        return []
    sentence = " ".join(str(gains.get("sentence") or "Nothing is said of stability.").split())
    return [warned(WarningCode.AXIS_CLAIM, sentence=sentence)]


def verdict_words(content: Mapping) -> list[str]:
    """Warn if, by the verdict of a loop.json, the loop's model does not describe the record."""
    if content["verdict"] in CERTAIN:
        return []
    sentence = str(content.get("sentence") or "").strip().rstrip(".")
    more = f" ({sentence})" if sentence else ""
    last = supported(content) == "after"
    code = WarningCode.LAST_MODEL if last else WarningCode.BASE_MODEL
    return [warned(code, verdict=content["verdict"], sentence=more)]


def supported(content: Mapping) -> str:
    """Return which model of a loop.json to use, "before" or "after" (`Loop.supported`)."""
    return "before" if content.get("supported") == "before" else "after"
