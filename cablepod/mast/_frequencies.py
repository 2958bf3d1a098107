"""Public function: frequencies of a mast and its guys."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import no_plan, over_members_by
from cablepod.errors import OutOfRangeWarning, scene_error, warn
from cablepod.mast._chain_modes import guy_modes
from cablepod.mast._chain_run import ChainGuys, links_of
from cablepod.mast._condensed_run import guys_in_mean_wind
from cablepod.mast._model import lowest_vibrations, modal_mast, with_guys
from cablepod.mast._output import dataset, spatial
from cablepod.mast._piecewise_guys import KINDS, kind_of_guys, refuse_things
from cablepod.mast._statics import check_shapes, rest_in
from cablepod.parameters._checks import choice, integer
from cablepod.parameters._mast import mast_parameters
from cablepod.scene._mast import MAST_SCENE
from cablepod.scene._mast_notes import warn_of_unusual_mast, warn_of_unusual_mast_members
from cablepod.wind._mast_air import mean_mast_air
from cablepod.wind._profile import air_at_rest


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
    OutOfRangeWarning
        For condensed guys so slack that they do not hold the mast; the frequencies that they lack are nan.

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

    count, rank = integer(least=1, most=10**4)("count", count), integer(least=1, most=60)("rank", rank)
    p = mast_parameters(scene)
    guys = kind_of_guys(p) if guys is None else choice(*KINDS)("guys", guys)
    if guys == "condensed":
        refuse_things(p, guys)
    air = mean_mast_air(p)
    at_rest = rest_in(p, air)
    warn_of_unusual_mast(p, at_rest.tension)
    beam, mast = at_rest.beam, modal_mast(at_rest)
    if guys == "catenary" or not p.guys:
        mass, stiffness, end_mass = mast.mass_with_guys, at_rest.stiffness, mast.guy_masses[:, None, None] * np.eye(2)
    else:
        check_shapes(at_rest)
        model: Any = (
            guy_modes(ChainGuys(mast, links_of(p), air), 2 * rank) if guys == "chain" else guys_in_mean_wind(mast, rank)
        )
        end_mass = model.end_mass
        mass, stiffness = with_guys(at_rest.rows, beam.mass, at_rest.mast_stiffness, end_mass, model.tangents)
    if count > len(mass):
        raise scene_error("count", count, f"at most {len(mass)}, the number of unknowns")
    try:
        omega, vectors = lowest_vibrations(stiffness, mass, count)
    except np.linalg.LinAlgError:
        squared, vectors = eigh(stiffness, mass, subset_by_index=[0, count - 1])
        omega = np.sqrt(np.where(squared > 0.0, squared, np.nan))
        warn(
            f'with guys of kind "{guys}" the mast is not stable at rest, as slack guys resist compression: '
            f'{np.isnan(omega).sum()} of the frequencies are not known; try guys="chain"',
            OutOfRangeWarning,
        )
    of_mast, of_guys = np.split(vectors, [beam.count])
    shapes = np.einsum("nda,am->mnd", beam.all_rows, of_mast)
    share = np.einsum("am,ab,bm->m", of_mast, beam.mass, of_mast)
    flat = shapes.reshape(count, -1)
    largest = flat[np.arange(count), np.abs(flat).argmax(axis=1)]
    variables: dict[str, Any] = {
        "angular_frequency": (("mode",), omega),
        "mode_shape": (
            ("mode", "node", "coordinate"),
            spatial(shapes / np.where(largest == 0.0, 1.0, largest)[:, None, None]),
        ),
        "mast_share": (("mode",), share),
    }
    if p.guys:
        ends = np.einsum("gia,am->gim", at_rest.rows, of_mast)
        own = np.einsum("gim,gij,gjm->mg", ends, end_mass, ends)
        own += (of_guys.reshape(len(p.guys), -1, count) ** 2).sum(axis=1).T
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
