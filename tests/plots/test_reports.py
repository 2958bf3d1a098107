"""Errors over time and against run time, of plain tables and lists."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from drawings import texts
from matplotlib import pyplot as plt

import cablepod as cp
from cablepod import plots


def comparison() -> xr.Dataset:
    return xr.Dataset({"error": ("time", [0.1, 0.2])}, {"time": [0.0, 1.0]})


ROWS = [
    ("chain", 1.0, 1e-4),
    ("reduced", 0.1, 1e-2),
    ("chain", 0.1, 2e-2),
    ("reduced", 0.01, 3e-2),
    ("chain", 3.0, 1e-3),
]
TABLES = {
    "triples": ROWS,
    "mappings": [dict(zip(("name", "run_time", "error"), row, strict=True)) for row in ROWS],
    "columns": {key: [row[i] for row in ROWS] for i, key in enumerate(("name", "run_time", "error"))},
    "table": pd.DataFrame(ROWS, columns=["name", "run_time", "error"]),
    "Dataset": pd.DataFrame(ROWS, columns=["name", "run_time", "error"]).to_xarray(),
}


@pytest.mark.parametrize("form", TABLES)
def test_error_against_run_time_takes_a_plain_table(form):
    ax = plots.error_against_run_time(TABLES[form])
    drawn = {line.get_label(): line.get_xydata() for line in ax.lines}
    np.testing.assert_array_equal(drawn["chain"], [[1.0, 1e-4], [0.1, 2e-2], [3.0, 1e-3]])
    np.testing.assert_array_equal(drawn["reduced"], [[0.1, 1e-2], [0.01, 3e-2]])
    np.testing.assert_array_equal(drawn["front"], [[0.01, 3e-2], [0.1, 1e-2], [1.0, 1e-4]])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("run time [s]", "error [1]")
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ([("a", 1.0)], r"result\[0\]: given \('a', 1.0\); allowed: rows of name, run_time \[s\] and error"),
        ([{"name": "a", "error": 0.1}], r"result\[0\]: given a row without run_time; allowed: rows of name"),
        ({"name": ["a"]}, "result: given a dict without run_time and error; allowed: rows"),
        ([("a", 0.0, 0.1)], "result: run_time: given 0.0; allowed: finite numbers above 0"),
        ([("a", 1.0, np.nan)], "result: error: given nan; allowed: finite numbers from 0 on"),
        ([("a", "fast", 0.1)], "result: given 'run times or errors that are no numbers'"),
        ([], "result: given "),
        (3, "result: given a int without name and run_time and error; allowed: rows"),
    ],
)
def test_tables_that_cannot_be_drawn_are_refused(table, message):
    with pytest.raises(cp.SceneError, match=message):
        plots.error_against_run_time(table)


def test_errors_over_time_take_a_list_too():
    title = "error of a guy: condensed model, r = {} against a guy: chain"
    given = [comparison().assign_attrs(title=title.format(rank)) for rank in (1, 2)]
    assert texts(plots.error_over_time(given)) == ["condensed model, r = 1", "condensed model, r = 2"]
    same = [comparison().assign_attrs(title="")] * 2
    assert texts(plots.error_over_time(same)) == ["comparison (1)", "comparison (2)"]
    assert texts(plots.error_over_time({"wind and ice, the rarest of all cases": comparison()})) == [
        "wind and ice, the rarest of\nall cases"
    ]
    for axes in (5, plt.figure()):
        with pytest.raises(cp.SceneError, match=f"^ax: given '{type(axes).__name__}'; allowed: axes of matplotlib"):
            plots.error_over_time(given, ax=axes)
    for nothing in ([], {}, ()):
        with pytest.raises(cp.SceneError, match=r"comparisons: given 'nothing'; allowed: a mapping, .* or a list"):
            plots.error_over_time(nothing)
    with pytest.raises(cp.SceneError, match=r"comparisons\[1\]: given 'float'; allowed: what compare.errors gives"):
        plots.error_over_time([comparison(), 3.0])
