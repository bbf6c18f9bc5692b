"""The command line of a plan that was changed."""

import re
import shlex
from typing import TYPE_CHECKING

from .call import Call

if TYPE_CHECKING:
    from ..protocol.design import Change

_LEFT_OUT = ("velocities", "out", "json", "quiet")


def changed_line(call: Call, change: "Change") -> str:
    """The call of `jaxfric protocol` with a change of its plan, to be pasted into a shell.

    Options are those of the call, but for the folder and for how it is told. Empty where no option
    plans the change (a load-point encoder), and for a call that gave no velocities.
    """
    given, noise = dict(call.given), change.slip_noise
    velocities, slip = given.get("velocities"), given.get("slip_per_step")
    known = isinstance(velocities, str) and isinstance(slip, str) and change.velocities
    if not known or change.encoder_noise is not None:
        return ""
    given["slip_per_step"] = _in_unit_of(str(slip), "m", change.slip_per_step)
    if noise is not None and "slip_channel" not in given:
        given["slip_channel"] = _in_unit_of("1 um", "m", noise)
    words = ["jaxfric protocol", _quoted(_in_unit_of(str(velocities), "m/s", *change.velocities))]
    for name, value in given.items():
        if name not in _LEFT_OUT:
            text = ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
            words += [f"--{name.strip('_').replace('_', '-')}", _quoted(text)]
    return " ".join(words)


def _in_unit_of(text: str, si_unit: str, *values: float) -> str:
    """Values in SI as a text in the last unit of another text."""
    from ..units import factor

    unit = text.split(",")[-1].strip().lstrip("+-0123456789.eE").strip()
    size = factor(unit, si_unit, "unit")
    return f"{', '.join(f'{value / size:.6g}' for value in values)} {unit}"


def _quoted(text: str) -> str:
    """A text for a shell: in double quotes, which every shell takes, where that is enough."""
    if " " in text and re.search(r"[\\\"$`!]", text) is None:
        return f'"{text}"'
    return shlex.quote(text)
