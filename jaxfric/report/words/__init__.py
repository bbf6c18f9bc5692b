"""Templates of all sentences on results, one template for each code.

Results hold codes and values. `say` makes sentences from them; no code parses a sentence.
"""

from collections.abc import Iterable

from ...effects import RunChange
from .following import CHANGES, NEXT
from .location import LOCATION
from .loop import APART, CURVE, FINDING, HEADLINE, REFUSAL, VERDICT
from .steady import STEADY

_TABLES = {
    "verdict": VERDICT,
    "curve": CURVE,
    "finding": FINDING,
    "refusal": REFUSAL,
    "location": LOCATION,
    "next": NEXT,
    "steady": STEADY,
    "headline": HEADLINE,
    "apart": APART,
}
TEMPLATES: dict[str, str] = {
    f"{table}.{code}": text for table, texts in _TABLES.items() for code, text in texts.items()
}
"""Every template by its code, "TABLE.CODE"; values are fields of `str.format`."""


def say(code: str, **values: object) -> str:
    """Fill the template of a code with values."""
    return TEMPLATES[code].format(**values)


def lower(text: str) -> str:
    """The text within a sentence."""
    return text[:1].lower() + text[1:]


def capital(text: str) -> str:
    """The text as the beginning of a sentence."""
    return text[:1].upper() + text[1:]


def change_words(wanted: Iterable[str]) -> str:
    """Put into words the changes of a run that would separate effects; a text stays unchanged."""
    return ", ".join(CHANGES[one] if isinstance(one, RunChange) else one for one in wanted)
