"""The text of a page: headings, tables and figures as HTML that needs no other file, no script and no network."""

from __future__ import annotations

import base64
import re
import textwrap
from collections.abc import Iterable, Sequence
from html import escape
from string import Template
from typing import NamedTuple

from cablepod.errors import printable

#: Maximum number of columns of a table beside its first ones, which fit on A4.
MAX_COLUMNS = 7
#: What stands in a cell without a value, and what is aligned to the right as a number.
NOTHING, NUMBER = "-", re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?( %)?|-")
#: Class of the cells of numbers, and of texts that stay on one line, with their maximum length.
RIGHT, SHORT, MAX_SHORT = ' class="n"', ' class="s"', 32
#: Maximum length of a sentence on one line of a text with columns, which fits on the page.
MAX_SENTENCE = 96
#: Maximum length of a line with columns that a print of usual size has room for.
MAX_LINE = 126

#: The security policy lets a browser load nothing but the pictures inside the page.
PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="cablepod $version">
<title>$title</title>
<style>
@page { size: A4; margin: 16mm 15mm; }
body { max-width: 180mm; margin: 2rem auto; padding: 0 1rem; font: 10.5pt/1.45 sans-serif; color: #111; background: #fff; }
h1 { font-size: 1.6em; line-height: 1.2; margin-bottom: 0.2em; }
h2 { font-size: 1.25em; margin: 1.8em 0 0.5em; border-bottom: 1px solid #888; }
h3 { font-size: 1.05em; margin: 1.3em 0 0.4em; }
.made { color: #444; margin-top: 0; }
nav a { color: #00457c; margin-right: 1em; white-space: nowrap; }
table { border-collapse: collapse; margin: 0.4em 0 1em; font-size: 0.9em; }
th, td { text-align: left; vertical-align: top; padding: 0.15em 0.7em 0.15em 0; border-bottom: 1px solid #ddd;
  overflow-wrap: anywhere; }
th { border-bottom: 1px solid #888; vertical-align: bottom; overflow-wrap: normal; }
th.n, td.n { text-align: right; }
td.n { font-variant-numeric: tabular-nums; }
td.n, td.s { white-space: nowrap; }
figure { margin: 1em 0; }
figure img { max-width: 100%; height: auto; }
figcaption, .legend { color: #444; font-size: 0.9em; }
.wide { overflow-x: auto; }
pre { white-space: pre; overflow-x: auto; font-size: 0.82em; line-height: 1.35; }
ul.warnings { border-left: 4px solid #b5521b; padding: 0.4em 0.4em 0.4em 2em; background: #fdf3ec; }
code { font-size: 0.92em; overflow-wrap: anywhere; }
@media print {
  body { max-width: none; margin: 0; padding: 0; font-size: 9.5pt; }
  nav { display: none; }
  figure, tr, li { break-inside: avoid; }
  h1, h2, h3 { break-after: avoid; }
  thead { display: table-header-group; }
  .wide { overflow: visible; }
  table { font-size: 0.8em; }
  th, td { padding-right: 0.5em; }
  td.s { white-space: normal; }
  pre { white-space: pre-wrap; overflow: visible; overflow-wrap: anywhere; font-size: 6.4pt; }
  pre.long { font-size: 5.2pt; }
  ul.warnings { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
</style>
</head>
<body>
<h1>$title</h1>
<p class="made">$made</p>
<nav>$contents</nav>
$sections
</body>
</html>
""")


class Table(NamedTuple):
    """Cells of a table as texts."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    fixed: int = 1  #: number of first columns, which name the row


class Section(NamedTuple):
    """A part of the page: name of its place, heading, HTML."""

    name: str
    heading: str
    body: str


def page(title: str, made: str, sections: Iterable[Section], version: str) -> str:
    """Return the whole page of sections that have a body."""
    shown = [section for section in sections if section.body]
    return PAGE.substitute(
        title=text(title),
        made=text(made),
        version=text(version),
        contents="\n".join(f'<a href="#{section.name}">{text(section.heading)}</a>' for section in shown),
        sections="\n".join(
            f'<section id="{section.name}">\n<h2>{text(section.heading)}</h2>\n{section.body}\n</section>'
            for section in shown
        ),
    )


def text(value: object) -> str:
    """Return a value as text in HTML."""
    return escape(printable(str(value)), quote=True)


def heading(value: object) -> str:
    """Return a heading within a section."""
    return f"<h3>{text(value)}</h3>"


def paragraph(value: object, kind: str = "") -> str:
    """Return a paragraph, of a class of the style sheet if one is given."""
    return f'<p class="{kind}">{text(value)}</p>' if kind else f"<p>{text(value)}</p>"


def lines(value: str) -> str:
    """Return a text whose lines and columns are kept; long sentences, which have no columns, are broken."""
    kept: list[str] = []
    for line in value.split("\n"):
        is_long = len(line) > MAX_SENTENCE and "  " not in line.strip()
        kept += textwrap.wrap(line, MAX_SENTENCE, subsequent_indent="  ", break_long_words=False) if is_long else [line]
    kind = ' class="long"' if max(map(len, kept), default=0) > MAX_LINE else ""
    return f"<pre{kind}>" + text("\n".join(kept)) + "</pre>"


def bullets(items: Iterable[object], kind: str = "") -> str:
    """Return a list."""
    return f'<ul class="{kind}">' + "".join(f"<li>{text(item)}</li>" for item in items) + "</ul>"


def table(content: Table) -> str:
    """Return a table; one with many columns is divided into several, each with the columns that name the row."""
    fixed, columns = content.fixed, len(content.head)
    parts = [range(i, min(i + MAX_COLUMNS, columns)) for i in range(fixed, columns, MAX_COLUMNS)] or [
        range(fixed, fixed)
    ]
    return "\n".join(_part(content, [*range(fixed), *part]) for part in parts)


def _part(content: Table, chosen: Sequence[int]) -> str:
    right = {i for i in chosen if content.rows and all(NUMBER.fullmatch(row[i]) for row in content.rows)}
    head = "".join(f"<th{RIGHT if i in right else ''}>{text(content.head[i])}</th>" for i in chosen)
    rows = "\n".join("<tr>" + "".join(_cell(row[i]) for i in chosen) + "</tr>" for row in content.rows)
    return f'<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table></div>'


def _cell(value: str) -> str:
    kind = RIGHT if NUMBER.fullmatch(value) else SHORT if len(value) <= MAX_SHORT else ""
    return f"<td{kind}>{text(value)}</td>"


def picture(png: bytes, caption: str) -> str:
    """Return a figure with its picture inside."""
    data = base64.b64encode(png).decode("ascii")
    return (
        f'<figure><img alt="{text(caption)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text(caption)}</figcaption></figure>"
    )
