"""Public function of the Galerkin model, eqs. (34)-(36) of the paper: modes and scene to trajectory."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import xarray as xr

from cablepod._inputs import FIELD_MODES, taken
from cablepod._resources import ARRAYS_OF_RUN, check_memory
from cablepod.batch._members import no_plan, over_members_by
from cablepod.conventions import OUTPUTS
from cablepod.discretisation._laws import LAWS, law_of
from cablepod.discretisation._step_limit import verlet_step_limit
from cablepod.errors import NotConvergedWarning, warn
from cablepod.galerkin._assembly import model_of
from cablepod.galerkin._estimate import estimate_of
from cablepod.galerkin._explicit import ExplicitGalerkinRun
from cablepod.galerkin._implicit import ImplicitGalerkinRun
from cablepod.galerkin._model import GalerkinModel
from cablepod.galerkin._runs import GalerkinRun
from cablepod.galerkin._scheme import EXPLICIT, SCHEMES, solve
from cablepod.integrate._request import REDUCED_TOLERANCE, Request
from cablepod.integrate._velocity_jump import warn_of_members, warn_of_velocity_jump
from cablepod.parameters._from_scene import SceneContent
from cablepod.reduced._training_distance import distance_outside_training
from cablepod.reduced._validity import (
    energy_attributes,
    forcing_attributes,
    law_attributes,
    warn_galerkin_out_of_range,
)
from cablepod.scene._warnings import warn_of_unusual

#: Maximum energy defect of a given step without a warning, as a fraction of the exchanged energy.
MAX_ENERGY_DEFECT = 0.1


@over_members_by(no_plan, warn_of_members)
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
    window: tuple[float, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the extensible cable of a scene by Galerkin projection on Karhunen-Loeve modes.

    Parameters
    ----------
    scene
        A scene with both ends held, with or without ``member``.  The modes may come from another scene.
    modes
        Result of :func:`cablepod.pod.decompose`; modes are functions of sigma = S / L0.
    rank
        Number of modes (of each coordinate if they are separate); all by default.
    times
        Output instants [s], increasing from 0; by default those of the scene.
    law
        "green": eq. (21), T / xi = K (xi^2 - 1) / 2.  The energy is then a polynomial in the amplitudes.  Its coefficients are
        computed once if that is faster, and the cost of a step does not depend on the number of particles.  A cable that goes
        slack resists compression.  "linear": the law of the chain, always evaluated as a sum over links.
    scheme
        By default "filtered_verlet", or chosen by `tolerance` if that is given; the attribute ``choice_of_scheme`` states the
        reason.  "velocity_verlet" is explicit; its step is limited by the fastest axial mode.  "filtered_verlet" is explicit too,
        but slows the vibrations that its step does not resolve: steps may follow the transverse motion, and cost as little.
        "trapezoidal" (average acceleration) is implicit and unconditionally stable in linear theory.
    step
        Time step [s].  A given step is run once, without a check of its error.
    tolerance
        Tolerance of the time error, as a fraction of the largest rms displacement: the step is shortened until two runs agree
        within it.  If neither `scheme`, `step` nor `tolerance` is given, it is a tenth of the error that the model expects of its
        modes (``error_estimate``), and at least 1e-6; where that has no estimate, and with a given scheme, it is 1e-6.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps, with time and place of the largest and
        smallest, so that "tension_peaks" adds nothing), "tension_mean", "tension_rms" (time mean and root mean square of each
        link, by the trapezoidal rule over all steps, in runs of more than 32768 steps over equal intervals of several steps)
        and "error_estimate" (of the model, from samples of the run, see
        :class:`cablepod.galerkin._estimate.GalerkinEstimate`).
        Extremes are of the steps: output times between two of them do not count.
    window
        Start and end [s] of the part of the run over which extremes and means are taken; all of it by default.
    progress
        Callback receiving the completed fraction, which never falls and ends at 1.

    Returns
    -------
    xarray.Dataset
        ``amplitude (time, coordinate, mode)`` or ``(time, mode)`` [m], ``end_position`` [m] and the requested outputs on the
        particles of the modes.  Attributes that describe the validity:

        - ``smallest_stretch``, ``largest_stretch``: minimum and maximum stretch xi at the output instants,
        - ``forcing_over_axial_frequency``, ``outside_training``: see :mod:`cablepod.reduced`,
        - ``energy_share_kept``: fraction of the energy of the snapshots in these modes, minimum over the coordinates that move,
        - ``error_estimate``: estimate of the largest error over time, as a fraction of the motion; nan if there is none.  It is
          that of the modes, of the law and of the step, against the chain of the same links by the law of the snapshots
          (attribute ``law`` of the modes; the linear law, the default of :func:`cablepod.chain.simulate`, where it is unknown),
        - ``tension_above_linear_law`` (law "green"): tension at the largest stretch over that of the linear law, less 1,
        - ``time_error_estimate``: contribution of the step to that error,
        - ``energy_defect``: largest violation of the energy balance (kinetic and strain energy, work of loads and ends,
          dissipation) at the steps beside the output instants, over the largest of these terms.  It is of second order in the
          step.  It does not estimate the error of the motion,
        - ``newton_iterations``, ``steps_cut`` (scheme "trapezoidal"): total iterations, and steps repeated with substeps.

    Raises
    ------
    SceneError
        For invalid options, a scene with a free end, or a step above the stability limit.
    RunStopped
        If the motion diverges, Newton's method does not converge, or the stability limit falls below a given explicit step.  Its
        ``partial`` holds the output until then.

    Warns
    -----
    NotConvergedWarning
        If no step meets the tolerance, or if a given step violates the energy balance or does not resolve the motion of the ends
        or the loads.
    OutOfRangeWarning
        If a link is compressed, if the laws differ by more than 5 % of the tension at the largest stretch and `law` is "green",
        if loads or ends change nearly as fast as axial waves and the scene lies outside the training range, or if the estimated
        error is comparable to the motion.
    VelocityJumpWarning
        If an end starts from rest with a nonzero speed along the cable; see the key ``ramp`` of motions.

    Notes
    -----
    The motion of the ends is a linear lifting.  Strains and masses are those of the chain, whatever layout and weights the modes
    have.  The scheme integrates the mass-weighted projections of the particles, not of the motion relative to the lifting.  With
    all modes each scheme therefore equals that of the chain to rounding, even if an end starts with a velocity jump.  A run
    without initial shape starts from the equilibrium of the model.

    Kinetic energy and work of the ends include the part of the lifting that the modes can represent.  The remainder is
    prescribed and exchanges no energy with the modes.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> chain = cp.chain.simulate(scene)
    >>> model = cp.galerkin.simulate(scene, cp.pod.decompose(chain), rank=2)
    >>> round(100 * float(cp.compare.errors(model, chain).error_max), 2)  # per cent
    0.04
    """
    modes = taken("modes", modes, FIELD_MODES)
    request = Request.of(
        times=times,
        scheme=scheme,
        schemes=SCHEMES,
        step=step,
        tolerance=tolerance,
        default_tolerance=REDUCED_TOLERANCE,
        window=window,
        outputs=outputs,
        allowed=(*OUTPUTS, "error_estimate"),
        progress=progress,
    )
    content = SceneContent.of(scene)
    p = content.parameters()
    warn_of_unusual(p)
    model = model_of(p, modes, rank=rank, law=law)
    instants = request.instants(p)
    check_memory(instants.size, model.chain.links, p.dims, key="times", variables=ARRAYS_OF_RUN)
    squared = model.initial_vibrations[0][-1]
    # few modes may have no stiffness at the start, but they are never stiffer than the chain
    limit = verlet_step_limit(math.sqrt(squared)) if squared > 0.0 else model.chain.step_limit()
    estimate = estimate_of(model, float(instants[-1]), law_of(modes.attrs) or LAWS[0])
    wanted = "error_estimate" in request.outputs
    runs: dict[str, GalerkinRun] = {
        name: (ExplicitGalerkinRun if name in EXPLICIT else ImplicitGalerkinRun)(
            model, model.initial, scene, modes, name, estimate.sample_interval, wanted, **request.of_run(instants)
        )
        for name in SCHEMES
    }
    explicit_limit = limit if scheme in (None, SCHEMES[0]) else None
    formula = f"2 over the highest angular frequency, {2 / limit:.6g} rad/s; scheme trapezoidal has none"
    given_steps_per_second = request.steps_per_second(p, float(instants[-1]), explicit_limit, formula)
    warn_of_velocity_jump(p)
    solution, time_tolerance, model_error = solve(runs, limit, request, given_steps_per_second, estimate.error)
    run, trajectory, _, time_error = solution[:4]
    if step is not None:
        _warn_of_energy_defect(trajectory.energy_defect, run.scheme)
    result = run.dataset(trajectory)
    result.attrs.update(step_limit=limit, **solution.attributes, **_validity_attributes(model, modes, result))
    if wanted:
        model_error = estimate.error(trajectory) if model_error is None else model_error
        result.attrs["error_estimate"] = (time_error or 0.0) + model_error
    warn_galerkin_out_of_range(result.attrs)
    return request.record(
        result,
        function="galerkin.simulate",
        inputs=[scene, modes],
        given={"rank": rank, "scheme": scheme},
        scene_digest=content.digest,
        rank=result.attrs["rank"],
        law=law,
        scheme=run.scheme,
        tolerance=time_tolerance,
    )


def _validity_attributes(model: GalerkinModel, modes: xr.Dataset, result: xr.Dataset) -> dict[str, Any]:
    """Return the attributes that compare a run with the range of validity and the training range."""
    p, length = model.chain.p, model.chain.total_length
    attributes = {name: float(value) for name, value in forcing_attributes(p, length).items()}
    attributes |= law_attributes(model.chain.law, result.attrs["largest_stretch"])
    attributes |= energy_attributes(modes, result.sizes["mode"])
    return attributes | distance_outside_training(modes, p, length, float(result.variables["time"].values[-1]))


def _warn_of_energy_defect(defect: float, scheme: str) -> None:
    """Warn if a given step violates the energy balance too much."""
    if defect > MAX_ENERGY_DEFECT:
        warn(
            f"energy balance violated by {100.0 * defect:.2g} % of the exchanged energy (energy_defect, {scheme}): the step is "
            "too long for the motion; give a shorter step, or a tolerance instead of a step",
            NotConvergedWarning,
        )
