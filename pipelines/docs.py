"""Write the reference from the docstrings, a page for each module, and check it.

    python pipelines/docs.py [--out FOLDER]

Needs pdoc (``pip install 'cablepod[docs]'``).  Ends with status 1 if a link has no target, or if a docstring refers to a name of
the package without a page.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pdoc
import pdoc.doc
import pdoc.render
from _study import command_line

#: The package, whose page shows the modules that it imports, and public modules imported by name only.
MODULES = (
    "cablepod", "cablepod.examples", "cablepod.discretisation._similarity", "cablepod.condensed._estimate", "cablepod.galerkin._estimate",
    "cablepod.pod._incremental",
)  # fmt: skip
#: A reference in a docstring: a role of Sphinx and a name.
ROLE = re.compile(r":(?:func|class|meth|data|mod|exc):`~?([\w.]+)`")


class Page(HTMLParser):
    """Anchors and links of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note the anchor and the links of a tag."""
        for name, value in attrs:
            if name == "id" and value:
                self.ids.add(value)
            elif name in ("href", "src") and value and tag != "link":
                self.links.add(value)


def broken_links(folder: Path) -> Iterator[str]:
    """List links within `folder` without a target; links to other sites are not followed."""
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in folder.rglob("*.html")}
    for path, page in pages.items():
        for link in sorted(page.links):
            if re.match(r"\w+:", link):
                continue
            place, fragment = urldefrag(unquote(link))
            target = (path.parent / place).resolve() if place else path
            if not target.exists() or (fragment and target in pages and fragment not in pages[target].ids):
                yield f"{path.relative_to(folder.resolve())}: {link} leads nowhere"


def lost_references(shown: dict[str, pdoc.doc.Doc]) -> Iterator[str]:
    """List names of the package in docstrings that have no page."""
    for name, item in shown.items():
        for target in ROLE.findall(item.docstring):
            candidates = [
                target,
                f"{item.modulename}.{target}",
                f"{name}.{target}",
                f"{name.rpartition('.')[0]}.{target}",
            ]
            if not any(candidate in shown for candidate in candidates) and target.partition(".")[0] not in (
                "xarray",
                "numpy",
            ):
                yield f"{name}: refers to {target}, which no page shows"


def members(module: pdoc.doc.Namespace) -> Iterator[pdoc.doc.Doc]:
    """Walk through the items of a page."""
    yield module
    for item in module.own_members:
        if not item.name.startswith("_"):
            yield item
            if isinstance(item, pdoc.doc.Class):
                yield from members(item)


def write(folder: Path) -> list[str]:
    """Write all pages; return their faults."""
    pdoc.render.configure(docformat="numpy", footer_text="cablepod")
    pdoc.pdoc(*MODULES, output_directory=folder)
    names = [path.relative_to(folder).with_suffix("").as_posix().replace("/", ".") for path in folder.rglob("*.html")]
    modules = [pdoc.doc.Module.from_name(name) for name in names if name.startswith("cablepod")]
    shown = {item.fullname: item for module in modules for item in members(module)}
    return [*broken_links(folder), *lost_references(shown)]


def main() -> int:
    """Write the pages and print their faults."""
    folder = command_line(__doc__, out="out/reference").parse_args().out
    faults = write(folder)
    for fault in faults:
        print(fault, file=sys.stderr)
    print(f"{folder / 'cablepod.html'}: {len(list(folder.rglob('*.html')))} pages, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
