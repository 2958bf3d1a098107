"""Render the notebooks, and the first page beside reference and notebooks, as static pages."""

from __future__ import annotations

import html
import os
import re
from pathlib import Path
from unittest import mock

import jupytext
import numpy as np
from nbconvert import HTMLExporter
from nbconvert.preprocessors import ExecutePreprocessor

import cablepod as cp
from cablepod import examples

NOTEBOOKS = Path(__file__).parent / "notebooks"
#: In the order in which they are to be read.
NAMES = ("first_look", "modes", "reduced_models", "parametric_study", "wind", "the_paper")
#: Time limit of a cell [s].
CELL = 600
PICTURE = "guy.gif"
#: Of the motion of example 3, 0.5 rad/s [s]; the picture then repeats without a jump.
TWO_PERIODS = 8.0 * np.pi
FIRST_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>cablepod</title>
<style>
body {{ max-width: 46rem; margin: 2rem auto; padding: 0 1rem; font-family: sans-serif; line-height: 1.5; }}
img {{ max-width: 100%; }}
</style>
</head>
<body>
<h1>cablepod {version}</h1>
<p>Reduced-order models of cable dynamics, from scene to archive, on labelled data.</p>
<figure>
<img src="{picture}" alt="Deflection of a guy along its arc length as its mast sways: moving dots, and a grey line at rest.">
<figcaption>A guy of 61 m whose upper end sways by 14 cm: the deflection normal to the chord in two periods of 12.6 s each.
</figcaption>
</figure>
<h2>Pages</h2>
<ul>
<li><a href="cablepod.html">Reference</a>: functions and theory, a page for each sub-package</li>
{links}
</ul>
</body>
</html>
"""


def render(name: str, folder: Path, *, execute: bool, small: bool = False) -> str:
    """Write the page of a notebook; return its title.

    Parameters
    ----------
    name
        Name of the notebook in ``pipelines/notebooks``.
    folder
        Folder of the page.
    execute
        Whether to run its cells; otherwise the page shows text and code alone.
    small
        Run it at the size of the tests: the numbers in the text are those of the full size.
    """
    notebook = jupytext.read(NOTEBOOKS / f"{name}.py")
    title = re.search(r"^# (.+)$", notebook.cells[0].source, re.MULTILINE)
    if title is None:
        raise ValueError(f"{name}: its first cell has no title")
    if execute:
        work = folder / "files"
        work.mkdir(exist_ok=True)
        # figures go to the page, whatever the backend outside is
        environment = {
            "CABLEPOD_SMALL": "1" if small else "",
            "MPLBACKEND": "module://matplotlib_inline.backend_inline",
        }
        with mock.patch.dict(os.environ, environment):
            runner = ExecutePreprocessor(timeout=CELL, kernel_name="python3")
            runner.preprocess(notebook, {"metadata": {"path": str(work)}})
    page, _ = HTMLExporter(exclude_input_prompt=True, exclude_output_prompt=True).from_notebook_node(
        notebook, {"metadata": {"name": title[1]}}
    )
    (folder / f"{name}.html").write_text(page, encoding="utf-8")
    return title[1]


def write(folder: Path, *, execute: bool, small: bool = False) -> None:
    """Write the first page with its animated picture, and a page for each notebook."""
    below = folder / "notebooks"
    below.mkdir(parents=True, exist_ok=True)
    titles = {name: render(name, below, execute=execute, small=small) for name in NAMES}
    run = cp.chain.simulate(examples.scene("example3"), times=np.linspace(0.0, TWO_PERIODS, 60, endpoint=False))
    cp.plots.animate(run, deflection=True).save(folder / PICTURE)
    links = "\n".join(
        f'<li><a href="notebooks/{name}.html">{html.escape(title)}</a>: a notebook</li>'
        for name, title in titles.items()
    )
    (folder / "index.html").write_text(
        FIRST_PAGE.format(version=cp.__version__, picture=PICTURE, links=links), encoding="utf-8"
    )
