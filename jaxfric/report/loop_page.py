"""A closed loop as the page loop.html."""

from collections.abc import Mapping

from ..loop.family import listed
from ..loop.result import Loop
from .aliases import apart
from .html import Figure, Page, origin_of, page_of, printable, words_of_page
from .location_text import shares_told
from .loop_next import meanings
from .loop_report import report
from .loop_text import base_name


def page(loop: Loop, pictures: Mapping[str, bytes], *, command: str) -> str:
    """Make the page of a loop with the drawn SVG `pictures`; `command` is the command line."""
    words = words_of_page("loop")
    lines = {
        "location.svg": shares_told(loop.location, loop.base_fit.steps.velocities),
        "aliasing.svg": apart(loop),
    }
    figures = []
    for file, about in words["figures"].items():
        caption = about["caption"].format(marks=loop.words.marks)
        figures.append(Figure(file, **about | {"caption": caption}, lines=lines.get(file, ())))
    here = {loop.verdict: f"{loop.verdict} (this record)"}
    terms = [(here.get(one["term"], one["term"]), one["text"]) for one in words["terms"]]
    declared = f" with {listed(loop.before.effects)}" if loop.before.effects else ""
    origin = loop.record.provenance
    unit = loop.record.friction_unit
    more = {
        "sampling": str(loop.record.sampling()),
        "friction": "coefficient" if unit == "1" else f"force in {unit}",
    }
    told = Page(
        f"{printable(origin.path)}: what does the {base_name(loop)}{declared} lack?",
        meanings(loop),
        words["where"],
        figures,
        terms,
        origin_of(origin, len(loop.record), command, more, f" in {loop.seconds:.1f} s"),
        words["colours"].get(loop.verdict, words["colours"]["effects"]),
    )
    return page_of(report(loop)._replace(notes=()), told, pictures, "loop.json")
