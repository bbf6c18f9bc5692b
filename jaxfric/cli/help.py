"""`--help` of a verb prints the most important options; `--help-all` prints all options.

The text of `--help` fits on one screen. The text leaves out options of the group `options.MORE`,
and shows only the first sentence of an option's help. The library cyclopts prints `--help-all`.
"""

import inspect
from typing import TYPE_CHECKING, Literal, get_args, get_origin

import cyclopts

from .options import MORE

if TYPE_CHECKING:
    from cyclopts.argument import Argument

ALL = "--help-all"
FLAGS = ("--help", "-h", ALL)


def print_first(name: str, verb: cyclopts.App) -> None:
    """Print usage, purpose and the most important options of a verb."""
    from rich.table import Table
    from rich.text import Text

    from .common import stdout_console

    called = [
        argument
        for argument in verb.assemble_argument_collection(parse_docstring=True)
        if argument.parameter.help and argument.parameter.group != MORE.group
    ]
    places = [
        one.name if one.required else f"[{one.name}]"
        for one in called
        if not one.name.startswith("-")
    ]
    table = Table.grid(padding=(0, 2))
    for argument in called:
        text = first_sentence(argument)
        if argument.required and argument.name.startswith("-"):
            text = f"Required: {text[0].lower()}{text[1:]}"
        table.add_row(Text(_label(argument), no_wrap=True), Text(text))
    console = stdout_console(80)
    console.print(Text(" ".join(["Usage: jaxfric", name, *places, "[OPTIONS]"])))
    console.print(Text(f"{inspect.cleandoc(verb.help).splitlines()[0]}\n"))
    console.print(table)
    console.print(Text(f"\nAll options, with their defaults: jaxfric {name} {ALL}"))


def _label(argument: "Argument") -> str:
    """Return the names of an option with its choices, or with a word for its value."""
    names = " ".join(name for name in argument.names if not name.startswith(("--no-", "--empty-")))
    if argument.hint is bool or not names.startswith("-"):
        return names
    choices = get_args(argument.hint) if get_origin(argument.hint) is Literal else ()
    return f"{names} {'|'.join(map(str, choices)) or 'STR'}"


def first_sentence(argument: "Argument") -> str:
    """Return the first sentence of an option's help, without Markdown marks."""
    text = " ".join((argument.parameter.help or "").split()).replace("\\[", "[")
    return text.partition(". ")[0].removesuffix(".")
