"""The application, which turns every failure into one line on stderr and an exit code."""

import contextlib
import gc
import importlib
import io
import logging
import os
import sys
import warnings
from collections.abc import Generator

import cyclopts

from ..errors import InputError, words_of_the_command
from ..report.version import installed_version
from .call import calling
from .common import warn
from .help import ALL, FLAGS, first_sentence, print_first
from .renamed import in_new_words
from .told import telling

CODES = {
    0: "a result, printed and written",
    1: "no reliable result: a fit did not converge, one of several files or a member of a study"
    " failed, a posterior cannot be trusted, or a figure could not be drawn; stderr says which",
    2: "bad input: one line on stderr says what, where and what to do; no result was written",
    130: "interrupted (Ctrl-C); 143: another process ended the study",
    141: "the program that read the output has ended",
}
"""Exit codes of all verbs with their meaning."""
_EPILOGUE = "\n".join(
    [
        "Every verb has --json (one JSON document on stdout, nothing else there), --quiet (no"
        " progress on stderr) and --out (where to write).\n",
        "| exit code | meaning |\n|---|---|",
        *(f"| {code} | {meaning} |" for code, meaning in CODES.items()),
    ]
)
app = cyclopts.App(
    name="jaxfric",
    help="Fit friction to records, find missing effects, and compute gains against stick-slip.",
    help_epilogue=_EPILOGUE,
    version=installed_version,
    default_parameter=cyclopts.Parameter(negative=()),
    help_flags=FLAGS,
    suppress_keyboard_interrupt=False,
)
_NAMES = (
    *("inspect", "fit", "run", "loop", "axis", "predict"),
    *("feedforward", "protocol", "gains", "stability", "simulate", "study"),
)
_VERBS = [getattr(importlib.import_module(f".{name}", __package__), name) for name in _NAMES]
"""The function of each verb, from the file of its name, in the order of the help."""
for verb in _VERBS:
    app.command(verb, help_epilogue="")
app.register_install_completion_command(
    help="Install completion of verbs and options in the shell (bash, zsh, fish, PowerShell). Then"
    " open a new shell.",
    help_epilogue="",
)


def exit_code() -> int | str | None:
    """Run the command, and return what `sys.exit` takes; a failure becomes one line and a code."""
    gc.disable()  # garbage collection while JAX traces costs a tenth of this short process's time
    sys.setswitchinterval(5e-4)  # default 5 ms: other threads would wait while one thread traces
    # matrices are small and `threads` uses the cores: threads of OpenBLAS would wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read by NumPy and SciPy when they load
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the caller
            setattr(sys, name, io.StringIO())
        else:
            stream.reconfigure(errors="backslashreplace")
    code: int | str | None
    try:
        code = _run(sys.argv[1:])
    except BrokenPipeError:
        code = 141
    except SystemExit as end:  # rich exits on a broken pipe
        code = 141 if isinstance(end.__context__, BrokenPipeError) else end.code
    if code == 141:
        sys.stdout = None
    return code


def _run(arguments: list[str]) -> int:
    """Run the verb of a command line and return the exit code; a verb's None means 0."""
    try:
        with _quiet(), words_of_the_command():
            arguments, remarks = in_new_words(arguments)
            warn(remarks, "note")
            verb, bound, _ = app.parse_args(arguments, exit_on_error=False, print_error=False)
            name = next(iter(arguments), "")
            if name in _NAMES and ALL not in arguments and verb == app.help_print:
                print_first(name, app[name])
                return 0
            quiet = getattr(bound.arguments.get("output"), "quiet", False)
            with calling(verb, bound, arguments), telling(silent=quiet or verb not in _VERBS):
                code = verb(*bound.args, **bound.kwargs)
        sys.stdout.flush()
    except cyclopts.CycloptsError as error:
        verb = " ".join(("jaxfric", *(error.command_chain or ())))
        text = str(error.__cause__ if isinstance(error.__cause__, InputError) else error)
        missing = error.argument if isinstance(error, cyclopts.MissingArgumentError) else None
        if missing is not None and missing.required:
            text = f"{missing.name} is missing: {first_sentence(missing)}"
        return _complain(f"{text} ({verb} {ALL} lists what there is)", 2)
    except InputError as error:
        return _complain(str(error), 2)
    except (KeyboardInterrupt, BrokenPipeError):
        raise
    except MemoryError:
        return _complain("out of memory; use a shorter record", 1)
    except Exception as error:
        if _debugging():
            raise
        if isinstance(error, OSError) and error.strerror:
            return _complain(f"{error.filename or 'standard output'}: {error.strerror}", 1)
        kind = type(error).__name__
        return _complain(
            f"internal error ({kind}: {error}); please report it. JAXFRIC_DEBUG=1 shows where", 1
        )
    return code if isinstance(code, int) else 0


@contextlib.contextmanager
def _quiet() -> Generator[None]:
    """Silence the libraries' warnings on fonts, caches and rounding, unless debugging."""
    if _debugging():
        yield
        return
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(logging.NOTSET)


def _debugging() -> bool:
    return bool(os.environ.get("JAXFRIC_DEBUG"))


def _complain(message: str, code: int) -> int:
    print("jaxfric: error: " + " ".join(message.split()), file=sys.stderr)
    return code
