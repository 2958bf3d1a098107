"""Draw Figures 4 to 9 of the paper and the figures of the report; nothing is saved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from cablepod import catenary, chain, galerkin, plots
from cablepod.examples import scene
from cablepod.paper.examples import INSTANTS, STARTS, Study, study
from cablepod.pod._snapshots import relative_arc_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def _panels(
    count: int, title: str, *, rows: int = 1, height: float = 4.2, width: float = 6.2
) -> tuple[Figure, np.ndarray]:
    from matplotlib import pyplot as plt  # slow to import

    figure, axes = plt.subplots(
        rows, count, figsize=(width * count, height * rows), layout="constrained", squeeze=False
    )
    figure.suptitle(title)
    return figure, axes


def figure4() -> Figure:
    """Draw the guy of Example 1 at rest as catenary and chain, and its sag."""
    guy = scene("example1")
    exact, particles = catenary.rest(guy, points=201), chain.rest(guy)
    figure, axes = _panels(2, "Figure 4: the guy at rest, T1 = 1875 N (Example 1)")
    plots.rest(exact, particles, ax=axes[0, 0])
    axes[0, 0].set_title("to different scales in x and y")
    right = axes[0, 1]
    dots = {"color": plots.COLOURS[0], "linestyle": "none", "marker": "o", "markersize": 3.5}
    for run, style in ((exact, {"color": plots.COLOURS[3]}), (particles, dots)):
        right.plot(relative_arc_length(run), _sag(run), **style)
    right.set(xlabel=plots.SIGMA, ylabel="deflection normal to the chord [m]", title="its sag")
    right.grid(alpha=0.3)
    return figure


def _sag(at_rest: xr.Dataset) -> np.ndarray:
    position = at_rest["position"].values
    chord = position[-1] - position[0]
    return (position - position[0]) @ np.array([-chord[1], chord[0]]) / np.hypot(*chord)


def figure5() -> Figure:
    """Draw the first three modes of the lifted x of Example 2, from two initial shapes."""
    figure, axes = _panels(2, r"Figure 5: the first three modes of $\hat x$, Example 2")
    for ax, name, title in (
        (axes[0, 0], "example2", "from equilibrium"),
        (axes[0, 1], "example2_tauter_start", "from the shape of a tauter cable, as in Table 2"),
    ):
        modes = study(name).modes
        plots.modes(modes.sel(coordinate="x", drop=True), ax=ax)
        ax.set_title(title)
    return figure


def _draw_run(base: Study, rank: int, times: list[float], figure: Figure, axes: np.ndarray) -> None:
    """Draw chain and reduced cable as in the paper, and by their deflection."""
    reduced = galerkin.simulate(base.scene, base.modes, rank=rank)
    plots.shapes(base.chain, reduced, times=times, ax=axes[0])
    plots.shapes(base.chain, reduced, times=times, deflection=True, ax=axes[1])
    axes[0].set_title("as in the paper (x and y to different scales)")
    axes[1].set_title("the same by its deflection from the chord")
    axes[0].get_legend().remove()  # both panels have one


def figure6() -> Figure:
    """Draw Example 2 with one mode at 45 s (text) and 15 s (caption)."""
    figure, axes = _panels(2, "Figure 6: Example 2, r = 1; the text says 45 s, the caption 15 s")
    _draw_run(study("example2"), 1, [15.0, 45.0], figure, axes[0])
    return figure


def figure7() -> Figure:
    """Draw Example 3 at six instants with two modes."""
    figure, axes = _panels(2, "Figure 7: Example 3, six instants, r = 2")
    _draw_run(study("example3"), 2, list(INSTANTS), figure, axes[0])
    return figure


def figure8() -> Figure:
    """Draw Example 3 at 45 s with two modes."""
    figure, axes = _panels(2, "Figure 8: Example 3 at 45 s, r = 2")
    _draw_run(study("example3"), 2, [45.0], figure, axes[0])
    return figure


def figure9() -> Figure:
    """Draw Example 4 at 45 s with three modes, for both signs of the load."""
    figure, axes = _panels(2, "Figure 9: Example 4 at 45 s, r = 3, for both signs of the horizontal load", rows=2)
    for row, name, sign in ((0, "example4", "+x"), (1, "example4_opposite_load", "-x")):
        _draw_run(study(name), 3, [45.0], figure, axes[row])
        axes[row, 0].set_title(f"load towards {sign} (x and y to different scales)")
    return figure


def singular_values(table2: xr.Dataset) -> Figure:
    """Draw the printed Table 2 and the singular values from several initial shapes."""
    figure, axes = _panels(2, "Table 2: singular values of Example 2, print and ours")
    starts = [str(name) for name in table2["start"].values if table2["table2_misfit_3"].sel(start=name) < 5.0]
    rows = table2["table2_row"].values
    for ax, axis in zip(axes[0], ("x", "y"), strict=True):
        ax.plot(
            rows,
            table2["table2_singular_value_printed"].sel(coordinate=axis),
            color=plots.COLOURS[0],
            linestyle="none",
            marker="x",
            markersize=9,
            label="print",
        )
        for i, name in enumerate(starts, start=1):
            values = table2["table2_singular_value"].sel(start=name, coordinate=axis)
            style = {
                "color": plots.COLOURS[(0, 1, 3, 5)[i]],
                "linestyle": plots.LINES[i - 1],
                "marker": plots.MARKERS[i],
                "fillstyle": "none",
            }
            ax.plot(rows, values, label=STARTS[name], **style)
        ax.set(xlabel="number of the mode [1]", ylabel="singular value [m]", yscale="log", title=rf"$\hat {axis}$")
        ax.set_xticks(rows)
        ax.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8)
    return figure


def routes(precision: xr.Dataset, run_times: xr.Dataset | None) -> Figure:
    """Draw accuracy and run time of each route to the modes."""
    figure, axes = _panels(3, "Three routes to the modes", width=5.2)
    exact = precision["route_exact"].values
    for i, method in enumerate(precision["route"].values):
        style = {
            "color": plots.COLOURS[i],
            "linestyle": plots.LINES[i],
            "marker": plots.MARKERS[i],
            "markevery": 8,
            "markersize": 4,
        }
        for ax, name in ((axes[0, 0], "route_error"), (axes[0, 1], "route_angle")):
            ax.plot(exact, np.maximum(precision[name].sel(route=method), 1e-17), label=str(method), **style)
        if run_times is not None:
            style["markevery"] = 1
            seconds = run_times["route_time"].sel(route=method)
            axes[0, 2].plot(run_times["route_samples"], 1e3 * seconds, label=str(method), **style)
    labels = ("relative error of the singular value [1]", "sine of the angle to the exact mode [1]")
    for ax, label in zip(axes[0], labels, strict=False):
        ax.set(
            xscale="log",
            yscale="log",
            xlabel="exact singular value / largest, falling [1]",
            ylabel=label,
            ylim=(1e-17, 1e6),
        )
        ax.invert_xaxis()
    axes[0, 1].set_ylim(1e-17, 10.0)
    axes[0, 2].set(
        xscale="log", yscale="log", xlabel="snapshots m (n = 39 at 125, else 80) [1]", ylabel="time, one thread [ms]"
    )
    for ax in axes[0]:
        ax.grid(alpha=0.3)
        ax.legend()
    return figure


def validity(maps: xr.Dataset) -> Figure:
    """Draw error maps of the chain's basis over pretension and stiffness."""
    few, many = (int(maps["validity_rank"].values[i]) for i in (0, -1))
    omega = float(maps["validity_angular_frequency"])
    strain = maps["validity_strain"].transpose("validity_stiffness", "validity_tension").values
    ratio = _at(maps, "validity_basis_error", many) / _at(maps, "validity_own_basis_error", many)
    law = maps["validity_law_gap"].transpose("validity_stiffness", "validity_tension").values
    title = f"Modes of the elastic chain on the extensible cable, end motion of {omega:g} rad/s: error / largest displacement"
    figure, axes = _panels(2, title, rows=3, height=3.2, width=5.6)
    for column, rank in enumerate((few, many)):
        model, basis = (_at(maps, f"validity_{name}_error", rank) for name in ("model", "basis"))
        _map(axes[0, column], maps, model, _percent(model), f"reduced model on the chain's modes, r = {rank}")
        _map(axes[1, column], maps, basis, _percent(basis), f"projection on the chain's modes, r = {rank}")
    _map(axes[2, 0], maps, law, _percent(law), "distance of chain (linear law) and cable, law (21)")
    texts = np.array([f"{value:.3g}\n({100 * e:.2g} %)" for value, e in zip(ratio.flat, strain.flat, strict=True)])
    last = f"projection error, chain's over own modes, r = {many} (strain)"
    _map(axes[2, 1], maps, ratio, texts.reshape(ratio.shape), last, limits=(1.0, 100.0))
    return figure


def _at(maps: xr.Dataset, name: str, rank: int) -> np.ndarray:
    return maps[name].sel(validity_rank=rank).transpose("validity_stiffness", "validity_tension").values


def _percent(values: np.ndarray) -> np.ndarray:
    return np.array([f"{100 * value:.2g} %" for value in values.flat]).reshape(values.shape)


def _map(
    ax: Axes,
    maps: xr.Dataset,
    values: np.ndarray,
    texts: np.ndarray,
    title: str,
    *,
    limits: tuple[float, float] = (1e-5, 1.0),
) -> None:
    """Draw a map on a logarithmic colour scale, with a text in each cell."""
    from matplotlib.colors import LogNorm

    ax.imshow(values, origin="lower", aspect="auto", cmap="cividis", norm=LogNorm(*limits, clip=True))
    settled = maps["validity_settled"].transpose("validity_stiffness", "validity_tension").values
    for (row, column), value in np.ndenumerate(values):
        dark = np.log10(max(value, limits[0]) / limits[0]) / np.log10(limits[1] / limits[0]) < 0.55
        text, mark = str(texts[row, column]), "" if settled[row, column] else "*"
        ax.text(column, row, text + mark, ha="center", va="center", fontsize=9, color="white" if dark else "black")
    tensions, stiffnesses = maps["validity_tension"].values, maps["validity_stiffness"].values
    ax.set_xticks(range(tensions.size), [f"{t / 1e3:g}" for t in tensions])
    ax.set_yticks(range(stiffnesses.size), [f"{k:.0e}".replace("e+0", "e") for k in stiffnesses])
    ax.set(xlabel="top tension T1 [kN]", ylabel="stiffness K [N]", title=title)
    ax.title.set_fontsize(10)
