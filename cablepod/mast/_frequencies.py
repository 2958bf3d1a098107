"""Public function: frequencies of a mast and its guys."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import no_plan, over_members_by
from cablepod.errors import scene_error
from cablepod.mast._chain_modes import guy_modes
from cablepod.mast._chain_run import ChainGuys, links_of
from cablepod.mast._condensed_guy import sines
from cablepod.mast._condensed_run import CondensedGuys
from cablepod.mast._model import ModalMast, with_guys
from cablepod.mast._output import dataset, spatial
from cablepod.mast._piecewise_guys import kind_of_guys, mass_at_mast, refuse_things
from cablepod.mast._statics import rest_in
from cablepod.parameters._checks import choice, integer
from cablepod.parameters._mast import mast_parameters
from cablepod.scene._mast import MAST_SCENE
from cablepod.scene._mast_notes import warn_of_unusual_mast, warn_of_unusual_mast_members
from cablepod.wind._mast_air import mean_mast_air
from cablepod.wind._profile import air_at_rest

#: Kinds of guys: with their own motion, as reduced models or as chains; as springs.
KINDS = ("condensed", "chain", "catenary")


@over_members_by(no_plan, warn_of_unusual_mast_members, kind=MAST_SCENE)
def frequencies(scene: xr.Dataset, *, count: int = 10, guys: str | None = None, rank: int = 8) -> xr.Dataset:
    """Compute the lowest frequencies of mast and guys about rest in the mean wind of the scene, without damping.

    Parameters
    ----------
    scene
        Scene with a mast.
    count
        Number of frequencies.
    guys
        "condensed", the default: with the motion of the guys, by `rank` sines of each deflection; "chain": the same by twice as
        many modes of a chain of as many links as the scene has, with segments and attachments, and the default where a guy has
        them; "catenary": springs of the static stiffness, with a third of the mass of each guy at the mast, as practice has them.
    rank
        Number of sines; half of the number of modes.

    Returns
    -------
    xarray.Dataset
        ``angular_frequency (mode)`` [rad/s], ``mode_shape (mode, node, coordinate)`` of the mast, ``mast_share (mode)`` and
        ``guy_share (mode, guy)`` of the kinetic energy, which tell modes of the mast from those of guys.

    Raises
    ------
    SceneError
        For invalid options, condensed guys with segments or attachments, and as :func:`rest`.

    Warns
    -----
    UnusualSceneWarning
        As :func:`rest`.

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
    p = mast_parameters(scene)
    guys = kind_of_guys(p) if guys is None else choice(*KINDS)("guys", guys)
    if guys == "condensed":
        refuse_things(p, guys)
    air = mean_mast_air(p)
    at_rest = rest_in(p, air)
    warn_of_unusual_mast(p, at_rest.tension)
    n, r2 = at_rest.beam.count, 0
    thirds = [mass_at_mast(guy.p, guy.length) for guy in at_rest.bare]
    if guys == "catenary" or not p.guys:
        stiffness, mass = at_rest.stiffness, at_rest.beam.mass.copy()
        for row, third in zip(at_rest.rows, thirds, strict=True):
            mass += third * row.T @ row
    else:
        if guys == "condensed":
            model: Any = CondensedGuys(ModalMast(at_rest), (sines(rank),) * 2, air)
        else:
            model = guy_modes(ChainGuys(ModalMast(at_rest), links_of(p), air), 2 * rank)
        r2 = model.tangents.shape[1] - 2
        of_mast = at_rest.rows, at_rest.beam.mass, at_rest.mast_stiffness
        mass, stiffness = with_guys(*of_mast, model.end_mass, model.tangents)
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
                own[:, g] = thirds[g] * (ends**2).sum(axis=1)
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
