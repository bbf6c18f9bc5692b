"""The words of results: one template a code, so that a sentence is changed in one place.

Results hold codes and values; `say` makes sentences of them, and no code reads a sentence back.
"""

from collections.abc import Iterable

from ...effects import RunChange
from .changes import CHANGES
from .following import NEXT, PLAN
from .location import LOCATION
from .loop import CURVE, FINDING, REFUSAL, VERDICT
from .steady import STEADY
from .tables import ANSWER, APART, HEADLINE, TABLE

_TABLES = {
    "verdict": VERDICT,
    "curve": CURVE,
    "finding": FINDING,
    "refusal": REFUSAL,
    "location": LOCATION,
    "next": NEXT,
    "plan": PLAN,
    "steady": STEADY,
    "headline": HEADLINE,
    "answer": ANSWER,
    "table": TABLE,
    "apart": APART,
}
TEMPLATES: dict[str, str] = {
    f"{table}.{code}": text for table, texts in _TABLES.items() for code, text in texts.items()
}
"""Every template by its code, "TABLE.CODE"; values are fields of `str.format`."""


def say(code: str, **values: object) -> str:
    """The template of a code, with its values."""
    return TEMPLATES[code].format(**values)


def change_words(wanted: Iterable[str]) -> str:
    """What would tell effects apart, in words: a `RunChange` each, or text that is its own."""
    return ", ".join(CHANGES[one] if isinstance(one, RunChange) else one for one in wanted)
