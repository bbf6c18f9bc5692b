"""What a loop asked of its engine, kept while the same record's loop is closed again.

A gate changes what is done with candidates, not the candidates: a loop without a gate asks for the
same fits until its way parts from that of the whole loop. What is kept is known by everything that
it depends on: the rows that count, the record, the noise that was learnt, and the arguments.
"""

import contextlib
import hashlib
import importlib
from collections.abc import Iterator
from typing import Any
from unittest.mock import patch

import numpy as np

from jaxfric.loop import close, search
from jaxfric.loop.engine import Engine
from jaxfric.loop.evaluate import Evaluator
from jaxfric.loop.refit import Candidate

_loop = importlib.import_module("jaxfric.loop.loop")  # the package has functions of that name
_learn = importlib.import_module("jaxfric.loop.learn")


def _of(value: Any) -> bytes:
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, Candidate):
        return b"|".join([repr(value.effects).encode(), value.z.tobytes(), _of(value.bic)])
    return repr(value).encode()


def state(engine: Engine) -> bytes:
    """What candidates of an engine depend on beside their arguments."""
    noise = engine.noise
    arrays = (engine.weight, noise.clock, noise.friction, noise.scale, noise.longest)
    found = hashlib.sha256(repr((engine.always, noise.family, len(engine.names))).encode())
    for array in (*arrays, *noise.noises):
        found.update(np.asarray(array).tobytes())
    return found.digest()


class Memory:
    """Fits, screenings and aliases of one record's engine."""

    def __init__(self):
        self.known: dict[Any, Any] = {}
        self.fits = 0
        """Fits that had to be made."""

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Within it nothing is computed twice."""
        first = {"locate": 1, "curve_family": 1}  # other arguments follow from the first
        with contextlib.ExitStack() as stack:
            for where, name in (
                (search, "refit"),
                (_learn, "refit"),
                (search, "screen"),
                (search, "aliases"),
                (search, "seek_parts"),
                (search, "learn_noise"),
                (close, "locate"),
                (close, "curve_family"),
            ):
                asking = self._asking(getattr(where, name), first.get(name))
                stack.enter_context(patch.object(where, name, asking))
            stack.enter_context(patch.object(Evaluator, "_found", self._found(Evaluator._found)))
            prepare = _loop._step_subject
            stack.enter_context(patch.object(_loop, "_step_subject", self._once(prepare)))
            yield

    def _once(self, prepare):
        def prepared(*arguments):
            if "subject" not in self.known:
                self.known["subject"] = prepare(*arguments)
            return self.known["subject"]

        return prepared

    def _found(self, found):
        """Linearisations, by what the evaluator's record is."""

        def linearised(evaluator, z, index):
            record = np.asarray(evaluator.problem.friction).tobytes()
            key = ("linearised", hash(record), z.tobytes(), index.tobytes())
            if key not in self.known:
                self.known[key] = found(evaluator, z, index)
            return self.known[key]

        return linearised

    def _asking(self, function, first: int | None):
        def asked(engine, *arguments, **more):
            key = (function.__name__, state(engine), *map(_of, arguments[:first]), _of(more))
            if key not in self.known:
                self.fits += function.__name__ == "refit"
                self.known[key] = function(engine, *arguments, **more)
            return self.known[key]

        return asked
