"""Make the sections of the report: tables, figures and values for ``page.md``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod.paper import examples, figures, initial_shape, routes, table1, validity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Size:
    """Extent of the report."""

    name: str
    note: str = ""  #: note on the page
    rest_links: tuple[int, ...] = (10, 20, 40, 80, 160)
    swapped_steps: tuple[float, ...] = examples.SWAPPED_STEPS
    ranks: tuple[int, ...] = examples.RANKS
    route_sizes: tuple[tuple[int, int], ...] = routes.SIZES
    tensions: tuple[float, ...] = validity.TENSIONS
    stiffnesses: tuple[float, ...] = validity.STIFFNESSES
    sags: tuple[float, ...] = initial_shape.EXAMPLE_3_SAGS


FULL = Size("full")
SMALL = Size(
    "small",
    note="\n**This is the small form, a trial**: fewer modes, smaller routes, fewer tensions, stiffnesses and sags than the full "
    "report. Statements about ranges hold for what was computed only.\n",
    rest_links=(10, 40),
    ranks=(1, 2, 3),
    route_sizes=((39, 125), (80, 500)),
    tensions=(4e3, 60e3),
    stiffnesses=(2e5, 2e7),
    sags=(0.6,),
)


@dataclass(frozen=True)
class Section:
    """Section of the report."""

    title: str
    data: xr.Dataset
    values: dict[str, Any]  #: for the fields of the page
    figures: dict[str, Figure] = field(default_factory=dict)


def lines(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a Markdown table."""
    body = [" | ".join(str(cell) for cell in row) for row in rows]
    return "\n".join(f"| {row} |" for row in [" | ".join(head), " | ".join("---" for _ in head), *body])


def table_1(size: Size, progress: Progress) -> Section:
    """Make the section on Table 1, Example 1 and Figure 4."""
    table = table1.table1()
    progress(0.2)
    rest = table1.rest_comparison(links=size.rest_links)
    linear = table["table1_unstretched_length"].sel(procedure="linearised")
    exact = table["table1_unstretched_length"].sel(procedure="exact")
    off = np.abs(linear.values - exact.values).max(axis=0)
    gaps = zip(rest["rest_links"].values, rest["rest_gap"].values, strict=True)
    values = {
        "table1": _rows_of_table_1(table),
        "stiffness": float(table["table1_stiffness"][0]),
        "table1_misfit_mm": 1e3 * float(table["table1_misfit"].max()),
        "linear_mm": 1e3 * off[0],
        "linear_soft_m": off[1],
        "rest_gaps": ", ".join(f"{1e3 * gap:.3g} mm with {links} links" for links, gap in gaps),
        **{name: float(rest[name]) for name in ("catenary_gap", "motion_gap", "motion_size")},
    }
    data = xr.merge([table, rest], combine_attrs="override")
    return Section("Table 1", data, values, {"figure4": figures.figure4()})


def _rows_of_table_1(table: xr.Dataset) -> str:
    """Return Table 1 in Markdown."""
    rows = []
    for i in range(table.sizes["table1_row"]):
        part = table.isel(table1_row=i)
        linear, exact = (
            part["table1_unstretched_length"].sel(procedure=name).values for name in ("linearised", "exact")
        )
        source = int(part["table1_source"])
        length, lower = (float(part[f"table1_{name}"][0, 0]) for name in ("stretched_length", "tension_lower"))
        rows.append(
            (
                f"{float(part['table1_top_tension']):.0f}",
                f"{float(part['table1_unstretched_length_printed']):.4f}",
                *(f"**{value:.5f}**" if j == source else f"{value:.5f}" for j, value in enumerate(linear)),
                *(f"{value:.5f}" for value in exact),
                f"{length:.5f} / {float(part['table1_stretched_length_printed']):.4f}",
                f"{length - linear[source]:.5f} / {float(part['table1_elongation_printed']):.3f}",
                f"{lower:.1f} / {float(part['table1_tension_lower_printed']):.0f}",
            )
        )
    head = (
        "T1 [N]", "L0 printed [m]", "eqs. (9)-(16), K", "eqs. (9)-(16), K/100", "exact, K", "exact, K/100",
        "L ours / print [m]",
        "ΔL ours / print [m]", "T0 ours / print [N]",
    )  # fmt: skip
    return lines(head, rows)


def table_2(_: Size, progress: Progress) -> Section:
    """Make the section on Table 2, Figures 5 and 6."""
    table = examples.table2()
    progress(0.7)
    printed = table["table2_singular_value_printed"].values
    shares = 100.0 * table["table2_share_printed"].values
    rest, best = table.sel(start="example2"), table.sel(start="example2_out_of_equilibrium")
    sigma, pov = rest["table2_singular_value"].values, rest["table2_proper_orthogonal_value"].values
    values = {
        "table2": _rows_of_table_2(table),
        "soft_kN": 1e-3 * float(table["table2_top_tension"].sel(start="example2_soft")),
        "as_printed_kN": 1e-3 * float(table["table2_top_tension"].sel(start="example2_as_printed")),
        "samples": round(float(sigma[0, 0] ** 2 / pov[0, 0])),
        "print_x": printed[0, 0],
        "print_y": printed[1, 0],
        "print_ratio": printed[0, 0] / printed[1, 0],
        "print_second": printed[0, 1],
        "print_share_x": shares[0, 0],
        "print_sum_y": 100.0 * printed[1, 0] / shares[1, 0],
        "sigma_x": sigma[0, 0],
        "sigma_y": sigma[1, 0],
        "second": sigma[0, 1],
        "sigma_ratio": sigma[0, 0] / sigma[1, 0],
        "square_ratio": (sigma[0, 0] / sigma[1, 0]) ** 2,
        "pov_x": pov[0, 0],
        "pov_y": pov[1, 0],
        "share_x": 100.0 * float(best["table2_share"][0, 0]),
        "energy_x": 100.0 * float(best["table2_energy_share"][0, 0]),
        "near": 100.0 * np.abs(best["table2_singular_value"].values[:, :3] / printed[:, :3] - 1.0).max(),
    }
    drawn = {"table2": figures.singular_values(table), "figure5": figures.figure5(), "figure6": figures.figure6()}
    return Section("Table 2", table, values, drawn)


def _rows_of_table_2(table: xr.Dataset) -> str:
    """Return Table 2 in Markdown."""

    def row(values: np.ndarray) -> list[str]:
        return [f"{value:.4g}" for value in values]

    rows: list[Sequence[Any]] = []
    for axis, total in zip(("x", "y"), examples.printed_of(2), strict=True):
        printed = table["table2_singular_value_printed"].sel(coordinate=axis).values
        rows.append((f"**print, {axis}**", *(f"**{value:g}**" for value in printed), f"**{total:g}**", ""))
        for name in table["start"].values:
            part = table.sel(start=name, coordinate=axis)
            misfit = f"{float(part['table2_misfit_3']):.3g} / {float(part['table2_misfit']):.3g}" if axis == "x" else ""
            values = row(part["table2_singular_value"].values)
            rows.append((f"`{name}`, {axis}", *values, f"{float(part['table2_sum']):.4g}", misfit))
    return lines(("scene", "σ1 [m]", "σ2", "σ3", "σ4", "σ5", "sum of 20", "misfit of 3 / 5 rows, x and y"), rows)


#: Probable first value of y in Table 2 without the misprint [m].
MENDED = 2.4026
#: Initial shapes named on the page, and the maximum misfit of a fitting part.
START_NAMES = ("longer cable (rows 1 to 3)", "tauter cable (A)", "longer cable (B)", "tauter cable (C)")
FITTING = 0.1


def which_start(size: Size, progress: Progress) -> Section:
    """Make the section on initial shapes that explain Table 2 and the shares of Example 3."""
    tried = initial_shape.tried(progress=lambda fraction: progress(0.6 * fraction))
    example3 = initial_shape.example3(sags=size.sags)
    target, sums = examples.printed_values(), examples.printed_of(2)
    rows: list[Sequence[Any]] = [
        ("**print**", "", *(f"**{value:g}**" for value in target[0]), f"**{sums[0]:g}**", "", "")
    ]
    for name in tried["tried"].values:
        part = tried.sel(tried=name)
        x = [f"{value:.3g}" for value in part["tried_singular_value"].values[0]]
        fit = [f"{float(part[key]):.3f}" for key in ("tried_misfit_3", "tried_misfit")]
        rows.append((name, f"{float(part['tried_sag']):.2f}", *x, f"{float(part['tried_sum'][0]):.3f}", *fit))
    known, found, other, least = (tried.sel(tried=name) for name in START_NAMES)

    def off(part: xr.Dataset) -> float:
        return 100.0 * float(np.abs(part["tried_singular_value"].values / target - 1.0).max())

    fitting = [
        f"{name} ({float(tried['tried_sag'].sel(tried=name)):.2f})"
        for name in tried["tried"].values[tried["tried_misfit"].values < FITTING]
    ]
    head = (
        "start",
        "its sag / sag at rest",
        "σ1 of x [m]",
        "σ2",
        "σ3",
        "σ4",
        "σ5",
        "sum of 20",
        "misfit, 3 rows",
        "5 rows",
    )
    ratio = float(found["tried_singular_value"][0, 0] / found["tried_singular_value"][1, 0])
    shares = 100.0 * example3["sagging_share"].values
    values = {
        "tried": lines(head, rows),
        "known_misfit": float(known["tried_misfit"]),
        "found_misfit": float(found["tried_misfit"]),
        "found_off": off(found),
        "other_misfit": float(other["tried_misfit"]),
        "other_off": off(other),
        "least_all": off(least),
        "fitting": FITTING,
        "fitting_starts": ", ".join(fitting),
        "found_sum_x": float(found["tried_sum"][0]),
        "found_sum_y": float(found["tried_sum"][1]),
        "least_misfit": float(least["tried_misfit"]),
        "least_off": 100.0 * (float(least["tried_singular_value"][0, 0]) / target[0, 0] - 1.0),
        "print_sum_x": sums[0],
        "print_sum_y_text": sums[1],
        "slip_share": 100.0 * target[1, 0] / sums[1],
        "mended_share": 100.0 * MENDED / sums[1],
        "slip_ratio": target[0, 0] / MENDED,
        "our_ratio": ratio,
        "sag_least": min(size.sags),
        "sag_most": max(size.sags),
        "sag_share_least": shares.min(),
        "sag_share_most": shares.max(),
    }
    return Section("Starts", xr.merge([tried, example3], combine_attrs="override"), values)


def example_3(size: Size, _: Progress) -> Section:
    """Make the section on the energy shares of Example 3, Figures 7 and 8."""
    data = examples.example3_share(steps=size.swapped_steps)
    every = 100.0 * data["example3_share_swapped"].values
    fine = data["example3_step"].values <= examples.FINE_STEP
    swapped, coarse = every[fine], every[~fine]
    printed = 100.0 * data["example3_share_printed"].values
    rest = 100.0 * data["example3_share_equilibrium"].values
    runs = zip(data["example3_step"].values, every, strict=True)
    rows = [
        ("print", *(f"{value:.2f} %" for value in printed)),
        ("`example3`, from equilibrium", *(f"{value:.2f} %" for value in rest)),
        *((f"`example3_swapped_rows`, step {step:.3g} s", *(_share(value) for value in pair)) for step, pair in runs),
    ]
    values = {
        "example3": lines(("share of the first five in the sum of 20 singular values", "x", "y"), rows),
        "swapped_least": swapped.min(),
        "swapped_most": swapped.max(),
        "print_share_3": printed[0],
        "print_share_3_y": printed[1],
        "finest_coarse": examples.FINE_STEP,
        "coarse": f"{int(np.isnan(coarse).any(axis=1).sum())} of the {len(coarse)} longer ones",
    }
    return Section("Example 3", data, values, {"figure7": figures.figure7(), "figure8": figures.figure8()})


def _share(percent: float) -> str:
    return "broke down" if np.isnan(percent) else f"{percent:.2f} %"


def reduced_models(size: Size, progress: Progress) -> Section:
    """Make the section on errors of the reduced model and Figure 9."""
    data = examples.errors(ranks=size.ranks, progress=progress)
    head = ("scene", "", *(f"r = {rank}" for rank in data["reduced_rank"].values))
    rows = []
    for name in data["scene"].values:
        part = data.sel(scene=name)
        for variable, title in (("reduced_error", "reduced model"), ("projection_error", "projection only")):
            rows.append((f"`{name}`", title, *(f"{value:.3g} %" for value in 100.0 * part[variable].values)))
    at_45 = []
    for name, rank, number in (("example2", 1, 6), ("example3", 2, 8), ("example4", 3, 9)):
        off = 100.0 * float(data["reduced_error_45"].sel(scene=name, reduced_rank=rank))
        at_45.append(f"Figure {number} (r = {rank}, 45 s) is {off:.2g} % off")
    values: dict[str, Any] = {"errors": lines(head, rows), "at_45": ", ".join(at_45)}
    jolted = 100.0 * data["reduced_error"].sel(scene=["example2_out_of_equilibrium", "example2_tauter_start"]).values
    values |= {
        "jolted_least": jolted[:, 0].min(),
        "jolted_most": jolted[:, 0].max(),
        "jolted_last": jolted[:, -1].max(),
    }
    values["jolted_rank"] = int(data["reduced_rank"][-1])
    for name, sign in (("example4", "plus"), ("example4_opposite_load", "minus")):
        values[f"length_{sign}"] = float(data["scene_unstretched_length"].sel(scene=name))
        values[f"tension_{sign}"] = float(data["scene_smallest_tension"].sel(scene=name))
    return Section("Examples 2 to 4", data, values, {"figure9": figures.figure9()})


def three_routes(size: Size, progress: Progress) -> Section:
    """Make the section on SVD, covariance matrix, method of snapshots, and weights (section 5.1)."""
    precision = routes.precision()
    times = routes.run_times(sizes=size.route_sizes, progress=lambda fraction: progress(0.7 * fraction))
    weights = routes.weights()
    rows = []
    for route in precision["route"].values:
        usable = float(precision["route_usable"].sel(route=route))
        seconds = times["route_time"].sel(route=route).values
        rows.append((route, f"{usable:.0e}", *("left out" if np.isnan(t) else f"{1e3 * t:.3g} ms" for t in seconds)))
    sizes = [f"{n} × {m}" for n, m in zip(times["route_features"].values, times["route_samples"].values, strict=True)]
    kinds = []
    for kind in weights["weights"].values:
        part = weights.sel(weights=kind)
        gap, value = float(part["weight_mode_gap"].max()), float(np.abs(part["weight_value_gap"]).max())
        kinds.append((f"`{kind}`", f"{100 * gap:.1f} %", f"{100 * value:.1f} %"))
    values = {
        "routes": lines(("route", "values right to a tenth down to σ/σ1 =", *sizes), rows),
        "most_snapshots": routes.MOST_SNAPSHOTS,
        "weights": lines(("`weights`", "mode", "singular value"), kinds),
    }
    data = xr.merge([precision, times, weights], combine_attrs="override")
    return Section("Three routes", data, values, {"routes": figures.routes(precision, times)})


#: Strain [1] up to which the laws of chain and cable hardly differ.
SMALL_STRAIN = 0.004


def range_of_validity(size: Size, progress: Progress) -> Section:
    """Make the section on the range of validity of the chain's basis."""
    maps = validity.maps(tensions=size.tensions, stiffnesses=size.stiffnesses, progress=progress)
    few, many = (int(maps["validity_rank"].values[i]) for i in (0, -1))
    small = maps["validity_strain"] <= SMALL_STRAIN
    chain, own = maps["validity_basis_error"], maps["validity_own_basis_error"]
    model, control = maps["validity_model_error"].sel(validity_rank=few), maps["validity_own_error"]
    values = {
        "few": few,
        "many": many,
        "small_strain": 100.0 * SMALL_STRAIN,
        "ratio_small": float((chain / own).where(small).max()),
        "model_gap": 100.0 * float((model / control - 1.0).where(small).pipe(np.abs).max()),
        "ratio_large": float((chain / own).max()),
        "basis_few": 100.0 * float(chain.sel(validity_rank=few).max()),
        "basis_many": 100.0 * float(chain.sel(validity_rank=many).max()),
        "model_few": 100.0 * float(model.max()),
        "model_many": 100.0 * float(maps["validity_model_error"].sel(validity_rank=many).max()),
        "model_stiff": 100.0 * float(model.isel(validity_stiffness=-1).max()),
        "law_gap": 100.0 * float(maps["validity_law_gap"].max()),
        "settled": _settled(int((maps["validity_settled"] < 1.0).sum()), maps["validity_settled"].size),
        "omega": float(maps["validity_angular_frequency"]),
    }
    return Section("Range of validity", maps, values, {"validity": figures.validity(maps)})


def _settled(moved: int, cells: int) -> str:
    if moved == 0:
        return f"In none of the {cells} cells does halving the time step move a result."
    return f"In {moved} of {cells} cells, marked by a star, halving the time step still moves the result."


#: Function of each section, and its fraction of the run time.
SECTIONS: tuple[tuple[Callable[[Size, Progress], Section], float], ...] = (
    (table_1, 0.1),
    (table_2, 0.1),
    (which_start, 0.08),
    (example_3, 0.07),
    (reduced_models, 0.12),
    (three_routes, 0.13),
    (range_of_validity, 0.4),
)
