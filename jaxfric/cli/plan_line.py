"""Command lines to try next: the current call with changed options."""

import re
import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING

from .call import Call, option_of

_OF_STEPS = ("states", "fit_stiffness", "slip_trend", "downsample_to")
"""Options of `jaxfric run` that `jaxfric loop` lacks or uses in another sense."""

if TYPE_CHECKING:
    from ..protocol.design import Change

_LEFT_OUT = ("file", "velocities", "out", "details", "json", "quiet")
"""The argument of the verb, and the options of output."""


def command_line(verb: str, argument: str, given: Mapping[str, object]) -> str:
    """Return the shell command of a verb; `given` holds its options by their Python names.

    The returned command has no options of output. Several values of an option are joined by commas,
    except for --column, whose values may hold commas.
    """
    words = [f"jaxfric {verb}", _quoted(argument)]
    for name, value in given.items():
        if name in _LEFT_OUT or value is None or value is False:
            continue
        option = option_of(name)
        if value is True:
            words.append(option)
        else:
            texts = list(map(str, value)) if isinstance(value, list | tuple) else [str(value)]
            for each in texts if name == "column" else [",".join(texts)]:
                words += [option, _quoted(each)]
    return " ".join(words)


def run_line(call: Call) -> str:
    """Return the next command after a `jaxfric run` whose fits do not describe the steps.

    The next command is the same call with --slip-trend. If --slip-trend was already given, the next
    command is `jaxfric loop` over the run. The text is empty if `jaxfric loop` would have no
    stiffness, or if no command is running.
    """
    from ..runs.ramps import RAMPS

    given, file = dict(call.given), call.given.get("file")
    if file is None:
        return ""
    if not given.get("slip_trend"):
        return command_line("run", str(file), given | {"slip_trend": True})
    if given.get("stiffness") in (None, RAMPS):
        return ""
    kept = {name: value for name, value in given.items() if name not in _OF_STEPS}
    return command_line("loop", str(file), {"run": "events" not in kept} | kept)


def loop_line(call: Call, law: str) -> str:
    """Return the `jaxfric loop` command for the record of a `jaxfric fit --compare`, with `law`.

    The text is empty if `jaxfric loop` would have no stiffness, or if no command is running.
    """
    given, file = dict(call.given), call.given.get("file")
    if file is None or "stiffness" not in given:
        return ""
    given |= {"law": None if law == "slip" else law}
    given |= {"slip_trend": None, "include": "slip_trend" if given.get("slip_trend") else None}
    return command_line("loop", str(file), given)


def changed_line(call: Call, change: "Change") -> str:
    """Return the shell command of a `jaxfric protocol` call with a change of its plan.

    The returned command has no options of output. The text is empty if the call gave no velocities.
    """
    if "velocities" not in call.given:
        return ""
    given = call.given | {"slip_per_step": f"{1e6 * change.slip_per_step:.6g} um"}
    if change.slip_noise is not None and "slip_channel" not in given:
        given["slip_channel"] = f"{1e6 * change.slip_noise:.6g} um"
    speeds = ", ".join(f"{1e6 * V:.6g}" for V in change.velocities)
    return command_line("protocol", f"{speeds} um/s", given)


def _quoted(text: str) -> str:
    """Quote a text for a shell, in double quotes if they suffice: every shell accepts them."""
    if " " in text and re.search(r"[\\\"$`!]", text) is None:
        return f'"{text}"'
    return shlex.quote(text)
