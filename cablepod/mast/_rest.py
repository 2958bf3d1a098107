"""Public function: a mast and its guys at rest."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import no_plan, over_members_by
from cablepod.conventions import ENDS
from cablepod.errors import SceneError
from cablepod.mast._beam import slopes_of, warn_of_slopes
from cablepod.mast._output import check_levels, dataset, nodes_of
from cablepod.mast._sections import foot_force, spatial
from cablepod.mast._statics import rest_in
from cablepod.parameters._mast import MastParameters, mast_parameters
from cablepod.scene._mast import MAST_SCENE
from cablepod.scene._mast_notes import warn_of_unusual_mast, warn_of_unusual_mast_members
from cablepod.wind._mast_air import mean_mast_air
from cablepod.wind._profile import air_at_rest


def _check_members(scene: xr.Dataset) -> None:
    """Refuse members of other levels, and warn of unusual ones."""
    check_levels(scene, ("displacement",))
    warn_of_unusual_mast_members(scene)


@over_members_by(no_plan, _check_members, kind=MAST_SCENE)
def rest(scene: xr.Dataset) -> xr.Dataset:
    """Compute the equilibrium of a mast and its guys under weight, ice, loads at time 0 and mean wind.

    Parameters
    ----------
    scene
        Scene with a mast.

    Returns
    -------
    xarray.Dataset
        ``displacement (level, coordinate)`` [m], ``guy_tension``, ``guy_tension_anchor (guy)`` [N], ``guy_force (guy,
        coordinate)`` [N], ``guy_length (guy)`` [m, unstretched], ``bending_moment (node, coordinate)`` [N m], ``shear_force
        (element, end, coordinate)`` [N], ``axial_force (node)`` [N, compression, mean of both sides], ``axial_compression
        (element)`` [N, at its lower end], ``foot_force (coordinate)`` and ``anchor_force (guy, coordinate)`` [N] on the
        foundations, ``buckling_factor`` of the mast with all guys, and where some break ``buckling_factor_after_break`` of the
        mast without these.

    Raises
    ------
    SceneError
        For a mast that buckles under its weight and guys (with the critical factor), guys that do not hold it, no equilibrium.

    Warns
    -----
    OutOfRangeWarning
        For slopes of the mast above a tenth: its equations hold for small slopes.
    UnusualSceneWarning
        Of the worst that :func:`summary` notes of units.

    Notes
    -----
    The unstretched lengths follow from the given tensions on the straight, unloaded mast in still air without ice.  Guys are
    exact elastic catenaries; the mean drag on a guy is a uniform load with the same sag, and forces at the ends with the rest
    of its sum and moment.  The mast is a beam-column with consistent geometric stiffness.  Newton's method finds their common
    equilibrium.

    Examples
    --------
    >>> import cablepod as cp
    >>> scene = cp.read_scene("data/scenes/mast30.toml")
    >>> rest = cp.mast.rest(scene)
    >>> rest.guy_tension.values.round(6).tolist(), rest.guy_tension.units
    ([5000.0, 5000.0, 5000.0], 'N')
    """
    p = mast_parameters(scene)
    air = mean_mast_air(p)
    found = rest_in(p, air)
    warn_of_unusual_mast(p, found.tension)
    beam, levels = found.beam, p.levels
    warn_of_slopes(beam, slopes_of(beam, beam.all_rows @ found.unknowns)[None])
    moved = beam.rows_at(levels) @ found.unknowns
    step = 1e-9 * p.height
    sides = [
        beam.compression(np.clip(beam.height + side, 0.0, p.height * (1.0 - 1e-15)), found.levels, found.pull)
        for side in (-step, step)
    ]
    sides[0][0], sides[1][-1] = sides[1][0], sides[0][-1]
    shear = found.sections[beam.height.size :].reshape(-1, len(ENDS), 2)
    variables: dict[str, Any] = {
        "displacement": (("level", "coordinate"), spatial(moved)),
        "bending_moment": (("node", "coordinate"), spatial(found.sections[: beam.height.size])),
        "shear_force": (("element", "end", "coordinate"), spatial(shear)),
        "axial_compression": (("element",), found.compression),
        "foot_force": (("coordinate",), foot_force(shear, found.compression)),
        "axial_force": (("node",), 0.5 * (sides[0] + sides[1])),
        "buckling_factor": ((), found.buckling_factor),
    }
    if any(guy.breaks is not None for guy in p.guys):
        variables["buckling_factor_after_break"] = ((), _factor_after_break(p))
    if p.guys:
        variables |= {
            "guy_tension": (("guy",), found.tension[:, 1]),
            "guy_tension_anchor": (("guy",), found.tension[:, 0]),
            "guy_force": (("guy", "coordinate"), found.force),
            "anchor_force": (("guy", "coordinate"), found.statics.anchor_forces),
            "guy_length": (("guy",), np.array([guy.length for guy in found.guys])),
            "anchor": (("guy", "coordinate"), np.array([guy.p.lower for guy in found.guys])),
        }
    coords = {"level": levels, **nodes_of(beam)}
    result = dataset(p, variables, coords)
    result.attrs.update(title=f"{scene.attrs.get('title', 'scene')}: rest", stage="mast rest", air=air_at_rest(p))
    return provenance.record(result, function="mast.rest", parameters={}, inputs=[scene])


def _factor_after_break(p: MastParameters) -> float:
    """Return the critical factor of buckling of the mast at rest without the guys that break; nan where it falls."""
    left = replace(p, guys=tuple(guy for guy in p.guys if guy.breaks is None))
    try:
        return rest_in(left, mean_mast_air(left)).buckling_factor
    except SceneError:
        return np.nan
