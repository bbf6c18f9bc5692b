"""Fill the templates of words.toml: sentences on results, one template for each code.

Results hold codes and values. `say` makes sentences from them; no code parses a sentence.
"""

import string
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Protocol

from ..effects import RunChange
from ..errors import option
from ..findings import Clause
from ..units import prefixed

_FILE = Path(__file__).with_name("words.toml")
_WORDS: dict[str, dict[str, str]] = tomllib.loads(_FILE.read_text(encoding="utf-8"))
WARNINGS, REASONS = _WORDS.pop("warning"), _WORDS.pop("reason")
"""Templates of warnings by `findings.WarningCode`, and of reasons (`runs.reasons`) and notes
(`prediction.NoteCode`) by their codes."""
CLAUSES = _WORDS.pop("clause")
"""Clauses of a sentence, by `findings.Clause`."""
VARIABLE, CHANGES = _WORDS.pop("variable"), _WORDS.pop("change")
"""Names of variables of a profile or structures of a test, and of changes of a run."""
TEMPLATES = {f"{table}.{code}": text for table, own in _WORDS.items() for code, text in own.items()}
"""Every other template by its code, "TABLE.CODE"."""
_SIZES = {"u": 1e6, "m": 1e3, "k": 1e-3, "M": 1e-6, "T": 1e-12, "%": 100.0}


class _Filler(string.Formatter):
    """Fills a template: "{option[draws]}" is an option of the command, or an argument of Python.
    Each value of a list is written in turn. "{:u.3g}" writes a value in micro-units (`_SIZES`). A
    `Clause` is written in its words."""

    def get_field(self, field_name, args, kwargs):
        if field_name.startswith("option["):
            return option(*field_name[len("option[") : -1].split("=", 1)), field_name
        return super().get_field(field_name, args, kwargs)

    def format_field(self, value, format_spec):
        if isinstance(value, Clause):
            return self.vformat(CLAUSES[value], (), {})
        if isinstance(value, list | tuple):
            return ", ".join(self.format_field(one, format_spec) for one in value)
        if format_spec[:1] in _SIZES:
            value, format_spec = _SIZES[format_spec[0]] * value, format_spec[1:]
        return super().format_field(value, format_spec)


def say(code: str, **values: object) -> str:
    """Fill the template of a code with values."""
    return _Filler().vformat(TEMPLATES[code], (), values)


def coded(code: str, values: Mapping[str, object]) -> str:
    """A warning or a reason in words."""
    return _Filler().vformat(WARNINGS.get(code) or REASONS[code], (), values)


class HasUnits(Protocol):
    """A result whose quantities have the units of a line or of a rotation."""

    def unit(self, si_unit: str) -> str:
        """The unit of a quantity whose linear unit is `si_unit`."""
        ...


def amount(of: HasUnits, value: float, si_unit: str, digits: int = 4) -> str:
    """A quantity of a result with the prefix of its unit."""
    return prefixed(value, of.unit(si_unit), digits)


def machine(of: HasUnits, k_p: float | None, k_v: float, mass: float | None) -> str:
    """The gains and the mass of a machine; k_p may be open."""
    stiffness = "" if k_p is None else f"k_p = {amount(of, k_p, 'N/m')}, "
    inertia = "no mass (quasi-static)" if mass is None else f"mass {amount(of, mass, 'kg')}"
    return f"{stiffness}k_v = {amount(of, k_v, 'N s/m')}, {inertia}"


def lower(text: str) -> str:
    """The text within a sentence."""
    return text[:1].lower() + text[1:]


def capital(text: str) -> str:
    """The text as the beginning of a sentence."""
    return text[:1].upper() + text[1:]


def change_words(wanted: Iterable[str]) -> str:
    """Put into words the changes of a run that would separate effects; a text stays unchanged."""
    return ", ".join(CHANGES[one] if isinstance(one, RunChange) else one for one in wanted)
