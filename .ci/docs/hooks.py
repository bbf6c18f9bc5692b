"""Pages of the site that are made from the code and from fits/, links to them, and equations."""

import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(ROOT)]

import catalogue
import command
import notebooks
import reference
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

SOURCES = "<!-- made by hooks.py: sources -->"
MADE_FROM = {"jaxfric/effects/": "effects.md", "jaxfric/__init__.py": "reference/index.md"}
"""What pages link to in the project, and the page of the site that is made from it."""
_PICTURE = re.compile(r"!\[[^\]]*\]\(([^)\s]+\.(?:png|svg))\)")
_FENCE = re.compile(r"(```.*?```|`[^`\n]*`)", re.S)
_DOI = re.compile(r"doi:(10\.\d{4,}/(?:[^\s,;()]|\([^\s()]*\))+)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made, and the pictures that any page shows."""
    made = {**reference.pages(), **command.pages(), **catalogue.pages(ROOT)}
    for name, (text, pictures) in notebooks.pages(ROOT).items():
        made[name] = text
        for picture, content in pictures.items():
            files.append(File.generated(config, picture, content=content))
    for page in sorted([*ROOT.glob("fits/*/README.md"), ROOT / "data" / "README.md"]):
        made[page.relative_to(ROOT).as_posix()] = page.read_text(encoding="utf-8")
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    for name, text in [*made.items(), *written(files)]:
        for picture in pictures_of(name, text):
            if files.get_file_from_path(picture) is None:
                files.append(File.generated(config, picture, abs_src_path=str(ROOT / picture)))
    return files


def written(files: Files) -> list[tuple[str, str]]:
    """The pages of the folder, as if they were in the root of the project."""
    own = [file for file in files.documentation_pages() if file.generated_by is None]
    return [(file.src_uri, at_root(file.content_string)) for file in own]


def pictures_of(page: str, text: str) -> list[str]:
    """Paths in the project of the pictures that a page shows."""
    folder = (ROOT / page).parent
    found = [(folder / one).resolve() for one in _PICTURE.findall(text)]
    return [one.relative_to(ROOT).as_posix() for one in found if one.is_file()]


def at_root(text: str) -> str:
    """Links of a page of the folder, as they are in the site."""
    text = text.replace("](../../../", "](").replace(".ci/docs/pages/", "")
    for there, here in MADE_FROM.items():
        text = text.replace(f"]({there})", f"]({here})")
    return re.sub(r"\]\((fits/tutorials/\w+)\.ipynb\)", r"](\1.md)", text)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Links to where pages are in the site; sources; equations as MathML."""
    text = at_root(markdown).replace(SOURCES, sources())
    return equations(text) if "$$" in text else text


def equations(text: str) -> str:
    """TeX between dollars as MathML, which browsers draw by themselves; none within code."""
    parts = _FENCE.split(text)
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"\$\$(.+?)\$\$", lambda m: _block(m[1]), parts[i], flags=re.S)
        parts[i] = re.sub(r"\$([^$\n]+(?:\n[^$\n]+)?)\$", lambda m: _math(m[1]), parts[i])
    return "".join(parts)


def _math(tex: str) -> str:
    return f"<span>{convert(' '.join(tex.split()))}</span>"  # a line that begins with math is none


def _block(tex: str) -> str:
    # a long one scrolls by itself: else the whole page does in a narrow window
    inside = convert(" ".join(tex.split()), display="block")
    return f'<div class="equation" style="overflow-x: auto">{inside}</div>'


def sources() -> str:
    """A list of the works that docstrings name by their DOI, with the modules that do."""
    found: dict[str, list[str]] = {}
    for path in sorted((ROOT / "jaxfric").rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts).replace(".__init__", "")
        for doi in _DOI.findall(path.read_text(encoding="utf-8")):
            modules = found.setdefault(doi.rstrip("."), [])
            if module not in modules:
                modules.append(module)
    rows = [
        f"| [doi:{doi}](https://doi.org/{doi.replace('(', '%28').replace(')', '%29')}) |"
        f" {', '.join(f'`{one}`' for one in modules)} |"
        for doi, modules in sorted(found.items())
    ]
    return "\n".join(["| work | named in |", "|---|---|", *rows])
