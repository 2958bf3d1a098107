"""Public function: results as one page."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import xarray as xr

from cablepod._inputs import ANY, taken
from cablepod.conventions import unit_text
from cablepod.errors import SceneError, scene_error, shown
from cablepod.plots import _page_figures, _page_html, _page_tables, _page_trust
from cablepod.plots._page_html import Section

RESULTS = "what study.run returns, a Dataset of this package, or a mapping from names to Datasets"
ENDINGS = (".html", ".htm")
#: Stages of results whose numbers are the input, which has a section of its own; those whose numbers figures show.
INPUT, SHOWN = ("scene", "scenes"), ("modes",)
#: Dimensions of a design by the keys of its scene in whose place they are.
OF_STORMS = {"wind.speed": "speed", "wind.direction": "direction", "wind.turbulence.seed": "storm"}


def report(
    results: xr.DataTree | xr.Dataset | Mapping[str, xr.Dataset],
    path: str | os.PathLike[str],
    *,
    text: str = "",
    tables: Mapping[str, Iterable[Mapping[str, Any]]] | None = None,
    warnings: Iterable[str] = (),
) -> Path:
    """Write results as one self-contained HTML page, to be read, printed or attached.

    Parameters
    ----------
    results
        What :func:`cablepod.study.run` returns, a Dataset of this package, or a mapping from names to Datasets.
    path
        Name that ends in ``.html``; an existing file is replaced as a whole.
    text
        Answers in words, such as those that a command prints; shown first, with their lines kept.
    tables
        Further tables by heading: rows, each a mapping from headings to numbers and texts.  A heading ends with the SI unit of
        its numbers, such as "peak [N]", and the page prints kN.
    warnings
        Texts of the warnings that were given while the results were computed.  Python does not keep them: the page shows those
        that are given here, and what the results themselves tell.

    Returns
    -------
    pathlib.Path
        `path`.  The page has warnings, input with units, tables in kN, m or mm and Hz, figures, estimated errors, versions and
        ids.  It needs no other file, script or network, and prints on A4.

    Raises
    ------
    SceneError
        For other results and tables, for another ending of the name, and for a folder that is not there.

    Notes
    -----
    Variables over instants and over places of a mesh are told by their least, mean and largest value; lazy ones above 200 MB are
    not read.  Figures that a Dataset does not allow are left out, and the page says why.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> page = cp.plots.report({"scene": scene, "rest": cp.catenary.rest(scene)}, "guy.html")
    >>> page.read_text(encoding="utf-8").splitlines()[0]
    '<!DOCTYPE html>'
    """
    from cablepod.archive._atomic import atomic_file  # plots take nothing else of the archive

    target = checked_path(path)
    datasets, attributes = _datasets(results)
    rows = _page_tables.checked_tables(tables)
    notes = _checked_texts("warnings", warnings)
    if not isinstance(text, str):
        raise scene_error("text", text, "a text")
    title = str(attributes.get("title") or _first_title(datasets))
    version = metadata.version("cablepod")
    made = f"Made by cablepod {version} on {datetime.now(UTC):%Y-%m-%d %H:%M} UTC. The axis y points up."
    sections = [
        Section("warnings", "Warnings", _warnings(datasets, attributes, notes)),
        Section("answers", "Answers", _page_html.lines(text) if text.strip() else ""),
        Section("tables", "Tables", _given_tables(rows)),
        Section("figures", "Figures", _figures(datasets)),
        Section("input", "Input", _input(datasets)),
        Section("numbers", "Numbers", "\n".join(_numbers(datasets))),
        Section("trust", "How far to trust it", _trust(datasets)),
        Section("provenance", "Where it comes from", _provenance(datasets)),
    ]
    content = _page_html.page(title, made, sections, version)
    with atomic_file(target) as part:
        part.write_text(content, encoding="utf-8")
    return target


def checked_path(path: Any) -> Path:
    """Return the path of a page, or refuse it."""
    allowed = "a name that ends in .html, in a folder that is there"
    if not isinstance(path, str | os.PathLike) or not isinstance(os.fspath(path), str):
        raise scene_error("path", path, allowed)
    target = Path(path)
    if target.suffix.lower() not in ENDINGS or target.is_dir() or not target.parent.is_dir():
        raise scene_error("path", str(path), allowed)
    return target


def _datasets(results: Any) -> tuple[dict[str, xr.Dataset], dict[Any, Any]]:
    """Return results by name, checked, and the attributes of the study that they are of."""
    if isinstance(results, xr.DataTree):
        found = {
            node.path.strip("/"): node.to_dataset() for node in results.subtree if node.has_data and node.path != "/"
        }
        if results.has_data:
            found = {str(results.name or "result"): results.to_dataset(), **found}
        attributes = dict(results.attrs)
    elif isinstance(results, xr.Dataset):
        found = {str(results.attrs.get("stage", "result")) or "result": results}
        attributes = {}
    elif isinstance(results, Mapping):
        found, attributes = dict(results), {}
    else:
        raise scene_error("results", results, RESULTS)
    if not found:
        raise SceneError(f"results: given none; allowed: {RESULTS}")
    for name, dataset in found.items():
        if not isinstance(name, str) or not isinstance(dataset, xr.Dataset):
            raise SceneError(f"results: given {type(dataset).__name__} named {shown(name)}; allowed: {RESULTS}")
    single = isinstance(results, xr.Dataset)
    return {
        name: taken("results" if single else f"results[{name!r}]", item, ANY) for name, item in found.items()
    }, attributes


def _checked_texts(key: str, given: Any) -> list[str]:
    """Return texts, each once."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise scene_error(key, given, "a list of texts")
    texts = list(given)
    if not all(isinstance(item, str) for item in texts):
        raise scene_error(key, texts, "a list of texts")
    return list(dict.fromkeys(texts))


def _first_title(datasets: Mapping[str, xr.Dataset]) -> str:
    """Return the title of the scene, or of the first result that has one."""
    by_stage = sorted(datasets.values(), key=lambda dataset: str(dataset.attrs.get("stage")) not in INPUT)
    return next(
        (title for dataset in by_stage if isinstance(title := dataset.attrs.get("title"), str) and title), "Results"
    )


# --- sections ---------------------------------------------------------------------------------------------------------------


def _warnings(datasets: Mapping[str, xr.Dataset], attributes: Mapping[Any, Any], given: list[str]) -> str:
    """Return all warnings: those that were given, and those that results tell and no given one says."""
    own = [
        text for text in _page_trust.warnings_of(datasets, attributes) if not any(text.endswith(note) for note in given)
    ]
    found = list(dict.fromkeys([*given, *own]))
    if not found:
        return _page_html.paragraph("None was given, and the results show none.")
    return _page_html.bullets(found, "warnings")


def _given_tables(rows: Mapping[str, list[dict[str, Any]]]) -> str:
    """Return the tables of the caller."""
    tables = {heading: _page_tables.table_of_rows(content) for heading, content in rows.items()}
    return "\n".join(
        _page_html.heading(heading) + _page_html.table(table) for heading, table in tables.items() if table is not None
    )


def _figures(datasets: Mapping[str, xr.Dataset]) -> str:
    """Return the figures, and which are left out with the reason."""
    parts, left_out = [], []
    for drawing in _page_figures.drawings(datasets):
        try:
            parts.append(_page_html.picture(_page_figures.png_of(drawing), drawing.caption))
        except SceneError as error:
            left_out.append(f"{drawing.caption}: {error}")
    if left_out:
        parts += [_page_html.paragraph("Left out:"), _page_html.bullets(left_out)]
    return "\n".join(parts)


def _input(datasets: Mapping[str, xr.Dataset]) -> str:
    """Return the keys of the scene, of a Dataset of it or of the history of a result."""
    scene = next((dataset for dataset in datasets.values() if str(dataset.attrs.get("stage")) in INPUT), None)
    table = None
    if scene is not None:
        table = _page_tables.input_of(scene)
    else:
        tables = map(_page_tables.input_from_history, datasets.values())
        table = next((found for found in tables if found is not None), None)
    if table is None:
        return _page_html.paragraph("The results do not tell their scene.")
    for dataset in datasets.values():
        if str(dataset.attrs.get("stage")) == "design":
            table = _with_storms(table, dataset)
    return _page_html.paragraph("Values as given, in SI units.", "legend") + _page_html.table(table)


def _with_storms(table: _page_html.Table, design: xr.Dataset) -> _page_html.Table:
    """Return the table of keys of a scene with the values of the wind that a design varies in the place of its own."""
    rows = []
    for path, *row in table.rows:
        varied = OF_STORMS.get(path)
        if varied in design.dims:
            attrs = design[varied].attrs
            values = _page_tables.as_given(design[varied].values.tolist())
            row = [values, unit_text(attrs["units"]), f"varied: {attrs['long_name']}"]
        rows.append([path, *row])
    return table._replace(rows=rows)


def _numbers(datasets: Mapping[str, xr.Dataset]) -> Iterator[str]:
    """Yield the numbers of each result: single ones, tables, and ranges of what is too long for a table."""
    counted = {name: item for name, item in datasets.items() if str(item.attrs.get("stage")) not in (*INPUT, *SHOWN)}
    for name, dataset in _page_tables.once(counted).items():
        found = [_page_tables.scalars_of(dataset), *_page_tables.tables_of(dataset), _page_tables.ranges_of(dataset)]
        tables = [table for table in found if table is not None]
        if tables:
            yield _page_html.heading(name)
            air = f" At rest in {dataset.attrs['air']}." if "air" in dataset.attrs else ""
            yield _page_html.paragraph(f"{dataset.attrs.get('title', '')}.{air}".lstrip("."), "legend")
            yield from map(_page_html.table, tables)


def _trust(datasets: Mapping[str, xr.Dataset]) -> str:
    """Return the estimated errors and what they are."""
    table = _page_trust.estimates_of(datasets)
    if table is None:
        return _page_html.paragraph("The results have no estimates of their errors.")
    return _page_html.table(table) + _page_html.bullets(_page_trust.meanings(table), "legend")


def _provenance(datasets: Mapping[str, xr.Dataset]) -> str:
    """Return versions and stages."""
    parts = [_page_html.table(_page_trust.versions())]
    stages = _page_trust.stages_of(datasets)
    if stages is not None:
        parts += [
            _page_html.table(stages),
            _page_html.paragraph(
                "An id follows from function, options and inputs; equal ids are equal results.", "legend"
            ),
        ]
    return "\n".join(parts)
