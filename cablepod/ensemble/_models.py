"""Models of an ensemble, and checks of their options."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod import cable, chain, condensed, galerkin, mast, rigid
from cablepod.condensed._runs import MAX_TOLERANCE
from cablepod.errors import SceneError, one_of, scene_error
from cablepod.integrate._request import DEFAULT_TOLERANCE
from cablepod.scene._mast import MAST_SCENE, scene_kind

#: Name of a model -> its function.
MODELS: Mapping[str, Callable[..., xr.Dataset]] = {
    "chain": chain.simulate,
    "cable": cable.simulate,
    "rigid": rigid.simulate,
    "galerkin": galerkin.simulate,
    "condensed": condensed.simulate,
    "mast": mast.simulate,
}
#: Models that need modes, and those that may have them.
REDUCED, WITH_MODES = ("galerkin", "condensed"), ("galerkin", "condensed", "mast")


def options_of(model: str) -> dict[str, Any]:
    """Return the options of a model's ``simulate``, except ``progress``, with their defaults."""
    arguments = inspect.signature(MODELS[model]).parameters.values()
    return {arg.name: arg.default for arg in arguments if arg.kind is arg.KEYWORD_ONLY and arg.name != "progress"}


def accepted_time_error(model: str, options: Mapping[str, Any]) -> float:
    """Return the time error, as a fraction of the motion, above which a member counts as not converged.

    It is the given tolerance, or the default one of full models.  Reduced models choose their own, at most MAX_TOLERANCE.
    """
    if options.get("tolerance") is not None:
        return float(options["tolerance"])
    return MAX_TOLERANCE if model in REDUCED else DEFAULT_TOLERANCE


def check_model(model: Any, modes: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """Check a model, its modes and the names of its options; return all options as JSON values.

    Raises
    ------
    SceneError
        For an unknown model or option, or missing or superfluous modes.
    """
    if not isinstance(model, str) or model not in MODELS:
        raise scene_error("model", model, one_of(MODELS, model))
    if model in REDUCED and not isinstance(modes, xr.Dataset):
        raise scene_error("modes", modes, f'the Dataset of modes for model "{model}", a result of pod.decompose')
    if model not in WITH_MODES and modes is not None:
        raise scene_error("modes", "a value", f'none for model "{model}"; only {", ".join(WITH_MODES)} use modes')
    if model == "mast" and not (modes is None or isinstance(modes, xr.Dataset)):
        raise scene_error("modes", modes, "the Dataset of modes of the guys, or none")
    known = options_of(model)
    for name in options:
        if name not in known:
            raise scene_error(f"option {name}", options[name], f'an option of model "{model}": {", ".join(known)}')
    if known.get("outputs") and model != "mast" and options.get("quadrature") is None:
        known = {**known, "outputs": (*known["outputs"], "tension_extremes")}  # what an ensemble is mostly made for
    return {name: _to_json(name, options.get(name, default)) for name, default in known.items()}


def check_scene_of_model(scenes: xr.Dataset, model: str) -> None:
    """Refuse the model of a mast for a scene of one cable, and other models for a scene with a mast.

    Raises
    ------
    SceneError
        Names ``model``.
    """
    with_mast = scene_kind(scenes) is MAST_SCENE
    if model in MODELS and (model == "mast") != with_mast:
        of = "a scene with [mast]" if with_mast else "a scene of one cable, without [mast]"
        allowed = '"mast"' if with_mast else ", ".join(f'"{name}"' for name in MODELS if name != "mast")
        raise SceneError(f'model: given "{model}" for {of}; allowed: {allowed}')


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
