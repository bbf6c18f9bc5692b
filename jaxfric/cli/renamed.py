"""Old names of verbs and options, which still work in this version and print a note.

Old names occur only in this module: it rewrites the command line before parsing.
"""

from collections.abc import Sequence

from ..errors import InputError

VERBS = {
    "compare": ("fit", "--compare"),
    "record": ("inspect",),
    "steady": ("axis",),
}
"""Verbs of earlier versions, and the words that replace them."""
OPTIONS = {
    "--fade": "--fade-speed",
    "--flip": "--flip-sign",
    "--free": "--refit",
    "--held": "--zero-order-hold",
    "--most": "--max-effects",
    "--rows": "--downsample-to",
    "--tell": "--distinguish",
    "--with": "--include",
    "--without": "--exclude",
}
"""Options of earlier versions, and their names now."""
VALUES = {"--weighting": {"ordinary": "ols", "whitened": "gls"}}
"""Option values of earlier versions, and their names now."""
GONE = {
    "report": "every verb writes its own page or figures; open loop.html or run.html of a result"
}
"""Removed verbs, and what to do instead."""


def in_new_words(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return a command line with the current names, and notes on the names that were replaced.

    The option `--rows` of `jaxfric protocol`, the number of samples at each velocity, keeps its
    name.
    """
    verb, *rest = words or [""]
    if verb in GONE:
        raise InputError(f"'jaxfric {verb}' is no verb any more; {GONE[verb]}")
    first, *options = VERBS.get(verb, (verb,))
    changed = {f"jaxfric {verb}": " ".join(("jaxfric", *VERBS[verb]))} if verb in VERBS else {}
    new: list[str] = []
    for word in rest:
        name, equals, value = word.partition("=")
        before = new[-1] if new and not equals else name
        if name in OPTIONS and (verb, name) != ("protocol", "--rows"):
            changed[name] = OPTIONS[name]
            word = f"{OPTIONS[name]}{equals}{value}"
        elif (value or word) in VALUES.get(before, {}):
            old = value or word
            changed[f"{before} {old}"] = f"{before} {VALUES[before][old]}"
            word = f"{name}={VALUES[before][old]}" if equals else VALUES[before][old]
        new.append(word)
    notes = [f"'{old}' is now '{now}'" for old, now in changed.items()]
    return [first, *new, *options] if words else [], ["; ".join(notes)] if notes else []
