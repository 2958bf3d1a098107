"""Write reference and notebooks as static pages into one folder, and check the links of all pages.

    python pipelines/docs.py [--out FOLDER] [--no-execute] [--small]

``index.html`` is the first page.  The reference has a page for each public module; that of a sub-package contains its README.md,
with formulas.  The notebooks are run and shown with what they print and draw; ``--no-execute`` shows text and code alone,
``--small`` runs them at the size of the tests.  Needs pdoc and nbconvert (``pip install '.[docs]'``), and no network.  Ends with
status 1 if

- a link of the reference has no target,
- a docstring refers to a name of the package without a page, or
- a link of a Markdown page of the repository has no target, file or anchor.
"""

from __future__ import annotations

import argparse
import html
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urldefrag

import _pages
import pdoc
import pdoc.doc
import pdoc.extract
import pdoc.render
from _links import PART, broken_html_links, broken_markdown_links
from _study import command_line
from jinja2 import pass_context
from pdoc.render_helpers import to_html, to_markdown_with_context

ROOT = Path(__file__).resolve().parents[1]
#: The package, whose page shows the modules that it imports, and its sub-packages; no private modules, except those with
#: classes and numbers that docstrings name.
MODULES = (
    "cablepod", "cablepod.scene", "cablepod.parameters", "cablepod.discretisation", "cablepod.integrate", "cablepod.reduced",
    "cablepod.batch", "cablepod.cli", "cablepod.paper", "cablepod.examples", r"!cablepod\..*\b_",
    "cablepod.discretisation._similarity", "cablepod.condensed._error_equation", "cablepod.condensed._estimate",
    "cablepod.galerkin._estimate", "cablepod.pod._incremental",
)  # fmt: skip
#: A reference in a docstring: a role of Sphinx and a name.
ROLE = re.compile(r":(?:func|class|meth|data|mod|exc):`~?([\w.]+)`")
#: Other packages that docstrings refer to.
OTHER_PACKAGES = ("xarray", "numpy", "numba")


def lost_references(shown: dict[str, pdoc.doc.Doc]) -> Iterator[str]:
    """List names of the package in docstrings that have no page."""
    for name, item in shown.items():
        for target in ROLE.findall(item.docstring):
            parents = ("", f"{item.modulename}.", f"{name}.", f"{name.rpartition('.')[0]}.")
            if (
                not any(f"{parent}{target}" in shown for parent in parents)
                and target.partition(".")[0] not in OTHER_PACKAGES
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


def page_of(module: str) -> str:
    """Return the path of the page of a module in the reference."""
    return f"{module.replace('.', '/')}.html"


def with_page_links(text: str, source: Path, module: str, modules: set[str]) -> str:
    """Let links of a README lead to pages of the reference; make other files of the repository plain text.

    Parameters
    ----------
    text
        A docstring in Markdown, with the README in it.
    source
        Folder of that README.
    module, modules
        Module of the docstring; all modules with a page.
    """

    def replace(link: re.Match[str]) -> str:
        place, anchor = urldefrag(link["target"] or "")
        if link["image"] or not place or re.match(r"\w+:", place):
            return link[0]
        target = (source / place).resolve()
        if not target.is_relative_to(ROOT):
            return link[0]
        name = ".".join(target.relative_to(ROOT).parent.parts)
        if target.name != "README.md" or name not in modules:
            return link["text"]
        page = os.path.relpath(page_of(name), Path(page_of(module)).parent)
        return f"[{link['text']}]({page}{'#' if anchor else ''}{anchor})"

    return PART.sub(replace, text)


def to_html_with_formulas(text: str) -> str:
    """Convert Markdown to HTML; formulas between dollars pass as they are."""
    formulas: list[str] = []

    def hide(literal: re.Match[str]) -> str:
        if not literal[0].startswith("$"):
            return literal[0]
        formulas.append(html.escape(literal[0]))
        return f"formula{len(formulas) - 1}hidden"

    def show(page: str) -> str:
        return re.sub(r"formula(\d+)hidden", lambda place: formulas[int(place[1])], page)

    hidden = to_html(PART.sub(hide, text))
    page: Any = type(hidden)(show(hidden))
    page.toc_html = hidden.toc_html and show(hidden.toc_html)
    page.metadata = hidden.metadata
    return page


def write(folder: Path) -> list[str]:
    """Write all pages of the reference; return the names of docstrings that have no page."""
    modules = set(pdoc.extract.walk_specs(MODULES))
    from cablepod import catenary

    assert catenary.stringing  # a forwarded name, which pdoc would not ask for

    @pass_context
    def to_markdown(context: Any, docstring: str) -> str:
        module = context["module"]
        text = to_markdown_with_context(context, docstring)
        if module.source_file is None:  # of the search index
            return text
        return with_page_links(text, module.source_file.parent, module.fullname, modules)

    pdoc.render.configure(docformat="numpy", footer_text="cablepod", math=True)
    pdoc.render.env.filters.update(to_markdown=to_markdown, to_html=to_html_with_formulas)
    pdoc.pdoc(*MODULES, output_directory=folder)
    shown = {item.fullname: item for name in modules for item in members(pdoc.doc.Module.from_name(name))}
    return list(lost_references(shown))


def main() -> int:
    """Write all pages, check all links and print the faults."""
    parser = command_line(__doc__, out="out/reference")
    parser.add_argument("--execute", action=argparse.BooleanOptionalAction, default=True, help="run the notebooks")
    parser.add_argument("--small", action="store_true", help="run them at the size of the tests")
    options = parser.parse_args()
    folder = options.out
    faults = write(folder)
    _pages.write(folder, execute=options.execute, small=options.small)
    faults += [*broken_html_links(folder), *broken_markdown_links(ROOT)]
    for fault in faults:
        print(fault, file=sys.stderr)
    print(f"{folder / 'index.html'}: {len(list(folder.rglob('*.html')))} pages, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
