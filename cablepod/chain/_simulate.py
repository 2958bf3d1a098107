"""The elastic chain, eqs. (1)-(3) of the paper with the signs repaired: scene -> chain at rest, scene -> trajectory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import over_members, over_members_by
from cablepod.chain import _batch as chain_many
from cablepod.chain._scheme import ChainRequest, prepare, solve
from cablepod.chain._start import rest_shape
from cablepod.conventions import label
from cablepod.discretisation._chain import chain_of, square
from cablepod.discretisation._laws import LAWS, check_law
from cablepod.integrate._run import chain_coordinates, law_suffix
from cablepod.parameters._from_scene import parameters

# --- rest -----------------------------------------------------------------------------------------------------------


@over_members
def rest(scene: xr.Dataset, *, links: int | None = None, law: str = LAWS[0]) -> xr.Dataset:
    """Compute the chain at rest between its ends, under all loads of the scene at time 0.

    Parameters
    ----------
    scene
        A scene; an end that is free during the run is held here.
    links
        Number of links, instead of the scene's.
    law
        "linear" or "green", see :func:`simulate`.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (link)`` [N], ``arc_length (particle)`` [m] and the scalars
        ``unstretched_length``, ``stretched_length`` [m], ``tension_lower``, ``tension_upper``, ``residual`` [N].

    Raises
    ------
    SceneError
        For a law that is not known, a scene without rest, and a chain that at rest has a link without force (folded on itself).

    Notes
    -----
    Newton's method on the force in the first link, which determines all else (the discrete catenary).  The residual is
    that of the tensions along the links as they are stored; tensions computed again from the positions carry the rounding
    of these, about K/l 2^-53 times the chord.

    Where a scene gives a tension, its unstretched length follows by the linear law whatever `law` is: both laws have the same
    cable, and by law (21), T = K xi (xi^2 - 1) / 2, the tension at rest is not quite the one given: with a strain e it is off by
    1.5 e at most, relatively, and by much less where the sag decides.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> rest = cp.chain.rest(scene, links=10)
    >>> rest.position.dims, rest.sizes["particle"], rest.tension.units
    (('particle', 'coordinate'), 11, 'N')
    """
    check_law(law)
    p = parameters(scene)
    chain = chain_of(p, links, law)
    position, tension = rest_shape(chain)
    reach = np.diff(position, axis=0)
    force = (tension / np.sqrt(square(reach)))[:, None] * reach
    unbalanced = force[1:] - force[:-1] + chain.loads(0.0)[1:-1]
    scalars = {
        "unstretched_length": chain.total_length,
        "stretched_length": float(np.sum(np.sqrt(square(reach)))),
        "tension_lower": tension[0],
        "tension_upper": tension[-1],
        "residual": float(np.sqrt(square(unbalanced)).max()),
    }
    result = xr.Dataset(
        {
            "position": (("particle", "coordinate"), position),
            "tension": ("link", tension),
            **{name: ((), value) for name, value in scalars.items()},
        },
        coords=chain_coordinates(chain),
    )
    label(result)
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: chain at rest{law_suffix(chain)}", stage="rest", law=chain.law
    )
    options = {"links": chain.links, "law": chain.law}
    return provenance.record(
        result,
        function="chain.rest",
        parameters=options,
        inputs=[scene],
        chosen=provenance.defaulted_options(links=links),
    )


# --- motion ---------------------------------------------------------------------------------------------------------


@over_members_by(chain_many.plan)
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
    outputs: tuple[str, ...] = ("position",),
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
        Instants of the output [s], rising from 0 on; by default 0, interval, ... up to the scene's duration.  They change
        no bit of the motion: what lies between two steps is interpolated to the order of the scheme.
    law
        "linear": T = K (xi - 1), xi = |R| / l, where that is positive; a slack link carries nothing.  "green": eq. (21) of the
        paper, T / xi = K (xi^2 - 1) / 2, the extensible cable cut into lumped linear elements; it resists compression.  A run
        from equilibrium starts from that of its law.
    scheme
        By default picked by `tolerance`; the attribute ``choice_of_scheme`` says why.  "velocity_verlet" is explicit.  Implicit,
        in O(n) per step and stable at any step as far as linear theory goes, are "trapezoidal" (average acceleration),
        "generalized_alpha" (Chung and Hulbert; damps what its steps do not resolve) and "energy_momentum" (Simo and Tarnow;
        keeps the energy).
    spectral_radius
        Of "generalized_alpha" for the highest frequencies, in [0, 1]; 0.8 by default.
    step
        Time step [s].  By default it follows from the highest frequency and is then halved or shortened until two runs agree
        within `tolerance`; with a given step there is one run and no such check.
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
        ``tension_minimum``, ``tension_maximum (link)`` [N] as asked for; by law "green" compression is negative.  Attributes say
        law, scheme, step [s], number of steps, stability limit of the step [s], highest angular frequency [rad/s] and the
        estimate of the time error; with law "green" limit and frequency are those of the start, and ``smallest_stretch`` says
        the least xi at the instants of the output.  ``energy_excess`` is the largest strain energy over what start, loads and
        ends explain; implicit runs add ``newton_iterations`` and ``steps_cut``.  Ends whose speed jumps at the start are
        accepted; the energy that this injects is then in ``start_jolt_energy`` [J], with ``start_jolt_speed`` [m/s] and
        ``start_jolt_tension`` [N], see Notes.

    Raises
    ------
    SceneError
        For options that cannot be, law "green" with viscous links, a step above the stability limit, an output that would not
        fit in memory.
    RunStopped
        Where the motion leaves the finite numbers, or its links hold far more energy than can be explained; its ``partial`` holds
        what was computed until then.  With law "green" also where at an instant of the output the links have become too stiff for
        a given step.

    Warns
    -----
    NotConvergedWarning
        Where no step meets the tolerance, as in chaotic scenes, and where a given step leaves more energy than can be explained,
        or does not resolve how the ends or the loads move.

    Notes
    -----
    m r'' = P + T_j - T_(j-1) with T = k (1 - l/|R|) R for |R| > l, else 0; eqs. (1)-(3) of the paper.  Second order in step
    and in 1/n.  Damping by mass is integrated exactly; viscous links use a velocity predicted from the last two half steps,
    which keeps the order.

    No motion can jump in position: each kind is continuous and starts from where the end is, a record being a spline.  A jump of
    its speed by v along the cable, at the start, sends out an axial wave that changes the tension by v sqrt(K mu) and, when it
    has run along the cable once, carries the energy mu L v^2 (of both ends the sum).

    By law (21) T = k/2 (|R|^2/l^2 - 1) R, from the energy K (xi^2 - 1)^2 / 8 per unstretched length.  Along a link it is
    (3 xi^2 - 1) / 2 times as stiff as unstretched, so the limit of the step is that of the stretch at the start and falls as the
    links are pulled; the step that is chosen here counts on the largest distance of the ends, keeps a margin, and is halved where
    that is not enough.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> run = cp.chain.simulate(scene, times=[0.0, 45.0], outputs=("position", "tension"))
    >>> run.position.dims, run.attrs["scheme"], run.attrs["time_error_estimate"] < 1e-6
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
        outputs=outputs,
    )
    ready = prepare(parameters(scene), request, str(scene.attrs.get("title", "scene")), progress)
    solution = solve(ready, request)
    run = solution.run
    resolved = {
        "links": run.chain.links,
        "times": run.times,
        "law": law,
        "scheme": run.scheme,
        "spectral_radius": request.radius if run.scheme == "generalized_alpha" else None,
        "step": 1.0 / solution.steps_per_second,
        "tolerance": request.recorded_tolerance,
        "outputs": list(request.outputs),
    }
    return provenance.record(
        solution.dataset(),
        function="chain.simulate",
        parameters=resolved,
        inputs=[scene],
        chosen=provenance.defaulted_options(
            links=links, times=times, scheme=scheme, spectral_radius=spectral_radius, step=step, tolerance=tolerance
        ),
    )
