"""Public function: the summary of a scene, of a cable or of a mast."""

from __future__ import annotations

import xarray as xr

from cablepod import cable, mast


def summary(scene: xr.Dataset) -> xr.Dataset:
    """Summarise a scene: static numbers, first frequencies, and notes on what is unusual.

    Parameters
    ----------
    scene
        A scene, of a cable or of a mast, with or without ``member``; it needs neither ``[time]`` nor ``[chain]``.

    Returns
    -------
    xarray.Dataset
        The numbers of :func:`cablepod.cable.summary`, or of :func:`cablepod.mast.summary` for a scene with ``[mast]``; ``note``
        is a text with a line for each note, empty for a usual scene.

    Raises
    ------
    SceneError
        For a scene without equilibrium.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> numbers = cp.summary(examples.scene("example2"))
    >>> round(float(numbers.stress) / 1e6), numbers.frequency_in_plane.values.round(2).tolist(), str(numbers.note.values)
    (120, [1.0, 1.98, 2.97], '')
    >>> round(float(cp.summary(examples.scene("mast30")).buckling_factor), 2)
    3.26
    """
    if isinstance(scene, xr.Dataset) and "mast_height" in scene.variables:
        return mast.summary(scene)
    return cable.summary(scene)
