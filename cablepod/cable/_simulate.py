"""The continuous extensible cable, eqs. (17)-(23) of the paper, at full order: at rest, in motion, in small vibrations."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import over_members
from cablepod.cable._mesh import Mesh, check_order, hung, mesh_of, parts, reference, settle, settled, start
from cablepod.cable._runs import SCHEMES, MeshImplicit, MeshRun, MeshVerlet, output_coordinates
from cablepod.cable._scheme import COUNTS, limit_of, picked, refined, refined_in_space
from cablepod.conventions import label
from cablepod.discretisation._chain import LAWS, check_law, square
from cablepod.integrate import _stepping as stepping
from cablepod.integrate._run import SUSPECT, State, suffix
from cablepod.parameters._parameters import Parameters, check_memory, parameters
from cablepod.parameters._schema import SceneError, integer, refuse

LAW = LAWS[1]


# --- rest -----------------------------------------------------------------------------------------------------------


@over_members
def rest(
    scene: xr.Dataset, *, elements: int | None = None, order: int | None = None, law: str = LAW, points: Any = None
) -> xr.Dataset:
    """Compute the continuous cable at rest between its ends, under all loads of the scene at time 0, by spectral elements.

    Parameters
    ----------
    scene
        A scene, with or without ``member``; an end that is free during the run is held here.
    elements
        Number of elements; by default so many that the shape is the continuous cable's to 1e-10 of the length, at most 128.
    order
        Order of their polynomials, 7 by default.
    law
        "green", eq. (21), or "linear", see :func:`simulate`.
    points
        Where the result is given, see :func:`simulate`.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (link)`` [N] at the middles of the links between particles,
        ``arc_length (particle)``, ``link_arc_length (link)`` [m] and the scalars ``unstretched_length``, ``stretched_length``
        [m], ``tension_lower``, ``tension_upper``, ``residual`` [N].  The attribute ``space_error_estimate`` is the largest
        distance from the continuous cable at rest, at nodes and between them, over the length.

    Raises
    ------
    SceneError
        For options that cannot be, and a cable that at rest has a place without tension (folded on itself).

    Notes
    -----
    Newton's method on the nodes, from the continuous cable, which is known but for the integral of x' = F/|F| xi(|F|), taken to
    rounding. Where a scene gives a tension, its unstretched length follows by the linear law whatever `law` is, as in
    :func:`cablepod.chain.rest`.
    """
    check_law(law)
    p = parameters(scene)
    least = _count(elements, p)
    for count in (least,) if elements is not None else [n for n in COUNTS if n >= least]:
        mesh = mesh_of(p, count, order, law, points)
        position, distance = settled(mesh)
        error = distance / mesh.total_length
        if error <= 1e-10:
            break
    stretch = mesh.stretch(position)
    ends = stretch[[0, -1]]
    k = p.stiffness
    tension = 0.5 * k * ends * (ends**2 - 1.0) if mesh.green else k * (ends - 1.0)
    unbalanced = (mesh.forces(position) + mesh.loads(0.0))[1:-1]
    scalars = {
        "unstretched_length": mesh.total_length,
        "stretched_length": float(mesh.length @ stretch),
        "tension_lower": tension[0],
        "tension_upper": tension[1],
        "residual": float(np.sqrt(square(unbalanced)).max(initial=0.0)),
    }
    result = xr.Dataset(
        {
            "position": (("particle", "coordinate"), mesh.at(position)),
            "tension": ("link", mesh.pull(position)[0]),
            **{name: ((), value) for name, value in scalars.items()},
        },
        coords=output_coordinates(mesh),
    )
    label(result)
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: continuous cable at rest in {count} elements{suffix(mesh)}",
        stage="rest",
        law=law,
        elements=count,
        element_order=mesh.order,
        space_error_estimate=error,
    )
    options = {
        "elements": count,
        "order": mesh.order,
        "law": law,
        "arc_length": mesh.particles,
        "points": points,
    }
    return provenance.record(
        result,
        function="cable.rest",
        parameters=options,
        inputs=[scene],
        chosen=provenance.unset(elements=elements, order=order),
    )


def _count(elements: int | None, p: Parameters) -> int:
    """Check the number of elements; the least one to begin with where none is given."""
    if elements is None:
        return max(COUNTS[0], parts(p).size - 1)
    return integer(least=1)("elements", elements)


# --- motion ---------------------------------------------------------------------------------------------------------


@over_members
def simulate(
    scene: xr.Dataset,
    *,
    elements: int | None = None,
    order: int | None = None,
    times: Any = None,
    law: str = LAW,
    scheme: str | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    points: Any = None,
    outputs: tuple[str, ...] = ("position",),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the continuous cable of a scene by spectral elements.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.  Its chain table says no more than where the result is given.
    elements
        Number of elements.  By default it is raised until two runs agree within `tolerance`.
    order
        Order of their polynomials, 7 by default, at most 16.
    times
        Instants of the output [s], rising from 0 on; by default 0, interval, ... up to the scene's duration.  They change no bit
        of the motion.
    law
        "green": eq. (21) of the paper, T / xi = K (xi^2 - 1) / 2, which resists compression (attribute ``first_slack_time``).
        "linear": T = K (xi - 1) where that is positive, else nothing.
    scheme
        "velocity_verlet", explicit, or "trapezoidal", implicit; by default the one that takes less time for `tolerance`.
    step
        Time step [s].  By default it is chosen as for the chain: shortened until two runs agree within `tolerance`.
        A given one is shortened too, where more elements than those at first need it; the attribute says to what.
    tolerance
        Wanted error in time, and that in space, as fractions of the largest rms displacement; 1e-6 by default.
    points
        Where the result is given: a number of particles at equal distances of unstretched arc length, or fractions of the length
        from 0 to 1, or "nodes".  By default the particles of the scene's chain; 41 where it has none.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps); nothing else is computed.
    progress
        Called now and then with the part of the run that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``position (time, particle, coordinate)`` [m], ``velocity`` [m/s], ``tension (time, link)`` [N],
        ``tension_minimum``, ``tension_maximum (link)`` [N] as asked for, tensions at ``link_arc_length (link)``, the middles
        between particles.  Attributes as those of :func:`cablepod.chain.simulate`, and ``elements``, ``element_order``,
        ``time_error_estimate`` and ``space_error_estimate`` where step and elements were chosen, ``smallest_stretch`` with its
        time and arc length, and where the stretch fell below 1 at any step ``first_slack_time``, ``first_slack_arc_length``.

    Raises
    ------
    SceneError
        For options that cannot be, law "green" with viscous links, a step above the stability limit, an output that would not
        fit in memory.
    RunStopped
        Where the motion leaves the finite numbers, or the cable holds far more energy than can be explained; its ``partial``
        holds what was computed until then.

    Warns
    -----
    NotConvergedWarning
        Where no step or no number of elements meets the tolerance: chaotic motion, or a cable that goes slack; and where a given
        step does not resolve how the ends or the loads move.

    Notes
    -----
    mu r'' = (T r'/xi)' + p, from the energy K (xi^2 - 1)^2 / 8 per unstretched length by law (21); GLL points are nodes and
    points of quadrature.  Where the motion is smooth the error at the nodes falls with order + 2 in the size of the elements
    (with 2 for order 1), and with the square of the step.  A cable that goes slack has corners, and a slack place resists nothing
    by the linear law: order is lost there.
    """
    check_law(law)
    stepping.check_scheme(scheme, SCHEMES)
    names = stepping.check_outputs(outputs)
    if step is not None and tolerance is not None:
        raise refuse("step and tolerance", (step, tolerance), "one of them: a tolerance chooses the step")
    goal = stepping.DEFAULT_TOLERANCE if tolerance is None else stepping.check_positive("tolerance", tolerance)
    p = parameters(scene)
    if law == "green" and p.link_viscosity is not None:
        raise refuse(
            "law and damping.link_viscosity",
            (law, p.link_viscosity),
            'viscous links with law "linear"; with "green" none, mass_proportional is possible',
        )
    check_order(order)
    instants = p.times() if times is None else stepping.check_times(times)
    p.check_reach(float(instants[-1]))
    title = str(scene.attrs.get("title", "scene"))

    def runs(count: int) -> dict[str, MeshRun]:
        mesh = mesh_of(p, count, order, law, points)
        check_memory(instants.size, max(mesh.links, mesh.particles.size), p.dims, key="elements and times", variables=3)
        about = (mesh, instants, start(mesh), names, progress, title)
        return {name: kind(*about) for name, kind in zip(SCHEMES, (MeshVerlet, MeshImplicit), strict=True)}

    at_hand = runs(_count(elements, p))
    reason, estimate, space = "given", None, None
    if step is not None:
        run = at_hand[scheme or SCHEMES[0]]
        state = run(rate := _given_rate(run, step))
        _suspect(state)
    elif scheme is not None:
        run = at_hand[scheme]
        state, rate, estimate = refined(run, goal)
    else:
        run, (state, rate, estimate), reason = picked(at_hand, goal)
    if elements is None:
        run, state, space = refined_in_space(runs, run, state, rate, goal)
        rate = state.instants.rate
    result = run.dataset(state)
    if estimate is not None:
        result.attrs["time_error_estimate"] = estimate
    if space is not None:
        result.attrs["space_error_estimate"] = space
    result.attrs["choice_of_scheme"] = reason
    options = {
        "elements": result.attrs["elements"],
        "order": result.attrs["element_order"],
        "times": instants,
        "law": law,
        "scheme": run.scheme,
        "step": 1.0 / rate,
        "tolerance": None if step is not None else goal,
        "arc_length": run.chain.particles,
        "points": points,
        "outputs": list(names),
    }
    return provenance.record(
        result,
        function="cable.simulate",
        parameters=options,
        inputs=[scene],
        chosen=provenance.unset(
            elements=elements, order=order, times=times, scheme=scheme, step=step, tolerance=tolerance
        ),
    )


def _given_rate(run: MeshRun, step: Any) -> float:
    if isinstance(run, MeshImplicit):
        return stepping.implicit_rate(step, float(run.times[-1]), run.chain.p.time_scale)
    limit = limit_of(run)
    why = f'2 over the highest angular frequency, {2 / limit:.6g} rad/s; scheme "trapezoidal" has none'
    return 1.0 / stepping.check_step(step, limit, why)


def _suspect(state: State) -> None:
    if state.notes["energy_excess"] > SUSPECT:
        warnings.warn(
            f"the cable holds up to {state.notes['energy_excess']:.2g} times the energy that rest, loads and ends "
            f"explain: a resonance, "
            "or a step too long for a cable that slackens and snaps taut; compare with half the step",
            stepping.NotConvergedWarning,
            stacklevel=4,
        )


# --- small vibrations -----------------------------------------------------------------------------------------------


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
    """Compute the lowest frequencies of small, undamped vibrations of the continuous cable about its rest, and their shapes.

    Parameters
    ----------
    scene
        A scene, with or without ``member``, with both ends held; they stand where they stand at time 0, and loads act as then.
    count
        Number of frequencies.
    elements
        Number of elements; by default so many that twice as many change no frequency by more than 1e-8 of it.
    order
        Order of their polynomials, 7 by default.
    law
        "green", eq. (21), or "linear", see :func:`simulate`.
    points
        Where the shapes are given, see :func:`simulate`.

    Returns
    -------
    xarray.Dataset
        ``angular_frequency (mode)`` [rad/s], rising, ``mode_shape (mode, particle, coordinate)`` with a mean square of 1 over the
        unstretched length and ``unstretched_length`` [m].  A planar scene gives the in-plane ones; a spatial one both, with
        ``out_of_plane_share (mode)``, the share of the mean square that is normal to the plane of chord and load, where these
        span one.  The attribute ``space_error_estimate`` is the largest relative change of a frequency by the last refinement.

    Raises
    ------
    SceneError
        For options that cannot be, for a free end, and for a cable without a taut rest.

    Notes
    -----
    The tangent at rest is a sum of squares, K = B^T B, so that frequencies are the singular values of B M^-1/2, with M the
    diagonal mass: rounding leaves an error of 1e-16 of the highest frequency, not of its square, and hardly extensible cables
    keep their digits.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> vibrations = cp.cable.frequencies(scene, count=2)
    >>> vibrations.angular_frequency.values.round(3).tolist(), vibrations.angular_frequency.units
    ([6.296, 12.464], 'rad s-1')
    """
    check_law(law)
    integer(least=1)("count", count)
    check_order(order)
    p = parameters(scene)
    if p.free is not None:
        raise refuse(
            "ends.free", p.free, "ends that are held: the rest about which the cable vibrates is between two of them"
        )
    tried = [n for n in COUNTS if n >= _count(None, p)] if elements is None else [_count(elements, p)]
    values, error = None, math.nan
    for number_of_elements in tried:
        mesh = mesh_of(p, number_of_elements, order, law, points)
        try:
            before, (values, vectors) = values, vibrations(mesh, count)
        except SceneError:
            if number_of_elements == tried[-1]:
                raise
            continue  # too few to turn as sharply as the cable does
        if before is not None and before.size == values.size:
            error = float(np.abs(values / before - 1.0).max())
            if error <= 1e-8:
                break
    if values is None or values.size < count:
        raise refuse("count", count, f"at most {p.dims * (mesh.links - 1)}, the unknowns of {mesh.sizes.size} elements")
    shapes = np.zeros((count, mesh.links + 1, p.dims))
    shapes[:, 1:-1] = vectors.T.reshape(count, -1, p.dims) / np.sqrt(mesh.share[1:-1, None] / mesh.total_length)
    flat = shapes.reshape(count, -1)
    shapes *= np.sign(flat[np.arange(count), np.abs(flat).argmax(axis=1)])[:, None, None]
    variables: dict[str, Any] = {
        "angular_frequency": ("mode", values),
        "mode_shape": (("mode", "particle", "coordinate"), mesh.at(shapes)),
        "unstretched_length": ((), mesh.total_length),
    }
    normal = _normal(p)
    if normal is not None:
        across = np.einsum("mjc,c->mj", shapes, normal) ** 2
        variables["out_of_plane_share"] = ("mode", across @ mesh.share / mesh.total_length)
    coordinates = output_coordinates(mesh)
    del coordinates["link_arc_length"]
    result = xr.Dataset(variables, coords={"mode": np.arange(1, count + 1), **coordinates})
    label(
        result,
        mode=("1", "number of the mode, from 1, by rising frequency"),
        mode_shape=("1", "shape of the vibration, its mean square over the unstretched length 1"),
    )
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: small vibrations of the continuous cable{suffix(mesh)}",
        stage="frequencies",
        law=law,
        elements=mesh.sizes.size,
        element_order=mesh.order,
        **({} if elements is not None else {"space_error_estimate": error}),
    )
    options = {
        "count": count,
        "elements": mesh.sizes.size,
        "order": mesh.order,
        "law": law,
        "arc_length": mesh.particles,
        "points": points,
    }
    return provenance.record(
        result,
        function="cable.frequencies",
        parameters=options,
        inputs=[scene],
        chosen=provenance.unset(elements=elements, order=order),
    )


def vibrations(mesh: Mesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest angular frequencies (count,) [rad/s], fewer where there are fewer unknowns, and vectors in columns."""
    from scipy.linalg import svd  # takes longer to import than a short run

    p, order = mesh.p, mesh.order
    g = mesh.gradient(settle(mesh, hung(mesh))[0])
    stretch = np.sqrt(square(g))
    if not stretch.min() > 1.0:
        raise SceneError(
            f"cable: at rest its stretch in {mesh.sizes.size} elements is {stretch.min():.9g} somewhere; allowed: a scene whose "
            "cable is taut at rest, and enough elements"
        )
    secant, along = mesh.moduli(stretch)
    t = g / stretch[:, None]
    turn = np.eye(p.dims) - t[:, :, None] * t[:, None, :]
    root = np.sqrt(secant)[:, None, None] * turn + np.sqrt(along)[:, None, None] * (t[:, :, None] * t[:, None, :])
    root *= np.sqrt(mesh.length)[:, None, None]
    d = np.array(reference(order)[2])
    matrix = np.zeros((mesh.length.size, p.dims, mesh.links + 1, p.dims))
    for e, scale in enumerate(mesh.scale):
        points, nodes = slice(e * (order + 1), (e + 1) * (order + 1)), slice(e * order, (e + 1) * order + 1)
        matrix[points, :, nodes] = np.einsum("qcd,qi->qcid", root[points], scale * d)
    matrix /= np.sqrt(p.mass * mesh.share)[:, None]
    inner = matrix[:, :, 1:-1].reshape(mesh.length.size * p.dims, -1)
    _, values, vectors = svd(inner, full_matrices=False)
    return values[::-1][:count], vectors[::-1][:count].T


def _normal(p: Parameters) -> np.ndarray | None:
    """Return the unit vector normal to chord and load of a spatial scene, None where there is no such plane."""
    if p.dims == 2:
        return None
    chord = np.subtract(*p.end_positions(np.zeros(1))[0])
    normal = np.cross(chord, p.load_at(0.0))
    size = float(np.linalg.norm(normal))
    return (
        normal / size if size > 1e-12 * float(np.linalg.norm(chord) * np.linalg.norm(p.load_at(0.0))) and size else None
    )
