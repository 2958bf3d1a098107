"""The paper's reduced model, eqs. (34)-(36): modes + scene -> trajectory."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import xarray as xr

from cablepod import provenance
from cablepod._resources import check_memory
from cablepod.batch._members import over_members
from cablepod.conventions import OUTPUTS
from cablepod.errors import NotConvergedWarning
from cablepod.galerkin._estimate import estimate
from cablepod.galerkin._explicit import ExplicitGalerkinRun
from cablepod.galerkin._implicit import ImplicitGalerkinRun
from cablepod.galerkin._model import GalerkinModel, model_of
from cablepod.galerkin._runs import GalerkinRun, GalerkinTrajectory
from cablepod.galerkin._scheme import SCHEMES, choose_scheme, refine_in_time
from cablepod.integrate._request import Request, check_step, implicit_steps_per_second
from cablepod.parameters._from_scene import parameters
from cablepod.reduced._training_distance import distance_outside_training
from cablepod.reduced._validity import forcing_attributes, warn_galerkin_out_of_range

#: Share of the exchanged energy that a given step may make or lose.
UNEXPLAINED = 0.1


@over_members
def simulate(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    rank: int | None = None,
    times: Any = None,
    law: str = "green",
    scheme: str | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position", "error_estimate"),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the extensible cable of a scene on Karhunen-Loeve modes.

    Parameters
    ----------
    scene
        A scene with both ends held, with or without ``member``; it need not be the one the modes come from.
    modes
        What :func:`cablepod.pod.decompose` gives; they are carried over by sigma = S / L0.
    rank
        Number of modes (of each coordinate where they are separate); all by default.
    times
        Instants of the output [s], rising from 0 on; by default those of the scene.
    law
        "green": eq. (21), T / xi = K (xi^2 - 1) / 2, a polynomial whose coefficients are computed once where that is faster: then
        the cost of a step does not depend on the number of particles.  Few particles are evaluated link by link.  It resists
        compression, where a cable goes slack.  "linear": the chain's law, always link by link.
    scheme
        By default picked by `tolerance`; the attribute ``choice_of_scheme`` says why.  "velocity_verlet" is explicit: its step
        follows the fastest axial mode.  Implicit, stable at any step as far as linear theory goes, so that steps may follow the
        transverse motion, are "trapezoidal" (average acceleration) and "energy_momentum" (Simo and Tarnow; keeps the energy, by
        both laws).
    step
        Time step [s].  By default it follows from the highest frequency of the model, or of the transverse vibration where
        implicit, and is shortened until two runs agree within `tolerance`; with a given step there is one run and no such check.
    tolerance
        Wanted time error as a fraction of the largest rms displacement; 1e-6 by default.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps), "error_estimate" (of the model, see
        :func:`cablepod.galerkin._estimate.estimate`; it takes about as long as a run); nothing else is computed.
    progress
        Called now and then with the part of the run that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``amplitude (time, coordinate, mode)`` or ``(time, mode)`` [m], ``end_position`` [m] and the outputs asked for, on the
        particles of the modes.  Attributes say how far to trust it: ``smallest_stretch``, the least xi met at the instants of the
        output, ``forcing_over_axial_frequency``, ``energy_share_kept`` of the snapshots (the least over the coordinates),
        ``outside_training``, see :mod:`cablepod.reduced`; ``error_estimate`` is the largest error to be expected over
        time, as a fraction of the motion, not a number where there is no estimate; ``time_error_estimate`` is the part of the
        steps in it.
        ``energy_defect`` is the largest kinetic and strain energy, at the steps at or beside the instants of the output, that is
        not explained by the start, the work of loads and of the ends, and damping,
        over the largest of these terms (kinetic energy, change of strain energy, works, dissipation): some 1e-15 to 1e-12 for
        "energy_momentum", of second order in the step for the others, and no estimate of the error of the motion.  Implicit runs
        add ``newton_iterations`` and ``steps_cut``: a step in which Newton's method fails is cut.

    Raises
    ------
    SceneError
        For options that cannot be, a scene with a free end, a step above the stability limit.
    RunStopped
        Where the motion leaves the finite numbers, Newton's method does not converge, or the highest frequency outgrows a given
        explicit step; its ``partial`` holds what was computed until then.

    Warns
    -----
    NotConvergedWarning
        Where no step meets the tolerance, and where a given step leaves much energy that nothing explains, or does not resolve
        how the ends or the loads move.
    OutOfRangeWarning
        Where a link is compressed, loads or ends change nearly as fast as waves run along the cable in a scene unlike those of
        the snapshots, or the error to be expected is as large as the motion, or nearly.

    Notes
    -----
    Lifting by the motion of the ends, strain taken link by link as in the chain, masses of the chain, whatever layout and weights
    the modes have.  What is stepped are mass-weighted projections of the particles themselves, not of what the lifting leaves:
    with all modes each scheme is then that of the chain to rounding, also where an end starts with a jump of its speed.  A run
    from equilibrium starts from the model's own.

    Kinetic energy and work of the ends count that part of the lifting which the modes can represent; what is left of it moves as
    the ends prescribe, and exchanges nothing with the modes.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> chain = cp.chain.simulate(scene)
    >>> model = cp.galerkin.simulate(scene, cp.pod.decompose(chain), rank=2)
    >>> round(100 * float(cp.compare.errors(model, chain).error_max), 2)  # per cent
    0.04
    """
    request = Request.of(
        times=times,
        scheme=scheme,
        schemes=SCHEMES,
        step=step,
        tolerance=tolerance,
        outputs=outputs,
        allowed=(*OUTPUTS, "error_estimate"),
    )
    p = parameters(scene)
    model = model_of(p, modes, rank=rank, law=law)
    instants = request.instants(p)
    check_memory(instants.size, model.chain.links, p.dims, key="times", variables=3)
    q0 = model.initial()
    highest = model.highest_frequency(q0, 0.0)
    # few modes may start where nothing pulls them back; stiffer than the chain they never are
    limit = 2.0 / highest if highest > 0.0 else model.chain.step_limit()
    runs: dict[str, GalerkinRun] = {
        name: (ExplicitGalerkinRun if name == SCHEMES[0] else ImplicitGalerkinRun)(
            model, instants, q0, request.outputs, progress, scene, modes, name
        )
        for name in SCHEMES
    }
    run, reason = runs[scheme or SCHEMES[0]], "given"
    if step is not None:
        if run.scheme == SCHEMES[0]:
            why = f"2 over the highest angular frequency, {2 / limit:.6g} rad/s; implicit schemes have none"
            rate = 1.0 / check_step(step, limit, why)
        else:
            rate = implicit_steps_per_second(step, float(instants[-1]), p.shortest_time_scale)
        state, time_error = run(rate), None
        _check_energy(state, run.scheme)
    elif scheme is not None:
        state, rate, time_error = refine_in_time(run, limit, request.tolerance)
    else:
        run, (state, rate, time_error), reason = choose_scheme(
            runs, limit, request.tolerance, asked=tolerance is not None
        )
    result = run.dataset(state)
    result.attrs.update(step_limit=limit, choice_of_scheme=reason, **_trust(model, modes, result))
    if time_error is not None:
        result.attrs["time_error_estimate"] = time_error
    if "error_estimate" in request.outputs:
        expected = estimate(model, run.sample, rate, float(instants[-1]))
        result.attrs["error_estimate"] = (time_error or 0.0) + expected
    warn_galerkin_out_of_range(result.attrs)
    options = {
        "rank": len(model.modes) // (p.dims if model.layout == "separate" else 1),
        "times": instants,
        "law": law,
        "scheme": run.scheme,
        "step": 1.0 / rate,
        "tolerance": request.recorded_tolerance,
        "outputs": list(request.outputs),
    }
    return provenance.record(
        result,
        function="galerkin.simulate",
        parameters=options,
        inputs=[scene, modes],
        chosen=provenance.defaulted_options(rank=rank, times=times, scheme=scheme, step=step, tolerance=tolerance),
    )


def _trust(model: GalerkinModel, modes: xr.Dataset, result: xr.Dataset) -> dict[str, Any]:
    """Tell what says how far a run can be trusted."""
    p, length = model.chain.p, model.chain.total_length
    notes = {name: float(value) for name, value in forcing_attributes(p, length).items()}
    if "energy_share" in modes:
        share = modes["energy_share"].isel(mode=slice(result.sizes["mode"])).sum("mode")
        notes["energy_share_kept"] = float(share.min())
    return notes | distance_outside_training(modes, p, length, float(result["time"].values[-1]))


def _check_energy(state: GalerkinTrajectory, scheme: str) -> None:
    defect = state.diagnostics["energy_defect"]
    if defect > UNEXPLAINED:
        warnings.warn(
            f"{defect:.2g} of the energy that is exchanged comes from nowhere (energy_defect, {scheme}): the step is too long "
            "for what moves; give a shorter one, scheme energy_momentum, or a tolerance instead of a step",
            NotConvergedWarning,
            stacklevel=4,
        )
