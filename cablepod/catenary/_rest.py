"""Public functions of the elastic catenary: a scene at rest, and arrays of cables."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cablepod import provenance
from cablepod._inputs import SCENE, check_units, taken
from cablepod.catenary._formulas import COLUMNS, FOUND
from cablepod.catenary._piecewise import is_piecewise
from cablepod.catenary._shape import shape
from cablepod.catenary._statics import load_plane, piecewise_statics, solve_statics
from cablepod.catenary._uniform import check_solved, solve_catenaries
from cablepod.conventions import COORDINATES, STILL_AIR, labelled_dataset
from cablepod.errors import SceneError, scene_error, warn
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import Members
from cablepod.parameters._keys import CATENARY_KEYS, exactly_one
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._particles import refuse_own

#: Units of the arguments of :func:`solve` that are no forces.
UNITS = {"span": "m", "rise": "m", "load": "N m-1", "unstretched_length": "m"}


def rest(scene: xr.Dataset, *, points: int = 41) -> xr.Dataset:
    """Compute the equilibrium of a continuous cable in still air by the exact elastic catenary.

    Weight and uniform load act, and the linear law T = K (xi - 1) holds.  If two lengths have the given tension, the
    shorter one is returned.  Loads and positions of the ends are those at time 0.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.
    points
        Number of output points, equally spaced in unstretched arc length, both ends included.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (particle)`` [N] with ``arc_length (particle)`` [m], and the
        scalars ``unstretched_length``, ``stretched_length`` [m], ``horizontal_force``, ``tension_lower``,
        ``tension_upper`` [N].  ``horizontal_force`` is the component across the total load, which is constant.  All are in
        still air, as the attribute ``air`` says: :func:`cablepod.chain.rest` is the cable in the mean wind.

    Raises
    ------
    SceneError
        If no such cable exists, or for fewer than two points.

    Warns
    -----
    UserWarning
        If the scene has point loads, which the catenary omits; :func:`cablepod.chain.rest` includes them.

    Notes
    -----
    The relative error is about 1e-13.  The forces of a taut cable of given length have a relative error of a few
    K/T 2^-53, caused by rounding of the length.  Source: eqs. (7)-(16) of the paper, elastic and with corrected signs.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> rest = cp.catenary.rest(scene)
    >>> round(float(rest.unstretched_length), 3), round(float(rest.tension_lower))
    (61.156, 14434)
    """
    integer(least=2)("points", points)
    scene = taken("scene", scene, SCENE)
    members = list(Members(scene))
    for p in members:
        refuse_own(p, "chain.rest")
    if any(p.point_loads for p in members):
        warn("catenary.rest leaves out the point loads of the scene; use chain.rest to include them")
    solved = [_rest_of_member(p, points) for p in members]
    single = "member" not in scene.dims
    position, tension, arc_length, scalars = (
        arrays[0] if single else np.stack(arrays) for arrays in zip(*solved, strict=True)
    )
    lead = () if single else ("member",)
    result = labelled_dataset(
        {
            "position": ((*lead, "particle", "coordinate"), position),
            "tension": ((*lead, "particle"), tension),
            **{name: (lead, scalars[..., i]) for i, name in enumerate(COLUMNS) if name != "mid_force"},
        },
        {"coordinate": np.array(COORDINATES[: members[0].dims])},
        {"arc_length": ((*lead, "particle"), arc_length)},
    )
    if not single:  # with the units of the scene, words without
        swept = {name: variable for name, variable in scene.variables.items() if variable.dims == ("member",)}
        result = result.assign_coords({name: variable.copy() for name, variable in swept.items()})
    title = f"{scene.attrs.get('title', 'scene')}: continuous cable at rest"
    if any(p.wind is not None for p in members):
        title = f"{title} in {STILL_AIR}"
    result.attrs.update(title=title, stage="rest", air=STILL_AIR)
    return provenance.record(result, function="catenary.rest", parameters={"points": points}, inputs=[scene])


def _rest_of_member(p: Parameters, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions (points, dims) [m], tensions [N] and arc lengths [m] of one cable at rest, and its statics (6,)."""
    if is_piecewise(p):
        solved = piecewise_statics(p, p.length_key, p.length_value)
        s = solved.total * np.linspace(0.0, 1.0, points)
        position, force = solved.at(s)
        return p.initial_ends[0] + position, np.sqrt((force * force).sum(axis=1)), s, solved.columns
    statics = solve_statics(p, p.length_key, p.length_value)
    plane = load_plane(p)
    s = statics[0] * np.linspace(0.0, 1.0, points)
    x, y, tension = shape(s, statics, plane.load, p.stiffness)
    return p.initial_ends[0] + x[:, None] * plane.across + y[:, None] * plane.against, tension, s, statics


def solve(
    span: ArrayLike, rise: ArrayLike, load: ArrayLike, stiffness: ArrayLike, **given: ArrayLike
) -> dict[str, np.ndarray]:
    """Solve many elastic catenaries given as arrays, at about one microsecond each.

    Parameters
    ----------
    span, rise
        Upper end relative to the lower one, across the load (>= 0) and against it [m].
    load
        Load per unstretched length (>= 0) [N/m].
    stiffness
        Axial stiffness K [N].
    **given
        Exactly one of ``top_tension``, ``bottom_tension``, ``horizontal_force`` [N], ``unstretched_length`` [m].

    Returns
    -------
    dict
        Arrays of the broadcast shape of all arguments: ``unstretched_length``, ``stretched_length`` [m],
        ``horizontal_force``, ``mid_force`` (force against the load at the middle of the unstretched length),
        ``tension_lower``, ``tension_upper`` [N].

    Raises
    ------
    SceneError
        If one cable has no solution.  The message names its index and the reason, for instance the least tension.  For arrays
        of different shapes, and what is no number or in other units.

    Examples
    --------
    >>> from cablepod import catenary
    >>> cables = catenary.solve(20.4, 57.7, 9.8125, 2e7, top_tension=[7500.0, 15000.0])
    >>> cables["unstretched_length"].round(3).tolist()
    [61.18, 61.156]
    """
    key = exactly_one("given", given, CATENARY_KEYS)
    if len(given) > 1:
        raise SceneError(f"{', '.join(given)}: unknown key; allowed: exactly one of {', '.join(CATENARY_KEYS)}")
    arrays = _broadcast({"span": span, "rise": rise, "load": load, "stiffness": stiffness, key: given[key]})
    a, b, q, k, value = (np.ascontiguousarray(x).ravel() for x in arrays)
    plane = a, b, np.hypot(a, b), q
    solutions, status = solve_catenaries(plane, k, key, value)
    failed = status != FOUND
    if failed.any():
        i = int(np.argmax(failed))
        numbers = [float(array[i]) for array in (*plane, k, value)]
        check_solved(int(status[i]), numbers[:4], numbers[4], key, numbers[5], name=f"{key}[{i}]")
    return {name: solutions[:, column].reshape(arrays[0].shape) for column, name in enumerate(COLUMNS)}


def _broadcast(given: dict[str, Any]) -> tuple[np.ndarray, ...]:
    """Return numbers by name as floats of a common shape; refuse others, and those that are labelled with other units."""
    arrays = []
    for name, value in given.items():
        check_units(name, value, UNITS.get(name, "N"))
        array = np.asarray(value)
        if array.dtype.kind not in "fiu":  # texts, dates and truth values, which numpy would convert
            raise scene_error(name, value, "numbers")
        arrays.append(array.astype(float))
    try:
        return np.broadcast_arrays(*arrays)
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(given, arrays, strict=True))
        raise SceneError(
            f"{', '.join(given)}: given the shapes {shapes}; allowed: one shape, or single numbers"
        ) from None
