"""The loops on one record: whole, and without each piece."""

import contextlib
import json
import time
from pathlib import Path

from fits.blind.scored import score
from jaxfric.cli.common import prepare_jax
from jaxfric.effects import CATALOGUE
from jaxfric.loop import close_loop
from jaxfric.records import read

from .__main__ import write
from .memory import Memory
from .pieces import PIECES
from .records import blind, made

WHOLE = "whole"


def weigh(place: int, out: Path, only: tuple[str, ...]) -> str:
    """Close the loop on a record with every piece that its file lacks; what was found, in words."""
    prepare_jax()
    one = blind()[place]
    name, truth = made(one, out)
    path = out / "found" / f"{name}.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    memory, rows = Memory(), dict(known.get("rows", {}))
    about = {"study": one.study, "condition": one.item.condition, "place": place}
    about["true"] = truth["effects"]
    wanted = [
        (piece, how)
        for piece, how in PIECES.items()
        if piece not in rows
        and (not how.of_fits or one.for_all)
        and (not only or piece in only or how.group in only)
    ]
    if WHOLE not in rows or any(not how.of_fits for _, how in wanted):
        with memory.kept():
            row = _row(one, name, truth, out)
        rows[WHOLE] = row | {"fits": memory.fits}
    for piece, how in wanted:
        before = memory.fits
        with contextlib.ExitStack() as stack:
            stack.enter_context(how.taken_out())
            if not how.of_fits:
                stack.enter_context(memory.kept())
            row = _row(one, name, truth, out)
        rows[piece] = row | {"fits": memory.fits - before}
        write(path, {**about, "rows": rows})
    whole = rows[WHOLE]
    return f"{one.item.label:22} {whole['verdict']} {'+'.join(whole['found']) or '-'}"


def _row(one, name: str, truth: dict, out: Path) -> dict:
    """What a loop finds, scored."""
    declared = json.loads((out / "records" / name / "declared.json").read_text())
    begun, error, loop = time.perf_counter(), None, None
    try:
        loop = close_loop(
            read(out / "records" / name / "record.csv"),
            stiffness=declared["stiffness [1/m]"],
            law=declared.get("law") or "slip",
            include=("stiffness",) if declared.get("stiffness known to [1]") else (),
            exclude=tuple(id for id in one.item.without if id in CATALOGUE),
        ).to_json()
    except Exception as failure:
        error = f"{type(failure).__name__}: {failure}"
    run = {"condition": one.item.condition, "without": list(one.item.without), "error": error}
    told = score(name, truth, loop, run)
    return {
        "verdict": told.verdict,
        "found": told.found,
        "kind": told.kind,
        "exact": told.exact,
        "group": told.group,
        "confirmed": told.confirmed,
        "covered": told.covered,
        "error": told.error,
        "seconds": time.perf_counter() - begun,
    }
