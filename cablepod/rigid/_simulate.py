"""The chain of rigid links, as a system of differential and algebraic equations: scene -> rest, scene -> trajectory."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._resources import check_memory
from cablepod.batch._members import over_members
from cablepod.conventions import label
from cablepod.discretisation._chain import LumpedChain, chain_of, square
from cablepod.errors import NotConvergedWarning, RunStopped, scene_error
from cablepod.integrate._request import Request, implicit_steps_per_second
from cablepod.integrate._run import Trajectory, chain_coordinates
from cablepod.integrate._step_control import (
    ComparableRuns,
    check_work,
    motion_scale,
    preferred_steps_per_second,
    refine_step,
)
from cablepod.parameters._checks import number
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Parameters
from cablepod.rigid._ends import check_ends
from cablepod.rigid._runs import DRIFT_WARN, FORMULATIONS, TURN_WARN, RigidRun
from cablepod.rigid._start import rest_shape, start

#: No link turns by more than about this [rad] in a step of the first of the runs that are compared.
ROTATION_PER_STEP = 0.1


@over_members
def rest(scene: xr.Dataset, *, links: int | None = None) -> xr.Dataset:
    """Compute the chain of rigid links at rest between its ends, under all loads of the scene at time 0.

    Parameters
    ----------
    scene
        A scene; an end that is free during the run is held here.
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
        For ends further apart than the links are long, and for a chain that at rest is straight or folded on itself.
    """
    p = parameters(scene)
    chain = chain_of(p, links)
    position, tension = rest_shape(chain)
    force = (tension / chain.length)[:, None] * np.diff(position, axis=0)
    unbalanced = force[1:] - force[:-1] + chain.loads(0.0)[1:-1]
    result = xr.Dataset(
        {
            "position": (("particle", "coordinate"), position),
            "tension": ("link", tension),
            "unstretched_length": ((), chain.total_length),
            "tension_lower": ((), tension[0]),
            "tension_upper": ((), tension[-1]),
            "residual": ((), float(np.sqrt(square(unbalanced)).max())),
        },
        coords=chain_coordinates(chain),
    )
    label(result)
    result.attrs.update(title=f"{scene.attrs.get('title', 'scene')}: rigid links at rest", stage="rest")
    return provenance.record(
        result,
        function="rigid.rest",
        parameters={"links": chain.links},
        inputs=[scene],
        chosen=provenance.defaulted_options(links=links),
    )


@over_members
def simulate(
    scene: xr.Dataset,
    *,
    links: int | None = None,
    times: Any = None,
    formulation: str = FORMULATIONS[0],
    baumgarte: float | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position",),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the chain of a scene with rigid links, which neither stretch nor bend, and pull as well as push.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.  Its cable gives mass and unstretched length; the stiffness plays no part but where
        a tension gives the length.
    links
        Number of links, instead of the scene's; a chain with a free end may have a single one.
    times
        Instants of the output [s], rising from 0 on; by default 0, interval, ... up to the scene's duration.  They change
        no bit of the motion; between two steps it is interpolated and put back on the constraints.
    formulation
        "rattle": index 3, the positions and velocities kept on the constraints directly; symplectic and symmetric in time, second
        order.  "index1": the constraints differentiated twice give the multipliers, the resulting equations are integrated by the
        classical Runge-Kutta scheme and projected on the constraints after each step; fourth order, more work for a step.
    baumgarte
        Rate [1/s] of Baumgarte's stabilisation in place of the projection, with "index1" only, for comparison: lengths drift.
    step
        Time step [s].  By default it is shortened until two runs agree within `tolerance`.
    tolerance
        Wanted time error as a fraction of the largest rms displacement; 1e-6 by default.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps); nothing else is computed.
    progress
        Called now and then with the part of the run that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``position (time, particle, coordinate)`` [m], ``velocity`` [m/s], ``tension (time, link)`` [N],
        ``tension_minimum``, ``tension_maximum (link)`` [N] as asked for; negative tensions are compression.  Attributes:
        ``formulation``, ``step`` [s], ``number_of_steps``, ``length_error`` (largest relative one of any link at any step),
        ``energy_drift`` (largest imbalance of kinetic energy, work of loads and ends, and damping, over ``energy_exchanged`` [J],
        the largest of them), ``largest_turn_rate`` of any link [rad/s], ``newton_iterations``, ``steps_cut``, the estimate of the
        time error, and where tensions are asked for ``smallest_tension`` [N], ``links_in_compression`` and ``first_compression``
        [s].  Ends whose speed jumps at the start pass the jump on at once: ``start_jolt_speed`` [m/s], ``start_jolt_energy`` [J].

    Raises
    ------
    SceneError
        For options that cannot be, viscous links, a stretched start, ends that are or come too far apart (it says by how much and
        when), a straight chain between two held ends, an output that would not fit in memory.
    RunStopped
        Where the multipliers become singular, as for a chain that is pulled straight, and where the motion leaves the finite
        numbers or its energies their balance; its ``partial`` holds what was computed until then.

    Warns
    -----
    NotConvergedWarning
        Where no step meets the tolerance, as in chaotic scenes, and where a given step is so long that links turn by a radian in
        it, that it had to be cut, that the energies are off by a tenth, or that it does not resolve how the ends or loads move.

    Notes
    -----
    m_j r_j'' = P_j + T_j e_j - T_(j-1) e_(j-1), with |R_j| = l_j for R_j = r_(j+1) - r_j = l_j e_j: the multipliers are the
    tensions.  They follow from tridiagonal systems, so that a step costs O(n).  RATTLE: Andersen (1983), J. Comput. Phys. 52; the
    index-1 form and its stabilisation: Baumgarte (1972), Comput. Methods Appl. Mech. Eng. 1; Hairer and Wanner, Solving Ordinary
    Differential Equations II, chapter VII.

    A particle carries half the mass of the links beside it, a free end half a link's.  A run starts from the rest of the rigid
    chain, from a straight line towards a free end where the ends are as far apart as the links are long, or from initial.points:
    one for each particle with the links' lengths to a part of 1e-9, or a line.  On a line towards a free end, link after link is
    laid with its own length; between held ends the particles are shared out and moved by as little as gives the links their
    lengths.
    """
    if formulation not in FORMULATIONS:
        raise scene_error("formulation", formulation, "one of " + ", ".join(f'"{name}"' for name in FORMULATIONS))
    request = Request.of(times=times, step=step, tolerance=tolerance, outputs=outputs)
    rate_of_drift = _check_baumgarte(baumgarte, formulation)
    p = parameters(scene)
    chain = _chain(p, links)
    instants = request.instants(p)
    until = float(instants[-1])
    check_memory(
        instants.size, chain.links, p.dims, key="links" if links is not None else "chain.links and times", variables=3
    )
    check_ends(chain, until)
    title = str(scene.attrs.get("title", "scene"))
    run = RigidRun(chain, instants, start(chain), request.outputs, progress, title, formulation, rate_of_drift)
    if step is not None:
        rate = implicit_steps_per_second(step, until, p.shortest_time_scale)
        state, estimate = run(rate), None
        turn = state.diagnostics["largest_turn_rate"] / rate
        if state.diagnostics["energy_drift"] > DRIFT_WARN or turn > TURN_WARN or state.diagnostics["steps_cut"]:
            warnings.warn(
                f"the step is too long for this motion: a link turns by up to {turn:.2g} rad in it, "
                f"{state.diagnostics['steps_cut']} steps had to be cut, and the energies are out of balance by "
                f"{state.diagnostics['energy_drift']:.2g} of what was exchanged; "
                "compare with half of it",
                NotConvergedWarning,
                stacklevel=3,
            )
    else:
        state, rate, estimate = _refine_in_time(run, request.tolerance)
    result = run.dataset(state)
    if estimate is not None:
        result.attrs["time_error_estimate"] = estimate
    options = {
        "links": chain.links,
        "times": instants,
        "formulation": formulation,
        "baumgarte": rate_of_drift,
        "step": 1.0 / rate,
        "tolerance": request.recorded_tolerance,
        "outputs": list(request.outputs),
    }
    return provenance.record(
        result,
        function="rigid.simulate",
        parameters=options,
        inputs=[scene],
        chosen=provenance.defaulted_options(
            links=links, times=times, step=step, tolerance=tolerance, baumgarte=baumgarte
        ),
    )


def _chain(p: Parameters, links: int | None) -> LumpedChain:
    if p.link_viscosity is not None:
        raise scene_error(
            "damping.link_viscosity",
            p.link_viscosity,
            "none, as rigid links do not stretch; mass_proportional is possible",
        )
    return chain_of(p, links, least=2 if p.free_end is None else 1)


def _check_baumgarte(rate: float | None, formulation: str) -> float | None:
    if rate is None:
        return None
    if formulation != "index1":
        raise scene_error("baumgarte", rate, 'none, but for formulation "index1"')
    return number(least=0.0)("baumgarte", rate)


def _refine_in_time(run: RigidRun, tolerance: float) -> tuple[Trajectory, float, float]:
    """Shorten the step until two runs agree; returns the trajectory, its steps per second, the estimate of its error."""
    chord = float(np.linalg.norm(run.chain.p.upper - run.chain.p.lower))

    def position(state: Trajectory) -> np.ndarray:
        return state.position

    def scale(state: Trajectory) -> float:
        return motion_scale(state.position, run.initial, chord)

    first, end_time, links = preferred_steps_per_second(1.0 / run.first_step()), float(run.times[-1]), run.chain.links
    check_work(first, end_time, links)
    try:  # the initial shape does not tell how fast links will rotate
        rotation_rate = replace(run, progress=None)(first).diagnostics["largest_turn_rate"]
    except RunStopped:
        rotation_rate = 0.0
    first = max(first, preferred_steps_per_second(max(rotation_rate, 1e-300) / ROTATION_PER_STEP))
    return refine_step(ComparableRuns(run, position, scale, first, end_time, links), tolerance)
