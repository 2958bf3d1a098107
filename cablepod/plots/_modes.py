"""Draw modes, singular values and amplitudes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from cablepod.parameters._checks import integer
from cablepod.plots import _style
from cablepod.plots._style import MARKS, MODES, SIGMA

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def modes(modes: xr.Dataset, *, count: int = 3, ax: Axes | None = None) -> Axes:
    """Draw mode shapes against S / L0 (figure 5 of the paper).

    Parameters
    ----------
    modes
        Result of ``pod.decompose``, of any layout.
    count
        Maximum number of modes, from the first.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: a colour and marker for each mode, a line style for each coordinate
        (solid x, dashed y, dotted z).  The legend says where modes come in the order of their energy.

    Raises
    ------
    SceneError
        For a Dataset without modes.
    """
    shape = _style.take("modes", modes, "mode_shape", ("particle", "mode"), MODES, more=1)
    ax = _by_mode(ax, _style.sigma("modes", modes), shape, count)
    ax.set(xlabel=SIGMA, ylabel="mode shape, of unit norm [1]")
    of_energy = "singular_value" in modes.variables  # the others come by frequency
    return _style.finish(ax, title="by falling energy\nof the snapshots" if of_energy else None)


def singular_values(modes: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the singular values [m] over the mode number, on a logarithmic axis.

    Parameters
    ----------
    modes
        Result of ``pod.decompose``, of any layout.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: a curve for each coordinate that has modes of its own.  Zeros are left out.

    Raises
    ------
    SceneError
        For a Dataset without singular values.
    """
    values = _style.take("modes", modes, "singular_value", ("mode",), MODES, more=1)
    ax = _style.axes(ax)
    for i, (name, part) in enumerate(_style.sets(values, 1)):
        # every mode is marked
        _style.log(ax, _style.numbers(values), part, name or "all modes", _style.style(i, i, MARKS))
    ax.locator_params(axis="x", integer=True, min_n_ticks=1)
    ax.set(xlabel="number of the mode [1]", ylabel="singular value [m]", yscale="log")
    return _style.finish(ax)


def amplitudes(run: xr.Dataset, *, count: int = 3, ax: Axes | None = None) -> Axes:
    """Draw the amplitudes of the first modes [m] over time.

    Parameters
    ----------
    run
        What a reduced model or ``pod.project`` gives.
    count
        Maximum number of modes, from the first.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: a colour and marker for each mode, a line style for each coordinate that has modes of its own.

    Raises
    ------
    SceneError
        For a Dataset without amplitudes.
    """
    amplitude = _style.take(
        "run", run, "amplitude", ("time", "mode"), "what a reduced model or pod.project gives", more=1
    )
    ax = _by_mode(ax, amplitude["time"].values, amplitude, count)
    ax.set(xlabel="time [s]", ylabel="amplitude [m]")
    return _style.finish(ax)


def _by_mode(ax: Axes | None, across: np.ndarray, array: xr.DataArray, count: int) -> Axes:
    """Draw the first `count` modes of each set of an array (..., points, mode)."""
    integer(least=1)("count", count)
    ax = _style.axes(ax)
    for j, (name, part) in enumerate(_style.sets(array, 2)):
        for i, number in enumerate(_style.numbers(array)[:count]):
            label = f"{name}, mode {number}" if name else f"mode {number}"
            ax.plot(across, part[:, i], label=label, **_style.style(i, j, across.size))
    return ax
