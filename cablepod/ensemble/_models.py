"""Models of an ensemble, and checks of their options."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod._models import MODELS, Model, model_of
from cablepod.condensed._runs import MAX_TOLERANCE
from cablepod.errors import SceneError, scene_error
from cablepod.integrate._request import DEFAULT_TOLERANCE
from cablepod.scene._mast import MAST_SCENE, scene_kind


def accepted_time_error(model: Model, options: Mapping[str, Any]) -> float:
    """Return the time error, as a fraction of the motion, above which a member counts as not converged.

    It is the given tolerance, or the default one of full models.  Reduced models choose their own, at most MAX_TOLERANCE.
    """
    if options.get("tolerance") is not None:
        return float(options["tolerance"])
    return MAX_TOLERANCE if model.layout is not None else DEFAULT_TOLERANCE


def check_model(given: Any, modes: Any, options: Mapping[str, Any]) -> tuple[Model, dict[str, Any]]:
    """Check a model, its modes and the names of its options; return the model, and all options as JSON values.

    Raises
    ------
    SceneError
        For an unknown model or option, or missing or superfluous modes.
    """
    model = model_of(given)
    if model.modes == "needed" and not isinstance(modes, xr.Dataset):
        raise scene_error("modes", modes, f'the Dataset of modes for model "{model.name}", a result of pod.decompose')
    if model.modes == "none" and modes is not None:
        users = ", ".join(name for name, other in MODELS.items() if other.modes != "none")
        raise scene_error("modes", "a value", f'none for model "{model.name}"; only {users} use modes')
    if not (modes is None or isinstance(modes, xr.Dataset)):
        raise scene_error(
            "modes", modes, "the Dataset of modes of the guys, or none" if model.of_mast else "a Dataset of modes"
        )
    known = model.options()
    check_option_names(model, options, known)
    if known.get("outputs") and not model.of_mast and not model.own and options.get("quadrature") is None:
        known = {**known, "outputs": (*known["outputs"], "tension_extremes")}  # what an ensemble is mostly made for
    return model, {name: _to_json(name, options.get(name, default)) for name, default in known.items()}


def check_option_names(model: Model, options: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse options that are none of the `known` ones of a model.

    Raises
    ------
    SceneError
        Names the option.
    """
    for name, value in options.items():
        if name not in known:
            raise scene_error(f"option {name}", value, f'an option of model "{model.name}": {", ".join(known)}')


def check_scene_of_model(scenes: xr.Dataset, model: Model) -> None:
    """Refuse the model of a mast for a scene of one cable, and other models for a scene with a mast.

    Raises
    ------
    SceneError
        Names ``model``.
    """
    with_mast = scene_kind(scenes) is MAST_SCENE
    if model.of_mast != with_mast:
        of = "a scene with [mast]" if with_mast else "a scene of one cable, without [mast]"
        allowed = ", ".join(f'"{name}"' for name, other in MODELS.items() if other.of_mast == with_mast)
        raise SceneError(f'model: given "{model.name}" for {of}; allowed: {allowed}')


def _to_json(name: str, value: Any) -> Any:
    """Return an option as a number, text or list of them."""
    if isinstance(value, xr.DataArray | np.ndarray):
        value = np.asarray(value).tolist()
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple):
        return [_to_json(name, entry) for entry in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise scene_error(name, value, "a number, a text or a list of them")
