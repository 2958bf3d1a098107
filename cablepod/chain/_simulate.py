"""Equilibrium and simulation of the elastic chain, eqs. (1)-(3) of the paper with corrected signs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import over_members, over_members_by
from cablepod.chain._air import ChainAir
from cablepod.chain._batch import plan
from cablepod.chain._scheme import ChainRequest, prepare, solve
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import chain_of, square
from cablepod.discretisation._laws import LAWS, check_law
from cablepod.integrate._coarse import warn_of_coarse_gusts, warn_of_few_links
from cablepod.integrate._output import chain_coordinates, law_suffix, rest_dataset
from cablepod.integrate._velocity_jump import warn_of_members, warn_of_velocity_jump
from cablepod.parameters._from_scene import parameters
from cablepod.scene._warnings import warn_of_unusual
from cablepod.wind._air import mean_air_of
from cablepod.wind._profile import air_at_rest

# --- rest -----------------------------------------------------------------------------------------------------------


@over_members
def rest(scene: xr.Dataset, *, links: int | None = None, law: str = LAWS[0]) -> xr.Dataset:
    """Compute the equilibrium of the chain under all loads of the scene at time 0, in its mean wind.

    Parameters
    ----------
    scene
        A scene; an end that is free in the run is held here.
    links
        Number of links, instead of the scene's.
    law
        "linear" or "green", see :func:`simulate`.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (link)`` [N], ``arc_length (particle)`` [m] and the scalars
        ``unstretched_length``, ``stretched_length`` [m], ``tension_lower``, ``tension_upper``, ``residual`` [N].  The attribute
        ``air`` says in which air the chain is at rest: the mean wind of the scene, or with ``wind.ramp`` still air.

    Raises
    ------
    SceneError
        For an unknown law, a scene without equilibrium, and a chain with a link without force at rest (folded on itself).

    Notes
    -----
    Newton's method solves for the force in the first link, which determines all others (discrete catenary).  ``residual`` is the
    largest force on an inner particle by the stored tensions.  Tensions computed from the stored positions have rounding errors
    of about K/l 2^-53 times the chord.

    If a scene gives a tension, its unstretched length follows from the linear law for either `law`, so that both laws have the
    same cable.  By law (21), T = K xi (xi^2 - 1) / 2, the tension at rest then differs from the given one: with a strain e by
    a relative 1.5 e at most, and by much less if the sag determines the tension.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> rest = cp.chain.rest(scene, links=10)
    >>> rest.position.dims, rest.sizes["particle"], rest.tension.units
    (('particle', 'coordinate'), 11, 'N')
    """
    check_law(law)
    p = parameters(scene)
    chain = chain_of(p, links, law)
    cable_air = mean_air_of(p)
    air = None if cable_air is None else ChainAir(chain, cable_air)
    position, tension = rest_shape(chain, air)
    reach = np.diff(position, axis=0)
    force = (tension / np.sqrt(square(reach)))[:, None] * reach
    loads = chain.loads(0.0) if air is None else chain.loads(0.0) + air.at_rest(position)
    unbalanced = force[1:] - force[:-1] + loads[1:-1]
    scalars = {
        "unstretched_length": chain.total_length,
        "stretched_length": float(np.sum(np.sqrt(square(reach)))),
        "tension_lower": tension[0],
        "tension_upper": tension[-1],
    }
    title = f"{scene.attrs.get('title', 'scene')}: chain at rest{law_suffix(chain)}"
    coords = chain_coordinates(chain, has_links=True)
    attrs = {"title": title, "law": chain.law, "air": air_at_rest(p)}
    result = rest_dataset(position, tension, unbalanced, coords, scalars, **attrs)
    options = {"links": chain.links, "law": chain.law}
    return provenance.record(
        result,
        function="chain.rest",
        parameters=options,
        inputs=[scene],
        chosen=provenance.defaulted_options(links=links),
    )


# --- motion ---------------------------------------------------------------------------------------------------------


@over_members_by(plan, warn_of_members)
def simulate(
    scene: xr.Dataset,
    *,
    links: int | None = None,
    times: Any = None,
    law: str = LAWS[0],
    scheme: str | None = None,
    spectral_radius: float | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position", "tension"),
    window: tuple[float, float] | None = None,
    wind: xr.Dataset | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the elastic chain of a scene.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.
    links
        Number of links, instead of the scene's.
    times
        Output times [s], rising from 0 on; by default 0, interval, ... up to the scene's duration.  They do not change the
        motion: output between two steps is interpolated, with an error far below that of the scheme.
    law
        "linear": T = K (xi - 1) with xi = |R| / l if positive, else 0 (slack).  "green": eq. (21) of the paper,
        T / xi = K (xi^2 - 1) / 2, the extensible cable with lumped linear elements; it resists compression.  A run from
        equilibrium starts from that of its law.
    scheme
        By default chosen for `tolerance`; the attribute ``choice_of_scheme`` gives the reason.  "velocity_verlet" is explicit.
        Implicit, with O(n) operations per step and unconditionally stable in linear theory, are "trapezoidal" (average
        acceleration), "generalized_alpha" (Chung and Hulbert; damps unresolved frequencies) and "energy_momentum" (Simo and
        Tarnow; conserves the energy).
    spectral_radius
        Spectral radius of "generalized_alpha" at high frequencies, in [0, 1]; 0.8 by default.
    step
        Time step [s].  By default it follows from the highest frequency and is shortened until two runs agree within
        `tolerance`; a given step is run once, without this check.
    tolerance
        Tolerance of the time error, as a fraction of the largest rms displacement; 1e-4 by default.  Where tensions are among the
        outputs it also holds for their rms difference over the links, as a fraction of their range.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps), "tension_peaks" (time and place of the
        largest and smallest of these), "tension_mean", "tension_rms" (time mean and root mean square of each link, by the
        trapezoidal rule over all steps, in runs of more than 32768 steps over equal intervals of several steps), "error_estimate"
        (of the links, by a companion run with 0.6 times as many, or half: mostly a quarter to half of the time more; with a given
        step it contains the error of that); only these are computed.
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
        ``tension_minimum``, ``tension_maximum (link)`` [N], ``tension_maximum_time`` [s], ``tension_maximum_arc_length`` [m, of
        the middle of the link] and the same of the minimum, as requested; by law "green" compression is negative.  Attributes:
        law, scheme, step [s], number of steps, stability limit of the step [s], highest angular frequency [rad/s] and the
        estimate of the time error, of the motion (``time_error_estimate``) and, where tensions are among the outputs, of these
        (``tension_time_error_estimate``).  As requested: ``space_error_estimate``, of the distance from the continuous cable
        over the motion (nan where the companion run stops).  With law "green" limit and frequency hold at the start;
        ``smallest_stretch`` is the minimum of xi at the output times. ``energy_excess`` is the largest ratio of the strain
        energy to the energy that start, loads and ends can supply. Implicit runs add ``newton_iterations`` and
        ``steps_cut``. Ends that start with a nonzero speed add ``start_jolt_speed`` [m/s], ``start_jolt_tension`` [N] and
        ``start_jolt_energy`` [J], see Notes.

    Raises
    ------
    SceneError
        For invalid options, law "green" with viscous links, a step above the stability limit, an output that would not fit in
        memory.
    RunStopped
        If the motion is no longer finite, or the links hold excessive strain energy; ``partial`` is the result until then.  With
        law "green" also if the links have become too stiff for a given step at an output time.

    Warns
    -----
    NotConvergedWarning
        If no step meets the tolerance, as in chaotic scenes, and if a given step leads to excessive strain energy or does not
        resolve the motion of the ends or the loads.
    CoarseWarning
        If the links are so few for each half wave that is driven, for the phase of free vibrations, for the sag, or for gusts,
        that an error of more than 1 % of the motion is likely, and "error_estimate" is not among the outputs.
    VelocityJumpWarning
        If an end starts from rest with a nonzero speed, whose wave exceeds 0.1 % of the tension at rest; see the key ``ramp`` of
        motions.

    Notes
    -----
    m r'' = P + T_j - T_(j-1) with T = k (1 - l/|R|) R for |R| > l, else 0; eqs. (1)-(3) of the paper.  Second order in the step
    and in 1/n.  Damping by mass is integrated exactly; viscous links use a velocity extrapolated from the last two half steps,
    which preserves the order.

    End motions are displacements counted from their value at time 0, which is the attribute ``motion_END_AXIS_offset`` [m] of
    harmonic motions and records; records are splines.  The key ``ramp`` multiplies them by a smooth step.  A jump v of the speed
    along the cable at the start sends out an axial wave, which changes the tension by v sqrt(K mu).  After one passage the wave
    carries the energy mu L v^2 (for two ends the sum).

    By law (21) T = k/2 (|R|^2/l^2 - 1) R, with the energy K (xi^2 - 1)^2 / 8 per unstretched length.  The tangent stiffness of a
    link is (3 xi^2 - 1) / 2 times that of the unstretched link, so that the stability limit falls with the stretch.  The step
    chosen here takes the largest distance of the ends into account with a margin, and is halved if that is not enough.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> run = cp.chain.simulate(scene, times=[0.0, 45.0], outputs=("position", "tension"))
    >>> run.position.dims, run.attrs["scheme"], run.attrs["time_error_estimate"] < 1e-4
    (('time', 'particle', 'coordinate'), 'velocity_verlet', True)
    """
    request = ChainRequest.of(
        links=links,
        times=times,
        law=law,
        scheme=scheme,
        spectral_radius=spectral_radius,
        step=step,
        tolerance=tolerance,
        window=window,
        outputs=outputs,
        wind=wind,
        progress=progress,
    )
    p = parameters(scene)
    warn_of_unusual(p)
    ready = prepare(p, request, str(scene.attrs.get("title", "scene")), request.progress)
    warn_of_velocity_jump(p)
    if "error_estimate" not in request.outputs:  # which tells it
        warn_of_few_links(p, ready.run.chain.links, float(ready.run.times[-1]))
        warn_of_coarse_gusts(ready.run.air, ready.run.chain.links)
    solution = solve(ready, request)
    run = solution.run
    return request.record(
        solution.dataset(),
        function="chain.simulate",
        inputs=[scene] if wind is None else [scene, wind],
        given={"links": links, "scheme": scheme, "spectral_radius": spectral_radius},
        links=run.chain.links,
        law=law,
        scheme=run.scheme,
        spectral_radius=request.radius if run.scheme == "generalized_alpha" else None,
    )
