"""The table of models, which ensembles, studies, commands, figures and lineage read, and models of a user's own.

A model is a function from a scene, and modes where it takes any, to a trajectory Dataset.  It is known by its name in
:data:`MODELS`, or as ``"module:function"`` where it stands outside the package.  A function is imported when it is called.
"""

from __future__ import annotations

import functools
import importlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import xarray as xr

from cablepod.errors import SceneError, one_of, scene_error

#: Marker, colour and label of the settings of a model in figures.
Marker = tuple[str, str, str]
#: Layout of the modes that a study gives to a function that has no attribute ``layout``.
DEFAULT_LAYOUT = "normal"
#: Options that a function of a user's own takes in any case.
NEEDED = ("times", "progress")
AT_THE_TOP = "a function that stands at the top of a module, or its name as module:function"


@dataclass(frozen=True)
class Model:
    """What the package knows of a model."""

    name: str
    where: str  #: module and function, ``"cablepod.chain:simulate"``
    modes: str = "none"  #: "none", "needed" or "optional"
    layout: str | None = None  #: of the modes of a reduced model, None for others
    of_mast: bool = False  #: whether it takes scenes with a mast, and only these
    own: bool = False  #: whether it stands outside the package
    markers: Mapping[str, Marker] = field(default_factory=dict)  #: scheme -> how figures show it

    @property
    def simulate(self) -> Callable[..., xr.Dataset]:
        """The function, of one scene and of scenes with ``member``."""
        found = _found(self.where)
        if not self.own:
            return found
        from cablepod.batch._members import over_members  # not needed to read the table

        @functools.wraps(found)
        def simulate(*args: Any, **options: Any) -> xr.Dataset:
            result = found(*args, **options)
            if not isinstance(result, xr.Dataset):
                raise SceneError(f"model: {self.where} gave a {type(result).__name__}; allowed: a trajectory Dataset")
            return result

        return over_members(simulate)

    @property
    def key(self) -> str:
        """How a file names it: by its name, or one outside the package by module and function."""
        return self.where if self.own else self.name

    @property
    def sub_package(self) -> str:
        """Name of the sub-package, as ``"chain"``."""
        return self.where.partition(":")[0].rpartition(".")[2]

    def options(self) -> dict[str, Any]:
        """Return the options of the function, except ``progress``, with their defaults."""
        arguments = inspect.signature(_found(self.where)).parameters.values()
        return {arg.name: arg.default for arg in arguments if arg.kind is arg.KEYWORD_ONLY and arg.name != "progress"}


#: Name -> model.
MODELS = {
    model.name: model
    for model in (
        Model("chain", "cablepod.chain:simulate", markers={
            "velocity_verlet": ("s", "#003a5c", "chain, explicit"), "trapezoidal": ("o", "#0072B2", "chain, implicit"),
        }),
        Model("cable", "cablepod.cable:simulate", markers={
            "velocity_verlet": ("D", "#2a7f8f", "cable, explicit"), "trapezoidal": ("d", "#56B4E9", "cable, implicit"),
        }),
        Model("rigid", "cablepod.rigid:simulate"),
        Model("condensed", "cablepod.condensed:simulate", "needed", "normal", markers={
            "velocity_verlet": ("^", "#D55E00", "condensed, explicit"), "trapezoidal": ("<", "#E69F00", "condensed, implicit"),
        }),
        Model("galerkin", "cablepod.galerkin:simulate", "needed", "separate", markers={
            "velocity_verlet": ("v", "#CC79A7", "Galerkin"),
        }),
        Model("mast", "cablepod.mast:simulate", "optional", of_mast=True),
    )
}  # fmt: skip
#: Models with modes of a layout, in the order of the tables of a study.
REDUCED = tuple(name for name, model in MODELS.items() if model.layout is not None)


def model_of(given: Any, *, allowed: tuple[str, ...] = tuple(MODELS)) -> Model:
    """Return a model by its name, as ``"module:function"``, or by its function.

    Raises
    ------
    SceneError
        Names ``model``: for an unknown name, and for a function that cannot be imported or lacks an argument.
    """
    where = given if isinstance(given, str) else _where(given)
    for model in MODELS.values():
        if where in (model.name, model.where) and model.name in allowed:
            return model
    if ":" not in where:
        raise scene_error("model", given, f"{one_of(allowed, given)}; or a function of your own")
    found = _found(where)
    if not isinstance(given, str) and found is not given:
        raise SceneError(f"model: given {where}, where another function stands; allowed: {AT_THE_TOP}")
    _check_arguments(where, found)
    layout = getattr(found, "layout", DEFAULT_LAYOUT)
    return Model(where.partition(":")[2], where, "optional", layout, own=True)


def _where(function: Any) -> str:
    """Return module and function as text, the public module of those of the package; nothing for what is no function."""
    if not inspect.isfunction(function):
        return ""
    parts = function.__module__.split(".")
    if parts[0] == __name__.partition(".")[0]:
        parts = [part for part in parts if part[:1] != "_"]
    return f"{'.'.join(parts)}:{function.__qualname__}"


def _found(where: str) -> Callable[..., xr.Dataset]:
    """Import a function."""
    module, _, name = where.partition(":")
    try:
        found: Any = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        raise SceneError(f"model: given {where!r}, which cannot be imported: {error}; allowed: {AT_THE_TOP}") from None
    if not inspect.isfunction(found):
        raise SceneError(f"model: given {where!r}, a {type(found).__name__}; allowed: {AT_THE_TOP}")
    return found


def _check_arguments(where: str, function: Callable[..., xr.Dataset]) -> None:
    """Refuse a function that cannot be called as a model."""
    arguments = inspect.signature(function).parameters
    positions = [arg for arg in arguments.values() if arg.kind in (arg.POSITIONAL_ONLY, arg.POSITIONAL_OR_KEYWORD)]
    keywords = [name for name, arg in arguments.items() if arg.kind is arg.KEYWORD_ONLY]
    if len(positions) != 2 or positions[1].default is inspect.Parameter.empty or not set(NEEDED) <= set(keywords):
        raise SceneError(
            f"model: given {where}{inspect.signature(function)}; allowed: a function (scene, modes=None, *, times=None, "
            "progress=None, ...) with options of its own by keyword"
        )
