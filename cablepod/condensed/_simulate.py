"""Public function of the condensed model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import NORMAL_MODES, SCENE, taken
from cablepod.batch._members import check_common_times, check_members_of_field
from cablepod.condensed._assembly import model_of, unit_of
from cablepod.condensed._batch import run
from cablepod.condensed._output import attributes_of, dataset
from cablepod.condensed._rescale import kept_model
from cablepod.condensed._runs import SCHEMES, CondensedRequest, solve
from cablepod.conventions import OUTPUTS
from cablepod.errors import scene_error
from cablepod.integrate._velocity_jump import warn_of_members, warn_of_velocity_jump
from cablepod.parameters._from_scene import Members, SceneContent
from cablepod.pod._normal import check_axis
from cablepod.reduced._validity import warn_condensed_out_of_range
from cablepod.scene._warnings import warn_of_unusual


def simulate(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    rank: int | None = None,
    times: Any = None,
    order: str = "leading",
    law: str = "linear",
    quadrature: int | None = None,
    scheme: str | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position", "error_estimate"),
    links: Any = None,
    window: tuple[float, float] | None = None,
    wind: xr.Dataset | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate a cable that is quasi-static along its chord, on modes of its deflection.

    Parameters
    ----------
    scene
        Scene with both ends held; it need not be the training scene of the modes.  Order "leading" has segments and attachments.
        Members of a scene with ``member`` run
        concurrently; failed members hold nan and report the reason in ``failure``.
    modes
        Result of :func:`cablepod.pod.decompose` with layout "normal", transferred by sigma = S / L0.
    rank
        Number of modes of each deflection; all by default.
    times
        Instants of the output [s], increasing, not negative; those of the scene by default.
    order
        "leading": closure and force to first order in strain and squared slope, a step costs products of r x r matrices; "exact":
        exact chordwise stretch on each link, with H from Newton's method; "inertial": exact, with the chordwise inertia that the
        deflection enforces.
    law
        "linear", the law of the chain; with orders "exact" and "inertial" also "green", eq. (21).
    quadrature
        With orders "exact" and "inertial": number of Gauss-Lobatto points along the cable at which the chordwise stretch is
        evaluated instead of on each link.  The cost is then independent of the number of links, and the result approaches the
        continuous cable instead of the chain.  Eight points suffice for four smooth modes, sixteen for eight.  Excludes point
        loads and "tension_extremes".
    scheme
        "velocity_verlet" (explicit), "trapezoidal" (implicit, stable at any step) or, with order "leading", "numerov"
        (explicit, of fourth order, stable below 1.73 times the limit of "velocity_verlet").  By default "velocity_verlet" with a
        given step or tolerance, and "numerov" without; trapezoidal where the stretching of the sag shortens such steps much.
    step
        Time step [s]; by default it is refined until two runs agree within the tolerance.
    tolerance
        Time error as a fraction of the largest rms displacement.  By default a tenth of the estimated error of the model, from
        1e-6 to 1e-2; this time error is that of the deflection.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps), "tension_peaks" (time and place of the
        largest and smallest of these), "tension_mean", "tension_rms" (time mean and root mean square of each link, by the
        trapezoidal rule over all steps, in runs of more than 32768 steps over equal intervals of several steps)
        and "error_estimate" (of the model, see :func:`cablepod.condensed._estimate.estimate`).  Only these are computed.
        Extremes are of the steps: output times between two of them do not count.
    links
        Numbers, from 1 at the lower end, of the links whose tensions are computed; all by default.
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
        ``amplitude (time, mode)`` [m], in space also ``amplitude_out_of_plane`` and ``normal_reference (coordinate)``,
        ``end_position`` [m] and the requested outputs, on the particles of the modes; of members that run in lanes
        ``end_position`` is computed when it is read.
        Attributes: scheme, step [s], number of steps, ``step_limit`` [s], the stability limit of explicit steps at the start,
        and the diagnostics of :mod:`cablepod.reduced`: ``smallest_chordwise_force`` [N] over all steps,
        ``forcing_over_axial_frequency``, ``energy_share_kept``, ``outside_training`` and ``error_estimate`` (largest expected
        error over time as a fraction of the motion, including ``time_error_estimate``).

    Raises
    ------
    SceneError
        For invalid options, modes of another layout, a scene with a free end, a step above the stability limit.
    RunStopped
        Where the motion leaves the finite numbers, its frequencies outgrow a given step, or Newton's method fails.

    Warns
    -----
    OutOfRangeWarning
        Where the chordwise force becomes negative (the cable goes slack, and the model is ill-posed), the ends or loads change as
        fast as waves travel along the cable, or the estimated error exceeds half of the motion.
    NotConvergedWarning
        Where no step meets the tolerance, and where a given step does not resolve the motion of the ends or the loads.
    VelocityJumpWarning
        If an end starts from rest with a nonzero speed along the cable; see the key ``ramp`` of motions.

    Notes
    -----
    The deflection w normal to the chord c obeys mu w_tt = (N w' / zeta')' + p.n - mu (c0_tt + S/L0 c_tt).n, where primes are
    derivatives by S.  The chordwise force is N = H(t) + tau(S, t) with tau' = -p.e + mu (c0_tt + S/L0 c_tt).e.  The closure, the
    integral of the chordwise stretch zeta' over S equals |c|, determines H.  The idea is that of Irvine and Caughey (1974), with
    modes from snapshots.  Neglected are the rotation of the chord acting on the relative motion and, except for order
    "inertial", the chordwise inertia relative to the chord.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> modes = cp.pod.decompose(cp.chain.simulate(scene), layout="normal", rank=2)
    >>> model = cp.condensed.simulate(scene, modes)
    >>> round(100 * model.attrs["error_estimate"], 2)  # per cent, without a reference solution
    0.02
    """
    scene, modes = taken("scene", scene, SCENE), taken("modes", modes, NORMAL_MODES)
    request = CondensedRequest.of(
        times=times,
        scheme=scheme,
        schemes=SCHEMES,
        step=step,
        tolerance=tolerance,
        window=window,
        outputs=outputs,
        allowed=(*OUTPUTS, "error_estimate"),
        progress=progress,
        links=None if links is None else check_links(links, modes),
        wind=wind,
    )
    if quadrature is not None and "tension_extremes" in request.outputs:
        raise scene_error("outputs", "tension_extremes", "none with quadrature, because they are computed on links")
    content = SceneContent.of(scene)
    p, several = content.parameters(), "member" in scene.dims
    if several:
        check_common_times(scene, times)
        check_members_of_field(wind, scene)
        warn_of_members(scene)
    else:
        warn_of_unusual(p)
    unit = unit_of(p, modes, rank=rank, order=order, law=law, quadrature=quadrature)
    used_tolerance = tolerance  # without one each member has its own
    if several:
        result = run(
            scene,
            modes,
            unit,
            Members(scene),
            request,
            lambda parameters: model_of(parameters, modes, rank=rank, order=order, law=law, quadrature=quadrature),
            progress,
        )
    else:
        title = str(scene.attrs.get("title", "scene"))
        warn_of_velocity_jump(p)
        check_axis(modes, np.diff(p.initial_ends, axis=0)[0])
        solution = solve(kept_model(unit, p), request, request.progress)
        attrs, used_tolerance = attributes_of(solution, modes, request), solution.tolerance
        result = dataset(solution.run.model, solution.state, attrs, request.outputs, title, request.links)
        warn_condensed_out_of_range(result.attrs)
    return request.record(
        result,
        function="condensed.simulate",
        inputs=[scene, modes] if wind is None else [scene, modes, wind],
        given={"rank": rank, "scheme": scheme},
        scene_digest=content.digest,
        rank=unit.rank,
        tolerance=used_tolerance,
        order=order,
        law=law,
        **({} if quadrature is None else {"quadrature": quadrature}),
        scheme=result.attrs.get("scheme", scheme),
        **({} if links is None else {"links": [int(number) for number in np.atleast_1d(links)]}),
    )


def check_links(links: Any, modes: xr.Dataset) -> np.ndarray:
    """Convert numbers of links, from 1, to indices, from 0."""
    most = modes.sizes["particle"] - 1
    try:
        numbers = np.atleast_1d(np.asarray(links))
    except (TypeError, ValueError):  # Datasets, lists of different lengths
        numbers = np.empty(0)
    if (
        numbers.ndim != 1
        or numbers.dtype.kind not in "iu"
        or not numbers.size
        or np.unique(numbers).size < numbers.size
    ):
        raise scene_error("links", links, f"different whole numbers from 1 to {most}")
    if numbers.min() < 1 or numbers.max() > most:
        raise scene_error("links", links, f"from 1, at the lower end, to {most}")
    return numbers - 1
