"""Reduced model that is quasi-static along the chord: modes for the deflection normal to it, one tension for all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.batch._members import values_of_members
from cablepod.condensed._assembly import model_of
from cablepod.condensed._batch import run
from cablepod.condensed._output import result_of
from cablepod.condensed._runs import SCHEMES, CondensedRequest, solve
from cablepod.conventions import OUTPUTS
from cablepod.errors import scene_error
from cablepod.parameters._from_scene import Members
from cablepod.reduced._validity import warn_condensed_out_of_range


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
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the cable of a scene, quasi-static along its chord, on modes of the deflection normal to it.

    Parameters
    ----------
    scene
        A scene with both ends held; it need not be the one the modes come from.  Members of a scene with ``member`` run side by
        side; those that fail hold nan and say why in ``failure``.
    modes
        What :func:`cablepod.pod.decompose` gives with layout "normal"; they are carried over by sigma = S / L0.  They test the
        equations too, unless they bring test functions of their own, from :func:`cablepod.oblique.train`.
    rank
        Number of modes of each deflection; all by default.
    times
        Instants of the output [s], rising from 0 on; by default those of the scene.
    order
        "leading": closure and force to first order in strain and slope squared, a step costs a product of r by r; "exact": the
        chordwise stretch at each link as it is, the tension from Newton's method; "inertial": exact, with the inertia of the
        motion along the chord that the deflection brings with it.
    law
        "linear", the chain's law; with orders "exact" and "inertial" also "green", eq. (21).
    quadrature
        With orders "exact" and "inertial": evaluate the chordwise stretch at so many points of a Gauss-Lobatto rule along the
        cable instead of on each link, at a cost that does not depend on the links.  It nears the continuous cable, not the chain;
        some eight do for four smooth modes, sixteen for eight.  Not with point loads, nor for extremes of tension.
    scheme
        "velocity_verlet" is explicit, "trapezoidal" implicit and stable at any step.  By default explicit, unless the stretching
        of the sag makes its steps short.
    step
        Time step [s]; by default it is shortened until two runs agree within `tolerance`.
    tolerance
        Wanted time error as a fraction of the largest rms displacement; 1e-6 by default.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps), "error_estimate" (of the model, see
        :func:`cablepod.condensed._estimate.estimate`; it takes longer than the run itself); nothing else is computed.
    links
        Numbers, from 1 at the lower end, of the links whose tensions are given; all by default.
    progress
        Called now and then with the part of the run that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``amplitude (time, mode)`` [m], in space also ``amplitude_out_of_plane``, ``end_position`` [m] and the outputs asked for,
        on the particles of the modes.  Attributes say scheme, step [s], number of steps, ``step_limit`` [s] of explicit steps,
        and how far the run stayed from where the model fails: ``smallest_chordwise_force`` [N] over all steps,
        ``forcing_over_axial_frequency``, ``energy_share_kept`` of the snapshots by the modes, ``outside_training``, how far the
        scene lies from those of the snapshots, see :mod:`cablepod.reduced`; ``error_estimate`` is the largest error to
        be expected over time, as a fraction of the motion, ``time_error_estimate`` the part of the steps in it; with trained
        test functions ``growth_over_run``, by which power of e small vibrations about rest would grow.

    Raises
    ------
    SceneError
        For options that cannot be, modes of another layout, a scene with a free end, a step above the stability limit.
    RunStopped
        Where the motion leaves the finite numbers, its frequencies outgrow a given step, or Newton's method fails.

    Warns
    -----
    OutOfRangeWarning
        Where the chordwise force becomes negative somewhere (the model is then ill-posed, a real cable goes slack there), or the
        ends move as fast as waves along the cable, or vibrations about rest would grow, or the model expects an error above half
        of the motion.
    NotConvergedWarning
        Where no step meets the tolerance, and where a given one does not resolve how the ends or the loads move.

    Notes
    -----
    mu w'' = (N w' / zeta')' + p.n - mu (c0'' + S/L0 c'').n for the deflection w normal to the chord c, with N = H(t) + tau(S),
    tau' = -p.e + mu (c0'' + S/L0 c'').e, and H from the closure, that the stretch zeta' along the chord adds up to |c|
    (dashes of w and zeta by S, of c by time).  An idea of Irvine and Caughey (1974) with modes from snapshots.  Left out are the
    turning of the chord as far as it acts on the deflection itself and, but for order "inertial", inertia of what moves along
    the chord relative to it.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> modes = cp.pod.decompose(cp.chain.simulate(scene), layout="normal", rank=2)
    >>> model = cp.condensed.simulate(scene, modes)
    >>> round(100 * model.attrs["error_estimate"], 2)  # per cent, without knowing the truth
    0.02
    """
    request = CondensedRequest.of(
        times=times,
        scheme=scheme,
        schemes=SCHEMES,
        step=step,
        tolerance=tolerance,
        outputs=outputs,
        allowed=(*OUTPUTS, "error_estimate"),
        links=None if links is None else check_links(links, modes),
    )
    if quadrature is not None and "tension_extremes" in request.outputs:
        raise scene_error("outputs", "tension_extremes", "without quadrature, as they are those of links")
    members = Members(scene)
    p = members[0]
    model = model_of(p, modes, rank=rank, order=order, law=law, quadrature=quadrature)
    if "member" in scene.dims:
        result = run(
            scene,
            modes,
            model,
            members,
            request,
            lambda other: model_of(other, modes, rank=rank, order=order, law=law, quadrature=quadrature),
            progress,
        )
    else:
        title = str(scene.attrs.get("title", "scene"))
        result = result_of(solve(model, request, progress), modes, request, title)
        warn_condensed_out_of_range(result.attrs)
    record = {
        "rank": model.rank,
        "times": p.times() if request.times is None else request.times,
        "order": order,
        "law": law,
        **({} if quadrature is None else {"quadrature": quadrature}),
        "scheme": result.attrs.get("scheme", scheme),
        "step": result.attrs.get("step", step),
        "tolerance": request.recorded_tolerance,
        "outputs": list(request.outputs),
        **({} if links is None else {"links": [int(item) for item in links]}),
        **(values_of_members(scene) if "member" in scene.dims else {}),
    }
    return provenance.record(
        result,
        function="condensed.simulate",
        parameters=record,
        inputs=[scene, modes],
        chosen=provenance.defaulted_options(rank=rank, times=times, scheme=scheme, step=step, tolerance=tolerance),
    )


def check_links(links: Any, modes: xr.Dataset) -> np.ndarray:
    """Return the indices, from 0, of links by their numbers, from 1."""
    most = modes.sizes["particle"] - 1
    numbers = np.atleast_1d(np.asarray(links))
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
