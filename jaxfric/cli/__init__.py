"""The command: thin verbs over the public functions, one file each.

Only what a verb needs is imported when it runs, so that `jaxfric --help` is quick. Bad input
ends in one line on stderr and exit code 2.
"""

from .app import main as main
