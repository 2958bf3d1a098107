"""Check the links of Markdown and HTML pages: files and anchors within the repository; other sites are not followed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

#: Parts of a Markdown page without links: code and formulas.
LITERAL = r"^```.*?^```|`[^`\n]+`|\$\$.+?\$\$|\$[^$\s](?:[^$\n]|\n(?!\n))*?\$"
#: A literal, or a link or an image: its mark, text and target.
PART = re.compile(rf"{LITERAL}|(?P<image>!?)\[(?P<text>[^\[\]]*)\]\((?P<target>[^()\s]+)\)", re.DOTALL | re.MULTILINE)
#: Templates, whose links are those of the page that is made from them.
TEMPLATES = ("cablepod/paper/page.md",)
#: Folders that are not part of the repository.
IGNORED = ("out", "build", "dist", "__pycache__")


class Page(HTMLParser):
    """Anchors and links of an HTML page."""

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


def anchors(text: str) -> set[str]:
    """Return the anchors that GitHub gives to the headings of a Markdown page."""
    found: set[str] = set()
    for heading in re.findall(r"^#{1,6} +(.+?)\s*$", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.M), re.M):
        anchor = slug(heading)
        copies = (anchor, *(f"{anchor}-{i}" for i in range(1, len(found) + 2)))
        found.add(next(name for name in copies if name not in found))
    return found


def slug(heading: str) -> str:
    """Return GitHub's anchor of a heading."""
    plain = PART.sub(lambda part: part["text"] or part[0], heading).lower()
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


def markdown_pages(root: Path) -> list[Path]:
    """List the Markdown pages of a repository, without templates and hidden folders."""
    return [
        page
        for page in sorted(root.rglob("*.md"))
        if page.relative_to(root).as_posix() not in TEMPLATES
        and not any(part.startswith(".") or part in IGNORED for part in page.relative_to(root).parts)
    ]


def broken_markdown_links(root: Path) -> Iterator[str]:
    """List links of the Markdown pages of a repository without a target: file or anchor."""
    root = root.resolve()
    for page in markdown_pages(root):
        text = page.read_text(encoding="utf-8")
        for target in sorted({part["target"] for part in PART.finditer(text) if part["target"]}):
            if re.match(r"\w+:", target):
                continue
            place, anchor = urldefrag(unquote(target))
            file = (page.parent / place).resolve() if place else page
            known = file.exists() and file.is_relative_to(root)
            if known and anchor:
                known = file.suffix == ".md" and anchor in anchors(file.read_text(encoding="utf-8"))
            if not known:
                yield f"{page.relative_to(root)}: {target} leads nowhere"


def broken_html_links(folder: Path) -> Iterator[str]:
    """List links of the HTML pages in a folder without a target."""
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in folder.rglob("*.html")}
    for path, page in pages.items():
        for link in sorted(page.links):
            if re.match(r"\w+:", link):
                continue
            place, fragment = urldefrag(unquote(link))
            target = (path.parent / place).resolve() if place else path
            if not target.exists() or (fragment and target in pages and fragment not in pages[target].ids):
                yield f"{path.relative_to(folder.resolve())}: {link} leads nowhere"
