"""Public functions of prepared models: condensed models that a host program steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from cablepod._inputs import NORMAL_MODES, PREPARED, SCENE, taken
from cablepod.condensed._assembly import model_of
from cablepod.condensed._host import air_of_host
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._prepared_dataset import NO_ID, UNCHANGED, check_contents, stored_model
from cablepod.condensed._prepared_model import PreparedModel
from cablepod.discretisation._modal_damping import refuse_damping_ratios
from cablepod.discretisation._step_limit import verlet_step_limit
from cablepod.errors import SceneError, scene_error
from cablepod.integrate._output_times import preferred_steps_per_second
from cablepod.integrate._particle_air import OF_DRAG
from cablepod.integrate._request import check_step
from cablepod.integrate._step_control import STEPS_PER_CHANGE
from cablepod.parameters._from_scene import parameters as parameters_of
from cablepod.parameters._ice import ice_thickness
from cablepod.parameters._nonuniform import refuse_nonuniform
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._time_functions import TimeFunction
from cablepod.scene._warnings import warn_of_unusual
from cablepod.wind._drag import STEP_OVER_DRAG_LIMIT

#: Order of prepared models.
ORDER = "leading"
#: Motion that stands for an end moved by a host: the load pattern of its inertia belongs to the model.
AT_REST = TimeFunction("polynomial", {"coefficients": [0.0]})
#: Default step over the stability limit at rest: frequency errors of at most 0.3 %, in the highest mode.
STEP_OVER_LIMIT = 0.125


def prepare(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    rank: int | None = None,
    order: str = ORDER,
    step: float | None = None,
    wind: xr.Dataset | None = None,
) -> PreparedModel:
    """Prepare a condensed model for a host program that moves its upper end.

    Parameters
    ----------
    scene
        Scene of one cable with both ends held and steady uniform loads; its motions are those of :meth:`PreparedModel.run`.
    modes
        Modes of layout "normal", as for :func:`cablepod.condensed.simulate`.
    rank
        Number of modes of each deflection; all by default.
    order
        "leading", see :func:`cablepod.condensed.simulate`, which has others.
    step
        Step of :meth:`PreparedModel.run` [s]; by default an eighth of the stability limit at rest, or less where the motions of
        the scene are faster.
    wind
        Field of :func:`cablepod.wind.field`, or a record with the same variables, in place of mean wind and gusts of the scene,
        whose ramp, air density, drag and ice it has.

    Returns
    -------
    PreparedModel
        At rest at time 0, in the mean wind.

    Raises
    ------
    SceneError
        For point loads, load factors, ice, a given initial shape, a free end, viscous links, damping by the tension, members,
        and as :func:`cablepod.condensed.simulate`.

    Warns
    -----
    UnusualSceneWarning
        Of the worst that :func:`cablepod.summary` notes, as every run.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> modes = cp.pod.decompose(cp.chain.simulate(scene, tolerance=1e-3), layout="normal", rank=2)
    >>> guy = cp.condensed.prepare(scene, modes)
    >>> end = guy.end_position
    >>> force = guy.step(end + [0.001, 0.0], [0.1, 0.0], 0.01)
    >>> round(float(guy.time), 3), force.shape
    (0.01, (2,))
    >>> guy.run().amplitude.shape  # the motion of the scene
    (125, 2)
    """
    scene, modes = taken("scene", scene, SCENE), taken("modes", modes, NORMAL_MODES)
    model, limit = _checked_model(scene, modes, rank, order)
    air = air_of_host(model, wind)
    warn_of_unusual(parameters_of(scene))
    is_chosen = step is None
    if step is None:
        of_wind = np.inf if air is None else min(0.5 * air.air.interval, STEP_OVER_DRAG_LIMIT * air.step_limit)
        slowest = min(STEP_OVER_LIMIT * limit, model.chain.p.shortest_time_scale / STEPS_PER_CHANGE, of_wind)
        step = 1.0 / preferred_steps_per_second(1.0 / slowest)
    else:
        step = check_step(step, limit, f"2 over the highest angular frequency, {2.0 / limit:.6g} rad/s")
        if air is not None:
            check_step(step, air.step_limit, OF_DRAG)
    return PreparedModel(scene, modes, model, step, wind, step_is_chosen=is_chosen)


def _checked_model(scene: xr.Dataset, modes: xr.Dataset, rank: int | None, order: str) -> tuple[CondensedModel, float]:
    """Return model and stability limit at rest [s]; refuse what prepared models lack."""
    if not isinstance(order, str) or order != ORDER:
        raise scene_error("order", order, f'"{ORDER}"; try: condensed.simulate')
    p = parameters_of(scene)
    _check_scene(p)
    moving = p if p.motions else replace(p, motions={("upper", "y"): AT_REST})
    model = model_of(moving, modes, rank=rank, order=order, law="linear")
    q, v = model.initial_state
    tension = model.force(q, v, model.static_boundary_data)[2]
    return model, float(verlet_step_limit(np.sqrt(model.omega_max_squared(q, model.static_boundary_data, tension))))


def _check_scene(p: Parameters) -> None:
    """Refuse scenes with terms that prepared models lack."""
    if p.point_loads:
        raise scene_error(p.point_loads[0].key, "a point load", "uniform loads only; try: condensed.simulate")
    if p.load_factor is not None:
        raise scene_error("load.kind", p.load_factor.kind, "steady uniform loads only; try: condensed.simulate")
    if ice_thickness(p):
        raise scene_error("ice.thickness", ice_thickness(p), "0 m; try: condensed.simulate")
    if p.tension_damping is not None:
        raise scene_error("damping.tension_proportional", p.tension_damping, "none; try: condensed.simulate")
    refuse_damping_ratios(p, "condensed.simulate, or damping.mass_proportional")
    refuse_nonuniform(p, "condensed.simulate")
    if p.initial:
        key = f"initial.{next(iter(p.initial))}"
        raise scene_error(key, "a start from another shape", "a start from equilibrium; try: condensed.simulate")


def resume(dataset: xr.Dataset, *, wind: xr.Dataset | None = None) -> PreparedModel:
    """Return the prepared model of a Dataset, which goes on from its state bit by bit.

    Parameters
    ----------
    dataset
        Result of :meth:`PreparedModel.dataset`, also read from a file.
    wind
        The field that was given to :func:`prepare`, which the Dataset does not contain.

    Returns
    -------
    PreparedModel
        With the time and the state of the Dataset.

    Raises
    ------
    SceneError
        For a Dataset that is no prepared model, or one whose variables were altered.
    """
    try:
        return _resumed(dataset, wind)
    except SceneError:
        raise
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        # of variables and attributes that are not those of any prepared model
        raise scene_error("dataset", f"contents with {error!r}", UNCHANGED) from error


def _resumed(dataset: xr.Dataset, wind: xr.Dataset | None) -> PreparedModel:
    """Return the prepared model of a Dataset, see :func:`resume`."""
    dataset = taken("dataset", dataset, PREPARED)
    stored = stored_model(dataset)
    scene, modes = taken("scene", stored.scene, SCENE), taken("modes", stored.modes, NORMAL_MODES)
    model, limit = _checked_model(scene, modes, stored.rank, stored.order)
    if (wind is None) != (stored.wind == ""):
        given, allowed = ("missing", "that given") if wind is None else ("given", "none, as none was given")
        raise SceneError(f"wind: {given}; allowed: {allowed} to `prepare`")
    if wind is not None and wind.attrs.get("id", NO_ID) != stored.wind:
        raise scene_error("wind", wind.attrs.get("id", NO_ID), f"the field with the id {stored.wind}")
    step = check_step(stored.step, limit, "as at `prepare`")
    chosen, coefficients = stored.step_is_chosen, stored.coefficients
    prepared = PreparedModel(scene, modes, model, step, wind, step_is_chosen=chosen, stored=coefficients)
    prepared.state = stored.state
    check_contents(dataset, prepared)
    return prepared
