"""Public function: frequencies of a mast and its guys."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import no_plan, over_members_by
from cablepod.errors import scene_error
from cablepod.mast._condensed_guy import sines
from cablepod.mast._condensed_run import CondensedGuys
from cablepod.mast._model import ModalMast
from cablepod.mast._output import dataset, spatial
from cablepod.mast._statics import rest_in
from cablepod.parameters._checks import choice, integer
from cablepod.parameters._mast import mast_parameters
from cablepod.scene._mast import MAST_SCENE
from cablepod.wind._mast_air import mean_mast_air
from cablepod.wind._profile import air_at_rest

#: Kinds of guys: with their own motion, as springs.
KINDS = ("condensed", "catenary")


@over_members_by(no_plan, kind=MAST_SCENE)
def frequencies(scene: xr.Dataset, *, count: int = 10, guys: str = "condensed", rank: int = 8) -> xr.Dataset:
    """Compute the lowest frequencies of mast and guys about rest in the mean wind of the scene, without damping.

    Parameters
    ----------
    scene
        Scene with a mast.
    count
        Number of frequencies.
    guys
        "condensed": with the motion of the guys, by `rank` sines of each deflection; "catenary": springs of the static stiffness,
        with a third of the mass of each guy at the mast, as practice has them.
    rank
        Number of sines.

    Returns
    -------
    xarray.Dataset
        ``angular_frequency (mode)`` [rad/s], ``mode_shape (mode, node, coordinate)`` of the mast, ``mast_share (mode)`` and
        ``guy_share (mode, guy)`` of the kinetic energy, which tell modes of the mast from those of guys.

    Raises
    ------
    SceneError
        For invalid options, and as :func:`rest`.

    Notes
    -----
    All unknowns of the beam are kept, no modes of it are left out.  The tension of the guys contains that of the mean drag on
    them; the change of the drag with the motion, which damps, is left out.

    Examples
    --------
    >>> import cablepod as cp
    >>> scene = cp.read_scene("data/scenes/mast30.toml")
    >>> found = cp.mast.frequencies(scene, count=4)
    >>> found.angular_frequency.dims, found.angular_frequency.units
    (('mode',), 'rad s-1')
    """
    from scipy.linalg import eigh

    integer(least=1, most=10**4)("count", count)
    integer(least=1, most=60)("rank", rank)
    choice(*KINDS)("guys", guys)
    p = mast_parameters(scene)
    air = mean_mast_air(p)
    at_rest = rest_in(p, air)
    n, r2 = at_rest.beam.count, 2 * rank if guys == "condensed" else 0
    if guys == "condensed":
        model = CondensedGuys(ModalMast(at_rest), (sines(rank),) * 2, air)
        mass, stiffness = model.system(at_rest.rows, at_rest.beam.mass, at_rest.mast_stiffness)
    else:
        stiffness, mass = at_rest.stiffness, at_rest.beam.mass.copy()
        for row, guy in zip(at_rest.rows, at_rest.bare, strict=True):
            mass += guy.p.mass * guy.length / 3.0 * row.T @ row
    if count > len(mass):
        raise scene_error("count", count, f"at most {len(mass)}, the number of unknowns")
    squared, vectors = eigh(stiffness, mass, subset_by_index=[0, count - 1])
    beam = at_rest.beam
    shapes = np.einsum("nda,am->mnd", beam.displacement_rows(np.arange(beam.height.size)), vectors[:n])
    share = np.einsum("am,ab,bm->m", vectors[:n], beam.mass, vectors[:n])
    largest = np.maximum(np.abs(shapes).max(axis=(1, 2)), 1e-300)
    flip = np.sign(
        np.take_along_axis(shapes.reshape(count, -1), np.abs(shapes).reshape(count, -1).argmax(axis=1)[:, None], 1)
    )
    variables: dict[str, Any] = {
        "angular_frequency": (("mode",), np.sqrt(np.maximum(squared, 0.0))),
        "mode_shape": (("mode", "node", "coordinate"), spatial(shapes * (flip / largest[:, None])[:, :, None])),
        "mast_share": (("mode",), share),
    }
    if p.guys:
        own = np.empty((count, len(p.guys)))
        for g, row in enumerate(at_rest.rows):
            ends = np.einsum("ia,am->mi", row, vectors[:n])
            if r2:
                own[:, g] = (vectors[n + r2 * g : n + r2 * (g + 1)] ** 2).sum(axis=0)
                own[:, g] += np.einsum("mi,ij,mj->m", ends, model.end_mass[g], ends)
            else:
                own[:, g] = at_rest.bare[g].p.mass * at_rest.bare[g].length / 3.0 * (ends**2).sum(axis=1)
        variables["guy_share"] = (("mode", "guy"), own)
    coords = {
        "mode": np.arange(1, count + 1),
        "node": np.arange(beam.height.size),
        "node_height": ("node", beam.height),
    }
    result = dataset(p, variables, coords)
    result["mode"].attrs["long_name"] = "number of the mode, from 1, by rising frequency"
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: frequencies",
        stage="mast frequencies",
        guys=guys,
        air=air_at_rest(p),
    )
    return provenance.record(
        result,
        function="mast.frequencies",
        parameters={"count": int(count), "guys": guys, "rank": int(rank)},
        inputs=[scene],
    )
