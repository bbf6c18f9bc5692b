"""Rivals on the records of a blind run: `python -m fits.rivals BLIND_DIR --out DIR`.

BLIND_DIR is what `python -m fits.blind --out BLIND_DIR` has written (records/, truth/, loops/). For
every record whose loop was closed, PySINDy and pyoperon regress what the loop's own base fit leaves
(`base`), and are scored by the same scorer (`compare`). DIR gets base/ and answers/, from which a
run that was stopped goes on, results.json and results.md.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from .answers import RULES, Formula, chosen, spoken
from .base import Base, UnlikeLoopError, stored
from .compare import everyone, finite, outcome, records, summary, table
from .sparse import frols, stlsq
from .symbolic import operon

METHODS: dict[str, Callable[[Base], list[Formula]]] = {
    "stlsq": stlsq,
    "frols": frols,
    "operon": operon,
}


def missing() -> list[str]:
    """Packages of the extra that are not installed."""
    return [name for name in ("pysindy", "pyoperon") if find_spec(name) is None]


def answers_of(base: Base) -> dict:
    """What every rival answers by every rule, for JSON; one that fails answers nothing."""
    out = {}
    for name, method in METHODS.items():
        begun, offers, error = time.monotonic(), [], None
        try:
            offers = method(base)
        except Exception as failure:  # of another's package: counted, and told
            error = f"{type(failure).__name__}: {failure}"
        seconds, rules = time.monotonic() - begun, {}
        for rule in RULES:
            ends = chosen(base, offers, rule)
            rms = {block: base.rms(ends.left, block) for block in ("train", "select", "report")}
            rules[rule] = {"claims": [list(c) for c in spoken(ends)], "rms": rms}
        out[name] = {"seconds": seconds, "offers": len(offers), "error": error, "rules": rules}
    return out


def answered(folder: Path, out: Path, name: str) -> dict:
    """The answers to a record, from `out` where they are known."""
    path = out / "answers" / f"{name}.json"
    if not path.exists():
        found = answers_of(stored(folder, out, name))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def publish(out: Path, known, lost: dict[str, int], answers: dict[str, dict]) -> str:
    """Write results.json and results.md; the table."""
    found = list(everyone(known, answers))
    rows = [summary(who, m, found[0][1]) for who, m in found]
    each = [outcome(who, m) for who, marks in found for m in marks]
    failed = sum(told[rival]["error"] is not None for told in answers.values() for rival in told)
    content = finite(
        {
            "schema": "jaxfric.rivals/1",
            "records": len(known),
            "left_out": lost,
            "failed": failed,
            "rows": rows,
            "each": each,
        }
    )
    text = json.dumps(content, indent=1, allow_nan=False)
    (out / "results.json").write_text(text + "\n", encoding="utf-8")
    gone = ", ".join(f"{n} {why}" for why, n in lost.items())
    text = (
        f"{len(known)} records (left out: {gone}; rivals failed {failed} times)\n\n{table(rows)}\n"
    )
    (out / "results.md").write_text(text, encoding="utf-8")
    return text


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m fits.rivals", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("folder", type=Path, help="what python -m fits.blind --out has written")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args(arguments)
    if not (asked.folder / "loops").is_dir():
        parser.error(f"{asked.folder} has no loops/; write it with: python -m fits.blind --out ...")
    if lacking := missing():
        parser.error(f"{' and '.join(lacking)} not installed: pip install -e '.[rivals]'")
    known, lost = records(asked.folder)
    if not known:
        parser.error(f"{asked.folder}/loops has no closed loop to compare with")
    from jaxfric.cli.common import prepare_jax

    prepare_jax()
    answers, begun = {}, time.monotonic()
    for i, k in enumerate(known, start=1):
        said = k.name
        try:
            answers[k.name] = answered(asked.folder, asked.out, k.name)
        except UnlikeLoopError as error:
            said = f"{k.name} left out: {error}"
        spent = time.monotonic() - begun
        print(f"{i:4}/{len(known)} {spent / 60:6.1f} min {said}", flush=True)
    lost["base not found again"] = len(known) - len(answers)
    print(publish(asked.out, [k for k in known if k.name in answers], lost, answers))


if __name__ == "__main__":
    main()
