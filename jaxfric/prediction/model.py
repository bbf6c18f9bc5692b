"""A saved model, read from a fit.json or loop.json and checked."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import InputError
from ..findings import WarningCode, warned
from ..saved.files import (
    Saved,
    missing_key,
    own_warnings,
    read_saved,
    refuse_damage,
    table_damage,
    values_of,
)
from ..schemas import FIT, LOOP

Content = Mapping[str, Any]
"""The content of a JSON file, or a part of it."""


class SavedModel(NamedTuple):
    """A saved model, and the path or name of the result that the model is from."""

    path: Path
    content: Content

    @property
    def is_axis(self) -> bool:
        """Whether the model is that of a servo axis."""
        return self.content["law"] == "coulomb_viscous"

    @property
    def is_loop(self) -> bool:
        """Whether the model comes from a loop, which has a model before and after the search."""
        return self.content["schema"] == LOOP

    def tables(self) -> dict[str, Content]:
        """Return the models by name: "fit", or "before" and, if effects were added, "after"."""
        if not self.is_loop:
            return {"fit": self.content}
        names = ("before", "after") if self.content["effects"] else ("before",)
        return {name: self.content[name] for name in names}

    def values(self, name: str) -> dict[str, float]:
        """Return the parameters (SI) of the model that has a given name in `tables`."""
        return values_of(self.tables()[name])

    def effects(self) -> tuple[str, ...]:
        """Return the ids of all effects of the models: effects found, and effects of the base."""
        names = [name for table in self.tables().values() for name in table["parameters"]]
        return tuple(dict.fromkeys(name.split(".")[0] for name in names if "." in name))

    def warnings(self) -> tuple[str, ...]:
        """Return warnings of the fit or loop itself, and of undetermined parameters."""
        own, loose = own_warnings(self.content), self.undetermined()
        return (*own, warned(WarningCode.LOOSE_MODEL, parameters=loose)) if loose else own

    def undetermined(self) -> list[str]:
        """Return the parameters that the model's own record did not determine."""
        last = list(self.tables().values())[-1]["parameters"]
        return [name for name, item in last.items() if not item.get("determined", True)]

    def normal_stress(self) -> float | None:
        """Return the normal stress [Pa] at which K of the model holds: the mean of its record,
        that of the start if the loop followed its changes, or that of the first stretch of a run;
        None if it is not known."""
        first = self.content.get("stretches") or [self.content.get("record", {})]
        return first[0].get("normal_stress")

    def speeds(self) -> tuple[float, float]:
        """Return the slowest and fastest steady motion of the model's own record [m/s]."""
        steps = self.content["steps"]
        velocities = steps["velocities"] if isinstance(steps, dict) else [v for _, v in steps]
        moving = [abs(float(v)) for v in velocities if float(v) != 0]
        return (min(moving), max(moving)) if moving else (0.0, float("inf"))


def load_model(model: object) -> SavedModel:
    """Read a model from a file, or take a `Fit` or `Loop`.

    Raises
    ------
    InputError : a missing or damaged file, a file of another schema; a fit that did not converge.
    """
    if not isinstance(model, Saved):
        raise InputError(
            "the model to predict with is a fit.json or loop.json (its path), a Fit or a Loop;"
            f" not a {type(model).__name__}"
        )
    path, content = read_saved(model, FIT, LOOP)
    schema = content["schema"]
    keys = ("before", "after", "effects") if schema == LOOP else ("parameters",)
    refuse_damage(path, schema, missing_key(content, ("law", "friction_unit", "steps", *keys)))
    saved = SavedModel(path, content)
    needed = ("M", "F_v", "F_c", "F_0") if saved.is_axis else ("f0", "A", "B", "L", "K", "V0")
    for name, table in saved.tables().items():
        refuse_damage(path, schema, table_damage(table, needed, f"{name}."))
    return saved
