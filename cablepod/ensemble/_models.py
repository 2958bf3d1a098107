"""Models that an ensemble can run, and their options."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod import cable, chain, condensed, galerkin, rigid
from cablepod.errors import scene_error

MODELS: dict[str, Callable[..., xr.Dataset]] = {
    "chain": chain.simulate,
    "cable": cable.simulate,
    "rigid": rigid.simulate,
    "galerkin": galerkin.simulate,
    "condensed": condensed.simulate,
}
REDUCED = ("galerkin", "condensed")


def options_of(model: str) -> dict[str, Any]:
    """Return the options of a model's ``simulate`` that an ensemble may have, with their defaults."""
    own = inspect.signature(MODELS[model]).parameters.values()
    return {item.name: item.default for item in own if item.kind is item.KEYWORD_ONLY and item.name != "progress"}


def check_model(model: Any, modes: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """Check the names of a model and of its options; returns the options, defaults filled in, as a file holds them.

    Raises
    ------
    SceneError
        Naming what was given and what is allowed.
    """
    if not isinstance(model, str) or model not in MODELS:
        raise scene_error("model", model, "one of " + ", ".join(f'"{name}"' for name in MODELS))
    if model in REDUCED and not isinstance(modes, xr.Dataset):
        raise scene_error(
            "modes", modes, f'the Dataset of modes that model "{model}" runs on, as pod.decompose gives it'
        )
    if model not in REDUCED and modes is not None:
        raise scene_error("modes", "a value", f'none for model "{model}"; they are for {" and ".join(REDUCED)}')
    known = options_of(model)
    for name in options:
        if name not in known:
            raise scene_error(f"option {name}", options[name], f'an option of model "{model}": {", ".join(known)}')
    return {name: _plain(name, options.get(name, default)) for name, default in known.items()}


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, xr.DataArray | np.ndarray):
        value = np.asarray(value).tolist()
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple):
        return [_plain(name, item) for item in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise scene_error(name, value, "a number, a text or a list of them")
