"""The continuous extensible cable, eqs. (17)-(23) of the paper, at full order: at rest, in motion, in small vibrations."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._resources import check_memory
from cablepod.batch._members import over_members
from cablepod.cable._mesh import check_order, mesh_of, part_borders
from cablepod.cable._runs import SCHEMES, CableRun, ExplicitCableRun, ImplicitCableRun, output_coordinates
from cablepod.cable._scheme import ELEMENT_COUNTS, choose_scheme, refine_in_space, refine_in_time, step_limit_of
from cablepod.cable._start import equilibrium_with_error, start
from cablepod.conventions import label
from cablepod.discretisation._chain import square
from cablepod.discretisation._laws import LAWS, check_law, law_tension
from cablepod.errors import NotConvergedWarning, scene_error
from cablepod.integrate._energy_check import ENERGY_WARN
from cablepod.integrate._request import Request, check_step, implicit_steps_per_second
from cablepod.integrate._run import Trajectory, law_suffix
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Parameters

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
    for count in (least,) if elements is not None else [n for n in ELEMENT_COUNTS if n >= least]:
        mesh = mesh_of(p, count, order, law, points)
        position, distance = equilibrium_with_error(mesh)
        error = distance / mesh.total_length
        if error <= 1e-10:
            break
    stretch = mesh.stretch(position)
    ends = stretch[[0, -1]]
    tension = law_tension(ends, p.stiffness, green=mesh.green)
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
            "position": (("particle", "coordinate"), mesh.interpolate(position)),
            "tension": ("link", mesh.tensions_and_forces(position)[0]),
            **{name: ((), value) for name, value in scalars.items()},
        },
        coords=output_coordinates(mesh),
    )
    label(result)
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: continuous cable at rest in {count} elements{law_suffix(mesh)}",
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
        chosen=provenance.defaulted_options(elements=elements, order=order),
    )


def _count(elements: int | None, p: Parameters) -> int:
    """Check the number of elements; the least one to begin with where none is given."""
    if elements is None:
        return max(ELEMENT_COUNTS[0], part_borders(p).size - 1)
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
    request = Request.of(times=times, scheme=scheme, schemes=SCHEMES, step=step, tolerance=tolerance, outputs=outputs)
    p = parameters(scene)
    if law == "green" and p.link_viscosity is not None:
        raise scene_error(
            "law and damping.link_viscosity",
            (law, p.link_viscosity),
            'viscous links with law "linear"; with "green" none, mass_proportional is possible',
        )
    check_order(order)
    instants = request.instants(p)
    title = str(scene.attrs.get("title", "scene"))

    def runs(count: int) -> dict[str, CableRun]:
        mesh = mesh_of(p, count, order, law, points)
        check_memory(instants.size, max(mesh.links, mesh.particles.size), p.dims, key="elements and times", variables=3)
        about = (mesh, instants, start(mesh), request.outputs, progress, title)
        return {name: kind(*about) for name, kind in zip(SCHEMES, (ExplicitCableRun, ImplicitCableRun), strict=True)}

    at_hand = runs(_count(elements, p))
    reason, estimate, space = "given", None, None
    if step is not None:
        run = at_hand[scheme or SCHEMES[0]]
        state = run(rate := _given_rate(run, step))
        _suspect(state)
    elif scheme is not None:
        run = at_hand[scheme]
        state, rate, estimate = refine_in_time(run, request.tolerance)
    else:
        run, (state, rate, estimate), reason = choose_scheme(at_hand, request.tolerance)
    if elements is None:
        run, state, space = refine_in_space(runs, run, state, rate, request.tolerance)
        rate = state.instants.steps_per_second
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
        "tolerance": request.recorded_tolerance,
        "arc_length": run.chain.particles,
        "points": points,
        "outputs": list(request.outputs),
    }
    return provenance.record(
        result,
        function="cable.simulate",
        parameters=options,
        inputs=[scene],
        chosen=provenance.defaulted_options(
            elements=elements, order=order, times=times, scheme=scheme, step=step, tolerance=tolerance
        ),
    )


def _given_rate(run: CableRun, step: Any) -> float:
    if isinstance(run, ImplicitCableRun):
        return implicit_steps_per_second(step, float(run.times[-1]), run.chain.p.shortest_time_scale)
    limit = step_limit_of(run)
    why = f'2 over the highest angular frequency, {2 / limit:.6g} rad/s; scheme "trapezoidal" has none'
    return 1.0 / check_step(step, limit, why)


def _suspect(state: Trajectory) -> None:
    if state.diagnostics["energy_excess"] > ENERGY_WARN:
        warnings.warn(
            f"the cable holds up to {state.diagnostics['energy_excess']:.2g} times the energy that rest, loads and ends "
            f"explain: a resonance, "
            "or a step too long for a cable that slackens and snaps taut; compare with half the step",
            NotConvergedWarning,
            stacklevel=4,
        )
