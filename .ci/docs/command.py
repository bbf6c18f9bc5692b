"""The reference of the command, from its own help."""

import sys

from jaxfric.cli.app import app


def pages() -> dict[str, str]:
    """One page with all verbs and their options."""
    sys.argv = ["jaxfric"]  # the lines of usage name the program that runs
    text = app.generate_docs(output_format="markdown", heading_level=1)
    _, _, rest = text.partition("\n")
    return {"reference/command.md": "# The command\n" + escaped(rest)}


def escaped(text: str) -> str:
    """Names in brackets, [UNIT], are no links; the list of contents is beside the page."""
    kept, skipping = [], False
    for line in text.splitlines():
        contents = line.startswith("## Table of Contents")
        skipping = contents or (skipping and not line.startswith("**"))
        if not skipping:
            kept.append(line)
    return "\n".join(kept)
