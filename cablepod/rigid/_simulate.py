"""Equilibrium and simulation of the chain of rigid links, a system of differential and algebraic equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._resources import ARRAYS_OF_RUN, check_memory
from cablepod.batch._members import no_plan, over_members, over_members_by
from cablepod.conventions import STILL_AIR
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.discretisation._modal_damping import refuse_damping_ratios
from cablepod.errors import NotConvergedWarning, RunStopped, scene_error, warn
from cablepod.integrate._output import chain_coordinates, rest_dataset
from cablepod.integrate._output_times import preferred_steps_per_second
from cablepod.integrate._request import Request
from cablepod.integrate._step_control import Found, check_work, refine_step
from cablepod.integrate._velocity_jump import warn_of_members, warn_of_velocity_jump
from cablepod.parameters._checks import choice
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._nonuniform import refuse_nonuniform
from cablepod.parameters._parameters import Parameters
from cablepod.rigid._ends import check_ends
from cablepod.rigid._runs import DRIFT_WARN, FORMULATIONS, ROTATION_WARN, RigidRun
from cablepod.rigid._start import rest_shape, start
from cablepod.scene._warnings import warn_of_unusual
from cablepod.wind._air import check_no_wind

#: Maximum rotation of a link per step of the first run [rad].
ROTATION_PER_STEP = 0.1


@over_members
def rest(scene: xr.Dataset, *, links: int | None = None) -> xr.Dataset:
    """Compute the equilibrium of the chain of rigid links under all loads of the scene at time 0.

    Parameters
    ----------
    scene
        A scene; an end that is free in the run is held here.
    links
        Number of links, instead of the scene's.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (link)`` [N], ``arc_length (particle)`` [m] and the scalars
        ``unstretched_length`` [m], ``tension_lower``, ``tension_upper``, ``residual`` [N].

    Raises
    ------
    SceneError
        For ends further apart than the length of the chain, and for a chain that is straight or folded on itself at rest.
    """
    p = parameters(scene)
    check_no_wind(p, "chain.rest")
    refuse_nonuniform(p, "chain.rest")
    chain = chain_of(p, links)
    position, tension = rest_shape(chain)
    force = (tension / chain.length)[:, None] * np.diff(position, axis=0)
    unbalanced = force[1:] - force[:-1] + chain.loads(0.0)[1:-1]
    scalars = {"unstretched_length": chain.total_length, "tension_lower": tension[0], "tension_upper": tension[-1]}
    title = f"{scene.attrs.get('title', 'scene')}: rigid links at rest"
    coords = chain_coordinates(chain, has_links=True)
    result = rest_dataset(position, tension, unbalanced, coords, scalars, title=title, air=STILL_AIR)
    return provenance.record(
        result,
        function="rigid.rest",
        parameters={"links": chain.links},
        inputs=[scene],
        chosen=provenance.defaulted_options(links=links),
    )


@over_members_by(no_plan, warn_of_members)
def simulate(
    scene: xr.Dataset,
    *,
    links: int | None = None,
    times: Any = None,
    formulation: str = FORMULATIONS[0],
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position", "tension"),
    window: tuple[float, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the chain of a scene with rigid links, which carry tension and compression.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.  Its cable gives mass and unstretched length; the stiffness enters only if a tension
        defines the length.
    links
        Number of links, instead of the scene's; a chain with a free end may have a single one.
    times
        Output times [s], rising from 0 on; by default 0, interval, ... up to the scene's duration.  They do not change the
        motion; output between two steps is interpolated and projected onto the constraints.
    formulation
        "rattle": index 3, positions and velocities satisfy the constraints; symplectic, symmetric in time, second order.
        "index1": the constraints differentiated twice give the multipliers, and the classical Runge-Kutta scheme with projection
        onto the constraints after each step integrates the resulting equations; fourth order, more work per step.
    step
        Time step [s].  By default it is shortened until two runs agree within `tolerance`.
    tolerance
        Tolerance of the time error, as a fraction of the largest rms displacement; 1e-4 by default.  Where tensions are among the
        outputs it also holds for their rms difference over the links, as a fraction of their range.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps), "tension_peaks" (time and place of the
        largest and smallest of these), "tension_mean", "tension_rms" (time mean and root mean square of each link, by the
        trapezoidal rule over all steps, in runs of more than 32768 steps over equal intervals of several steps); only these are
        computed.
        Extremes are of the steps: output times between two of them do not count.
    window
        Start and end [s] of the part of the run over which extremes and means are taken; all of it by default.
    progress
        Callback receiving the completed fraction, which never falls and ends at 1.

    Returns
    -------
    xarray.Dataset
        ``position (time, particle, coordinate)`` [m], ``velocity`` [m/s], ``tension (time, link)`` [N],
        ``tension_minimum``, ``tension_maximum (link)`` [N], as requested; compression is negative.  Attributes: ``formulation``,
        ``step`` [s], ``number_of_steps``, ``length_error`` (maximum relative error over all links and steps), ``energy_drift``
        (largest imbalance of kinetic energy, work of loads and ends, and damping, over ``energy_exchanged`` [J], the largest of
        them), ``largest_turn_rate`` (maximum rotation rate of a link [rad/s]), ``newton_iterations``, ``steps_cut`` and the
        estimate of the time error.  Tensions add ``smallest_tension`` [N], ``links_in_compression`` and ``first_compression``
        [s].  Ends that start with a nonzero speed add ``start_jolt_speed`` [m/s] and ``start_jolt_energy`` [J].

    Raises
    ------
    SceneError
        For invalid options, viscous links, an initial shape with stretched links, ends that are or come too far apart (with
        distance and time), a straight chain between two held ends, an output that would not fit in memory.
    RunStopped
        If the multipliers become singular, as for a chain that is pulled straight, if the motion is no longer finite, or if the
        energies are out of balance; ``partial`` is the result until then.

    Warns
    -----
    NotConvergedWarning
        If no step meets the tolerance, as in chaotic scenes, and if a given step is too long: links turn by more than a radian
        in it, it needs substeps, the energies are out of balance by a tenth, or it does not resolve the motion of ends or loads.
    VelocityJumpWarning
        If an end starts from rest with a nonzero speed along the cable; see the key ``ramp`` of motions.

    Notes
    -----
    m_j r_j'' = P_j + T_j e_j - T_(j-1) e_(j-1), with |R_j| = l_j for R_j = r_(j+1) - r_j = l_j e_j.  The tensions T_j are
    Lagrange multipliers and follow from tridiagonal systems, so that a step costs O(n).  RATTLE: Andersen (1983), J. Comput.
    Phys. 52; index-1 form and projection: Hairer and Wanner, Solving Ordinary Differential Equations II, chapter VII.

    A particle carries half the mass of the links beside it, a free end half a link's.  A run starts from the equilibrium of the
    rigid chain, from a straight line towards a free end at full length, or from initial.points: one point for each particle, with
    link lengths to a relative 1e-9, or a polyline.  On a polyline towards a free end, links are placed one after the other;
    between held ends particles are placed by unstretched length, and the smallest corrections then give the links their lengths.
    """
    choice(*FORMULATIONS)("formulation", formulation)
    request = Request.of(times=times, step=step, tolerance=tolerance, window=window, outputs=outputs, progress=progress)
    p = parameters(scene)
    warn_of_unusual(p)
    chain = _chain(p, links)
    instants = request.instants(p)
    end_time = float(instants[-1])
    key = "links" if links is not None else "chain.links and times"
    # states have velocities and forces
    check_memory(instants.size, chain.links, p.dims, key=key, variables=2 * ARRAYS_OF_RUN)
    check_ends(chain, end_time)
    warn_of_velocity_jump(p)
    title = str(scene.attrs.get("title", "scene"))
    run = RigidRun(chain, start(chain), title, formulation, **request.of_run(instants))
    steps_per_second = request.steps_per_second(p, end_time, None)
    if steps_per_second is not None:
        state, estimate = run(steps_per_second), None
        diagnostics = state.diagnostics
        rotation = diagnostics["largest_turn_rate"] / steps_per_second
        if diagnostics["energy_drift"] > DRIFT_WARN or rotation > ROTATION_WARN or diagnostics["steps_cut"]:
            warn(
                f"the step is too long for this motion: a link turns by up to {rotation:.2g} rad per step, "
                f"{diagnostics['steps_cut']} steps needed substeps, and the energies are out of balance by "
                f"{diagnostics['energy_drift']:.2g} of the exchanged energy; compare with half the step",
                NotConvergedWarning,
            )
    else:
        state, _, estimate = _refine_in_time(run, request.tolerance)
    result = run.dataset(state)
    if estimate is not None:
        result.attrs["time_error_estimate"] = estimate
    return request.record(
        result,
        function="rigid.simulate",
        inputs=[scene],
        given={"links": links},
        links=chain.links,
        formulation=formulation,
    )


def _chain(p: Parameters, links: int | None) -> LumpedChain:
    """Discretise a scene into rigid links; refuse viscous ones."""
    if p.link_viscosity is not None:
        raise scene_error(
            "damping.link_viscosity",
            p.link_viscosity,
            "none, as rigid links do not stretch; mass_proportional is possible",
        )
    check_no_wind(p, "chain.simulate")
    if p.tension_damping is not None:
        raise scene_error(
            "damping.tension_proportional", p.tension_damping, "none; try: chain.simulate, or damping.mass_proportional"
        )
    refuse_damping_ratios(p, "chain.simulate, or damping.mass_proportional")
    refuse_nonuniform(p, "chain.simulate")
    return chain_of(p, links, least=2 if p.free_end is None else 1)


def _refine_in_time(run: RigidRun, tolerance: float) -> Found:
    """Shorten the step until two runs agree."""
    runs = run.comparable_runs()
    check_work(runs.steps_per_second, runs.end_time, runs.links)
    try:  # the initial shape does not tell how fast links will rotate
        rotation_rate = replace(run, progress=None)(runs.steps_per_second).diagnostics["largest_turn_rate"]
    except RunStopped:
        rotation_rate = 0.0
    first = max(runs.steps_per_second, preferred_steps_per_second(max(rotation_rate, 1e-300) / ROTATION_PER_STEP))
    return refine_step(replace(runs, steps_per_second=first), tolerance)
