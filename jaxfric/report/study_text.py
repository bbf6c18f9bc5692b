"""Describe a study in words and as JSON: its outputs, and the number of members with each code."""

from typing import TYPE_CHECKING

import numpy as np

from ..schemas import STUDY_SUMMARY
from ..units import duration
from .report import NextStep, Report

if TYPE_CHECKING:
    from xarray import Dataset

_WORDS = {"limit_cycle": "limit cycle, which is stick-slip"}
"""Codes in words, where these say more."""
_SHOWN = 5
"""Texts of errors that are shown."""
_NOT_PLAIN = ("escape", "failed")
"""Codes of the end of a motion whose meaning is shown."""


def report(found: "Dataset", seconds: float, members: int, store: str) -> Report:
    """Report how many members the study has, how many this run did, and how many have each code."""
    dims = found["outcome"].dims
    shape = " x ".join(f"{found.sizes[d]} {d}" for d in dims)
    done = f"{members} members done in {duration(seconds)}" if members else "nothing left to do"
    notes = []
    for name, counts in codes(found).items():
        about = found[name].attrs
        meanings = about["flag_meanings"].split()
        if name == "outcome" and list(counts) == meanings[:1]:
            continue
        whole = sum(counts.values())
        shares = [
            f"{count} {_WORDS.get(code, code.replace('_', ' '))} ({count / whole:.1%})"
            for code, count in counts.items()
        ]
        asked = f" ({about['long_name']})" if name == "end" else ""
        notes.append(f"{name}{asked}: {', '.join(shares)}")
        if name == "end":
            texts = dict(zip(meanings, about["flag_texts"], strict=True))
            notes += [f"  {code}: {texts[code]}" for code in _NOT_PLAIN if code in counts]
    errors = list(found.attrs["errors"].items())
    notes += [f"  {count} of them: {text}" for text, count in errors[:_SHOWN]]
    if len(errors) > _SHOWN:
        notes.append(f"  and {len(errors) - _SHOWN} other errors, in the attribute 'errors'")
    head = [f"{found['outcome'].size} members ({shape}); {done}"]
    steps = [NextStep("draw it:", f"jaxfric study --plot {store}")]
    return Report(head, notes=notes, next_steps=steps)


def codes(found: "Dataset") -> dict[str, dict[str, int]]:
    """Count members with each code, by variable; "without" counts members without a code."""
    every = {}
    for name in found.data_vars:
        about = found[name].attrs
        if "flag_meanings" not in about or found[name].ndim != found["outcome"].ndim:
            continue
        values, counts = np.unique(found[name].values, return_counts=True)
        names = about["flag_meanings"].split()
        every[str(name)] = {
            names[value] if value >= 0 else "without": int(count)
            for value, count in zip(values, counts, strict=True)
        }
    return every


def content(found: "Dataset", store: str, members: int) -> dict[str, object]:
    """Summarise a study as JSON; the computed numbers are only in the store."""
    return {
        "schema": STUDY_SUMMARY,
        "store": store,
        "members": int(found["outcome"].size),
        "shape": {str(d): found.sizes[d] for d in found["outcome"].dims},
        "computed_now": members,
        "codes": codes(found),
        "errors": dict(found.attrs["errors"]),
        "warnings": list(found.attrs.get("warnings", ())),
    }
