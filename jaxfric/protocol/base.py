"""The base model of a plan, with typical parameters, the user's parameters, or those of a file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ..effects import CATALOGUE
from ..errors import InputError, did_you_mean, option
from ..findings import WarningCode, warned
from ..fitting.typed import typed_parameters
from ..laws.registry import takes
from ..saved.entry import law_in
from ..saved.files import own_warnings, read_saved
from ..schemas import FIT, LOOP
from .design import BASE

TYPICAL = "f0=0.6, A=0.010, B=0.014, L=20 um"
"""Default parameters, of a friction coefficient."""


class Base(NamedTuple):
    """Parameters of a law (SI), and further known properties of a similar record."""

    parameters: Mapping[str, float]
    law: str = "slip"
    friction_unit: str = "1"
    effects: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    stiffness: float | None = None
    noise: float | None = None

    def without(self, asked: Sequence[str], typed: Sequence[str]) -> "Base":
        """Return the base without the `asked` effects of its file, so that the plan tells whether
        the experiment can detect these effects. Effects that the user has `typed` stay."""
        gone = {id for id in asked if id in self.effects and id not in typed}
        kept = {name: x for name, x in self.parameters.items() if name.split(".")[0] not in gone}
        effects = tuple(id for id in self.effects if id not in gone)
        return self._replace(parameters=kept, effects=effects)


def base_of_text(text: str = TYPICAL, friction_unit: str = "1", law: str = "slip") -> Base:
    """Return the base with the parameters of a text, "f0=0.6, A=0.010, B=0.014, L=20 um".

    Raises `InputError` for an unknown name or a wrong unit.
    """
    names = ("f0", "A", "B", "L", "V0")
    of = {"what": option("parameters"), "example": TYPICAL}
    return Base(typed_parameters(text, friction_unit, names=names, **of), law, friction_unit)


def base_of_file(path: Path) -> Base:
    """Read the base from a fit.json, or from the supported model of a loop.json (`Loop.supported`).

    Raises `InputError` for a file of another kind, and for the file of an axis.
    """
    _, content = read_saved(path, FIT, LOOP)
    fitted = law_in(path, content)
    if fitted.is_axis:
        raise InputError(
            f"{path}: it is of an axis, and a protocol is of a slider; give a fit.json, or the"
            " loop.json of 'jaxfric loop'"
        )
    effects = tuple(effect.id for effect in fitted.effects)
    values = {name: value for name, value in fitted.parameters.items() if name not in ("K", "m")}
    stiffness = fitted.parameters.get("K", _number(content, "stiffness"))
    noise = _number(content.get("noise"), "sigma")
    unit, told = fitted.friction_unit, own_warnings(content)
    if (mass := fitted.parameters.get("m")) is not None:
        kilograms = "kg" if unit == "N" else "s^2/m"
        told = (*told, warned(WarningCode.NO_MASS, mass=mass, unit=kilograms))
    return Base(values, fitted.name, unit, effects, told, stiffness, noise)


def named_pair(
    ids: tuple[str, str], law: str, with_: Sequence[str], without: Sequence[str]
) -> tuple[str, str]:
    """Return the pair of effects with the ids of a plan; the name of the base law means the base.

    Raises `InputError` for an effect of the base, and for an effect that the plan does not know.
    """
    known = [
        id
        for id, effect in CATALOGUE.items()
        if effect.channel is None and id not in (*with_, *without) and takes(law, effect)
    ]
    a, b = (BASE if id == law and id not in known else id for id in ids)
    for id in (a, b):
        if id not in (BASE, *known):
            has = f"; the base model has it ({option('include')})" if id in with_ else ""
            raise InputError(
                f"{option('distinguish')}: no effect '{id}' to distinguish in this plan"
                f"{has or did_you_mean(id, (BASE, *known))}"
            )
    if a == b:
        raise InputError(
            f"{option('distinguish')}: both are the base model, the {law} law; name an effect"
        )
    return a, b


def _number(table: object, key: str) -> float | None:
    """Return a number from a table of a file, or None."""
    value = table.get(key) if isinstance(table, dict) else None
    return float(value) if isinstance(value, int | float) else None
