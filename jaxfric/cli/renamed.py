"""Old names of verbs, which work for one version, with a note: this is the only place of them."""

from collections.abc import Sequence

from ..errors import InputError

VERBS = {"compare": ("fit", "--compare"), "steady": ("axis",)}
"""The words that stand for a verb of earlier versions."""
GONE = {
    "report": "every verb writes its own page or figures; open loop.html or run.html of a result"
}
"""Verbs that are no more, and what to do instead."""


def in_new_words(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """A command line with the names of today, and a note on every one that was another."""
    verb, rest = words[0] if words else "", list(words[1:])
    if verb in GONE:
        raise InputError(f"'jaxfric {verb}' is no verb any more; {GONE[verb]}")
    if verb not in VERBS:
        return list(words), []
    first, *options = VERBS[verb]
    now = " ".join(VERBS[verb])
    return [first, *rest, *options], [f"'jaxfric {verb}' is now 'jaxfric {now}'"]
