"""Check a scene Dataset as a whole."""

from __future__ import annotations

import xarray as xr

from cablepod.errors import SceneError
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._mast import mast_parameters
from cablepod.scene._limits import check_numbers, check_times
from cablepod.scene._mast import check_mast_numbers
from cablepod.scene._notes import likely_keys, remedy


def check_scene(scene: xr.Dataset) -> None:
    """Check a scene Dataset, of a cable or of a mast: which keys go together, and its numbers.

    Raises
    ------
    SceneError
        For a scene that cannot be simulated; the message names the key, the given value and the allowed ones, and the key of a
        cable that was likely given in another unit.
    """
    if "mast_height" in scene:
        mast = mast_parameters(scene)
        check_times(mast.duration, mast.interval)
        check_mast_numbers(mast)
        return
    p = parameters(scene)
    check_times(p.duration, p.interval)
    try:
        check_numbers(p)
    except SceneError as error:
        error.args = (f"{error}{remedy(likely_keys(p))}",)
        raise
