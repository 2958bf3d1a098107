"""Draw damping ratios over the constant of the damper, over the sag, and over the amplitude."""

from __future__ import annotations

from pathlib import Path

import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

#: Colours of the modes (Okabe and Ito), markers and lines of the constants.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000")
MARKS = ("v", "o", "^")
#: Damping ratio that 10 rho D^2 / m asks for against rain and wind (PTI DC45.1-18), pipe of 0.2 m, 80 kg/m, air of 1.25 kg/m3.
ASKED = 10.0 * 1.25 * 0.2**2 / 80.0


def draw(result: xr.Dataset, place: float, path: Path) -> None:
    """Draw the three panels into a file."""
    figure, axes = plt.subplots(1, 3, figsize=(13.5, 4.3), layout="constrained")
    _over_constants(axes[0], result, place)
    _over_sag(axes[1], result)
    _over_amplitude(axes[2], result)
    for ax in axes:
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _over_constants(ax: Axes, result: xr.Dataset, place: float) -> None:
    c = 1e-3 * result.damper.values
    for n, colour in enumerate(COLOURS):
        ax.plot(c, 100.0 * result.curve_cable.values[:, n], color=colour, label=f"mode {n + 1}")
        ax.plot(c, 100.0 * result.curve_closed_form.values[:, n], color=colour, linestyle=":", linewidth=1.2)
    best = 1e-3 * float(result.constant.sel(place=place))
    ax.axvline(best, color="#888888", linewidth=1)
    ax.text(1.05 * best, 0.02, f"best for five modes\n{best:.0f} kN s/m", fontsize=8, color="#444444", va="bottom")
    ax.axhline(100.0 * ASKED, color="#888888", linewidth=1, linestyle="--")
    ax.text(c[-1], 100.0 * ASKED + 0.01, "rain and wind", fontsize=8, color="#444444", ha="right", va="bottom")
    ax.set(xscale="log", ylim=(0.0, 60.0 * place), xlim=(c[0], c[-1]))
    ax.set_xlabel("constant of the damper c [kN s/m]")
    ax.set_ylabel("damping ratio ζ [%]")
    ax.set_title(f"damper at {100.0 * place:g} % of the stay (dotted: closed form)", fontsize=10)
    ax.legend(fontsize=8, loc="upper right")


def _over_sag(ax: Axes, result: xr.Dataset) -> None:
    sag = result.curve_tension_sag_parameter.values
    for n in range(3):
        cable, with_sag, without = (
            100.0 * result[f"curve_tension_{name}"].values[:, n]
            for name in ("cable", "closed_form", "closed_form_without_sag")
        )
        ax.plot(sag, cable, color=COLOURS[n], label=f"mode {n + 1}")
        ax.plot(sag, with_sag, color=COLOURS[n], linestyle=":", linewidth=1.2)
        ax.plot(sag, without, color=COLOURS[n], linestyle="--", linewidth=0.8)
    ax.set(xscale="log", ylim=(0.0, None), xlim=(sag.min(), sag.max()))
    ax.set_xlabel("Irvine's parameter λ² [1]")
    ax.set_ylabel("damping ratio ζ [%]")
    ax.set_title("sag (dotted: closed form; dashed: without sag)", fontsize=10)
    ax.legend(fontsize=8, loc="lower left")


def _over_amplitude(ax: Axes, result: xr.Dataset) -> None:
    part = result.isel(decay_tension=0)
    start = 100.0 * part.amplitude.values
    for n, mode in enumerate(part.decay_mode.values):
        for factor, mark in zip(part.over_best.values, MARKS, strict=True):
            row = part.sel(decay_mode=mode, over_best=factor)
            change = 100.0 * (row.decay_ratio.values / float(row.small_ratio) - 1.0)
            label = f"mode {mode}, c = {factor:g} T/aω"
            ax.plot(start, change, color=COLOURS[n], marker=mark, markersize=5, label=label, linestyle=("-", "--")[n])
    ax.set(xscale="log")
    ax.set_xticks(start, [f"{value:g}" for value in start])
    ax.minorticks_off()
    ax.set_xlabel("amplitude at the start [% of the chord]")
    ax.set_ylabel("change of the damping ratio [%]")
    ax.set_title(f"amplitude, at {1e-6 * float(part.decay_tension):g} MN", fontsize=10)
    ax.legend(fontsize=8, loc="lower left")
