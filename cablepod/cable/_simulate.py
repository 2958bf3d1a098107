"""Public functions of the continuous cable, eqs. (17)-(23) of the paper: equilibrium and motion by spectral elements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import xarray as xr

from cablepod import provenance
from cablepod._inputs import check_times
from cablepod._resources import check_bytes
from cablepod.batch._members import BatchPlan, over_members, over_members_by
from cablepod.cable._air import MeshAir
from cablepod.cable._mesh import COMPARED_POINTS, SpectralMesh, check_order, mesh_of, part_borders
from cablepod.cable._runs import SCHEMES, CableRun, ExplicitCableRun, ImplicitCableRun
from cablepod.cable._scheme import ELEMENT_COUNTS, element_counts, first_runs, refine_in_space, solve, space_error_of
from cablepod.cable._start import attached_forces, converged_equilibrium, start
from cablepod.conventions import OUTPUTS
from cablepod.discretisation._laws import LAWS, check_law, check_viscous_law, law_tension
from cablepod.discretisation._modal_damping import implicit_scheme
from cablepod.errors import SceneError
from cablepod.integrate._coarse import driven_of, end_time_of, warn_of_few_elements
from cablepod.integrate._output import chain_coordinates, law_suffix, rest_dataset
from cablepod.integrate._request import Request
from cablepod.integrate._velocity_jump import warn_of_members, warn_of_velocity_jump
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import Members, parameters
from cablepod.parameters._parameters import Parameters
from cablepod.scene._warnings import checked_members, warn_of_unusual
from cablepod.wind._air import air_of, mean_air_of
from cablepod.wind._profile import air_at_rest

#: Default law, eq. (21) of the paper.
LAW = LAWS[1]
#: Relative tolerance of the equilibrium shape: distance from the continuous cable over the length.
EQUILIBRIUM_RTOL = 1e-10


# --- equilibrium ----------------------------------------------------------------------------------------------------


@over_members
def rest(
    scene: xr.Dataset, *, elements: int | None = None, order: int | None = None, law: str = LAW, points: Any = None
) -> xr.Dataset:
    """Compute the equilibrium of the continuous cable under all loads of the scene at time 0, in its mean wind.

    Its elements end at ends of segments and at attachments, whose weight and drag act.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.  A free end is held at its initial position.
    elements
        Number of elements.  By default it is raised until the shape agrees with the continuous cable to 1e-10 of the length, up
        to 128, or to twice the number of parts between more than 95 point loads.
    order
        Polynomial order of the elements, 7 by default.
    law
        "green", eq. (21), or "linear", see :func:`simulate`.
    points
        Output points, see :func:`simulate`.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (link)`` [N] midway between particles,
        ``arc_length (particle)``, ``link_arc_length (link)`` [m] and the scalars ``unstretched_length``, ``stretched_length``
        [m], ``tension_lower``, ``tension_upper``, ``residual`` [N].  The attribute ``space_error_estimate`` is the largest
        distance from the continuous cable, at nodes and midway between them, over the length; in wind, that of the nodes from
        those of twice as many elements.  ``air`` says in which air the cable is at rest: the mean wind of the scene, or with
        ``wind.ramp`` still air.

    Raises
    ------
    SceneError
        For invalid options, or a cable that has a point without tension in equilibrium (folded on itself).

    Notes
    -----
    Newton's method for the nodes starts from the continuous cable, which follows from the integral of x' = F/|F| xi(|F|) to
    rounding.  If a scene gives a tension, the unstretched length follows by the linear law whatever `law` is, as in
    :func:`cablepod.chain.rest`.
    """
    check_law(law)
    p = parameters(scene)
    air = mean_air_of(p)
    mesh, position, error = converged_equilibrium(p, counts_of(elements, p), EQUILIBRIUM_RTOL, order, law, points)
    stretch = mesh.stretch(position)
    ends = stretch[[0, -1]]
    tension = law_tension(ends, mesh.element_stiffness[[0, -1]], green=mesh.green)
    scalars = {
        "unstretched_length": mesh.total_length,
        "stretched_length": float(mesh.length @ stretch),
        "tension_lower": tension[0],
        "tension_upper": tension[1],
    }
    drag = 0.0 if air is None else MeshAir(mesh, air).at_rest(position)
    result = rest_dataset(
        mesh.interpolate(position),
        mesh.tensions_and_forces(position)[0],
        (mesh.forces(position) + mesh.loads(0.0) + drag)[1:-1],
        chain_coordinates(mesh, has_links=True),
        scalars,
        title=f"{scene.attrs.get('title', 'scene')}: continuous cable at rest in {mesh.sizes.size} elements{law_suffix(mesh)}",
        law=law,
        air=air_at_rest(p),
        elements=mesh.sizes.size,
        element_order=mesh.order,
        space_error_estimate=error,
    )
    return record(result, scene, mesh, "cable.rest", elements=elements, order=order, points=points)


def record(
    result: xr.Dataset,
    scene: xr.Dataset,
    mesh: SpectralMesh,
    function: str,
    *,
    elements: int | None,
    order: int | None,
    **options: Any,
) -> xr.Dataset:
    """Append an equilibrium or its vibrations to the history of the result, in place; options as the caller gave them."""
    resolved = {"elements": mesh.sizes.size, "order": mesh.order, "law": mesh.law}
    chosen = provenance.defaulted_options(elements=elements, order=order)
    return provenance.record(result, function=function, parameters=resolved | options, inputs=[scene], chosen=chosen)


def counts_of(elements: int | None, p: Parameters) -> list[int]:
    """Check the number of elements; return the one that is given, or those that are tried in turn."""
    if elements is None:
        return element_counts(max(ELEMENT_COUNTS[0], part_borders(p).size - 1))
    return [integer(least=1)("elements", elements)]


# --- motion ---------------------------------------------------------------------------------------------------------


def _plan(
    scene: xr.Dataset, *, elements: Any = None, order: Any = None, times: Any = None, outputs: Any = (), **_: Any
) -> BatchPlan | None:
    """Warn of a member with too few elements, of those that are looked at; each member runs alone."""
    try:
        members, order = Members(scene), check_order(order)
        instants = None if times is None else check_times(times)
        if elements is not None and "error_estimate" not in outputs:
            needs = {
                i: driven_of(members[i], end_time_of(members[i], instants)).half_waves for i in checked_members(members)
            }
            p = members[max(needs, key=needs.__getitem__)]
            warn_of_few_elements(p, counts_of(elements, p)[0], order, end_time_of(p, instants))
    except SceneError:
        pass  # which the runs report
    return None


@over_members_by(_plan, warn_of_members)
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
    outputs: tuple[str, ...] = ("position", "tension"),
    window: tuple[float, float] | None = None,
    wind: xr.Dataset | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the continuous cable of a scene by spectral elements.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.  Its chain table only sets the default of `points`.
    elements
        Number of elements.  By default it is raised until two runs agree within `tolerance`, up to 128, or to twice the number of
        parts between more than 95 point loads, attachments and ends of segments.
    order
        Polynomial order of the elements, 7 by default, at most 16.
    times
        Output instants [s], increasing from 0; by default 0, interval, ... up to the scene's duration.  They do not change the
        motion by a single bit.
    law
        "green": eq. (21) of the paper, T / xi = K (xi^2 - 1) / 2, which resists compression (attribute ``first_slack_time``).
        "linear": T = K max(xi - 1, 0).
    scheme
        "velocity_verlet" (explicit) or "trapezoidal" (implicit); by default the faster one for `tolerance`.
    step
        Time step [s].  By default it is shortened until two runs agree within `tolerance`, as for the chain.  A given step is
        shortened only if a later, finer mesh requires it; the attribute ``step`` is the one used.
    tolerance
        Tolerance of the time error and of the space error, as fractions of the largest rms displacement; 1e-4 by default.  Where
        tensions are among the outputs the time error also counts in them, as a fraction of their range.
    points
        Output points: a number of particles equidistant in unstretched arc length, or fractions of the length from 0 to 1, or
        "nodes".  By default the particles of the scene's chain, or 41 particles without a chain.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps), "tension_peaks" (time and place of the
        largest and smallest of these), "tension_mean", "tension_rms" (time mean and root mean square of each link, by the
        trapezoidal rule over all steps, in runs of more than 32768 steps over equal intervals of several steps), "error_estimate"
        (of a given number of elements, by a companion run with fewer; where they are chosen it is there anyway).
        Extremes are of the steps: output times between two of them do not count.
    window
        Start and end [s] of the part of the run over which extremes and means are taken; all of it by default.
    wind
        Field of :func:`cablepod.wind.field`, or a record with the same variables, in place of mean wind and gusts of the scene,
        whose ramp, air density, drag and ice it has; along ``member``, that of each member.
    progress
        Callback receiving the completed fraction, which never falls and ends at 1.

    Returns
    -------
    xarray.Dataset
        ``position (time, particle, coordinate)`` [m], ``velocity`` [m/s], ``tension (time, link)`` [N],
        ``tension_minimum``, ``tension_maximum (link)`` [N] as requested; tensions are at ``link_arc_length (link)``, midway
        between particles.  Attributes are those of :func:`cablepod.chain.simulate`, ``elements``, ``element_order``, and
        ``smallest_stretch`` with its time and arc length.  If the step was chosen: ``time_error_estimate``.  If elements were
        chosen, or as requested: ``space_error_estimate`` (of given elements mostly too large; nan where there is none).  If the
        stretch fell below 1 at any step: ``first_slack_time``, ``first_slack_arc_length``.

    Raises
    ------
    SceneError
        For invalid options, law "green" with viscous links, a step above the stability limit, or an output larger than the
        memory.
    RunStopped
        If the motion diverges, or the energy exceeds by far the energy supplied.  Its ``partial`` holds the output until then.

    Warns
    -----
    NotConvergedWarning
        If no step or no number of elements meets the tolerance (chaotic motion, or a cable that goes slack), or if a given step
        does not resolve the motion of the ends or the loads, or violates the energy balance.
    CoarseWarning
        If a given number of elements has so few nodes for each half wave that is driven that an error of more than 1 % of the
        motion is likely, and "error_estimate" is not among the outputs.
    VelocityJumpWarning
        If an end starts from rest with a nonzero speed along the cable; see the key ``ramp`` of motions.

    Notes
    -----
    The equation of motion is mu r'' = (T r'/xi)' + p, with the energy K (xi^2 - 1)^2 / 8 per unstretched length for law (21).
    The GLL points are nodes and quadrature points.  For smooth motion the error at the nodes is of order p + 2 in the element
    length for polynomial order p (2 for p = 1), and of order 2 in the step.  A damper to the ground is solved for at its node
    in both schemes, so that it does not limit the step.  A cable that goes slack has corners and, by the
    linear law, no stiffness there, so that the order is lower.
    """
    check_law(law)
    request = Request.of(
        times=times,
        scheme=scheme,
        schemes=SCHEMES,
        step=step,
        tolerance=tolerance,
        window=window,
        outputs=outputs,
        allowed=(*OUTPUTS, "error_estimate"),
        progress=progress,
        several=step is None or elements is None,
    )
    p = parameters(scene)
    request = replace(request, scheme=implicit_scheme(p, request.scheme, SCHEMES[1:]))
    warn_of_unusual(p)
    check_viscous_law(law, p.link_viscosity)
    check_order(order)
    instants = request.instants(p)
    title = str(scene.attrs.get("title", "scene"))
    cable_air = air_of(p, float(instants[-1]), wind)

    is_compared = step is None or elements is None or "error_estimate" in request.outputs

    def runs(count: int, order: int | None = order) -> dict[str, CableRun]:
        mesh = mesh_of(p, count, order, law, points)
        _check_memory(mesh, instants.size, request.scheme, is_compared=is_compared)
        air = None if cable_air is None else MeshAir(mesh, cable_air)
        initial = start(mesh, air)
        options = request.of_run(instants, air=air, attached=attached_forces(mesh, initial, air))
        pair = zip(SCHEMES, (ExplicitCableRun, ImplicitCableRun), strict=True)
        return {name: run(mesh, initial, title, **options) for name, run in pair}

    first = first_runs(runs, counts_of(elements, p))
    explicit = first[SCHEMES[0]]
    limit = explicit.step_limit if step is not None and request.scheme in (None, SCHEMES[0]) else None
    formula = f'{explicit.limit_text}; scheme "trapezoidal" has none'
    given_steps_per_second = request.steps_per_second(p, float(instants[-1]), limit, formula)
    warn_of_velocity_jump(p)
    if elements is not None and "error_estimate" not in request.outputs:
        warn_of_few_elements(p, elements, check_order(order), float(instants[-1]))
    solution = solve(first, request, given_steps_per_second)
    solution.warn_of_energy_excess("the cable holds", "half the step")
    space_error = {}
    if elements is None:
        solution, space_error["space_error_estimate"] = refine_in_space(runs, solution, request.tolerance)
    elif "error_estimate" in request.outputs:
        space_error["space_error_estimate"] = space_error_of(runs, solution)
    result = solution.dataset()
    result.attrs.update(space_error)
    return request.record(
        result,
        function="cable.simulate",
        inputs=[scene] if wind is None else [scene, wind],
        given={"elements": elements, "order": order, "scheme": scheme},
        elements=result.attrs["elements"],
        order=result.attrs["element_order"],
        law=law,
        scheme=solution.run.scheme,
        points=points,
    )


def _check_memory(mesh: SpectralMesh, instants: int, scheme: str | None, *, is_compared: bool) -> None:
    """Refuse a run whose largest arrays together, of all output times, would not fit in memory.

    These are positions, also of two earlier runs with which it is compared, and the more of two: for the energy, what the kernels
    have saved, by implicit schemes velocities and accelerations too, with the gradient at the quadrature points in three forms;
    for the result, the nodes around each particle, or compared point, with what they give there and the output, or
    gradient, force and four scalars at the quadrature points.
    """
    nodes, places = mesh.links + 1, max(0 if mesh.places is None else mesh.places.size, COMPARED_POINTS * is_compared)
    in_run = (1 if scheme == SCHEMES[0] else 3) * nodes + 3 * mesh.length.size
    of_tension = (2 + 4 / mesh.p.dims) * mesh.length.size + 2 * mesh.particles.size
    in_result = max((mesh.order + 1 + 2) * places, of_tension)
    needed = 8.0 * instants * mesh.p.dims * ((3 if is_compared else 1) * nodes + max(in_run, in_result))
    cells = f"{mesh.sizes.size} elements of order {mesh.order}"
    check_bytes(needed, "elements and times", f"{cells} and {instants} instants, {needed / 1e9:.3g} GB in the run")
