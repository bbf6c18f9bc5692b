"""The result of a feedforward: formula, C function, table, fade speed and limits."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..described import Described, Drawable, Tabular
from ..errors import option
from ..findings import listed
from ..fitting.uncertainty import QUANTILE
from ..plain import entries, plain
from ..schemas import FEEDFORWARD
from .code import c_code
from .curve import FrictionCurve, FrictionValues
from .fade import Fade
from .identified import Identified
from .pieces import INERTIA, SIGN, Piece, latex_formula, plain_formula
from .spot import FrictionAt, friction_at
from .units import positive


@dataclass(frozen=True, eq=False, repr=False)
class Feedforward(Described, Drawable, Tabular):
    """Friction compensation of an axis or joint. SI; forces in `about.force_unit`."""

    about: Identified
    """The identified axis."""
    pieces: tuple[Piece, ...]
    curve: FrictionCurve
    fade: Fade
    left_out: tuple[str, ...]
    """Effects that are not compensated, and why."""
    velocity: np.ndarray
    """Velocities of the table [m/s or rad/s], ascending (n)."""
    table: FrictionValues
    """Friction at the velocities of the table (n), without fade; errors are nan outside the
    supported speeds."""
    given: np.ndarray
    """Compensation at the velocities of the table: friction with fade (n) [F]."""
    level: float
    """Friction that changes sign, at the lowest supported speed [F]."""
    share: float
    """Largest safe share of the friction with a measured velocity: 1 minus twice the largest
    relative error over the supported speeds."""
    least_damping: float
    """k_v needed if the measured velocity replaces the reference [F s/m]."""
    warnings: tuple[str, ...]

    @property
    def findings(self) -> tuple[Mapping[str, Any], ...]:
        """The identified friction by direction, and its support, as in the file of the model."""
        return self.about.claims

    @property
    def formula(self) -> str:
        """The feedforward as a line of text, SI."""
        return plain_formula(self.pieces, self.fade.speed)

    @property
    def latex(self) -> str:
        """The feedforward as LaTeX, for an equation."""
        return latex_formula(self.pieces, self.fade.speed)

    def seen(self) -> np.ndarray:
        """Whether the record supports the friction at the velocities of the table (n)."""
        return self.about.supports(self.velocity)

    def c(self, name: str = "axis", *, made_by: Sequence[str] = ()) -> str:
        """The source of `NAME_compensation` and `NAME_feedforward` in C99, see `compensation.code`.

        `made_by` gives lines for the head comment of the source. Raises `InputError` if `name` is
        not a C identifier.
        """
        notes = [f"left out: {line}" for line in self.left_out]
        notes += [f"WARNING: {line}" for line in self.warnings]
        held = self.curve.held
        return c_code(self.about, self.pieces, self.fade, notes, held, name=name, made_by=made_by)

    def friction(self, velocity: np.ndarray | float) -> np.ndarray:
        """Friction of the model at velocities [m/s or rad/s], without fade [F]."""
        return self._force(velocity, None)

    def compensation(self, velocity: np.ndarray | float) -> np.ndarray:
        """Compensation at velocities [m/s or rad/s]: friction with fade, as in C [F]."""
        return self._force(velocity, self.fade.speed)

    def _force(self, velocity: np.ndarray | float, fade: float | None) -> np.ndarray:
        v = np.asarray(velocity, float)
        return self.curve.at(v.ravel(), fade).force.reshape(v.shape)

    def at(self, velocity: float | str) -> FrictionAt:
        """Friction and compensation at a speed [m/s or rad/s], or a text as "50 mm/s".

        `supported` of the result tells whether the record supports this speed; if not, errors are
        nan.

        Raises
        ------
        InputError : not a positive speed.
        """
        speed = positive(velocity, f"{self.about.length}/s", option("at"))
        return friction_at(self.curve, self.fade.speed, speed)

    def columns(self) -> dict[str, np.ndarray]:
        """The table by column: velocity, friction with its standard error and 95 % band, the
        compensation (friction with fade), and the basis of the friction. Errors are nan outside the
        supported speeds; the basis is "record" or "guess". Column names contain the units.
        """
        force, std = self.table.force, self.table.std
        unit, speed = self.about.force_unit, f"{self.about.length}/s"
        return {
            f"velocity [{speed}]": self.velocity,
            f"friction [{unit}]": force,
            f"std [{unit}]": std,
            f"lower [{unit}]": force - QUANTILE * std,
            f"upper [{unit}]": force + QUANTILE * std,
            f"compensation [{unit}]": self.given,
            "basis": np.where(self.seen(), "record", "guess"),
        }

    def csv(self) -> str:
        """The table as CSV. Commas only separate columns; fields of unknown errors are empty."""
        columns = self.columns()
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(_cell(x) for x in row) for row in rows]
        return "\n".join([",".join(columns), *lines]) + "\n"

    def to_json(self, asked: Sequence[FrictionAt] = ()) -> dict:
        """The content of `feedforward.json`, schema `schemas.FEEDFORWARD`; SI, null if unknown.
        `asked` is the friction at requested speeds; it becomes the entry "at" of the file."""
        about = self.about
        table = {
            "schema": FEEDFORWARD,
            "model": about.source,
            "sentence": self.sentence,
            **entries(about, "force_unit", "coordinate"),
            **entries(self, "formula", "latex"),
            "terms": [
                {
                    **entries(p, "name", "value", "std", "unit"),
                    "times": "s" if p.part == SIGN else "1",
                    "factor": p.text or "1",
                }
                for p in self.pieces
            ],
            "left_out": self.left_out,
            "undetermined": about.loose,
            "fade": entries(self.fade, "speed", "decided_by", "reasons"),
            "supported": {
                "slowest": about.slowest,
                "fastest": about.fastest,
                "rows_count_from": about.slowest_row,
                "below": about.below,
            },
            "findings": self.findings,
            "middle_of_travel": about.middle,
            "at": asked,
            "at_the_slowest": self.at(about.slowest),
            "level": self.level,
            "of_a_measured_velocity": {
                **entries(self, "share", "least_damping"),
                "own_damping": about.damping,
            },
            "table": {
                "velocity": self.velocity,
                "friction": self.table.force,
                "std": self.table.std,
                "compensation": self.given,
                "supported": self.seen(),
            },
            **listed(self.warnings),
        }
        return plain(table)

    @property
    def sentence(self) -> str:
        """One line: the friction, the fade speed, and the compensation if the fade reduces it."""
        about, speed = self.about, f"{self.about.length}/s"
        inertia = any(p.part == INERTIA for p in self.pieces)
        here, fades = self.at(about.slowest), f"{self.fade.speed:.3g} {speed}"
        if here.faded:
            fades += f": the compensation there is {here.given(about.force_unit)}"
        return (
            f"Feedforward of friction{' and inertia' if inertia else ''}: friction is"
            f" {here.forwards.text(about.force_unit)} forwards and"
            f" {here.backwards.text(about.force_unit)} backwards at {about.slowest:.3g} {speed}"
            f"{self.within(here)}. The sign of friction fades below {fades}."
            f" The record supports the map from {about.slowest:.3g} to {about.fastest:.3g} {speed}."
        )

    def within(self, here: FrictionAt) -> str:
        """A note in brackets if the misfit of the test block exceeds the errors of friction `here`.
        The errors of friction do not include the misfit."""
        if not self.missed > here.mean.std:
            return ""
        return (
            f" (errors of the model's terms alone: its misfit of the test block is"
            f" {self.missed:.2g} {self.about.force_unit} beyond noise)"
        )

    @property
    def missed(self) -> float:
        """Rms misfit of the test block beyond its noise [F]. The misfit is 0 if noise explains the
        residual, or if the file does not contain the residual."""
        if self.about.left is None:
            return 0.0
        rms, noise = self.about.left
        return math.sqrt(max(rms**2 - noise**2, 0.0))

    @property
    def cautions(self) -> tuple[str, ...]:
        """Sentences on correct and unsafe use."""
        about, unit = self.about, self.about.force_unit
        damping, own = f"{unit} s/{about.length}", about.damping
        lines = [
            "Drive it with the reference's velocity and acceleration. It is then pure feedforward"
            " and does not change stability: the gains must stabilise the axis as before"
            + (f" ({about.claim})" if about.claim else "")
        ]
        if own is None:
            told = "that of the drive in force, which the file does not contain"
        else:
            told = f"the drive's own, {own:.4g} {damping}, is"
            told += " above it" if own > self.least_damping else " not: raise it, or v_f"
        share = (
            f"at most {100 * self.share:.3g} % of the friction (two standard errors):"
            " over-compensation causes limit cycles"
            if self.share > 0
            else "nothing, as the error of friction exceeds half of it"
        )
        lines.append(
            "With the measured velocity instead it is a feedback, which reduces damping: below the"
            f" fade speed k_v must exceed {self.least_damping:.4g} {damping} ({told}). Then"
            f" compensate {share}"
        )
        if about.left is not None:
            rms, noise = about.left
            text = f"Rms residual of the test block: {rms:.2g} {unit}"
            text += (
                f", noise {noise:.2g} {unit}: the misfit of {self.missed:.2g} {unit} limits the"
                " compensation, however small the errors of its terms"
                if self.missed
                else ", consistent with noise"
            )
            lines.append(text)
        lines.append(about.below)
        if any(math.isnan(one.speed) for one in self.fade.reasons):
            lines.append(
                "The fade speed may be too low: the acceleration of the reference at reversals is"
                f" unknown ({option('acceleration')})"
            )
        return tuple(lines)


def _cell(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return "" if math.isnan(value) else f"{value:.9g}"
