"""The command `jaxfric`: each verb has one file and calls the public functions.

Every verb has `--json` (stdout is exactly one JSON document), `--quiet` (no progress on stderr) and
`--out FOLDER`. Exit codes:

| code | meaning |
|------|---------|
| 0 | a result |
| 1 | no reliable result: a fit did not converge, one of several files or a member of a study
      failed, a posterior cannot be trusted, or a figure could not be drawn |
| 2 | bad input: one line on stderr, and no result was written |
| 130, 143 | interrupted, ended by another process |
| 141 | the program that read the output has ended |

A verb imports modules only when the verb runs, so that `jaxfric --help` is quick.
"""

import gc
import sys


def main() -> None:
    """Run the command. Ctrl-C ends it with one line and code 130, also while its modules load."""
    try:
        from .app import exit_code

        code = exit_code()
    except KeyboardInterrupt:
        print("jaxfric: interrupted; nothing was written", file=sys.stderr)
        code = 130
    gc.freeze()  # skips the search for reference cycles at exit, which takes half a second
    sys.exit(code)
