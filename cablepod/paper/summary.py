"""Summarise the report in one table of printed and computed values."""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod.paper.examples import FINE_STEP

HEAD = ("table or figure of the paper", "command", "ours", "print")


def summary(report: xr.Dataset) -> list[tuple[str, ...]]:
    """Return the rows (what, command, ours, print) of the table on the page of this folder.

    Parameters
    ----------
    report
        Dataset of :func:`cablepod.paper.report.write`.
    """
    return [*_table1(report), *_table2(report), *_example3(report), *_figures(report)]


def _table1(report: xr.Dataset) -> list[tuple[str, ...]]:
    length = report["table1_unstretched_length"].sel(procedure="linearised").values
    printed = report["table1_unstretched_length_printed"].values
    source = report["table1_source"].values.astype(int)
    tensions = report["table1_top_tension"].values
    rows: list[tuple[str, ...]] = []
    for i, tension in enumerate(tensions):
        ours = f"{length[i, 0]:.4f} m; with K/100 {length[i, 1]:.4f} m"
        mark = ("K", "K/100")[source[i]]
        rows.append(
            (f"Table 1, L0 at T1 = {tension:.0f} N", "`cablepod paper`", ours, f"{printed[i]:.4f} m (from {mark})")
        )
    return rows


def _table2(report: xr.Dataset) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    printed = report["table2_singular_value_printed"].values
    for start, title in (
        ("example2", "Table 2, σ1 to σ3 [m], x; y, from equilibrium"),
        ("example2_out_of_equilibrium", "the same, from the shape of a longer cable"),
        ("example2_tauter_start", "the same, from the shape of a tauter cable"),
    ):
        rows.append(
            (
                title,
                f"`cablepod run {start}`",
                _pair(report["table2_singular_value"].sel(start=start).values),
                _pair(printed, 6),
            )
        )
    share = 100.0 * report["table2_share"].sel(start="example2_tauter_start").values[:, 0]
    shares = 100.0 * report["table2_share_printed"].values[:, 0]
    title = "Table 2, share σ1/Σσ, x; y"
    ours, theirs = (f"{pair[0]:.2f} %; {pair[1]:.2f} %" for pair in (share, shares))
    rows.append((title, "`cablepod run example2_tauter_start`", ours, theirs))
    return rows


def _pair(values: np.ndarray, digits: int = 4) -> str:
    return "; ".join(", ".join(f"{value:.{digits}g}" for value in row[:3]) for row in values)


def _example3(report: xr.Dataset) -> list[tuple[str, ...]]:
    printed = "; ".join(f"{100 * float(value):.2f} %" for value in report["example3_share_printed"])
    rest = "; ".join(f"{100 * float(value):.2f} %" for value in report["example3_share_equilibrium"])
    fine = report["example3_step"].values <= FINE_STEP
    swapped = 100.0 * report["example3_share_swapped"].values[fine]
    title = "Example 3, share of five modes in Σσ of 20, x; y"
    return [
        (f"{title}, from equilibrium", "`cablepod run example3`", rest, printed),
        (
            "the same, from swapped rows",
            "`cablepod paper`",
            f"{swapped.min():.1f} to {swapped.max():.1f} %, by the time step",
            printed,
        ),
    ]


def _figures(report: xr.Dataset) -> list[tuple[str, ...]]:
    counts = report["rest_links"].values
    links = int(counts[np.abs(counts - 40).argmin()])
    gap = 1e3 * float(report["rest_gap"].sel(rest_links=links))
    rows: list[tuple[str, ...]] = [
        (
            "Figure 4, the guy at rest",
            "`cablepod paper`",
            f"chain of {links} links within {gap:.2g} mm of the catenary",
            "drawn",
        ),
        ("Figure 5, first three modes of x", "`cablepod paper`", "drawn", "drawn"),
    ]
    for name, rank, what, which in (
        ("example2", 1, "Figure 6, Example 2 at 45 s, one mode, from equilibrium", "reduced_error_45"),
        ("example2_tauter_start", 1, "the same from the shape of a tauter cable, the worst of 124 s", "reduced_error"),
        ("example3", 2, "Figure 7, Example 3 at six instants, two modes", "reduced_error_six"),
        ("example3", 2, "Figure 8, Example 3 at 45 s, two modes", "reduced_error_45"),
        ("example4", 3, "Figure 9, Example 4 at 45 s, three modes", "reduced_error_45"),
        ("example4_opposite_load", 3, "the same with the load towards -x", "reduced_error_45"),
    ):
        error = 100.0 * float(report[which].sel(scene=name, reduced_rank=rank))
        rows.append(
            (what, "`cablepod paper`", f"reduced model {error:.2g} % of the motion from the chain", "judged similar")
        )
    return rows
