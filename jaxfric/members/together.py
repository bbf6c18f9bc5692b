"""The computations of a study as one function, which carries the registered entries that it uses.

A user may register a law, a margin or a computation in a running process. The store of a study
belongs to these entries, too, and other processes receive them with the function.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any

from jaxtyping import ArrayLike

from ..laws import REGISTRY, name_of
from ..stability.margin_table import MARGINS, Margin
from ..study import Output
from ..study.function import Function
from ..study.source import belongs_to_package, fingerprint
from .spec import Spec


@dataclass(frozen=True, eq=False)
class Together:
    """A function that runs computations on the same members, with the laws and margins in use.

    A process that unpickles the function registers these laws and margins.
    """

    parts: Mapping[str, tuple[Callable, Function]]
    """Each computation of the study: what made its function, and the function."""
    laws: Mapping[str, Any]
    margins: Mapping[str, tuple[Margin, Callable]]
    """Entries with their functions."""

    @classmethod
    def of(
        cls,
        parts: Mapping[str, tuple[Callable, Function]],
        spec: Spec,
        outputs: tuple[Output, ...],
    ) -> "Together":
        """Return the function of a study that stores `outputs`."""
        law = spec.law if spec.law is None or isinstance(spec.law, str) else name_of(spec.law)
        required = spec.options.get("gains", {}).get("margin")
        margins = {output.name for output in outputs}
        margins |= set(required if isinstance(required, dict) else ())
        return cls(
            parts,
            {n: x for n, x in REGISTRY.items() if n == law},
            {n: (x, resolve_name(x.function)) for n, x in MARGINS.items() if n in margins},
        )

    def __call__(self, varied: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
        """Return the outputs of all computations."""
        return {n: x for _, part in self.parts.values() for n, x in part(dict(varied)).items()}

    def __reduce__(self):
        return _registered, (self.parts, self.laws, self.margins)

    def own(self) -> dict[str, str]:
        """Return checksums of the user's entries, by table and name."""
        found = {f"law {n}": x for n, x in self.laws.items() if not belongs_to_package(x)}
        for table, entries, code in (("margin", self.margins, 1), ("compute", self.parts, 0)):
            found |= {
                f"{table} {n}": x for n, x in entries.items() if not belongs_to_package(x[code])
            }
        return {name: fingerprint(x) for name, x in found.items()}


def _registered(parts: Mapping, laws: Mapping, margins: Mapping) -> Together:
    """Return an unpickled function after the registration of its laws and margins."""
    for _, function in margins.values():
        if function.__module__ == "__main__":  # a script's, which another process does not run
            setattr(sys.modules["__main__"], function.__name__, function)
    entries = {name: entry for name, (entry, _) in margins.items()}
    for table, here in ((REGISTRY, laws), (MARGINS, entries)):
        for name, entry in here.items():
            if fingerprint(table.get(name)) != fingerprint(entry):
                table[name] = entry
    return Together(parts, laws, margins)
