"""Odd values for the options of every `simulate`: calls end with a result or a clear error, never with a raw one."""

from __future__ import annotations

import inspect
import warnings
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from public_calls import datasets, function_of

import cablepod as cp

#: Errors that speak to the user.
CLEAR = (cp.SceneError, cp.ArchiveError, cp.RunStopped)
#: Functions that run a model, with the stages of their Datasets.
SIMULATE = {
    "chain.simulate": ("scene",),
    "cable.simulate": ("scene",),
    "rigid.simulate": ("scene",),
    "galerkin.simulate": ("scene", "modes"),
    "condensed.simulate": ("scene", "normal modes"),
    "condensed.prepare": ("scene", "normal modes"),
}
#: Values that no option has, for every option.
ODD: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 2**70, -(2**70), 10**400, 0.0, 0.5, -1.5, np.nan, np.inf, 1e300, 1e-300, 1j, "", "text",
    b"b", "position", "linear", "velocity_verlet", "trapezoidal", "leading", "exact", (), [], {}, set(), [None], [1, "a"],
    [[1], [1, 2]], ["position", None], ("position", 1), [b"position"], ["linear"], ["velocity_verlet"], ["leading"],
    {"position": 1}, {"position"}, np.array(["linear", "green"]), np.array("linear"), np.array(["position"]), np.array([1,
    2]), np.array(1.0), np.array([[0.0]]), np.array([0.0, 1.0]), np.array([], float), np.array([None]), np.array("x", object),
    np.float32(0.5), np.int64(2), np.bool_(True), np.datetime64("2020"), np.timedelta64(1, "s"), [0, 2**70], [2**70],
    [10**400], [0.0, 1e300], range(3), iter([0.0, 1.0]), (0.0, 1.0), (1.0, 0.0), ("position", "tension_extremes"),
    ("tension_extremes", "tension_extremes"), ("tension_peaks",), xr.DataArray([0.0, 1.0]), xr.DataArray(1.0), xr.Dataset(),
    object(), int, len, slice(3), 1e-12, 1e12,
)  # fmt: skip
#: Options that are no numbers or names of the model.
NOT_TRIED = ("scene", "modes", "progress")


class Call(NamedTuple):
    """A call with odd options."""

    name: str
    options: dict[str, Any]


def calls(name: str, count: int, seed: int) -> list[Call]:
    """So many calls of a function with one to three odd options."""
    rng = np.random.default_rng(seed)
    options = [option for option in inspect.signature(function_of(name)).parameters if option not in NOT_TRIED]
    cheap = {"step": 2e-4, "times": [0.0, 0.1]}
    found = []
    for _ in range(count):
        chosen = rng.choice(options, size=min(int(rng.integers(1, 4)), len(options)), replace=False)
        odd = {str(option): ODD[rng.integers(len(ODD))] for option in chosen}
        found.append(Call(name, {key: value for key, value in cheap.items() if key in options} | odd))
    return found


def fault(call: Call) -> str | None:
    """Make a call; tell what is wrong with its outcome, None where it is as it should be."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", "step: given .* takes")  # announced: nothing runs here for hours
            function_of(call.name)(*(datasets()[stage] for stage in SIMULATE[call.name]), **call.options)
    except UserWarning:
        return None
    except CLEAR as error:
        text = str(error)
        return None if len(text) >= 10 and "\n" not in text else f"unclear: {text}"
    except Exception as error:
        return f"raw {type(error).__name__}: {error}"
    return None
