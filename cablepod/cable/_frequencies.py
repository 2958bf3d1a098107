"""Small vibrations of the continuous cable about equilibrium."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod.batch._members import over_members
from cablepod.cable._air import MeshAir
from cablepod.cable._equilibrium import TooFewElements
from cablepod.cable._mesh import SpectralMesh, check_order, mesh_of
from cablepod.cable._simulate import LAW, counts_of, record
from cablepod.cable._start import start
from cablepod.conventions import label
from cablepod.discretisation._chain import square
from cablepod.discretisation._damped_vibrations import damped_vibrations
from cablepod.discretisation._gll import gll_rule
from cablepod.discretisation._laws import check_law
from cablepod.errors import scene_error
from cablepod.integrate._output import chain_coordinates, law_suffix
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Parameters
from cablepod.wind._air import mean_air_of
from cablepod.wind._profile import air_at_rest

#: Relative tolerance of the frequencies between two numbers of elements.  In wind the profile is linear between points that miss
#: 3e-5 of the deflection: elements converge slowly, towards a drag that is no better.
FREQUENCY_RTOL, FREQUENCY_RTOL_IN_WIND = 1e-8, 1e-5


@over_members
def frequencies(
    scene: xr.Dataset,
    *,
    count: int = 6,
    elements: int | None = None,
    order: int | None = None,
    law: str = LAW,
    points: Any = None,
) -> xr.Dataset:
    """Compute the lowest frequencies and mode shapes of small vibrations about rest, in the mean wind of the scene.

    Of all damping, only that by dampers attached to the cable is taken into account.

    Parameters
    ----------
    scene
        A scene with both ends held, with or without ``member``.  Positions of the ends, loads and mean wind are those at time 0
        (with ``wind.ramp`` that is still air).
    count
        Number of frequencies.
    elements
        Number of elements.  By default it is raised until no frequency changes by more than 1e-8 relative, in wind 1e-5.
    order
        Polynomial order of the elements, 7 by default.
    law
        "green", eq. (21), or "linear", see :func:`cablepod.cable.simulate`.  Those of a taut cable by "green" are higher than
        by "linear", as in :func:`cablepod.summary` and ``cablepod check``, by three quarters of the strain at rest: 0.2 % at a
        strain of 0.27 %.
    points
        Output points of the mode shapes, see :func:`cablepod.cable.simulate`.

    Returns
    -------
    xarray.Dataset
        ``angular_frequency (mode)`` [rad/s] in increasing order, ``mode_shape (mode, particle, coordinate)`` with a mean square
        of 1 over the unstretched length, and ``unstretched_length`` [m].  A planar scene has in-plane modes only.  A spatial
        scene has all modes; ``out_of_plane_share (mode)`` is the fraction of the mean square normal to the plane of chord and
        load (with the mean drag), if there is one plane.

        With dampers, ``angular_frequency`` is abs(lambda) and ``damping_ratio (mode)`` is -Re(lambda) / abs(lambda) of the roots
        lambda with which vibrations go as exp(lambda t): they oscillate with the angular frequency times sqrt(1 - ratio^2).
        Their shapes are complex: ``mode_shape`` is the real part and ``mode_shape_imaginary (mode, particle, coordinate)`` the
        imaginary one, 0 where the shape is largest.  Motions that decay without oscillating are left out.

        The attribute ``space_error_estimate`` is the largest relative change of a frequency, or root, in the last refinement;
        ``air`` says in which air the cable is at rest.

    Raises
    ------
    SceneError
        For invalid options, a free end, or a cable that is not taut in equilibrium.

    Notes
    -----
    Springs to the ground add to the stiffness, masses to the mass; dampers make the eigenvalue problem quadratic.  Without them
    the tangent stiffness in equilibrium is a sum of squares, K = B^T B.  The angular frequencies are therefore the singular
    values of B M^-1/2 with the diagonal mass matrix M.  The rounding error is 1e-16 of the highest frequency, not of its square,
    so that nearly inextensible cables lose no digits.  Mean wind acts by the tension and shape that its drag gives; the change of
    the drag with the motion, which damps, is left out.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> vibrations = cp.cable.frequencies(scene, count=2)
    >>> vibrations.angular_frequency.values.round(3).tolist(), vibrations.angular_frequency.units
    ([6.296, 12.464], 'rad s-1')
    """
    check_law(law)
    integer(least=1)("count", count)
    check_order(order)
    p = parameters(scene)
    if p.free_end is not None:
        raise scene_error(
            "ends.free",
            p.free_end,
            "ends that are held, as the vibrations are about the equilibrium between two held ends",
        )
    mesh, roots, vectors, error = converged_vibrations(p, count, elements, order, law, points)
    shapes = _shapes(mesh, vectors)
    at_particles, dims = mesh.interpolate(shapes), ("mode", "particle", "coordinate")
    variables: dict[str, Any] = {
        "angular_frequency": ("mode", np.abs(roots)),
        "mode_shape": (dims, at_particles.real),
        "unstretched_length": ((), mesh.total_length),
    }
    # where only some members of an ensemble have dampers, all have the variables
    if np.iscomplexobj(roots) or any(re.fullmatch(r"attachment_\d+_damper", str(name)) for name in scene):
        variables["damping_ratio"] = ("mode", np.maximum(-roots.real, 0.0) / np.abs(roots))
        variables["mode_shape_imaginary"] = (dims, at_particles.imag)
    normal = normal_of_plane(p, mesh)
    if normal is not None:
        across = np.abs(np.einsum("mjc,c->mj", shapes, normal)) ** 2
        variables["out_of_plane_share"] = ("mode", across @ mesh.tributary_length / mesh.total_length)
    result = xr.Dataset(variables, coords={"mode": np.arange(1, count + 1), **chain_coordinates(mesh, has_links=False)})
    label(
        result,
        mode=("1", "number of the mode, from 1, by rising frequency"),
        mode_shape=("1", "shape of the vibration, its mean square over the unstretched length 1"),
        mode_shape_imaginary=("1", "imaginary part of the shape of the vibration"),
        damping_ratio=("1", "damping ratio of small vibrations about rest, by the attached dampers"),
    )
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: small vibrations of the continuous cable{law_suffix(mesh)}",
        stage="frequencies",
        air=air_at_rest(p),
        law=law,
        elements=mesh.sizes.size,
        element_order=mesh.order,
        **({} if elements is not None else {"space_error_estimate": error}),
    )
    return record(result, scene, mesh, "cable.frequencies", elements=elements, order=order, points=points, count=count)


def converged_vibrations(
    p: Parameters,
    count: int,
    elements: int | None = None,
    order: int | None = None,
    law: str = LAW,
    points: Any = None,
    out_of_plane: bool = False,
) -> tuple[SpectralMesh, np.ndarray, np.ndarray, float]:
    """Refine the mesh until the frequencies converge; return mesh, frequencies, vectors and last relative change.

    With dampers the frequencies are the complex roots lambda, and the vectors complex, see :func:`vibrations`.  With
    `out_of_plane` the vibrations are those normal to the plane of a planar scene.

    Raises
    ------
    SceneError
        For fewer unknowns than frequencies, or a cable that is not taut in equilibrium.
    """
    p = replace(p, initial={})  # the start of a run, which is not rest
    counts = counts_of(elements, p)
    tolerance = FREQUENCY_RTOL if p.wind is None else FREQUENCY_RTOL_IN_WIND
    values, vectors, error = None, np.empty((0, 0)), math.nan
    for number_of_elements in counts:
        mesh = mesh_of(p, number_of_elements, order, law, points)
        try:
            before, (values, vectors) = values, vibrations(mesh, count, out_of_plane=out_of_plane)
        except TooFewElements:
            if number_of_elements == counts[-1] and values is None:
                raise
            continue
        if before is not None and before.size == values.size:
            error = float(np.abs(values / before - 1.0).max())
            if error <= tolerance:
                break
    if values is None or values.size < count:
        allowed = f"at most {p.dims * (mesh.links - 1)}, the unknowns of {mesh.sizes.size} elements"
        if values is not None and np.iscomplexobj(values):
            allowed = f"at most {values.size}, the vibrations of {mesh.sizes.size} elements that oscillate"
        raise scene_error("count", count, allowed)
    return mesh, values, vectors, error


def vibrations(mesh: SpectralMesh, count: int, *, out_of_plane: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Compute up to `count` lowest angular frequencies [rad/s] and vectors (unknowns, count), orthonormal in mass.

    With dampers these are the complex roots lambda [1/s] and vectors of :func:`damped_vibrations`.  Vectors are displacements
    times the root of the mass.  With `out_of_plane` the only unknown of a node is its displacement normal to the plane of a
    planar scene, to which its dampers and springs are normal.
    """
    from scipy.linalg import svd  # costly to import

    p, order = mesh.p, mesh.order
    air = mean_air_of(p)
    position = start(mesh, None if air is None else MeshAir(mesh, air))
    g = mesh.gradient(position)
    stretch = np.sqrt(square(g))
    if not stretch.min() > 1.0:  # of a cable so stiff that its strain at rest is below the rounding of the positions
        raise TooFewElements(
            f"cable: at rest its strain in {mesh.sizes.size} elements is {stretch.min() - 1.0:.2g} by rounding; allowed: strains "
            f"above that (its stiffness is {p.stiffness:.3g} N)"
        )
    secant, tangent = mesh.moduli(stretch)
    t = g / stretch[:, None]
    # square root of the modulus matrix, times that of the quadrature weight
    if out_of_plane:
        root = np.sqrt(secant)[:, None, None]
    else:
        along = t[:, :, None] * t[:, None, :]
        root = np.sqrt(secant)[:, None, None] * (np.eye(p.dims) - along) + np.sqrt(tangent)[:, None, None] * along
    root *= np.sqrt(mesh.length)[:, None, None]
    dims, d = root.shape[-1], gll_rule(order)[2]
    matrix = np.zeros((mesh.length.size, dims, mesh.links + 1, dims))
    of_elements = root.reshape(-1, order + 1, dims, dims)
    entries = np.einsum("eqcd,qi,e->eiqcd", of_elements, d, mesh.scale)
    matrix.reshape(len(of_elements), order + 1, dims, -1, dims)[np.arange(len(entries))[:, None], :, :, mesh.nodes] = (
        entries
    )
    matrix /= np.sqrt(mesh.mass)[:, None]
    inner = matrix[:, :, 1:-1].reshape(mesh.length.size * dims, -1)
    springs, dampers = (
        np.zeros((0, inner.shape[1])) if out_of_plane else _rows_of(mesh, name) for name in ("spring", "damper")
    )
    if len(springs):
        inner = np.vstack([inner, springs])
    _, values, vectors = svd(inner, full_matrices=False)
    if len(dampers):
        return damped_vibrations(values[::-1], vectors[::-1].T, dampers.T, count)
    return values[::-1][:count], vectors[::-1][:count].T


def _rows_of(mesh: SpectralMesh, name: str) -> np.ndarray:
    """Return the rows R (attachments, unknowns) of springs or dampers, whose matrix is R^T R over the roots of the masses."""
    attached = zip(mesh.attached_particles, mesh.p.attachments, strict=True)
    held = [(node, item) for node, item in attached if getattr(item, name)]
    rows = np.zeros((len(held), mesh.links + 1, mesh.p.dims))
    for row, (node, item) in zip(rows, held, strict=True):
        row[node] = math.sqrt(getattr(item, name) / mesh.mass[node]) * np.asarray(item.direction)
    return rows[:, 1:-1].reshape(len(held), (mesh.links - 1) * mesh.p.dims)


def _shapes(mesh: SpectralMesh, vectors: np.ndarray) -> np.ndarray:
    """Return mode shapes (mode, nodes, dims) of vectors (unknowns, mode): mean square 1, largest component real and positive."""
    count = vectors.shape[1]
    shapes = np.zeros((count, mesh.links + 1, mesh.p.dims), dtype=vectors.dtype)
    shapes[:, 1:-1] = vectors.T.reshape(count, -1, mesh.p.dims) / np.sqrt(mesh.mass[1:-1, None])
    mean_square = square(np.abs(shapes)) @ mesh.tributary_length / mesh.total_length
    flat = shapes.reshape(count, -1)
    largest = flat[np.arange(count), np.abs(flat).argmax(axis=1)]
    factor = np.conj(largest) / (np.abs(largest) * np.sqrt(mean_square))
    return np.asarray(shapes * factor[:, None, None])


def normal_of_plane(p: Parameters, mesh: SpectralMesh) -> np.ndarray | None:
    """Return the unit vector normal to chord and load, mean drag included, (3,) of a spatial scene; None without such a plane."""
    if p.dims == 2:
        return None
    load, air = p.load_at(0.0), mean_air_of(p)
    if air is not None:
        drag = MeshAir(mesh, air)
        load = load + drag.at_rest(start(mesh, drag)).sum(axis=0) / mesh.total_length
    chord = np.subtract(*p.end_positions(np.zeros(1))[0])
    normal = np.cross(chord, load)
    norm = float(np.linalg.norm(normal))
    parallel = norm <= 1e-12 * float(np.linalg.norm(chord) * np.linalg.norm(load))
    return None if parallel else normal / norm
