"""The continuous elastic cable at rest (theory of section 3 of the paper, exact): scene -> scene at rest."""

from __future__ import annotations

import math
import warnings

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cablepod import provenance
from cablepod.catenary._statics import kind_of, load_plane, solve_statics
from cablepod.conventions import COORDINATES, label
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import parameters_of_members
from cablepod.parameters._keys import LENGTH_KEYS, exactly_one
from cablepod.parameters._parameters import Parameters


def rest(scene: xr.Dataset, *, points: int = 41) -> xr.Dataset:
    """Compute the continuous cable at rest under its weight and uniform load, by the exact elastic catenary.

    The linear law T = K (xi - 1) holds.  Where two lengths have the given tension, the shorter is meant.  A load that
    varies in time acts with its value at time 0; the ends stand where they stand then.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.
    points
        Number of equally spaced unstretched arc lengths at which the shape is given, both ends included.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (particle)`` [N] with ``arc_length (particle)`` [m], and the
        scalars ``unstretched_length``, ``stretched_length`` [m], ``horizontal_force``, ``tension_lower``,
        ``tension_upper`` [N].  ``horizontal_force`` is the component across the total load, which is constant.

    Raises
    ------
    SceneError
        Where no such cable exists, and for fewer than two points.

    Warns
    -----
    UserWarning
        Where the scene has point loads, which the catenary leaves out; :func:`cablepod.chain.rest` has them.

    Notes
    -----
    Right to about 1e-13 relative, and to a few K/T 2^-53 in the forces of a taut cable whose length is given, which is
    what rounding the length does to them.  Source: eqs. (7)-(16) of the paper, elastic and with the signs repaired.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> rest = cp.catenary.rest(scene)
    >>> round(float(rest.unstretched_length), 3), round(float(rest.tension_lower))
    (61.156, 14434)
    """
    integer(least=2)("points", points)
    members = parameters_of_members(scene)
    if any(p.point_loads for p in members):
        warnings.warn(
            "catenary.rest leaves out the point loads of the scene; see chain.rest, which has them",
            UserWarning,
            stacklevel=2,
        )
    solved = [_one(p, points) for p in members]
    single = "member" not in scene.dims
    stack = [item[0] if single else np.stack(item) for item in zip(*solved, strict=True)]
    position, tension, arc_length, scalars = stack
    lead = () if single else ("member",)
    names = (
        "unstretched_length",
        "stretched_length",
        "horizontal_force",
        "mid_force",
        "tension_lower",
        "tension_upper",
    )
    result = xr.Dataset(
        {
            "position": ((*lead, "particle", "coordinate"), position),
            "tension": ((*lead, "particle"), tension),
            **{name: (lead, scalars[..., i]) for i, name in enumerate(names) if name != "mid_force"},
        },
        coords={
            "arc_length": ((*lead, "particle"), arc_length),
            "coordinate": list(COORDINATES[: members[0].dims]),
        },
    )
    if not single:
        varied = {name: v for name, v in scene.variables.items() if v.dims == ("member",)}
        result = result.assign_coords({name: v.copy() for name, v in varied.items()})
    label(result)
    result.attrs.update(title=f"{scene.attrs.get('title', 'scene')}: continuous cable at rest", stage="rest")
    options = {"points": points} | ({} if single else {"unstretched_lengths": scalars[..., 0]})
    return provenance.record(result, function="catenary.rest", parameters=options, inputs=[scene])


def _one(p: Parameters, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    from cablepod.catenary import _kernels_shape as kernel  # numba is imported only to compute

    solution = solve_statics(p, p.length_key, p.length_value)
    _, _, _, q, across, against = load_plane(p)
    s = solution[0] * np.linspace(0.0, 1.0, points)
    x, y, tension = np.empty(points), np.empty(points), np.empty(points)
    kernel.shape(s, solution, q, p.stiffness, x, y, tension)
    lower = p.end_positions(np.zeros(1))[0, 0]
    return lower + x[:, None] * across + y[:, None] * against, tension, s, solution


def solve(
    span: ArrayLike, rise: ArrayLike, load: ArrayLike, stiffness: ArrayLike, **given: ArrayLike
) -> dict[str, np.ndarray]:
    """Solve many elastic catenaries at array level, about a microsecond each.

    Parameters
    ----------
    span, rise
        Of the upper end from the lower one, across the load (>= 0) and against it [m].
    load
        Load per unstretched length (>= 0) [N/m].
    stiffness
        Axial stiffness K [N].
    **given
        Exactly one of ``top_tension``, ``bottom_tension``, ``horizontal_force`` [N], ``unstretched_length`` [m].

    Returns
    -------
    dict
        Arrays of the common shape of all arguments: ``unstretched_length``, ``stretched_length`` [m], ``horizontal_force``,
        ``mid_force`` (force against the load at the middle of the unstretched length), ``tension_lower``,
        ``tension_upper`` [N].

    Raises
    ------
    SceneError
        Where one of them has no solution; the message says which, and the least tension where that is the reason.

    Examples
    --------
    >>> from cablepod import catenary
    >>> cables = catenary.solve(20.4, 57.7, 9.8125, 2e7, top_tension=[7500.0, 15000.0])
    >>> cables["unstretched_length"].round(3).tolist()
    [61.18, 61.156]
    """
    from cablepod.catenary import _kernels_solve as kernel  # numba is imported only to compute

    key = exactly_one("given", given, LENGTH_KEYS)
    if len(given) > 1:
        raise SceneError(f"{', '.join(given)}: unknown key; allowed: exactly one of {', '.join(LENGTH_KEYS)}")
    arrays = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (span, rise, load, stiffness, given[key])))
    a, b, q, k, value = (np.ascontiguousarray(x).ravel() for x in arrays)
    out, status = np.empty((a.size, 6)), np.empty(a.size, dtype=np.int64)
    kind = kind_of(key)
    kernel.solve_many(a, b, np.hypot(a, b), q, k, kind, value, out, status)
    if (status != kernel.FOUND).any():
        i = int(np.argmax(status != kernel.FOUND))
        reason = "a combination for which there is a cable"
        if status[i] == kernel.BELOW_LEAST_TENSION:
            sign = 1.0 if kind == kernel.UPPER_TENSION else -1.0
            least = kernel.least_tension(a[i], b[i], math.hypot(a[i], b[i]), q[i], k[i], sign)
            reason = f"at least {max(least, 0.0):.6g} N"
        elif status[i] == kernel.SLACK_WEIGHTLESS:
            reason = "at most the chord, because a slack cable without load has no shape at rest"
        raise scene_error(f"{key}[{i}]", float(value[i]), reason)
    return {name: out[:, column].reshape(arrays[0].shape) for column, name in enumerate(kernel.COLUMNS)}
