"""The page of all effects: equation, what each is confused with, what separates it, a picture."""

from collections.abc import Mapping
from pathlib import Path

from jaxfric.effects import AXIS_CATALOGUE, CATALOGUE, AbstractEffect, parameters, separators
from jaxfric.report.words import change_words

_HEAD = """# Which effect looks like which

What a model lacks shows in what its fit leaves. Each picture is that residual for a small amount
of one effect: how the record changes, less what the other parameters of the fit take up of it.
Only the shape means something, so its largest value is 1. The slider is driven at 1, 10, 1, 3, 10
and 1 µm/s over 150 µm each; the axis goes to and fro at four speeds. `python -m fits.effects`
makes the pictures.

Two effects whose pictures look alike cannot be told apart by that experiment: then the line
*separated by* says which measurement does, and [`jaxfric protocol`](protocol.md) says it for your
own plan.
"""
_ROOMS = {
    "friction": "In the friction",
    "machine": "In the machine",
    "drive": "In the drive",
    "sensor": "In the sensor",
}


def pages(root: Path) -> dict[str, str]:
    """The page, made from the catalogue."""
    parts = [_HEAD]
    for title, folder, effects in (
        ("Effects of a slider", "slider", CATALOGUE),
        ("Effects of an axis", "axis", AXIS_CATALOGUE),
    ):
        parts.append(f"## {title}\n\n{overview(effects, folder)}")
        for room, words in _ROOMS.items():
            here = {i: e for i, e in effects.items() if e.room == room}
            if here:
                parts.append(f"### {words}{'' if folder == 'slider' else ' of an axis'}")
            parts += [entry(i, e, folder, effects) for i, e in here.items()]
    return {"effects.md": "\n\n".join(parts)}


def anchor(id: str, folder: str) -> str:
    """The place of an effect in the page."""
    return f"{folder}-{id}"


def overview(effects: Mapping[str, type[AbstractEffect]], folder: str) -> str:
    """A table of all effects in a line each."""
    rows = [
        f"| [{id}](#{anchor(id, folder)}) | `{effect.equation}` |"
        f" {confused(effect, effects, folder)} |"
        for id, effect in effects.items()
    ]
    return "\n".join(["| effect | equation | confused with |", "|---|---|---|", *rows])


def confused(
    effect: type[AbstractEffect], effects: Mapping[str, type[AbstractEffect]], folder: str
) -> str:
    """The effects that one is taken for, with links."""
    links = [f"[{o}](#{anchor(o, folder)})" if o in effects else o for o in effect.confused_with]
    return ", ".join(links) or "none"


def entry(
    id: str, effect: type[AbstractEffect], folder: str, effects: Mapping[str, type[AbstractEffect]]
) -> str:
    """One effect."""
    text = " ".join((effect.__doc__ or "").split("\n\n")[0].split())
    symbols = "\n".join(
        f"    - `{about.symbol}` [{about.unit}]: {about.text}"
        for about in parameters(effect).values()
    )
    needs = f"\n- **Needs** the column `{effect.channel}`" if effect.channel else ""
    return (
        f"#### `{id}` {{#{anchor(id, folder)}}}\n\n{text}\n\n"
        f"![what a fit without {id} leaves](fits/effects/{folder}/{id}.png)\n\n"
        f"- **Equation**: `{effect.equation}`\n- **Parameters**\n{symbols}\n"
        f"- **Confused with**: {confused(effect, effects, folder)}\n"
        f"- **Separated by**: {change_words(separators(effect))}{needs}"
    )
